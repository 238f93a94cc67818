//! The board's side of `pmacctl gather`: the lines that begin a gather, and the board left as it was, however it went.
//!
//! `ENDGATHER` undoes the latest `GATHER`, which may be that of the servo report (DPRAM manual p. 14): it is sent only where
//! a `GATHER` of this program is to be undone. The period of gathering (I19) is the servo report's as well, and is put back
//! in every case.

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

/// How long the board may take to answer a line.
const LINE: Duration = Duration::from_secs(5);
/// How often to look whether the servo report runs.
const LOOK: Duration = Duration::from_millis(5);

/// The value of I-variable `variable`, as the board answers it.
pub fn ask(connection: &mut Connection, variable: u16) -> Result<String, Failure> {
    let lines = connection.send(&format!("I{variable}"), LINE)?;
    Ok(lines.first().map(|line| answer::text(line).to_owned()).unwrap_or_default())
}

/// Whether the board gathers, as after a `pmacctl gather` that was killed.
pub fn gathers(connection: &mut Connection, family: &Family) -> Result<bool, Failure> {
    let status = connection.send("???", LINE)?;
    Ok(status.first().is_some_and(|reply| reply_has(reply, family.status.global, "data_gathering_on")))
}

/// Ends gathering, where the board gathers.
pub fn end_gather(connection: &mut Connection) -> Result<(), Failure> {
    Ok(connection.send("ENDGATHER", LINE).map(drop)?)
}

/// What the latest `GATHER` of this program has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Begun {
    Nothing,
    /// The servo report.
    Report,
    Gathering,
}

/// The board from the first line that changes something on.
pub struct GatherBoard<'a> {
    connection: Connection,
    family: &'static Family,
    plan: &'a GatherPlan,
    /// The period of gathering as it was found.
    old_period: String,
    /// How the servo report stood, as far as was known.
    report: ServoReport,
    begun: Begun,
    /// Whether the daemon follows.
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

    /// Everything up to the `GATHER` that starts gathering. `silence` is how long the servo report may take to come.
    ///
    /// # Errors
    /// [`Failure`]; the board is as [`GatherBoard::finish`] has to find it.
    pub fn begin(
        &mut self,
        board: &Board,
        layout: &Layout,
        host_clock: Option<u64>,
        silence: Duration,
        stop: &Interrupt,
    ) -> Result<GatherFollower, Failure> {
        // A report that has just been ended counts as live for a moment more; the first `GATHER` starts it again. Looked at
        // while it still comes in its old period, by which the daemon judges.
        let ended = self.report == ServoReport::Running && !report_comes(board, silence, stop)?;
        for line in &self.plan.prepare {
            self.connection.send(line, LINE).map_err(|error| explain(line, error))?;
            if *line == self.plan.stop {
                self.say_what_was_ended();
            }
        }
        // The servo report's timer is the clock, and has to run before the daemon's first look.
        let starts = self.plan.start.iter().skip(1).chain(self.plan.start.first().filter(|_| ended));
        for line in starts {
            self.gather(line, Begun::Report)?;
            wait_for_report(board, self.family, silence, stop)?;
        }
        let told = self.connection.gather_begin(self.plan, layout, host_clock);
        // What did not answer may have taken it.
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
        // What may have been carried out may have to be undone.
        if matches!(result, Ok(_) | Err(LineError::Uncertain { .. })) {
            self.begun = begins;
        }
        Ok(result.map(drop)?)
    }

    /// Ends gathering on the board and puts the report's period back.
    ///
    /// # Errors
    /// [`Failure`]; what can still be done has been done.
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
            // A full buffer has ended its gather: what ENDGATHER would end then is the servo report.
            Begun::Gathering => {
                self.plan.mode == GatherMode::Stop
                    && matches!(gathers(&mut self.connection, self.family), Ok(false))
            }
        };
        if ended { Ok(()) } else { Ok(self.connection.send(&self.plan.stop, LINE).map(drop)?) }
    }

    /// As [`GatherBoard::finish`], after `failure`, which is the one that counts.
    pub fn give_up(&mut self, failure: Failure) -> Failure {
        if let Err(another) = self.finish() {
            // Nobody reads it: nothing to be done.
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

/// Whether the servo report still comes, seen by its next update.
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

/// Waits for the servo report, which the first `GATHER` starts where the board is told to report.
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
            let cure = i.reported.map_or_else(String::new, |reported| format!(" (is I{reported} above 0?)"));
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
