//! The bus's side of the daemon: the one thread that owns the board.
//!
//! | place | what is in it |
//! |---|---|
//! | [`board_loop`], `phase` | the loop, its start and its end |
//! | [`board`], `presence`, `reset` | the board opened, gone and back, reset |
//! | [`function_table`], [`board_function`] | who is served next |
//! | [`guard_time`] | what is not begun shortly before a servo update |
//! | [`identify`], `report`, `port_watch` | what the board is, and what of it the clients and the log are told |
//! | [`ports`] | the ways by which lines and interrupts come and go |
//! | [`work`] | one file for each function that clients use |

pub mod board;
pub mod board_function;
pub mod board_loop;
pub mod function_table;
pub mod guard_time;
pub mod identify;
pub(in crate::daemon) mod phase;
pub(in crate::daemon) mod port_watch;
pub mod ports;
pub(in crate::daemon) mod presence;
pub(in crate::daemon) mod report;
pub(in crate::daemon) mod reset;
pub mod work;
