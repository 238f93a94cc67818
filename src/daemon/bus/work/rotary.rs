//! Lines for the binary rotary buffers: the bus thread feeds the board as it makes room.

use std::collections::VecDeque;
use std::time::Instant;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::timing::ROTARY_POLL;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once};
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::function::rotary::{RotaryError, RotarySetup, RotaryStream};
use crate::map::Family;

/// How many commands one poll writes, four words each: few, so that the servo data never wait long.
const COMMANDS_A_POLL: usize = 16;

/// The commands of a line, two words each.
pub type Line = Vec<(u32, u32)>;

/// Lines for a buffer, sent together.
#[derive(Debug)]
pub struct Batch {
    /// The ticket under which the sender hears of the lines' end.
    pub ticket: Ticket,
    /// The buffer's number, from 0.
    pub buffer: usize,
    /// The number that the next line has to have, if its sender counts.
    pub first: Option<u64>,
    /// The lines left.
    pub lines: VecDeque<Line>,
    /// Until when the lines wait for room.
    pub deadline: Instant,
}

/// The lines that wait, and their buffers.
#[derive(Debug)]
pub struct RotaryQueue {
    streams: Vec<RotaryStream>,
    waiting: VecDeque<Batch>,
    /// The buffer whose turn it is.
    turn: usize,
    next_poll: Instant,
}

impl RotaryQueue {
    /// No lines, and no buffer of `family` set up.
    #[must_use]
    pub fn new(family: &'static Family, now: Instant) -> Self {
        Self {
            streams: RotaryStream::of_family(family),
            waiting: VecDeque::with_capacity(at_once::ROTARY),
            turn: 0,
            next_poll: now,
        }
    }

    /// The buffer's stream, if the daemon has set it up.
    fn stream(&mut self, buffer: usize) -> Option<&mut RotaryStream> {
        self.streams.get_mut(buffer).filter(|stream| stream.is_set_up())
    }

