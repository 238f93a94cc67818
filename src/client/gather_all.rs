//! A gather from its beginning to its end, in one call.

use std::fmt::Display;
use std::time::{Duration, Instant};

use super::{Board, ClientError, CommandError, Connection, GatherPhase, GatherRun, Taken, identity};
use crate::gather::{GatherMode, GatherPlan, GatherRequest, SampleClock, Source, plan};
use crate::map::{BufferLayout, Layout};
use crate::protocol::{CallError, Function};

/// How long to sleep if no samples have come.
const LOOK: Duration = Duration::from_millis(5);
/// How often this program tells the daemon that it still follows.
const RENEWAL: Duration = Duration::from_millis(500);
/// How long the board may give no sample, beyond two periods.
const SILENCE: Duration = Duration::from_secs(5);

/// The samples of a gather.
#[derive(Debug)]
pub struct Gathered {
    /// The columns' titles: the source, and its unit in brackets.
    pub columns: Vec<String>,
    /// The number of each sample, from 0.
    pub numbers: Vec<u64>,
    /// The values, row by row.
    pub values: Vec<f64>,
    /// How many samples the board made in all.
    pub made: u64,
    /// When the board made each sample.
    pub clock: SampleClock,
}

impl Gathered {
    /// Samples that the board or the daemon overwrote before this program read them. Exact.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.made - self.numbers.len() as u64
    }

    /// When the board made each sample: seconds since the first.
    #[must_use]
    pub fn times(&self) -> Vec<f64> {
        self.numbers.iter().map(|number| self.clock.at(*number)).collect()
    }
}

fn refused(why: impl Display) -> ClientError {
    CommandError::from(CallError::refused(why)).into()
}

/// The gather had begun.
fn ended(why: impl Display) -> ClientError {
    ClientError::Gather(why.to_string())
}

/// `error`, of a gather that had begun: no call of which nothing was done.
fn of_begun(error: ClientError) -> ClientError {
    match error {
        ClientError::Socket(error) if error.is_uncertain() => error.into(),
        error => ended(error),
    }
}

/// What to gather, in the terms of the board.
struct Wish {
    plan: GatherPlan,
    layout: Layout,
    period_ns: f64,
    /// How many samples.
    wanted: u64,
}

