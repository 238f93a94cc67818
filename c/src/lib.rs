//! `libpmac_dpram.so`: the client library for C, C++ and every language that calls C. `include/pmac_dpram.h` is its
//! page; `tests/header.rs` writes that file from the functions of `border`.
//!
//! Only `border` holds `unsafe`: its functions turn pointers into references and call safe code. Nothing here keeps
//! global state, ends the process, handles a signal, or lets a panic out.

mod board;
mod border;
mod failure;
mod per_process;
mod replies;
mod sequences;
mod snapshot;
mod streams;
mod types;
mod updates;
