//! The clients' last lines that end programs, motions or a gather. The daemon tells owners and waiting clients which
//! client sent them.
//!
//! A line counts if the board may have carried it out. The daemon does not know what the serial port, another host or a
//! program of the board ends.

use std::collections::VecDeque;
use std::time::Instant;

use crate::daemon::shared::caller::Caller;
use crate::language::LineEnds;
use crate::map::Family;
use crate::protocol::board::SentStop;

/// How many stops the daemon keeps.
const STOPS_KEPT: usize = 16;

#[derive(Debug)]
struct Sent {
    number: u64,
    ends: LineEnds,
    by: Caller,
    /// The number of the sequence whose step the line is.
    sequence: Option<u64>,
    at: Instant,
}

/// The last lines that ended something.
#[derive(Debug, Default)]
pub struct SentStops {
    last: VecDeque<Sent>,
    count: u64,
}

impl SentStops {
    /// `by` has sent a command that `ends` these, perhaps as a step of `sequence`.
    pub fn add(&mut self, ends: LineEnds, by: Caller, sequence: Option<u64>, now: Instant) {
        self.count += 1;
        if self.last.len() == STOPS_KEPT {
            self.last.pop_front();
        }
        self.last.push_back(Sent { number: self.count, ends, by, sequence, at: now });
    }

    /// The stops that other clients than `client` sent, for a board of this family.
    pub fn of_others(&self, client: u64, family: &Family) -> Vec<SentStop> {
        let others = self.last.iter().filter(|sent| sent.by.client != client);
        others.map(|sent| sent.told(family)).collect()
    }

    /// The client that has ended the work of sequence `number` `since` the sequence began, and how: `uid 0 (pid 7) sent
    /// ENDGATHER`. `ends` tells which lines end that work. `None` if no client did.
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
