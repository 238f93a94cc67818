//! `pmacctl tune`: makes the move by which a user judges a loop's gains, and reports how the motor followed the move.
//!
//! The daemon owns both ends: a sequence of lines restores the motor's jog variables, and the gather ends, whichever
//! process dies.

mod moves;
mod recorder;
mod response;

use std::borrow::Cow;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::json;

use self::moves::{ASKED, LONGEST_MS, Plan, Settings, TuneMove};
use self::recorder::{Record, Recorder};
use self::response::{BAND, Response, Settles};
use crate::cli::act::jog::{motor, send};
use crate::cli::act::wait::{Goal, Watch, is_no_replay, motors_end};
use crate::cli::args::values::{seconds, table_path};
use crate::cli::console::{Interrupt, TableFile, board_of, confirm, note};
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::cli::plot::{Figure, Panel, PicturePath, Trace, draw};
use crate::client::Connection;
use crate::client::command::lines::{LineSequence, LinesOptions};
use crate::client::number::{fixed, short};
use crate::language::deadlines;
use crate::map::IVariables;
use crate::table::{Field, FieldKind};

/// How long the motor may take to stand in position after the recording, and to come back.
const STANDS_WITHIN: Duration = Duration::from_secs(10);

/// The part of a recording to draw: this many times the motor's settling time.
const SHOWN: f64 = 4.0;

/// The largest distance, in counts, of the commanded position from the end of a whole move: the board rounds the
/// position so.
const END_WITHIN: f64 = 1.0 / 32.0;

/// `tune`.
#[derive(Debug, Args)]
pub struct Tune {
    #[command(subcommand)]
    command: TuneCommand,
}

#[derive(Debug, Subcommand)]
enum TuneCommand {
    /// Step the commanded position (in 2 ms), and time the motor's response
    Step {
        /// The size of the move in counts; below 0 in the negative direction
        #[arg(long, value_name = "COUNTS", default_value = "100", allow_negative_numbers = true)]
        size: f64,
        #[command(flatten)]
        common: Common,
    },
    /// Move with a velocity made of parabolas (a pure S-curve jog), to judge feed forward by the following error
    Parabolic {
        /// The size of the move in counts; below 0 in the negative direction
        #[arg(long, value_name = "COUNTS", default_value = "1000", allow_negative_numbers = true)]
        size: f64,
        /// How long the move takes, in ms [default: the shortest time that the motor's jogs allow, by Ix16, Ix17, Ix19
        /// and Ix22]
        #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u32).range(4..=i64::from(LONGEST_MS)))]
        time: Option<u32>,
        #[command(flatten)]
        common: Common,
    },
}

#[derive(Debug, Args)]
struct Common {
    /// The motor, by its number or its name in the configuration
    #[arg(value_name = "MOTOR")]
    motor: String,
    /// Kill the motor at this following error in counts (Ix11 during the move), unless its own limit is smaller [default:
    /// twice the size]
    #[arg(long, value_name = "COUNTS", value_parser = above_0)]
    limit: Option<f64>,
    /// How long to record after the move, in seconds
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = seconds, allow_negative_numbers = true)]
    seconds: Duration,
    /// Do not jog back. Without this the motor jogs back with its own jog speed
    #[arg(long)]
    stay: bool,
    /// Move without asking
    #[arg(long)]
    yes: bool,
    /// Write the recording to a file, ending in .csv or .npy
    #[arg(long, short, value_name = "FILE", value_parser = table_path)]
    output: Option<PathBuf>,
    /// Draw the recording; the name ends in .svg
    #[arg(long, value_name = "FILE")]
    plot: Option<PicturePath>,
}

/// The longest recording after a move.
const LONGEST_RECORDING: Duration = Duration::from_secs(60);

fn above_0(text: &str) -> Result<f64, String> {
    let limit = text.parse().ok().filter(|limit: &f64| *limit > 0.0 && limit.is_finite());
    limit.ok_or_else(|| "must be a number of counts above 0".to_owned())
}

/// The move that the user wants.
struct WantedMove<'a> {
    what: TuneMove,
    size: f64,
    common: &'a Common,
}

impl WantedMove<'_> {
    fn kind(&self) -> &'static str {
        match self.what {
            TuneMove::Step => "step",
            TuneMove::Parabolic(_) => "parabolic move",
        }
    }

    fn settles(&self) -> Settles {
        match self.what {
            TuneMove::Step => Settles::AfterBegin,
            TuneMove::Parabolic(_) => Settles::AfterEnd,
        }
    }
}

