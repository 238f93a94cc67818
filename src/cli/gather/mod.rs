//! `pmacctl gather`: writes samples taken by the board at servo rate to a file.

mod prepared;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args as ClapArgs;
use serde_json::json;

pub use self::prepared::Prepared;
use crate::cli::act::lines::LineError;
use crate::cli::args::values::{seconds, table_path};
use crate::cli::console::{Interrupt, Progress, TableFile, is_stdout, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::plot::{PicturePath, check_drawable, draw_file};
use crate::client::{Board, CommandError, Connection, GatherPhase, GatherRun, Taken};
use crate::decode::Scales;
use crate::format::Visible;
use crate::gather::{GatherMode, GatherPlan, SampleClock, Source, fields};
use crate::language::{Meaning, deadlines};
use crate::map::Layout;
use crate::protocol::board::GatherStopReply;
use crate::protocol::check_line;

/// How long to sleep if there are no samples.
const TAKE_SAMPLES_EVERY: Duration = Duration::from_millis(5);
/// Beyond two periods, report a board without samples after this time.
const NO_SAMPLE_FOR: Duration = Duration::from_secs(5);
/// How often to tell the daemon that the owner still follows.
const RENEWAL: Duration = Duration::from_millis(500);

#[derive(Debug, ClapArgs)]
pub struct Gather {
    /// A register to sample: 1.actual_position, cs2.program_status, servo_timer, Y:$C003 (signed unless ,u follows), D:$002B
    #[arg(long, short, value_name = "SOURCE", required_unless_present = "stop")]
    source: Vec<String>,
    /// Servo cycles between samples (I19, meanwhile also the period of the servo report; I5049 on Turbo boards)
    #[arg(long, value_name = "CYCLES", default_value = "1")]
    period: u32,
    /// Stop after this time in seconds [default: at ^C, or with --once when the buffer is full]
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// The board's buffer in 32-bit longs, rounded up to whole samples [default: all that the daemon reserves]
    #[arg(long, value_name = "LONGS")]
    buffer: Option<u32>,
    /// Stop when the buffer is full (I45=2, I5000=2 on Turbo boards) instead of wrapping round
    #[arg(long)]
    once: bool,
    /// The file, ending in .csv or .npy; - is CSV on stdout
    #[arg(long, short, value_name = "FILE", value_parser = table_path, required_unless_present = "stop")]
    output: Option<PathBuf>,
    /// Draw the file at the end, as pmacctl plot does; the name ends in .svg
    #[arg(long, value_name = "FILE")]
    plot: Option<PicturePath>,
    /// Send this line, such as '#1J:1000', when the board gathers. The line may move the machine
    #[arg(long, value_name = "LINE", allow_hyphen_values = true)]
    then: Option<String>,
    /// End your gather, or a gather that somebody began by hand. Sends ENDGATHER only if the board gathers
    #[arg(long, conflicts_with_all = ["source", "period", "seconds", "buffer", "once", "output", "plot", "then"])]
    stop: bool,
    /// With --stop: end the gather of the user with this number
    #[arg(long, value_name = "UID", requires = "stop")]
    of: Option<u32>,
}

pub fn run(context: &mut Context, options: &Gather) -> Result<Verdict, Failure> {
    match &options.output {
        Some(output) => gather(context, options, output),
        None => stop(context, options.of),
    }
}

/// `gather --stop`.
fn stop(context: &mut Context, of: Option<u32>) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    let ended = connection.gather_stop(of)?;
    let GatherStopReply { gathered, uid, pid, period, notes, .. } = &ended;
    if context.output.is_json() {
        context.output.json(&ended)?;
    } else if *gathered {
        let variable = family.i.gather_period;
        let shared = if variable == family.i.servo_period { ", also the servo report's period," } else { "" };
        let period = period.as_deref().unwrap_or("not known");
        let whose = match ended.reason {
            Some(_) => format!(" of uid {uid} (pid {pid})"),
            None => String::new(),
        };
        context.output.line(format_args!("the gather{whose} has ended; I{variable}{shared} is {period}"))?;
    } else {
        context.output.line("the board gathers nothing; nothing was sent")?;
    }
    if notes.is_empty() { Ok(Verdict::Yes) } else { Err(Failure::Refused(notes.join("; "))) }
}

