//! An error that came while a line was under way: the line's, or a program's.
//!
//! Where no program can report one ([`super::programs`]) it is the line's at once. Otherwise the next exchange decides, by the order in
//! which the board answers: a line of our own goes, whose reply is unmistakable ([`super::check`]). If it is answered first, the error
//! was the line's. What comes before is the line's own reply, which its caller gets, and the error was a program's
//! (`tests/models/whose_error.pml`).

use std::time::Instant;

use super::check::REPLY_LINES;
use super::letters::may_start_program;
use super::{AsciiQueue, InFlight, UnderWay, WaitingControl, WaitingLine};
use crate::daemon::shared::queue::{Event, GivenUp, Outcome, Sender, Text, stopped_by};
use crate::function::ascii::ResponseText;
use crate::protocol::MessageKind;
use crate::segment::Publisher;

/// A line that an error came to.
#[derive(Clone, Copy)]
pub(super) struct Refused {
    pub under_way: UnderWay,
    error: u16,
    /// An error of another number came behind it: one of the two may be a program's.
    other: Option<u16>,
    /// Lines that came behind the error and may be those of our own line's reply: the first `count`.
    held: [ResponseText; REPLY_LINES],
    count: usize,
    /// A line came that is not: the line is being answered.
    is_answered: bool,
}

impl AsciiQueue {
    /// An error came to the line under way.
    pub(super) fn refuse(&mut self, events: &Sender<Event>, publisher: &Publisher, error: u16, now: Instant) {
        let Some(under_way) = self.under_way.take() else {
            self.ports.believe_error(now);
            return self.program_error(events, publisher, error);
        };
        if !self.programs_may_report(&under_way) {
            self.ports.believe_error(now);
            return self.end_command(events, under_way, Err(error), now);
        }
        self.ports.doubt_error();
        self.check.go_at(now);
        let held = [ResponseText::default(); REPLY_LINES];
        self.refused = Some(Refused { under_way, error, other: None, held, count: 0, is_answered: false });
    }

    /// Whether an error that came during this command may be a program's.
    fn programs_may_report(&self, under_way: &UnderWay) -> bool {
        let starts_one = match &under_way.command {
            InFlight::Line(line) => may_start_program(line.line.as_bytes()),
            _ => false,
        };
        let none_ran = || !starts_one && self.programs.none_ran(self.clock.ns_of(under_way.since));
        match self.identifier.program_reports() {
            _ if self.programs.is_replay => false,
            [_, Some(2)] => false,
            [Some(0), _] => !none_ran(),
            _ => true,
        }
    }

    /// A line of a reply came behind the error.
    pub(super) fn line_behind_error(&mut self, events: &Sender<Event>, text: ResponseText, now: Instant) {
        let Some(refused) = &mut self.refused else { return };
        if let Some(UnderWay { command: InFlight::Check, .. }) = self.under_way
            && !refused.is_answered
        {
            self.check.line(text.as_bytes());
            if let Some(place) = refused.held.get_mut(refused.count).filter(|_| self.check.may_be_own()) {
                (*place, refused.count) = (text, refused.count + 1);
                return self.see_check(now);
            }
        }
        refused.is_answered = true;
        self.tell_held(events);
        self.tell_refused(events, text);
        self.see_check(now);
    }

    /// A reply has ended behind the error.
    pub(super) fn end_behind_error(
        &mut self,
        events: &Sender<Event>,
        publisher: &Publisher,
        result: Result<(), u16>,
        now: Instant,
    ) {
        let checks = matches!(self.under_way, Some(UnderWay { command: InFlight::Check, .. }));
        let Some(refused) = &mut self.refused else { return };
        let is_own = checks && !refused.is_answered && self.check.own_answer().is_some();
        if let Err(error) = result {
            return self.error_behind_error(events, publisher, error, is_own, now);
        }
        if is_own {
            let Refused { under_way, error, other, .. } = *refused;
            self.refused = None;
            match other {
                None => self.end_command(events, under_way, Err(error), now),
                Some(_) => self.end_unsettled(events, error, &under_way, now),
            }
            return self.end_check(result, now);
        }
        self.tell_held(events);
        let Some(Refused { under_way, error, other, .. }) = self.refused.take() else { return };
        for error in [Some(error), other].into_iter().flatten() {
            self.program_error(events, publisher, error);
        }
        if checks {
            self.end_check(result, now);
        } else {
            // Nothing else is to come.
            self.ports.believe_error(now);
            self.ports.end_doubt(now);
        }
        self.end_command(events, under_way, result, now);
    }