pub fn run(context: &mut Context, options: &Tune) -> Result<Verdict, Failure> {
    let wanted = match &options.command {
        TuneCommand::Step { size, common } => WantedMove { what: TuneMove::Step, size: *size, common },
        TuneCommand::Parabolic { size, time, common } => {
            WantedMove { what: TuneMove::Parabolic(*time), size: *size, common }
        }
    };
    if !wanted.size.is_finite() || (wanted.size * 32.0).round() == 0.0 {
        return Err(Failure::Request("--size must be a number of counts, 1/32 at least".to_owned()));
    }
    if wanted.common.seconds > LONGEST_RECORDING {
        return Err(Failure::Request(format!("--seconds is at most {}", LONGEST_RECORDING.as_secs())));
    }
    tune(context, &wanted)
}

fn tune(context: &mut Context, wanted: &WantedMove) -> Result<Verdict, Failure> {
    let WantedMove { what, common, .. } = wanted;
    let number = motor(&common.motor, || Ok(context.board()?.identity()?))?;
    let not_sent = |failure: Failure| failure.at("not sent");
    // The board rounds the end of a jog to this.
    let size = (wanted.size * 32.0).round() / 32.0;
    let mut connection = context.connection()?;
    check_numbers(Context::family(None, &mut connection)?, true, &[number])?;
    is_no_replay(&mut connection).map_err(not_sent)?;
    let mut recorder = Recorder::new(context, number).map_err(not_sent)?;
    let mut watch = Watch::begin(context, recorder.connection()).map_err(not_sent)?;
    watch.check_motors(&[number]).map_err(not_sent)?;
    let start = watch.standing_at(number).map_err(not_sent)?;
    let settings = ask(&mut connection, number).map_err(not_sent)?;
    let plan = Plan::new(*what, number, (start, size), common.limit, &settings)
        .map_err(|why| not_sent(Failure::Refused(why)))?;
    let tuning = Tuning { wanted, number, start, size, settings, plan };
    let Tuning { settings, plan, .. } = &tuning;
    plan.remark.iter().for_each(note);
    if !confirm(&tuning.question(context)?, common.yes)? {
        return Ok(Verdict::No);
    }
    // Another client may have changed the settings since the question.
    let now = ask(&mut connection, number).map_err(not_sent)?;
    if now != *settings {
        let why = settings.changes(&now, number);
        return Err(not_sent(Failure::Refused(format!("{why} since the question; begin again"))));
    }
    let stop = Interrupt::listen()?;
    let options = LinesOptions { kind: "tune", timeout: deadlines::PLAIN, keep_going: false };
    let mut lines = connection.lines(options);
    lines.at_end(settings.put_back(number));
    let most = plan.time_s + common.seconds.as_secs_f64();
    let record = recorder
        .record(&mut lines, most, &stop, |lines, connection| tuning.jog(lines, connection, &mut watch));
    let ended = lines.finish();
    let record = record?;
    let mut failed = match ended {
        Ok(reply) => reply.notes,
        Err(error) => {
            vec![format!("{error}; {} may stay as the move set them", plan.lines(number).join(" "))]
        }
    };
    failed.extend(record.failure.clone());
    let goal = if record.interrupted { Goal::Stands } else { Goal::At(start + size) };
    if record.interrupted {
        // The same ^C does not end the wait for the stop.
        watch = Watch::begin(context, recorder.connection())?;
    }
    let ends = failed.len();
    failed.extend(
        motors_end(recorder.connection(), &mut watch, &[number], goal, STANDS_WITHIN)
            .unwrap_or_else(|failure| vec![failure.to_string()]),
    );
    let has_stopped = failed.len() == ends;
    if failed.is_empty() && !record.interrupted && !common.stay {
        let back = back(context, recorder.connection(), number, start);
        failed.extend(back.unwrap_or_else(|failure| vec![failure.to_string()]));
    }
    // The command does not bring the motor back: after a disturbance no user expects another move. It reports the
    // distance.
    let away = watch.away_from(number, start, start + size).filter(|away| {
        (record.interrupted || !failed.is_empty()) && !(common.stay && (away - size).abs() <= END_WITHIN)
    });
    failed.extend(away.map(|away| is_away(number, start, away)));
    // A move that did not come to its end, or whose end the reports did not show, has no response to report.
    let is_seen = record.failure.is_none() && !record.interrupted && has_stopped;
    let is_whole =
        |response: &Response| is_seen && (response.size - size).abs() <= END_WITHIN + 0.01 * size.abs();
    let moved = record.recording.response(wanted.settles());
    let part = moved.as_ref().map(|response| response.size);
    let response = moved.filter(is_whole);
    tuning.print(context, &record, response.as_ref(), &failed)?;
    if let Some(path) = &common.output {
        write(path, &record, &stop)?;
    }
    if let Some(picture) = &common.plot {
        let title = format!("motor {number}: {} of {} counts", wanted.kind(), short(size));
        plot(&record, response.as_ref(), title, picture)?;
    }
    if record.interrupted {
        let was = if has_stopped { format!("; motor {number} was stopped") } else { String::new() };
        failed.insert(0, format!("interrupted{was}"));
    }
    if failed.is_empty() && response.is_none() {
        failed.push(match part {
            None => "the commanded position did not move".to_owned(),
            Some(part) => format!(
                "the recording has {} counts of the move's {}: a feed rate override stretches the move",
                fixed(part, 1),
                short(size)
            ),
        });
    }
    Verdict::without(&failed)
}

