//! The simulated board: PMAC's half of every handshake, with motors that move (layer 5).
//!
//! The simulator shares with the driver only the number formats and the register map: it is the opponent in every test.
//! It runs as its own process (`pmac-sim`) against a file that a host maps too, so that both sides really race; or step
//! by step in the process of a test ([`world`]).
//!
//! Lowest first; a row knows nothing of the rows below it:
//!
//! | room or file | content |
//! |---|---|
//! | [`fault`], [`judge`] | faults that a test sets in the board; a host's breaches of the handshakes |
//! | [`board`] | memory, variables, motors, coordinate systems, status words |
//! | [`language`], lower half | scanner, expressions, axis lists: shared by programs and commands |
//! | [`program`] | program buffers, motion programs, PLCs |
//! | [`language`], upper half | the interpreter of on-line commands; the serial port's characters |
//! | [`functions`] | the automatic functions of the DPRAM, the mailboxes, the ISA host port |
//! | [`world`], [`control`] | all of it together, one servo cycle a step; the control socket's commands |
//! | [`process`] | options, sockets, real time |

pub mod board;
#[cfg(test)]
mod command_tests;
pub mod control;
#[cfg(test)]
mod driver_tests;
pub mod fault;
pub mod functions;
pub mod judge;
#[cfg(test)]
mod judge_tests;
pub mod language;
#[cfg(test)]
mod motion_tests;
pub mod process;
pub mod program;
#[cfg(test)]
mod real_program_tests;
#[cfg(test)]
mod register_tests;
#[cfg(test)]
mod reset_tests;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tools_tests;
#[cfg(test)]
mod turbo_tests;
pub mod world;
