//! Jogs by command line: those that end with the connection they came by, and jogs to a position. And which jogs are without
//! their panel.
//!
//! A jog to a position asks what is addressed, then sends the line that jogs and puts the address back. Both are on-line only: no
//! program buffer takes them, whoever has one open.

use std::time::Instant;

use log::warn;

use super::Service;
use super::replies::{held_by_another, outcome_reply};
use crate::daemon::shared::open_buffer::{Account, Writer};
use crate::daemon::shared::queue::{Command, Origin, Outcome, Text};
use crate::daemon::socket::call_table::{Caller, Ended, Then};
use crate::daemon::socket::connection::Client;
use crate::daemon::socket::jog_to::JogTo;
use crate::daemon::socket::leftovers::LineEffect;
use crate::daemon::socket::stop_target::Target;
use crate::protocol::{CallError, Function};

impl Service {
    /// A motor jogs for the connection that has said so last, until another command to it has been carried out.
    pub(super) fn note_jogs(&mut self, ended: &Ended, outcome: Outcome, now: Instant) {
        if outcome == Outcome::Done
            && let Some(motors) = ended.ends.as_ref().filter(|ends| !ends.unnamed).map(|ends| ends.motors)
        {
            self.line_jogs.over(motors);
            self.let_go(motors, now);
        }
        if let Then::ReplyToLine(LineEffect { jogs: [carried_out, refused], silence, .. }) = ended.then {
            let client = ended.caller.client;
            match outcome {
                Outcome::Done => self.line_jogs.begin(client, carried_out, silence, now),
                Outcome::Error(_) => self.line_jogs.may_begin(client, refused, silence, now),
                outcome if outcome.is_unsent() => {}
                // How far the board came nobody knows.
                _ => self.line_jogs.may_begin(client, carried_out | refused, silence, now),
            }
        }
    }

    /// Stops what jogs for clients that are gone, or silent while the daemon does nothing for them.
    pub(super) fn tend_line_jogs(&mut self, now: Instant) {
        let Self { line_jogs, clients, .. } = self;
        line_jogs.hear(|client| clients.get(client).is_some_and(Client::waits_for_board), now);
        let motors = line_jogs.take(now, |client| !clients.hears(client));
        self.end_line_jogs(motors, "who had asked for it is gone or silent", now);
    }

    /// Stops `motors`, which jogged by command line, for this `reason`.
    pub(super) fn end_line_jogs(&mut self, motors: u32, reason: &str, now: Instant) {
        if motors == 0 {
            return;
        }
        let target = Target::Motors(motors);
        warn!(target: "audit", "{target} jogged by command line: {reason}; pmacd stops it");
        if self.info.why_not(Function::Panel).is_none() {
            self.leases.stop_now(motors, now);
        } else {
            self.stop_by_line(target, None, true, now);
        }
    }

    /// Begins a jog that `caller` asks for.
    ///
    /// # Errors
    /// Why nothing was sent.
    pub(super) fn jog_to(&mut self, caller: Caller, jog: JogTo, now: Instant) -> Result<(), CallError> {
        self.may_jog(caller, jog)?;
        let deadline = JogTo::deadline(now);
        self.question(caller, JogTo::QUESTION, Then::JogTo(jog, deadline), deadline);
        Ok(())
    }

    /// The board has said what is addressed, or not: the line is sent, or the caller hears why not.
    pub(super) fn jog_addressed(
        &mut self,
        caller: Caller,
        (jog, deadline): (JogTo, Instant),
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) {
        if let Err(error) = self.send_jog(caller, (jog, deadline), lines, outcome, now) {
            self.answer(caller, Err(error), now);
        }
    }

    fn send_jog(
        &mut self,
        caller: Caller,
        (jog, deadline): (JogTo, Instant),
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) -> Result<(), CallError> {
        let addressed = match outcome {
            Outcome::Done => lines.first().and_then(|line| line.trim().parse().ok()),
            // That is said of the question. The jog has not been sent.
            Outcome::Error(_) | Outcome::TimedOut | Outcome::Interrupted(_) => None,
            outcome => return outcome_reply(outcome, Vec::new(), false, now).map(drop),
        };
        let addressed = addressed.ok_or_else(|| CallError::Refused {
            reason: "the board does not say which motor is addressed; nothing was sent".to_owned(),
        })?;
        // Somebody may have begun to hold it meanwhile.
        self.may_jog(caller, jog)?;
        let line = jog.line(addressed);
        let origin = Origin { uid: caller.peer.uid.as_raw(), shown: Text::of(&&*line), stays: false };
        let audit = Some(format!("sends {:?}", &*line));
        self.wait_for_board(caller, deadline, Then::ReplyDone(None), audit, |ticket| Command::Send {
            ticket,
            line,
            origin,
            deadline,
            writer: Writer::Question,
        });
        Ok(())
    }

    /// The board does not read the control panel any more: `by` has switched it off, or it is not known who.
    pub(super) fn panel_ended(&mut self, by: Option<Account>, now: Instant) {
        self.leases.panel_ended(by, now);
        let going = self.panel_jogs.newly_alone(self.info.motion());
        if going != 0 {
            warn!(target: "audit", "{}", self.without_panel(going));
        }
    }

    /// What is told of the motors that were set in motion by the panel and go on, while it is off.
    pub(super) fn jogs_without_panel(&self) -> Option<String> {
        let going = self.panel_jogs.going(self.info.motion());
        let is_off = self.info.enabling().panel == Some(false);
        (is_off && going != 0).then(|| self.without_panel(going))
    }

    fn without_panel(&self, motors: u32) -> String {
        let cure = match self.info.why_not(Function::Ascii) {
            None => "pmacctl panel jog-stop stops it by command line, pmacctl abort everything",
            Some(_) => "pmacd sends no command lines, so nothing of it stops it until the panel is on again",
        };
        format!(
            "{} was set in motion by the control panel, which is off (I{} is not 3), and may go on: {cure}",
            Target::Motors(motors),
            self.info.family().i.panel.unwrap_or_default()
        )
    }

    /// Whether `caller` may jog the motor now: nobody else holds it, and its loop is known not to be open. The daemon takes it
    /// that every jog closes the loop of a killed motor, as `J/` does (Turbo Software Reference p. 275).
    fn may_jog(&self, caller: Caller, jog: JogTo) -> Result<(), CallError> {
        if let Some((holder, held)) = self.leases.held_by_another(caller.client, jog.mask()) {
            return Err(held_by_another(holder, held));
        }
        if self.info.loops_untold() & jog.mask() != 0 {
            return Err(CallError::Refused {
                reason: format!(
                    "whether the loop of motor {} is open is not known until the board has told where its M-variables point \
                     (pmacctl status tells how far that is); nothing was sent",
                    jog.motor()
                ),
            });
        }
        match self.info.loops_left_open() & jog.mask() {
            0 => Ok(()),
            open => Err(CallError::Refused {
                reason: format!(
                    "the loop of {} is open (killed, or a fault), and a jog would close it; nothing was sent; pmacctl send \
                     '#{}J/' closes it where the motor stands",
                    Target::Motors(open),
                    jog.motor()
                ),
            }),
        }
    }
}
