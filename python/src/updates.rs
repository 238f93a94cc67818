//! Every servo update in turn, none twice, and exactly how many were lost or missed.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pmac_dpram::client::{Board as Client, ClientError, Follower, Staleness, Step};
use pmac_dpram::segment::Counter;
use pyo3::prelude::*;

use crate::board::SLICE;
use crate::data::Snapshot;
use crate::errors::{of_client, stale};

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

/// Servo updates from now on, of the present daemon and of those that follow it.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Updates {
    taking: Mutex<Taking>,
    timeout: Duration,
}

impl Taking {
    /// Takes what has come. Whether there is any.
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

    fn wait(&mut self, time: Duration) -> Result<bool, ClientError> {
        Ok(self.take()? || self.client.wait(self.follower.next() - 1, time)? && self.take()?)
    }
}

impl Updates {
    /// From the next update on.
    pub fn begin(mut client: Client, timeout: Duration) -> PyResult<Self> {
        let follower = Follower::new(&mut client).map_err(of_client)?;
        let subscriber = client.subscriber();
        let (generation, missed_before) = (subscriber.generation(), subscriber.counter(Counter::Missed));
        let (taken, lost, missed) = (VecDeque::new(), 0, 0);
        let taking = Taking { client, follower, taken, lost, missed, missed_before, generation };
        Ok(Self { taking: Mutex::new(taking), timeout })
    }

    fn taking(&self) -> MutexGuard<'_, Taking> {
        self.taking.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Updates {
    /// The next update, if there is one already.
    fn take(&self, py: Python<'_>) -> PyResult<Option<Snapshot>> {
        let update = py.detach(|| {
            let mut taking = self.taking();
            taking.take().map(|_| taking.taken.pop_front())
        });
        update.map_err(of_client)
    }

    /// The updates that have come already, at most `most`. Does not wait.
    #[pyo3(signature = (most = 65536))]
    fn take_all(&self, py: Python<'_>, most: usize) -> PyResult<Vec<Snapshot>> {
        let taken = py.detach(|| {
            let mut taking = self.taking();
            let mut taken = Vec::new();
            while taken.len() < most && taking.take()? {
                let left = most - taken.len();
                let count = left.min(taking.taken.len());
                taken.extend(taking.taken.drain(..count));
            }
            Ok(taken)
        });
        taken.map_err(of_client)
    }

    /// The next update. After `timeout` without one it raises `StaleData` or `DaemonGone`; the next call waits again.
    fn next(&self, py: Python<'_>) -> PyResult<Snapshot> {
        let end = Instant::now() + self.timeout;
        loop {
            if let Some(update) = self.take(py)? {
                return Ok(update);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let found = py.detach(|| self.taking().client.snapshot()).map_err(of_client)?;
                let servo = found.servo.and_then(|servo| servo.stale);
                let silent = Staleness::NoUpdates { age_ns: self.timeout.as_nanos() as u64 };
                return Err(stale(found.stale.or(servo).unwrap_or(silent)));
            }
            py.detach(|| self.taking().wait(left.min(SLICE))).map_err(of_client)?;
            py.check_signals()?;
        }
    }

    /// How many updates were overwritten before they were taken here. Exact.
    #[getter]
    fn lost(&self, py: Python<'_>) -> u64 {
        py.detach(|| self.taking().lost)
    }

    /// How many updates of the board the daemon did not read in time, since this began. Exact.
    #[getter]
    fn missed(&self, py: Python<'_>) -> u64 {
        py.detach(|| self.taking().missed)
    }
}
