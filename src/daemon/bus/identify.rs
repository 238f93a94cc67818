//! Asks the board for its identity by ASCII lines, in moments when no client has a line to send.
//!
//! `TYPE` and `VERSION` name the board; I-variables tell its reports and how often they come (the family knows their
//! numbers); Ix07, Ix08 and Ix09 give the scale of every motor's raw numbers. A value that the board does not answer
//! stays unknown, or comes from the configuration. A question moves the board's active response port to the DPRAM, so
//! the daemon asks only with reason: at start, when the board comes (back) to life, and after a line that may have
//! changed an answer. Another host can change answers at any time, so the daemon asks the I-variables again every half
//! minute; more often where it reads no report.

mod questions;

use std::time::{Duration, Instant};

use self::questions::{ERROR_REPORT, PLC_CONTROL, Question, Tells, note_type, questions};
use crate::daemon::bus::change_watch::ChangeWatch;
use crate::daemon::bus::scale_doubts::{ScaleDoubts, scale_tables};
use crate::daemon::bus::timing::{
    IDENTITY_AFTER_LINE, IDENTITY_AGAIN, IDENTITY_ANSWER, IDENTITY_ANSWER_AT_MOST, IDENTITY_PUT_OFF_AT_MOST,
    IDENTITY_RECHECK,
};
use crate::daemon::shared::status::{CHANGES, Change, Enabling};
use crate::format::Text;
use crate::language::{LINE_MAX, Meaning};
use crate::map::Family;
use crate::protocol::answer;
use crate::segment::Identity;
use crate::segment::identity::first_motors;

/// Asks, collects, and keeps the last complete answer.
pub struct Identifier {
    questions: Vec<(Text<LINE_MAX>, Question)>,
    configured: Identity,
    /// The question to ask next, or under way; all asked when it is past the end.
    next: usize,
    /// Whether the daemon has sent the question and the board owes the reply.
    under_way: bool,
    /// Whether to begin again when the reply has come.
    again: bool,
    /// When the first change since the last complete answer came.
    changing_since: Option<Instant>,
    /// Changes have gone on for so long that the daemon first asks the questions to their end.
    overdue: bool,
    not_before: Instant,
    asking: Identity,
    /// The identity that the daemon told last.
    known: Identity,
    /// Scales that lines may have changed since the first question.
    doubts: ScaleDoubts,
    /// Lines of the present reply so far.
    lines: usize,
    /// The functions switched on, by the last answers.
    enabling: Enabling,
    /// The answer to publish, once.
    update: Option<Identity>,
    wanted: bool,
    /// Changes by other hosts and by programs of the board.
    changes: ChangeWatch,
    /// How long until the daemon asks the board again.
    recheck: Duration,
    /// How long the board may take to begin its answer.
    patience: Duration,
    /// The board did not answer the last question in time, and no answer has come since.
    has_failed: bool,
    /// When the last question was due.
    asked: Instant,
    /// The servo report has no period, but the board does not make it in the background either: as last told, and as
    /// this round says.
    on_request: bool,
    asking_on_request: bool,
    /// I5 and I6, if the board has told them since the last line that may have set them: as last told, and as this
    /// round says.
    program_reports: [Option<u32>; 2],
    asking_program_reports: [Option<u32>; 2],
}

impl Identifier {
    /// Starts with the identity in the configuration; if `ask`, asks the board, of `family`, at the first opportunity.
    #[must_use]
    pub fn new(family: &'static Family, configured: Identity, ask: bool, now: Instant) -> Self {
        let asked = questions(family).into_iter().filter(|_| ask);
        Self {
            questions: asked.map(with_line).collect(),
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
            changes: ChangeWatch::new(family),
            recheck: IDENTITY_RECHECK,
            patience: IDENTITY_ANSWER,
            has_failed: false,
            asked: now,
            on_request: false,
            asking_on_request: false,
            program_reports: [None; 2],
            asking_program_reports: [None; 2],
        }
    }

    /// For a daemon that reads no report of the board: only silence would reveal a dead board.
    #[must_use]
    pub fn without_reports(mut self) -> Self {
        self.recheck = IDENTITY_AGAIN;
        self
    }

