//! Drives the stops: takes the next step after the panel or a command line has stopped the target, or has failed to.

use std::time::Instant;

use log::{error, info, warn};
use nix::unistd::{getegid, geteuid};

use super::Service;
use crate::daemon::motion::effect::ended_by_stop;
use crate::daemon::motion::stops::{At, Seen, Stop};
use crate::daemon::motion::target::Target;
use crate::daemon::motion::timing::{PANEL_STOP_TAKES, STOP_AGAIN, STOP_LINE_TAKES, STOP_QUESTION_TAKES};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::peer::Peer;
use crate::daemon::shared::queue::{Command, LINE_MAX, Line, Origin, Outcome, Text};
use crate::daemon::socket::call_table::Then;
use crate::map::Motors;
use crate::protocol::{CallError, Function, Reply, control};

impl Service {
    /// Stops `target` by command line: the panel did not take the stop, or the daemon does not use the panel. `caller`
    /// waits for the stop. The stop `ends_hold` if a client held the motors, which must stand in the end.
    pub(super) fn stop_by_line(
        &mut self,
        target: Target,
        caller: Option<Caller>,
        ends_hold: bool,
        now: Instant,
    ) {
        let number = self.stops.begin(Stop::new(target, caller, ends_hold, At::Question, now));
        self.line_begins(number, target, now);
    }

    fn line_begins(&mut self, number: u64, target: Target, now: Instant) {
        let has_panel = self.uses(Function::Panel);
        if !self.uses(Function::Ascii) {
            if let Some(stop) = self.stops.get_mut(number) {
                stop.hopeless = !has_panel;
            }
            return self.stop_watched(number, now);
        }
        if has_panel {
            warn!(target: "audit", "the control panel did not take the stop of {target}; sends it as a command line");
        }
        self.send_first(target.question(), number, now + STOP_QUESTION_TAKES, now);
    }

    /// A step of stop `number` is over.
    pub(super) fn stop_step(&mut self, number: u64, lines: &[String], outcome: Outcome, now: Instant) {
        let Some(stop) = self.stops.get_mut(number) else { return };
        let (target, is_done) = (stop.target, outcome == Outcome::Done);
        match stop.at {
            At::Panel(_) | At::CallersPanel if is_done => self.stop_over(number, Ok(()), now),
            At::Panel(_) | At::CallersPanel => {
                if stop.at != At::CallersPanel {
                    let mask = target.motors().bits();
                    error!(target: "audit", "the board did not take the stop of a held jog (mask {mask:#04x})");
                }
                (stop.at, stop.begun) = (At::Question, now);
                self.line_begins(number, target, now);
            }
            At::Question => self.stop_addressed(number, lines, now),
            At::Line => self.line_ended(number, outcome, now),
            At::AbortAll if is_done => {
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
                // The board did not take ^A: the daemon has to request the stop again.
                stop.at = At::Watch;
                self.may_go_on(number, now);
            }
            At::Due(_) | At::Watch => {}
        }
    }

    /// Sends the line that stops, after the board has told the address and the open loops, or has not answered.
    fn stop_addressed(&mut self, number: u64, lines: &[String], now: Instant) {
        let (reported, motion) = (self.info.loops_left_open(), self.info.motion());
        let motor_status = self.info.family().status.motor;
        let Some(stop) = self.stops.get_mut(number) else { return };
        let target = stop.target;
        let addressed = lines.first().and_then(|line| line.trim().parse().ok());
        let loops = target.loops(lines, motor_status);
        // Where the answers do not tell a motor's loop, the report does. The report may date from just before the motor
        // began to move, so the daemon watches the motors that the line leaves out because of the report.
        let untold = target.motors().without(loops.told);
        let open = loops.open.and(untold.among(reported));
        stop.is_doubtful = untold.meets(reported);
        let unknown = untold.without(reported).without(motion.moving.and(motion.standing));
        tell_of_loops(target, open, unknown, reported);
        match target.line(open, addressed) {
            Some(line) => {
                stop.at = At::Line;
                info!(target: "audit", "pmacd sends {:?}", &*line);
                self.send_first(line, number, now + STOP_LINE_TAKES, now);
            }
            None if stop.is_doubtful => self.stop_watched(number, now),
            None => self.stop_over(number, Ok(()), now),
        }
    }

    /// The board has taken the line that stops, or not.
    fn line_ended(&mut self, number: u64, outcome: Outcome, now: Instant) {
        let has_panel = self.uses(Function::Panel);
        let Some(stop) = self.stops.get_mut(number) else { return };
        stop.taken = outcome == Outcome::Done;
        stop.error = if let Outcome::Error(error) = outcome { Some(error) } else { None };
        let is_without_effect = stop.error.is_some() || outcome.is_unsent();
        stop.hopeless = is_without_effect && !has_panel;
        let is_watched = stop.ends_hold || stop.is_doubtful;
        match (stop.target.motors().is_empty(), stop.taken) {
            (is_systems, true) if is_systems || !is_watched => self.stop_over(number, Ok(()), now),
            (true, _) => self.may_go_on(number, now),
            (false, _) => self.stop_watched(number, now),
        }
    }

    fn stop_watched(&mut self, number: u64, now: Instant) {
        if let Some(stop) = self.stops.get_mut(number) {
            stop.at = At::Watch;
        }
        self.tend_stops(now);
    }

