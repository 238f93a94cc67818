//! Records commanded and actual position of one motor, every servo cycle, while it moves.

use std::time::{Duration, Instant};

use super::response::Recording;
use crate::cli::console::Interrupt;
use crate::cli::context::{Context, Failure};
use crate::cli::gather::Prepared;
use crate::client::command::lines::LineSequence;
use crate::client::{Connection, GatherRun, Taken};
use crate::function::panel::PanelAction;
use crate::gather::{GatherMode, Source, SourceError};
use crate::map::Layout;

/// The sleep when no samples have come.
const TAKE_SAMPLES_EVERY: Duration = Duration::from_millis(5);
/// How often to tell the daemon that the owner still follows.
const RENEWAL: Duration = Duration::from_millis(500);
/// How long the board may be silent, and how long a motor may take to begin.
const NO_SAMPLE_FOR: Duration = Duration::from_secs(5);
/// The part of the recording from before the move.
const BEFORE: f64 = 0.1;

/// A recording.
#[derive(Debug, Default)]
pub struct Record {
    pub recording: Recording,
    /// Samples missing from the recording, and the indices of the samples after each gap.
    pub lost: u64,
    pub gaps: Vec<usize>,
    /// The user interrupted the recording; the motor was stopped.
    pub interrupted: bool,
    /// Another cause that ended the recording.
    pub failure: Option<String>,
    /// The number of the next sample.
    next: u64,
}

/// A gather of one motor.
pub struct Recorder {
    prepared: Prepared,
    number: u8,
    cycle_s: f64,
}

/// The sources for motor `number`, the actual position last.
fn sources(number: u8, layout: &Layout) -> Result<Vec<Source>, SourceError> {
    let source = |name: &str| Source::parse(&format!("{number}.{name}"), layout);
    ["commanded_position", "actual_position"].into_iter().map(source).collect()
}

impl Recorder {
    /// A recorder of motor `number`. Sends no line yet.
    ///
    /// # Errors
    /// [`Failure`] says what the recorder cannot record.
    pub fn new(context: &Context, number: u8) -> Result<Self, Failure> {
        let named = |layout: &Layout| sources(number, layout);
        let prepared = Prepared::new(context, named, 1, GatherMode::Wrap, None)?;
        let columns = &prepared.plan.columns;
        let cycle_ns =
            prepared.clock.servo_period_ns.filter(|_| columns.iter().all(|column| column.unit == "count"));
        let Some(cycle_ns) = cycle_ns else {
            let why = format!("the scales of motor {number}, or the servo period, are not known yet");
            return Err(Failure::Refused(why));
        };
        Ok(Self { prepared, number, cycle_s: cycle_ns / 1e9 })
    }

    /// The connection that gathers.
    pub fn connection(&mut self) -> &mut Connection {
        &mut self.prepared.connection
    }

    /// Has `jog` move the motor once the board gathers, and records until so many seconds after the begin of the
    /// motion. Keeps the sequence `lines` alive meanwhile.
    ///
    /// # Errors
    /// The failure of `jog`, or [`Failure`] if the board does not gather. The record tells later failures.
    pub fn record(
        &mut self,
        lines: &mut LineSequence<'_>,
        seconds: f64,
        stop: &Interrupt,
        jog: impl FnOnce(&mut LineSequence<'_>, &mut Connection) -> Result<(), Failure>,
    ) -> Result<Record, Failure> {
        let mut samples = self.prepared.begin()?;
        let mut record = Record::default();
        let jogged = jog(lines, &mut self.prepared.connection);
        if jogged.is_ok() {
            let followed = self.follow(&mut samples, &mut record, seconds, stop, lines);
            record.failure = followed.err().map(|failure| failure.to_string());
        }
        // The end of the gather may take its time. If the sequence has ended, its end tells why.
        let _ = lines.renew();
        let stopped = self.prepared.connection.gather_stop(None);
        jogged?;
        let (why, untidy) = match stopped {
            Ok(reply) => (reply.reason, reply.notes),
            Err(error) => (None, vec![error.to_string()]),
        };
        // The daemon knows best why a gather has ended.
        if let (Some(why), Some(failure)) = (why, &mut record.failure) {
            *failure = format!("the gather was ended: {why}");
        }
        if !untidy.is_empty() && record.failure.is_none() {
            record.failure = Some(untidy.join("; "));
        }
        record.trim();
        Ok(record)
    }

    fn follow(
        &mut self,
        samples: &mut GatherRun,
        record: &mut Record,
        seconds: f64,
        stop: &Interrupt,
        lines: &mut LineSequence<'_>,
    ) -> Result<(), Failure> {
        let wanted = (seconds / self.cycle_s).ceil() as usize;
        let refused = |why: &str| Err(Failure::Refused(why.to_owned()));
        let (mut last_news, mut renewed) = (Instant::now(), Instant::now());
        loop {
            if stop.came() {
                record.interrupted = true;
                self.prepared.connection.panel(PanelAction::JogStop.name(), &[self.number])?;
                return Ok(());
            }
            let cycle_s = self.cycle_s;
            let taken = samples.take(&mut self.prepared.board, None, |number, values| {
                record.take(number, cycle_s, values);
                Ok::<(), Failure>(())
            })?;
            match (taken, record.begin()) {
                (Taken::Another, _) => return refused("somebody else started another gather"),
                (_, Some(begin)) if record.recording.times.len() >= begin + wanted => return Ok(()),
                (_, None) if record.recording.times.len() as f64 * cycle_s > NO_SAMPLE_FOR.as_secs_f64() => {
                    return refused("the motor did not begin to move");
                }
                _ if samples.ended().is_some() => return refused("the gather has ended early"),
                (Taken::Some, _) => last_news = Instant::now(),
                (Taken::Nothing, _) if last_news.elapsed() > NO_SAMPLE_FOR => {
                    return refused("the board gathers nothing");
                }
                (Taken::Nothing, _) => std::thread::sleep(TAKE_SAMPLES_EVERY),
            }
            if renewed.elapsed() > RENEWAL {
                renewed = Instant::now();
                self.prepared.connection.sequence_renew()?;
                lines.renew()?;
            }
        }
    }
}

impl Record {
    fn take(&mut self, number: u64, cycle_s: f64, values: &[f64]) {
        let [commanded, actual] = *values else { return };
        let Recording { times, commanded: all_commanded, actual: all_actual } = &mut self.recording;
        if number > self.next {
            self.lost += number - self.next;
            self.gaps.push(times.len());
        }
        self.next = number + 1;
        times.push(number as f64 * cycle_s);
        all_commanded.push(commanded);
        all_actual.push(actual);
    }

    /// The index of the first sample in which the commanded position has moved.
    fn begin(&self) -> Option<usize> {
        let commanded = &self.recording.commanded;
        commanded.iter().position(|position| *position != commanded[0])
    }

    /// Drops samples from long before the move.
    fn trim(&mut self) {
        let Some(begin) = self.begin() else { return };
        let Recording { times, commanded, actual } = &mut self.recording;
        let kept = ((times.len() - begin) as f64 * BEFORE) as usize;
        let first = begin.saturating_sub(kept.max(1));
        for column in [times, commanded, actual] {
            column.drain(..first);
        }
        self.gaps.retain_mut(|gap| {
            let is_kept = *gap > first;
            *gap = gap.saturating_sub(first);
            is_kept
        });
    }
}
