//! Checks of parameters that several methods have.

use crate::map::{Family, HostOffset};
use crate::protocol::{CallError, calls};

/// The first of `words` words at `offset`, all of them in the DPRAM; `name` is the parameter's.
pub fn inside(
    calls::Offset(offset): calls::Offset,
    words: usize,
    name: &str,
    family: &Family,
) -> Result<HostOffset, CallError> {
    let end = family.length;
    if offset.bytes() >= end {
        return Err(CallError::invalid(name, format_args!("an even number from 0 to {}", end - 2)));
    }
    let fits = words <= (end - offset.bytes()) as usize / 2;
    if fits { Ok(offset) } else { Err(CallError::OutOfRange) }
}

/// Checks that `number` is from 1 to `count`; `name` is the parameter's.
pub fn check_number(number: usize, count: usize, name: &str) -> Result<(), CallError> {
    let is_one = (1..=count).contains(&number);
    if is_one { Ok(()) } else { Err(CallError::invalid(name, format_args!("1 to {count}, not {number}"))) }
}

/// The index of the rotary buffer with this number, from 1.
pub fn rotary_buffer(number: u8, family: &Family) -> Result<usize, CallError> {
    let count = family.rotary.headers.len();
    let index = usize::from(number).checked_sub(1).filter(|index| *index < count);
    index.ok_or_else(|| CallError::invalid("buffer", format_args!("1 to {count}")))
}
