//! `pmacctl log`: writes every servo update to a file, until its end.
//!
//! | file | content |
//! |---|---|
//! | `row` | the columns of a line; [`crate::table::csv`] writes it as text |
//! | `files`, `series` | one file or a series of files; a full disk |
//! | `words` | the columns of the site's own words |
//! | `trigger` | when to begin, and the rows from before the trigger |
//! | `wait` | the waits of a log, and the notes about them |

mod files;
mod row;
mod series;
mod trigger;
mod wait;
mod words;

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::json;

use self::files::{Files, Pauses, Rotation, RowMeaning, Tally};
use self::row::{LogRows, TIME};
use self::trigger::{Before, Condition};
use self::wait::{LongWait, SAY_AFTER, Silence};
use self::words::Words;
use crate::cli::args::values::{bytes, number, seconds, table_path};
use crate::cli::console::{Interrupt, is_stdout, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::plot::{PicturePath, check_drawable, draw_file};
use crate::cli::show::motors::reason;
use crate::client::{Board, Follower, Gap, Staleness, Step, View, identity};
use crate::decode::ServoData;
use crate::segment::{Identity, RegionId};

/// The sleep between two looks for updates: a small part of the time for which the segment keeps an update.
const TAKE_UPDATES_EVERY: Duration = Duration::from_millis(20);
/// The time that the board has to tell the scales. After it, the log fixes the columns without them.
const SCALES: Duration = Duration::from_secs(5);
/// After this time the log says that it waits for scales.
const SCALES_SILENT: Duration = Duration::from_secs(1);
/// A daemon that has run for so long has asked the board for its type and its scales, if it asks at all.
const ASKED: Duration = Duration::from_secs(10);

#[derive(Debug, Args)]
pub struct Log {
    /// The file, ending in .csv or .npy; - is CSV on stdout
    #[arg(long, short, value_name = "FILE", value_parser = table_path)]
    output: PathBuf,
    /// Only these motors, as 1,2 [default: all reported motors]
    #[arg(long, value_name = "N,N", value_delimiter = ',', value_parser = number)]
    motors: Vec<u8>,
    /// Only these fields, named as in `motors --json`, and user.NAME for a word of `watch user` [default: commanded_position,
    /// actual_position, following_error, velocity, servo_status, all words]. While the board has not told the scales, as after a reset, an update is a row without values and
    /// counts as missed
    #[arg(long, value_name = "FIELD,FIELD", value_delimiter = ',')]
    fields: Vec<String>,
    /// Stop after this time in seconds, from the trigger on if there is one [default: at ^C]
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// Begin another file (run-000001.csv and following for run.csv) when the file has this many bytes (100M) or a quarter
    /// of --keep
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    rotate_bytes: Option<u64>,
    /// Begin another file after this time, in seconds
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    rotate_seconds: Option<Duration>,
    /// Remove the oldest files of the series, so that all take at most this many bytes (10G). A file that another log
    /// writes stays
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    keep: Option<u64>,
    /// Draw the file at the end, as pmacctl plot does; the name ends in .svg
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rotate_bytes", "rotate_seconds", "keep"])]
    plot: Option<PicturePath>,
    /// Begin when this condition is true, at time 0: '1.following_error>100', '|1.following_error|>100', '1.open_loop',
    /// '!1.open_loop', 'user.NAME>3', 'user.NAME[2]>3'
    #[arg(long, value_name = "CONDITION")]
    trigger: Option<Condition>,
    /// With --trigger: write the updates of this time before it, too, in seconds
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = seconds, requires = "trigger")]
    before: Duration,
}

/// The most numbers to keep from before the trigger: 256 MiB of them.
const MOST_BEFORE: f64 = (1 << 25) as f64;

