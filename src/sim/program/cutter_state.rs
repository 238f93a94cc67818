//! What cutter radius compensation remembers between moves.

use super::cutter::Element;
use super::item::Mode;
use super::place::Cursor;
use super::trajectory::Later;
use super::transform::Vector;

/// The state of the compensation.
#[derive(Debug, Clone, Default)]
pub struct Cutter {
    /// 1 left, -1 right, 0 off.
    pub side: f64,
    /// CCR, in user units.
    pub radius: f64,
    /// The move held back until the next one is known.
    pub held: Option<Held>,
    /// The programmed position, while the axes are beside it.
    pub programmed: Option<[f64; 9]>,
    /// The next move leads in.
    pub leads_in: bool,
}

impl Cutter {
    /// Drops the moves, keeps CC and CCR. Returns where calculation was at the held move.
    pub fn reset(&mut self) -> Option<Cursor> {
        self.programmed = None;
        self.held.take().and_then(|held| held.cursor)
    }

    /// The programmed position, if the axes are beside it.
    #[must_use]
    pub fn programmed(&self) -> Option<[f64; 9]> {
        self.programmed
    }
}

/// A move held back.
#[derive(Debug, Clone)]
pub struct Held {
    /// Its geometry in the plane.
    pub element: Element,
    /// Its programmed end.
    pub end: [f64; 9],
    /// The centre of an arc.
    pub centre: Option<Vector>,
    /// It leads in: it is the first after CC1 or CC2.
    pub leads_in: bool,
    /// The move mode in force when it was programmed.
    pub mode: Mode,
    /// Where calculation was.
    pub cursor: Option<Cursor>,
    /// Assignments that take effect when it begins.
    pub later: Vec<Later>,
    /// TA, TS, F or TM, and the first `??` word's bit for TM.
    pub times: [f64; 3],
    /// See `times`.
    pub by_time: u32,
}