/// A move without an obstacle.
struct Tuning<'a> {
    wanted: &'a WantedMove<'a>,
    number: u8,
    /// The motor's position, and the length of the move, in counts.
    start: f64,
    size: f64,
    /// The motor's variables, to be restored.
    settings: Settings,
    plan: Plan,
}

impl Tuning<'_> {
    fn question(&self, context: &Context) -> Result<String, Failure> {
        let Self { wanted, number, start, size, plan, .. } = self;
        let (from, to, board) = (fixed(*start, 1), fixed(start + size, 1), board_of(context)?);
        let back = if wanted.common.stay { "" } else { " and back" };
        let [first, rest @ ..] =
            plan.lines(*number).try_into().unwrap_or([const { String::new() }; moves::SET.len()]);
        Ok(format!(
            "Motor {number} of {board} MOVES: a {} from {from} to {to} counts in {} s{back}, with {first} (fatal at {} counts) and {}, \
             which are put back. Move it?",
            wanted.kind(),
            short(plan.time_s),
            short(plan.limit),
            rest.join(" ")
        ))
    }

    /// Sets the jog variables in the sequence `lines`, and jogs the motor over `connection`.
    fn jog(
        &self,
        lines: &mut LineSequence<'_>,
        connection: &mut Connection,
        watch: &mut Watch,
    ) -> Result<(), Failure> {
        let Self { number, start, size, .. } = *self;
        run_lines(lines, &self.plan.lines(number))?;
        // Another client may have moved the motor since the question.
        let now = watch.standing_at(number).map_err(|failure| failure.at("not sent"))?;
        if now != start {
            let why = format!("motor {number} was at {}, and is at {} now", fixed(start, 1), fixed(now, 1));
            return Err(Failure::Refused(why).at("not sent"));
        }
        send(connection, number, start + size)?;
        // The board has planned the whole jog: a variable that changes now is for the next jog (Software Reference p. 76), which may be
        // another client's. If this fails, the end of the sequence puts the variables back.
        let _ = run_lines(lines, &self.settings.put_back(number)[1..]);
        Ok(())
    }

    /// Prints the counts, and the motor's response if the move was seen.
    fn print(
        &self,
        context: &mut Context,
        record: &Record,
        response: Option<&Response>,
        failed: &[String],
    ) -> Result<(), Failure> {
        let (samples, lost) = (record.recording.times.len(), record.lost);
        if context.output.is_json() {
            let Self { wanted, number, start, size, plan, .. } = self;
            return Ok(context.output.json(&json!({
                "motor": number, "kind": wanted.kind(), "start": start, "size": size,
                "time_s": plan.time_s, "limit": plan.limit, "samples": samples, "lost": lost, "response": response, "failed": failed,
            }))?);
        }
        context.output.line(format_args!("samples={samples} lost={lost}"))?;
        response.into_iter().flat_map(said).try_for_each(|line| context.output.line(line))?;
        // A killed motor's commanded position follows the motor: there was no move to a place.
        if response.is_none() {
            let most = record.recording.following_error().into_iter().map(f64::abs).fold(0.0, f64::max);
            context.output.line(format_args!("following error  {} counts at the most", fixed(most, 2)))?;
        }
        Ok(())
    }
}