pub fn run(context: &mut Context, options: &Log) -> Result<Verdict, Failure> {
    if options.plot.is_some() {
        check_drawable(&options.output)?;
    }
    let mut board = context.board()?;
    let stop = Interrupt::listen()?;
    let began_ns = board.subscriber().now_ns();
    let end_ns = end_after(options, began_ns);
    let word = options.trigger.as_ref().and_then(Condition::word);
    let mut run = Logging {
        options,
        stop,
        // Without a trigger the log begins at once.
        end_ns: end_ns.filter(|_| options.trigger.is_none()),
        before: options.trigger.as_ref().map(|_| Before::new(options.before.as_nanos() as u64)),
        output: None,
        words: Words::new(&mut board, &options.fields, word.as_deref())?,
        servo_period_ns: None,
        can_tell: true,
        scales: LongWait::default(),
        trigger: LongWait::default(),
        over: false,
        silent: None,
    };
    let mut follower = Follower::new(&mut board)?;
    let mut silence = Silence::default();
    loop {
        let identity = board.identity()?;
        run.servo_period_ns = identity::scales(&identity).servo_period_ns();
        let up_ns = board.subscriber().now_ns().saturating_sub(board.subscriber().header().created_ns);
        let may_tell = identity.board_type.is_some() || Duration::from_nanos(up_ns) < ASKED;
        run.can_tell = may_tell && lacks_scales(&identity, &options.motors);
        let mut steps = Vec::new();
        // Read the clock first: an update that comes while the log takes updates must not count as missing.
        let (now_ns, has_ended) = (board.subscriber().now_ns(), run.stop.came());
        let stale = follower.advance(&mut board, |step| {
            steps.push(step);
            Ok::<_, Failure>(())
        })?;
        run.words.advance(&mut board)?;
        let came = !steps.is_empty();
        steps.into_iter().try_for_each(|step| run.take(step))?;
        if let Some(output) = &mut run.output {
            output.files.tend()?;
        }
        if run.over || has_ended || run.end_ns.is_some_and(|end| now_ns >= end) {
            let pause_ns =
                board.subscriber().region(RegionId::Servo).map_err(Failure::request)?.stale_after_ns;
            run.end(now_ns, pause_ns, stale)?;
            break;
        }
        silence.note(came, stale, &mut board);
        run.say_what_triggers();
        std::thread::sleep(TAKE_UPDATES_EVERY);
    }
    finish(context, &mut board, run)
}

/// A running log.
struct Logging<'a> {
    options: &'a Log,
    stop: Interrupt,
    /// By the segment's clock; `None` without an end, and while the trigger has not set the end.
    end_ns: Option<u64>,
    /// The rows from before the trigger; `None` after the trigger.
    before: Option<Before>,
    /// Since the first update.
    output: Option<Output>,
    words: Words,
    servo_period_ns: Option<f64>,
    /// Whether the board may still tell its scales: `pmacd` asks for them, or has just begun.
    can_tell: bool,
    /// The waits for scales and for the trigger.
    scales: LongWait,
    trigger: LongWait,
    /// Whether an update from after the end has come.
    over: bool,
    /// A pause at the end: the time without an update, and its reason.
    silent: Option<(Duration, Option<Staleness>)>,
}

struct Output {
    rows: LogRows,
    files: Files,
}

impl Logging<'_> {
    /// Takes the next step.
    fn take(&mut self, step: Step) -> Result<(), Failure> {
        if self.over {
            return Ok(());
        }
        match step {
            Step::Update(update) if self.end_ns.is_some_and(|end| update.time_ns >= end) => {
                self.over = true;
                Ok(())
            }
            Step::Update(update) => self.update(&update),
            Step::Gap(gap) => {
                // Before the first update nothing is missing.
                let Some(Output { rows, files }) = &mut self.output else { return Ok(()) };
                if gap.missed + gap.lost == 0 {
                    rows.pause();
                }
                if let Some(before) = &mut self.before {
                    before.keep_gap(gap, rows.gap(gap));
                    return Ok(());
                }
                files.row(rows.gap(gap), RowMeaning::Gap(gap))
            }
        }
    }

    /// Ends the log. A pause after the last update needs a row of its own: no later update reports that pause.
    fn end(&mut self, now_ns: u64, pause_ns: u64, stale: Option<Staleness>) -> Result<(), Failure> {
        let Some(Output { rows, files }) = self.output.as_mut().filter(|_| !self.over) else { return Ok(()) };
        let silent_ns = rows.silent_ns(self.end_ns.unwrap_or(now_ns).min(now_ns));
        if silent_ns < pause_ns || self.before.is_some() {
            return Ok(());
        }
        let silent = Duration::from_nanos(silent_ns);
        self.silent = Some((silent, stale));
        files
            .row(rows.pause_at_end(silent_ns), RowMeaning::Gap(Gap { pause: Some(silent), ..Gap::default() }))
    }

    /// Whether to wait for the scales of `lacking` with the first row: a log that begins just after `pmacd` would be raw to
    /// its end.
    fn waits_for_scales(&mut self, lacking: &[&str]) -> bool {
        let told = || {
            let (names, most) = (lacking.join(", "), SCALES.as_secs());
            format!("the board has not told what scales {names}; waiting for that, at most {most} s")
        };
        !lacking.is_empty() && self.can_tell && self.scales.go_on(SCALES_SILENT, told) < SCALES
    }

    /// Says that the log waits for the trigger, when updates come.
    fn say_what_triggers(&mut self) {
        if let (Some(trigger), Some(_), Some(_)) = (&self.options.trigger, &self.before, &self.output) {
            self.trigger.go_on(SAY_AFTER, || format!("waiting for {trigger}; ^C ends it"));
        }
    }

    fn update(&mut self, update: &View<ServoData>) -> Result<(), Failure> {
        if self.output.is_none() {
            let rows = planned(self.options, update, self.servo_period_ns, &self.words)?;
            if self.waits_for_scales(&rows.unscaled(&update.data)) {
                // The time counts from the first row.
                self.end_ns = self.end_ns.and_then(|_| end_after(self.options, update.time_ns));
                return Ok(());
            }
            self.output = Some(begin(self.options, rows, update, &self.stop)?);
        }
        let Some(Output { rows, files }) = &mut self.output else { return Ok(()) };
        if rows.lacks_scales(&update.data) {
            let row = rows.unscaled_update(update, &mut self.words);
            let Some(before) = &mut self.before else { return files.row(row, RowMeaning::Unscaled) };
            before.keep(update.time_ns, RowMeaning::Unscaled, row);
            return Ok(());
        }
        let Some(before) = &mut self.before else {
            return files.row(rows.update(update, &mut self.words), RowMeaning::Update);
        };
        let word = self.words.of_trigger(update.time_ns);
        if !self.options.trigger.as_ref().is_some_and(|trigger| trigger.is_met(&update.data, word)) {
            before.keep(update.time_ns, RowMeaning::Update, rows.update(update, &mut self.words));
            return Ok(());
        }
        note(format_args!("triggered at update {}", update.sequence));
        rows.update(update, &mut self.words);
        let trigger = rows.zero();
        for (meaning, mut row) in before.take() {
            row[TIME] -= trigger;
            files.row(&row, meaning)?;
        }
        self.before = None;
        self.end_ns = end_after(self.options, update.time_ns);
        files.row(rows.update(update, &mut self.words), RowMeaning::Update)
    }
}

