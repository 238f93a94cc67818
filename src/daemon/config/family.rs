//! Which family the board is of, as the settings say it.

use crate::device::BoardSpec;
use crate::map::{DEFAULT_FAMILY, Family};

/// The family of `board`, where `written` is what the configuration says.
///
/// # Errors
/// The two contradict each other, or no board of the family has such a DPRAM.
pub(super) fn decide(board: &BoardSpec, written: Option<&'static Family>) -> Result<&'static Family, String> {
    let BoardSpec::Simulator(simulator) = board else { return Ok(written.unwrap_or(DEFAULT_FAMILY)) };
    let started = simulator.family.map(Family::by_name).transpose().map_err(|error| error.to_string())?;
    if let (Some(started), Some(written)) = (started, written)
        && started != written
    {
        return Err(format!(
            "the board is sim,family={}, but family = \"{}\" in the configuration says otherwise; remove one of the two",
            started.name, written.name
        ));
    }
    let family = started.or(written).unwrap_or(DEFAULT_FAMILY);
    simulator.dpram.map_or(Ok(family), |size| family.with_dpram(size))
}
