//! Every servo update in turn, none twice, with exact counts of lost and missed ones.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pmac_dpram::client::{Board as Client, ClientError, Staleness, Updates as Taking};
use pmac_dpram::segment::SegmentName;
use pyo3::prelude::*;

use crate::board::{SLICE, duration};
use crate::columns::Columns;
use crate::data::Snapshot;
use crate::errors::{of_client, stale};
use crate::per_process::{PerProcess, lock};

/// Servo updates from now on, of the present daemon and its successors.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Updates {
    name: SegmentName,
    taking: PerProcess<Taking>,
    /// Apart from the taking, so that a taking thread does not wait for a waiting one.
    waiting: PerProcess<Client>,
    timeout: Duration,
}

/// Hands new updates to `push`, at most `most`.
fn take_most(taking: &mut Taking, most: usize, mut push: impl FnMut(Snapshot)) -> Result<(), ClientError> {
    for _ in 0..most {
        let Some((update, gap)) = taking.next_come()? else { break };
        push(Snapshot::of_update(update, gap));
    }
    Ok(())
}

impl Updates {
    /// Begins with the next update.
    pub fn begin(client: Client, timeout: Duration) -> PyResult<Self> {
        let name = client.name().clone();
        let (taking, waiting) = (PerProcess::new(begin(client)?), PerProcess::new(attach(&name)?));
        Ok(Self { name, taking, waiting, timeout })
    }

    fn taking(&self) -> PyResult<Arc<Mutex<Taking>>> {
        self.taking.get(|| begin(attach(&self.name)?))
    }
}

fn begin(client: Client) -> PyResult<Taking> {
    Taking::new(client).map_err(of_client)
}

fn attach(name: &SegmentName) -> PyResult<Client> {
    Client::attach(name.as_str()).map_err(of_client)
}

#[pymethods]
impl Updates {
    /// The next update, if one has come already. Raises `StaleData` or `DaemonGone` if none came and the caller has
    /// waited for `timeout`.
    #[pyo3(signature = (waited = 0.0))]
    fn take(&self, py: Python<'_>, waited: f64) -> PyResult<Option<Snapshot>> {
        let is_over = duration(waited)? >= self.timeout;
        let taking = self.taking()?;
        let update = py.detach(|| {
            let mut taking = lock(&taking);
            let update = taking.next_come()?;
            let found = if update.is_none() && is_over { Some(taking.board().snapshot()?) } else { None };
            Ok((update.map(|(update, gap)| Snapshot::of_update(update, gap)), found))
        });
        let (update, found) = update.map_err(of_client)?;
        let Some(found) = found else { return Ok(update) };
        let servo = found.servo.and_then(|servo| servo.stale);
        let silent = Staleness::NoUpdates { age_ns: self.timeout.as_nanos() as u64 };
        Err(stale(found.stale.or(servo).unwrap_or(silent)))
    }

    /// Sleeps until an update comes, for a moment at most. Takes no update, so a caller that stops waiting loses none.
    #[pyo3(signature = (waited = 0.0))]
    fn wait(&self, py: Python<'_>, waited: f64) -> PyResult<()> {
        let left = self.timeout.saturating_sub(duration(waited)?);
        let (taking, waiting) = (self.taking()?, self.waiting.get(|| attach(&self.name))?);
        let waited = py.detach(|| {
            let Some(after) = lock(&taking).waits_behind() else { return Ok(true) };
            lock(&waiting).wait(after, left.min(SLICE))
        });
        waited.map(drop).map_err(of_client)
    }

    /// The updates that have come already, at most `most`. Does not wait.
    #[pyo3(signature = (most = 65536))]
    fn take_all(&self, py: Python<'_>, most: usize) -> PyResult<Vec<Snapshot>> {
        let (taking, mut taken) = (self.taking()?, Vec::new());
        py.detach(|| take_most(&mut lock(&taking), most, |update| taken.push(update))).map_err(of_client)?;
        Ok(taken)
    }

    /// As [`Self::take_all`], as columns.
    #[pyo3(signature = (columns, most = 65536))]
    fn take_columns(&self, py: Python<'_>, columns: Vec<String>, most: usize) -> PyResult<Columns> {
        let (taking, mut taken) = (self.taking()?, Columns::new(columns)?);
        let push = |update: Snapshot| {
            let (servo, lost) = update.servo();
            taken.lose(lost);
            taken.push(servo);
        };
        py.detach(|| take_most(&mut lock(&taking), most, push)).map_err(of_client)?;
        Ok(taken)
    }

    /// The next update. After `timeout` without one it raises `StaleData` or `DaemonGone`; the next call waits again.
    fn next(&self, py: Python<'_>) -> PyResult<Snapshot> {
        let began = Instant::now();
        loop {
            if let Some(update) = self.take(py, began.elapsed().as_secs_f64())? {
                return Ok(update);
            }
            self.wait(py, began.elapsed().as_secs_f64())?;
            py.check_signals()?;
        }
    }

    /// How many updates the daemon overwrote before this object took them. Exact.
    #[getter]
    fn lost(&self, py: Python<'_>) -> PyResult<u64> {
        let taking = self.taking()?;
        Ok(py.detach(|| lock(&taking).lost()))
    }

    /// How many updates of the board the daemon did not read in time since this object began. Exact.
    #[getter]
    fn missed(&self, py: Python<'_>) -> PyResult<u64> {
        let taking = self.taking()?;
        Ok(py.detach(|| lock(&taking).missed()))
    }
}
