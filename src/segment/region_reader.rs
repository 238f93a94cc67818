//! Reads the samples of one region, for a subscriber and its cursors.

use super::SegmentError;
use super::header::Region;
use super::memory::ReadMap;
use super::ring::{Attempt, Latest};
use super::sample::Sample;

/// How often a read starts again after the writer overwrote the slot. With 4 slots or more, even one restart is rare.
pub(super) const ATTEMPTS: u32 = 16;

/// The result of reading one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// The sample was copied.
    Sample,
    /// The sample is not published yet.
    NotYet,
    /// The sample was overwritten.
    Lost {
        /// The oldest sample that the ring may still hold.
        first_available: u64,
    },
}

/// One region of a mapped segment.
pub(super) struct RegionReader<'a> {
    pub(super) map: &'a ReadMap,
    pub(super) region: &'a Region,
    pub(super) generation: u64,
}

impl RegionReader<'_> {
    /// Copies the latest sample, after `attempts` failed attempts.
    pub(super) fn latest(&self, attempts: u32, sample: &mut Sample) -> Result<Option<u64>, SegmentError> {
        let room = sample.room(self.region.lines);
        match self.region.ring.latest(self.map, room, ATTEMPTS - attempts) {
            Latest::Whole { sequence, retries } => {
                self.accept(sample, sequence, attempts + retries).map(|()| Some(sequence))
            }
            Latest::Empty => {
                sample.clear();
                Ok(None)
            }
            Latest::Overrun => {
                sample.clear();
                Err(self.overrun())
            }
        }
    }

    /// Copies sample `sequence`. Leaves the sample empty if the ring does not hold it.
    #[inline]
    pub(super) fn read(&self, sequence: u64, sample: &mut Sample) -> Result<Read, SegmentError> {
        match self.region.ring.read(self.map, sequence, sample.room(self.region.lines)) {
            Attempt::Whole => self.accept(sample, sequence, 0).map(|()| Read::Sample),
            Attempt::NotYet => {
                sample.clear();
                Ok(Read::NotYet)
            }
            Attempt::Lost => {
                sample.clear();
                let first_available = self.region.ring.oldest(self.published());
                Ok(Read::Lost { first_available: first_available.max(sequence.saturating_add(1)) })
            }
        }
    }

    /// As [`RegionReader::read`], but reads the head again only when the reader has reached `head`, its last value, or
    /// the sample is lost.
    #[inline(always)]
    pub(super) fn follow(
        &self,
        sequence: u64,
        head: &mut u64,
        sample: &mut Sample,
    ) -> Result<Attempt, SegmentError> {
        if sequence > *head {
            *head = self.published();
            if sequence > *head {
                sample.clear();
                return Ok(Attempt::NotYet);
            }
        }
        let room = sample.room(self.region.lines);
        let attempt = self.region.ring.read_published(self.map, sequence, *head, room);
        if attempt == Attempt::Whole {
            self.accept(sample, sequence, 0)?;
        } else {
            sample.clear();
            *head = self.published();
        }
        Ok(attempt)
    }

    /// Where an overrun reader continues when the head is `head`.
    pub(super) fn resume(&self, head: u64) -> u64 {
        self.region.ring.resume(head)
    }

    /// The writer overtook every attempt.
    pub(super) fn overrun(&self) -> SegmentError {
        SegmentError::Overrun { region: self.region.id, attempts: ATTEMPTS }
    }

    fn published(&self) -> u64 {
        self.region.ring.published(self.map)
    }

    #[inline(always)]
    fn accept(&self, sample: &mut Sample, sequence: u64, retries: u32) -> Result<(), SegmentError> {
        if sample.accept(sequence, retries, self.region.payload_bytes) {
            Ok(())
        } else {
            sample.clear();
            Err(SegmentError::Corrupt { region: self.region.id, sequence })
        }
    }
}
