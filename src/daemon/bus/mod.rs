//! The bus's side of the daemon: the one thread that owns the board.
//!
//! | place | what is in it |
//! |---|---|
//! | [`board_loop`], [`phase`] | the loop, its start and its end |
//! | [`waits`], [`readable`], [`doorbell`] | how it waits, and what for |
//! | [`board`], [`presence`] | the board opened, gone and back |
//! | [`function_table`], [`board_function`] | who is served next |
//! | [`guard_time`] | what is not begun shortly before a servo update |
//! | [`command_intake`] | commands from the socket, answers to it |
//! | [`identify`], [`change_watch`], [`scale_doubts`], [`report`] | what the board is, who else changes it, and what of it the clients and the log are told |
//! | [`memory_scan`], [`servo_sign`] | where the board's own programs keep data, and what needs not wait for it |
//! | `timing` | how long it waits for what |
//! | [`ports`] | the ports by which lines and interrupts come and go |
//! | [`work`] | one file for each function that clients use |

pub mod board;
pub mod board_function;
pub mod board_loop;
pub mod change_watch;
pub mod command_intake;
pub mod doorbell;
pub mod function_table;
pub mod guard_time;
pub mod identify;
pub mod memory_scan;
pub mod phase;
pub mod ports;
pub mod presence;
pub mod readable;
pub mod report;
pub mod scale_doubts;
pub mod servo_sign;
mod timing;
pub mod waits;
pub mod work;