    /// Asks the panel for the stops that are due, and checks the motors that should stand by now.
    pub(super) fn tend_stops(&mut self, now: Instant) {
        if let Some((number, motors)) = self.stops.due(now) {
            let ticket = self.calls.send_now(Job::EndHold(motors), now + PANEL_STOP_TAKES);
            // If the bus thread has no room for the request, the stop stays due.
            if let (Some(ticket), Some(stop)) = (ticket, self.stops.get_mut(number)) {
                stop.at = At::Panel(ticket);
            }
        }
        for (number, seen) in self.stops.seen(self.info.motion(), now) {
            let may_abort = self.stops.stop_all_after.is_some() && self.uses(Function::Ascii);
            let Some(stop) = self.stops.get_mut(number) else { continue };
            match seen {
                Seen::Open => {}
                Seen::Stand => self.stop_over(number, Ok(()), now),
                Seen::Move if stop.ends_hold && may_abort => {
                    stop.at = At::AbortAll;
                    let target = stop.target;
                    error!(target: "audit", "{target} may still move after its held jog is over: pmacd sends ^A");
                    self.abort_all(number, now);
                }
                Seen::Move => self.may_go_on(number, now),
            }
        }
    }

    fn abort_all(&mut self, number: u64, now: Instant) {
        let (caller, character, deadline) = (by_itself(), control::ABORT, now + STOP_LINE_TAKES);
        self.stop_all_begins(caller, character, true, now);
        let uid = caller.peer.uid.as_raw();
        let sent = self.calls.send_own(caller, deadline, Then::Stop(number), |ticket| Command::Control {
            drops_lines: true,
            ticket,
            uid,
            character,
            deadline,
        });
        if !sent {
            self.stop_step(number, &[], Outcome::Busy, now);
        }
    }

    /// The board has carried out a command to `motors`. If the board took their stop before, the command's sender may
    /// move them.
    pub(super) fn let_go(&mut self, motors: Motors, now: Instant) {
        for number in self.stops.let_go(motors) {
            self.stop_over(number, Ok(()), now);
        }
    }

    fn stop_over(&mut self, number: u64, result: Result<(), String>, now: Instant) {
        let Some(stop) = self.stops.over(number) else { return };
        match &result {
            Ok(()) => {
                if let Some(caller) = stop.caller {
                    // `note_effect` records the end by the caller's own request, as for every command of a client.
                    if stop.at != At::CallersPanel
                        && let Some(ends) = ended_by_stop(stop.target)
                    {
                        self.sent_stops.add(ends, caller, None, now);
                    }
                    self.has_stopped(stop.target, caller, now);
                }
            }
            Err(reason) => {
                error!(target: "audit", "{reason}");
                // After ^A no motor is left to stop.
                if stop.ends_hold && stop.at != At::AbortAll {
                    self.stops.begin_due(stop.target.motors(), now + STOP_AGAIN);
                }
            }
        }
        if let Some(caller) = stop.caller {
            let reply = result.map(|()| Reply::done()).map_err(|reason| CallError::StopFailed { reason });
            self.answer(caller, reply, now);
        }
    }

    /// The daemon has not seen the board take stop `number`: ends the stop, and tells its caller and the log that the
    /// motors may still move.
    fn may_go_on(&mut self, number: u64, now: Instant) {
        let panel = match self.uses(Function::Panel) {
            true => "the control panel did not take the stop, and ",
            false => "",
        };
        let Some(stop) = self.stops.get_mut(number) else { return };
        let line = match stop.error {
            Some(error) => format!("the board refused the command line (ERR{error:03})"),
            None => "no command line is known to have stopped it".to_owned(),
        };
        let reason = format!(
            "{} MAY STILL MOVE: {panel}{line}; pmacctl abort stops everything (^A), an emergency stop does so without the computer",
            stop.target
        );
        self.stop_over(number, Err(reason), now);
    }

    /// Sends `line` for stop `number`, ahead of all other lines. If the bus thread has no room, the step has failed.
    fn send_first(&mut self, line: Text<LINE_MAX>, number: u64, deadline: Instant, now: Instant) {
        let line = Line::of(&*line);
        let origin = Origin::of(geteuid().as_raw(), &line, true);
        let sent = self.calls.send_own(by_itself(), deadline, Then::Stop(number), |ticket| Command::First {
            ticket,
            line,
            origin,
            deadline,
        });
        if !sent {
            self.stop_step(number, &[], Outcome::Busy, now);
        }
    }
}

/// Logs the motors whose `open` loops the stop of `target` spares, the motors whose loops are `unknown`, and the
/// `reported` open loops that an abort closes.
fn tell_of_loops(target: Target, open: Motors, unknown: Motors, reported: Motors) {
    let (left_out, unknown) = (target.motors().among(open), target.motors().among(unknown));
    if !left_out.is_empty() {
        warn!(
            target: "audit",
            "motor {left_out} gets no stop: its loop is open (killed, or a fault), and J/ would close it"
        );
    }
    if !unknown.is_empty() {
        warn!(
            target: "audit",
            "the loop of motor {unknown} may be open, and J/ closes it then: neither ? nor a report tells"
        );
    }
    if !target.aborted().is_empty() && !reported.is_empty() {
        warn!(
            target: "audit",
            "the abort of {target} closes the loop of motor {reported}, which is open, if it belongs there"
        );
    }
}

/// The daemon as caller, for commands of its own.
fn by_itself() -> Caller {
    let pid = std::process::id().cast_signed();
    Caller { client: Caller::NOBODY, peer: Peer { uid: geteuid(), gid: getegid(), pid }, oneway: true }
}