fn gather(context: &mut Context, options: &Gather, output: &Path) -> Result<Verdict, Failure> {
    let is_stdout = is_stdout(output);
    if options.plot.is_some() {
        check_drawable(output)?;
    }
    options.then.as_deref().map_or(Ok(()), check_then)?;
    let named = |layout: &Layout| options.source.iter().map(|text| Source::parse(text, layout)).collect();
    let mode = if options.once { GatherMode::Stop } else { GatherMode::Wrap };
    let mut prepared = Prepared::new(context, named, options.period, mode, options.buffer)?;
    let stop = Interrupt::listen()?;
    let fields = fields(&prepared.plan.columns, prepared.clock);
    let mut out = TableFile::open(output, &fields, &stop)?;
    let samples_of = match prepared.begin() {
        Ok(samples) => samples,
        Err(failure) => {
            out.discard();
            return Err(failure);
        }
    };
    let Prepared { mut board, mut connection, layout, plan, clock } = prepared;
    let silence = silence(&clock, &layout);
    let mut gather = Gathering {
        samples_of,
        plan: &plan,
        clock,
        silence,
        out,
        row: Vec::new(),
        samples: 0,
        is_silent: false,
    };
    let mut outcome = match &options.then {
        Some(line) => send(&mut connection, line),
        None => Ok(()),
    };
    if outcome.is_ok() {
        outcome = gather.until(&mut board, &mut connection, options.seconds, &stop);
    }
    // In every case: until the stop no other client can gather.
    let stopped = connection.gather_stop(None);
    if gather.is_silent && trouble(&stopped).is_none() {
        let seconds = gather.silence.as_secs_f64();
        let text = format!("the board gathers nothing: no sample for {seconds:.0} s");
        outcome = Err(Failure::Refused(text));
    } else if outcome.is_ok() && stopped.is_ok() && gather.samples_of.ended().is_none() && !gather.is_silent {
        outcome = gather.rest(&mut board, options.seconds);
    }
    let (samples, next, ended) = (gather.samples, gather.samples_of.next(), gather.samples_of.ended());
    if samples == 0 && (outcome.is_err() || gather.is_silent) {
        gather.out.discard();
    } else {
        let finished = gather.out.finish();
        outcome = outcome.and(finished);
    }
    if let Err(failure) = outcome {
        // The user already knows that the daemon is gone.
        if let (Ok(_) | Err(CommandError::Refused(_)), Some(trouble)) = (&stopped, trouble(&stopped)) {
            note(trouble);
        }
        return Err(failure);
    }
    let lost = next - samples;
    let less = gather.falls_short(options, stop.came());
    let span = clock.at(next);
    let unit = if clock.servo_period_ns.is_some() { "seconds" } else { "servo_cycles" };
    if context.output.is_json() && !is_stdout {
        context
            .output
            .json(&json!({ "samples": samples, "lost": lost, unit: span, "columns": plan.columns }))?;
    } else {
        let summary = format!("samples={samples} lost={lost} {unit}={span:.3}");
        if is_stdout {
            note(summary);
        } else {
            context.output.line(summary)?;
        }
    }
    // The daemon knows best why a gather has ended.
    let why = trouble(&stopped).or_else(|| why_ended(ended).map(str::to_owned));
    let so_far = if why.is_some() { Some(format!("{next} samples came, which are kept")) } else { None };
    let mut said: Vec<String> = why.into_iter().chain(less.or(so_far)).collect();
    let drawn = match &options.plot {
        Some(picture) if samples > 0 => draw_file(output, &[], picture),
        _ => Ok(()),
    };
    if said.is_empty() {
        return drawn.map(|()| Verdict::Yes);
    }
    said.extend(drawn.err().map(|failure| failure.to_string()));
    Err(Failure::Refused(said.join("; ")))
}

