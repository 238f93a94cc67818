//! The site's own words: read at a rate, or after each servo update, and published unchanged.

use crate::device::{Bus, BusError};
use crate::function::user_words::UserWordsReader;
use crate::map::user_word::UserWord;
use crate::segment::freshness::limit_ns;
use crate::segment::payload::user::{self, HEADER_WORDS};
use crate::segment::{BlockPlace, Publisher, RegionId, RegionSpec, RegionState, Stamp};

/// Words are stale after this time without a sample, or after ten periods ([`limit_ns`]).
const STALE_NS: u64 = 1_000_000_000;
/// How soon to read words again that the board was writing.
const AGAIN_NS: u64 = 200_000;
/// How long the daemon repeats the reading of words that the board is writing: a site's program that has stopped with
/// an odd guard must not cost more of the bus.
const AGAIN_FOR_NS: u64 = 10_000_000;
/// Samples in the ring at one sample a servo update.
const SERVO_SLOTS: u32 = 4096;

/// When the mirror reads the words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UserRate {
    /// After each servo update.
    Servo,
    /// Once in so many nanoseconds.
    EveryNs(u64),
}

impl UserRate {
    const fn period_ns(self) -> u64 {
        match self {
            Self::Servo => 0,
            Self::EveryNs(period) => period,
        }
    }
}

/// The regions in the segment: the words' values and their names. Empty without words.
#[must_use]
pub fn regions(words: &[UserWord], rate: UserRate) -> Vec<RegionSpec> {
    if words.is_empty() {
        return Vec::new();
    }
    let region = |id, slots, payload_bytes, period_hint_ns, stale_after_ns| RegionSpec {
        id,
        slots,
        payload_bytes,
        first_host_offset: 0,
        blocks: BlockPlace::NONE,
        period_hint_ns,
        stale_after_ns,
    };
    let slots = match 1_000_000_000_u64.checked_div(rate.period_ns()) {
        None => SERVO_SLOTS,
        Some(a_second) => u32::try_from(a_second).unwrap_or(u32::MAX).clamp(16, 1024).next_power_of_two(),
    };
    let payload_bytes = 2 * user::payload_words(words) as u32;
    let stale_after_ns = limit_ns(STALE_NS, rate.period_ns());
    vec![
        region(RegionId::User, slots, payload_bytes, rate.period_ns(), stale_after_ns),
        region(RegionId::UserTable, 2, user::table_bytes(words) as u32, 0, 0),
    ]
}

/// Mirrors the words.
pub struct UserMirror {
    reader: UserWordsReader,
    rate: UserRate,
    payload: Box<[u16]>,
    /// The number of the last seen servo update.
    updates: u64,
    /// The planned time of the next sample.
    planned_ns: u64,
    due_ns: u64,
}

impl UserMirror {
    /// A mirror of `words`; publishes their names at once.
    #[must_use]
    pub fn new(words: &[UserWord], rate: UserRate, publisher: &mut Publisher, now: u64) -> Self {
        if !words.is_empty() {
            let stamp = Stamp { time_ns: now, servo_timer: 0, valid: true };
            publisher.publish_bytes(RegionId::UserTable, stamp, &user::encode_table(words));
            publisher.set_region_state(RegionId::UserTable, RegionState::Live);
        }
        let payload = vec![0; user::payload_words(words)].into();
        Self { reader: UserWordsReader::new(words), rate, payload, updates: 0, planned_ns: now, due_ns: now }
    }

    /// When to read next; `None` without words, or when servo updates set the time.
    #[must_use]
    pub fn due_ns(&self) -> Option<u64> {
        (self.rate != UserRate::Servo && !self.reader.words().is_empty()).then_some(self.due_ns)
    }

    /// How long a reading can wait.
    #[must_use]
    pub fn spare_ns(&self) -> u64 {
        self.rate.period_ns() / 8
    }

    /// Takes the number of servo updates so far; after a new one, reads and publishes the words if they follow the
    /// servo report.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn follow_servo(
        &mut self,
        updates: u64,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
        now: u64,
    ) -> Result<(), BusError> {
        let is_new = std::mem::replace(&mut self.updates, updates) != updates;
        if is_new && self.rate == UserRate::Servo && !self.reader.words().is_empty() {
            let whole = self.reader.poll(bus)?;
            self.publish(whole, publisher, now);
        }
        Ok(())
    }

    /// Reads the words and publishes them. If the board is writing some of them, the mirror first tries again, for half
    /// a period at most.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, publisher: &mut Publisher, now: u64) -> Result<(), BusError> {
        let period = self.rate.period_ns();
        let whole = self.reader.poll(bus)?;
        if whole.count_ones() as usize != self.reader.words().len()
            && now < self.planned_ns + (period / 2).min(AGAIN_FOR_NS)
        {
            self.due_ns = now + AGAIN_NS;
            return Ok(());
        }
        self.publish(whole, publisher, now);
        let next = self.planned_ns + period;
        self.planned_ns = if next > now { next } else { now + period };
        self.due_ns = self.planned_ns;
        Ok(())
    }

    fn publish(&mut self, whole: u64, publisher: &mut Publisher, time_ns: u64) {
        let (header, values) = self.payload.split_at_mut(HEADER_WORDS);
        header.copy_from_slice(&user::header(whole));
        values.copy_from_slice(self.reader.image());
        publisher.publish(RegionId::User, Stamp { time_ns, servo_timer: 0, valid: true }, &self.payload);
        publisher.set_region_state(RegionId::User, RegionState::Live);
    }
}
