//! Who the board is: asked by ASCII, in the moments when nobody else has a line to send.
//!
//! `TYPE` and `VERSION` name the board; I-variables say what it reports and how often (the family knows their numbers); Ix07,
//! Ix08 and Ix09 give the scale of every motor's raw numbers. What the board does not answer stays unknown, or is taken from
//! the configuration. Asking moves the board's active response port to the DPRAM, so it is done only when there is
//! reason: at start, when the board comes (back) to life, and after a line that may have changed an answer. Another host
//! can change answers at any time, so I-variables are asked again every half minute; more often where the daemon reads no
//! report.

mod global_words;
mod questions;

use std::time::{Duration, Instant};

use self::global_words::Comparison;
use self::questions::{Meaning, Question, note_type, questions};
use crate::daemon::bus::change_watch::ChangeWatch;
use crate::daemon::bus::scale_doubts::{ScaleDoubts, scale_tables};
use crate::daemon::shared::status::{CHANGES, Change, Enabling};
use crate::format::Text;
use crate::map::Family;
use crate::protocol::{LINE_MAX, answer};
use crate::segment::Identity;
use crate::segment::identity::first_motors;

/// How long the board may take for one question.
const PATIENCE: Duration = Duration::from_millis(500);
/// How long to wait before asking a silent board again.
const AGAIN: Duration = Duration::from_secs(10);
/// How often to ask for I-variables that another host may have changed.
const RECHECK: Duration = Duration::from_secs(30);
/// How long to wait after a line that may have changed something: more may follow.
const SETTLE: Duration = Duration::from_millis(200);
/// How long lines that go on changing something can put the questions off.
const LONGEST: Duration = Duration::from_secs(2);

/// Asks, collects, and keeps the last complete answer.
pub struct Identifier {
    questions: Vec<(Text<LINE_MAX>, Question)>,
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
    /// What was told last.
    known: Identity,
    /// Scales that lines may have changed since the first question was asked.
    doubts: ScaleDoubts,
    /// Lines of the present reply so far.
    lines: usize,
    /// What the last answers said is switched on.
    enabling: Enabling,
    /// The answer to publish, once.
    update: Option<Identity>,
    wanted: bool,
    /// What somebody else has changed.
    changes: ChangeWatch,
    /// How long until the board is asked again.
    recheck: Duration,
    /// When the last question was due.
    asked: Instant,
    /// Which copy of the global status is which.
    comparison: Option<Comparison>,
}

impl Identifier {
    /// Starts with what the configuration says; asks the board, of `family`, at the first opportunity if `ask`.
    #[must_use]
    pub fn new(family: &'static Family, configured: Identity, ask: bool, now: Instant) -> Self {
        let asked = questions(family).into_iter().filter(|_| ask);
        let questions: Vec<_> =
            asked.map(|question| (Text::from_bytes(question.line().as_bytes()), question)).collect();
        Self {
            questions,
            asking: configured.clone(),
            known: configured.clone(),
            doubts: ScaleDoubts::default(),
            update: Some(configured.clone()),
            configured,
            next: 0,
            under_way: false,
            again: false,
            changing_since: None,
            overdue: false,
            not_before: now,
            lines: 0,
            enabling: Enabling::default(),
            wanted: ask,
            changes: ChangeWatch::default(),
            recheck: RECHECK,
            asked: now,
            comparison: family.servo.global_status.as_ref().filter(|_| ask).map(Comparison::new),
        }
    }

    /// The same for a daemon that reads no report of the board: a dead one would be known by nothing but silence.
    #[must_use]
    pub fn without_reports(mut self) -> Self {
        self.recheck = AGAIN;
        self
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
        self.restart();
    }

    /// The board was reset, or is another one: it answers differently now, and nobody has changed that.
    pub fn begin_anew(&mut self, now: Instant) {
        self.changes.forget();
        if let Some(comparison) = &mut self.comparison {
            comparison.forget();
            self.tell(self.known.clone());
        }
        self.ask_again(now);
    }

    /// Goes back to the first question, unless the board still owes the reply to another.
    fn restart(&mut self) {
        let may_stop_here = !self.overdue || self.next >= self.questions.len();
        if self.again && !self.under_way && may_stop_here {
            self.again = false;
            self.next = 0;
        }
    }