    /// One more error came: behind the whole reply to our own line, if `is_own`.
    fn error_behind_error(
        &mut self,
        events: &Sender<Event>,
        publisher: &Publisher,
        error: u16,
        is_own: bool,
        now: Instant,
    ) {
        self.see_check(now);
        let Some(refused) = &mut self.refused else { return };
        if is_own {
            // The line was answered before.
            self.program_error(events, publisher, error);
        } else if std::mem::take(&mut refused.is_answered) {
            // So the line was not refused by the error before. By this one it may be.
            let before = std::mem::replace(&mut refused.error, error);
            self.check.forget_values();
            self.program_error(events, publisher, before);
        } else if matches!((&self.under_way, &refused.under_way.command), (Some(_), InFlight::Buffer))
            && error == refused.error
        {
            self.refuses_size(events, error, now);
        } else if error != refused.error {
            refused.other.get_or_insert(error);
        }
    }

    /// The board refuses the question for a program buffer, and our own line, which asks the same. Whether one of the errors was a
    /// program's the handshake tells.
    fn refuses_size(&mut self, events: &Sender<Event>, error: u16, now: Instant) {
        let Some(Refused { under_way, .. }) = self.refused.take() else { return };
        self.under_way = None;
        self.ports.finish(now);
        self.end_command(events, under_way, Err(error), now);
    }

    /// Tells what was held back: it is the line's.
    fn tell_held(&mut self, events: &Sender<Event>) {
        let Some(refused) = &mut self.refused else { return };
        let (held, count) = (refused.held, std::mem::take(&mut refused.count));
        held[..count].iter().for_each(|text| self.tell_refused(events, *text));
    }

    fn tell_refused(&mut self, events: &Sender<Event>, text: ResponseText) {
        let Some(refused) = &mut self.refused else { return };
        refused.under_way.taken = true;
        let command = refused.under_way.command;
        self.tell_line(events, &command, text);
    }

    /// Ends a line that waits for the board to settle whose an error is: its time is over, somebody has cancelled it, or `must_end`,
    /// because the board does not settle it any more.
    pub(super) fn expire_refused(&mut self, events: &Sender<Event>, must_end: bool, now: Instant) {
        let is_over = |Refused { under_way, .. }: &mut Refused| {
            must_end || now >= under_way.deadline || under_way.ended_by.is_some()
        };
        if let Some(Refused { under_way, error, .. }) = self.refused.take_if(is_over) {
            self.ports.doubt();
            self.end_unsettled(events, error, &under_way, now);
        }
    }

    /// Ends a command of which nobody knows whether the board refused it.
    fn end_unsettled(&mut self, events: &Sender<Event>, error: u16, under_way: &UnderWay, now: Instant) {
        let UnderWay { command, since, ended_by, .. } = under_way;
        let Some((ticket, origin)) = self.caller_in_doubt(command) else {
            return self.give_up_own(*command, true, now);
        };
        let outcome = match ended_by {
            Some(ended_by) => stopped_by(ended_by.uid, ended_by.character),
            None => Text::of(&format_args!(
                "the board reported ERR{error:03}, of the line or of a program, and has not shown which"
            )),
        };
        if ended_by.is_none() {
            self.check.give_up(GivenUp { by: origin, since: *since });
        }
        self.outbox.tell(events, Event::Done(ticket, Outcome::Interrupted(outcome)));
    }

    /// A program of the board has failed in a `CMD`.
    pub(super) fn program_error(&mut self, events: &Sender<Event>, publisher: &Publisher, error: u16) {
        let text = ResponseText::of(&format_args!("ERR{error:03}"));
        self.unsolicited(events, publisher, MessageKind::Error, &text);
    }

    /// Gives a line of a reply to whom it is for.
    pub(super) fn tell_line(&mut self, events: &Sender<Event>, command: &InFlight, text: ResponseText) {
        match command {
            InFlight::Line(WaitingLine { ticket, .. }) | InFlight::Control(WaitingControl { ticket, .. }) => {
                self.outbox.tell(events, Event::Line(*ticket, text));
            }
            InFlight::Identify => self.identifier.line(text.as_bytes()),
            InFlight::Scan => self.scan.line(text.as_bytes()),
            InFlight::Buffer | InFlight::Address => self.buffer_question.line(text.as_bytes()),
            InFlight::PutBack => {}
            InFlight::Check => self.check.line(text.as_bytes()),
        }
    }
}
