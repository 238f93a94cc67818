//! The background region: asks for reports at a steady rate and publishes each.
//!
//! A sample's time is the last moment when its report was not there yet: the time of the question, or of the last empty
//! poll. The data are no older, whatever held up the daemon since. The mirror does not publish a report older than the
//! limit of staleness; it asks for a new one.

use super::freshness::{Freshness, Transition};
use crate::device::{Bus, BusError};
use crate::function::background::{BackgroundPoll, BackgroundReader};
use crate::function::servo_timer::ServoTimer;
use crate::map::{BackgroundBlock, Motors, Selection, Systems, WholeBoard};
use crate::segment::freshness::limit_ns;
use crate::segment::{BlockPlace, Counter, Publisher, RegionId, RegionSpec, RegionState, Stamp};

/// How soon to poll (again) for a requested report, and no later than after a quarter of a period.
const AGAIN_NS: u64 = 2_000_000;
/// Reports are stale after this time without one, or after ten periods ([`limit_ns`]).
const STALE_NS: u64 = 1_000_000_000;

/// The region in the segment, with a report every `period_ns`. It holds a second of reports, at least 16.
#[must_use]
pub fn region(block: &BackgroundBlock, period_ns: u64) -> RegionSpec {
    let reports = u32::try_from(1_000_000_000 / period_ns.max(1)).unwrap_or(u32::MAX);
    RegionSpec {
        id: RegionId::Background,
        slots: reports.clamp(16, 1024).next_power_of_two(),
        payload_bytes: 2 * block.words() as u32,
        first_host_offset: block.region.start.bytes(),
        blocks: BlockPlace::new(block.blocks, block.region.start),
        period_hint_ns: period_ns,
        stale_after_ns: limit_ns(STALE_NS, period_ns),
    }
}

/// Mirrors the background fixed data.
pub struct BackgroundMirror {
    block: &'static BackgroundBlock,
    /// The reader, which knows the report's blocks.
    pub reader: BackgroundReader,
    timer: ServoTimer,
    /// Whether reports come, and when they are stale.
    pub freshness: Freshness,
    period_ns: u64,
    due_ns: u64,
    last_poll_ns: u64,
    /// The mirror has asked for a report.
    asked: Option<Asked>,
    /// The board may be making a report under an old count; the mirror does not take that report.
    is_outdated: bool,
    /// The last report's facts about the whole board.
    told: Told,
    /// Reports published so far.
    reports: u64,
}

/// A report's facts about the whole board.
#[derive(Debug, Clone, Copy, Default)]
struct Told {
    /// The report's time.
    time_ns: u64,
    /// The time of the request for it; the board began it later.
    asked_ns: u64,
    whole_board: Option<WholeBoard>,
}

/// A requested report.
#[derive(Debug, Clone, Copy)]
struct Asked {
    at_ns: u64,
    /// The report was not there at this time.
    not_before_ns: u64,
    /// The time at which the mirror read its first words.
    began_ns: Option<u64>,
}

impl BackgroundMirror {
    /// As [`BackgroundMirror::new`], but the mirror reads only the words of `selection`.
    #[must_use]
    pub fn new(block: &'static BackgroundBlock, period_ns: u64, selection: Selection) -> Self {
        Self {
            block,
            reader: BackgroundReader::new(block, selection),
            timer: ServoTimer::new(block.timer.bits()),
            freshness: Freshness::new(limit_ns(STALE_NS, period_ns)),
            period_ns,
            due_ns: 0,
            last_poll_ns: 0,
            asked: None,
            is_outdated: false,
            told: Told::default(),
            reports: 0,
        }
    }

