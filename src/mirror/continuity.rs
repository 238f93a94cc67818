//! Whether the board went on or was reset: its servo timer against the time that went by.
//!
//! A board that went on shows no more servo cycles since the last update than fit into the time since. A board that was
//! reset counts from 0, so its timer itself shows no more than that. A timer tells of a reset only if it fits a count
//! from 0 and does not fit the time since the last update. A pause of the report (I48, GATHER, a longer I19) or of
//! either program is no reset, however long. A simulated board runs slow on a busy machine, stopped or in virtual time,
//! so fewer cycles than fit say nothing.
//!
//! The longer the silence, the more of the timer's values fit: after about a turn of its 15 bits all do, and the timer
//! tells nothing. The mirror then takes the silence for a pause: a false alarm would end a streamed contour, and the
//! daemon has other means to see a reset. A reset clears the status word at once, and a mirror that polls every few
//! milliseconds sees a timer of exactly 0 without a report, which a board that goes on shows once in 32768 times.

/// A timer that moved on by no more than this many updates goes on from the last update, but never a timer that moved
/// by more than a quarter of a turn.
const NEXT_UPDATES: u64 = 64;
/// By so many servo cycles an update may seem early: the thread was held up between clock and poll.
const SLACK: u64 = 64;
/// After this many servo cycles the mirror knows their length, from the latest ones: the older half counts less after
/// so many.
const MEASURED: u64 = 256;
const MEASURED_AT_MOST: u64 = 8192;
/// More servo cycles than any board has run: the bound when I10 is nonsense.
const MOST_CYCLES: u64 = 1 << 48;

/// The verdict on an update's timer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The board went on since the last update, or nothing says otherwise.
    Continuous,
    /// The board was reset, or cleared its memory.
    Reset,
    /// The timer is neither at its expected value nor near its start: another program set it, or its clock became
    /// faster.
    Discontinuous,
}

/// Remembers the last update's time and measures the length of a servo cycle.
#[derive(Debug, Clone)]
pub struct Continuity {
    /// Bits of the servo timer.
    timer_bits: u32,
    /// The length of a servo cycle by the board's I10.
    told_ns: Option<u64>,
    /// Servo cycles that passed while updates came, and the time that they took.
    cycles: u64,
    taken_ns: u64,
    /// The last update; `None` while the age of every update is unknown.
    last_ns: Option<u64>,
}

impl Continuity {
    /// The state before the first update of a board whose servo timer has `timer_bits`.
    #[must_use]
    pub fn new(timer_bits: u32) -> Self {
        Self { timer_bits, told_ns: None, cycles: 0, taken_ns: 0, last_ns: None }
    }

    /// Takes the length of a servo cycle by I10. A measured length wins.
    pub fn expect_cycle(&mut self, cycle_ns: u64) {
        self.told_ns = Some(cycle_ns);
    }

    /// Starts over, as with another board.
    pub fn reset(&mut self) {
        *self = Self { told_ns: self.told_ns, ..Self::new(self.timer_bits) };
    }

    /// Judges an update at `now_ns` whose timer is `timer` and moved on by `passed`, less whole turns. `cycles`: the
    /// known cycles from update to update (I19); `was_live`: updates came until now.
    #[must_use]
    pub fn judge(
        &self,
        timer: u32,
        passed: u64,
        cycles: Option<u32>,
        now_ns: u64,
        was_live: bool,
    ) -> Verdict {
        if timer == 0 && !was_live {
            return Verdict::Reset;
        }
        let next = (NEXT_UPDATES * u64::from(cycles.unwrap_or(1))).min(1 << (self.timer_bits - 2));
        let Some(elapsed) = self.elapsed(now_ns).filter(|_| passed > next) else {
            return Verdict::Continuous;
        };
        let fit = elapsed + elapsed / 4 + SLACK;
        if passed <= fit {
            Verdict::Continuous
        } else if u64::from(timer) <= fit {
            Verdict::Reset
        } else {
            Verdict::Discontinuous
        }
    }

    /// Servo cycles since the last update, whole turns included, if the timer shows `passed`: after more than a turn
    /// only the elapsed time tells. A timer that shows one of the next updates goes on from the last update, however
    /// long ago that was. A timer that even with its turns does not come near the elapsed time stood still for a part
    /// of it, like a simulated board that is stopped together with this program. `cycles` as for [`Self::judge`].
    #[must_use]
    pub fn whole(&self, passed: u64, cycles: Option<u32>, now_ns: u64) -> u64 {
        let turn = 1u64 << self.timer_bits;
        let elapsed = self.elapsed(now_ns).unwrap_or(0);
        let turns = (elapsed.saturating_sub(passed) + turn / 2) / turn;
        let whole = passed + turns * turn;
        let is_next = passed <= SLACK.max(2 * u64::from(cycles.unwrap_or(1)));
        let near = (elapsed / 16 + SLACK).min(turn / 4);
        if is_next || whole.abs_diff(elapsed) > near { passed } else { whole }
    }

