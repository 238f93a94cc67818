//! The fields of a coordinate system that only Turbo boards report (Turbo User Manual p. 405; the register table marks
//! those that only the vendor's headers tell).

use super::quantity::{Flags, Quantity, Scales};
use super::{Block, flags};
use crate::format::Float48Layout;
use crate::map::StatusTable;

/// In the pointer word: a feed hold is in progress.
const FEED_HOLD: u32 = 1 << 22;
/// In the pointer word: the bits of the address.
const ADDRESS: u32 = (1 << 19) - 1;

/// The fields of a coordinate system that only Turbo boards report; `None` if the daemon did not read them.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TurboSystem {
    /// The programmed feed rate, F, in user units per Isx90 time units; `None` also while moves are programmed by time.
    pub feed_rate: Option<f64>,
    /// The programmed move time, TM, in milliseconds; `None` also while moves are programmed by feed rate.
    pub move_time_ms: Option<f64>,
    /// The present time base.
    pub time_base: Option<Quantity>,
    /// Where the desired time base comes from, Isx93.
    pub time_base_register: Option<Quantity>,
    /// Whether a feed hold is in progress.
    pub feed_hold: Option<bool>,
    /// The lookahead status word, the third word of `??`.
    pub lookahead_status_word: Option<u32>,
    /// The flags of the lookahead status word.
    pub lookahead_status: Option<Flags>,
}

/// Where these fields begin in a block, in 16-bit words.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurboFields {
    feedrate_or_time: usize,
    feedpot: usize,
    feedpot_pointer: usize,
    status_word_3: usize,
}

impl TurboFields {
    /// The places by the table's names; `None` when the family lacks one.
    pub(super) fn of(field: impl Fn(&str) -> Option<usize>) -> Option<Self> {
        Some(Self {
            feedrate_or_time: field("feedrate_or_time")?,
            feedpot: field("feedpot")?,
            feedpot_pointer: field("feedpot_pointer")?,
            status_word_3: field("status_word_3")?,
        })
    }

    /// Decodes a block whose first status word has the flags `status`.
    pub(super) fn decode(
        &self,
        block: &Block,
        status: Option<Flags>,
        tables: &'static [StatusTable],
        scales: &Scales,
        float48: Float48Layout,
    ) -> TurboSystem {
        let by_time = status.map(|status| status.has("move_by_time"));
        let speed = |by: bool| block.float(self.feedrate_or_time, float48).filter(|_| by_time == Some(by));
        let pointer = block.unsigned(self.feedpot_pointer);
        let lookahead_status_word = block.unsigned(self.status_word_3);
        TurboSystem {
            feed_rate: speed(false),
            move_time_ms: speed(true),
            time_base: block.signed(self.feedpot).map(|raw| Quantity::time_base(raw, scales.i10)),
            time_base_register: pointer.map(|pointer| Quantity::address(pointer & ADDRESS)),
            feed_hold: pointer.map(|pointer| pointer & FEED_HOLD != 0),
            lookahead_status_word,
            lookahead_status: flags(lookahead_status_word, tables.get(2)),
        }
    }
}