/// Reports that motor `number` was not brought back to `start`.
fn is_away(number: u8, start: f64, away: f64) -> String {
    let (away, start) = (fixed(away, 1), short(start));
    format!(
        "motor {number} stands {away} counts from where it was; pmacctl jog {number} ={start} brings it back"
    )
}

/// The motor's variables.
fn ask(connection: &mut Connection, number: u8) -> Result<Settings, Failure> {
    let names = ASKED.map(|which| format!("I{}", IVariables::motor(number.into(), which)));
    let reply = connection.question(&names.join(" "), deadlines::PLAIN)?;
    let not_told = || Failure::Refused(format!("the board does not tell {}", names.join(" ")));
    Settings::of(reply).ok_or_else(not_told)
}

/// Runs `lines` in the sequence.
fn run_lines(sequence: &mut LineSequence<'_>, lines: &[String]) -> Result<(), Failure> {
    let mut refused = None;
    let goes_on = sequence.run(lines, |reply| {
        refused = reply.failure.as_ref().map(|failure| failure.message.clone());
        refused.is_none()
    })?;
    match refused {
        None if goes_on => Ok(()),
        refused => {
            Err(Failure::Refused(refused.unwrap_or_else(|| "the daemon ended the sequence".to_owned())))
        }
    }
}

/// Jogs the motor back to its start. Returns the failure.
fn back(
    context: &Context,
    connection: &mut Connection,
    number: u8,
    start: f64,
) -> Result<Vec<String>, Failure> {
    let mut watch = Watch::begin(context, connection)?;
    send(connection, number, start)?;
    motors_end(connection, &mut watch, &[number], Goal::At(start), STANDS_WITHIN)
}

/// The figures, one on a line.
fn said(response: &Response) -> [String; 4] {
    let ms = |time: Option<f64>| {
        time.map_or("not in the recording".to_owned(), |time| format!("{} ms", fixed(time * 1e3, 1)))
    };
    [
        format!("rise time        {} (10 % to 90 %)", ms(response.rise_time_s)),
        format!("overshoot        {} %", fixed(response.overshoot_percent, 1)),
        format!("settling time    {} (within {} %)", ms(response.settling_time_s), BAND * 100.0),
        format!(
            "following error  {} counts RMS, {} at the most",
            fixed(response.following_error_rms, 2),
            fixed(response.following_error_most, 2)
        ),
    ]
}

fn write(path: &std::path::Path, record: &Record, stop: &Interrupt) -> Result<(), Failure> {
    let fields = [
        Field::new("time_s", "", FieldKind::Seconds),
        Field::new("commanded_position", "count", FieldKind::Real),
        Field::new("actual_position", "count", FieldKind::Real),
    ];
    let mut file = TableFile::open(path, &fields, stop)?;
    let recording = &record.recording;
    for index in 0..recording.times.len() {
        file.row(&[recording.times[index], recording.commanded[index], recording.actual[index]])?;
    }
    file.finish()
}

fn plot(
    record: &Record,
    response: Option<&Response>,
    title: String,
    picture: &PicturePath,
) -> Result<(), Failure> {
    let recording = &record.recording;
    let begin = response.map_or(0.0, |response| response.begin);
    // The drawing ends soon after the motor has settled.
    let end = response.and_then(|response| Some(begin + SHOWN * (response.settled? - begin)));
    let shown = recording.times.iter().take_while(|time| end.is_none_or(|end| **time <= end));
    let places: Vec<f64> = shown.map(|time| (time - begin) * 1e3).collect();
    let error = recording.following_error();
    let trace = |name: &str, values| Trace { name: name.to_owned(), values: Cow::Borrowed(values) };
    let squeezed = |line: String| line.split_whitespace().collect::<Vec<_>>().join(" ");
    draw(
        &Figure {
            title,
            note: response
                .iter()
                .flat_map(|response| said(response))
                .map(squeezed)
                .collect::<Vec<_>>()
                .join(" · "),
            along: "time (ms)".to_owned(),
            places: &places,
            gaps: record.gaps.clone(),
            panels: vec![
                Panel {
                    label: "position (count)".to_owned(),
                    traces: vec![
                        trace("commanded", &recording.commanded),
                        trace("actual", &recording.actual),
                    ],
                },
                Panel {
                    label: "following error (count)".to_owned(),
                    traces: vec![trace("following error", &error)],
                },
            ],
        },
        picture,
    )
}