    /// Whether a question has waited so long that other lines wait for it now.
    #[must_use]
    pub fn is_overdue(&self, now: Instant) -> bool {
        self.due().is_some_and(|due| now >= due + LONGEST)
    }

    /// From when on a question is to be asked.
    fn due(&self) -> Option<Instant> {
        let again = self.wanted.then_some(self.asked + self.recheck);
        if self.next < self.questions.len() { Some(self.not_before) } else { again }
    }

    /// The line was not sent after all: it is asked again.
    pub fn not_sent(&mut self) {
        self.under_way = false;
        self.comparison.as_mut().map(Comparison::end);
        self.restart();
    }

    /// Takes note of a line that somebody sends. If the board may answer differently after it, it is asked again soon. A
    /// scale that the line may change is not known from now on: a position in counts by the old one would be wrong.
    pub fn line_sent(&mut self, line: &[u8], now: Instant) {
        let Some(doubts) = ScaleDoubts::of_line(line).filter(|_| self.wanted) else { return };
        self.doubts.add(doubts);
        self.tell(self.known.clone());
        self.ask_again(now);
    }

    /// Tells an answer, as far as it is not in doubt.
    fn tell(&mut self, answer: Identity) {
        let mut answer = self.doubts.leave_out(answer);
        answer.global_words = self.comparison.as_ref().and_then(Comparison::found);
        if answer != self.known {
            self.known = answer.clone();
            self.update = Some(answer);
        }
    }

    /// How long nothing needs to be asked.
    #[must_use]
    pub fn due_in(&self, now: Instant) -> Duration {
        let compares = self.comparison.as_ref().and_then(|comparison| comparison.due(now));
        let compares = compares.map_or(Duration::MAX, |due| due.saturating_duration_since(now));
        let asks = self.due().map_or(Duration::MAX, |due| due.saturating_duration_since(now));
        asks.min(compares)
    }

    /// Takes note of the copies of the global status in the servo report, as they lie; of nothing while none come.
    pub fn see_global_status(&mut self, copies: Option<[u32; 2]>) {
        if let Some(comparison) = &mut self.comparison {
            comparison.see(copies);
        }
    }

    /// The line to send now, if any, and how long to wait for its reply. Tell with [`Identifier::sent`] if it was.
    pub fn next_line(&mut self, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        if let Some(comparison) = &mut self.comparison
            && comparison.due(now) == Some(now)
        {
            comparison.begin(now);
            return Some((Text::from_bytes(global_words::QUESTION), PATIENCE));
        }
        if self.next >= self.questions.len() && self.wanted && now >= self.asked + self.recheck {
            // Who the board is does not change while it lives.
            let is_report = |(_, question): &(_, Question)| matches!(question, Question::Reports(_));
            self.next = self.questions.iter().position(is_report)?;
            self.asking = self.known.clone();
            // Callers' lines go between them as usual.
            self.not_before = now;
        }
        let (line, _) = self.questions.get(self.next)?;
        if now < self.not_before {
            return None;
        }
        self.asked = now;
        self.lines = 0;
        if self.next == 0 {
            self.asking = self.configured.clone();
            self.doubts = ScaleDoubts::default();
        }
        Some((*line, PATIENCE))
    }

    /// A line of somebody's goes to the board.
    pub fn line_goes(&mut self, line: &[u8]) {
        self.changes.line_goes(line);
    }

    /// What somebody else has changed, another host or a program of the board.
    #[must_use]
    pub fn changes(&self) -> [Option<Change>; CHANGES] {
        self.changes.changes()
    }

    /// The line was sent.
    pub fn sent(&mut self) {
        self.under_way = true;
    }

