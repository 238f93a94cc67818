//! Who the board is: asked by ASCII, in the moments when nobody else has a line to send.
//!
//! `TYPE` and `VERSION` name the board; I10, I19, I48, I49 and I59 say what it reports and how often; Ix07, Ix08 and
//! Ix09 give the scale of every motor's raw numbers. What the board does not answer stays unknown, or is taken from
//! the configuration. Asking moves the board's active response port to the DPRAM, so it is done only when there is
//! reason: at start, when the board comes (back) to life, and after a line that may have changed an answer.

use std::fmt::Write;
use std::time::{Duration, Instant};

use crate::daemon::shared::status::Enabling;
use crate::format::Text;
use crate::map::classic;
use crate::protocol::{LINE_MAX, answer};
use crate::segment::Identity;
use crate::segment::identity::first_motors;

/// How long the board may take for one question.
const PATIENCE: Duration = Duration::from_millis(500);
/// How long to wait before asking a silent board again.
const AGAIN: Duration = Duration::from_secs(10);
/// How long to wait after a line that may have changed something: more may follow.
const SETTLE: Duration = Duration::from_millis(200);
/// How long lines that go on changing something can put the questions off.
const LONGEST: Duration = Duration::from_secs(2);

/// What is asked, in order. Each question is one line; each value of its reply is one reply line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Question {
    Type,
    Version,
    Reports,
    /// Ix07, Ix08, Ix09 of one motor after the other.
    Scales,
}

const QUESTIONS: [Question; 4] = [Question::Type, Question::Version, Question::Reports, Question::Scales];

/// Asks, collects, and keeps the last complete answer.
pub struct Identifier {
    configured: Identity,
    /// The question to ask next, or under way; all asked when it is past the end.
    next: usize,
    /// Whether the board has been sent it and owes the reply.
    under_way: bool,
    /// Whether to begin again when the reply has come.
    again: bool,
    /// The first of the changes since the last complete answer.
    changing_since: Option<Instant>,
    /// Changes have gone on for so long that the questions are asked to their end first.
    overdue: bool,
    not_before: Instant,
    asking: Identity,
    /// Lines of the present reply so far.
    lines: usize,
    /// What the last answers said is switched on.
    enabling: Enabling,
    /// The answer to publish, once.
    news: Option<Identity>,
    wanted: bool,
}

impl Identifier {
    /// Starts with what the configuration says; asks the board at the first opportunity if `ask`.
    #[must_use]
    pub fn new(configured: Identity, ask: bool, now: Instant) -> Self {
        Self {
            asking: configured.clone(),
            news: Some(configured.clone()),
            configured,
            next: if ask { 0 } else { QUESTIONS.len() },
            under_way: false,
            again: false,
            changing_since: None,
            overdue: false,
            not_before: now,
            lines: 0,
            enabling: Enabling::default(),
            wanted: ask,
        }
    }

    /// The board may answer differently now: ask again soon. Where that is said again and again, the questions are asked
    /// to their end every few seconds all the same.
    pub fn ask_again(&mut self, now: Instant) {
        if !self.wanted {
            return;
        }
        self.again = true;
        self.enabling = Enabling::default();
        let since = *self.changing_since.get_or_insert(now);
        self.overdue = now >= since + LONGEST;
        if !self.overdue {
            self.not_before = now + SETTLE;
        }
        self.begin_again();
    }

    /// Goes back to the first question, unless the board still owes the reply to another.
    fn begin_again(&mut self) {
        let may_stop_here = !self.overdue || self.next >= QUESTIONS.len();
        if self.again && !self.under_way && may_stop_here {
            self.again = false;
            self.next = 0;
        }
    }

    /// Whether a question has waited so long that other lines wait for it now.
    #[must_use]
    pub fn is_overdue(&self, now: Instant) -> bool {
        self.next < QUESTIONS.len() && now >= self.not_before + LONGEST
    }

    /// The line was not sent after all: it is asked again.
    pub fn not_sent(&mut self) {
        self.under_way = false;
        self.begin_again();
    }

    /// Looks at a line somebody sends: does it change what the board would answer?
    #[must_use]
    pub fn may_be_changed_by(line: &[u8]) -> bool {
        // An I-variable, or a reset or $-address. A jog (J=), P, Q and M come too often to ask four questions after each.
        line.contains(&b'$')
            || line.contains(&b'=') && line.iter().any(|byte| byte.eq_ignore_ascii_case(&b'i'))
    }

