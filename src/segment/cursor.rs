//! The position in a region of a reader that wants every sample.

use super::SegmentError;
use super::layout::RegionId;
use super::region_reader::{ATTEMPTS, RegionReader};
use super::ring::Attempt;
use super::sample::Sample;

/// Follows every sample of a region and counts exactly how many it lost; see [`super::Subscriber::next`]. Holds no
/// borrow.
#[derive(Clone, Debug)]
pub struct Cursor {
    region: RegionId,
    generation: u64,
    next: u64,
    /// The head when it was last read.
    head: u64,
    lost: u64,
}

impl Cursor {
    pub(super) fn new(region: RegionId, generation: u64, next: u64) -> Self {
        Self { region, generation, next: next.max(1), head: 0, lost: 0 }
    }

    /// Copies the next sample; see [`super::Subscriber::next`].
    #[inline(always)]
    pub(super) fn next(
        &mut self,
        reader: &RegionReader<'_>,
        sample: &mut Sample,
    ) -> Result<bool, SegmentError> {
        if reader.generation != self.generation {
            return Err(SegmentError::OtherGeneration {
                cursor: self.generation,
                segment: reader.generation,
            });
        }
        for _ in 0..ATTEMPTS {
            match reader.follow(self.next, &mut self.head, sample)? {
                Attempt::Whole => {
                    self.next = self.next.saturating_add(1);
                    return Ok(true);
                }
                Attempt::NotYet => return Ok(false),
                Attempt::Lost => {
                    // The overwritten samples are lost, even while this process still sees an older head.
                    let resume = reader.resume(self.head).max(self.next.saturating_add(1));
                    self.lost = self.lost.wrapping_add(resume - self.next);
                    self.next = resume;
                }
            }
        }
        Err(reader.overrun())
    }

    /// The region that it follows.
    #[inline(always)]
    #[must_use]
    pub fn region(&self) -> RegionId {
        self.region
    }

    /// The number of the sample that it reads next.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.next
    }

    /// How many samples it has lost, exactly.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}
