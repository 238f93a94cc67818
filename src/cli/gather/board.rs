//! The board's side of `pmacctl gather`: starts a gather, and restores the board afterwards, also after an error.
//!
//! `ENDGATHER` undoes the latest `GATHER`, which may be that of the servo report (DPRAM manual p. 14). So it is sent only to
//! undo a `GATHER` of this program. I19 is the period of gathering and of the servo report, and is always restored.

use std::io::{self, Write};
use std::time::{Duration, Instant};

use crate::cli::act::lines::LineError;
use crate::cli::console::interrupt::Interrupt;
use crate::cli::context::Failure;
use crate::client::{Board, CommandError, Connection, GatherFollower};
use crate::gather::{GatherMode, GatherPlan, ServoReport};
use crate::map::status::reply_has;
use crate::map::{Family, Layout};
use crate::protocol::{CallError, answer};
use crate::segment::{RegionId, RegionState};

/// Time limit of a line.
const LINE: Duration = Duration::from_secs(5);
/// Period of the checks whether the servo report runs.
const LOOK: Duration = Duration::from_millis(5);

/// The value of I-variable `variable`, in the board's words.
pub fn ask(connection: &mut Connection, variable: u16) -> Result<String, Failure> {
    let lines = connection.send(&format!("I{variable}"), LINE)?;
    Ok(lines.first().map(|line| answer::text(line).to_owned()).unwrap_or_default())
}

/// Whether the board gathers. It still does after a `pmacctl gather` was killed.
pub fn gathers(connection: &mut Connection, family: &Family) -> Result<bool, Failure> {
    let status = connection.send("???", LINE)?;
    Ok(status.first().is_some_and(|reply| reply_has(reply, family.status.global, "data_gathering_on")))
}

/// Ends gathering. The caller knows that the board gathers.
pub fn end_gather(connection: &mut Connection) -> Result<(), Failure> {
    Ok(connection.send("ENDGATHER", LINE).map(drop)?)
}

/// What the latest `GATHER` of this program started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Begun {
    Nothing,
    /// The servo report.
    Report,
    Gathering,
}

/// The board, from the first line that changes it.
pub struct GatherBoard<'a> {
    connection: Connection,
    family: &'static Family,
    plan: &'a GatherPlan,
    /// The period of gathering before this gather.
    old_period: String,
    /// The state of the servo report before this gather, as far as it is known.
    report: ServoReport,
    begun: Begun,
    /// Whether the daemon follows the gather.
    followed: bool,
}

impl<'a> GatherBoard<'a> {
    pub fn new(
        connection: Connection,
        family: &'static Family,
        plan: &'a GatherPlan,
        old_period: String,
        report: ServoReport,
    ) -> Self {
        Self { connection, family, plan, old_period, report, begun: Begun::Nothing, followed: false }
    }

    /// Does everything up to the `GATHER` that starts gathering. `silence` is the time limit of the servo report's start.
    ///
    /// # Errors
    /// [`Failure`]. Then call [`GatherBoard::finish`].
    pub fn begin(
        &mut self,
        board: &Board,
        layout: &Layout,
        host_clock: Option<u64>,
        silence: Duration,
        stop: &Interrupt,
    ) -> Result<GatherFollower, Failure> {
        // A report that has just ended counts as live for a moment. Then the first `GATHER` starts it again. Check before the
        // period changes: the daemon judges by the old one.
        let ended = self.report == ServoReport::Running && !report_comes(board, silence, stop)?;
        for line in &self.plan.prepare {
            self.connection.send(line, LINE).map_err(|error| explain(line, error))?;
            if *line == self.plan.stop {
                self.say_what_was_ended();
            }
        }
        // The servo report's timer is the clock. It must run before the daemon's first poll.
        let starts = self.plan.start.iter().skip(1).chain(self.plan.start.first().filter(|_| ended));
        for line in starts {
            self.gather(line, Begun::Report)?;
            wait_for_report(board, self.family, silence, stop)?;
        }
        let told = self.connection.gather_begin(self.plan, layout, host_clock);
        // A daemon that did not answer may still have taken the call.
        self.followed = !matches!(told, Err(CommandError::Refused(_)));
        told?;
        Ok(board.follow_gather()?)
    }

