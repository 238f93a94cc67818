//! The means to decode a board's words.

use super::identity;
use crate::decode::{BackgroundData, BackgroundDecoder, Scales, ServoData, ServoDecoder, TooShort};
use crate::format::Float48Layout;
use crate::segment::{Identity, RegionInfo};

/// The numbers of motors and of background blocks that the board reports, and the motors' scales.
#[derive(Debug, Clone)]
pub(super) struct Decoder {
    servo: ServoDecoder,
    background: BackgroundDecoder,
    motors: usize,
    blocks: usize,
    scales: Scales,
}

impl Decoder {
    /// The decoder for a board of this identity; `None` for a family that this version does not know.
    pub(super) fn new(identity: &Identity) -> Option<Self> {
        let family = identity::family(identity)?;
        let motors = identity::reported(identity, family);
        Some(Self {
            servo: ServoDecoder::new(family),
            background: BackgroundDecoder::new(family),
            motors,
            blocks: family.background.reported(motors),
            scales: identity::scales(identity),
        })
    }

    pub(super) fn servo(&self, region: &RegionInfo, words: &[u16]) -> Result<ServoData, TooShort> {
        self.servo.decode(words, held(self.motors, region, words), &self.scales, region.selection)
    }

    pub(super) fn background(&self, region: &RegionInfo, words: &[u16]) -> Result<BackgroundData, TooShort> {
        let numbers = held(self.blocks, region, words);
        let layout = Float48Layout::default();
        self.background.decode(words, numbers, &self.scales, layout, region.selection)
    }
}

/// How many of the reported `numbers` are in a payload: an older payload may have fewer than the board's present mask.
fn held(numbers: usize, region: &RegionInfo, words: &[u16]) -> usize {
    numbers.min(region.blocks.held_in(2 * words.len()))
}
