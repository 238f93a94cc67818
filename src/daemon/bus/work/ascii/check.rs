//! A probe after an abandoned or [unsettled](super::unsettled) command: the daemon begins no other line before the
//! board has answered the probe.
//!
//! The abandoned command's reply may still come and would pass for the next line's. PMAC answers lines in their order.
//! So the daemon first sends a line whose reply is unmistakable; every reply before it is late, and the daemon drops
//! it.
//!
//! The probe is `I3 I10 I3`: twice the handshake, 0 to 3, around I10, the servo period, a large number. An open program
//! buffer would store that line. While a buffer is or may be open, the probe is `SIZE SIZE`, which the board answers at
//! once ([`open_buffer::QUESTION`]).
//!
//! No other reply may look like the probe's. The values of other lines come close: `I107I108I109I160`, asked for motor
//! after motor, often ends with 0, 96, 96, 96 and 0. So the middle value must be a servo period, and the reply must
//! have these values and no more. We never send a probe whose reply has as many values as the abandoned line's: the
//! rest of that reply may still come. The answer to `^F`, several values in one line, may come in between.
//!
//! The board may answer a probe late, too. So each probe differs from the one before: it asks for I10, or `SIZE`, once
//! more, up to [`CHECK_LINES`] times, and only a reply with exactly as many values is its own. The next probe goes when
//! the board has taken the last one. A new daemon continues the count: the old daemon's probe is still in the command
//! buffer.
//!
//! [`open_buffer::QUESTION`]: crate::daemon::shared::open_buffer::QUESTION

use std::time::{Duration, Instant};

use log::warn;

use super::{AsciiQueue, InFlight, Poll, UnderWay};
use crate::daemon::bus::timing::{CHECK_AGAIN, CHECK_ANSWER};
use crate::daemon::shared::open_buffer::Unsaid;
use crate::daemon::shared::queue::{GivenUp, Text};
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::{CommandState, answer};

/// How many probes the daemon can tell from each other.
const CHECK_LINES: usize = 4;
/// The probes that ask for the handshake. I3 and I10 are the same in every family.
const HANDSHAKE: [&[u8]; CHECK_LINES] =
    [b"I3 I10 I3", b"I3 I10 I10 I3", b"I3 I10 I10 I10 I3", b"I3 I10 I10 I10 I10 I3"];
/// The probes that ask whether a program buffer is open.
const BUFFER: [&[u8]; CHECK_LINES] =
    [b"SIZE SIZE", b"SIZE SIZE SIZE", b"SIZE SIZE SIZE SIZE", b"SIZE SIZE SIZE SIZE SIZE"];
/// Longer than the longest probe.
pub(super) const LINE_MAX: usize = 32;
/// I10 of a servo period of 1.2 µs, which is shorter than any board's.
const LEAST_PERIOD: i64 = 10_000;
/// The most lines of a reply.
pub(super) const REPLY_LINES: usize = CHECK_LINES + 2;
/// After this many probes with unexpected answers the daemon takes it that the board does not answer probes as
/// expected. The board then gets no other line: the daemon could not tell to which line its replies belong. A
/// recording, which may lack these answers, still gets lines.
const CHECK_TRIES: u8 = 3;

/// The probe's question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asks {
    Handshake,
    Buffer,
}

/// The board's answer to a probe, and the probe's number, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct CheckAnswer {
    asks: Asks,
    kind: usize,
    /// I3, or the free memory.
    value: i64,
}

/// The probe's due time, and the board's replies.
#[derive(Debug)]
pub(super) struct Check {
    not_before: Instant,
    /// The last probe: its question, and its number. The count goes on from one doubt to the next.
    asks: Asks,
    kind: usize,
    /// The last values since a reply ended or the board answered `^F`, and the number of lines.
    values: [Option<i64>; REPLY_LINES],
    lines: usize,
    /// A reply ended that belongs to no probe.
    is_answered: bool,
    /// The error of the last such reply.
    error: Option<u16>,
    /// How many probes the board answered unexpectedly.
    tries: u8,
    /// The command that the daemon has given up.
    given_up: Option<GivenUp>,
    /// The board answers probes but marks no end of its replies.
    marks_no_end: bool,
}

