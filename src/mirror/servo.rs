//! The servo region: reads each update once, in time, publishes it, and counts the missed ones.

use std::collections::VecDeque;

use super::clock::UpdateClock;
use super::continuity::{Continuity, Verdict};
use super::freshness::{Freshness, Transition};
use super::gaps::UpdateCounter;
use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::function::servo::{Motion, ServoPoll, ServoReader, ServoReading};
use crate::function::servo_timer::ServoTimer;
use crate::map::{BusyRule, Motors, Selection, ServoBlock, WholeBoard};
use crate::segment::freshness::limit_ns;
use crate::segment::{BlockPlace, Counter, Publisher, RegionId, RegionSpec, RegionState, Stamp};

/// How often the mirror repeats a torn copy at once, before the next poll.
const COPIES: usize = 3;
/// Stretches of Host-Busy remembered between two updates.
const HOLDS: usize = 16;
/// Servo data are stale after this time without an update, or after ten periods ([`limit_ns`]).
const STALE_NS: u64 = 100_000_000;

/// A longer time between updates is a pause, if the board has told no period.
const LONGEST_PERIOD_NS: u64 = 1_000_000_000;

/// Two seconds at the default rate of 2.26 kHz, for readers that sleep.
const SLOTS: u32 = 4096;

/// The region in the segment. Its period follows later.
#[must_use]
pub fn region(block: &ServoBlock) -> RegionSpec {
    RegionSpec {
        id: RegionId::Servo,
        slots: SLOTS,
        payload_bytes: 2 * block.words() as u32,
        first_host_offset: block.region.start.bytes(),
        blocks: BlockPlace::new(block.motors, block.region.start),
        period_hint_ns: 0,
        stale_after_ns: STALE_NS,
    }
}

/// Mirrors the servo report.
pub struct ServoMirror {
    block: &'static ServoBlock,
    time: Clock,
    /// The reader, which knows the report's motors and what it says of them.
    pub reader: ServoReader,
    clock: UpdateClock,
    timer: ServoTimer,
    continuity: Continuity,
    gaps: UpdateCounter,
    /// Whether updates come, and when they are stale.
    pub freshness: Freshness,
    last_poll_ns: u64,
    /// The period in the segment.
    published_period_ns: u64,
    /// Periods of the clock that passed before the last update.
    clocks_before: u64,
    /// Since the last update taken: when Host-Busy was set, from and to.
    holds: VecDeque<(u64, u64)>,
    /// The mirror has found the board reset; reported once.
    was_reset: bool,
    /// Updates published so far.
    updates: u64,
    /// The length of a servo cycle, and the report's period in servo cycles, by the board.
    cycle_ns: Option<u64>,
    cycles: Option<u32>,
    /// The board makes an update in the servo cycle after the host has taken the last one.
    on_request: bool,
}

impl ServoMirror {
    /// As [`ServoMirror::new`], but the mirror reads only the words of `selection`.
    #[must_use]
    pub fn new(block: &'static ServoBlock, reading: ServoReading, selection: Selection, time: Clock) -> Self {
        Self {
            block,
            reader: ServoReader::new(block, reading, selection).timed_by(time.clone()),
            time,
            clock: UpdateClock::default(),
            timer: ServoTimer::new(block.timer.bits()),
            continuity: Continuity::new(block.timer.bits()),
            // Only boards that say when data are ready can wait until the host has taken them.
            gaps: match block.busy {
                BusyRule::ClearWhileWriting => UpdateCounter::told(),
                BusyRule::SetWhileWriting => UpdateCounter::default(),
            },
            freshness: Freshness::new(STALE_NS),
            last_poll_ns: 0,
            published_period_ns: 0,
            clocks_before: 1,
            holds: VecDeque::with_capacity(HOLDS),
            was_reset: false,
            updates: 0,
            cycle_ns: None,
            cycles: None,
            on_request: false,
        }
    }

