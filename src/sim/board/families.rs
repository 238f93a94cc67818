//! The families that can be simulated.

use super::firmware::{FirmwareTables, PMAC, PMAC2};
use super::turbo::{TURBO, TURBO_32K, TURBO2, TURBO2_8K};

/// Each with the DPRAM it comes with.
pub static SIMULATED: &[&FirmwareTables] = &[&PMAC, &PMAC2, &TURBO, &TURBO2];
/// Those with a DPRAM of another size.
static OTHER_LENGTHS: &[&FirmwareTables] = &[&TURBO_32K, &TURBO2_8K];

/// The firmware of `tables` on a board with a DPRAM of `length` bytes; `None` for a size that no such board has.
#[must_use]
pub fn with_length(tables: &FirmwareTables, length: u32) -> Option<&'static FirmwareTables> {
    let all = SIMULATED.iter().chain(OTHER_LENGTHS).copied();
    all.into_iter().find(|other| other.family.name == tables.family.name && other.family.length == length)
}
