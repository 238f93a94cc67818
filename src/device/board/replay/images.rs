//! Facts of the later images that the trace lacks: everything without a trace, and the words in a gap of the trace.
//!
//! If the trace has a word between an image and the next, the trace decides; else the image. A report comes from an
//! image as a whole, and only if the trace has no update of it from the image before to the one behind. PMAC may have
//! made an update while the host read the image, so the image's words may belong to two updates.

use std::ops::Range;

use crate::recording::{Access, Recording};

/// An image behind the first one.
pub struct LaterImage<'a> {
    /// Its time, from the first access on.
    pub at_ns: u64,
    /// The time from the image before to the one behind.
    pub around: Range<u64>,
    words: &'a [u16],
    before: &'a [u16],
    /// Words that the trace has until the next image.
    traced: Vec<bool>,
}

/// The later images of `recording`, whose first access was at `zero`.
pub fn later_images(recording: &Recording, zero: u64) -> impl Iterator<Item = LaterImage<'_>> {
    let images = &recording.images;
    images.iter().enumerate().skip(1).map(move |(index, image)| {
        let before = &images[index - 1];
        let end = images.get(index + 1).map_or(u64::MAX, |next| next.t_ns);
        let since = |t_ns: u64| recording.accesses.partition_point(|access| access.t_ns < t_ns);
        let mut traced = vec![false; image.words.len()];
        for Access { offset, width, .. } in &recording.accesses[since(image.t_ns)..since(end)] {
            traced[offset.word()..offset.word() + usize::from(width / 16)].fill(true);
        }
        LaterImage {
            at_ns: image.t_ns.saturating_sub(zero),
            around: before.t_ns.saturating_sub(zero)..end.saturating_sub(zero),
            words: &image.words,
            before: &before.words,
            traced,
        }
    })
}

impl LaterImage<'_> {
    /// Its words without those that the trace has.
    pub fn untraced(&self) -> impl Iterator<Item = (u16, u16)> {
        let words = self.words.iter().zip(&self.traced).zip(0..);
        words.filter(|((_, is_traced), _)| !**is_traced).map(|((value, _), word)| (word, *value))
    }

    /// The words of a report without those that `hosts` names; `None` if they equal the image before.
    pub fn report(&self, words: &Range<u16>, hosts: &[u16]) -> Option<Vec<(u16, u16)>> {
        let pmacs = words.clone().filter(|word| !hosts.contains(word));
        let of = |image: &[u16]| -> Vec<(u16, u16)> {
            pmacs.clone().filter_map(|word| Some((word, *image.get(usize::from(word))?))).collect()
        };
        let now = of(self.words);
        (now != of(self.before)).then_some(now)
    }
}
