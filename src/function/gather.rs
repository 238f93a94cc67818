//! Reads gathered samples out of the DPRAM while the board writes them (DPRAM manual p. 25-26).
//!
//! The board stores a sample every I19 servo cycles at its index (longs from the buffer's start), and writes the
//! buffer's size, as `DEFINE GATHER` had it, and the index beside it. A sample never parts at the buffer's end: the
//! real length is the size rounded up to whole samples. The host only reads and cannot tell the board how far it has
//! read. So with I45=3 the board overwrites samples that the host did not read in time, and the index alone cannot
//! tell a whole turn from none. The caller therefore also gives the reader the servo cycles; from index and cycles the
//! reader knows the exact number of samples.
//!
//! The number of samples between two polls fits the index and lies between the least and the most that the time
//! between the polls allows. If the host was held up between two accesses of a poll for a quarter of the buffer, the
//! reader discards the poll; the next one tells. While the clock stands still and the index moves on, as when the
//! servo report pauses, the reader takes no samples until the clock goes on. After a copy the reader reads the index
//! again, drops the samples that the board may have overwritten meanwhile, and counts them as lost.

use super::servo;
use crate::device::{Bus, BusError};
use crate::function::servo_timer::ServoTimer;
use crate::gather::GatherMode;
use crate::map::{GatherPlace, ServoBlock};

/// The most longs that one poll copies, unless a single sample has more.
const CHUNK_LONGS: u32 = 64;
/// Longs of the longest sample of any family: 48 sources of two longs.
const MOST_LONGS: usize = 96;
/// By how many samples the count from the servo cycles may be off: the clock itself advances about once a sample.
const SLACK_SAMPLES: u64 = 2;
/// The shortest buffer in samples for I45=3: the cycles must leave less than a turn open.
pub const LEAST_WRAP_SAMPLES: u32 = 16;

/// The most longs that one poll copies on a board whose longest sample has `longest_sample` longs.
#[must_use]
pub const fn chunk_longs(longest_sample: u32) -> usize {
    if longest_sample > CHUNK_LONGS { longest_sample as usize } else { CHUNK_LONGS as usize }
}

/// The buffer as it was defined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GatherBuffer {
    /// Where the board's firmware keeps the buffer.
    pub place: GatherPlace,
    /// Longs from the buffer's start to the DPRAM's end.
    pub room_longs: u32,
    /// The size given to `DEFINE GATHER`, in longs.
    pub size_longs: u32,
    /// Longs of one sample.
    pub sample_longs: u32,
    /// Longs of the longest sample of the board's family.
    pub longest_sample: u32,
    /// Whether the board stops or wraps at the buffer's end.
    pub mode: GatherMode,
    /// Servo cycles from one sample to the next (I19).
    pub period: u32,
}

/// A buffer that the host cannot read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GatherError {
    /// No such sample length.
    #[error("samples of {longs} longs are not possible; 1 to {most} are")]
    Sample {
        /// Longs of one sample.
        longs: u32,
        /// The most that a sample can have.
        most: u32,
    },
    /// No such period.
    #[error("samples cannot come every 0 servo cycles; 1 or more are possible")]
    Period,
    /// The buffer does not fit into the DPRAM.
    #[error("a gather buffer of {longs} longs is not possible; there is room for 1 to {room}")]
    Size {
        /// Its real length in longs.
        longs: u32,
        /// The longs that the DPRAM has room for.
        room: u32,
    },
    /// The buffer is too short for I45=3.
    #[error(
        "a gather buffer of {samples} samples is too short to be read while the board goes round in it; \
         {LEAST_WRAP_SAMPLES} are needed, or a gather that ends when the buffer is full"
    )]
    TooShort {
        /// Its samples.
        samples: u32,
    },
}

/// Where a reader begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GatherStart {
    /// At the first sample after `DEFINE GATHER`. The first poll must come before a whole buffer has been gathered;
    /// between the definition and `GATHER` is best.
    Defined,
    /// At the next sample that the board stores after the first poll: gathering runs already.
    Running,
}

