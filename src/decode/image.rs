//! A raw dump of the whole DPRAM, from a file.

use super::TooShort;
use super::background::{BackgroundData, background};
use super::quantity::Scales;
use super::servo::{ServoData, servo};
use super::value::{Value, value};
use crate::format::{Float48Layout, WordOrder};
use crate::map::{Family, HostOffset, Region, TypedAddress};

/// The words of a whole DPRAM.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    family: &'static Family,
    words: Vec<u16>,
}

/// Bytes that are no image of the family's DPRAM.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("an image of the DPRAM of a {family} has {expected} bytes, not {got}")]
pub struct ImageError {
    /// The family's name.
    pub family: &'static str,
    /// How many bytes its DPRAM has; a text, because a family may have several sizes.
    pub expected: String,
    /// How many bytes the dump has.
    pub got: usize,
}

impl Image {
    /// Takes the bytes of a dump, low byte of a word first unless `order` says that they are swapped. The dump may
    /// have the length of any board of the family.
    ///
    /// # Errors
    /// [`ImageError`] when no board of the family has a DPRAM of this size.
    pub fn from_bytes(bytes: &[u8], family: &'static Family, order: WordOrder) -> Result<Self, ImageError> {
        let got = bytes.len();
        let family =
            u32::try_from(got).ok().and_then(|length| family.with_length(length)).ok_or_else(|| {
                let lengths: Vec<_> = family.lengths().map(|length| length.to_string()).collect();
                ImageError { family: family.title, expected: lengths.join(" or "), got }
            })?;
        let words = bytes.as_chunks().0.iter().map(|pair| order.apply(u16::from_le_bytes(*pair)));
        Ok(Self { family, words: words.collect() })
    }

    /// The family, with a DPRAM of this size.
    #[must_use]
    pub const fn family(&self) -> &'static Family {
        self.family
    }

    /// All words, from host offset 0.
    #[must_use]
    pub fn words(&self) -> &[u16] {
        &self.words
    }

    /// The word at `offset`, or `None` outside the image.
    #[must_use]
    pub fn word(&self, offset: HostOffset) -> Option<u16> {
        self.words.get(offset.word()).copied()
    }

    /// The words of `region`; empty when the region lies outside the image.
    #[must_use]
    pub fn region(&self, region: Region) -> &[u16] {
        self.words.get(region.start.word()..region.end.word()).unwrap_or_default()
    }

    /// The value at `location`, or `None` outside the image.
    #[must_use]
    pub fn value(&self, location: TypedAddress, float48: Float48Layout) -> Option<Value> {
        value(location.space, self.words.get(location.offset.word()..)?, float48)
    }

    /// The servo buffer. See [`servo`].
    ///
    /// # Errors
    /// [`TooShort`] when the image ends before the buffer does.
    pub fn servo(&self, motors: usize, scales: &Scales) -> Result<ServoData, TooShort> {
        servo(self.family, self.region(self.family.servo.region), motors, scales)
    }

    /// The background buffer, of at most `count` numbers. If a word of the report says how many numbers it has, the
    /// further blocks are old data. See [`background`].
    ///
    /// # Errors
    /// [`TooShort`] when the image ends before the buffer does.
    pub fn background(
        &self,
        count: usize,
        scales: &Scales,
        float48: Float48Layout,
    ) -> Result<BackgroundData, TooShort> {
        let report = &self.family.background;
        // Turbo User Manual p. 405: bits 7-0 of the word are the highest coordinate system.
        let reported = report.count.and_then(|word| self.word(word)).map(|word| usize::from(word & 0xFF));
        let count = reported.map_or(count, |reported| reported.min(count));
        background(self.family, self.region(report.region), count, scales, float48)
    }
}
