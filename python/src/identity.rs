//! The board's identity, as the board has told `pmacd`.

use pmac_dpram::map::Family;
use pmac_dpram::segment::Identity as Told;
use pyo3::prelude::*;

/// The board's identity. A field is `None` if the board has not told it.
#[pyclass(frozen, get_all, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Identity {
    /// The family: `pmac`, `pmac2`, `turbo` or `turbo2`.
    family: Option<&'static str>,
    /// Its answer to `TYPE`.
    r#type: Option<String>,
    /// The firmware version, as `1.16D`.
    firmware: Option<String>,
    /// The servo period in nanoseconds.
    servo_period_ns: Option<f64>,
    /// Servo cycles from one update to the next.
    servo_report_cycles: Option<u32>,
}

impl Identity {
    /// The identity in the segment's data.
    pub fn of(told: &Told) -> Self {
        Self {
            family: told.family.and_then(Family::by_number).map(|family| family.name),
            r#type: told.board_type.as_ref().map(ToString::to_string),
            firmware: told.firmware.as_ref().map(ToString::to_string),
            servo_period_ns: told.servo_period_ps.map(|picoseconds| picoseconds as f64 / 1e3),
            servo_report_cycles: told.servo_report_cycles,
        }
    }
}
