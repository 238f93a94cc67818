//! The data that `top` reads from the segment for each picture.

use std::time::Instant;

use super::trace::Traces;
use crate::client::{Board, ClientError, Snapshot};

/// The most samples read for one picture: the size of a ring.
const MOST_SAMPLES: usize = 4096;

pub struct Source {
    board: Board,
    /// The number of the next servo sample, in the segment of this generation.
    next: u64,
    generation: u64,
}

impl Source {
    pub fn new(board: Board) -> Self {
        Self { board, next: 0, generation: 0 }
    }

    /// The present snapshot. The servo updates since the last call go into the traces.
    pub fn look(&mut self, traces: &mut Traces) -> Result<Snapshot, ClientError> {
        let snapshot = self.board.snapshot()?;
        let generation = self.board.subscriber().generation();
        if generation != self.generation {
            // A new daemon counts from the beginning. Earlier updates do not belong to this screen.
            (self.generation, self.next) = (generation, self.board.servo_sequence()?.max(1));
        }
        let history = self.board.history(self.next, MOST_SAMPLES)?;
        self.next = history.next;
        if history.lost > 0 {
            // The lost updates leave a gap in the traces.
            traces.add(&[], true, Instant::now());
        }
        let stale = !snapshot.servo.as_ref().is_some_and(|servo| servo.is_fresh());
        traces.add(&history.samples, stale, Instant::now());
        Ok(snapshot)
    }
}