/// Refuses a line of `--then` that the board could not take, or that would keep further lines from the board.
fn check_then(line: &str) -> Result<(), Failure> {
    check_line(line).map_err(|reason| Failure::Request(format!("--then: invalid line: {reason}")))?;
    if Meaning::of(line).opens() {
        return Err(Failure::Request(format!(
            "--then: {line:?} opens a program buffer, which would keep the end of the gather from the board"
        )));
    }
    Ok(())
}

/// Sends the line of `--then` once the board gathers.
fn send(connection: &mut Connection, line: &str) -> Result<(), Failure> {
    let timeout = Meaning::of(line).deadline(deadlines::PLAIN);
    let reply = connection.send(line, timeout).map_err(LineError::from);
    let reply = reply.map_err(|error| {
        Failure::from(error)
            .at(format_args!("the line of --then, {line:?}, failed, and the gather was ended for that"))
    })?;
    reply.iter().for_each(|text| note(Visible(text)));
    Ok(())
}

/// Why no samples follow the last one, if the board should have gone on.
fn why_ended(phase: Option<GatherPhase>) -> Option<&'static str> {
    match phase {
        Some(GatherPhase::Redefined) => Some(
            "the buffer was defined again, the board was reset, or its index counts something else than longs",
        ),
        Some(GatherPhase::Interrupted) => Some("gathering paused for an unknown number of samples"),
        Some(GatherPhase::Running | GatherPhase::Ended) | None => None,
    }
}

/// The message when the daemon is gone during a gather.
fn gone(samples: u64) -> String {
    format!(
        "pmacd is gone, or does not answer; {samples} samples came, which are kept; the board may go on gathering, and I-variables may \
         stay as the gather set them: pmacctl gather --stop, when pmacd is there again"
    )
}

/// The message on the end of a gather, if anything went wrong.
fn trouble(stopped: &Result<GatherStopReply, CommandError>) -> Option<String> {
    let GatherStopReply { reason, notes, .. } = match stopped {
        Ok(reply) => reply,
        Err(error) => return Some(error.to_string()),
    };
    let reason = reason.iter().map(|why| format!("the gather was ended: {why}"));
    let said: Vec<String> = reason.chain(notes.iter().cloned()).collect();
    (!said.is_empty()).then(|| said.join("; "))
}

/// The longest silence of the board: two periods, since a period may just have begun, and [`NO_SAMPLE_FOR`]. If the
/// servo period is unknown, assumes the factory setting.
fn silence(clock: &SampleClock, layout: &Layout) -> Duration {
    let factory = || Scales { motors: Vec::new(), i10: Some(layout.family().default_i10) }.servo_period_ns();
    let cycle_ns = clock.servo_period_ns.or_else(factory).unwrap_or_default();
    NO_SAMPLE_FOR.saturating_add(Duration::from_nanos((2.0 * f64::from(clock.period) * cycle_ns) as u64))
}

/// A running gather.
struct Gathering<'a> {
    samples_of: GatherRun,
    plan: &'a GatherPlan,
    clock: SampleClock,
    /// Time limit without a sample.
    silence: Duration,
    out: TableFile,
    /// A row of the file.
    row: Vec<f64>,
    /// Samples written.
    samples: u64,
    /// No samples come.
    is_silent: bool,
}

