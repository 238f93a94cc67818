//! ASCII communication through the DPRAM, the host's half (DPRAM manual p. 27-29, firmware 1.15 and later; Turbo User
//! Manual p. 406). Where the words lie, and how long a line may be, says an [`AsciiPort`].
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | `command_loaded` | sets it when a line lies in the command buffer | clears it when it took the line |
//! | `control_character` | writes a control character | clears it when it took the character |
//! | `command` | writes the line and a NUL | reads it |
//! | `response_control` | writes 0 when it read the response | writes, last, what kind of response lies there |
//! | `response_count` | | writes, but once with the NUL and once without, so the host does not read it |
//! | `response` | reads, up to the NUL; then clears the first word | writes, only while `response_control` is 0 |
//!
//! A line that does not fit the command buffer goes in two parts: the first fills the buffer and has no NUL (the last
//! byte of the buffer is not taken as a character but must not be NUL), the second has one.
//!
//! PMAC programs put texts of their own into the same response buffer. The control word tells them apart, so they are
//! never taken for a reply. A reply that comes after its command was given up cannot be told from the next command's.
//! So the port is held until the board shows that it is free ([`hold`]), and after a control character's reply that a silence has
//! ended until an `<ACK>` that may follow has come (`late_mark`). An error need not be the line's (`error`).
//!
//! The manual lets a reply end with `<ACK>` (p. 28, step 6). With I3=0 there is none: I58=1 makes I3=0 of an I3=1 (p. 27),
//! which is the factory's. A port that was told so ([`DpramPort::set_reply_end`]) ends a reply [`REPLY_END`] after its last
//! line, or after the line was taken.

pub mod control;
mod error;
pub mod hold;
mod late_mark;
mod line_cut;
mod part_answer;
mod response_buffer;
pub mod stop;

use std::time::{Duration, Instant};

use control::Lying;
use hold::Hold;
use late_mark::{Follows, LateMarks};
use line_cut::cut;
use response_buffer::Untold;

use crate::device::{Bus, BusError};
use crate::format::{Text, TextOrder};
use crate::map::functions::{RESPONSE_BYTES, response};
use crate::map::readings::ReplyEnd;
use crate::map::{AsciiPort, errors};

/// How long after a command was given up an acknowledgement may still be its.
const DOUBT: Duration = Duration::from_secs(10);
/// How long an `<ACK>` is waited for that has come every time so far.
const EXPECTED: Duration = Duration::from_secs(1);
/// How long after its last line a control character's reply, which has no end mark, counts as complete.
pub const CONTROL_REPLY_END: Duration = Duration::from_millis(50);
/// How long after its last line, or after the line was taken, a reply without an end mark counts as complete.
pub const REPLY_END: Duration = Duration::from_millis(100);
/// How long a board may take for the first line of a control character's reply.
pub const CONTROL_REPLY_BEGIN: Duration = Duration::from_millis(300);
/// A response line, read from the board into private memory: at most 255 characters, without the NUL (DPRAM manual p. 29).
pub type ResponseText = Text<{ RESPONSE_BYTES - 1 }>;

/// What a poll found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AsciiEvent {
    /// A line of the reply to the command under way.
    Line(ResponseText),
    /// The command under way ended: acknowledged, or refused with an error number.
    Done(Result<(), u16>),
    /// The response to a `CMD"..."` in a PMAC program.
    ProgramResponse(ResponseText),
    /// A `SEND"..."` from a PMAC program.
    ProgramMessage(ResponseText),
    /// A response nobody waits for any more, dropped; the value is its control word.
    Stale(u16),
    /// The command under way ended by this control word, which no manual has: what became of the command is not known.
    Unknown(u16),
    /// An error came while a line was under way: the line's own, which is over then, or a program's. What comes is told as the
    /// line's until another one is begun, or the error is believed ([`DpramPort::believe_error`]).
    Error(u16),
    /// A program's error, of which nobody's command is the cause.
    ProgramError(u16),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nothing under way.
    Idle,
    /// A part of the line is in the buffer, its flag set; `sent` characters have been handed over with it.
    Loaded { sent: usize },
    /// PMAC has the first part, `sent` characters. The second waits for an answer to the first until then; `None`: no more.
    FirstTaken { sent: usize, until: Option<Instant> },
    /// PMAC has the whole line. A silence since `quiet_since` ends the reply; `None`: it ends nothing, as no line of a
    /// reply to an open-ended line has come, or not since its last end.
    Replying { quiet_since: Option<Instant> },
    /// An error came: the line's own, or a program's. In the second case the line's response is still to come.
    Refused,
    /// A control character that has a reply waits in its word, or was taken; a line came last at `quiet_since`.
    ControlReply { taken: bool, answered: bool, quiet_since: Instant },
    /// Something may still come, or be carried out, that belongs to a command given up.
    Held(Hold),
}

