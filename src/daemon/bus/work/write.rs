//! Background variable writes: PMAC gets one batch of records at a time, and the next one once it has written all of
//! the batch.

use std::collections::VecDeque;
use std::time::Instant;

use crate::daemon::bus::timing::WRITE_POLL;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once};
use crate::device::{Bus, BusError};
use crate::function::variable_write::{GivenUp, VariableWriter, WritePoll, WriteRecord};
use crate::map::BufferLayout;

struct RecordBatch {
    ticket: Ticket,
    records: Vec<WriteRecord>,
    deadline: Instant,
}

/// The records that wait, and those that PMAC has.
pub struct WriteQueue {
    writer: VariableWriter,
    waiting: VecDeque<RecordBatch>,
    under_way: Option<(Ticket, Instant)>,
    /// The batch under way when the daemon took the board over again, and how far PMAC was.
    interrupted: Option<(Ticket, GivenUp)>,
    next_poll: Instant,
}

impl WriteQueue {
    /// No records yet. The layout has the room for them.
    #[must_use]
    pub fn new(layout: &BufferLayout, now: Instant) -> Self {
        Self {
            writer: VariableWriter::new(layout.family(), layout.variable_write()),
            waiting: VecDeque::with_capacity(at_once::WRITES),
            under_way: None,
            interrupted: None,
            next_poll: now,
        }
    }

    /// Takes back the records that PMAC has. The daemon calls this on every way out.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.writer.release(bus)
    }

    /// Takes back the records of this host or a dead one: at the start, or when the board is another one.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.writer.release(bus)?;
        let given_up = self.writer.acquire(now);
        if let Some((ticket, _)) = self.under_way.take() {
            self.interrupted = Some((ticket, given_up));
        }
        self.next_poll = now;
        Ok(())
    }

    /// Accepts records.
    pub fn submit(&mut self, ticket: Ticket, records: Vec<WriteRecord>, deadline: Instant, now: Instant) {
        self.waiting.push_back(RecordBatch { ticket, records, deadline });
        self.next_poll = now;
    }

    /// When to poll next; `None` while there is nothing to do.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        (self.under_way.is_some()
            || self.interrupted.is_some()
            || !self.waiting.is_empty()
            || !self.writer.is_idle())
        .then_some(self.next_poll)
    }

    /// Does the work that is due; returns a batch's end.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        if let Some((ticket, given_up)) = self.interrupted.take() {
            return Ok(Some(Event::Done(
                ticket,
                not_all_written(format_args!("the board was reset, or replaced"), given_up),
            )));
        }
        let poll = self.writer.poll(bus, now)?;
        self.next_poll = if matches!(poll, WritePoll::Progress(_)) { now } else { now + WRITE_POLL };
        if let Some((ticket, deadline)) = self.under_way {
            if poll == WritePoll::Done {
                self.under_way = None;
                self.next_poll = now;
                return Ok(Some(Event::Done(ticket, Outcome::Done)));
            }
            if now >= deadline {
                self.under_way = None;
                let given_up = self.writer.give_up(bus, now)?;
                let why = format_args!("PMAC did not write in time, give it longer");
                return Ok(Some(Event::Done(ticket, not_all_written(why, given_up))));
            }
            return Ok(None);
        }
        let Some(next) = self.waiting.pop_front() else { return Ok(None) };
        if now >= next.deadline {
            let reason =
                Text::of(&"PMAC was not free to write in time, give it longer; nothing has been written");
            return Ok(Some(Event::Done(next.ticket, Outcome::Refused(reason))));
        }
        let RecordBatch { ticket, records, deadline } = next;
        match self.writer.begin(bus, records)? {
            Ok(()) => {
                self.under_way = Some((ticket, deadline));
                self.next_poll = now;
            }
            Err(records) => self.waiting.push_front(RecordBatch { ticket, records, deadline }),
        }
        Ok(None)
    }
}

fn not_all_written(why: std::fmt::Arguments<'_>, GivenUp { done, uncertain }: GivenUp) -> Outcome {
    let told = Text::of(&format_args!("{why}: {done} records are written, {uncertain} may be"));
    if done + uncertain == 0 { Outcome::Refused(told) } else { Outcome::Interrupted(told) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::map::{BufferSettings, FAMILIES, Layout};

    #[test]
    fn what_came_too_late_blames_no_variable_that_the_socket_asks_for() {
        for family in FAMILIES {
            let layout = Layout::new(family, None);
            let plan = BufferLayout::new(&layout, &BufferSettings::default()).unwrap();
            let file = tempfile::tempfile().unwrap();
            file.set_len(family.length.into()).unwrap();
            let mut bus = FileBoard::from_file(&file, family.length as usize).unwrap();
            let now = Instant::now();
            let mut queue = WriteQueue::new(&plan, now);
            queue.submit(Ticket(1), Vec::new(), now, now);
            let Some(Event::Done(Ticket(1), Outcome::Refused(text))) = queue.poll(&mut bus, now).unwrap()
            else {
                panic!("{}", family.name)
            };
            assert_eq!(
                &*text,
                "PMAC was not free to write in time, give it longer; nothing has been written"
            );
        }
    }
}
