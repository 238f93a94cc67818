//! The functions of Delta Tau's PComm32 on Linux, over `pmacd`: a program is compiled anew, or loads this library under
//! the name that it knows.
//!
//! | layer | modules |
//! |---|---|
//! | 0 | `border`: all that C hands over, and all `unsafe` · `fault`: how calls fail · `config`: which board a device is |
//! | 1 | `device`: one device of this process · `process`: the devices of each process |
//! | 2 | `ascii`: lines and replies · `variables` · `memory`: the DPRAM by byte offset · `status`: the board's reports · `rotary`: streams of motion programs · `download`: program files · `texts`: of the board's programs, and callbacks |
//! | 3 | `exports`: the names, with the vendor's prototypes |
//!
//! # Invariants
//! * `unsafe` lives in `border.rs` alone.
//! * No panic crosses the border, and no argument of a program crashes it: NULL, a device number above 7, a closed device
//!   and a short buffer are errors.
//! * Every wait is bounded. A stop waits for no other thread of the program.
//! * A forked child opens its own connections.
#![allow(non_snake_case)]

mod ascii;
mod border;
mod config;
mod device;
mod download;
mod exports;
mod fault;
mod memory;
mod process;
mod rotary;
mod status;
mod texts;
mod variables;