impl Check {
    pub(super) const fn new(now: Instant) -> Self {
        Self {
            not_before: now,
            asks: Asks::Handshake,
            kind: CHECK_LINES - 1,
            values: [None; REPLY_LINES],
            lines: 0,
            is_answered: false,
            error: None,
            tries: 0,
            given_up: None,
            marks_no_end: false,
        }
    }

    /// The next probe. The reply to `before` may still come.
    fn next(&self, asks: Asks, before: Option<&[u8]>) -> &'static [u8] {
        let kind = self.next_kind(asks, before);
        match asks {
            Asks::Handshake => HANDSHAKE[kind],
            Asks::Buffer => BUFFER[kind],
        }
    }

    /// The number of the next probe, whose reply has not as many values as `before` has questions such as `P1`. The
    /// daemon knows only the first 60 characters of an abandoned line.
    fn next_kind(&self, asks: Asks, before: Option<&[u8]>) -> usize {
        let is_question = |pair: &&[u8]| pair[0].is_ascii_alphabetic() && pair[1].is_ascii_digit();
        let questions = before.map(|line| line.windows(2).filter(is_question).count());
        let values = match asks {
            Asks::Handshake => 3,
            Asks::Buffer => 2,
        };
        let next = (self.kind + 1) % CHECK_LINES;
        if questions == Some(next + values) { (next + 1) % CHECK_LINES } else { next }
    }

    /// An earlier daemon sent this line last. That daemon may have emptied it by its first byte.
    pub(super) fn follow(&mut self, line: &[u8]) {
        let is_it = |own: &[u8]| line.get(1..) == own.get(1..);
        let kind = (0..CHECK_LINES).find(|kind| is_it(HANDSHAKE[*kind]) || is_it(BUFFER[*kind]));
        self.kind = kind.unwrap_or(self.kind);
    }

    /// The daemon has sent the next probe.
    fn sent(&mut self, asks: Asks, before: Option<&[u8]>) {
        (self.asks, self.kind) = (asks, self.next_kind(asks, before));
        self.is_answered = false;
        self.error = None;
        self.forget_values();
    }

    pub(super) const fn forget_values(&mut self) {
        (self.values, self.lines) = ([None; REPLY_LINES], 0);
    }

    /// A line of a reply came.
    pub(super) fn line(&mut self, text: &[u8]) {
        if text.trim_ascii().contains(&b' ') {
            return self.forget_values();
        }
        self.values.rotate_left(1);
        self.values[REPLY_LINES - 1] = std::str::from_utf8(text).ok().and_then(answer::integer);
        self.lines += 1;
    }

    /// The last values as a reply to a probe, if they are one: to the last probe, or a late reply.
    fn answer(&self) -> Option<CheckAnswer> {
        let value = |back: usize| REPLY_LINES.checked_sub(1 + back).and_then(|index| self.values[index]);
        let last = value(0)?;
        if (0..=3).contains(&last) {
            let period = value(1).filter(|period| *period >= LEAST_PERIOD)?;
            let kind = (1..).take_while(|back| value(*back) == Some(period)).count();
            let is_whole = value(kind + 1) == Some(last) && self.lines == kind + 2;
            return is_whole.then_some(CheckAnswer { asks: Asks::Handshake, kind: kind - 1, value: last });
        }
        // Among other values this reply would not be unmistakable.
        let is_alike = (0..self.lines).all(|back| value(back) == Some(last));
        let kind = self.lines.checked_sub(2).filter(|kind| *kind < CHECK_LINES && is_alike)?;
        Some(CheckAnswer { asks: Asks::Buffer, kind, value: last })
    }

    /// Whether all lines so far may begin the reply to the last probe.
    pub(super) fn may_be_own(&self) -> bool {
        let Some(values) = REPLY_LINES.checked_sub(self.lines).map(|first| &self.values[first..]) else {
            return false;
        };
        let [Some(first), rest @ ..] = values else { return false };
        match self.asks {
            Asks::Buffer => self.lines <= self.kind + 2 && rest.iter().all(|value| value == &Some(*first)),
            Asks::Handshake => {
                let (periods, last) = rest.split_at(rest.len().min(self.kind + 1));
                let is_period = |value: &Option<i64>| *value >= Some(LEAST_PERIOD) && *value == periods[0];
                (0..=3).contains(first)
                    && periods.iter().all(is_period)
                    && [&[][..], &[Some(*first)]].contains(&last)
            }
        }
    }

    /// The board's answer to the last probe, once it is complete.
    pub(super) fn own_answer(&self) -> Option<i64> {
        let own = |answer: &CheckAnswer| (answer.asks, answer.kind) == (self.asks, self.kind);
        self.answer().filter(own).map(|answer| answer.value)
    }

    /// Makes the probe due `now`: nothing else is in doubt.
    pub(super) const fn go_at(&mut self, now: Instant) {
        self.not_before = now;
    }

    /// How long until the probe is due.
    pub(super) fn due_in(&self, now: Instant) -> Duration {
        self.not_before.saturating_duration_since(now)
    }

    /// The daemon has given this command up.
    pub(super) const fn give_up(&mut self, given_up: GivenUp) {
        self.given_up = Some(given_up);
    }

    /// After a reset or `^X` the board works on nothing.
    pub(super) const fn reset(&mut self) {
        self.given_up = None;
    }

    /// Whether the board answers, but marks no end of its replies.
    pub(super) const fn marks_no_end(&self) -> bool {
        self.marks_no_end
    }

    /// Whether the board's answers do not fit the probes, so that the daemon sends no other line.
    pub(super) const fn is_answered_otherwise(&self) -> bool {
        self.tries >= CHECK_TRIES
    }

    /// The abandoned command that holds the port.
    pub(super) const fn given_up(&self) -> Option<GivenUp> {
        self.given_up
    }
}

