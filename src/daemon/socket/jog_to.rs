//! A jog to a position: the client's request, and the command line for the board.
//!
//! The control panel has no request for such a jog, so the daemon sends a command line: `#nJ={constant}`. `#n` changes
//! the motor that every sender addresses (User Manual p. 29), so the line addresses the earlier motor again.

use std::time::{Duration, Instant};

use crate::daemon::shared::parameters::check_number;
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, LINE_MAX, Text};
use crate::map::{Family, Motors};
use crate::protocol::{CallError, calls};

/// How long the daemon's question and the line may take together.
const TIMEOUT: Duration = DEFAULT_TIMEOUT;
/// The limit of PMAC's software limits: 2^35 counts (Software Reference p. 72).
const FARTHEST: f64 = 34_359_738_368.0;

/// A client's request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JogTo {
    /// The motor, from 1 on.
    motor: u32,
    /// The position to reach, in counts.
    position: f64,
    /// The motor that the board addresses, once the board has told it.
    pub(super) addressed: Option<u32>,
}

impl JogTo {
    /// The request that `call` makes.
    ///
    /// # Errors
    /// `family` has no such motor, or a motor does not count so far.
    pub(super) fn of(call: &calls::JogTo, family: &Family) -> Result<Self, CallError> {
        check_number(call.motor, family.motors, "motor")?;
        if call.position.is_nan() || call.position.abs() >= FARTHEST {
            return Err(CallError::invalid(
                "position",
                format_args!("less than {FARTHEST} counts either way: a motor counts no farther"),
            ));
        }
        let motor = u32::try_from(call.motor).unwrap_or_default();
        Ok(Self { motor, position: call.position, addressed: None })
    }

    /// When the daemon gives up a jog that begins `now`.
    pub(super) fn deadline(now: Instant) -> Instant {
        now + TIMEOUT
    }

    /// The motor, as a set of one.
    pub(super) const fn motors(self) -> Motors {
        Motors::of(self.motor as usize)
    }

    /// The line that jogs the motor and then addresses the earlier motor again; `None` until the board has told which
    /// motor it addresses.
    pub(super) fn line(self) -> Option<Text<LINE_MAX>> {
        let Self { motor, position, addressed } = self;
        addressed.map(|addressed| Text::of(&format_args!("#{motor}J={}#{addressed}", constant(position))))
    }
}

/// The position as the board takes it: to 1/32 of a count, without an exponent.
fn constant(counts: f64) -> String {
    ((counts * 32.0).round() / 32.0 + 0.0).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn a_position_is_sent_to_a_32nd_of_a_count() {
        for (counts, text) in [
            (5000.0, "5000"),
            (-0.001, "0"),
            (0.1, "0.09375"),
            (-34_359_738_367.9, "-34359738367.90625"),
            (1e10, "10000000000"),
        ] {
            let jog = JogTo::of(&calls::JogTo { motor: 3, position: counts }, &PMAC).unwrap();
            assert!(jog.line().is_none(), "the board has not said what is addressed");
            let line = JogTo { addressed: Some(2), ..jog }.line().unwrap();
            assert_eq!((&*line, jog.motors()), (&*format!("#3J={text}#2"), Motors::of(3)));
        }
    }

    #[test]
    fn a_jog_of_no_motor_or_too_far_is_refused() {
        for (motor, position, name) in [
            (0, 1.0, "motor"),
            (9, 1.0, "motor"),
            (1, 4e10, "position"),
            (1, -FARTHEST, "position"),
            (1, f64::NAN, "position"),
        ] {
            let refused = JogTo::of(&calls::JogTo { motor, position }, &PMAC).unwrap_err();
            assert!(
                matches!(&refused, CallError::InvalidParameter { parameter, .. } if parameter == name),
                "{refused}"
            );
        }
    }
}