    /// The `GATHER` that starts gathering.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn start(&mut self) -> Result<(), Failure> {
        self.plan.start.last().map_or(Ok(()), |line| self.gather(line, Begun::Gathering))
    }

    fn gather(&mut self, line: &str, begins: Begun) -> Result<(), Failure> {
        let result = self.connection.send(line, LINE).map_err(LineError::from);
        // The board may have executed a line without an answer: undo that one too.
        if matches!(result, Ok(_) | Err(LineError::Uncertain { .. })) {
            self.begun = begins;
        }
        Ok(result.map(drop)?)
    }

    /// Ends gathering on the board and restores the report's period.
    ///
    /// # Errors
    /// [`Failure`]. All other steps have been tried.
    pub fn finish(&mut self) -> Result<(), Failure> {
        let stopped = self.end();
        let told = if self.followed { self.connection.gather_end() } else { Ok(()) };
        let (old, variable) = (&self.old_period, self.family.i.gather_period);
        let put_back = if *old == self.plan.period.to_string() {
            Ok(())
        } else {
            self.connection.send(&format!("I{variable}={old}"), LINE).map(drop).map_err(|error| {
                let period = self.plan.period;
                Failure::Refused(format!("I{variable}={old}: {error}; I{variable} may still be {period}"))
            })
        };
        stopped?;
        told?;
        put_back
    }

    fn end(&mut self) -> Result<(), Failure> {
        let ended = match self.begun {
            Begun::Nothing => true,
            Begun::Report => false,
            // A full buffer has ended the gather already. ENDGATHER would now end the servo report.
            Begun::Gathering => {
                self.plan.mode == GatherMode::Stop
                    && matches!(gathers(&mut self.connection, self.family), Ok(false))
            }
        };
        if ended { Ok(()) } else { Ok(self.connection.send(&self.plan.stop, LINE).map(drop)?) }
    }

    /// As [`GatherBoard::finish`], after `failure`, which is returned.
    pub fn give_up(&mut self, failure: Failure) -> Failure {
        if let Err(another) = self.finish() {
            // If stderr is closed, the message is lost.
            let _ = writeln!(io::stderr(), "{another}");
        }
        failure
    }

    fn say_what_was_ended(&self) {
        let (period, variable) = (&self.old_period, self.family.i.gather_period);
        let _ = writeln!(
            io::stderr(),
            "the board was gathering already, every I{variable}={period} servo cycles: that has been ended (by whom it was \
             begun is not known; I{variable} stays {period} afterwards)"
        );
    }
}

/// Waits for an update to see whether the servo report runs.
fn report_comes(board: &Board, silence: Duration, stop: &Interrupt) -> Result<bool, Failure> {
    let region = || board.subscriber().region(RegionId::Servo).map_err(Failure::request);
    let first = region()?;
    let limit = silence.saturating_add(Duration::from_nanos(first.period_ns.saturating_mul(2)));
    let began = Instant::now();
    while region()?.state == RegionState::Live && began.elapsed() < limit && !stop.came() {
        if region()?.published != first.published {
            return Ok(true);
        }
        std::thread::sleep(LOOK);
    }
    if stop.came() { Err(interrupted()) } else { Ok(false) }
}

fn interrupted() -> Failure {
    Failure::Refused("interrupted before the first sample".to_owned())
}

/// Waits for the servo report. If it is enabled, the first `GATHER` starts it.
fn wait_for_report(
    board: &Board,
    family: &Family,
    silence: Duration,
    stop: &Interrupt,
) -> Result<(), Failure> {
    let began = Instant::now();
    while board.subscriber().region(RegionId::Servo).map_err(Failure::request)?.state != RegionState::Live {
        if stop.came() {
            return Err(interrupted());
        }
        if began.elapsed() > silence {
            let i = &family.i;
            let cure = i
                .reported
                .map_or_else(String::new, |reported| format!(" (check that I{reported} is above 0)"));
            return Err(Failure::Refused(format!(
                "I{}=1 and GATHER start no servo report{cure}, so turns of the buffer cannot be counted",
                i.servo_enable
            )));
        }
        std::thread::sleep(LOOK);
    }
    Ok(())
}

fn explain(line: &str, error: CommandError) -> Failure {
    match &error {
        CommandError::Refused(CallError::Board { .. }) if line.starts_with("DEFINE") => {
            Failure::Refused(format!(
                "{line}: {error}; if a gather waits for its trigger, `pmacctl send ENDGATHER` ends that (and the servo report where none waits: GATHER starts it again)"
            ))
        }
        _ => Failure::from(error),
    }
}
