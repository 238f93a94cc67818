//! The simulated board: PMAC's half of every handshake, with motors that move (layer 5).
//!
//! It shares with the driver only the number formats and the register map: it is the opponent in every test. It runs
//! as its own process (`pmac-sim`) against a file that a host maps too, so that both sides really race.
//!
//! | file | what it is on the board |
//! |---|---|
//! | [`world`] | all of it together: one servo cycle a step, interrupts as counts |
//! | [`memory`], [`dpram`] | X and Y memory, and the part shared with the host |
//! | [`board`], `commands`, `board_commands`, `axis_position`, `registers` | servo interrupt and background loop; what commands do; status words |
//! | `compensation` | leadscrew and backlash compensation |
//! | `set_up` | registers that SAVE keeps beside the variables |
//! | [`motor`], `supervision`, [`profile`], [`coordinate`] | servo loop, drive and shaft; jog and home moves; time base |
//! | [`servo_report`], [`background_report`], [`ascii`], [`gather`] | the automatic functions of the DPRAM |
//! | [`program`] | program buffers, motion programs, PLCs |
//! | [`functions`]: [`panel`], [`variable_read`], [`variable_write`], [`rotary_transfer`], `claims` | those that work by flags in the background pass; who uses which stretch |
//! | [`mailbox`], [`host_port`] | the VME mailbox port; the interrupt registers of the ISA port |
//! | [`language`] | the interpreter of on-line commands |
//! | [`judge`], [`fault`] | what a host does wrong; what the board can be told to do wrong |

pub mod ascii;
#[cfg(test)]
mod ascii_tests;
mod axis_position;
pub mod background_report;
pub mod board;
mod board_commands;
mod claims;
pub mod clock;
mod commands;
mod compensation;
pub mod control;
pub mod coordinate;
pub mod dpram;
pub mod fault;
pub mod functions;
pub mod gather;
pub mod host_port;
pub mod identity;
pub mod interrupt;
pub mod judge;
pub mod language;
pub mod mailbox;
pub mod memory;
#[cfg(test)]
mod motion_tests;
pub mod motor;
pub mod offsets;
pub mod options;
pub mod panel;
pub mod process;
pub mod profile;
pub mod program;
mod random;
#[cfg(test)]
mod register_tests;
mod registers;
#[cfg(test)]
mod reset_tests;
pub mod rotary_transfer;
pub mod serial;
pub mod servo_report;
mod set_up;
pub mod socket;
mod supervision;
#[cfg(test)]
mod testing;
pub mod variable_read;
pub mod variable_write;
pub mod world;

/// The start-up file that enables all DPRAM functions for eight motors.
pub const STARTUP: &str = include_str!("dpram-startup.pmc");
