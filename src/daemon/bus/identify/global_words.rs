//! Which of the two copies of the global status in a report is which word of `???`.
//!
//! The DPRAM manual (p. 15) has $D00A copy Y:$0003 and calls it the first word of the reply; the Software Reference says that the
//! first one is X:$0003. Under the other reading "a program buffer is open" would be read out of a word that has other bits
//! there. So the board's own reply is compared with the copies: those from before the question and from after the reply have
//! to say the same. A reply that fits both ways says nothing, and one that fits neither was made while something changed. On Turbo
//! boards the background report has the copies (FACTS-TURBO 5: which is which is likely, not sure).

use std::time::{Duration, Instant};

use crate::map::functions::GlobalStatus;
use crate::map::readings::GlobalWords;
use crate::map::status::parse_reply;

/// The question.
pub(super) const QUESTION: &[u8] = b"???";
/// How soon the board is asked again, while nothing has told the two copies apart.
pub(super) const AGAIN: Duration = Duration::from_secs(2);
/// How soon otherwise: another board may stand there by then.
const RECHECK: Duration = Duration::from_secs(30);

/// The comparison, and what it has found.
#[derive(Debug)]
pub(super) struct Comparison {
    status: &'static GlobalStatus,
    /// The copies in the last report, as they lie.
    copies: Option<[u32; 2]>,
    /// Those when the question was sent, which waits for its reply.
    before: Option<[u32; 2]>,
    found: Option<GlobalWords>,
    asked: Option<Instant>,
}

impl Comparison {
    pub(super) const fn new(status: &'static GlobalStatus) -> Self {
        Self { status, copies: None, before: None, found: None, asked: None }
    }

    /// What the board has told, if it has.
    pub(super) const fn found(&self) -> Option<GlobalWords> {
        self.found
    }

    /// When the board is to be asked, as `now` is the earliest; never while no copies come.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        let pause = if self.found.is_some() { RECHECK } else { AGAIN };
        self.copies.map(|_| self.asked.map_or(now, |asked| now.max(asked + pause)))
    }

    /// Nothing is known of the board any more.
    pub(super) const fn forget(&mut self) {
        (self.before, self.found, self.asked) = (None, None, None);
    }

    /// Takes note of the copies in the last report.
    pub(super) const fn see(&mut self, copies: Option<[u32; 2]>) {
        self.copies = copies;
    }

    /// The question goes to the board.
    pub(super) const fn begin(&mut self, now: Instant) {
        (self.before, self.asked) = (self.copies, Some(now));
    }

    /// Whether the board owes the reply.
    pub(super) const fn is_under_way(&self) -> bool {
        self.before.is_some()
    }

    /// The reply has ended, or does not come; whether it was owed.
    pub(super) const fn end(&mut self) -> bool {
        self.before.take().is_some()
    }

    /// Takes a line of the board's reply. What contradicts an earlier one leaves nothing known: it is asked again.
    pub(super) fn answer(&mut self, reply: &[u8]) {
        let (Some(before), Some(after)) = (self.before, self.copies) else { return };
        let Some(told) = std::str::from_utf8(reply).ok().and_then(parse_reply) else { return };
        let fitting = self.fitting(before, told).filter(|words| self.fitting(after, told) == Some(*words));
        if let Some(words) = fitting {
            self.found = Some(words).filter(|_| self.found.is_none_or(|found| found == words));
        }
    }

    /// The only way in which the copies fit the reply.
    fn fitting(&self, copies: [u32; 2], told: [u32; 2]) -> Option<GlobalWords> {
        let steady = self.status.steady;
        let fits = |words: &GlobalWords| {
            let differ = words.in_order(copies).into_iter().zip(told).zip(steady);
            differ.into_iter().all(|((copy, word), steady)| (copy ^ word) & steady == 0)
        };
        let mut fitting = [GlobalWords::YFirst, GlobalWords::XFirst].into_iter().filter(fits);
        fitting.next().filter(|_| fitting.next().is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    fn comparison() -> Comparison {
        Comparison::new(PMAC.servo.global_status.as_ref().unwrap())
    }

    /// What a reply tells between the copies before and after it.
    fn told(before: [u32; 2], reply: &str, after: [u32; 2]) -> Option<GlobalWords> {
        let mut comparison = comparison();
        comparison.see(Some(before));
        comparison.begin(Instant::now());
        comparison.see(Some(after));
        comparison.answer(reply.as_bytes());
        comparison.found()
    }

    #[test]
    fn b3_the_reply_says_which_copy_is_which() {
        use GlobalWords::{XFirst, YFirst};
        let (first, second) = (0x00_0003, 0x40_8000);
        let reply = "000003408000";
        assert_eq!(told([second, first], reply, [second, first]), Some(YFirst));
        assert_eq!(told([first, second], reply, [first, second]), Some(XFirst));
        // What comes and goes by itself says nothing: the interrupts, internal bits.
        assert_eq!(
            told([second | 0x3005, first | 0xA0_0000], reply, [second | 1, first | 0x200]),
            Some(YFirst)
        );
        for (before, reply, after) in [
            ([second, first], "408000408000", [second, first]),
            ([0, 0], "000000000000", [0, 0]),
            ([second, first | 1 << 19], reply, [second, first]),
            ([second, first], reply, [second | 1 << 18, first]),
            ([second, first], "ERR003", [second, first]),
            ([second, first], "no, not this", [second, first]),
        ] {
            assert_eq!(told(before, reply, after), None, "{before:06X?} {reply} {after:06X?}");
        }
    }

    #[test]
    fn b3_a_reply_that_contradicts_leaves_nothing_known() {
        let mut comparison = comparison();
        let now = Instant::now();
        assert_eq!(comparison.due(now), None, "no copies come");
        for (copies, found) in [
            ([0x8000, 3], Some(GlobalWords::YFirst)),
            ([3, 0x8000], None),
            ([3, 0x8000], Some(GlobalWords::XFirst)),
        ] {
            comparison.see(Some(copies));
            comparison.begin(now);
            comparison.answer(b"000003008000");
            assert!(comparison.end() && !comparison.end());
            assert_eq!(comparison.found(), found);
            let pause = if found.is_some() { RECHECK } else { AGAIN };
            assert_eq!(comparison.due(now), Some(now + pause));
        }
        comparison.forget();
        assert_eq!((comparison.found(), comparison.due(now)), (None, Some(now)));
    }
}