/// Makes the board gather `sources` (`1.actual_position`, `servo_timer`, `Y:$C003`) each `period` servo cycles, for
/// `time`. `goes_on` is asked many times a second; when it says no, the gather ends and the result is `None`.
///
/// # Errors
/// [`ClientError`], also if the gather ends early, or not as the caller wants it to.
pub fn gather_all(
    board: &mut Board,
    mut connection: Connection,
    sources: &[String],
    (period, time): (u32, Duration),
    mut goes_on: impl FnMut() -> bool,
) -> Result<Option<Gathered>, ClientError> {
    let Wish { plan, layout, period_ns, wanted } = prepare(board, &mut connection, sources, period, time)?;
    let clock = SampleClock { period: plan.period, servo_period_ns: Some(period_ns) };
    let silence = SILENCE + Duration::from_nanos((2.0 * f64::from(plan.period) * period_ns) as u64);
    let mut run = GatherRun::new(board.follow_gather()?, plan.columns.clone());
    connection.gather_start(&plan, &layout, Some(period_ns.round() as u64))?;
    let (mut numbers, mut values) = (Vec::new(), Vec::new());
    let mut follow = || -> Result<bool, ClientError> {
        let (mut news, mut renewed) = (Instant::now(), Instant::now());
        while run.ended().is_none() && run.next() < wanted {
            let taken = run.take(board, Some(wanted), |number, row| {
                numbers.push(number);
                values.extend_from_slice(row);
                Ok::<(), ClientError>(())
            })?;
            match taken {
                Taken::Another => return Err(ended("somebody else started another gather")),
                Taken::Some => news = Instant::now(),
                Taken::Nothing if news.elapsed() > silence => {
                    let seconds = silence.as_secs_f64();
                    return Err(ended(format_args!(
                        "the board gathers nothing: no sample for {seconds:.0} s"
                    )));
                }
                Taken::Nothing => std::thread::sleep(LOOK),
            }
            if renewed.elapsed() > RENEWAL {
                renewed = Instant::now();
                match connection.sequence_renew() {
                    // The daemon has ended the gather, and says why in its reply to `gather_stop`.
                    Err(CommandError::Refused(_)) => return Ok(true),
                    renewed => renewed?,
                }
            }
            if !goes_on() {
                return Ok(false);
            }
        }
        Ok(true)
    };
    let followed = follow().map_err(of_begun);
    // In any case: no other client can gather before this.
    let stopped = connection.gather_stop(None);
    if !followed? {
        return match stopped {
            Ok(reply) if reply.notes.is_empty() => Ok(None),
            Ok(reply) => Err(ended(reply.notes.join("; "))),
            Err(error) if error.is_uncertain() => Err(error.into()),
            Err(error) => Err(ended(format_args!("the board may go on gathering: {error}"))),
        };
    }
    let (reason, notes) = match stopped {
        Ok(reply) => (reply.reason, reply.notes),
        Err(CommandError::Refused(error)) => (Some(error.to_string()), Vec::new()),
        Err(error) => return Err(of_begun(error.into())),
    };
    let made = run.next();
    let early = (made < wanted).then(|| early(run.ended(), reason));
    let early = early.map(|why| format!("gathering ended early, after {made} of {wanted} samples: {why}"));
    let said: Vec<String> = early.into_iter().chain(notes).collect();
    if !said.is_empty() {
        return Err(ended(said.join("; ")));
    }
    let columns = plan.columns.iter().map(|column| column.title()).collect();
    Ok(Some(Gathered { columns, numbers, values, made, clock }))
}

fn prepare(
    board: &mut Board,
    connection: &mut Connection,
    sources: &[String],
    period: u32,
    time: Duration,
) -> Result<Wish, ClientError> {
    let settings = connection.settings()?;
    let found = board.identity()?;
    let family = identity::family(&found).ok_or_else(|| refused("the board's family is not known"))?;
    let family = connection.info()?.sized(family);
    for function in [Function::Gather, Function::Ascii] {
        if !settings.functions.has(function) {
            let why = settings.functions.why_not(function, family);
            return Err(refused(format_args!("cannot gather: {why}")));
        }
    }
    let firmware = found.firmware.as_deref().and_then(|text| text.parse().ok());
    let (known, scales) = (Layout::new(family, firmware), identity::scales(&found));
    let layout = settings.layout(family, firmware);
    let parse = |text: &String| Source::parse(text, &known).map_err(refused);
    let sources: Vec<Source> = sources.iter().map(parse).collect::<Result<_, _>>()?;
    let sample_longs = sources.iter().map(Source::longs).sum();
    let kept = BufferLayout::new(&layout, &settings.plan).map_err(refused)?;
    let buffer_longs = kept.gather_size(sample_longs);
    let request = GatherRequest { sources, period, mode: GatherMode::Wrap, buffer_longs };
    let plan = plan(&request, &layout, &scales).map_err(refused)?;
    kept.check_gather(layout.gather().buffer, plan.buffer_longs, plan.sample_longs).map_err(refused)?;
    let period_ns =
        scales.servo_period_ns().ok_or_else(|| refused("the board has not told its servo period"))?;
    let wanted = (time.as_nanos() as f64 / (period_ns * f64::from(plan.period))).round() as u64;
    Ok(Wish { plan, layout, period_ns, wanted })
}

/// Why a gather has ended early.
fn early(ended: Option<GatherPhase>, reason: Option<String>) -> String {
    match ended {
        Some(GatherPhase::Redefined) => "the buffer was defined again, or the board was reset".to_owned(),
        Some(GatherPhase::Interrupted) => "gathering paused for an unknown number of samples".to_owned(),
        _ => reason.unwrap_or_else(|| "it was ended".to_owned()),
    }
}
