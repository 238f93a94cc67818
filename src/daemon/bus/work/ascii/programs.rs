//! Whether a program's `CMD` may have caused an error.
//!
//! With I6=2 the board reports no such error (Software Reference, I6). Otherwise a PLC program may cause one unless
//! I5=0, and a motion program may unless the background reports say that no coordinate system runs one. A report counts
//! from its request on, unless a client may have started a program since. Another host's program counts from the next
//! report on.

/// The time since which no motion program runs.
#[derive(Debug, Default)]
pub(super) struct Programs {
    /// The board is a recording, whose answers tell of no program's errors.
    pub(super) is_replay: bool,
    /// All reports since this time say that no motion program runs; CLOCK_MONOTONIC.
    none_since: Option<u64>,
    /// A program may have started at this time.
    started: u64,
}

impl Programs {
    /// The last report, asked for at `asked_ns`, says whether a motion program runs; `None`: no report tells.
    pub(super) fn see(&mut self, told: Option<(bool, u64)>) {
        match told {
            Some((false, asked_ns)) if asked_ns >= self.started => {
                self.none_since.get_or_insert(asked_ns);
            }
            _ => self.none_since = None,
        }
    }

    /// At `now_ns` the daemon has sent a command, or a command has ended, that may have started a program.
    pub(super) fn may_have_started(&mut self, now_ns: u64) {
        (self.none_since, self.started) = (None, now_ns);
    }

    /// Whether no motion program has run since `since_ns`.
    pub(super) fn none_ran(&self, since_ns: u64) -> bool {
        self.none_since.is_some_and(|none_since| none_since <= since_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_program_ran_where_every_report_since_says_so() {
        let mut programs = Programs::default();
        assert!(!programs.none_ran(100), "no report");
        programs.see(Some((false, 100)));
        assert!(programs.none_ran(100) && !programs.none_ran(99));
        programs.see(Some((false, 150)));
        assert!(programs.none_ran(100));
        for runs in [Some((true, 200)), None] {
            programs.see(runs);
            assert!(!programs.none_ran(u64::MAX));
            programs.see(Some((false, 250)));
            assert!(programs.none_ran(250) && !programs.none_ran(200));
        }
        programs.may_have_started(300);
        programs.see(Some((false, 299)));
        assert!(!programs.none_ran(u64::MAX), "the report is older");
        programs.see(Some((false, 300)));
        assert!(programs.none_ran(300));
    }
}
