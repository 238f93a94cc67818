//! Reading every sample of a region in turn.

use super::SegmentError;
use super::layout::RegionId;
use super::ring::Attempt;
use super::sample::Sample;
use super::subscribe::{ATTEMPTS, Subscriber};

/// Follows every sample of a region and knows exactly how many it lost. Holds no borrow: hand it the subscriber it was made by.
#[derive(Clone, Debug)]
pub struct Cursor {
    region: RegionId,
    generation: u64,
    next: u64,
    /// What the head was when it was last looked at.
    head: u64,
    lost: u64,
}

impl Cursor {
    pub(super) fn new(region: RegionId, generation: u64, next: u64) -> Self {
        Self { region, generation, next: next.max(1), head: 0, lost: 0 }
    }

    /// Copies the next sample; `false`, and an empty sample, when it is not published yet. Overrun by the writer, goes on half a
    /// ring behind it and counts what it lost.
    ///
    /// # Errors
    /// [`SegmentError::OtherGeneration`] with another segment's subscriber; [`SegmentError::Overrun`] when the writer overtook every
    /// attempt (calling again is right); [`SegmentError::Corrupt`].
    #[inline(always)]
    pub fn next(&mut self, subscriber: &Subscriber, sample: &mut Sample) -> Result<bool, SegmentError> {
        if subscriber.generation() != self.generation {
            return Err(SegmentError::OtherGeneration {
                cursor: self.generation,
                segment: subscriber.generation(),
            });
        }
        for _ in 0..ATTEMPTS {
            match subscriber.follow(self.region, self.next, &mut self.head, sample)? {
                Attempt::Whole => {
                    self.next = self.next.saturating_add(1);
                    return Ok(true);
                }
                Attempt::NotYet => return Ok(false),
                Attempt::Lost => {
                    // What was overwritten is lost for certain, even while this process still sees an older head.
                    let resume = subscriber.resume(self.region, self.head)?.max(self.next.saturating_add(1));
                    self.lost = self.lost.wrapping_add(resume - self.next);
                    self.next = resume;
                }
            }
        }
        Err(SegmentError::Overrun { region: self.region, attempts: ATTEMPTS })
    }

    /// The number of the sample it will read next.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.next
    }

    /// How many samples it lost, exactly.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}
