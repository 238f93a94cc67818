//! The desk in front of the background variable write buffer: one batch of records at a time, each until PMAC has
//! written all of it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::queue::{Event, Outcome, Text, Ticket};
use crate::device::{Bus, BusError};
use crate::function::variable_write::{VariableWriter, WriteRecord, WriteStep};
use crate::map::Region;

/// Batches that may wait.
const WAITING_MAX: usize = 16;
/// How often to look whether PMAC is done.
const LOOK: Duration = Duration::from_millis(1);

struct Batch {
    ticket: Ticket,
    records: Vec<WriteRecord>,
    deadline: Instant,
}

/// The desk.
pub struct WriteDesk {
    writer: VariableWriter,
    waiting: VecDeque<Batch>,
    under_way: Option<(Ticket, Instant)>,
    next_look: Instant,
}

impl WriteDesk {
    /// A desk whose records lie in `place`.
    #[must_use]
    pub fn new(place: Region) -> Self {
        Self {
            writer: VariableWriter::new(place),
            waiting: VecDeque::with_capacity(WAITING_MAX),
            under_way: None,
            next_look: Instant::now(),
        }
    }

    /// Takes records in, or refuses them.
    pub fn submit(&mut self, ticket: Ticket, records: Vec<WriteRecord>, deadline: Instant) -> Option<Event> {
        if self.waiting.len() == WAITING_MAX {
            return Some(Event::Done(ticket, Outcome::Refused(Text::of(&"too many writes wait already"))));
        }
        self.waiting.push_back(Batch { ticket, records, deadline });
        self.next_look = Instant::now();
        None
    }

    /// When to pass next; `None` while nothing is to be done.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        (self.under_way.is_some() || !self.waiting.is_empty() || !self.writer.is_idle())
            .then_some(self.next_look)
    }

    /// Does what can be done now; tells what has ended.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        let step = self.writer.step(bus, now)?;
        self.next_look = if matches!(step, WriteStep::Progress(_)) { now } else { now + LOOK };
        if let Some((ticket, deadline)) = self.under_way {
            if step == WriteStep::Done {
                self.under_way = None;
                self.next_look = now;
                return Ok(Some(Event::Done(ticket, Outcome::Done)));
            }
            if now >= deadline {
                self.under_way = None;
                let given_up = self.writer.give_up(bus, now)?;
                let reason = format!(
                    "PMAC did not write in time (is I55=1?): {} records are written, {} may be",
                    given_up.done, given_up.uncertain
                );
                return Ok(Some(Event::Done(ticket, Outcome::Refused(Text::of(&reason)))));
            }
            return Ok(None);
        }
        let Some(next) = self.waiting.pop_front() else { return Ok(None) };
        if now >= next.deadline {
            let reason = "PMAC was not free to write in time (is I55=1?); nothing has been written";
            return Ok(Some(Event::Done(next.ticket, Outcome::Refused(Text::of(&reason)))));
        }
        let Batch { ticket, records, deadline } = next;
        match self.writer.begin(bus, records)? {
            Ok(()) => {
                self.under_way = Some((ticket, deadline));
                self.next_look = now;
            }
            Err(records) => self.waiting.push_front(Batch { ticket, records, deadline }),
        }
        Ok(None)
    }
}