    /// A line of the reply came.
    pub fn line(&mut self, line: &[u8]) {
        if let Some(comparison) = self.comparison.as_mut().filter(|comparison| comparison.is_under_way()) {
            return comparison.answer(line);
        }
        let index = self.lines;
        self.lines += 1;
        let Some((_, question)) = self.questions.get(self.next) else { return };
        let line = line.trim_ascii();
        let value = answer::integer(std::str::from_utf8(line).unwrap_or_default());
        let asking = &mut self.asking;
        match question {
            Question::Type => note_type(asking, line),
            Question::Version => asking.firmware = Some(Text::from_bytes(line)),
            Question::Reports(variables) => {
                let value = value.and_then(|value| u32::try_from(value).ok());
                let Some((number, meaning)) = variables.get(index) else { return };
                if let Some(value) = value {
                    self.changes.told(*number, value, self.asked);
                }
                match meaning {
                    Meaning::ServoPeriod => {
                        asking.i10 = value;
                        asking.servo_period_ps = value.filter(says_period).map(servo_period_ps);
                    }
                    Meaning::ReportCycles => asking.servo_report_cycles = value,
                    Meaning::ServoReport => asking.servo_report = value,
                    Meaning::ServoInBackground if value == Some(1) => {
                        (asking.servo_report, asking.servo_report_cycles) = (value, None);
                    }
                    Meaning::ServoInBackground => {}
                    Meaning::BackgroundReport => asking.background_report = value,
                    Meaning::Reported => asking.motor_mask = value.map(first_motors),
                    // Asked before the last change: it says nothing.
                    Meaning::Panel | Meaning::Variables if self.again => {}
                    Meaning::Panel => self.enabling.panel = value.map(|value| value == 3),
                    Meaning::Variables => {
                        self.enabling.variables = value.map(|value| value == 1);
                        self.enabling.asked = Some(self.asked);
                    }
                    Meaning::Handshake => {}
                }
            }
            Question::Scales(motors) => {
                let tables = scale_tables(asking);
                let motor = motors.start() - 1 + index / tables.len();
                if let Some(scale) = tables[index % tables.len()].get_mut(motor) {
                    *scale = value.and_then(|value| i32::try_from(value).ok());
                }
            }
        }
    }

    /// The reply is complete, or the board refused the question (which leaves its answers unknown).
    pub fn done(&mut self) {
        self.under_way = false;
        if self.comparison.as_mut().is_some_and(Comparison::end) {
            self.tell(self.known.clone());
            return self.restart();
        }
        self.next += 1;
        if self.next == self.questions.len() {
            self.tell(self.asking.clone());
            self.changing_since = None;
            self.overdue = false;
        }
        self.restart();
    }

    /// The board did not answer.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        self.comparison.as_mut().map(Comparison::end);
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
    pub fn take_update(&mut self) -> Option<Identity> {
        self.update.take()
    }
}

/// Whether I10 says the servo period: at its end it stands for any that is longer (Software Reference, I10: 0 to 8388607).
const fn says_period(i10: &u32) -> bool {
    matches!(*i10, 1..8_388_607)
}

