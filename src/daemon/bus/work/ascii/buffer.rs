//! Whether a program buffer is open: a report of the board tells, or the daemon asks the board before a line that might
//! enter the buffer.
//!
//! Only clients' lines and the daemon's own questions wait for the answer. Control characters and lines that store
//! nothing do not wait.

use std::time::{Duration, Instant};

use log::warn;

use super::{AsciiQueue, InFlight, Poll, WaitingLine};
use crate::daemon::bus::timing::{BUFFER_AGAIN, BUFFER_ANSWER};
use crate::daemon::shared::open_buffer::{QUESTION, Unsaid};
use crate::daemon::shared::queue::{LINE_MAX, Outcome, Text};
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::answer;

/// The question, and its answer.
#[derive(Debug)]
pub(super) struct BufferQuestion {
    not_before: Instant,
    /// The number that the board has answered, to this question or to the question for the address.
    number: Option<i64>,
}

impl BufferQuestion {
    pub(super) const fn new(now: Instant) -> Self {
        Self { not_before: now, number: None }
    }

    /// A line of the reply came.
    pub(super) fn line(&mut self, text: &[u8]) {
        self.number = std::str::from_utf8(text).ok().and_then(answer::integer);
    }
}

impl AsciiQueue {
    /// Takes in a report's word and number about program buffers, which others may open too; `None` while no report
    /// comes.
    pub fn see_buffer(&mut self, told: Option<(bool, u64)>) {
        match told {
            Some((open, report)) => self.buffer.see(open, report),
            None => self.buffer.unsee(),
        }
    }

    /// Asks the board.
    pub(super) fn ask_buffer(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if self.ports.current_mut().begin(bus, QUESTION)? {
            self.buffer_question.number = None;
            self.start(InFlight::Buffer, now + BUFFER_ANSWER, poll);
        }
        Ok(())
    }

    /// Asks the board which coordinate system it addresses, before a sender other than the rotary buffers' opener
    /// addresses another system.
    pub(super) fn ask_address(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if self.ports.current_mut().begin(bus, b"&")? {
            self.buffer_question.number = None;
            self.start(InFlight::Address, now + BUFFER_ANSWER, poll);
        }
        Ok(())
    }

    /// The board has answered the question for the address, or has failed to.
    pub(super) fn address_answered(&mut self) {
        let system = self.buffer_question.number.take();
        self.buffer.told_address(system.and_then(|system| u32::try_from(system).ok()));
    }

    /// Addresses `system` again, before the next line of the rotary buffers' opener.
    pub(super) fn put_address_back(
        &mut self,
        bus: &mut impl Bus,
        system: u32,
        poll: Poll<'_>,
    ) -> Result<(), PortError> {
        let now = poll.now;
        let line: Text<LINE_MAX> = Text::of(&format_args!("&{system}"));
        if self.ports.current_mut().begin(bus, line.as_bytes())? {
            self.start(InFlight::PutBack, now + BUFFER_ANSWER, poll);
        }
        Ok(())
    }

    /// The board has answered, or refused the question. The daemon assumes that a board that does not know the question
    /// has no buffer open.
    pub(super) fn buffer_answered(&mut self, result: Result<(), u16>, now: Instant) {
        match (self.buffer_question.number.take(), result) {
            (None, Err(error)) => self.buffer_unsaid(Unsaid::Refused(error), now),
            (None, Ok(())) => self.buffer_unsaid(Unsaid::Otherwise, now),
            (size, _) => self.buffer.learn(size, now),
        }
        if self.buffer.is_open() {
            self.buffer_question.not_before = now + BUFFER_AGAIN;
        }
    }

    /// The board does not say. Lines must reach it all the same: otherwise an engineer could not even turn the report
    /// on.
    pub(super) fn buffer_unsaid(&mut self, why: Unsaid, now: Instant) {
        if self.buffer.is_not_said(why, now) {
            warn!(
                "the board {why}: whether another host has opened a program buffer is not known, and a line that is sent may \
                 enter it; turn the servo report on, which tells (pmacctl setup enable)"
            );
        }
    }

    /// The board has not answered the question.
    pub(super) fn buffer_not_answered(&mut self, now: Instant) {
        self.buffer_question.not_before = now + BUFFER_AGAIN;
    }

    /// How long the daemon holds back its own questions because of a buffer, which would store them as program lines.
    pub(super) fn questions_barred_for(&self, now: Instant) -> Duration {
        let asked_again = self.buffer_question.not_before.saturating_duration_since(now);
        match (self.buffer.is_known(now), self.buffer.is_open()) {
            (true, false) => Duration::ZERO,
            (true, true) if asked_again.is_zero() => Duration::MAX,
            _ => asked_again,
        }
    }

    /// The outcome of a line that the board has answered. If another sender opened or closed a buffer between the last
    /// report and the line, the acknowledgement says little.
    pub(super) fn outcome_of(&mut self, line: &WaitingLine, result: Result<(), u16>) -> Outcome {
        let WaitingLine { line, writer, .. } = line;
        let line = &line.meaning;
        let surprise = self.buffer.surprise(line, *writer);
        match (result, surprise) {
            (Err(number), _) => {
                self.buffer.refused(line, number);
                Outcome::Error(number)
            }
            (Ok(()), Some(barred)) => Outcome::Interrupted(Text::of(&barred.too_late())),
            (Ok(()), None) => {
                self.buffer.done(line);
                Outcome::Done
            }
        }
    }
}