impl AsciiQueue {
    /// Sends the probe.
    pub(super) fn begin_check(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        let is_closed = self.buffer.is_known(now) && !self.buffer.is_open();
        let asks = if is_closed { Asks::Handshake } else { Asks::Buffer };
        let unsettled = self.unsettled.as_ref().map(|unsettled| unsettled.under_way.command);
        let shown = self.check.given_up.map(|given_up| given_up.by.shown);
        let before = match &unsettled {
            Some(InFlight::Line(line)) => Some(line.line.as_bytes()),
            _ => shown.as_ref().map(Text::as_bytes),
        };
        let line = self.check.next(asks, before);
        if now >= self.check.not_before && self.ports.current_mut().begin_open_ended(bus, line)? {
            self.check.sent(asks, before);
            self.start(InFlight::Check, self.check_deadline(now), poll);
        }
        Ok(())
    }

    /// The probe's deadline: at least that of the unsettled command in front of it.
    fn check_deadline(&self, now: Instant) -> Instant {
        let deadline = now + CHECK_ANSWER;
        self.unsettled.as_ref().map_or(deadline, |unsettled| deadline.max(unsettled.under_way.deadline))
    }

    /// The board has sent something and may send more.
    pub(super) fn see_check(&mut self, now: Instant) {
        let until = self.check_deadline(now);
        if let Some(UnderWay { command: InFlight::Check, deadline, .. }) = &mut self.under_way {
            *deadline = until;
        }
    }

    /// A reply has ended: the probe's, or a late one.
    pub(super) fn end_check(&mut self, result: Result<(), u16>, now: Instant) {
        if self.check.own_answer().is_some() && result.is_err() {
            // The error is a program's, before the end of the reply.
            return self.see_check(now);
        }
        let Some(value) = self.check.own_answer() else {
            self.identifier.late_answer();
            // A late reply to an earlier probe is no wrong answer.
            self.check.is_answered |= self.check.answer().is_none();
            // An <ACK> may follow.
            self.check.error = result.err().or(self.check.error);
            self.check.forget_values();
            return self.see_check(now);
        };
        self.under_way = None;
        self.check.marks_no_end = false;
        self.has_answered(value, now);
    }

    /// Whether the board has not taken the probe in time. The probe stays: the daemon tells the callers, and more
    /// probes would use up those that the daemon can tell apart (`tests/models/ascii.pml`).
    pub(super) fn check_lies(&mut self) -> bool {
        let lies = matches!(self.under_way, Some(UnderWay { command: InFlight::Check, .. }))
            && self.ports.current().line_lies();
        if lies {
            self.state = CommandState::Silent;
        }
        lies
    }