impl Gathering<'_> {
    /// The number of samples in `seconds`.
    fn wanted(&self, seconds: Option<Duration>) -> Option<u64> {
        let period_ns = self.clock.servo_period_ns? * f64::from(self.plan.period);
        Some((seconds?.as_nanos() as f64 / period_ns).round() as u64)
    }

    /// Why fewer samples came than `options` ask for, or not all are in the file.
    fn falls_short(&self, options: &Gather, interrupted: bool) -> Option<String> {
        let (next, capacity) =
            (self.samples_of.next(), u64::from(self.plan.buffer_longs / self.plan.sample_longs));
        let lost = next - self.samples;
        let asked = match (self.wanted(options.seconds), options.once) {
            (Some(wanted), true) => Some(wanted.min(capacity)),
            (None, true) if options.seconds.is_none() => Some(capacity),
            (wanted, _) => wanted,
        };
        let cut_short = interrupted && (options.seconds.is_some() || options.once);
        match asked {
            Some(asked) if next < asked && cut_short => {
                Some(format!("interrupted: {next} of {asked} samples came"))
            }
            Some(asked) if next < asked => {
                Some(format!("gathering ended early: {next} of {asked} samples came"))
            }
            None if cut_short => Some("interrupted".to_owned()),
            _ if lost > 0 => Some(format!("{lost} samples were overwritten before they could be read")),
            _ => None,
        }
    }

    /// Takes samples until there are enough, the user interrupts, or the gather has ended.
    fn until(
        &mut self,
        board: &mut Board,
        connection: &mut Connection,
        seconds: Option<Duration>,
        stop: &Interrupt,
    ) -> Result<(), Failure> {
        let wanted = self.wanted(seconds);
        // The servo period is unknown: use the host's clock.
        let end =
            if wanted.is_none() { seconds.and_then(|time| Instant::now().checked_add(time)) } else { None };
        let (mut last_news, mut renewed, mut progress) =
            (Instant::now(), Instant::now(), Progress::on_terminal());
        while self.goes_on(wanted) && !stop.came() && end.is_none_or(|end| Instant::now() < end) {
            if self.take(board, wanted)? {
                last_news = Instant::now();
            } else if last_news.elapsed() > self.silence {
                self.is_silent = true;
                break;
            } else {
                std::thread::sleep(TAKE_SAMPLES_EVERY);
            }
            if renewed.elapsed() > RENEWAL {
                renewed = Instant::now();
                match connection.sequence_renew() {
                    // The daemon has ended the gather, and gives the reason on request.
                    Err(CommandError::Refused(_)) => break,
                    Ok(()) => {}
                    Err(_) => return Err(Failure::Request(gone(self.samples))),
                }
            }
            let next = self.samples_of.next();
            let (samples, lost) = (self.samples, next - self.samples);
            progress.show(|_| format!("samples={samples} lost={lost} {:.1} s", self.clock.at(next)));
        }
        progress.clear();
        Ok(())
    }

    /// Takes the remaining samples after the end.
    fn rest(&mut self, board: &mut Board, seconds: Option<Duration>) -> Result<(), Failure> {
        let wanted = self.wanted(seconds);
        let began = Instant::now();
        while self.goes_on(wanted) {
            if !self.take(board, wanted)? {
                if began.elapsed() > self.silence {
                    return Err(Failure::Request(
                        "the daemon did not report the end of the gather".to_owned(),
                    ));
                }
                std::thread::sleep(TAKE_SAMPLES_EVERY);
            }
        }
        Ok(())
    }

    /// Takes the next samples up to `wanted`. Returns whether there were any.
    fn take(&mut self, board: &mut Board, wanted: Option<u64>) -> Result<bool, Failure> {
        let Self { samples_of, out, row, clock, samples, .. } = self;
        let taken = samples_of.take(board, wanted, |number, values| {
            row.clear();
            row.extend([number as f64, clock.at(number)].iter().chain(values));
            out.row(row)?;
            *samples += 1;
            Ok::<(), Failure>(())
        })?;
        match taken {
            Taken::Another => Err(Failure::Refused("somebody else started another gather".to_owned())),
            taken => Ok(taken == Taken::Some),
        }
    }

    /// Whether samples up to `wanted` are still to come.
    fn goes_on(&self, wanted: Option<u64>) -> bool {
        self.samples_of.ended().is_none() && wanted.is_none_or(|wanted| self.samples_of.next() < wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn a_board_may_be_silent_for_as_long_as_its_period_takes() {
        let layout = Layout::new(&PMAC, None);
        let seconds = |period, servo_period_ns| {
            silence(&SampleClock { period, servo_period_ns }, &layout).as_secs_f64().round()
        };
        assert_eq!(seconds(1, Some(442_708.4)), 5.0);
        assert_eq!(seconds(22_588, Some(442_708.4)), 25.0);
        assert_eq!(seconds(22_588, None), 25.0, "as the factory has it");
        assert_eq!(seconds(8_388_607, Some(442_708.4)), 5.0 + 7427.0, "the longest there is");
    }
}
