//! Samples that the board gathers at servo rate.

use std::time::{Duration, Instant};

use pmac_dpram::client::{
    Board as Client, ClientError, CommandError, Connection, GatherPhase, GatherRun, Taken, identity,
};
use pmac_dpram::gather::{GatherMode, GatherRequest, SampleClock, Source, plan};
use pmac_dpram::map::{BufferLayout, Layout};
use pmac_dpram::protocol::Function;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{of_client, of_command, refused};

/// How long to sleep if no samples have come.
const LOOK: Duration = Duration::from_millis(5);
/// How often this program tells the daemon that it still follows.
const RENEWAL: Duration = Duration::from_millis(500);
/// How long the board may give no sample, beyond two periods.
const SILENCE: Duration = Duration::from_secs(5);

/// The samples of a gather.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Gathered {
    columns: Vec<String>,
    numbers: Vec<u64>,
    /// Row by row.
    values: Vec<f64>,
    /// How many samples the board made in all.
    made: u64,
    clock: SampleClock,
}

#[pymethods]
impl Gathered {
    /// The columns' titles: the source, and its unit in brackets.
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.columns.clone()
    }

    /// The samples as 64-bit floats of this machine, row by row: `np.frombuffer(data).reshape(-1, len(columns))`.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let bytes: Vec<u8> = self.values.iter().flat_map(|value| value.to_ne_bytes()).collect();
        PyBytes::new(py, &bytes)
    }

    /// One column's values.
    fn column(&self, index: usize) -> PyResult<Vec<f64>> {
        if index >= self.columns.len() {
            return Err(refused(&format!("there is no column {index}; there are {}", self.columns.len())));
        }
        Ok(self.values.iter().skip(index).step_by(self.columns.len()).copied().collect())
    }

    /// When the board made each sample: seconds since the first, or servo cycles if the servo period is not known.
    #[getter]
    fn times(&self) -> Vec<f64> {
        self.numbers.iter().map(|number| self.clock.at(*number)).collect()
    }

    /// Samples that the board or the daemon overwrote before this program read them. Exact.
    #[getter]
    fn lost(&self) -> u64 {
        self.made - self.numbers.len() as u64
    }

    fn __len__(&self) -> usize {
        self.numbers.len()
    }

    fn __repr__(&self) -> String {
        format!("<Gathered {} samples of {}>", self.numbers.len(), self.columns.join(", "))
    }
}

/// Makes the board gather `sources` each `period` servo cycles, for `time`.
pub fn gather(
    py: Python<'_>,
    mut client: Client,
    mut connection: Connection,
    sources: &[String],
    period: u32,
    time: Duration,
) -> PyResult<Gathered> {
    let settings = connection.settings().map_err(of_command)?;
    let found = client.identity().map_err(of_client)?;
    let family = identity::family(&found).ok_or_else(|| refused("the board's family is not known"))?;
    let family = connection.info().map_err(of_command)?.sized(family);
    for function in [Function::Gather, Function::Ascii] {
        if !settings.functions.has(function) {
            return Err(refused(&format!("cannot gather: {}", settings.functions.why_not(function, family))));
        }
    }
    let firmware = found.firmware.as_deref().and_then(|text| text.parse().ok());
    let (known, scales) = (Layout::new(family, firmware), identity::scales(&found));
    let layout = settings.layout(family, firmware);
    let refuse = |error: &dyn std::fmt::Display| refused(&error.to_string());
    let sources: Vec<Source> = sources
        .iter()
        .map(|text| Source::parse(text, &known).map_err(|error| refuse(&error)))
        .collect::<PyResult<_>>()?;
    let sample_longs = sources.iter().map(Source::longs).sum();
    let kept = BufferLayout::new(&layout, &settings.plan).map_err(|error| refuse(&error))?;
    let buffer_longs = kept.gather_size(sample_longs);
    let request = GatherRequest { sources, period, mode: GatherMode::Wrap, buffer_longs };
    let plan = plan(&request, &layout, &scales).map_err(|error| refuse(&error))?;
    kept.check_gather(layout.gather().buffer, plan.buffer_longs, plan.sample_longs)
        .map_err(|error| refuse(&error))?;
    let clock = SampleClock { period: plan.period, servo_period_ns: scales.servo_period_ns() };
    let period_ns =
        clock.servo_period_ns.ok_or_else(|| refused("the board has not told its servo period"))?;
    let wanted = (time.as_nanos() as f64 / (period_ns * f64::from(plan.period))).round() as u64;
    let silence = SILENCE + Duration::from_nanos((2.0 * f64::from(plan.period) * period_ns) as u64);

    let mut run = GatherRun::new(client.follow_gather().map_err(of_client)?, plan.columns.clone());
    py.detach(|| connection.gather_start(&plan, &layout, Some(period_ns.round() as u64)))
        .map_err(of_command)?;
    let (mut numbers, mut values) = (Vec::new(), Vec::new());
    let mut follow = || -> PyResult<()> {
        let (mut news, mut renewed) = (Instant::now(), Instant::now());
        while run.ended().is_none() && run.next() < wanted {
            let taken = run.take(&mut client, Some(wanted), |number, row| {
                numbers.push(number);
                values.extend_from_slice(row);
                Ok::<(), ClientError>(())
            });
            match taken.map_err(of_client)? {
                Taken::Another => return Err(refused("somebody else started another gather")),
                Taken::Some => news = Instant::now(),
                Taken::Nothing if news.elapsed() > silence => {
                    let seconds = silence.as_secs_f64();
                    return Err(refused(&format!("the board gathers nothing: no sample for {seconds:.0} s")));
                }
                Taken::Nothing => py.detach(|| std::thread::sleep(LOOK)),
            }
            if renewed.elapsed() > RENEWAL {
                renewed = Instant::now();
                match py.detach(|| connection.sequence_renew()) {
                    // The daemon has ended the gather, and says why in its reply to `gather_stop`.
                    Err(CommandError::Refused(_)) => return Ok(()),
                    renewed => renewed.map_err(of_command)?,
                }
            }
            py.check_signals()?;
        }
        Ok(())
    };
    let followed = follow();
    // In any case: no other client can gather before this.
    let stopped = py.detach(|| connection.gather_stop(None));
    followed?;
    let (reason, notes) = match stopped {
        Ok(reply) => (reply.reason, reply.notes),
        Err(CommandError::Refused(error)) => (Some(error.to_string()), Vec::new()),
        Err(error) => return Err(of_command(error)),
    };
    let made = run.next();
    let early = match run.ended() {
        _ if made >= wanted => None,
        Some(GatherPhase::Redefined) => {
            Some("the buffer was defined again, or the board was reset".to_owned())
        }
        Some(GatherPhase::Interrupted) => {
            Some("gathering paused for an unknown number of samples".to_owned())
        }
        _ => Some(reason.unwrap_or_else(|| "it was ended".to_owned())),
    };
    let early = early.map(|why| format!("gathering ended early, after {made} of {wanted} samples: {why}"));
    let said: Vec<String> = early.into_iter().chain(notes).collect();
    if !said.is_empty() {
        return Err(refused(&said.join("; ")));
    }
    let columns = plan.columns.iter().map(|column| column.title()).collect();
    Ok(Gathered { columns, numbers, values, made, clock })
}
