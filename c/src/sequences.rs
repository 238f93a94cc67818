//! Gathers and rotary streams, from their beginning to their end.

use std::ffi::CString;
use std::time::Duration;

use driver::client::{Gathered as Samples, StreamError, StreamOptions, gather_all, stream_all};
use driver::protocol::calls::LeftLines;

use crate::board::Board;
use crate::failure::{Failure, Status};
use crate::replies::Reply;
use crate::types::{GatheredInfo, ROTARY_CLEAR, ROTARY_CONTINUE, ROTARY_RUN, RotaryOptions, Streamed};

/// How long the board may take no lines of a stream, unless the caller says.
const PATIENCE: Duration = Duration::from_secs(60);

/// The samples of a gather.
pub struct Gathered {
    samples: Samples,
    titles: Vec<CString>,
    times: Vec<f64>,
}

fn halted() -> Failure {
    Failure::new(Status::Halted, "the caller's function ended it")
}

impl Gathered {
    /// Gathers `sources` each `period` servo cycles, for `time`.
    pub fn new(
        board: &Board,
        sources: &[&str],
        (period, time): (u32, Duration),
        goes_on: impl FnMut() -> bool,
    ) -> Result<Self, Failure> {
        let sources: Vec<String> = sources.iter().map(|source| (*source).to_owned()).collect();
        let (mut reader, connection) = (board.reader()?, board.connect()?);
        let samples = gather_all(&mut reader, connection, &sources, (period, time), goes_on)?;
        let samples = samples.ok_or_else(halted)?;
        let titles = samples.columns.iter().map(|title| CString::new(title.as_str()).unwrap_or_default());
        Ok(Self { titles: titles.collect(), times: samples.times(), samples })
    }

    /// Its size.
    pub fn info(&self) -> GatheredInfo {
        GatheredInfo {
            rows: self.times.len() as u64,
            columns: self.titles.len() as u64,
            lost: self.samples.lost(),
        }
    }

    /// The title of column `index`.
    pub fn title(&self, index: usize) -> Option<&CString> {
        self.titles.get(index)
    }

    /// Row by row.
    pub fn values(&self) -> &[f64] {
        &self.samples.values
    }

    /// Seconds since the first sample.
    pub fn times(&self) -> &[f64] {
        &self.times
    }
}

/// Streams the motion program `text`, which is called `name`, to a rotary buffer. Also returns the compiler's warnings.
pub fn stream(
    board: &Board,
    (name, text): (&str, &[u8]),
    options: &RotaryOptions,
    goes_on: impl FnMut() -> bool,
) -> Result<(Streamed, Reply), Failure> {
    let flag = |bit| options.flags & bit != 0;
    if options.flags & !(ROTARY_RUN | ROTARY_CLEAR | ROTARY_CONTINUE) != 0 {
        return Err(Failure::argument(format!(
            "flags {:#x}: this library does not know all of them",
            options.flags
        )));
    }
    let left = match (flag(ROTARY_CLEAR), flag(ROTARY_CONTINUE)) {
        (true, true) => {
            return Err(Failure::argument("PMAC_ROTARY_CLEAR and PMAC_ROTARY_CONTINUE exclude one another"));
        }
        (true, false) => Some(LeftLines::Clear),
        (false, true) => Some(LeftLines::Continue),
        (false, false) => None,
    };
    let coordinate_system = u8::try_from(options.coordinate_system).map_err(|_| {
        Failure::argument(format!("there is no coordinate system {}", options.coordinate_system))
    })?;
    let options = StreamOptions {
        coordinate_system,
        define_longs: Some(options.define_longs).filter(|longs| *longs != 0),
        run: flag(ROTARY_RUN),
        left,
        timeout: match options.timeout_ms {
            0 => PATIENCE,
            milliseconds => Duration::from_millis(milliseconds.into()),
        },
    };
    let connections = (board.connect()?, board.connect()?);
    let failed = |StreamError { said, cause, began }| {
        let failure = Failure::from(cause).saying(said);
        // An uncertain end and a failed stop stay that; any other error in mid-stream is no call of which nothing was done.
        if began && !matches!(failure.status, Status::Uncertain | Status::StopFailed) {
            return Failure { status: Status::Ended, ..failure };
        }
        failure
    };
    let streamed =
        stream_all(connections, (name, text), &options, goes_on).map_err(failed)?.ok_or_else(halted)?;
    let sent = Streamed {
        lines: streamed.lines as u64,
        commands: streamed.commands as u64,
        underruns: streamed.underruns,
        found_lines: streamed.found_lines,
    };
    Ok((sent, Reply::new(&streamed.warnings)))
}
