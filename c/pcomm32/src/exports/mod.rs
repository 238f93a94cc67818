//! The exported names, with the prototypes of the vendor's headers. `long` has 32 bits there.
#![allow(non_camel_case_types, clippy::upper_case_acronyms)]

mod ascii;
mod device;
mod memory;
mod status;
mod stubs;
mod variables;
mod work;

use std::ffi::c_void;

type BOOL = i32;
type DWORD = u32;
/// `int`, `long`, and enumerations.
type int = i32;
/// A function that C# programs declare with a result of 64 bits: the upper half must be 0.
type wide = usize;
/// A pointer that nobody follows.
type Pointer = *const c_void;

const FALSE: BOOL = 0;
const TRUE: BOOL = 1;

/// TRUE for success.
fn truth<T, E>(outcome: Result<T, E>) -> BOOL {
    BOOL::from(outcome.is_ok())
}

/// A status structure of the vendor's headers: longs of the DPRAM, whose bit fields the program's compiler knows.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Words<const COUNT: usize>([u32; COUNT]);