/// The host's half of the port: one command line at a time.
pub struct DpramPort {
    words: &'static AsciiPort,
    order: TextOrder,
    state: State,
    /// The line under way, in its first `length` bytes.
    line: Box<[u8]>,
    length: usize,
    /// What was read of the reply and is told at the next polls.
    untold: Untold,
    /// The board was seen to answer before it cleared the command flag.
    answers_early: bool,
    /// Until then an acknowledgement may belong to a command given up, by this host or the one before it.
    doubt_until: Instant,
    /// A command was given up in that time.
    gave_up: bool,
    /// The control character that waits in its word.
    lying: Option<Lying>,
    /// The board was seen to take a control character.
    takes_characters: bool,
    /// A silence is needed before the next line: the board may acknowledge an empty one.
    settles: bool,
    /// How the board shows the end of a reply.
    reply_end: ReplyEnd,
    /// The caller says which reply was the line's.
    open_ended: bool,
    /// Which replies the board marks late.
    late_marks: LateMarks,
    /// Whether the board answers the first part of a line.
    part_answer: Follows,
    /// Another host may have left the first part of a line, without the second; the board was not told yet to forget it.
    half_left: bool,
    /// The stop that goes once more before the next line is begun.
    stop_again: Option<u8>,
    /// How long the board took for its last answer.
    answer_time: Duration,
}

impl DpramPort {
    /// A port in `words`, whose texts are packed in `order`.
    #[must_use]
    pub fn new(words: &'static AsciiPort, order: TextOrder, now: Instant) -> Self {
        Self {
            words,
            order,
            state: State::Idle,
            line: vec![0; words.line_limit].into(),
            length: 0,
            untold: Untold::default(),
            answers_early: false,
            doubt_until: now + DOUBT,
            gave_up: false,
            lying: None,
            takes_characters: false,
            settles: false,
            reply_end: ReplyEnd::Ack,
            open_ended: false,
            late_marks: LateMarks::default(),
            part_answer: Follows::default(),
            half_left: false,
            stop_again: None,
            answer_time: Duration::ZERO,
        }
    }

    /// Begins held: a host that died may have left the board at a line, and the rest of a reply to come.
    pub fn hold(&mut self, now: Instant) {
        self.state = State::Held(Hold::asking(now, self.half_left));
    }

    /// The board has taken `^X`, which "will also clear the control words" (DPRAM manual p. 27), with whatever lies there by then.
    /// It does not say when. So nothing is begun before the board has answered a question and been silent.
    pub fn follow_cancel(&mut self, now: Instant) {
        if self.is_idle() || self.awaits_mark() {
            self.hold(now);
        }
    }

    /// Lets pass what still comes before the next line is begun.
    pub fn settle(&mut self, now: Instant) {
        self.settles = true;
        if self.is_idle() {
            self.rest(now);
        }
    }

    /// Whether a line of ours lies before the board, or it has the first part of one and the second is to follow, as far as was seen.
    #[must_use]
    pub const fn line_lies(&self) -> bool {
        matches!(self.state, State::Loaded { .. } | State::FirstTaken { .. })
    }

    /// How the board shows the end of a reply. A mark that comes is believed in any case.
    pub const fn set_reply_end(&mut self, reply_end: ReplyEnd) {
        self.reply_end = reply_end;
    }

    /// How the end of a reply shows.
    #[must_use]
    pub const fn reply_end(&self) -> ReplyEnd {
        self.reply_end
    }

    /// Withdraws whatever a host, this one or a dead one, left in the port: the command flag, the control character
    /// (a board that was deaf must not act on it later), the response, which is nobody's.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.lying = None;
        bus.write16(self.words.command_loaded.word, 0)?;
        bus.write16(self.words.control_character, 0)?;
        bus.write16(self.words.response_control, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Whether [`DpramPort::begin`] may be called.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        matches!(self.state, State::Idle | State::Refused)
    }

