//! The background region: asks for reports at a steady rate and publishes each.

use super::freshness::{Freshness, Transition};
use crate::device::{Bus, BusError};
use crate::function::background::{BackgroundLook, BackgroundReader};
use crate::function::servo_timer::ServoTimer;
use crate::map::Selection;
use crate::segment::{Counter, Publisher, RegionId, RegionState, Stamp, monotonic_ns};

/// The servo timer's bits in the background buffer.
const TIMER_BITS: u32 = 16;
/// How soon to look again when a report is due and not ready.
const AGAIN_NS: u64 = 2_000_000;
/// Reports are stale after this time, or ten periods, without one.
const STALE_NS: u64 = 1_000_000_000;
const STALE_PERIODS: u64 = 10;

/// Mirrors the background fixed data.
pub struct BackgroundMirror {
    reader: BackgroundReader,
    timer: ServoTimer,
    freshness: Freshness,
    period_ns: u64,
    due_ns: u64,
    /// When the first word of the report being read was read.
    began_ns: Option<u64>,
}

impl BackgroundMirror {
    /// A mirror that takes a report every `period_ns`.
    #[must_use]
    pub fn new(period_ns: u64) -> Self {
        Self::selecting(period_ns, Selection::ALL)
    }

    /// As [`BackgroundMirror::new`], but of the blocks only what `selection` has is read.
    #[must_use]
    pub fn selecting(period_ns: u64, selection: Selection) -> Self {
        Self {
            reader: BackgroundReader::selecting(selection),
            timer: ServoTimer::new(TIMER_BITS),
            freshness: Freshness::new(STALE_NS.max(STALE_PERIODS * period_ns)),
            period_ns,
            due_ns: 0,
            began_ns: None,
        }
    }

    /// Takes the number of motors and coordinate systems the board reports (I59).
    pub fn configure(&mut self, numbers: usize) {
        self.reader.set_numbers(numbers);
        self.began_ns = None;
    }

    /// When to look next, CLOCK_MONOTONIC.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Whether reports come.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.freshness.is_live()
    }

    /// Reports are stale after this time.
    #[must_use]
    pub fn stale_after_ns(&self) -> u64 {
        self.freshness.limit_ns()
    }

    /// Starts over, as with another board.
    pub fn forget(&mut self) {
        self.reader.forget();
        self.timer.forget();
        self.began_ns = None;
    }

    /// Gives up what lies there, so that the next report is a new one.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn start_over(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.reader.forget();
        self.began_ns = None;
        BackgroundReader::release(bus)
    }

    /// Looks once: reads a part of a report, and publishes it when it is whole.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
    ) -> Result<Option<Transition>, BusError> {
        let now = monotonic_ns();
        match self.reader.look(bus)? {
            BackgroundLook::Nothing => {
                self.due_ns = now + AGAIN_NS;
                let transition = self.freshness.none_came(now);
                if transition.is_some() {
                    self.forget();
                    publisher.set_region_state(RegionId::Background, RegionState::Stale);
                }
                Ok(transition)
            }
            BackgroundLook::Partial => {
                self.began_ns.get_or_insert(now);
                self.due_ns = now;
                Ok(None)
            }
            BackgroundLook::Report(timer) => {
                let began_ns = self.began_ns.take().unwrap_or(now);
                let (servo_timer, _) = self.timer.advance(timer);
                publisher.publish(
                    RegionId::Background,
                    Stamp { time_ns: began_ns, servo_timer, valid: true },
                    self.reader.image(),
                );
                publisher.counters().add(Counter::BackgroundUpdates, 1);
                self.due_ns = (began_ns + self.period_ns).max(now);
                let transition = self.freshness.came(now);
                if transition.is_some() {
                    publisher.set_region_state(RegionId::Background, RegionState::Live);
                }
                Ok(transition)
            }
        }
    }
}
