//! Which I-variables a line sets: `I58=0`, `I50..60=0`, `I108,8,100=96`, `I(P1)=0`.

use super::number::Numbers;
use crate::map::{IVariables, Motors};

/// The I-variable that switches command lines through the DPRAM on, in every family.
const ENABLE: u32 = 58;
/// Turbo boards: the address of the DPRAM that the board uses. $60000 is the DPRAM on the host's bus; the others lie
/// at multiples of $4000 behind it (Turbo User Manual p. 45). On PMAC boards I24 is the address of a register to
/// gather, which is none of these.
const PLACE: u32 = 24;
const PLACES: std::ops::RangeInclusive<u32> = 0x6_4000..=0x7_C000;
const APART: u32 = 0x4000;

/// Whether a line ends command lines through the DPRAM, for everybody.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum CutsOff {
    /// The line does not.
    #[default]
    No,
    /// The line may, if the board carries it out at once: it sets a variable whose number only the board can compute.
    May,
    /// The line sets I58 to another value than 1 (DPRAM manual p. 28).
    Enable,
    /// The line sets I24 of a Turbo board to the address of another DPRAM.
    Place,
}

impl CutsOff {
    /// Whether the line certainly ends them.
    #[must_use]
    pub const fn is_certain(self) -> bool {
        matches!(self, Self::Enable | Self::Place)
    }
}

/// The I-variables that a line sets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Settings {
    /// The line sets at least one.
    pub any: bool,
    /// Whether the line ends command lines by these settings.
    pub cuts_off: CutsOff,
    /// The motors whose [`IVariables::SCALES`] the line sets.
    pub scales: [Motors; IVariables::SCALES.len()],
    /// The line sets several at once, or variables that only the board can tell: every scale may be among them.
    pub several: bool,
    /// Those of I0 to I63 that the line names by number; bit 0 is I0.
    low: u64,
    /// Those that the line sets to another value than 3.
    not_3: u64,
    /// The line sets variables that only the board can tell.
    untold: bool,
}

impl Settings {
    /// Notes that the line sets `numbers` to `value`.
    pub(super) fn add(&mut self, numbers: Numbers, value: Option<u32>) {
        let low =
            (0..u64::BITS).filter(|number| numbers.has(*number)).fold(0, |low, number| low | 1 << number);
        self.any = true;
        self.low |= low;
        self.not_3 |= if value == Some(3) { 0 } else { low };
        self.untold |= numbers == Numbers::Unknown;
        let cuts_off = match value {
            value if numbers.has(ENABLE) && value != Some(1) => CutsOff::Enable,
            Some(place) if numbers.has(PLACE) && PLACES.contains(&place) && place % APART == 0 => {
                CutsOff::Place
            }
            value if numbers == Numbers::Unknown && value != Some(1) => CutsOff::May,
            _ => CutsOff::No,
        };
        // The cure depends on the first setting that ends command lines.
        if !self.cuts_off.is_certain() {
            self.cuts_off = self.cuts_off.max(cuts_off);
        }
        let Numbers::One(number) = numbers else {
            self.several = true;
            return;
        };
        if let Some(index) = IVariables::SCALES.iter().position(|scale| *scale == number as usize % 100) {
            self.scales[index].add(Motors::of(number as usize / 100));
        }
    }

    /// Whether the line sets I-variable `number` by its number.
    #[must_use]
    pub const fn has(&self, number: u16) -> bool {
        number < 64 && self.low >> number & 1 != 0
    }

    /// Whether the line may set I-variable `number`; from I64 on, any setting counts.
    #[must_use]
    pub const fn may_have(&self, number: u16) -> bool {
        self.untold || self.has(number) || number >= 64 && self.any
    }

    /// Whether the line sets I-variable `number` to another value than 3.
    #[must_use]
    pub const fn has_not_3(&self, number: u16) -> bool {
        number < 64 && self.not_3 >> number & 1 != 0
    }
}