    /// Starts sending `line`. `Ok(false)`: the port is not idle, or the board still holds an earlier line; try later.
    ///
    /// # Errors
    /// When the bus cannot be reached. The line must have passed [`crate::protocol::check_line`]; one that is too long is not sent.
    pub fn begin(&mut self, bus: &mut impl Bus, line: &[u8]) -> Result<bool, BusError> {
        // A flag would tell some boards of the control character, and not of the line.
        let may_begin = self.is_idle() && self.lying.is_none() && self.untold.is_empty();
        if !may_begin || line.len() > self.words.line_limit {
            return Ok(false);
        }
        // A response that is there now is nobody's. A poll takes it first.
        if self.has_response(bus)? || self.is_loaded(bus)? {
            return Ok(false);
        }
        self.line[..line.len()].copy_from_slice(line);
        self.length = line.len();
        self.untold = Untold::default();
        self.open_ended = false;
        self.load(bus, 0)?;
        Ok(true)
    }

    /// As [`DpramPort::begin`], of a line whose reply the caller knows when he sees it: replies come, late ones of other lines first,
    /// until [`DpramPort::finish`].
    ///
    /// # Errors
    /// As [`DpramPort::begin`].
    pub fn begin_open_ended(&mut self, bus: &mut impl Bus, line: &[u8]) -> Result<bool, BusError> {
        let begun = self.begin(bus, line)?;
        self.open_ended = begun;
        Ok(begun)
    }

    /// The reply to an open-ended line has come.
    pub fn finish(&mut self, now: Instant) {
        if self.open_ended {
            self.open_ended = false;
            self.rest(now);
        }
    }

    /// A reply has ended.
    fn end_reply(&mut self, now: Instant) {
        match &mut self.state {
            State::Replying { quiet_since } if self.open_ended => *quiet_since = None,
            State::Loaded { .. } if self.open_ended => {}
            State::Refused => {}
            _ => self.rest(now),
        }
    }

    /// Characters of a line that go in its first part.
    const fn first_part(&self) -> usize {
        self.words.command_bytes - 1
    }

