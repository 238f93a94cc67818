//! Keeps the ledger of motion: enters the effect of each command, and ends holds and jogs whose clients are silent or
//! gone.

use std::time::Instant;

use super::Service;
use super::replies::not_sent;
use crate::daemon::motion::effect::{CommandEffect, LineEffect};
use crate::daemon::motion::target::Target;
use crate::daemon::motion::timing::PANEL_STOP_TAKES;
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Outcome, dropped_by};
use crate::daemon::socket::call_step::CallStep;
use crate::daemon::socket::call_table::Then;
use crate::daemon::socket::connection::Client;
use crate::daemon::socket::heard::Heard;
use crate::map::Motors;
use crate::protocol::Function;

impl Service {
    /// Records the `effect` of a command on motion, as far as the board has carried it out, or may have.
    pub(super) fn note_effect(&mut self, effect: CommandEffect, then: &Then, heard: &Heard, now: Instant) {
        let CommandEffect { ends, resets, stops_all, jogs } = effect;
        let Heard { caller, outcome, .. } = *heard;
        if outcome == Outcome::Done
            && let Some(ends) = ends.as_ref().filter(|ends| !ends.unnamed)
        {
            let motors = ends.motors;
            self.ledger.commanded(motors);
            self.let_go(motors, now);
        }
        if let Then::Call(CallStep::Reply(LineEffect { jogs: [carried_out, refused], silence, .. })) = *then {
            let jogs = match outcome {
                Outcome::Done => carried_out,
                Outcome::Error(_) => refused,
                outcome if outcome.is_unsent() => Motors::NONE,
                // The daemon does not know how far the board came.
                _ => carried_out.and(refused),
            };
            if outcome == Outcome::Done {
                self.ledger.commanded(jogs);
            }
            self.ledger.jog_by_line(caller.client, jogs, silence, now);
        }
        if outcome.is_unsent() || matches!(outcome, Outcome::Error(_)) {
            return;
        }
        self.ledger.jog_by_panel(jogs);
        if let Some(ends) = ends {
            if resets {
                self.resets.was_sent(now);
            }
            let sequence = if let Then::Sequence(number, _) = *then { Some(number) } else { None };
            if ends.buffer && sequence.is_none() {
                self.end_closed_streams(caller.peer, now);
            }
            self.sent_stops.add(ends, caller, sequence, now);
        }
        if let Some(character) = stops_all.filter(|_| outcome == Outcome::Done) {
            let holders = self.ledger.all_stopped();
            self.withdraw_holds(&holders, now);
            self.end_streams(caller.peer, character, now);
        }
    }

    /// `caller` stops all motion by `character`, which is on its way to the board. A held jog that still waits here
    /// would begin behind the character without a holder, so the daemon withdraws it. If the stop `drops_lines`, the
    /// daemon also drops the lines and panel requests that wait here, the lines of sequences, and other clients'
    /// messages that it has not read yet.
    pub(super) fn stop_all_begins(&mut self, caller: Caller, character: u8, drops_lines: bool, now: Instant) {
        self.ledger.stop_all_begins(character, now);
        let all: Vec<u64> = self.clients.iter().map(|(client, _)| client).collect();
        self.withdraw_holds(&all, now);
        if drops_lines {
            let reason = dropped_by(caller.peer.uid.as_raw(), character);
            self.clients.outdate(reason, caller.client);
            self.sequences.drop_lines(reason);
            for ended in self.calls.drop_what_waits(reason) {
                self.on_end(ended, now);
            }
        }
    }

    /// The board has stopped the `target` of `caller`: ends the holds of its motors, and the streams that feed its
    /// coordinate systems.
    pub(super) fn has_stopped(&mut self, target: Target, caller: Caller, now: Instant) {
        self.ledger.stopped(caller.client, caller.peer.account(), target.motors(), now);
        self.end_streams_of(target.aborted(), caller.peer, now);
    }

    /// Stops the motors of clients that are gone, or silent without a call under way, and drives the stops.
    pub(super) fn tend_motion(&mut self, now: Instant) {
        let Self { ledger, clients, .. } = self;
        ledger.hear(|client| clients.get(client).is_some_and(Client::waits_for_board), now);
        let (motors, holders) = ledger.lapse(|client| clients.hears(client), now);
        match self.uses(Function::Panel) {
            _ if motors.is_empty() => {}
            true => {
                self.stops.begin_due(motors, now);
            }
            false => self.stop_by_line(Target::Motors(motors), None, true, now),
        }
        self.withdraw_holds(&holders, now);
        self.tend_stops(now);
    }

    /// Withdraws from the queue the held jogs of these clients that are over: a jog sent after its stop would have no
    /// end.
    fn withdraw_holds(&mut self, clients: &[u64], now: Instant) {
        for client in clients {
            if let Some(caller) = self.calls.take_back_hold(*client) {
                let end = self.ledger.renew(*client, now).err().flatten();
                self.answer(caller, Err(not_sent(end)), now);
            }
            if self.clients.get(*client).is_none() {
                self.ledger.forget(*client);
            }
        }
    }

    /// The daemon ends now: requests the stop of all held motors once more, if the bus thread has room for the request.
    /// The bus thread carries it out before its own end.
    pub(super) fn stop_at_the_end(&mut self, now: Instant) {
        let motors = self.ledger.held_motors().and(self.stops.due_motors());
        if !motors.is_empty() {
            self.calls.send_now(Job::EndHold(motors), now + PANEL_STOP_TAKES);
        }
    }

    /// Whether the daemon may use `function` of the board now.
    pub(super) fn uses(&self, function: Function) -> bool {
        self.info.why_not(function).is_none()
    }
}