    /// The board did not end the probe's reply in time.
    pub(super) fn fail_check(&mut self, now: Instant) {
        if let Some(value) = self.check.own_answer() {
            // The whole reply came, without its end. The line I3=2, which mends that, must not wait.
            if !std::mem::replace(&mut self.check.marks_no_end, true) {
                warn!(
                    "the board does not mark the end of its replies: each line waits out its time and is told as one that may have been \
                     carried out; send I3=2 (pmacctl send I3=2)"
                );
            }
            self.state = CommandState::Answers;
            return self.has_answered(value, now);
        }
        self.check.not_before = now + CHECK_AGAIN;
        self.check.tries = self.check.tries.saturating_add(u8::from(self.check.is_answered));
        let is_otherwise = self.check.is_answered_otherwise();
        match self.check.asks {
            Asks::Handshake if is_otherwise && self.programs.is_replay => {
                self.state = CommandState::Answers;
                self.end_doubt(now);
            }
            Asks::Buffer if is_otherwise => {
                self.check.tries = 0;
                self.state = CommandState::Answers;
                // The handshake is next, while the daemon believes this.
                self.check.not_before = now;
                self.buffer_unsaid(self.check.error.map_or(Unsaid::Otherwise, Unsaid::Refused), now);
            }
            _ => self.state = CommandState::Silent,
        }
    }

    /// The board has answered the probe. An open buffer allows no other probe, so this answer ends the doubt, too.
    fn has_answered(&mut self, value: i64, now: Instant) {
        if self.check.asks == Asks::Buffer {
            self.buffer.learn(Some(value), now);
        }
        let is_settled = self.buffer.is_open() || self.ports.only_end_in_doubt();
        if self.check.asks == Asks::Handshake || is_settled {
            self.end_doubt(now);
        } else {
            self.ports.current_mut().finish(now);
        }
    }

    fn end_doubt(&mut self, now: Instant) {
        self.check.reset();
        self.check.tries = 0;
        self.ports.end_doubt(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_line_goes_whose_reply_the_line_given_up_may_have() {
        for (given_up, next) in [
            ("I3 I10 I3", "I3 I10 I10 I3"),
            ("p1p2p1", "I3 I10 I10 I3"),
            ("P1P2P2P1", "I3 I10 I3"),
            ("SLOW", "I3 I10 I3"),
        ] {
            let check = Check::new(Instant::now());
            assert_eq!(check.next(Asks::Handshake, Some(given_up.as_bytes())), next.as_bytes(), "{given_up}");
        }
    }

    /// The number that the daemon believes to be the answer to the third probe, after these lines.
    fn answer(lines: &[&str]) -> Option<i64> {
        let mut check = Check::new(Instant::now());
        (0..3).for_each(|_| check.sent(Asks::Handshake, None));
        lines.iter().for_each(|line| check.line(line.as_bytes()));
        check.own_answer()
    }

    #[test]
    fn what_cannot_begin_the_reply_to_our_own_line_is_known_at_once() {
        let may_be = |asks, lines: &[&str]| {
            let mut check = Check::new(Instant::now());
            (0..2).for_each(|_| check.sent(asks, None));
            lines.iter().for_each(|line| check.line(line.as_bytes()));
            check.may_be_own()
        };
        let handshake = ["2", "3713707", "3713707", "2"];
        let buffer = ["31000"; 3];
        for count in 1..=4 {
            assert!(may_be(Asks::Handshake, &handshake[..count]), "{count}");
            assert!(count > 3 || may_be(Asks::Buffer, &buffer[..count]), "{count}");
        }
        for lines in [
            &["4"][..],
            &["X10"],
            &["2", "96"],
            &["2", "3713707", "2"],
            &["2", "3713707", "3713708"],
            &["2", "3713707", "3713707", "3"],
            &["2", "3713707", "3713707", "2", "2"],
            &["0 0 0"],
        ] {
            assert!(!may_be(Asks::Handshake, lines), "{lines:?}");
        }
        for lines in [&["X10"][..], &["5", "6"], &["5"; 4]] {
            assert!(!may_be(Asks::Buffer, lines), "{lines:?}");
        }
    }

    #[test]
    fn the_end_of_a_reply_to_another_question_is_no_answer() {
        let own = ["2", "3713707", "3713707", "3713707", "2"];
        assert_eq!(answer(&own), Some(2));
        let late = ["0 0 0 0 0 0 0 0", "2", "3713707", "3713707", "3713707", "2"];
        assert_eq!(answer(&late), Some(2), "behind the answer to ^F");
        // I107I108I109I160I207I208I209I260: the factory's values.
        assert_eq!(answer(&["0", "96", "96", "96", "0"]), None);
        assert_eq!(answer(&["7", "2", "3713707", "3713707", "3713707", "2"]), None);
    }
}
