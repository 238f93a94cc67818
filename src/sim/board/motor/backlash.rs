//! The side of its backlash on which a motor is, and how far the motor has taken it up.

/// How far a motor's backlash is taken up.
#[derive(Debug, Clone, Copy, Default)]
pub struct Backlash {
    /// `?` word 2 bit 4: the motor went in the negative direction last.
    pub negative: bool,
    /// The farthest commanded position in that direction; `None` before the first look.
    extreme: Option<f64>,
    /// Counts added now.
    pub added: f64,
}

impl Backlash {
    /// The position's zero has moved.
    pub fn shift(&mut self, by: f64) {
        self.extreme = self.extreme.map(|extreme| extreme + by);
    }

    /// Follows the commanded position: the direction changes when that position has gone back by more than `hysteresis`
    /// counts.
    pub fn follow(&mut self, commanded: f64, hysteresis: f64) {
        let extreme = self.extreme.get_or_insert(commanded);
        let sign = if self.negative { -1.0 } else { 1.0 };
        let behind = (*extreme - commanded) * sign;
        if behind > hysteresis {
            self.negative = !self.negative;
        }
        if behind < 0.0 || behind > hysteresis {
            *extreme = commanded;
        }
    }
}