/// The result of a poll. Sample numbers count from 0 at the [`GatherStart`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GatherPoll {
    /// The board has stored no complete sample that the reader has not taken.
    Idle,
    /// Samples, whole and in order, lie in [`GatherReader::longs`]. The first one's number is higher than the last
    /// one's before it by more than 1 where samples were lost.
    Samples {
        /// The number of the first.
        first: u64,
        /// How many.
        count: usize,
    },
    /// Gathering is over (I45=2 and the buffer full, or [`GatherReader::stopped`]) and the reader has taken every
    /// sample.
    Ended,
    /// The host was held up between its accesses for too long to trust them, and took no sample. Poll again.
    Disturbed,
    /// The index lies outside the buffer, where no board puts it. The reader took no sample.
    OutOfRange {
        /// The value of the index word.
        index: u16,
    },
    /// Size or index do not fit this reader's buffer any more: a `DEFINE GATHER`, a `DELETE GATHER` or a reset. The
    /// reader reads no more until [`GatherReader::restart`].
    Redefined {
        /// The value of the size word, in longs.
        size: u16,
        /// The value of the index word.
        index: u16,
    },
    /// Gathering paused. The caller did not poll for a whole turn of the buffer, so the reader cannot know for how
    /// many samples. The reader reads no more until [`GatherReader::restart`]. It cannot tell a pause as long as whole
    /// turns from those turns; a caller that sends `ENDGATHER` itself says so with [`GatherReader::stopped`].
    Interrupted,
}

/// Reads the samples of one gather.
#[derive(Debug)]
pub struct GatherReader {
    buffer: GatherBuffer,
    /// Samples the buffer holds.
    capacity: u64,
    start: GatherStart,
    /// By how many samples the count from the clock may be off.
    slack: u64,
    /// The slot of sample 0.
    base: u64,
    /// Complete samples the board has stored since sample 0.
    written: u64,
    /// Samples that the reader has taken or lost.
    read: u64,
    lost: u64,
    /// The servo cycles just before and just after the last index was read.
    last: Option<(u64, u64)>,
    /// Gathering has ended at the next poll.
    stopping: bool,
    stopped: bool,
    /// The clock's reading when the index had moved further than the clock allows.
    doubted: Option<u64>,
    /// The result that ended the reading.
    broken: Option<GatherPoll>,
    words: [u16; 2 * MOST_LONGS],
    longs: [u32; MOST_LONGS],
    length: usize,
}

/// Why no number of samples fits both index and time.
enum Misfit {
    /// Less time passed than the fewest that fit the index take.
    TooMany,
    /// More time passed than the most that fit the index take.
    TooFew,
}

impl GatherReader {
    /// A reader that has not polled yet.
    ///
    /// # Errors
    /// [`GatherError`] for a buffer that no board can have or that the host could not read.
    pub fn new(buffer: GatherBuffer, start: GatherStart) -> Result<Self, GatherError> {
        let GatherBuffer { size_longs, sample_longs, room_longs: room, .. } = buffer;
        let most = buffer.longest_sample.min(MOST_LONGS as u32);
        if !(1..=most).contains(&sample_longs) {
            return Err(GatherError::Sample { longs: sample_longs, most });
        }
        if buffer.period == 0 {
            return Err(GatherError::Period);
        }
        let samples = size_longs.div_ceil(sample_longs);
        let longs = samples.saturating_mul(sample_longs);
        if samples == 0 || longs > room {
            return Err(GatherError::Size { longs, room });
        }
        if buffer.mode == GatherMode::Wrap && samples < LEAST_WRAP_SAMPLES {
            return Err(GatherError::TooShort { samples });
        }
        Ok(Self {
            buffer,
            capacity: samples.into(),
            start,
            slack: SLACK_SAMPLES,
            base: 0,
            written: 0,
            read: 0,
            lost: 0,
            last: None,
            stopping: false,
            stopped: false,
            doubted: None,
            broken: None,
            words: [0; 2 * MOST_LONGS],
            longs: [0; MOST_LONGS],
            length: 0,
        })
    }

    /// Begins anew, with sample 0 and nothing lost.
    pub fn restart(&mut self, start: GatherStart) {
        self.start = start;
        (self.base, self.written, self.read, self.lost, self.length) = (0, 0, 0, 0, 0);
        (self.last, self.doubted, self.broken) = (None, None, None);
        (self.stopping, self.stopped) = (false, false);
    }

    /// The clock is not the board's own: its cycles may be off by an eighth of a turn, which still leaves less than a
    /// turn open (a quarter for each of two brackets, an eighth on either side). If another host defines a new buffer
    /// within that distance of its end, gathering seems to go on.
    pub fn doubt_clock(&mut self) {
        self.slack = SLACK_SAMPLES.max(self.capacity / 8);
    }

