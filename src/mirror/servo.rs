//! The servo region: reads each update once, in time, publishes it, and counts what was not read.

use super::clock::UpdateClock;
use super::freshness::{Freshness, Transition};
use super::gaps::UpdateCounter;
use crate::device::{Bus, BusError};
use crate::function::servo::{ServoLook, ServoReader, ServoReading};
use crate::function::servo_timer::ServoTimer;
use crate::segment::{Counter, Publisher, RegionId, RegionState, Stamp, monotonic_ns};

/// The servo timer's bits in the servo buffer.
const TIMER_BITS: u32 = 15;
/// How often a torn copy is made again at once, before the next look.
const COPIES: usize = 3;
/// Servo data are stale after this time, or [`STALE_PERIODS`], without an update.
const STALE_NS: u64 = 100_000_000;
const STALE_PERIODS: u64 = 10;

/// Mirrors the servo fixed data.
pub struct ServoMirror {
    reader: ServoReader,
    clock: UpdateClock,
    timer: ServoTimer,
    gaps: UpdateCounter,
    freshness: Freshness,
    servo_period_ns: Option<u64>,
    last_update_ns: u64,
    last_look_ns: u64,
    /// The period the segment was last told.
    told_period_ns: u64,
    /// Since the last update taken: predicted update times that fell into a stretch of Host-Busy.
    held_off: u64,
}

impl ServoMirror {
    /// A mirror that has seen nothing.
    #[must_use]
    pub fn new(reading: ServoReading) -> Self {
        Self {
            reader: ServoReader::new(reading),
            clock: UpdateClock::default(),
            timer: ServoTimer::new(TIMER_BITS),
            gaps: UpdateCounter::default(),
            freshness: Freshness::new(STALE_NS),
            servo_period_ns: None,
            last_update_ns: 0,
            last_look_ns: 0,
            told_period_ns: 0,
            held_off: 0,
        }
    }

    /// Takes what the board said of its motors (I59), servo period (I10) and report period in servo cycles (I19).
    pub fn configure(&mut self, motors: usize, servo_period_ns: Option<u64>, cycles: Option<u32>) {
        self.reader.set_motors(motors);
        self.servo_period_ns = servo_period_ns;
        if let Some(cycles) = cycles
            && self.gaps.cycles() != Some(cycles)
        {
            self.gaps.expect_cycles(cycles);
        }
        if let (Some(period), Some(cycles @ 1..)) = (servo_period_ns, cycles) {
            self.clock.expect_period(period * u64::from(cycles));
        }
    }

    /// When to look next, CLOCK_MONOTONIC.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.clock.due_ns()
    }

    /// Whether updates come.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.freshness.is_live()
    }

    /// Updates are stale after this time.
    #[must_use]
    pub fn stale_after_ns(&self) -> u64 {
        self.freshness.limit_ns()
    }

    /// Starts over, as with another board: what lies in the buffer now is old.
    pub fn forget(&mut self) {
        self.reader.forget();
        self.timer.forget();
    }

    /// Looks once, and publishes the update if there is one.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
    ) -> Result<Option<Transition>, BusError> {
        for _ in 0..COPIES {
            let before = monotonic_ns();
            match self.reader.look(bus)? {
                ServoLook::Update(timer) => return Ok(self.publish(publisher, timer, before)),
                ServoLook::Torn => {
                    publisher.counters().add(Counter::Retries, 1);
                    self.note_hold(before);
                }
                look @ (ServoLook::Unchanged | ServoLook::Busy) => {
                    if look == ServoLook::Busy {
                        self.note_hold(before);
                    }
                    break;
                }
            }
        }
        let now = monotonic_ns();
        self.clock.looked_in_vain(now);
        // Only looks tell that the board is silent; a mirror that was itself stopped has no right to say so yet.
        if now.saturating_sub(self.last_look_ns) >= self.freshness.limit_ns() {
            self.freshness.excuse(now);
        }
        self.last_look_ns = now;
        let transition = self.freshness.none_came(now);
        if transition.is_some() {
            // When updates come again they are a new stretch: the board may have been reset in between.
            self.forget();
            publisher.set_region_state(RegionId::Servo, RegionState::Stale);
        }
        Ok(transition)
    }

    fn publish(&mut self, publisher: &mut Publisher, timer: u16, time_ns: u64) -> Option<Transition> {
        let (servo_timer, passed) = self.timer.advance(timer);
        let updates = match passed {
            Some(passed) => {
                let turns = self.whole_turns(time_ns, passed);
                self.gaps.updates(u64::from(passed) + (turns << TIMER_BITS))
            }
            None => 1,
        };
        publisher.publish(RegionId::Servo, Stamp { time_ns, servo_timer, valid: true }, self.reader.image());
        let now = monotonic_ns();
        self.clock.found(time_ns, updates);
        self.note_hold(time_ns);
        let not_read = updates - 1;
        let skipped = not_read.min(std::mem::take(&mut self.held_off));
        let counters = publisher.counters();
        counters.add(Counter::Updates, 1);
        counters.add(Counter::Skipped, skipped);
        counters.add(Counter::Missed, not_read - skipped);
        self.last_update_ns = time_ns;
        self.last_look_ns = now;
        let transition = self.freshness.came(time_ns);
        if transition.is_some() {
            publisher.set_region_state(RegionId::Servo, RegionState::Live);
        }
        self.follow_period(publisher);
        transition
    }

    /// How many whole turns of the 15-bit timer passed unseen: a mirror that was stopped for longer than one can
    /// tell from the time that went by.
    fn whole_turns(&self, now_ns: u64, passed: u32) -> u64 {
        let Some(servo_period_ns) = self.servo_period_ns else { return 0 };
        let elapsed = now_ns.saturating_sub(self.last_update_ns) / servo_period_ns.max(1);
        let turn = 1u64 << TIMER_BITS;
        (elapsed.saturating_sub(u64::from(passed)) + turn / 2) / turn
    }

    /// In the handshake, an update due while Host-Busy was set has been skipped by the board.
    fn note_hold(&mut self, since_ns: u64) {
        if self.reader.reading() == ServoReading::Handshake {
            let until = monotonic_ns();
            let due = self.clock.due_ns();
            if (since_ns..=until).contains(&due) {
                self.held_off += 1;
            }
        }
    }

    /// Keeps the limit of staleness at ten periods of what the updates really come at.
    fn follow_period(&mut self, publisher: &Publisher) {
        let Some(period) = self.clock.period_ns() else { return };
        // A few per cent either way change nothing for anybody.
        if period.abs_diff(self.told_period_ns) > self.told_period_ns / 16 {
            self.told_period_ns = period;
            self.freshness.set_limit(STALE_NS.max(STALE_PERIODS * period));
            publisher.set_period(RegionId::Servo, period, self.freshness.limit_ns());
        }
    }
}
