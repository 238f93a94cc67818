//! The gather region: the samples that the board gathers, unchanged and in order (DPRAM manual p. 25-26).
//!
//! [`crate::segment::payload::gather`] describes the payload. A ring of [`SLOTS`] payloads holds more than 8 s of eight
//! longs at 2.26 kHz; the numbers tell a late reader what it missed. The region is live while the daemon follows a
//! gather.

use std::time::{Duration, Instant};

use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::function::gather::{
    GatherBuffer, GatherError, GatherPoll, GatherReader, GatherStart, chunk_longs, report_cycles,
};
use crate::function::servo_timer::ServoTimer;
use crate::map::{Family, GatherPlace, ServoBlock};
use crate::segment::payload::gather::{GatherChunk, GatherPhase, payload_words};
use crate::segment::{BlockPlace, Publisher, RegionId, RegionSpec, RegionState, Stamp};

/// The longest payload of a board of `family`, in 16-bit words.
#[must_use]
pub const fn longest_payload(family: &Family) -> usize {
    payload_words(chunk_longs(family.i.longest_gather_sample()))
}

/// Payloads in the ring.
pub const SLOTS: u32 = 4096;
/// How often to poll for samples when there were none.
const POLL_PERIOD: Duration = Duration::from_millis(2);
/// After so many indices in a row outside the buffer the buffer is another one; fewer may be a disturbance.
const STRAYS: u32 = 3;

/// The region in the segment. A gather may pause, so its samples never grow stale.
#[must_use]
pub fn region(family: &Family) -> RegionSpec {
    RegionSpec {
        id: RegionId::Gather,
        slots: SLOTS,
        payload_bytes: 2 * longest_payload(family) as u32,
        first_host_offset: 0,
        blocks: BlockPlace::NONE,
        period_hint_ns: 0,
        stale_after_ns: 0,
    }
}

/// The clock that counts the board's turns in its buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GatherClock {
    /// The servo report's timer, while that report runs.
    Report,
    /// The host's clock, and the board's servo period in nanoseconds, not 0.
    Host(std::num::NonZeroU64),
}

impl GatherClock {
    /// The host's clock, for a board with this servo period in nanoseconds; `None` for 0.
    #[must_use]
    pub fn host(servo_period_ns: u64) -> Option<Self> {
        std::num::NonZeroU64::new(servo_period_ns).map(Self::Host)
    }
}

/// Why the daemon cannot follow a gather.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotFollowed {
    /// The board's family has no such buffer, or the daemon could not read it.
    #[error(transparent)]
    Buffer(#[from] GatherError),
    /// The board has samples already.
    #[error("gathering runs already: follow it between DEFINE GATHER and GATHER")]
    Runs,
    /// The words that the daemon read are inconclusive.
    #[error("the daemon was held up; try again")]
    HeldUp,
    /// The board's words describe another buffer.
    #[error(
        "DEFINE GATHER {size} should have left {size} at {0} and 0 at {1}, where {found} and {index} stand; has somebody else defined a buffer, or is I{mode} neither 2 nor 3? \
         If not, the board keeps these words elsewhere: see docs/evidence.md",
        place.size, place.index
    )]
    NotTheBuffer {
        /// The defined size.
        size: u32,
        /// The place of the board's gather words.
        place: GatherPlace,
        /// The word at the size's place.
        found: u16,
        /// The word at the index's place.
        index: u16,
        /// The I-variable for the place where the board gathers.
        mode: u16,
    },
}

/// Counts servo cycles.
struct Cycles {
    clock: GatherClock,
    /// The servo report with the timer that counts.
    report: &'static ServoBlock,
    timer: ServoTimer,
    time: Clock,
}

/// Follows one gather at a time.
pub struct GatherMirror {
    family: &'static Family,
    /// The followed gather.
    reader: Option<GatherReader>,
    cycles: Cycles,
    number: u32,
    payload: Box<[u16]>,
    next_poll: Instant,
    /// Indices outside the buffer, in a row.
    strays: u32,
}

impl GatherMirror {
    /// A mirror that follows nothing, on a board of `family`.
    #[must_use]
    pub fn new(family: &'static Family, time: Clock) -> Self {
        let next_poll = time.now();
        Self {
            family,
            reader: None,
            cycles: Cycles::new(GatherClock::Report, &family.servo, time),
            number: 0,
            payload: vec![0; longest_payload(family)].into_boxed_slice(),
            next_poll,
            strays: 0,
        }
    }

