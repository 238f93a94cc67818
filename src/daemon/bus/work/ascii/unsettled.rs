//! A command whose end the order of the board's answers settles.
//!
//! An error during a line is the line's or a program's. Where no program can report errors ([`super::programs`]), the
//! error is the line's. Otherwise, and behind a control character, whose reply has no end mark, a probe decides
//! ([`super::check`]). Every reply before the probe's is the command's. If a line got such a reply, the error was a
//! program's; if not, the error was the line's (`tests/models/whose_error.pml`).

use std::time::Instant;

use super::check::REPLY_LINES;
use super::{AsciiQueue, InFlight, Poll, UnderWay, WaitingControl, WaitingLine};
use crate::daemon::shared::queue::{Event, GivenUp, Outcome, Text, stopped_by};
use crate::function::line_port::ResponseText;
use crate::protocol::MessageKind;

/// The command.
#[derive(Clone, Copy)]
pub(super) struct Unsettled {
    pub under_way: UnderWay,
    /// The line's possible error; `None`: the command is a control character.
    error: Option<u16>,
    /// A second error of another number: one of the two may be a program's.
    other: Option<u16>,
    /// Lines since then that may belong to the probe's reply: the first `count`.
    held: [ResponseText; REPLY_LINES],
    count: usize,
    /// A line came that cannot be the probe's: the board is answering the command.
    is_answered: bool,
}

impl AsciiQueue {
    /// An error came to the line under way.
    pub(super) fn refuse(&mut self, poll: Poll<'_>, error: u16) {
        let now = poll.now;
        let Some(under_way) = self.under_way.take() else {
            self.ports.current_mut().settled(now);
            return self.program_error(poll, error);
        };
        if !self.programs_may_report(&under_way) {
            self.ports.current_mut().settled(now);
            if error == 0 && !self.programs.is_replay {
                // A control word that no manual has may not have been the end.
                self.ports.doubt();
            }
            return self.end_command(poll, under_way, Err(error));
        }
        self.unsettle(under_way, Some(error), now);
    }

    /// The board has taken the control character under way.
    pub(super) fn character_taken(&mut self, now: Instant) {
        match self.under_way.take() {
            Some(under_way) => self.unsettle(under_way, None, now),
            None => self.ports.current_mut().settled(now),
        }
    }

    fn unsettle(&mut self, under_way: UnderWay, error: Option<u16>, now: Instant) {
        self.ports.doubt_its_end();
        self.check.go_at(now);
        let held = [ResponseText::default(); REPLY_LINES];
        self.unsettled =
            Some(Unsettled { under_way, error, other: None, held, count: 0, is_answered: false });
    }

