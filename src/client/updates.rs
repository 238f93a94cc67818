//! Every servo update in turn, none twice, with exact counts of lost and missed ones.

use std::collections::VecDeque;

use super::{Board, ClientError, Follower, Gap, Step, View};
use crate::decode::ServoData;
use crate::segment::Counter;

/// A servo update, and the missing updates before it.
pub type Update = (View<ServoData>, Option<Gap>);

/// Servo updates of the present daemon and its successors.
pub struct Updates {
    board: Board,
    follower: Follower,
    taken: VecDeque<Update>,
    lost: u64,
    missed: u64,
    /// How many updates the present daemon had missed at the last look.
    missed_before: u64,
    generation: u64,
}

impl Updates {
    /// Begins with the next update of `board`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn new(mut board: Board) -> Result<Self, ClientError> {
        let follower = Follower::new(&mut board)?;
        let subscriber = board.subscriber();
        let (generation, missed_before) = (subscriber.generation(), subscriber.counter(Counter::Missed));
        let (taken, lost, missed) = (VecDeque::new(), 0, 0);
        Ok(Self { board, follower, taken, lost, missed, missed_before, generation })
    }

    /// The next update, if one has come.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn next_come(&mut self) -> Result<Option<Update>, ClientError> {
        if self.taken.is_empty() {
            self.look()?;
        }
        Ok(self.taken.pop_front())
    }

    fn look(&mut self) -> Result<(), ClientError> {
        self.board.refresh()?;
        let subscriber = self.board.subscriber();
        let missed = subscriber.counter(Counter::Missed);
        if subscriber.generation() != self.generation {
            (self.generation, self.missed_before) = (subscriber.generation(), 0);
        }
        self.missed += missed.saturating_sub(self.missed_before);
        self.missed_before = missed;
        let Self { board, follower, taken, lost, .. } = self;
        let mut before = None;
        follower.advance_some(board, |step| {
            match step {
                Step::Gap(gap) => {
                    *lost += gap.lost;
                    before = Some(gap);
                }
                Step::Update(update) => taken.push_back((update, before.take())),
            }
            Ok::<_, ClientError>(())
        })?;
        Ok(())
    }

    /// The board, for other data.
    pub const fn board(&mut self) -> &mut Board {
        &mut self.board
    }

    /// The number of the update to wait behind; `None` if updates have come already.
    #[must_use]
    pub fn waits_behind(&self) -> Option<u64> {
        self.taken.is_empty().then(|| self.follower.next() - 1)
    }

    /// How many updates the daemon overwrote before this program took them. Exact.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// How many updates of the board the daemon did not read in time, since these began. Exact.
    #[must_use]
    pub const fn missed(&self) -> u64 {
        self.missed
    }
}
