//! The last lines of clients that end programs, motions or a gather. Owners, and those who wait, are told who sent them.
//!
//! A line counts when the board may have carried it out. What the serial port, another host or a program of the board ends is not
//! known here.

use std::collections::VecDeque;
use std::time::Instant;

use crate::daemon::shared::caller::Caller;
use crate::language::LineEnds;
use crate::map::Family;
use crate::protocol::board::SentStop;

/// How many are kept.
const STOPS_KEPT: usize = 16;

#[derive(Debug)]
struct Sent {
    number: u64,
    ends: LineEnds,
    by: Caller,
    /// It is a step of the sequence of this number.
    sequence: Option<u64>,
    at: Instant,
}

/// The last of them.
#[derive(Debug, Default)]
pub struct SentStops {
    last: VecDeque<Sent>,
    count: u64,
}

impl SentStops {
    /// `by` has sent what `ends` these, as a step of this `sequence` if it is one.
    pub fn add(&mut self, ends: LineEnds, by: Caller, sequence: Option<u64>, now: Instant) {
        self.count += 1;
        if self.last.len() == STOPS_KEPT {
            self.last.pop_front();
        }
        self.last.push_back(Sent { number: self.count, ends, by, sequence, at: now });
    }

    /// Those of a board of this family that did not come from `client`.
    pub fn of_others(&self, client: u64, family: &Family) -> Vec<SentStop> {
        let others = self.last.iter().filter(|sent| sent.by.client != client);
        others.map(|sent| sent.told(family)).collect()
    }

    /// Who has ended what sequence `number` does, if somebody here did `since` it began: `uid 0 (pid 7) sent ENDGATHER`. `ends` tells
    /// what ends it.
    pub fn that_ended(
        &self,
        number: u64,
        since: Instant,
        ends: impl Fn(&LineEnds) -> bool,
        family: &Family,
    ) -> Option<String> {
        let is_others = |sent: &&Sent| sent.at >= since && sent.sequence != Some(number);
        let mut latest = self.last.iter().rev().filter(is_others);
        latest.find(|sent| ends(&sent.ends)).map(|sent| sent.told(family).to_string())
    }
}

impl Sent {
    fn told(&self, family: &Family) -> SentStop {
        let Self { number, ends, by, .. } = self;
        let within = |mask: u32, count: usize| {
            (1..=32).filter(|number| *number as usize <= count && mask >> (number - 1) & 1 != 0).collect()
        };
        SentStop {
            number: *number,
            what: ends.what.to_string(),
            uid: by.peer.uid.as_raw(),
            pid: by.peer.pid,
            named: !ends.unnamed,
            coordinate_systems: within(ends.systems.bits(), family.coordinate_systems),
            motors: within(ends.motors.bits(), family.motors),
            gather: ends.gather,
        }
    }
}