    /// Follows the gather of `buffer` from its first sample on. Call this between `DEFINE GATHER` and `GATHER`. The
    /// inner error says why the daemon cannot follow it; the daemon then goes on with the previous gather.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn begin(
        &mut self,
        bus: &mut impl Bus,
        buffer: GatherBuffer,
        clock: GatherClock,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<Result<(), NotFollowed>, BusError> {
        let mut reader = match GatherReader::new(buffer, GatherStart::Defined) {
            Ok(reader) => reader,
            Err(error) => return Ok(Err(error.into())),
        };
        if matches!(clock, GatherClock::Host(_)) {
            reader.doubt_clock();
        }
        let mut cycles = Cycles::new(clock, &self.family.servo, self.cycles.time.clone());
        let reason = match cycles.poll(bus, &mut reader)? {
            GatherPoll::Idle => None,
            GatherPoll::Samples { .. } | GatherPoll::Ended => Some(NotFollowed::Runs),
            GatherPoll::Disturbed => Some(NotFollowed::HeldUp),
            GatherPoll::OutOfRange { .. } | GatherPoll::Redefined { .. } | GatherPoll::Interrupted => {
                let (size, place, mode) = (buffer.size_longs, buffer.place, self.family.i.gather_mode);
                let (found, index) = (bus.read16(place.size)?, bus.read16(place.index)?);
                Some(NotFollowed::NotTheBuffer { size, place, found, index, mode })
            }
        };
        if let Some(reason) = reason {
            return Ok(Err(reason));
        }
        (self.reader, self.cycles) = (Some(reader), cycles);
        self.number = self.number.wrapping_add(1);
        self.strays = 0;
        self.next_poll = now;
        publisher.set_region_state(RegionId::Gather, RegionState::Live);
        Ok(Ok(()))
    }

    /// The board has taken `ENDGATHER`.
    pub fn end(&mut self, now: Instant) {
        if let Some(reader) = &mut self.reader {
            reader.stopped();
            self.next_poll = now;
        }
    }

    /// The daemon has another board now, or the board was reset: its gather is gone.
    pub fn reset(&mut self, publisher: &mut Publisher) {
        if self.reader.is_some() {
            self.publish(GatherPhase::Redefined, None, publisher);
        }
        self.forget(publisher);
    }

    fn forget(&mut self, publisher: &Publisher) {
        self.reader = None;
        publisher.set_region_state(RegionId::Gather, RegionState::Off);
    }

    /// When to poll next; `None` while the mirror follows no gather.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        self.reader.is_some().then_some(self.next_poll)
    }

    /// Polls once; publishes new samples.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
        now: Instant,
    ) -> Result<(), BusError> {
        let Some(reader) = &mut self.reader else { return Ok(()) };
        let found = self.cycles.poll(bus, reader)?;
        let (phase, first) = match found {
            GatherPoll::Samples { first, .. } => (GatherPhase::Running, Some(first)),
            // A single one may be a disturbance on the bus.
            GatherPoll::OutOfRange { .. } if self.strays + 1 >= STRAYS => (GatherPhase::Redefined, None),
            GatherPoll::Idle | GatherPoll::Disturbed | GatherPoll::OutOfRange { .. } => {
                let strays = matches!(found, GatherPoll::OutOfRange { .. });
                self.strays = if strays { self.strays + 1 } else { 0 };
                self.next_poll = now + POLL_PERIOD;
                return Ok(());
            }
            GatherPoll::Ended => (GatherPhase::Ended, None),
            GatherPoll::Redefined { .. } => (GatherPhase::Redefined, None),
            GatherPoll::Interrupted => (GatherPhase::Interrupted, None),
        };
        self.strays = 0;
        self.publish(phase, first, publisher);
        self.next_poll = now;
        if phase != GatherPhase::Running {
            self.forget(publisher);
        }
        Ok(())
    }

    /// Publishes the samples of the last poll, from sample `first` on, or the end.
    fn publish(&mut self, phase: GatherPhase, first: Option<u64>, publisher: &mut Publisher) {
        let Some(reader) = &self.reader else { return };
        let chunk = GatherChunk {
            gather: self.number,
            phase,
            first: first.unwrap_or(reader.written()),
            lost: reader.lost(),
            sample_longs: reader.sample_longs(),
            longs: if phase == GatherPhase::Running { reader.longs() } else { &[] },
        };
        let words = chunk.encode(&mut self.payload);
        let stamp = Stamp { time_ns: self.cycles.time.ns(), servo_timer: 0, valid: true };
        publisher.publish(RegionId::Gather, stamp, &self.payload[..words]);
    }
}

impl Cycles {
    fn new(clock: GatherClock, report: &'static ServoBlock, time: Clock) -> Self {
        Self { clock, report, timer: ServoTimer::new(report.timer.bits()), time }
    }

    /// Polls `reader`, counting these cycles.
    fn poll(&mut self, bus: &mut impl Bus, reader: &mut GatherReader) -> Result<GatherPoll, BusError> {
        reader.poll(bus, |bus| match self.clock {
            GatherClock::Report => report_cycles(bus, self.report, &mut self.timer),
            GatherClock::Host(period) => Ok(self.time.ns() / period),
        })
    }
}
