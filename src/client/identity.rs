//! The segment's identity of the board, in the terms of its decoder.

use crate::decode::{MotorScales, Scales};
use crate::map::{DEFAULT_FAMILY, Family};
use crate::segment::Identity;

/// The board's family; [`DEFAULT_FAMILY`] if the segment does not say, `None` if this library does not know the family.
#[must_use]
pub fn family(identity: &Identity) -> Option<&'static Family> {
    match identity.family {
        None => Some(DEFAULT_FAMILY),
        Some(number) => Family::by_number(number),
    }
}

/// The known scales of the board's motors.
#[must_use]
pub fn scales(identity: &Identity) -> Scales {
    let motor = |index: usize| MotorScales {
        position_scale: identity.ix08[index].map(f64::from),
        velocity_scale: identity.ix09[index].map(f64::from),
        master_scale: identity.ix07[index].map(f64::from),
        loop_cycles: identity.ix60[index].map(|extension| f64::from(extension) + 1.0),
    };
    Scales { motors: (0..identity.ix08.len()).map(motor).collect(), i10: identity.i10 }
}

/// How many motors and coordinate systems the board's reports have: the board's answer, else all of `family`.
#[must_use]
pub fn reported(identity: &Identity, family: &Family) -> usize {
    let said = identity.reported_motors().or(identity.motors).and_then(|count| usize::try_from(count).ok());
    said.unwrap_or(family.motors).min(family.motors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_said_takes_the_defaults() {
        let identity = Identity::default();
        let family = family(&identity).unwrap();
        assert_eq!(family.name, "pmac");
        assert_eq!(reported(&identity, family), 8);
        assert_eq!(scales(&identity).motor(1), MotorScales::default());
    }

    #[test]
    fn what_is_said_counts_as_far_as_it_is_known_here() {
        let mut identity = Identity {
            family: Some(2),
            motor_mask: Some(0b111),
            i10: Some(3_713_707),
            ..Identity::default()
        };
        identity.ix08[2] = Some(96);
        assert_eq!(family(&identity).unwrap().name, "pmac2");
        assert_eq!(reported(&identity, family(&identity).unwrap()), 3);
        assert_eq!(scales(&identity).motor(3).position_scale, Some(96.0));
        assert_eq!(scales(&identity).motor(1).position_scale, None);
        identity.motor_mask = Some(u32::MAX);
        assert_eq!(reported(&identity, family(&identity).unwrap()), 8);
        identity.family = Some(99);
        assert!(family(&identity).is_none());
    }
}
