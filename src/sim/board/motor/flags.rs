//! A motor's flags: where its switches lie on the way of the shaft, and the flag that triggers a move.
//!
//! Turbo Software Reference pp. 102 (Ixx24), 157 (Ixx97), 222 and 228 (I7mn2 and I7mn3).

use crate::sim::board::Board;
use crate::sim::board::motor::{INDEX_PERIOD, Inputs, Motor};

/// What lies on the way of the shaft. The first four are the flags of a channel, in I7mn3's order.
pub const PLACES: [&str; 5] = ["home", "plus", "minus", "user", "stop"];
/// The limit switch at the positive end.
pub const PLUS: usize = 1;
/// The limit switch at the negative end.
pub const MINUS: usize = 2;
/// A hard stop: nothing turns the shaft into it.
pub const STOP: usize = 4;

/// The shaft positions of a switch that is on, or off, everywhere.
pub const fn everywhere(is_on: bool) -> [f64; 2] {
    if is_on { [f64::NEG_INFINITY, f64::INFINITY] } else { [0.0; 2] }
}

/// What a channel captures the position at, and what the flags do.
#[derive(Debug, Clone, Copy, Default)]
pub struct Capture {
    /// I7mn2: bit 0 asks for the index, bit 1 for the flag; bits 2 and 3 invert them.
    mode: u32,
    /// I7mn3: the flag's place.
    flag: usize,
    /// The flag has to change: a PMAC-style gate array triggers on edges, a PMAC2-style one on levels.
    is_edge: bool,
    /// The warning following error is the trigger.
    pub(super) is_warning: bool,
    /// The limit switches stop the motor.
    pub(super) limits: bool,
}

impl Inputs {
    /// Whether the shaft is in place `place` when it is at `shaft`.
    pub fn is_on(&self, place: usize, shaft: f64) -> bool {
        let [from, to] = self.places[place];
        (from..to).contains(&shaft)
    }
}

impl Motor {
    /// Where the shaft was when the flags triggered, on its way from `before`.
    pub(super) fn captured(&self, before: f64) -> Option<f64> {
        let Capture { mode, flag, is_edge, .. } = self.capture;
        let is_on = |at| self.inputs.is_on(flag, at) != (mode & 8 != 0);
        let flag_triggers = is_on(self.shaft) && !(is_edge && is_on(before));
        let index = index_between(before, self.shaft).filter(|_| !self.inputs.no_index);
        match mode & 3 {
            0 => Some(self.shaft),
            2 if !flag_triggers => None,
            2 => {
                let edges = self.inputs.places[flag].into_iter();
                let mut crossed =
                    edges.filter(|edge| (before.min(self.shaft)..=before.max(self.shaft)).contains(edge));
                Some(crossed.next_back().filter(|_| !is_on(before)).unwrap_or(self.shaft))
            }
            asked => {
                let pulse = if mode & 4 == 0 { index } else { Some(self.shaft) };
                pulse.filter(|&at| asked & 2 == 0 || is_on(at))
            }
        }
    }
}

impl Board {
    /// The capture of the 0-based `motor` as the I-variables set it now.
    pub(in crate::sim::board) fn capture(&self, motor: usize) -> Capture {
        // A board lists I7mn2 as 0 where it has no gate array; the simulated board's arrays have the factory's 1.
        const INDEX: u32 = 1;
        let settings = self.settings();
        let flags = self.setting(settings.flag_mode, motor) as u32;
        let (trigger, bit) = settings.error_trigger;
        let mut capture = Capture {
            mode: INDEX,
            flag: 0,
            is_edge: flags & 1 == 0,
            is_warning: self.setting(trigger, motor) as u32 & bit != 0,
            limits: flags >> 17 & 1 == 0,
        };
        if settings.has_channels && self.motors[motor].searching() {
            let address = self.ix(motor, 25) as usize;
            let own = |number| Some(self.variables.i(number));
            let station = |number| self.station_variable((address - 0x3440, number)).ok();
            let variables = match address {
                0x3440..=0x347F => [912, 913].map(station),
                0x7_8000..=0x7_BFFF => {
                    let channel = if capture.is_edge { address % 16 / 4 } else { address % 32 / 8 };
                    let first = if address >> 9 & 1 == 0 { 0 } else { 2 + (address >> 12 & 3) * 2 };
                    let number = 7012 + 100 * (first + (address >> 8 & 1)) + 10 * channel;
                    [number, number + 1].map(own)
                }
                _ => [None; 2],
            };
            let [mode, flag] = variables.map(|value| value.unwrap_or(0.0) as u32);
            capture.mode = if mode == 0 { INDEX } else { mode };
            capture.flag = flag as usize & 3;
        }
        capture
    }
}

/// The position of the index pulse between `before` and `after`, if any.
fn index_between(before: f64, after: f64) -> Option<f64> {
    let pulse = if after > before {
        (after / INDEX_PERIOD).floor() * INDEX_PERIOD
    } else {
        (after / INDEX_PERIOD).ceil() * INDEX_PERIOD
    };
    (after > before && pulse > before || after < before && pulse < before).then_some(pulse)
}