/// The servo period in picoseconds that I10 says: I10 / 8388608 ms.
#[must_use]
pub fn servo_period_ps(i10: u32) -> u64 {
    u64::from(i10) * 1_000_000_000 / 8_388_608
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::readings::GlobalWords;
    use crate::map::{FAMILIES, PMAC, TURBO2};

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
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
        assert_eq!(
            identifier.take_update(),
            Some(Identity::default()),
            "what is configured is known at once"
        );
        assert_eq!(answer(&mut identifier, now, &["PMAC1, ISA, FLASH, PID, CLK X1"]), "TYPE");
        answer(&mut identifier, now, &["1.16D"]);
        answer(&mut identifier, now, &["3713707", "I19=1", "1", "1", "$8", "3", "0"]);
        let enabling = Enabling { panel: Some(true), variables: Some(false), asked: Some(now) };
        assert_eq!(identifier.enabling(), enabling);
        assert_eq!(identifier.take_update(), None);
        let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
        let scales: Vec<&str> = scales.iter().map(String::as_str).collect();
        let line = answer(&mut identifier, now, &scales);
        assert!(line.starts_with("I107I108I109I160I207") && line.len() <= LINE_MAX);
        let identity = identifier.take_update().unwrap();
        assert_eq!(identity.firmware.as_deref(), Some("1.16D"));
        assert_eq!((identity.servo_report_cycles, identity.reported_motors()), (Some(1), Some(8)));
        assert_eq!(identity.servo_period_ps, Some(442_708_373));
        assert_eq!((identity.ix07[0], identity.ix08[0], identity.ix09[7]), (Some(90), Some(91), Some(120)));
        assert_eq!(identity.ix08[8], None);
        assert!(identifier.next_line(now).is_none());
        assert_eq!(identifier.due_in(now), RECHECK);
    }

    #[test]
    fn b1_9_what_another_host_changes_is_found_within_half_a_minute() {
        let start = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
        let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
        let mut scales: Vec<&str> = scales.iter().map(String::as_str).collect();
        for lines in [&["PMAC1"][..], &["1.16D"], &["3713707", "1", "1", "1", "8", "3", "1", "2"], &scales] {
            answer(&mut identifier, start, lines);
        }
        let first = identifier.take_update().unwrap();
        let now = start + RECHECK;
        scales[1] = "48";
        let asked = answer(&mut identifier, now, &["3713707", "1", "1", "1", "8", "1", "1", "2"]);
        assert_eq!(asked, "I10 I19 I48 I49 I59 I2 I55 I3", "who it is, is not asked again");
        answer(&mut identifier, now, &scales);
        let change = identifier.changes()[5].unwrap();
        assert_eq!((change.variable, change.was, change.is, change.since), (2, 3, 1, start));
        assert_eq!(identifier.enabling().panel, Some(false));
        let second = identifier.take_update().unwrap();
        assert_eq!((second.ix08[0], second.board_type), (Some(48), first.board_type));
        identifier.line_goes(b"I2=3");
        assert_eq!(identifier.changes()[5], None);
        identifier.begin_anew(now);
        assert!(identifier.changes().iter().all(Option::is_none));
    }

    #[test]
    fn b3_the_global_words_are_compared_as_soon_as_they_come_and_anew_after_a_reset() {
        let start = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
        assert_eq!(answer(&mut identifier, start, &["PMAC1"]), "TYPE", "no copies come yet");
        identifier.see_global_status(Some([1, 0x8000]));
        assert_eq!(answer(&mut identifier, start, &["000001008000"]), "???");
        assert_eq!(identifier.take_update().unwrap().global_words, Some(GlobalWords::XFirst));
        assert_eq!(answer(&mut identifier, start, &["1.16D"]), "VERSION", "it goes on where it was");
        identifier.begin_anew(start);
        assert_eq!(identifier.take_update().unwrap().global_words, None);
        assert_eq!(answer(&mut identifier, start, &["000000000000"]), "???");
        assert_eq!(identifier.take_update(), None, "the reply fits neither way");
        assert_eq!(identifier.next_line(start), None, "it is asked again later");
        let later = start + global_words::AGAIN;
        identifier.see_global_status(None);
        assert_ne!(answer(&mut identifier, later, &[]), "???");
        identifier.see_global_status(Some([0x8000, 1]));
        identifier.next_line(later).unwrap();
        identifier.sent();
        identifier.failed(later);
        assert_eq!(identifier.next_line(later), None);
        assert_eq!(answer(&mut identifier, later + global_words::AGAIN, &["000001008000"]), "???");
        assert_eq!(identifier.take_update().unwrap().global_words, Some(GlobalWords::YFirst));
    }

    #[test]
    fn b1_9_lines_that_always_wait_neither_keep_a_recheck_off_nor_wait_for_all_of_it() {
        let start = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
        for lines in [&["PMAC1"][..], &["1.16D"], &["3713707", "1", "1", "1", "8", "3", "1", "2"], &["96"]] {
            answer(&mut identifier, start, lines);
        }
        assert!(!identifier.is_overdue(start + RECHECK));
        let now = start + RECHECK + LONGEST;
        assert!(identifier.is_overdue(now), "lines wait for it now");
        answer(&mut identifier, now, &["3713707", "1", "1", "1", "8", "3", "1", "2"]);
        assert!(!identifier.is_overdue(now), "lines go before the next question");
        assert!(identifier.is_overdue(now + LONGEST));
    }

    #[test]
    fn every_motors_scales_are_asked_in_lines_that_the_board_takes() {
        for family in FAMILIES {
            let now = Instant::now();
            let mut identifier = Identifier::new(family, Identity::default(), true, now);
            let mut asked = Vec::new();
            while let Some((line, _)) = identifier.next_line(now) {
                assert!(line.len() <= family.ascii.line_limit.min(LINE_MAX), "{line:?}");
                let numbers: Vec<_> =
                    line.split('I').skip(1).map(|number| number.trim().to_owned()).collect();
                identifier.sent();
                for number in &numbers {
                    identifier.line(number.as_bytes());
                }
                if numbers.first().is_some_and(|number| number.ends_with("07")) {
                    asked.extend(numbers);
                }
                identifier.done();
            }
            let all = (1..=family.motors)
                .flat_map(|motor| [7, 8, 9, 60].map(|which| (100 * motor + which).to_string()));
            assert_eq!(asked, all.collect::<Vec<_>>(), "{}", family.name);
            identifier.take_update();
            for motor in 1..=family.motors {
                let scale = |table: &[Option<i32>]| table[motor - 1];
                let asking = &identifier.asking;
                let scales =
                    [&asking.ix07, &asking.ix08, &asking.ix09, &asking.ix60].map(|table| scale(table));
                assert_eq!(scales, [7, 8, 9, 60].map(|which| Some(100 * motor as i32 + which)));
            }
        }
    }

    #[test]
    fn a_family_is_asked_for_the_variables_it_has() {
        let line = |family| questions(family)[2].line();
        assert_eq!(line(&PMAC), "I10 I19 I48 I49 I59 I2 I55 I3");
        // FACTS-TURBO section 3: no I-variable says how many motors are reported, or where the panel is.
        assert_eq!(line(&TURBO2), "I10 I47 I48 I57 I49 I55 I3");
    }

    #[test]
    fn a_silent_board_is_asked_again_later_and_a_changed_one_soon() {
        let now = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
        identifier.next_line(now).unwrap();
        identifier.failed(now);
        assert!(identifier.next_line(now).is_none());
        assert!(identifier.next_line(now + AGAIN).is_some());
        identifier.ask_again(now);
        assert!(identifier.next_line(now + SETTLE).is_some());
        let mut quiet = Identifier::new(&PMAC, Identity::default(), false, now);
        quiet.ask_again(now);
        assert!(quiet.next_line(now + AGAIN).is_none(), "told not to ask");
    }

    #[test]
    fn a_board_without_reports_is_asked_again_and_again() {
        let now = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now).without_reports();
        while identifier.next_line(now).is_some() {
            identifier.sent();
            identifier.done();
        }
        assert_eq!(identifier.due_in(now), AGAIN);
        assert!(identifier.next_line(now + AGAIN).is_some());
        let mut quiet = Identifier::new(&PMAC, Identity::default(), false, now).without_reports();
        assert_eq!((quiet.next_line(now + AGAIN), quiet.due_in(now)), (None, Duration::MAX));
    }

    #[test]
    fn a_change_in_mid_question_neither_mixes_the_answers_nor_is_forgotten() {
        let now = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
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
    fn a_scale_in_doubt_is_unknown_until_the_board_has_told_it_again() {
        let now = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
        let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
        let scales: Vec<&str> = scales.iter().map(String::as_str).collect();
        let all = |identifier: &mut Identifier, now| {
            for lines in [&["PMAC1"][..], &["1.16D"], &["3713707", "1", "1", "1", "8", "3", "1"], &scales] {
                answer(identifier, now, lines);
            }
        };
        all(&mut identifier, now);
        identifier.take_update();
        identifier.line_sent(b"I122=3", now);
        assert_eq!(identifier.take_update(), None, "no scale");
        identifier.line_sent(b"I208=48", now);
        let told = identifier.take_update().unwrap();
        assert_eq!((told.ix08[0], told.ix08[1], told.ix07[1]), (Some(91), None, Some(94)));
        assert_eq!(told.firmware.as_deref(), Some("1.16D"));
        // A further change while the board is asked.
        answer(&mut identifier, now + SETTLE, &["PMAC1"]);
        identifier.line_sent(b"I308=48", now + SETTLE);
        assert_eq!(identifier.take_update().unwrap().ix08[1..3], [None, None]);
        all(&mut identifier, now + 2 * SETTLE);
        assert_eq!(identifier.take_update().unwrap().ix08[1..3], [Some(95), Some(99)]);
    }

    #[test]
    fn a_stream_of_changes_puts_the_answer_off_but_not_for_ever() {
        let start = Instant::now();
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
        identifier.take_update();
        let mut answered_at = None;
        for step in 0..100 {
            let now = start + Duration::from_millis(50 * step);
            identifier.ask_again(now);
            if identifier.next_line(now).is_some() {
                identifier.sent();
                identifier.line(b"1");
                identifier.done();
            }
            if identifier.take_update().is_some() {
                answered_at.get_or_insert(now - start);
            }
        }
        let answered_at = answered_at.expect("an answer in spite of them");
        assert!((LONGEST..2 * LONGEST).contains(&answered_at), "{answered_at:?}");
        assert!(!identifier.is_overdue(identifier.not_before + SETTLE));
        assert!(identifier.is_overdue(identifier.not_before + LONGEST));
    }
}
