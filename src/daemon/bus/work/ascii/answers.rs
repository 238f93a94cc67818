//! Routes the board's answers to their commands.

use std::time::Instant;

use super::{AsciiQueue, InFlight, OWN_LINE, OWN_REPLY, Poll, STX, UnderWay, WaitingControl, WaitingLine};
use crate::daemon::shared::open_buffer::Barred;
use crate::daemon::shared::queue::{Event, Outcome, Text, Unsolicited};
use crate::function::line_port::{AsciiEvent, ResponseText};
use crate::protocol::{CommandState, MessageKind};
use crate::segment::Counter;

/// Whether this command asks for values. If a board only acknowledges such a command, it has stored the command as a
/// program line.
fn asks_for_values(command: &InFlight) -> bool {
    match command {
        InFlight::Line(line) => line.line.meaning.only_asks_for_variables,
        InFlight::Identify | InFlight::Scan => true,
        _ => false,
    }
}

impl AsciiQueue {
    pub(super) fn handle(&mut self, poll: Poll<'_>, event: AsciiEvent) {
        let now = poll.now;
        let counters = poll.publisher.counters();
        match event {
            AsciiEvent::Line(text) => {
                counters.add(Counter::AsciiReplies, 1);
                self.line_pace.line(now);
                if self.unsettled.is_some() {
                    return self.line_to_unsettled(poll, text);
                }
                if let Some(under_way) = &mut self.under_way {
                    under_way.taken = true;
                    let command = under_way.command;
                    self.tell_line(poll, &command, text);
                    if matches!(command, InFlight::Check) {
                        self.see_check(now);
                    }
                    self.go_on_with_own(now);
                }
            }
            AsciiEvent::Done(result) => {
                counters.add(Counter::AsciiErrors, u64::from(result.is_err()));
                self.state = CommandState::Answers;
                self.answered = Some(now);
                if self.unsettled.is_some() {
                    return self.end_to_unsettled(poll, result);
                }
                if let Some(UnderWay { command: InFlight::Check, .. }) = self.under_way {
                    return self.end_check(result, now);
                }
                if let Some(under_way) = self.under_way.take() {
                    self.end_command(poll, under_way, result);
                }
            }
            AsciiEvent::ProgramResponse(text) => self.unsolicited(poll, MessageKind::Cmd, &text),
            AsciiEvent::ProgramMessage(text) => self.unsolicited(poll, MessageKind::Send, &text),
            AsciiEvent::Stale(_) => {
                counters.add(Counter::AsciiUnsolicited, 1);
                self.identifier.late_answer();
                if self.under_way.is_none() && self.unsettled.is_none() && !self.programs.is_replay {
                    // The board owed nothing, so only the order of answers tells whose the next reply is.
                    self.ports.doubt();
                }
            }
            AsciiEvent::Taken => self.character_taken(now),
            AsciiEvent::Error(number) => {
                counters.add(Counter::AsciiErrors, 1);
                self.state = CommandState::Answers;
                self.answered = Some(now);
                self.refuse(poll, number);
            }
            AsciiEvent::ProgramError(number) => {
                counters.add(Counter::AsciiErrors, 1);
                self.program_error(poll, number);
            }
        }
    }

    /// The board has ended a command.
    pub(super) fn end_command(&mut self, poll: Poll<'_>, under_way: UnderWay, result: Result<(), u16>) {
        let now = poll.now;
        let asks = !self.buffer.is_open() && asks_for_values(&under_way.command);
        let is_unanswered = asks && result.is_ok() && !under_way.taken;
        if is_unanswered {
            self.buffer.disbelieve();
        }
        match under_way.command {
            InFlight::Line(line) => {
                self.line_over(&line);
                let outcome = if is_unanswered {
                    Outcome::Interrupted(Text::of(&Barred::Open(None).too_late()))
                } else {
                    self.outcome_of(&line, result)
                };
                self.outbox.tell(poll.events, Event::Done(line.ticket, outcome));
            }
            InFlight::Control(WaitingControl { ticket, .. }) => {
                let outcome = result.map_or_else(Outcome::Error, |()| Outcome::Done);
                self.outbox.tell(poll.events, Event::Done(ticket, outcome));
            }
            // The board stored the question as a program line; the answer is still to come.
            InFlight::Identify if self.buffer.is_open() => self.identifier.not_sent(),
            InFlight::Identify => {
                self.identifier.done();
                self.scan.is_answering(now);
            }
            InFlight::Scan if self.buffer.is_open() => self.scan.not_sent(),
            InFlight::Scan => self.scan.done(result.is_err(), now),
            InFlight::Buffer => self.buffer_answered(result, now),
            InFlight::Address => self.address_answered(),
            InFlight::PutBack if result.is_ok() => self.buffer.address_is_back(),
            InFlight::PutBack => self.buffer.told_address(None),
            InFlight::Character | InFlight::Check => {}
        }
    }

    /// `line` has ended; the board may have carried it out.
    pub(super) fn line_over(&mut self, line: &WaitingLine) {
        if line.line.meaning.may_start_program {
            self.may_start_program();
        }
    }

    /// A line came: extends the deadline of the daemon's own question, since a slow board needs time for many lines.
    fn go_on_with_own(&mut self, now: Instant) {
        if let Some(UnderWay { command, deadline, since, .. }) = &mut self.under_way
            && matches!(command, InFlight::Identify | InFlight::Scan)
        {
            *deadline = (*deadline).max((now + OWN_LINE).min(*since + OWN_REPLY));
        }
    }

    pub(super) fn unsolicited(&mut self, poll: Poll<'_>, kind: MessageKind, text: &ResponseText) {
        poll.publisher.counters().add(Counter::AsciiUnsolicited, 1);
        let text = text.as_bytes().strip_prefix(&[STX]).map_or(*text, ResponseText::from_bytes);
        self.outbox
            .tell(poll.events, Event::Unsolicited(Unsolicited { time_ns: self.clock.ns(), kind, text }));
    }
}