    /// Clears the host's bit, whichever host set it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        ServoReader::release(self.block, bus)
    }

    /// Takes the board's answers: the motors it reports, its servo period, and the report's period in servo cycles, 0
    /// if it has none.
    pub fn configure(&mut self, motors: Motors, servo_period_ns: Option<u64>, cycles: Option<u32>) {
        self.reader.set_motors(motors);
        if let Some(cycles) = cycles
            && self.gaps.cycles() != Some(cycles)
        {
            self.gaps.expect_cycles(cycles);
        }
        if let Some(period) = servo_period_ns {
            self.continuity.expect_cycle(period);
        }
        (self.cycle_ns, self.cycles) = (servo_period_ns, cycles);
        self.expect_period();
    }

    /// Sets whether the board makes each update in the servo cycle after the host has taken the last one (Turbo User
    /// Manual p. 403: I47=0).
    pub fn set_on_request(&mut self, on_request: bool) {
        if self.on_request != on_request {
            self.on_request = on_request;
            // The timing learnt from the other way of reading does not hold for this one.
            self.clock = UpdateClock::default();
            self.expect_period();
        }
    }

    /// Tells the clock the board's period. On request the period is one servo cycle; the clock must not learn it, or it
    /// would learn how often it polls itself.
    fn expect_period(&mut self) {
        let cycles = if self.on_request { Some(1) } else { self.cycles.filter(|cycles| *cycles > 0) };
        if let (Some(period), Some(cycles)) = (self.cycle_ns, cycles) {
            self.clock.expect_period(period.saturating_mul(cycles.into()));
        }
    }

    /// When to poll next, CLOCK_MONOTONIC.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.clock.due_ns()
    }

    /// Whether updates come.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.freshness.is_live()
    }

    /// The facts about the whole board in the servo data; `None` while no data come, or if they do not tell.
    #[must_use]
    pub fn whole_board(&self) -> Option<WholeBoard> {
        self.reader.whole_board().filter(|_| self.is_live())
    }

    /// The motors whose loop is open, by the servo data: none while no data come.
    #[must_use]
    pub fn open_loops(&self) -> Motors {
        if self.is_live() { self.reader.open_loops() } else { Motors::NONE }
    }

    /// The motors that move, by the servo data: unknown while no data come.
    #[must_use]
    pub fn motion(&self) -> Motion {
        if self.is_live() { self.reader.motion() } else { Motion::default() }
    }

    /// Updates published so far.
    #[must_use]
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Starts over, as with another board: the data in the buffer now are old.
    pub fn reset(&mut self) {
        self.reader.reset();
        self.timer.reset();
        self.continuity.reset();
    }

    /// The daemon stops using the report: the mirror's knowledge of it says nothing about the board.
    pub fn end(&mut self, publisher: &Publisher) {
        self.reset();
        self.freshness.end();
        publisher.set_region_state(RegionId::Servo, RegionState::Off);
    }

    /// Polls once, and publishes an update.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
    ) -> Result<Option<Transition>, BusError> {
        let mut began = 0;
        for _ in 0..COPIES {
            began = self.time.ns();
            match self.reader.poll(bus)? {
                ServoPoll::Update(timer) => return Ok(self.publish(publisher, timer, began)),
                ServoPoll::Torn => {
                    publisher.counters().add(Counter::Retries, 1);
                    self.record_host_busy(began);
                }
                ServoPoll::First(timer) => {
                    // Counts an update missed because the motor mask was just widened.
                    if let (_, Some(passed @ 1..)) = self.timer.advance(timer)
                        && self.freshness.is_live()
                    {
                        publisher.counters().add(Counter::Missed, self.gaps.updates(passed.into()));
                    }
                    break;
                }
                poll @ (ServoPoll::Unchanged | ServoPoll::Busy) => {
                    if poll == ServoPoll::Busy {
                        self.record_host_busy(began);
                    }
                    break;
                }
            }
        }
        let now = self.time.ns();
        self.clock.poll_empty(began, now);
        // Silence counts only while this thread polls: after a stop the deadline starts again.
        if self.stood_still(now) {
            self.freshness.reset_deadline(now);
        }
        self.last_poll_ns = now;
        let transition = self.freshness.timeout(now);
        if transition.is_some() {
            publisher.set_region_state(RegionId::Servo, RegionState::Stale);
        }
        Ok(transition)
    }

    /// Whether this thread made no poll before `now_ns` for as long as it takes data to become old.
    fn stood_still(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.last_poll_ns) >= self.freshness.limit_ns()
    }

    fn publish(&mut self, publisher: &mut Publisher, timer: u32, time_ns: u64) -> Option<Transition> {
        let (servo_timer, passed) = self.timer.advance(timer);
        let passed = passed.map_or(1, u64::from);
        let was_live = self.freshness.is_live();
        let verdict = self.continuity.judge(timer, passed, self.gaps.cycles(), time_ns, was_live);
        if verdict != Verdict::Continuous {
            // The read words may be zeros. A new stretch begins with the next update.
            if verdict == Verdict::Reset {
                publisher.counters().add(Counter::Resets, 1);
                self.was_reset = true;
            }
            self.continuity.on_update(time_ns, None);
            self.clock.poll_empty(time_ns, self.time.ns());
            return None;
        }
        let passed = self.continuity.whole(passed, self.gaps.cycles(), time_ns);
        // While the board reported nothing, it made no update that the mirror could have missed.
        let updates = if was_live { self.gaps.updates(passed) } else { 1 };
        // The clock follows servo cycles while each of them may bring an update.
        let every_cycle = self.on_request || self.gaps.is_untold();
        let steps = if every_cycle && was_live { passed } else { updates };
        // The board may have stood still together with this thread: then the time tells no length of a cycle.
        let went_on = was_live && self.continuity.since_last(time_ns) < self.freshness.limit_ns();
        self.continuity.on_update(time_ns, went_on.then_some(passed));
        publisher.publish(RegionId::Servo, Stamp { time_ns, servo_timer, valid: true }, self.reader.image());
        self.clock.on_update(time_ns, steps);
        self.updates += 1;
        let not_read = updates - 1;
        let skipped = self.skipped(not_read);
        self.record_host_busy(time_ns);
        let counters = publisher.counters();
        counters.add(Counter::Updates, 1);
        counters.add(Counter::Skipped, skipped);
        counters.add(Counter::Missed, not_read - skipped);
        self.last_poll_ns = time_ns;
        let transition = self.freshness.on_update(time_ns);
        if transition.is_some() {
            publisher.set_region_state(RegionId::Servo, RegionState::Live);
        }
        // While the board has told no period, the clock follows servo cycles.
        self.follow_period(publisher, if self.gaps.is_untold() { passed } else { 1 });
        transition
    }

    /// Whether the mirror has found the board reset since the last call.
    pub fn take_reset(&mut self) -> bool {
        std::mem::take(&mut self.was_reset)
    }

    /// In the handshake the board skips an update that is due while Host-Busy is set.
    fn record_host_busy(&mut self, since_ns: u64) {
        if self.reader.reading() == ServoReading::Handshake {
            if self.holds.len() == HOLDS {
                self.holds.pop_front();
            }
            self.holds.push_back((since_ns, self.time.ns()));
        }
    }

    /// How many of the `not_read` updates before the last one were due while Host-Busy was set. An estimate: only the
    /// clock says when they were due.
    fn skipped(&mut self, not_read: u64) -> u64 {
        let holds = self.holds.drain(..);
        match (self.clock.update_ns(), self.clock.period_ns()) {
            (Some(update), Some(period @ 1..)) if not_read > 0 => holds
                .map(|(from, to)| due_between(update, period, not_read, from, to))
                .sum::<u64>()
                .min(not_read),
            _ => 0,
        }
    }

    /// Keeps the limit of staleness at ten periods of the updates' real distance, which is `clocks` of the clock's
    /// periods.
    fn follow_period(&mut self, publisher: &Publisher, clocks: u64) {
        let Some(period) = self.clock.period_ns() else { return };
        // A single pause, or a long one, says nothing about the updates after it.
        let whole = period.saturating_mul(clocks.min(std::mem::replace(&mut self.clocks_before, clocks)));
        let period = if (STALE_NS / 10..=LONGEST_PERIOD_NS).contains(&whole) { whole } else { period };
        // A learnt period wavers by less.
        if period.abs_diff(self.published_period_ns) > self.published_period_ns / 512 {
            self.published_period_ns = period;
            self.freshness.set_limit(limit_ns(STALE_NS, period));
            publisher.set_period(RegionId::Servo, period, self.freshness.limit_ns());
        }
    }
}

/// Of the `count` updates before the one at `update_ns`, each a period before the next: those due from `from` to `to`.
fn due_between(update_ns: u64, period_ns: u64, count: u64, from: u64, to: u64) -> u64 {
    let first = update_ns.saturating_sub(to).div_ceil(period_ns).max(1);
    let last = (update_ns.saturating_sub(from) / period_ns).min(count);
    (last + 1).saturating_sub(first)
}

#[cfg(test)]
#[path = "servo_tests.rs"]
mod report_tests;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_updates_are_those_due_while_the_host_held_the_buffer() {
        // Updates at 900, 800 and 700 were not read; the one at 1000 was.
        assert_eq!(due_between(1000, 100, 3, 880, 920), 1);
        assert_eq!(due_between(1000, 100, 3, 820, 880), 0);
        assert_eq!(due_between(1000, 100, 3, 780, 920), 2);
        assert_eq!(due_between(1000, 100, 3, 900, 900), 1);
        assert_eq!(due_between(1000, 100, 3, 100, 2000), 3);
        assert_eq!(due_between(1000, 100, 3, 100, 650), 0, "before the first of them");
        assert_eq!(due_between(1000, 100, 3, 950, 2000), 0, "the one seen was not skipped");
    }
}
