//! Every servo update in turn, with exact counts of lost and missed ones.

use std::time::{Duration, Instant};

use driver::client::{Board as Client, ClientError, Updates as Taking};
use driver::segment::SegmentName;

use crate::board::Board;
use crate::failure::Failure;
use crate::per_process::{PerProcess, Pool};
use crate::snapshot::Snapshot;

/// Servo updates of the present daemon and its successors. In a forked child they begin anew.
pub struct Updates {
    name: SegmentName,
    taking: PerProcess<Option<Taking>>,
    /// Readers to wait by: a waiting thread keeps no other one from taking.
    waiting: Pool<Client>,
}

impl Updates {
    /// Begins with the next update.
    pub fn new(board: &Board) -> Result<Self, Failure> {
        let updates =
            Self { name: board.segment().clone(), taking: PerProcess::default(), waiting: Pool::default() };
        updates.with(|_| Ok(()))?;
        Ok(updates)
    }

    fn attach(&self) -> Result<Client, ClientError> {
        Client::attach(self.name.as_str())
    }

    fn with<R>(&self, action: impl FnOnce(&mut Taking) -> Result<R, ClientError>) -> Result<R, Failure> {
        let mut place = self.taking.lock()?;
        let taking = match &mut *place {
            Some(taking) => taking,
            none => none.insert(Taking::new(self.attach()?)?),
        };
        Ok(action(taking)?)
    }

    /// The next update; `None` after `timeout`. Then data that are not live are an error.
    pub fn next(&self, timeout: Duration) -> Result<Option<Snapshot>, Failure> {
        let began = Instant::now();
        loop {
            let (update, after) = self.with(|taking| {
                let update = taking.next_come()?;
                Ok((update, taking.waits_behind()))
            })?;
            if let Some((update, gap)) = update {
                return Ok(Some(Snapshot::of_update(update, gap)));
            }
            let left = timeout.saturating_sub(began.elapsed());
            if left.is_zero() {
                self.check_live()?;
                return Ok(None);
            }
            if let Some(after) = after {
                self.wait(after, left)?;
            }
        }
    }

    fn wait(&self, after: u64, left: Duration) -> Result<(), Failure> {
        let mut reader = self.waiting.take()?.map_or_else(|| self.attach(), Ok)?;
        reader.wait(after, left)?;
        self.waiting.put(reader)
    }

    fn check_live(&self) -> Result<(), Failure> {
        let found = self.with(|taking| taking.board().snapshot())?;
        let servo = found.servo.and_then(|servo| servo.stale);
        found.stale.or(servo).map_or(Ok(()), |why| Err(why.into()))
    }

    /// How many updates were lost, and how many missed, since these began.
    pub fn counts(&self) -> Result<(u64, u64), Failure> {
        self.with(|taking| Ok((taking.lost(), taking.missed())))
    }
}