    /// How long nothing needs to be asked.
    #[must_use]
    pub fn due_in(&self, now: Instant) -> Duration {
        if self.next < QUESTIONS.len() {
            self.not_before.saturating_duration_since(now)
        } else {
            Duration::MAX
        }
    }

    /// The line to send now, if any, and how long to wait for its reply. Tell with [`Identifier::sent`] if it was.
    pub fn next_line(&mut self, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        let question = *QUESTIONS.get(self.next)?;
        if now < self.not_before {
            return None;
        }
        self.lines = 0;
        if self.next == 0 {
            self.asking = self.configured.clone();
        }
        let mut line = Text::default();
        let fits = match question {
            Question::Type => line.write_str("TYPE"),
            Question::Version => line.write_str("VERSION"),
            Question::Reports => line.write_str("I10 I19 I48 I49 I59 I2 I55"),
            Question::Scales => {
                (1..=classic::MOTORS).try_for_each(|motor| write!(line, "I{motor}07I{motor}08I{motor}09"))
            }
        };
        fits.ok().map(|()| (line, PATIENCE))
    }

    /// The line was sent.
    pub fn sent(&mut self) {
        self.under_way = true;
    }

    /// A line of the reply came.
    pub fn line(&mut self, line: &[u8]) {
        let index = self.lines;
        self.lines += 1;
        let Some(question) = QUESTIONS.get(self.next) else { return };
        let line = line.trim_ascii();
        let text = std::str::from_utf8(line).unwrap_or_default();
        match question {
            Question::Type => self.asking.board_type = Some(Text::from_bytes(line)),
            Question::Version => self.asking.firmware = Some(Text::from_bytes(line)),
            Question::Reports => {
                let value = answer::integer(text).and_then(|value| u32::try_from(value).ok());
                let asking = &mut self.asking;
                match index {
                    0 => {
                        asking.i10 = value;
                        asking.servo_period_ps = value.filter(|&i10| i10 > 0).map(servo_period_ps);
                    }
                    1 => asking.servo_report_cycles = value,
                    2 => asking.servo_report = value,
                    3 => asking.background_report = value,
                    4 => asking.motor_mask = value.map(first_motors),
                    5 if !self.again => self.enabling.panel = value.map(|i2| i2 == 3),
                    6 if !self.again => self.enabling.variables = value.map(|i55| i55 == 1),
                    _ => {}
                }
            }
            Question::Scales => {
                let value = answer::integer(text).and_then(|value| i32::try_from(value).ok());
                let scales = match index % 3 {
                    0 => &mut self.asking.ix07,
                    1 => &mut self.asking.ix08,
                    _ => &mut self.asking.ix09,
                };
                if let Some(scale) = scales.get_mut(index / 3) {
                    *scale = value;
                }
            }
        }
    }

    /// The reply is complete, or the board refused the question (which leaves its answers unknown).
    pub fn done(&mut self) {
        self.under_way = false;
        self.next += 1;
        if self.next == QUESTIONS.len() {
            self.news = Some(self.asking.clone());
            self.changing_since = None;
            self.overdue = false;
        }
        self.begin_again();
    }

    /// The board did not answer.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        self.again = false;
        self.changing_since = None;
        self.overdue = false;
        self.next = 0;
        self.not_before = now + AGAIN;
    }

    /// What is switched on, as far as the board has said since the last line that may have changed it.
    #[must_use]
    pub fn enabling(&self) -> Enabling {
        self.enabling
    }

    /// What has become known since the last call.
    pub fn news(&mut self) -> Option<Identity> {
        self.news.take()
    }
}