    /// Sets a buffer up.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn open(
        &mut self,
        bus: &mut impl Bus,
        buffer: usize,
        setup: &RotarySetup,
    ) -> Result<Outcome, BusError> {
        if self.waiting.iter().any(|batch| batch.buffer == buffer) {
            return Ok(refused(&"lines for this buffer are still waiting; let them go first"));
        }
        let mut others = (0..).zip(&self.streams).filter(|(other, _)| *other != buffer);
        if let Some((other, _)) = others.find(|(_, stream)| stream.is_in_way_of(setup)) {
            return Ok(refused(&format_args!(
                "rotary buffer {} lies there, and a stream uses it",
                other + 1
            )));
        }
        let Some(stream) = self.streams.get_mut(buffer) else {
            return Ok(refused(&RotaryError::NotSetUp));
        };
        match stream.set_up(bus, setup) {
            Ok(()) => {
                self.streams.iter().try_for_each(|stream| stream.clear_unused(bus))?;
                Ok(Outcome::Done)
            }
            Err(RotaryError::Bus(error)) => Err(error),
            Err(reason) => Ok(refused(&reason)),
        }
    }

    /// Accepts lines, or refuses them.
    pub fn submit(&mut self, batch: Batch, now: Instant) -> Option<Event> {
        if self.stream(batch.buffer).is_none() {
            return Some(Event::Done(batch.ticket, refused(&RotaryError::NotSetUp)));
        }
        self.waiting.push_back(batch);
        self.next_poll = now;
        None
    }

    /// No line will follow: the lines that still wait are late.
    pub fn finish(&mut self, buffer: usize, now: Instant) -> Outcome {
        let waiting = self.waiting.iter_mut().filter(|batch| batch.buffer == buffer);
        waiting.for_each(|batch| batch.deadline = now);
        self.next_poll = now;
        match self.stream(buffer) {
            Some(stream) => {
                stream.finish();
                Outcome::Done
            }
            None => refused(&RotaryError::NotSetUp),
        }
    }

    /// Marks a buffer's header as not in use: the board takes no more lines out of the buffer.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn close(&mut self, bus: &mut impl Bus, buffer: usize) -> Result<Outcome, BusError> {
        self.streams.get_mut(buffer).map_or(Ok(()), |stream| stream.close(bus))?;
        Ok(Outcome::Done)
    }

    /// A buffer's progress.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn state(&mut self, bus: &mut impl Bus, ticket: Ticket, buffer: usize) -> Result<Event, BusError> {
        let Some(stream) = self.stream(buffer) else {
            return Ok(Event::Done(ticket, refused(&RotaryError::NotSetUp)));
        };
        match stream.state(bus) {
            Ok(state) => Ok(Event::Rotary(ticket, state)),
            Err(RotaryError::Bus(error)) => Err(error),
            Err(reason) => Ok(Event::Done(ticket, refused(&reason))),
        }
    }

    /// When to poll next; `None` while no line waits.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        (!self.waiting.is_empty()).then_some(self.next_poll)
    }

    /// Puts in the lines that have room; returns a batch's end.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        // Late batches first: the server has told their callers by now, so nothing more of them may go in.
        if let Some(index) = self.waiting.iter().position(|batch| now >= batch.deadline)
            && let Some(late) = self.waiting.remove(index)
        {
            return Ok(Some(Event::Done(late.ticket, Outcome::TimedOut)));
        }
        // Every buffer gets its turn: neither a full buffer nor one with room holds up the others.
        self.next_poll = now + ROTARY_POLL;
        let count = self.streams.len();
        for buffer in (self.turn..self.turn + count).map(|turn| turn % count) {
            let Some(index) = self.waiting.iter().position(|batch| batch.buffer == buffer) else { continue };
            let fed = self.feed(bus, index)?;
            if matches!(fed, Fed::Full) {
                continue;
            }
            (self.turn, self.next_poll) = ((buffer + 1) % count, now);
            if let Fed::Ended(event) = fed {
                self.waiting.remove(index);
                return Ok(Some(event));
            }
            break;
        }
        Ok(None)
    }

    fn feed(&mut self, bus: &mut impl Bus, index: usize) -> Result<Fed, BusError> {
        let Some(batch) = self.waiting.get_mut(index) else { return Ok(Fed::Full) };
        let stream = self.streams.get_mut(batch.buffer).filter(|stream| stream.is_set_up());
        let Some(stream) = stream else {
            return Ok(Fed::Ended(Event::Done(
                batch.ticket,
                refused(&"the rotary buffer was lost in a reset"),
            )));
        };
        // If a batch did not go in whole, the batches sent after it would leave a gap.
        if let Some(first) = batch.first
            && first != stream.sent_lines()
        {
            let next = stream.sent_lines();
            let reason = refused(&format_args!("line {first} is not the next one, line {next} is"));
            return Ok(Fed::Ended(Event::Done(batch.ticket, reason)));
        }
        let mut commands = 0;
        while let Some(line) = batch.lines.front() {
            if commands > 0 && commands + line.len() > COMMANDS_A_POLL {
                return Ok(Fed::Some);
            }
            match stream.offer(bus, line) {
                Ok(true) => {
                    commands += line.len();
                    batch.lines.pop_front();
                    batch.first = batch.first.map(|first| first + 1);
                }
                Ok(false) => return Ok(Fed::Full),
                Err(RotaryError::Bus(error)) => return Err(error),
                Err(reason) => return Ok(Fed::Ended(Event::Done(batch.ticket, refused(&reason)))),
            }
        }
        Ok(Fed::Ended(Event::Done(batch.ticket, Outcome::Done)))
    }
}

impl<B: Bus> BoardFunction<B> for RotaryQueue {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        self.due().map(|due| clock.ns_of(due))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        if let Some(answer) = RotaryQueue::poll(self, context.bus, context.clock.now())? {
            context.intake.answer(answer);
        }
        Ok(Polled::default())
    }
    fn acquire(&mut self, _context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.streams.iter_mut().for_each(RotaryStream::reset);
        Ok(())
    }
}

#[expect(
    clippy::large_enum_variant,
    reason = "short-lived, and the event travels inline as it does in the queue"
)]
enum Fed {
    /// The buffer may have room for more.
    Some,
    /// The buffer has no room for the next line.
    Full,
    /// The batch is done, or cannot go in.
    Ended(Event),
}

