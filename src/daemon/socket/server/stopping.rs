//! Drives the stops that the control panel did not take, or that there is no panel for.

use std::time::Instant;

use log::{error, info, warn};
use nix::unistd::{getegid, geteuid};

use super::Service;
use crate::daemon::shared::queue::{Command, LINE_MAX, Origin, Outcome, Text, dropped_by};
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::command_ends::ended_by_stop;
use crate::daemon::socket::policy::Peer;
use crate::daemon::socket::stop_target::Target;
use crate::daemon::socket::stops::{At, LINE_TAKES, QUESTION_TAKES, Seen};
use crate::protocol::{CallError, Function, Reply, control};

impl Service {
    /// `character`, which stops all motion, is on its way to the board. A jog that is to be held and was not handed over would begin
    /// behind it, and be held by nobody.
    pub(super) fn stop_all_begins(&mut self, character: u8, now: Instant) {
        self.leases.control_begins(character, now);
        let all: Vec<u64> = self.clients.iter().map(|(client, _)| client).collect();
        self.withdraw_holds(&all, now);
    }

    /// User `uid` stops all motion by `character`, as client `by` or for nobody: no line and no request of the panel that waits here is
    /// sent any more, nor a line that a sequence would send, nor what other clients have sent and nobody has read yet.
    pub(super) fn drop_what_waits(&mut self, uid: u32, character: u8, by: Option<u64>, now: Instant) {
        let reason = dropped_by(uid, character);
        self.clients.outdate(reason, by);
        self.sequences.drop_lines(reason);
        for ended in self.calls.drop_what_waits(&reason.to_string()) {
            self.on_end(ended, Outcome::Dropped(reason), now);
        }
    }

    /// Stops `target`, which `caller` waits for, by command line: the panel did not take it, or is not used. It `ends_hold`
    /// when the motors were held, and must stand in the end.
    pub(super) fn stop_by_line(
        &mut self,
        target: Target,
        caller: Option<Caller>,
        ends_hold: bool,
        now: Instant,
    ) {
        let number = self.stops.begin(target, caller, ends_hold, now);
        if !self.uses(Function::Ascii) {
            if let Some(stop) = self.stops.get_mut(number) {
                stop.hopeless = self.info.why_not(Function::Panel).is_some();
            }
            return self.stop_watched(number, now);
        }
        if self.uses(Function::Panel) {
            warn!(target: "audit", "the control panel did not take the stop of {target}; sends it as a command line");
        }
        let deadline = now + QUESTION_TAKES;
        if !self.send_first(target.question(), number, deadline) {
            self.stop_step(number, &[], Outcome::Busy, now);
        }
    }

    /// A step of stop `number` is over.
    pub(super) fn stop_step(&mut self, number: u64, lines: &[String], outcome: Outcome, now: Instant) {
        let (reported, motion) = (self.info.loops_left_open(), self.info.motion());
        let motor_status = self.info.family().status.motor;
        let has_panel = self.uses(Function::Panel);
        let Some(stop) = self.stops.get_mut(number) else { return };
        let target = stop.target;
        match stop.at {
            At::Question => {
                let addressed = lines.first().and_then(|line| line.trim().parse().ok());
                let loops = target.loops(lines, motor_status);
                // What no answer tells, the report does. It may be from just before the motor began to move, so what it leaves out is
                // watched.
                let untold = target.motors() & !loops.told;
                let open = loops.open | untold & reported;
                stop.is_doubtful = untold & reported != 0;
                tell_of_loops(
                    target,
                    open,
                    untold & !reported & !(motion.moving | motion.standing),
                    reported,
                );
                let Some(line) = target.line(open, addressed) else {
                    return match stop.is_doubtful {
                        true => self.stop_watched(number, now),
                        false => self.stop_over(number, Ok(()), now),
                    };
                };
                stop.at = At::Line;
                info!(target: "audit", "pmacd sends {:?}", &*line);
                if !self.send_first(line, number, now + LINE_TAKES) {
                    self.stop_step(number, &[], Outcome::Busy, now);
                }
            }
            At::Line => {
                stop.taken = outcome == Outcome::Done;
                stop.error = match outcome {
                    Outcome::Error(error) => Some(error),
                    _ => None,
                };
                let is_without_effect = stop.error.is_some() || outcome.is_unsent();
                stop.hopeless = is_without_effect && !has_panel;
                let is_watched = stop.ends_hold || stop.is_doubtful;
                let is_believed = stop.taken && (!is_watched || target.motors() == 0);
                if is_believed {
                    self.stop_over(number, Ok(()), now);
                } else if target.motors() == 0 {
                    let reason = self.may_go_on(number, target);
                    self.stop_over(number, Err(reason), now);
                } else {
                    self.stop_watched(number, now);
                }
            }
            At::AbortAll if outcome == Outcome::Done => {
                self.panel_jogs.stopped(u32::MAX);
                let clients = self.leases.control_taken();
                self.withdraw_holds(&clients, now);
                self.end_streams(by_itself().peer, control::ABORT, now);
                let (stop, cure) = match self.uses(Function::Panel) {
                    true => (
                        "the control panel did not take the stop",
                        "; the panel needs I2=3 and a board that answers",
                    ),
                    false => ("the command line did not stop it", ""),
                };
                let reason = format!(
                    "{stop}, and {target} still moved, so pmacd sent ^A: every motor and program is aborted{cure}"
                );
                self.stop_over(number, Err(reason), now);
            }
            At::AbortAll => {
                // Not taken: the stop has to be requested again.
                stop.at = At::Watch;
                let reason = self.may_go_on(number, target);
                self.stop_over(number, Err(reason), now);
            }
            At::Watch => {}
        }
    }