    /// Whether a line in the buffer waits for the board to take it, or the board has not cleared the flag of the last one. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn is_loaded(&self, bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(self.words.command_loaded.is_set(bus.read16(self.words.command_loaded.word)?))
    }

    /// Writes the part of the line that starts at `from`, then raises the flag.
    fn load(&mut self, bus: &mut impl Bus, from: usize) -> Result<(), BusError> {
        let rest = &self.line[from..self.length];
        let first_of_two = rest.len() > self.first_part();
        let part = match first_of_two {
            true => &rest[..cut(rest, self.first_part(), self.words.line_limit)],
            false => rest,
        };
        // Behind the part NUL ends the line; in a first part there must be anything else, and blanks are harmless.
        let (end, fill) = if first_of_two { (self.first_part(), b' ') } else { (part.len(), 0) };
        let byte = |index: usize| part.get(index).copied().unwrap_or(if index <= end { fill } else { 0 });
        for word in 0..=end / 2 {
            let offset = self.words.command.plus_words(word);
            bus.write16(offset, self.order.pack(byte(2 * word), byte(2 * word + 1)))?;
        }
        bus.order_writes();
        bus.write16(self.words.command_loaded.word, self.words.command_loaded.mask)?;
        self.state = State::Loaded { sent: from + part.len() };
        Ok(())
    }

    /// Whether the port reads as all ones: the board's memory is out of reach (its page is not selected, or it has no
    /// power). The control character's word has 8 bits, so nobody writes that. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn is_out_of_reach(&self, bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(bus.read16(self.words.control_character)? == u16::MAX)
    }

    /// The line that was sent last, by whom ever, as far as its text fits: the board leaves it in the command buffer. N/2 reads.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn last_line<const N: usize>(&self, bus: &mut impl Bus) -> Result<Text<N>, BusError> {
        let mut bytes = [0; N];
        for (index, pair) in bytes.chunks_exact_mut(2).enumerate() {
            let word = bus.read16(self.words.command.plus_words(index))?;
            pair.copy_from_slice(&self.order.unpack(word));
        }
        let length = bytes.iter().position(|byte| *byte == 0).unwrap_or(N);
        Ok(Text::cut(&bytes[..length]))
    }

    /// Whether a response is in its buffer. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn has_response(&self, bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(bus.read16(self.words.response_control)? != 0)
    }

    /// Takes back the command under way if the board has taken nothing of it, so that it can go another way; the port
    /// is idle then. `Ok(false)`: the board has taken some of it, or nothing is under way.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_back(&mut self, bus: &mut impl Bus, now: Instant) -> Result<bool, BusError> {
        let word = match self.state {
            State::Loaded { sent } if sent <= self.first_part() => self.words.command_loaded.word,
            State::ControlReply { taken: false, .. } => self.words.control_character,
            _ => return Ok(false),
        };
        let lying = bus.read16(word)?;
        if lying == 0 || lying == u16::MAX {
            return Ok(false);
        }
        match self.state {
            State::Loaded { .. } => self.withdraw_line(bus)?,
            _ => self.withdraw_control(bus)?,
        }
        self.rest(now);
        Ok(true)
    }

    /// Clears the flag of a line.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    fn withdraw_line(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(self.words.command_loaded.word, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Whether the board has taken the whole command under way, as far as polls have seen.
    #[must_use]
    pub fn was_taken(&self) -> bool {
        matches!(self.state, State::Replying { .. } | State::ControlReply { taken: true, .. })
    }

    /// Gives up on the command under way: the port is held until the board shows that it is free. Whether the board has done
    /// it, does it still or will do it is not known. A line stays where it lies until [`hold`] takes it back: its flag tells
    /// when the board is done with it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn give_up(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        let cancels = match self.state {
            State::Held(_) | State::Idle => return Ok(()),
            // The board may hold its first part, before which it would put the next line.
            State::Loaded { .. } => self.length > self.first_part(),
            State::FirstTaken { .. } => true,
            State::ControlReply { taken: false, .. } => {
                self.withdraw_control(bus)?;
                false
            }
            State::Replying { .. } | State::Refused | State::ControlReply { .. } => false,
        };
        self.abandon(now, cancels);
        Ok(())
    }

    /// Whatever still comes belongs to nobody.
    fn abandon(&mut self, now: Instant, cancels: bool) {
        self.untold = Untold::default();
        self.open_ended = false;
        self.doubt_until = now + DOUBT;
        self.gave_up = true;
        self.state = State::Held(Hold::asking(now, cancels));
    }

    /// Does what can be done now and tells what was found; `None` when there is nothing (more) to find.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<AsciiEvent>, BusError> {
        if let Some(event) = self.tell(now) {
            return Ok(Some(event));
        }
        if let State::Loaded { sent } = self.state
            && !self.is_loaded(bus)?
        {
            if sent < self.length {
                self.first_part_taken(sent, now);
            } else {
                self.state = State::Replying { quiet_since: (!self.open_ended).then_some(now) };
            }
        }
        if let State::ControlReply { taken: false, .. } = self.state
            && !self.control_pending(bus, now)?
        {
            self.state = State::ControlReply { taken: true, answered: false, quiet_since: now };
        }
        let mut control = bus.read16(self.words.response_control)?;
        if control == 0 && self.second_part_is_due(now) {
            self.go_on_with_line(bus)?;
            control = bus.read16(self.words.response_control)?;
        }
        if control == 0 {
            return self.nothing_came(bus, now);
        }
        bus.order_reads();
        let text = self.read_response(bus, control)?;
        bus.order_reads();
        self.look_again_for_first_part(bus, now)?;
        let is_early = control != response::LINE && self.precedes_its_character(bus, now)?;
        let error_of_program = self.error_of_program(bus, control, is_early)?;
        let stale = is_early || self.is_stale(bus, control, &text, now)?;
        if stale {
            self.late_marks.came();
        }
        self.take_response(bus, control, &text)?;
        if let (response::TO_PROGRAM | response::MESSAGE, State::Held(hold)) = (control, &mut self.state) {
            // The text kept the board from putting out what is still to come of the command given up.
            hold.text_came(now);
        }
        if let Some(number) = error_of_program {
            return Ok(Some(AsciiEvent::ProgramError(number)));
        }
        Ok(Some(match control {
            response::TO_PROGRAM => AsciiEvent::ProgramResponse(text),
            response::MESSAGE => AsciiEvent::ProgramMessage(text),
            _ if stale => AsciiEvent::Stale(control),
            _ => self.classify(control, text, now),
        }))
    }

    /// Whether a response that came while the line was still in the buffer belongs to an earlier command.
    ///
    /// The manual has the board clear the flag when it "has processed" the line; whether its answer can come before
    /// that is not said. A board that was seen to answer so early is believed. Otherwise an acknowledgement without
    /// text is doubted for a while after a command was given up, and after the start, when an earlier host may have
    /// left one under way.
    fn is_stale(
        &mut self,
        bus: &mut impl Bus,
        control: u16,
        text: &ResponseText,
        now: Instant,
    ) -> Result<bool, BusError> {
        let State::Loaded { sent } = self.state else { return Ok(false) };
        let is_mark = control == response::ACKNOWLEDGE && text.as_bytes().is_empty();
        if sent < self.length {
            // The board has not all of the line: this is no end of its reply.
            return Ok(is_mark);
        }
        // Of an open-ended line the caller tells its reply from others.
        if self.open_ended || self.answers_early || !self.is_loaded(bus)? {
            return Ok(false);
        }
        if sent == self.length && sent > self.first_part() {
            // The board has not taken the second part: it is the first one's.
            if is_mark {
                self.first_part_was_answered();
            }
            return Ok(is_mark);
        }
        let doubtful = now < self.doubt_until;
        if control == response::LINE && !self.gave_up {
            self.answers_early = true;
        }
        self.gave_up &= doubtful;
        Ok(doubtful && is_mark)
    }

    /// The response buffer is empty: a silence may be what the state waits for.
    fn nothing_came(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<AsciiEvent>, BusError> {
        Ok(match self.state {
            State::Held(hold) => {
                self.go_on_holding(bus, hold, now)?;
                None
            }
            State::Replying { quiet_since: Some(since) }
                if self.reply_end == ReplyEnd::Silence && now >= since + REPLY_END =>
            {
                self.end_reply(now);
                Some(AsciiEvent::Done(Ok(())))
            }
            State::ControlReply { taken: true, answered, quiet_since }
                if now.duration_since(quiet_since)
                    >= if answered { CONTROL_REPLY_END } else { CONTROL_REPLY_BEGIN } =>
            {
                // Should more come after all, it is not the next command's.
                self.await_mark(now);
                Some(AsciiEvent::Done(Ok(())))
            }
            _ => None,
        })
    }

    /// The next of what was read before.
    fn tell(&mut self, now: Instant) -> Option<AsciiEvent> {
        let event = self.untold.next();
        if let Some(AsciiEvent::Done(_)) = event {
            self.end_reply(now);
        }
        event
    }

    /// Whose a response is that is not a program's.
    fn classify(&mut self, control: u16, text: ResponseText, now: Instant) -> AsciiEvent {
        match &mut self.state {
            State::Loaded { .. } | State::Refused => {}
            State::FirstTaken { .. } => return self.answer_to_first_part(control, text, now),
            State::Replying { quiet_since } => {
                if let Some(since) = quiet_since.replace(now).filter(|_| control & response::ERROR == 0) {
                    self.answer_time = now.duration_since(since);
                }
            }
            State::ControlReply { answered, quiet_since, .. } => {
                *answered = true;
                *quiet_since = now;
            }
            State::Held(hold) => {
                hold.response_came(now);
                if control == response::ACKNOWLEDGE {
                    self.mark_came(now);
                }
                return AsciiEvent::Stale(control);
            }
            State::Idle => {
                if control == response::ACKNOWLEDGE {
                    self.late_marks.came();
                }
                return AsciiEvent::Stale(control);
            }
        }
        let has_text = !text.as_bytes().is_empty();
        match control {
            // Some firmware marks the last line itself instead of sending an `<ACK>` alone.
            response::LINE | response::ACKNOWLEDGE if has_text || control == response::LINE => {
                self.untold = Untold::new(text, control == response::ACKNOWLEDGE);
                self.tell(now).unwrap_or(AsciiEvent::Line(text))
            }
            response::ACKNOWLEDGE => {
                self.end_reply(now);
                AsciiEvent::Done(Ok(()))
            }
            _ => match errors::from_control(control) {
                Some(number) => self.end_with_error(number, now),
                // Nothing is there.
                None if control == u16::MAX => AsciiEvent::Stale(control),
                None => {
                    self.abandon(now, false);
                    AsciiEvent::Unknown(control)
                }
            },
        }
    }
}

#[cfg(test)]
#[path = "ascii_tests.rs"]
mod tests;