fn refused(reason: &dyn std::fmt::Display) -> Outcome {
    Outcome::Refused(Text::of(reason))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::device::FileBoard;
    use crate::map::{HostOffset, PMAC};

    fn board() -> FileBoard {
        let file = tempfile::tempfile().unwrap();
        file.set_len(PMAC.length.into()).unwrap();
        FileBoard::from_file(&file, PMAC.length as usize).unwrap()
    }

    /// A ring for coordinate system `cs`, in a place of its own.
    fn setup(cs: u8, size_longs: u32) -> RotarySetup {
        RotarySetup {
            start: HostOffset::new(0x3000 + 0x400 * u32::from(cs - 1)),
            size_longs,
            coordinate_system: cs,
            coordinate_system_base: 1,
        }
    }

    #[test]
    fn a_full_buffer_does_not_make_another_one_wait() {
        let (mut bus, now) = (board(), Instant::now());
        let mut queue = RotaryQueue::new(&PMAC, now);
        for (buffer, size) in [(0, 200), (1, 6)] {
            let setup = setup(buffer as u8 + 1, size);
            assert_eq!(queue.open(&mut bus, buffer, &setup).unwrap(), Outcome::Done);
            let (ticket, lines) = (Ticket(buffer as u64), vec![vec![(0x000E23, 0x500000)]; 90].into());
            let deadline = now + Duration::from_secs(1);
            assert!(queue.submit(Batch { ticket, buffer, first: None, lines, deadline }, now).is_none());
        }
        let mut ended = None;
        while queue.due() == Some(now) && ended.is_none() {
            ended = queue.poll(&mut bus, now).unwrap();
        }
        assert!(matches!(ended, Some(Event::Done(Ticket(0), Outcome::Done))), "{ended:?}");
    }

    #[test]
    fn a_ring_lies_in_nobody_elses_while_a_stream_uses_that() {
        let (mut bus, now) = (board(), Instant::now());
        let mut queue = RotaryQueue::new(&PMAC, now);
        let first = setup(1, 40);
        assert_eq!(queue.open(&mut bus, 0, &first).unwrap(), Outcome::Done);
        let (there, behind) = (HostOffset::new(0x3000 + 4 * 38), HostOffset::new(0x3000 + 4 * 40));
        let second = |start| RotarySetup { start, coordinate_system: 2, ..first };
        assert!(matches!(queue.open(&mut bus, 1, &second(there)).unwrap(), Outcome::Refused(_)));
        assert_eq!(queue.open(&mut bus, 1, &second(behind)).unwrap(), Outcome::Done);
        assert_eq!(queue.close(&mut bus, 0).unwrap(), Outcome::Done);
        assert_eq!(queue.open(&mut bus, 1, &second(there)).unwrap(), Outcome::Done);
    }

    #[test]
    fn a_batch_that_is_late_does_not_go_in_any_more() {
        let (mut bus, now) = (board(), Instant::now());
        let mut queue = RotaryQueue::new(&PMAC, now);
        let buffer = 0;
        assert_eq!(queue.open(&mut bus, buffer, &setup(1, 40)).unwrap(), Outcome::Done);
        let deadline = now + Duration::from_secs(1);
        let lines = || vec![vec![(0x000E23, 0x500000)]; 3];
        for (ticket, deadline) in [(1, deadline), (2, deadline), (3, deadline + Duration::from_secs(1))] {
            let lines = lines().into();
            let batch = Batch { ticket: Ticket(ticket), buffer, first: None, lines, deadline };
            assert!(queue.submit(batch, now).is_none());
        }
        // The buffer has room for all batches, but the thread was stopped until the deadline.
        for ticket in [1, 2] {
            let event = queue.poll(&mut bus, deadline).unwrap();
            assert!(
                matches!(event, Some(Event::Done(Ticket(t), Outcome::TimedOut)) if t == ticket),
                "{event:?}"
            );
        }
        let event = queue.poll(&mut bus, deadline).unwrap();
        assert!(matches!(event, Some(Event::Done(Ticket(3), Outcome::Done))), "{event:?}");
        let state = queue.state(&mut bus, Ticket(4), buffer).unwrap();
        assert!(matches!(state, Event::Rotary(_, state) if state.sent_lines == 3), "{state:?}");
        assert_eq!(queue.due(), None);
    }
}