    /// An update came at `now_ns`, after `passed` servo cycles if they are known.
    pub fn on_update(&mut self, now_ns: u64, passed: Option<u64>) {
        if let (Some(last), Some(passed)) = (self.last_ns, passed) {
            self.cycles += passed;
            self.taken_ns = self.taken_ns.saturating_add(now_ns.saturating_sub(last));
            while self.cycles > MEASURED_AT_MOST {
                self.cycles /= 2;
                self.taken_ns /= 2;
            }
        }
        self.last_ns = Some(now_ns);
    }

    /// The time since the last update, in ns.
    #[must_use]
    pub fn since_last(&self, now_ns: u64) -> u64 {
        self.last_ns.map_or(u64::MAX, |last| now_ns.saturating_sub(last))
    }

    /// Servo cycles that fit into the time since the last update; `None` while either length is unknown.
    fn elapsed(&self, now_ns: u64) -> Option<u64> {
        let since = now_ns.saturating_sub(self.last_ns?);
        let measured = (self.cycles >= MEASURED).then_some((self.taken_ns, self.cycles));
        let (ns, cycles) = measured.or(self.told_ns.map(|told| (told, 1)))?;
        let elapsed = u128::from(since) * u128::from(cycles) / u128::from(ns.max(1));
        Some(u64::try_from(elapsed).unwrap_or(u64::MAX).min(MOST_CYCLES))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMER_BITS: u32 = 15;

    /// 2258.8 Hz.
    const CYCLE_NS: u64 = 442_708;
    const SECOND: u64 = 2259;
    const TURN: u64 = 1 << TIMER_BITS;

    /// The verdict on `timer` from a board that has shown `last` and was silent for `silence` cycles.
    fn after(last: u64, silence: u64, timer: u64) -> Verdict {
        let mut continuity = Continuity::new(TIMER_BITS);
        continuity.expect_cycle(CYCLE_NS);
        let start = 1_000_000_000;
        continuity.on_update(start, None);
        let passed = (timer + TURN - last) % TURN;
        let is_live = silence * CYCLE_NS < 100_000_000;
        continuity.judge(timer as u32, passed, Some(1), start + silence * CYCLE_NS, is_live)
    }

    #[test]
    fn a_pause_is_no_reset() {
        for silence in
            [100, 230, 300, SECOND / 3, SECOND, 10 * SECOND, 14 * SECOND, 20 * SECOND, 3600 * SECOND]
        {
            for last in [0, 1, 5000, 16_000, 32_000, TURN - 1] {
                // On time; a little early; slow, as a simulated board; stopped, as a board in mid-pause.
                for passed in [silence, silence + silence / 16 + 20, silence * 2 / 3, silence / 2, 70, 3, 1] {
                    let timer = (last + passed) % TURN;
                    if timer != 0 {
                        assert_eq!(
                            after(last, silence, timer),
                            Verdict::Continuous,
                            "{last} {silence} {passed}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_reset_is_found() {
        // A reset clears the status word at once: a poll finds 0, at any time and wherever the timer was.
        for silence in [230, SECOND, 8 * SECOND, 20 * SECOND, 3600 * SECOND] {
            for last in [1, 5000, 16_000, TURN - silence % TURN, TURN - 1] {
                assert_eq!(after(last, silence, 0), Verdict::Reset, "{last} {silence}");
            }
        }
        // While updates come, from one update to the next.
        for (last, timer) in [(5000, 0), (5000, 1), (30_000, 0), (200, 0), (20_000, 60)] {
            assert_eq!(after(last, 1, timer), Verdict::Reset, "{last}");
        }
        // The mirror sees the first update after the board has counted from 0 for a while.
        for (last, silence, timer) in
            [(20_000, 300, 10), (20_000, SECOND, 2000), (5000, SECOND, 500), (12_000, 5 * SECOND, 9000)]
        {
            assert_eq!(after(last, silence, timer), Verdict::Reset, "{last} {silence} {timer}");
        }
        // With a period so long that 64 of it are a turn.
        let mut continuity = Continuity::new(TIMER_BITS);
        continuity.expect_cycle(CYCLE_NS);
        continuity.on_update(0, None);
        let passed = TURN - 20_000 + 30;
        assert_eq!(continuity.judge(30, passed, Some(600), 600 * CYCLE_NS, true), Verdict::Reset);
        assert_eq!(continuity.judge(20_600, 600, Some(600), 600 * CYCLE_NS, true), Verdict::Continuous);
    }

    #[test]
    fn a_timer_that_is_elsewhere_is_no_reset() {
        assert_eq!(after(5000, 1, 25_000), Verdict::Discontinuous);
        assert_eq!(after(5000, SECOND, 25_000), Verdict::Discontinuous);
        // The servo clock has become four times as fast meanwhile.
        assert_eq!(after(5000, SECOND, 5000 + 4 * SECOND), Verdict::Discontinuous);
    }

    #[test]
    fn what_nobody_knows_tells_of_no_reset() {
        let mut continuity = Continuity::new(TIMER_BITS);
        // No update yet: the age of the present report is unknown.
        continuity.expect_cycle(CYCLE_NS);
        assert_eq!(continuity.judge(7, 20_000, Some(1), 1_000_000_000, false), Verdict::Continuous);
        assert_eq!(continuity.judge(0, 20_000, Some(1), 1_000_000_000, false), Verdict::Reset, "cleared");
        // The length of a cycle is unknown.
        let mut continuity = Continuity::new(TIMER_BITS);
        continuity.on_update(0, None);
        assert_eq!(continuity.judge(7, 20_000, None, 442_708, true), Verdict::Continuous);
    }

    #[test]
    fn a_changed_report_period_is_no_reset() {
        // From I19 = 3 to 200, 230 and 2000, while the mirror believes the old period and once it doubts it.
        for period in [200, 230, 2000] {
            for (cycles, is_live) in [(Some(3), true), (None, true), (Some(3), false)] {
                let mut continuity = Continuity::new(TIMER_BITS);
                let mut now = 0;
                for _ in 0..200 {
                    now += 3 * CYCLE_NS;
                    continuity.on_update(now, Some(3));
                }
                for update in 1..5 {
                    now += period * CYCLE_NS;
                    let timer = (9000 + update * period) as u32;
                    assert_eq!(continuity.judge(timer, period, cycles, now, is_live), Verdict::Continuous);
                    continuity.on_update(now, is_live.then_some(period));
                }
            }
        }
    }

    #[test]
    fn the_length_of_a_cycle_is_measured() {
        let mut continuity = Continuity::new(TIMER_BITS);
        // I10 says twice the real length.
        continuity.expect_cycle(2 * CYCLE_NS);
        let mut now = 0;
        for update in 0..5000 {
            now += CYCLE_NS;
            continuity.on_update(now, (update > 0).then_some(1));
        }
        assert_eq!(continuity.elapsed(now + 1000 * CYCLE_NS), Some(1000));
        // The servo clock became slower; the estimate follows.
        for _ in 0..30_000 {
            now += 2 * CYCLE_NS;
            continuity.on_update(now, Some(1));
        }
        let elapsed = continuity.elapsed(now + 1000 * CYCLE_NS).unwrap();
        assert!((500..510).contains(&elapsed), "{elapsed}");
        continuity.reset();
        assert_eq!(continuity.elapsed(now), None);
        continuity.on_update(now, Some(1));
        assert_eq!(continuity.elapsed(now + 1000 * CYCLE_NS), Some(500), "as told");
    }

    #[test]
    fn turns_are_counted_by_time() {
        let mut continuity = Continuity::new(TIMER_BITS);
        assert_eq!(continuity.whole(100, Some(1), 1_000_000_000), 100);
        continuity.expect_cycle(1000);
        continuity.on_update(0, None);
        assert_eq!(continuity.whole(100, Some(1), 120_000), 100);
        assert_eq!(continuity.whole(100, Some(1), 32_800_000), 32_868);
        assert_eq!(continuity.whole(32_000, Some(1), (65_536 + 31_000) * 1000), 65_536 + 32_000);
    }

    #[test]
    fn a_board_that_stood_still_with_the_daemon_made_no_turn() {
        let mut continuity = Continuity::new(TIMER_BITS);
        continuity.expect_cycle(CYCLE_NS);
        continuity.on_update(0, None);
        // First, board and daemon go on together; second, the board goes on a tenth of a second before the daemon.
        for stood in [5, 8, 10, 12, 20, 60, 3600, 30_000] {
            for passed in [1, 20, 64] {
                let now = (stood * SECOND + passed) * CYCLE_NS;
                assert_eq!(continuity.whole(passed, Some(1), now), passed, "{stood} s, {passed}");
            }
        }
        // No time is near whole turns, of 14.5 s.
        for stood in [8, 10, 12, 20, 25, 124, 299, 1006] {
            let now = (stood * SECOND + SECOND / 10) * CYCLE_NS;
            assert_eq!(continuity.whole(SECOND / 10, Some(1), now), SECOND / 10, "{stood} s");
        }
        // Only the daemon stood still.
        for silence in [5 * SECOND, 20 * SECOND, 60 * SECOND, 300 * SECOND] {
            assert_eq!(continuity.whole(silence % TURN, Some(1), silence * CYCLE_NS), silence);
        }
    }

    #[test]
    fn a_nonsensical_period_makes_no_nonsensical_sums() {
        for cycle_ns in [0, 1, CYCLE_NS, u64::MAX] {
            let mut continuity = Continuity::new(TIMER_BITS);
            continuity.expect_cycle(cycle_ns);
            continuity.on_update(0, None);
            let elapsed = continuity.elapsed(u64::MAX);
            assert!(elapsed.is_some_and(|elapsed| elapsed <= MOST_CYCLES), "{cycle_ns}: {elapsed:?}");
            let _ = continuity.judge(5, 20_000, Some(u32::MAX), u64::MAX, true);
            continuity.on_update(u64::MAX, Some(continuity.whole(5, None, u64::MAX)));
            let _ = continuity.judge(5, 20_000, Some(u32::MAX), u64::MAX, false);
        }
    }
}