    /// The board has answered `ENDGATHER`: after the next poll no further samples come, and passing time no longer
    /// counts. The reader still reads the remaining samples.
    pub fn stopped(&mut self) {
        self.stopping = true;
    }

    /// The longs of the samples that the last poll took, in order; empty unless it was [`GatherPoll::Samples`].
    #[must_use]
    pub fn longs(&self) -> &[u32] {
        &self.longs[..self.length]
    }

    /// Longs of one sample.
    #[must_use]
    pub const fn sample_longs(&self) -> usize {
        self.buffer.sample_longs as usize
    }

    /// Samples the board has stored, as of the last poll.
    #[must_use]
    pub const fn written(&self) -> u64 {
        self.written
    }

    /// Samples that the board overwrote before the reader took them.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Samples in the buffer that the reader has not taken, as of the last poll.
    #[must_use]
    pub const fn waiting(&self) -> u64 {
        self.written - self.read
    }

    /// Polls once and takes up to [`chunk_longs`] longs of samples.
    ///
    /// `cycles` gives the servo cycles that the board has run, from any beginning: the servo report's timer
    /// ([`report_cycles`]), or the host's clock divided by the servo period. `cycles` must not run ahead of or behind
    /// the board by more than two samples, and not stand still while the board gathers. The reader uses `cycles` with
    /// I45=3 only.
    ///
    /// Costs 2 reads, and one more with 2 for each long when there are samples; and with I45=3 what `cycles` costs,
    /// twice, or three times when there are samples.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll<B: Bus>(
        &mut self,
        bus: &mut B,
        mut cycles: impl FnMut(&mut B) -> Result<u64, BusError>,
    ) -> Result<GatherPoll, BusError> {
        self.length = 0;
        if let Some(poll) = self.broken {
            return Ok(poll);
        }
        let timed = self.buffer.mode == GatherMode::Wrap;
        let before = if timed { cycles(bus)? } else { 0 };
        let size = bus.read16(self.buffer.place.size)?;
        let index = bus.read16(self.buffer.place.index)?;
        let after = if timed { cycles(bus)? } else { 0 };
        if u64::from(size).div_ceil(self.buffer.sample_longs.into()) != self.capacity {
            return Ok(self.break_off(GatherPoll::Redefined { size, index }));
        }
        if let Some(poll) = self.learn(size, index, (before, after)) {
            return Ok(poll);
        }
        self.skip_overwritten();
        if self.read >= self.written {
            let full = !timed && self.base + self.written == self.capacity;
            return Ok(if full || self.stopped { GatherPoll::Ended } else { GatherPoll::Idle });
        }
        let taken = self.copy(bus)?;
        let index = bus.read16(self.buffer.place.index)?;
        let later = if timed { cycles(bus)? } else { 0 };
        let first = self.read;
        if let Some(poll) = self.learn(size, index, (after, later)) {
            return Ok(poll);
        }
        self.skip_overwritten();
        let dropped = ((self.read - first) as usize).min(taken);
        let sample_longs = self.sample_longs();
        self.longs.copy_within(dropped * sample_longs..taken * sample_longs, 0);
        let count = taken - dropped;
        self.length = count * sample_longs;
        if count == 0 {
            return Ok(GatherPoll::Idle);
        }
        let first = self.read;
        self.read += count as u64;
        Ok(GatherPoll::Samples { first, count })
    }

    fn break_off(&mut self, poll: GatherPoll) -> GatherPoll {
        self.broken = Some(poll);
        poll
    }

    /// Takes an index that the host read within `bracket`, in servo cycles. Returns the poll's result if the index
    /// ends the poll.
    fn learn(&mut self, size: u16, index: u16, bracket: (u64, u64)) -> Option<GatherPoll> {
        // A board may move its index long by long; only whole samples count.
        let slot = u64::from(index) / u64::from(self.buffer.sample_longs);
        if u64::from(index) > self.capacity * u64::from(self.buffer.sample_longs) {
            return Some(GatherPoll::OutOfRange { index });
        }
        // A wider bracket would leave several numbers of samples open, now or at the next poll.
        if bracket.1.saturating_sub(bracket.0) / u64::from(self.buffer.period) > self.capacity / 4 {
            return Some(GatherPoll::Disturbed);
        }
        match (self.last, self.start) {
            (None, GatherStart::Running) => self.base = slot,
            (None, GatherStart::Defined) => self.written = slot,
            (Some(_), _) if self.buffer.mode == GatherMode::Stop || self.stopped => {
                let slot = if self.buffer.mode == GatherMode::Wrap { slot % self.capacity } else { slot };
                let here = (self.base + self.written) % self.capacity;
                let expected =
                    if self.buffer.mode == GatherMode::Wrap { here } else { self.base + self.written };
                if slot < expected || (self.stopped && slot != expected) {
                    return Some(self.break_off(GatherPoll::Redefined { size, index }));
                }
                self.written += slot - expected;
            }
            (Some(last), _) => match self.samples_since(slot, last, bracket) {
                Ok(samples) => self.written += samples,
                // The clock may pause: Host-Busy holds off the servo report while gathering goes on. The clock's next
                // reading says for how long, so the reader waits for it once.
                Err(Misfit::TooMany) if self.doubted.is_none_or(|clock| clock == bracket.1) => {
                    self.doubted = Some(bracket.1);
                    return Some(GatherPoll::Idle);
                }
                Err(Misfit::TooMany) => return Some(self.break_off(GatherPoll::Redefined { size, index })),
                Err(Misfit::TooFew) => return Some(self.break_off(GatherPoll::Interrupted)),
            },
        }
        (self.last, self.doubted) = (Some(bracket), None);
        if self.stopping {
            self.stopped = true;
        }
        None
    }

    /// How many samples the board has stored since the host read the index within `last`, now that the index points to
    /// `slot`.
    fn samples_since(&self, slot: u64, last: (u64, u64), now: (u64, u64)) -> Result<u64, Misfit> {
        let here = (self.base + self.written) % self.capacity;
        let ahead = (slot % self.capacity + self.capacity - here) % self.capacity;
        let period = u64::from(self.buffer.period);
        let least = (now.0.saturating_sub(last.1) / period).saturating_sub(self.slack);
        let most = now.1.saturating_sub(last.0).div_ceil(period) + self.slack;
        if ahead > most {
            return Err(Misfit::TooMany);
        }
        // The most samples that fit the index and the time. No other number fits: brackets and slack leave less than a
        // turn open, under 5 + 5 + 6 samples of 16 in the shortest buffer.
        let samples = ahead + (most - ahead) / self.capacity * self.capacity;
        // The time asks for more samples: gathering paused. Within one turn the index still tells.
        if samples < least && samples >= self.capacity {
            return Err(Misfit::TooFew);
        }
        Ok(samples)
    }

    /// Gives up samples that the board has overwritten, or may be overwriting now with its next sample.
    fn skip_overwritten(&mut self) {
        let keeps = match self.buffer.mode {
            GatherMode::Wrap if !self.stopped => self.capacity - 1,
            _ => self.capacity,
        };
        let oldest = self.written.saturating_sub(keeps);
        if self.read < oldest {
            self.lost += oldest - self.read;
            self.read = oldest;
        }
    }

    /// Copies as many of the next samples as fit, and returns how many.
    fn copy(&mut self, bus: &mut impl Bus) -> Result<usize, BusError> {
        let sample_longs = self.sample_longs();
        let chunk = chunk_longs(self.buffer.longest_sample).min(MOST_LONGS);
        let taken = (self.written - self.read).min((chunk / sample_longs) as u64) as usize;
        let slot = ((self.base + self.read) % self.capacity) as usize;
        // Up to the buffer's end, then from its start.
        let until_end = taken.min(self.capacity as usize - slot);
        let (head, tail) = self.words[..2 * taken * sample_longs].split_at_mut(2 * until_end * sample_longs);
        bus.order_reads();
        bus.read_data(self.buffer.place.buffer.plus_words(2 * slot * sample_longs), head)?;
        if !tail.is_empty() {
            bus.read_data(self.buffer.place.buffer, tail)?;
        }
        bus.order_reads();
        for (long, [low, high]) in self.longs.iter_mut().zip(self.words.as_chunks().0) {
            *long = u32::from(*high) << 16 | u32::from(*low);
        }
        Ok(taken)
    }
}

/// The servo cycles by the timer of the servo report, extended by `timer`: a clock for [`GatherReader::poll`] while
/// the board makes that report and no host holds it off. Costs one read where the timer has one word. The caller must
/// call it at least once a turn of the timer, 14 s with 15 bits.
///
/// # Errors
/// When the bus cannot be reached.
pub fn report_cycles(
    bus: &mut impl Bus,
    report: &ServoBlock,
    timer: &mut ServoTimer,
) -> Result<u64, BusError> {
    Ok(timer.advance(servo::read_timer(bus, report)?).0)
}