    /// The board may answer differently now: asks again soon. Under constant calls the daemon still asks the questions
    /// to their end every few seconds.
    pub fn ask_again(&mut self, now: Instant) {
        if !self.wanted {
            return;
        }
        self.again = true;
        self.enabling = Enabling::default();
        let since = *self.changing_since.get_or_insert(now);
        self.overdue = now >= since + IDENTITY_PUT_OFF_AT_MOST;
        if !self.overdue {
            self.not_before = now + IDENTITY_AFTER_LINE;
        }
        self.restart();
    }

    /// The board was reset or replaced: its answers may differ now, without a change by another host.
    pub fn begin_anew(&mut self, now: Instant) {
        self.changes.forget();
        (self.program_reports, self.asking_program_reports) = ([None; 2], [None; 2]);
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

    /// Whether a question has waited for so long, also since the last question, that other lines now wait for it.
    #[must_use]
    pub fn is_overdue(&self, now: Instant) -> bool {
        self.due().is_some_and(|due| now >= due.max(self.asked) + IDENTITY_PUT_OFF_AT_MOST)
    }

    /// When the next question is due.
    fn due(&self) -> Option<Instant> {
        let again = self.wanted.then_some(self.asked + self.recheck);
        if self.next < self.questions.len() { Some(self.not_before) } else { again }
    }

    /// The daemon did not send the line after all, and asks again.
    pub fn not_sent(&mut self) {
        self.under_way = false;
        self.restart();
    }

    /// Tells the parts of an answer that are not in doubt.
    fn tell(&mut self, answer: Identity) {
        let answer = self.doubts.leave_out(answer);
        if answer != self.known {
            self.known = answer.clone();
            self.update = Some(answer);
        }
    }

    /// How long until the next question is due.
    #[must_use]
    pub fn due_in(&self, now: Instant) -> Duration {
        self.due().map_or(Duration::MAX, |due| due.saturating_duration_since(now))
    }

    /// The line to send now, if any, and how long to wait for its reply. A line asks for only so many scales that the
    /// reply has at most `most_lines`, if one motor's scales fit in. The caller reports the sent line by
    /// [`Identifier::sent`].
    pub fn next_line(&mut self, most_lines: u16, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        if self.next >= self.questions.len() && self.wanted && now >= self.asked + self.recheck {
            // The board's type and version do not change while it lives.
            let is_report = |(_, question): &(_, Question)| matches!(question, Question::Reports(_));
            self.next = self.questions.iter().position(is_report)?;
            self.asking = self.known.clone();
            self.asking_program_reports = [None; 2];
            // Clients' lines go between the questions as usual.
            self.not_before = now;
        }
        if now < self.not_before {
            return None;
        }
        while self.questions.get(self.next)?.1.values() > usize::from(most_lines) && self.halve() {}
        let (line, _) = self.questions.get(self.next)?;
        self.asked = now;
        self.lines = 0;
        if self.next == 0 {
            self.asking = self.configured.clone();
            self.asking_program_reports = [None; 2];
            self.doubts = ScaleDoubts::default();
        }
        Some((*line, self.patience))
    }

    /// A client's line goes to the board. If the board may answer differently after it, the daemon asks again soon. A
    /// scale that the line may change is unknown from now on: a position in counts by the old scale would be wrong.
    pub fn line_goes(&mut self, line: &Meaning, now: Instant) {
        self.changes.line_goes(line);
        let may_set = |variable: u16| line.resets || line.settings.may_have(variable);
        for told in [&mut self.program_reports, &mut self.asking_program_reports] {
            for (told, variable) in told.iter_mut().zip([PLC_CONTROL, ERROR_REPORT]) {
                *told = told.filter(|_| !may_set(variable));
            }
        }
        if let Some(doubts) = ScaleDoubts::of(line).filter(|_| self.wanted) {
            self.doubts.add(doubts);
            self.tell(self.known.clone());
            self.ask_again(now);
        }
    }

    /// I5 and I6, if the board has told them since the last line that may have set them.
    #[must_use]
    pub const fn program_reports(&self) -> [Option<u32>; 2] {
        self.program_reports
    }

    /// The changes by another host or a program of the board.
    #[must_use]
    pub fn changes(&self) -> [Option<Change>; CHANGES] {
        self.changes.changes()
    }

    /// The daemon has sent the line.
    pub fn sent(&mut self) {
        self.under_way = true;
    }

    /// A line of the reply came.
    pub fn line(&mut self, line: &[u8]) {
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
                let is_watched = !matches!(meaning, Tells::PlcControl | Tells::ErrorReport);
                if let Some(value) = value.filter(|_| is_watched) {
                    self.changes.told(*number, value, self.asked);
                }
                match meaning {
                    Tells::ServoPeriod => {
                        asking.i10 = value;
                        asking.servo_period_ps = value.filter(says_period).map(servo_period_ps);
                    }
                    Tells::ReportCycles => asking.servo_report_cycles = value,
                    Tells::ServoReport => asking.servo_report = value,
                    Tells::ServoInBackground if value == Some(1) => {
                        (asking.servo_report, asking.servo_report_cycles) = (value, Some(0));
                        self.asking_on_request = false;
                    }
                    Tells::ServoInBackground => {
                        self.asking_on_request = value == Some(0) && asking.servo_report_cycles == Some(0);
                    }
                    Tells::BackgroundReport => asking.background_report = value,
                    Tells::Reported => asking.motor_mask = value.map(first_motors),
                    // The answer dates from before the last change, and says nothing.
                    Tells::Panel | Tells::Variables if self.again => {}
                    Tells::Panel => self.enabling.panel = value.map(|value| value == 3),
                    Tells::Variables => {
                        self.enabling.variables = value.map(|value| value == 1);
                        self.enabling.asked = Some(self.asked);
                    }
                    Tells::PlcControl => self.asking_program_reports[0] = value,
                    Tells::ErrorReport => self.asking_program_reports[1] = value,
                    Tells::Handshake => {}
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
        self.has_failed = false;
        self.next += 1;
        if self.next == self.questions.len() {
            self.on_request = self.asking_on_request;
            self.program_reports = self.asking_program_reports;
            self.tell(self.asking.clone());
            self.changing_since = None;
            self.overdue = false;
        }
        self.restart();
    }

    /// The board did not answer completely in time: the daemon asks for fewer scales at a time.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        self.halve();
        self.has_failed = true;
        self.again = false;
        self.changing_since = None;
        self.overdue = false;
        self.next = 0;
        self.not_before = now + IDENTITY_AGAIN;
    }

    /// Splits the present question in two, if possible.
    fn halve(&mut self) -> bool {
        let halves = self.questions.get(self.next).and_then(|(_, question)| question.halves());
        let Some(halves) = halves else { return false };
        self.questions.splice(self.next..=self.next, halves.map(with_line));
        true
    }

    /// An answer came that belongs to no question under way. If it is the answer that was late, the daemon gives the
    /// board more time from now on.
    pub fn late_answer(&mut self) {
        if std::mem::take(&mut self.has_failed) {
            self.patience = (2 * self.patience).min(IDENTITY_ANSWER_AT_MOST);
        }
    }

    /// The functions switched on, as far as the board has told since the last line that may have changed them.
    #[must_use]
    pub fn enabling(&self) -> Enabling {
        self.enabling
    }

    /// Whether the board makes each servo report once the host has taken the last, as far as the board has told.
    #[must_use]
    pub fn on_request(&self) -> bool {
        self.on_request
    }

    /// The identity learnt since the last call.
    pub fn take_update(&mut self) -> Option<Identity> {
        self.update.take()
    }
}

/// A question and the line that asks it.
fn with_line(question: Question) -> (Text<LINE_MAX>, Question) {
    (Text::from_bytes(question.line().as_bytes()), question)
}

/// Whether I10 tells the servo period: the highest value stands for any longer period (Software Reference, I10: 0 to
/// 8388607).
const fn says_period(i10: &u32) -> bool {
    matches!(*i10, 1..8_388_607)
}

/// The servo period in picoseconds by I10: I10 / 8388608 ms.
#[must_use]
pub fn servo_period_ps(i10: u32) -> u64 {
    u64::from(i10) * 1_000_000_000 / 8_388_608
}

#[cfg(test)]
mod tests;