/// The servo period in picoseconds that I10 says: I10 / 8388608 ms.
#[must_use]
pub fn servo_period_ps(i10: u32) -> u64 {
    u64::from(i10) * 1_000_000_000 / 8_388_608
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(identifier: &mut Identifier, now: Instant, lines: &[&str]) -> String {
        let (line, _) = identifier.next_line(now).unwrap();
        identifier.sent();
        for line in lines {
            identifier.line(line.as_bytes());
        }
        identifier.done();
        String::from_utf8(line.as_bytes().to_vec()).unwrap()
    }

    #[test]
    fn it_asks_everything_once_and_tells_it_once() {
        let now = Instant::now();
        let mut identifier = Identifier::new(Identity::default(), true, now);
        assert_eq!(identifier.news(), Some(Identity::default()), "what is configured is known at once");
        assert_eq!(answer(&mut identifier, now, &["PMAC1, ISA, FLASH, PID, CLK X1"]), "TYPE");
        answer(&mut identifier, now, &["1.16D"]);
        answer(&mut identifier, now, &["3713707", "I19=1", "1", "1", "$8", "3", "0"]);
        assert_eq!(identifier.enabling(), Enabling { panel: Some(true), variables: Some(false) });
        assert_eq!(identifier.news(), None);
        let scales: Vec<String> = (0..24).map(|index| (90 + index).to_string()).collect();
        let scales: Vec<&str> = scales.iter().map(String::as_str).collect();
        let line = answer(&mut identifier, now, &scales);
        assert!(line.starts_with("I107I108I109I207") && line.len() <= LINE_MAX);
        let identity = identifier.news().unwrap();
        assert_eq!(identity.firmware.as_deref(), Some("1.16D"));
        assert_eq!((identity.servo_report_cycles, identity.reported_motors()), (Some(1), Some(8)));
        assert_eq!(identity.servo_period_ps, Some(442_708_373));
        assert_eq!((identity.ix07[0], identity.ix08[0], identity.ix09[7]), (Some(90), Some(91), Some(113)));
        assert_eq!(identity.ix08[8], None);
        assert!(identifier.next_line(now).is_none());
        assert_eq!(identifier.due_in(now), Duration::MAX);
    }

    #[test]
    fn a_silent_board_is_asked_again_later_and_a_changed_one_soon() {
        let now = Instant::now();
        let mut identifier = Identifier::new(Identity::default(), true, now);
        identifier.next_line(now).unwrap();
        identifier.failed(now);
        assert!(identifier.next_line(now).is_none());
        assert!(identifier.next_line(now + AGAIN).is_some());
        identifier.ask_again(now);
        assert!(identifier.next_line(now + SETTLE).is_some());
        let mut quiet = Identifier::new(Identity::default(), false, now);
        quiet.ask_again(now);
        assert!(quiet.next_line(now + AGAIN).is_none(), "told not to ask");
    }

    #[test]
    fn a_change_in_mid_question_neither_mixes_the_answers_nor_is_forgotten() {
        let now = Instant::now();
        let mut identifier = Identifier::new(Identity::default(), true, now);
        answer(&mut identifier, now, &["PMAC1"]);
        answer(&mut identifier, now, &["1.16D"]);
        identifier.next_line(now).unwrap();
        identifier.sent();
        identifier.ask_again(now);
        for line in ["3713707", "1", "1", "1", "8", "3", "1"] {
            identifier.line(line.as_bytes());
        }
        identifier.done();
        assert_eq!(identifier.enabling(), Enabling::default(), "asked before the change");
        assert_eq!(answer(&mut identifier, now + SETTLE, &["PMAC1"]), "TYPE", "it begins again");
    }

    #[test]
    fn a_stream_of_changes_puts_the_answer_off_but_not_for_ever() {
        let start = Instant::now();
        let mut identifier = Identifier::new(Identity::default(), true, start);
        identifier.news();
        let mut answered_at = None;
        for step in 0..100 {
            let now = start + Duration::from_millis(50 * step);
            identifier.ask_again(now);
            if identifier.next_line(now).is_some() {
                identifier.sent();
                identifier.line(b"1");
                identifier.done();
            }
            if identifier.news().is_some() {
                answered_at.get_or_insert(now - start);
            }
        }
        let answered_at = answered_at.expect("an answer in spite of them");
        assert!((LONGEST..2 * LONGEST).contains(&answered_at), "{answered_at:?}");
        assert!(!identifier.is_overdue(identifier.not_before + SETTLE));
        assert!(identifier.is_overdue(identifier.not_before + LONGEST));
    }

    #[test]
    fn only_lines_that_may_change_an_answer_have_it_asked_again() {
        for line in ["I59=4", "i108=96", "P1=2I19=1", "$$$", "WX$D009,1", "I(P1)=3"] {
            assert!(Identifier::may_be_changed_by(line.as_bytes()), "{line}");
        }
        for line in ["#1J=1000 #2J=-5", "P5=1", "M1=0", "#1J=", "I108", "?"] {
            assert!(!Identifier::may_be_changed_by(line.as_bytes()), "{line}");
        }
    }
}