    /// Clears the host's bit, whichever host set it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        BackgroundReader::release(self.block, bus)
    }

    /// Takes the highest motor that the board reports. If the report has only coordinate systems, the mirror reads all
    /// of them.
    pub fn configure(&mut self, motors: usize) {
        self.reader.set_numbers(self.block.reported(motors));
        if self.block.count.is_some() {
            self.count_changes();
        } else if let Some(asked) = &mut self.asked {
            // The mirror reads the half-read report again; its time stays.
            asked.began_ns = None;
        }
    }

    /// When to poll next, CLOCK_MONOTONIC.
    #[must_use]
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// How long a poll can wait: as long as from one poll to the next.
    #[must_use]
    pub fn spare_ns(&self) -> u64 {
        AGAIN_NS.min(self.period_ns / 4)
    }

    /// Whether reports come.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.freshness.is_live()
    }

    /// The facts about the whole board in the last report; `None` while no reports come, or if they do not tell.
    #[must_use]
    pub fn whole_board(&self) -> Option<WholeBoard> {
        self.told.whole_board.filter(|_| self.is_live())
    }

    /// The motors whose amplifier is off, by the reports: none while no reports come.
    #[must_use]
    pub fn amplifiers_off(&self) -> Motors {
        if self.is_live() && self.reports > 0 { self.reader.amplifiers_off() } else { Motors::NONE }
    }

    /// The coordinate systems that run a motion program, and when the mirror asked for the report that says so; `None`
    /// unless the last report tells and is at most `age_ns` old at `now`.
    #[must_use]
    pub fn programs_run(&self, now: u64, age_ns: u64) -> Option<(Systems, u64)> {
        let is_told = self.is_live() && self.reports > 0 && self.is_new(now, age_ns);
        let runs = if is_told { self.reader.programs_run() } else { None };
        runs.map(|runs| (runs, self.told.asked_ns))
    }

    /// Whether the last report is at most `age_ns` old at `now`. False if the mirror asks less often than that: the
    /// daemon would notice too late that a report has become too old.
    #[must_use]
    pub fn is_new(&self, now: u64, age_ns: u64) -> bool {
        self.period_ns <= age_ns && now.saturating_sub(self.told.time_ns) <= age_ns
    }

    /// Reports published so far.
    #[must_use]
    pub fn reports(&self) -> u64 {
        self.reports
    }

    /// Starts over, as with another board.
    pub fn reset(&mut self) {
        self.timer.reset();
        self.ask_anew();
    }

    /// Whether to leave the host's words for the report's extent as they are found.
    pub fn keep_as_found(&mut self, as_found: bool) {
        if self.reader.keep_as_found(as_found) {
            self.count_changes();
        }
    }

    /// The board may be making a report under the old count.
    fn count_changes(&mut self) {
        self.is_outdated |= self.asked.is_some();
        self.ask_anew();
    }

    /// Drops the requested or half-read report, made under another count: blocks beyond the count are old, or another
    /// program's.
    fn ask_anew(&mut self) {
        self.reader.reset();
        self.asked = None;
    }

    /// The daemon stops using the report: the mirror's knowledge of it says nothing about the board.
    pub fn end(&mut self, publisher: &Publisher) {
        self.reset();
        self.freshness.end();
        publisher.set_region_state(RegionId::Background, RegionState::Off);
    }

    /// Gives up a waiting report and asks for a new one.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn ask(&mut self, bus: &mut impl Bus, now: u64) -> Result<(), BusError> {
        self.asked = None;
        // A report that is there already is complete; a new request takes it away.
        self.is_outdated = self.is_outdated && !self.reader.is_ready(bus)?;
        self.reader.ask(bus)?;
        self.asked = Some(Asked { at_ns: now, not_before_ns: now, began_ns: None });
        self.due_ns = now + self.spare_ns();
        Ok(())
    }

    /// Does the work due at `now`: asks for a report, polls for it, or reads a part of it, and publishes it when it is
    /// whole.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
        now: u64,
    ) -> Result<Option<Transition>, BusError> {
        // Silence counts only while this thread polls: after a stop the deadline starts again.
        if now.saturating_sub(self.last_poll_ns) >= self.freshness.limit_ns() {
            self.freshness.reset_deadline(now);
        }
        self.last_poll_ns = now;
        let Some(asked) = &mut self.asked else {
            // A poll that came late does not make the reports less frequent.
            let planned_ns = self.due_ns;
            let is_punctual = now.saturating_sub(planned_ns) <= self.spare_ns();
            self.ask(bus, now)?;
            if let Some(asked) = self.asked.as_mut().filter(|_| is_punctual) {
                asked.at_ns = planned_ns;
            }
            return Ok(None);
        };
        match self.reader.poll(bus)? {
            BackgroundPoll::Nothing => {
                // Another report can have replaced this one only after the mirror read this one's first words.
                asked.not_before_ns = asked.began_ns.take().unwrap_or(now);
                self.due_ns = now + self.spare_ns();
                let transition = self.freshness.timeout(now);
                if transition.is_some() {
                    self.reset();
                    publisher.set_region_state(RegionId::Background, RegionState::Stale);
                }
                Ok(transition)
            }
            BackgroundPoll::Partial => {
                asked.began_ns.get_or_insert(now);
                self.due_ns = now;
                Ok(None)
            }
            BackgroundPoll::Report(timer) => {
                let Asked { at_ns, not_before_ns: time_ns, .. } = *asked;
                self.asked = None;
                let is_outdated = std::mem::take(&mut self.is_outdated);
                if is_outdated || now.saturating_sub(time_ns) >= self.freshness.limit_ns() {
                    self.due_ns = now;
                    return Ok(None);
                }
                let (servo_timer, _) = self.timer.advance(timer);
                publisher.publish(
                    RegionId::Background,
                    Stamp { time_ns, servo_timer, valid: true },
                    self.reader.image(),
                );
                publisher.counters().add(Counter::BackgroundUpdates, 1);
                self.reports += 1;
                self.told = Told { time_ns, asked_ns: at_ns, whole_board: self.reader.whole_board() };
                self.due_ns = (at_ns + self.period_ns).max(now);
                let transition = self.freshness.on_update(now);
                if transition.is_some() {
                    publisher.set_region_state(RegionId::Background, RegionState::Live);
                }
                Ok(transition)
            }
        }
    }
}

#[cfg(test)]
#[path = "background_tests.rs"]
mod tests;