/// Whether the board has yet to tell the servo period, or the scale of one of `motors` (all motors if empty). A scale
/// of 0 counts as told.
fn lacks_scales(identity: &Identity, motors: &[u8]) -> bool {
    let reported = identity.motor_mask.unwrap_or_default();
    let is_logged =
        |motor: &u8| reported >> (motor - 1) & 1 != 0 && (motors.is_empty() || motors.contains(motor));
    let mut numbers = (1..=32_u8).filter(is_logged);
    identity.i10.is_none() || numbers.any(|motor| identity.ix08[usize::from(motor) - 1].is_none())
}

/// The end of a log that begins at `began_ns`.
fn end_after(options: &Log, began_ns: u64) -> Option<u64> {
    options.seconds.map(|time| began_ns.saturating_add(time.as_nanos() as u64))
}

/// The rows: the user's motors and fields, by their places in the first update.
fn planned(
    options: &Log,
    first: &View<ServoData>,
    servo_period_ns: Option<f64>,
    words: &Words,
) -> Result<LogRows, Failure> {
    let motors: Vec<usize> = options.motors.iter().map(|motor| usize::from(*motor)).collect();
    let rows = LogRows::new(first, &motors, &options.fields, servo_period_ns)?.with(words);
    if let Some(mistake) = options.trigger.as_ref().and_then(|trigger| trigger.mistake(&first.data)) {
        return Err(Failure::Request(mistake));
    }
    Ok(rows)
}

/// Says what the first update lacks, and opens the file.
fn begin(options: &Log, rows: LogRows, first: &View<ServoData>, stop: &Interrupt) -> Result<Output, Failure> {
    let unscaled = rows.unscaled(&first.data);
    if !unscaled.is_empty() {
        let names = unscaled.join(", ");
        note(format_args!(
            "{names}: the board has not told the scale: values are the registers' integers, and time without one is in servo cycles"
        ));
    }
    if let Some(why) = options.trigger.as_ref().and_then(|trigger| trigger.lacks_scale(&first.data)) {
        note(why);
    }
    let fields = rows.fields();
    let numbers =
        options.before.as_nanos() as f64 / rows.servo_period_ns().unwrap_or(1e5) * fields.len() as f64;
    if options.trigger.is_some() && numbers > MOST_BEFORE {
        return Err(Failure::Request(
            "--before: that is too much to keep in memory; name fewer motors or fields".to_owned(),
        ));
    }
    let unknown = rows.without_value(&first.data);
    if !unknown.is_empty() {
        let names = unknown.join(", ");
        note(format_args!("{names}: pmacd does not have it from the board; it is NaN until it does"));
    }
    let rotation = Rotation { bytes: options.rotate_bytes, age: options.rotate_seconds, keep: options.keep };
    Ok(Output { rows, files: Files::open(&options.output, fields, rotation, stop)? })
}