    fn stop_watched(&mut self, number: u64, now: Instant) {
        if let Some(stop) = self.stops.get_mut(number) {
            stop.at = At::Watch;
        }
        self.tend_stops(now);
    }

    /// Looks at the motors that should stand by now.
    pub(super) fn tend_stops(&mut self, now: Instant) {
        for (number, seen) in self.stops.seen(self.info.motion(), now) {
            let may_abort = self.stops.stop_all_after.is_some() && self.uses(Function::Ascii);
            let Some(stop) = self.stops.get_mut(number) else { continue };
            let target = stop.target;
            match seen {
                Seen::Open => {}
                Seen::Stand => self.stop_over(number, Ok(()), now),
                Seen::Move if stop.ends_hold && may_abort => {
                    stop.at = At::AbortAll;
                    error!(target: "audit", "{target} may still move after its held jog is over: pmacd sends ^A");
                    self.stop_all_begins(control::ABORT, now);
                    self.drop_what_waits(geteuid().as_raw(), control::ABORT, None, now);
                    let deadline = now + LINE_TAKES;
                    let sent = self.calls.send_own(by_itself(), deadline, Then::Stop(number), |ticket| {
                        Command::Control {
                            drops_lines: true,
                            ticket,
                            uid: geteuid().as_raw(),
                            character: control::ABORT,
                            deadline,
                        }
                    });
                    if !sent {
                        self.stop_step(number, &[], Outcome::Busy, now);
                    }
                }
                Seen::Move => {
                    let reason = self.may_go_on(number, target);
                    self.stop_over(number, Err(reason), now);
                }
            }
        }
    }

    /// A command to `motors` has been carried out. Where their stop has been taken before, whoever sent it may have them move.
    pub(super) fn let_go(&mut self, motors: u32, now: Instant) {
        for number in self.stops.let_go(motors) {
            self.stop_over(number, Ok(()), now);
        }
    }

    fn stop_over(&mut self, number: u64, result: Result<(), String>, now: Instant) {
        let Some(stop) = self.stops.over(number) else { return };
        match &result {
            Ok(()) => {
                if let Some(caller) = stop.caller {
                    if let Some(ends) = ended_by_stop(stop.target) {
                        self.sent_stops.add(ends, caller, None, now);
                    }
                    self.panel_has_stopped(stop.target, caller, now);
                }
            }
            Err(reason) => {
                error!(target: "audit", "{reason}");
                // After ^A nothing is left to stop.
                if stop.ends_hold && stop.at != At::AbortAll {
                    self.leases.stop_again(stop.target.motors(), now);
                }
            }
        }
        if let Some(caller) = stop.caller {
            let reply = result.map(|()| Reply::done()).map_err(|reason| CallError::StopFailed { reason });
            self.answer(caller, reply, now);
        }
    }

    /// What is told of stop `number`, which nobody has seen to be taken.
    fn may_go_on(&mut self, number: u64, target: Target) -> String {
        let panel = match self.uses(Function::Panel) {
            true => "the control panel did not take the stop, and ",
            false => "",
        };
        let error = self.stops.get_mut(number).and_then(|stop| stop.error);
        let line = match error {
            Some(error) => format!("the board refused the command line (ERR{error:03})"),
            None => "no command line is known to have stopped it".to_owned(),
        };
        format!(
            "{target} MAY STILL MOVE: {panel}{line}; pmacctl abort stops everything (^A), an emergency stop does so without \
             the computer"
        )
    }

    fn uses(&self, function: Function) -> bool {
        self.info.why_not(function).is_none()
    }

    fn send_first(&mut self, line: Text<LINE_MAX>, number: u64, deadline: Instant) -> bool {
        let origin = Origin { uid: geteuid().as_raw(), shown: Text::of(&&*line), stays: true };
        self.calls.send_own(by_itself(), deadline, Then::Stop(number), |ticket| Command::First {
            ticket,
            line,
            origin,
            deadline,
        })
    }
}

/// Says whose loops a stop of `target` leaves `open`, of whose it is `unknown` whether they are, and whose an abort closes, of those
/// `reported` open.
fn tell_of_loops(target: Target, open: u32, unknown: u32, reported: u32) {
    let motors = Target::Motors;
    if target.motors() & open != 0 {
        let left_out = motors(target.motors() & open);
        warn!(target: "audit", "{left_out} gets no stop: its loop is open (killed, or a fault), and J/ would close it");
    }
    if target.motors() & unknown != 0 {
        let unknown = motors(target.motors() & unknown);
        warn!(target: "audit", "the loop of {unknown} may be open, and J/ closes it then: neither ? nor a report tells");
    }
    if target.aborted() != 0 && reported != 0 {
        let reported = motors(reported);
        warn!(target: "audit", "the abort of {target} closes the loop of {reported}, which is open, if it belongs there");
    }
}

/// The daemon, as the caller of what it does by itself.
fn by_itself() -> Caller {
    let pid = std::process::id().cast_signed();
    Caller { client: u64::MAX, peer: Peer { uid: geteuid(), gid: getegid(), pid }, oneway: true }
}