    /// Whether an error that came during this command may be a program's.
    fn programs_may_report(&self, under_way: &UnderWay) -> bool {
        let starts_one = match &under_way.command {
            InFlight::Line(line) => line.line.meaning.may_start_program,
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

    /// A line of a reply came.
    pub(super) fn line_to_unsettled(&mut self, poll: Poll<'_>, text: ResponseText) {
        let now = poll.now;
        let checks = self.is_checking();
        let Some(unsettled) = &mut self.unsettled else { return };
        if unsettled.error.is_none() {
            return self.line_to_character(poll, text);
        }
        if checks && !unsettled.is_answered {
            self.check.line(text.as_bytes());
            if let Some(place) = unsettled.held.get_mut(unsettled.count).filter(|_| self.check.may_be_own()) {
                (*place, unsettled.count) = (text, unsettled.count + 1);
                return self.see_check(now);
            }
        }
        unsettled.is_answered = true;
        self.tell_held(poll);
        self.tell_unsettled(poll, text);
        self.see_check(now);
    }

    /// A line came that is the control character's or begins the probe's reply. Lines that cannot begin the probe's
    /// reply are the character's.
    fn line_to_character(&mut self, poll: Poll<'_>, text: ResponseText) {
        let now = poll.now;
        let checks = self.is_checking();
        let Some(unsettled) = &mut self.unsettled else { return };
        let (mut lines, mut count) = ([ResponseText::default(); REPLY_LINES + 1], unsettled.count + 1);
        lines[..unsettled.count].copy_from_slice(&unsettled.held[..unsettled.count]);
        lines[unsettled.count] = text;
        while count > 0 {
            self.check.forget_values();
            lines[..count].iter().for_each(|line| self.check.line(line.as_bytes()));
            if checks && count <= REPLY_LINES && self.check.may_be_own() {
                break;
            }
            self.tell_unsettled(poll, lines[0]);
            lines.rotate_left(1);
            count -= 1;
        }
        if let Some(unsettled) = &mut self.unsettled {
            unsettled.held[..count].copy_from_slice(&lines[..count]);
            unsettled.count = count;
        }
        self.see_check(now);
    }

    fn is_checking(&self) -> bool {
        matches!(self.under_way, Some(UnderWay { command: InFlight::Check, .. }))
    }

    /// A reply has ended.
    pub(super) fn end_to_unsettled(&mut self, poll: Poll<'_>, result: Result<(), u16>) {
        let now = poll.now;
        let checks = self.is_checking();
        let Some(unsettled) = &self.unsettled else { return };
        let is_own = checks && !unsettled.is_answered && self.check.own_answer().is_some();
        if let Err(error) = result {
            return self.error_to_unsettled(poll, error, is_own);
        }
        if is_own {
            let Unsettled { under_way, error, other, .. } = *unsettled;
            self.unsettled = None;
            match (error, other) {
                (None, _) => self.end_command(poll, under_way, Ok(())),
                (Some(error), None) => self.end_command(poll, under_way, Err(error)),
                (Some(error), Some(_)) => self.end_doubtful(poll, error, &under_way),
            }
            return self.end_check(result, now);
        }
        self.tell_held(poll);
        if matches!(self.unsettled, Some(Unsettled { error: None, .. })) {
            // Some board may mark the end of its reply all the same.
            self.check.forget_values();
            return self.see_check(now);
        }
        let Some(Unsettled { under_way, error, other, .. }) = self.unsettled.take() else { return };
        for error in [error, other].into_iter().flatten() {
            self.program_error(poll, error);
        }
        if checks {
            self.end_check(result, now);
        } else {
            // The board sends nothing else.
            self.ports.current_mut().settled(now);
            self.ports.end_doubt(now);
        }
        self.end_command(poll, under_way, result);
    }

    /// Another error came; with `is_own`, behind the probe's whole reply.
    fn error_to_unsettled(&mut self, poll: Poll<'_>, error: u16, is_own: bool) {
        let now = poll.now;
        self.see_check(now);
        let Some(unsettled) = &mut self.unsettled else { return };
        let Some(before) = unsettled.error.filter(|_| !is_own) else {
            // The board had answered the line before; and no board refuses a control character.
            return self.program_error(poll, error);
        };
        if std::mem::take(&mut unsettled.is_answered) {
            // So the earlier error did not refuse the line. This error may.
            unsettled.error = Some(error);
            self.check.forget_values();
            self.program_error(poll, before);
        } else if error != before {
            unsettled.other.get_or_insert(error);
        } else if let (Some(_), InFlight::Buffer) = (&self.under_way, &unsettled.under_way.command) {
            self.refuses_size(poll, error);
        }
    }

    /// The board refuses both the question for a program buffer and the probe, which asks the same. The handshake probe
    /// tells whether one of the errors was a program's.
    fn refuses_size(&mut self, poll: Poll<'_>, error: u16) {
        let now = poll.now;
        let Some(Unsettled { under_way, .. }) = self.unsettled.take() else { return };
        self.under_way = None;
        self.ports.current_mut().finish(now);
        self.end_command(poll, under_way, Err(error));
    }

    /// Hands the held-back lines to the command's caller.
    fn tell_held(&mut self, poll: Poll<'_>) {
        let Some(unsettled) = &mut self.unsettled else { return };
        let (held, count) = (unsettled.held, std::mem::take(&mut unsettled.count));
        held[..count].iter().for_each(|text| self.tell_unsettled(poll, *text));
    }

    fn tell_unsettled(&mut self, poll: Poll<'_>, text: ResponseText) {
        let Some(unsettled) = &mut self.unsettled else { return };
        unsettled.under_way.taken = true;
        let command = unsettled.under_way.command;
        self.tell_line(poll, &command, text);
    }

    /// Ends an unsettled command: at its deadline, after a cancel, or with `must_end`, because the board no longer
    /// settles it.
    pub(super) fn expire_unsettled(&mut self, poll: Poll<'_>, must_end: bool) {
        let now = poll.now;
        let is_over = |Unsettled { under_way, .. }: &mut Unsettled| {
            must_end || now >= under_way.deadline || under_way.ended_by.is_some()
        };
        let Some(Unsettled { under_way, error, .. }) = self.unsettled.take_if(is_over) else { return };
        self.ports.doubt();
        match error {
            Some(error) => self.end_doubtful(poll, error, &under_way),
            None => self.end_given_up(poll, &under_way),
        }
    }

    /// Ends a line that the board may or may not have refused.
    fn end_doubtful(&mut self, poll: Poll<'_>, error: u16, under_way: &UnderWay) {
        let now = poll.now;
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
        self.outbox.tell(poll.events, Event::Done(ticket, Outcome::Interrupted(outcome)));
    }

    /// A program of the board has failed in a `CMD`.
    pub(super) fn program_error(&mut self, poll: Poll<'_>, error: u16) {
        let text = ResponseText::of(&format_args!("ERR{error:03}"));
        self.unsolicited(poll, MessageKind::Error, &text);
    }

    /// Hands a line of a reply to the command's owner.
    pub(super) fn tell_line(&mut self, poll: Poll<'_>, command: &InFlight, text: ResponseText) {
        match command {
            InFlight::Line(WaitingLine { ticket, .. }) | InFlight::Control(WaitingControl { ticket, .. }) => {
                self.outbox.tell(poll.events, Event::Line(*ticket, text));
            }
            InFlight::Identify => self.identifier.line(text.as_bytes()),
            InFlight::Scan => self.scan.line(text.as_bytes()),
            InFlight::Buffer | InFlight::Address => self.buffer_question.line(text.as_bytes()),
            InFlight::PutBack | InFlight::Character => {}
            InFlight::Check => self.check.line(text.as_bytes()),
        }
    }
}
