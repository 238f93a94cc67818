//! The bus's side of the daemon: the one thread that owns the board.
//!
//! | place | what is in it |
//! |---|---|
//! | [`board_loop`], [`phase`] | the loop, its start and its end |
//! | [`waits`], [`readable`], [`doorbell`] | how the bus thread waits: for the time, commands and interrupts |
//! | [`board`], [`presence`] | how the daemon opens the board, and sees it go and come back |
//! | [`function_table`], [`board_function`] | which function of the board the bus thread serves next |
//! | [`guard_time`] | the work that the bus thread does not begin shortly before a servo update |
//! | [`command_intake`] | commands from the socket, answers to it |
//! | [`identify`], [`change_watch`], [`scale_doubts`], [`report`] | the board's identity, others' changes to the board, news for clients and log |
//! | [`memory_scan`], [`servo_sign`] | where the board's own programs keep data; the servo report's sign of life, used before that is known |
//! | `timing` | the limits of the bus thread's waits |
//! | [`ports`] | the ports that carry lines and interrupts |
//! | [`work`] | the work for clients, a file for each function |

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
