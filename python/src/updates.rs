//! Every servo update in turn, none twice, with exact counts of lost and missed ones.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pmac_dpram::client::{Board as Client, ClientError, Follower, Staleness, Step};
use pmac_dpram::segment::{Counter, SegmentName};
use pyo3::prelude::*;

use crate::board::{SLICE, duration};
use crate::columns::Columns;
use crate::data::Snapshot;
use crate::errors::{of_client, stale};
use crate::per_process::{PerProcess, lock};

struct Taking {
    client: Client,
    follower: Follower,
    taken: VecDeque<Snapshot>,
    lost: u64,
    /// How many updates the daemons had missed by now, and the present one at the last look.
    missed: u64,
    missed_before: u64,
    generation: u64,
}

/// Servo updates from now on, of the present daemon and its successors.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Updates {
    name: SegmentName,
    taking: PerProcess<Taking>,
    /// Apart from the taking, so that a taking thread does not wait for a waiting one.
    waiting: PerProcess<Client>,
    timeout: Duration,
}

impl Taking {
    /// Begins with the next update.
    fn begin(mut client: Client) -> PyResult<Self> {
        let follower = Follower::new(&mut client).map_err(of_client)?;
        let subscriber = client.subscriber();
        let (generation, missed_before) = (subscriber.generation(), subscriber.counter(Counter::Missed));
        let (taken, lost, missed) = (VecDeque::new(), 0, 0);
        Ok(Self { client, follower, taken, lost, missed, missed_before, generation })
    }

    /// Takes new updates; returns whether any wait for the caller.
    fn take(&mut self) -> Result<bool, ClientError> {
        if !self.taken.is_empty() {
            return Ok(true);
        }
        self.client.refresh()?;
        let subscriber = self.client.subscriber();
        let missed = subscriber.counter(Counter::Missed);
        if subscriber.generation() != self.generation {
            (self.generation, self.missed_before) = (subscriber.generation(), 0);
        }
        self.missed += missed.saturating_sub(self.missed_before);
        self.missed_before = missed;
        let Self { client, follower, taken, lost, .. } = self;
        let mut before = None;
        follower.advance_some(client, |step| {
            match step {
                Step::Gap(gap) => {
                    *lost += gap.lost;
                    before = Some(gap);
                }
                Step::Update(update) => taken.push_back(Snapshot::of_update(update, before.take())),
            }
            Ok::<_, ClientError>(())
        })
    }

    /// Hands new updates to `push`, at most `most`.
    fn take_most(&mut self, most: usize, mut push: impl FnMut(Snapshot)) -> Result<(), ClientError> {
        let mut left = most;
        while left > 0 && self.take()? {
            let count = left.min(self.taken.len());
            self.taken.drain(..count).for_each(&mut push);
            left -= count;
        }
        Ok(())
    }
}

impl Updates {
    /// Begins with the next update.
    pub fn begin(client: Client, timeout: Duration) -> PyResult<Self> {
        let name = client.name().clone();
        let (taking, waiting) = (PerProcess::new(Taking::begin(client)?), PerProcess::new(attach(&name)?));
        Ok(Self { name, taking, waiting, timeout })
    }

    fn taking(&self) -> PyResult<Arc<Mutex<Taking>>> {
        self.taking.get(|| Taking::begin(attach(&self.name)?))
    }
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
            taking.take()?;
            let update = taking.taken.pop_front();
            let found = if update.is_none() && is_over { Some(taking.client.snapshot()?) } else { None };
            Ok((update, found))
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
            let after = {
                let taking = lock(&taking);
                if !taking.taken.is_empty() {
                    return Ok(true);
                }
                taking.follower.next() - 1
            };
            lock(&waiting).wait(after, left.min(SLICE))
        });
        waited.map(drop).map_err(of_client)
    }

    /// The updates that have come already, at most `most`. Does not wait.
    #[pyo3(signature = (most = 65536))]
    fn take_all(&self, py: Python<'_>, most: usize) -> PyResult<Vec<Snapshot>> {
        let (taking, mut taken) = (self.taking()?, Vec::new());
        py.detach(|| lock(&taking).take_most(most, |update| taken.push(update))).map_err(of_client)?;
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
        py.detach(|| lock(&taking).take_most(most, push)).map_err(of_client)?;
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
        Ok(py.detach(|| lock(&taking).lost))
    }

    /// How many updates of the board the daemon did not read in time since this object began. Exact.
    #[getter]
    fn missed(&self, py: Python<'_>) -> PyResult<u64> {
        let taking = self.taking()?;
        Ok(py.detach(|| lock(&taking).missed))
    }
}
