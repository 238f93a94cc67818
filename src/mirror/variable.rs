//! The variable region: the users' registers that PMAC copies in the background, published with their table.
//!
//! [`crate::segment::payload::variable`] describes the payload.

use std::time::{Duration, Instant};

use super::freshness::Freshness;
use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::format::join32;
use crate::function::servo_timer::ServoTimer;
use crate::function::variable_read::{
    VariableEntry, VariableMode, VariablePoll, VariableReadBusError, VariableReader,
};
use crate::map::functions::VARIABLE_READ_ENTRIES;
use crate::map::{BufferLayout, VariableKind};
use crate::segment::payload::variable::{self, Variable};
use crate::segment::{BlockPlace, Publisher, RegionId, RegionSpec, RegionState, Stamp};

/// The longest payload in 16-bit words.
pub const PAYLOAD_WORDS: usize = variable::payload_words(VARIABLE_READ_ENTRIES);
/// The servo timer's bits in the variable-read header.
const TIMER_BITS: u32 = 16;
/// How often to poll for new values; PMAC's background cycle takes some milliseconds.
const POLL_PERIOD: Duration = Duration::from_millis(2);
/// The shortest time between polls while the reader has work left.
const BUSY_POLL_PERIOD: Duration = Duration::from_micros(50);
/// Without new values for this long the region is stale, in ns.
const STALE_NS: u64 = 1_000_000_000;

/// After this long without a reading of the servo timer, its 16 bits may have gone round, in ns: at 20 kHz they do
/// after 3.3 s.
const TURN_NS: u64 = 3_000_000_000;

/// Samples in the ring: a second at the rate of a PMAC's background, for readers that sleep.
const SLOTS: u32 = 1024;

/// The region in the segment.
#[must_use]
pub fn region() -> RegionSpec {
    RegionSpec {
        id: RegionId::Variable,
        slots: SLOTS,
        payload_bytes: 2 * PAYLOAD_WORDS as u32,
        first_host_offset: 0,
        blocks: BlockPlace::NONE,
        period_hint_ns: 0,
        stale_after_ns: STALE_NS,
    }
}

/// Mirrors the variable-read buffer.
pub struct VariableMirror {
    time: Clock,
    reader: VariableReader,
    mode: VariableMode,
    timer: ServoTimer,
    /// When the mirror last read the timer; CLOCK_MONOTONIC.
    timer_read_ns: u64,
    table: u32,
    payload: [u16; PAYLOAD_WORDS],
    next_poll: Instant,
    freshness: Freshness,
}

impl VariableMirror {
    /// A mirror without a table, which uses the layout's words for it.
    #[must_use]
    pub fn new(layout: &BufferLayout, mode: VariableMode, time: Clock) -> Self {
        let family = layout.family();
        Self {
            reader: VariableReader::new(&family.variable_read, family.start, layout.variable_read()),
            mode,
            timer: ServoTimer::new(TIMER_BITS),
            timer_read_ns: 0,
            table: 0,
            payload: [0; PAYLOAD_WORDS],
            next_poll: time.now(),
            time,
            freshness: Freshness::new(STALE_NS),
        }
    }

    /// Stops the function, whichever host started it. The daemon calls this at its start and on every way out. 2
    /// writes.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.reader.release(bus)
    }

    /// Replaces the table; an empty one stops the function.
    ///
    /// # Errors
    /// An impossible table, or a bus out of reach.
    pub fn begin(
        &mut self,
        bus: &mut impl Bus,
        entries: &[VariableEntry],
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), VariableReadBusError> {
        self.reader.begin(bus, entries, self.mode, now)?;
        self.table = self.table.wrapping_add(1);
        self.freshness = Freshness::new(STALE_NS);
        self.next_poll = now;
        publisher.set_region_state(RegionId::Variable, RegionState::Off);
        Ok(())
    }

    /// Sets the present table up again, as after a reset of the board.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(
        &mut self,
        bus: &mut impl Bus,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), BusError> {
        self.timer.reset();
        let mut table = [VariableEntry { address: 0, kind: VariableKind::Y }; VARIABLE_READ_ENTRIES];
        let count = self.reader.entries().len();
        table[..count].copy_from_slice(self.reader.entries());
        match self.begin(bus, &table[..count], publisher, now) {
            // The reader accepted this table before.
            Ok(()) | Err(VariableReadBusError::Refused(_)) => Ok(()),
            Err(VariableReadBusError::Bus(error)) => Err(error),
        }
    }

    /// The number of the present table, as in the region's payload.
    #[must_use]
    pub const fn table(&self) -> u32 {
        self.table
    }

    /// The time of the next poll; `None` without a table.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        (!self.reader.entries().is_empty()).then_some(self.next_poll)
    }

    /// Polls once; publishes new values.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
        now: Instant,
    ) -> Result<(), BusError> {
        let time_ns = self.time.ns();
        let timer = match self.reader.poll(bus, now)? {
            VariablePoll::Report(timer) => Some(timer),
            VariablePoll::Values(which) => {
                let entry = self.reader.values().get(which.trailing_zeros() as usize);
                entry.map(|value| value.timer)
            }
            VariablePoll::Partial | VariablePoll::SettingUp => {
                self.next_poll = now + BUSY_POLL_PERIOD;
                None
            }
            VariablePoll::Off | VariablePoll::Nothing => {
                self.next_poll = now + POLL_PERIOD;
                if self.freshness.timeout(time_ns).is_some() {
                    publisher.set_region_state(RegionId::Variable, RegionState::Stale);
                }
                None
            }
        };
        if let Some(timer) = timer {
            self.publish(publisher, timer, time_ns);
            self.next_poll = now + POLL_PERIOD;
        }
        Ok(())
    }

    fn publish(&mut self, publisher: &mut Publisher, timer: u16, time_ns: u64) {
        if time_ns.saturating_sub(self.timer_read_ns) > TURN_NS {
            self.timer.reset();
        }
        self.timer_read_ns = time_ns;
        let (servo_timer, _) = self.timer.advance(timer.into());
        let entries = self.reader.entries().iter().zip(self.reader.values());
        let variables = entries.map(|(&VariableEntry { address, kind }, value)| {
            let [a, b, c, d] = value.words;
            Variable { address, kind, updates: value.updates as u32, longs: [join32(a, b), join32(c, d)] }
        });
        let words = variable::encode(self.table, variables, &mut self.payload);
        publisher.publish(
            RegionId::Variable,
            Stamp { time_ns, servo_timer, valid: true },
            &self.payload[..words],
        );
        if self.freshness.on_update(time_ns).is_some() {
            publisher.set_region_state(RegionId::Variable, RegionState::Live);
        }
    }
}