fn finish(context: &mut Context, board: &mut Board, run: Logging) -> Result<Verdict, Failure> {
    let options = run.options;
    let waited_in_vain = run.before.is_some();
    let Some(Output { mut files, .. }) = run.output else {
        summarize(context, options, Default::default(), None)?;
        return Err(Failure::Refused(match run.scales.has_begun() {
            true => "it ended before the board had told its scales; nothing is written".to_owned(),
            false => no_update(board),
        }));
    };
    let finished = files.finish();
    let tally = files.tally();
    let Tally { updates, .. } = tally;
    if updates == 0 {
        files.discard();
    }
    finished?;
    let unscaled = files.unscaled();
    if unscaled > 0 {
        note(format_args!(
            "{unscaled} of the missed were read, but the board had not told the scale (Ix08) again after a reset or a start of pmacd"
        ));
    }
    let pauses = files.pauses();
    if let Some(said) = said_of_pauses(pauses) {
        note(said);
    }
    summarize(context, options, (tally, pauses), (updates > 0).then(|| files.present()))?;
    if waited_in_vain {
        return Err(Failure::Refused("the trigger never came; nothing is written".to_owned()));
    }
    let mut said: Vec<String> = said_of_lost(files.lost()).into_iter().collect();
    if let Some((time, stale)) = run.silent {
        let why = stale.map_or_else(String::new, |stale| format!(" ({})", stale.name()));
        said.push(format!("no update came for the last {:.1} s{why}", time.as_secs_f64()));
    }
    let drawn = match &options.plot {
        Some(picture) if updates > 0 => draw_file(&options.output, &[], picture),
        _ => Ok(()),
    };
    if said.is_empty() {
        return drawn.map(|()| (updates > 0).into());
    }
    said.extend(drawn.err().map(|failure| failure.to_string()));
    Err(Failure::Refused(said.join("; ")))
}

/// The message of a log without an update.
fn no_update(board: &mut Board) -> String {
    let stale =
        board.snapshot().ok().and_then(|snapshot| snapshot.servo.map_or(snapshot.stale, |servo| servo.stale));
    let why = stale.map_or_else(String::new, |stale| format!(": {}", reason(board, stale)));
    format!("no update came{why}")
}

/// The last line: the counts of the files; `present` is the last file.
fn summarize(
    context: &mut Context,
    options: &Log,
    (Tally { updates, missed, lost }, pauses): (Tally, Pauses),
    present: Option<PathBuf>,
) -> Result<(), Failure> {
    if context.output.is_json() && !is_stdout(&options.output) {
        let document = json!({
            "updates": updates, "lost": lost, "missed": missed, "pauses": pauses.count,
            "paused_s": pauses.time.as_secs_f64(), "file": present,
        });
        return Ok(context.output.json(&document)?);
    }
    let summary = format!("updates={updates} lost={lost} missed={missed}");
    if is_stdout(&options.output) {
        note(summary);
        return Ok(());
    }
    Ok(context.output.line(summary)?)
}

/// The note on pauses.
fn said_of_pauses(Pauses { count, time }: Pauses) -> Option<String> {
    let plural = if count == 1 { "" } else { "s" };
    (count > 0).then(|| {
        format!(
            "{count} pause{plural} of the board or of pmacd, {:.1} s in all: the updates in that time, if the board made any, are \
             not counted; rows without values, missed=0 and lost=0, say where",
            time.as_secs_f64()
        )
    })
}

/// The note on lost updates: `told` are in a row of the file, `at_end` in none.
fn said_of_lost((told, at_end): (u64, u64)) -> Option<String> {
    let not_in = format!("{} updates are not in the file", told + at_end);
    match (told, at_end) {
        (0, 0) => None,
        (_, 0) => Some(format!("{not_in}; its rows with lost > 0 say where")),
        (0, _) => Some(format!("{not_in}: behind its last row there was no room until the end")),
        _ => Some(format!(
            "{not_in}; its rows with lost > 0 say where, but for {at_end} behind its last row: there was no room until the end"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_disk_that_stays_full_no_row_is_promised() {
        for (lost, said) in [
            ((0, 0), None),
            ((5, 0), Some("5 updates are not in the file; its rows with lost > 0 say where")),
            (
                (0, 7),
                Some("7 updates are not in the file: behind its last row there was no room until the end"),
            ),
            (
                (5, 7),
                Some(
                    "12 updates are not in the file; its rows with lost > 0 say where, but for 7 behind its last row: there was \
                     no room until the end",
                ),
            ),
        ] {
            assert_eq!(said_of_lost(lost).as_deref(), said, "{lost:?}");
        }
    }
}
