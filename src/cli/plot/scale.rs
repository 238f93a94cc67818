//! An axis: its ends, and the round numbers marked on it.

use crate::client::number::{digits, fixed};

/// Room above and below the values, as a part of their span.
const ROOM: f64 = 0.05;
/// Steps outside of these have an exponent.
const PLAIN: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// Digits of a number that is written with an exponent.
const DIGITS: usize = 6;

/// The largest value to draw: the distance of two such values is a number, too.
const LARGEST_DRAWN: f64 = 1e300;

/// The ends of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    pub low: f64,
    pub high: f64,
}

impl Scale {
    /// The span of the `values` that can be drawn; `None` without values. One value alone is in the middle.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let reach =
            |Self { low, high }: Self, value: f64| Self { low: low.min(value), high: high.max(value) };
        let nothing = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };
        let scale = values.filter(|value| value.abs() <= LARGEST_DRAWN).fold(nothing, reach);
        if scale.low > scale.high {
            return None;
        }
        // As wide as an f64 can tell apart at the least.
        let least = scale.low.abs().max(scale.high.abs()) * 1e-12;
        if scale.high - scale.low > least {
            return Some(scale);
        }
        let value = scale.low.abs();
        let half = if value == 0.0 { 1.0 } else { (value * 1e-3).min(1.0).max(value * 1e-9) };
        Some(Self { low: scale.low - half, high: scale.high + half })
    }

    /// With room at both ends.
    pub fn with_room(self) -> Self {
        let room = (self.high - self.low) * ROOM;
        Self { low: self.low - room, high: self.high + room }
    }

    /// Whether the axis has `value`.
    pub fn has(self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// The place of `value` on the axis: 0 at the low end, 1 at the high end.
    pub fn part(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// At most `most` round numbers on the axis, ascending, and their texts.
    pub fn marks(self, most: usize) -> Vec<(f64, String)> {
        let span = self.high - self.low;
        let rough = span / most.max(1) as f64;
        let power = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
        let step = step.unwrap_or(10.0 * power);
        let first = (self.low / step).ceil();
        let count = (self.high / step).floor() - first;
        if !count.is_finite() {
            return Vec::new();
        }
        // A sum of steps would add up their rounding errors.
        (0..=count.max(0.0) as usize)
            .map(|index| (first + index as f64) * step)
            .filter(|value| self.has(*value))
            .map(|value| (value, written(value, step)))
            .collect()
    }
}

fn written(value: f64, step: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !PLAIN.contains(&step) || value.abs() >= 1e15 {
        return digits(value, DIGITS);
    }
    let places = (-step.log10().floor()).max(0.0) as usize;
    fixed(value, places)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marks(low: f64, high: f64, most: usize) -> Vec<String> {
        Scale { low, high }.marks(most).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn marks_are_round_numbers_with_the_places_they_need() {
        assert_eq!(
            marks(0.0, 1.0, 5),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"].map(|t| if t == "0.0" { "0" } else { t })
        );
        assert_eq!(marks(-3.0, 14.0, 4), ["0", "5", "10"]);
        assert_eq!(marks(299_995.0, 300_005.0, 5), ["299996", "299998", "300000", "300002", "300004"]);
        assert_eq!(marks(0.0, 4e-9, 4), ["0", "1e-9", "2e-9", "3e-9", "4e-9"]);
        assert_eq!(marks(0.0, 2e9, 2), ["0", "1000000000", "2000000000"]);
        assert_eq!(marks(-0.25, -0.05, 2), ["-0.2", "-0.1"]);
    }

    #[test]
    fn a_flat_trace_stands_in_the_middle() {
        let of = |values: &[f64]| Scale::of(values.iter().copied());
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[f64::NAN, f64::INFINITY, f64::MAX]), None);
        assert_eq!(of(&[0.0, f64::NAN]), Some(Scale { low: -1.0, high: 1.0 }));
        assert_eq!(of(&[5000.0]), Some(Scale { low: 4999.0, high: 5001.0 }));
        assert_eq!(of(&[3.0, f64::INFINITY, -1.0]), Some(Scale { low: -1.0, high: 3.0 }));
        for value in [1e300, -1e-300, 1e15] {
            let scale = of(&[value]).unwrap();
            assert!((0.4..0.6).contains(&scale.part(value)), "{value}: {scale:?}");
            assert!(scale.marks(6).len() <= 8, "{value}");
        }
    }
}
