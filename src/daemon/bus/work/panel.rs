//! Requests to the control panel: one at a time, each until the board has taken it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once};
use crate::device::{Bus, BusError};
use crate::function::panel::{FeedOverride, Panel, PanelBusError, PanelRequest};
use crate::map::Family;

/// How long the panel is left alone after a request was withdrawn; longer than two background passes of a busy board.
const REST: Duration = Duration::from_millis(50);
/// How often to ask whether the board has taken a request.
const POLL: Duration = Duration::from_millis(1);

#[derive(Debug)]
struct Waiting {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
}

#[derive(Debug, Clone, Copy)]
struct Pending {
    ticket: Ticket,
    mask: u32,
    deadline: Instant,
}

/// The requests that wait, and the one that lies in the panel.
#[derive(Debug)]
pub struct PanelQueue {
    panel: Panel,
    /// The I-variable that enables the panel.
    enable: Option<u16>,
    waiting: VecDeque<Waiting>,
    /// The request that lies in the panel.
    pending: Option<Pending>,
    /// What is to be told of a request that was cut off: whose it was, and what became of it.
    cut_off: Option<(Ticket, Outcome)>,
    /// After a request was withdrawn, until when the panel rests: PMAC may have been at work on it, and clears the mask when
    /// it is done, which must not look as if it had taken the next one.
    rests_until: Option<Instant>,
    next_poll: Instant,
}

impl PanelQueue {
    /// No requests yet, for the panel of `family`; `None` if it has none.
    #[must_use]
    pub fn new(family: &'static Family, now: Instant) -> Option<Self> {
        Some(Self {
            panel: Panel::new(family.panel.as_ref()?),
            enable: family.i.panel,
            waiting: VecDeque::with_capacity(at_once::PANEL + at_once::STOPS),
            pending: None,
            cut_off: None,
            rests_until: None,
            next_poll: now,
        })
    }

    fn not_taken(&self) -> Outcome {
        let enable = self.enable.map_or_else(|| ".".to_owned(), |number| format!("; is I{number}=3?"));
        Outcome::Refused(Text::of(&format_args!(
            "the board did not take the panel request in time{enable} It has been withdrawn"
        )))
    }

    /// Withdraws what a dead host left requested, and takes over the overrides that are in force.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.cut_off(bus)?;
        self.panel.acquire(bus)?;
        self.rests_until = Some(now + REST);
        Ok(())
    }

    /// Withdraws a request the board has not taken: nobody will be there to know what becomes of it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.cut_off(bus)?;
        self.panel.withdraw(bus)
    }

    /// Nobody waits any more for the board to take what lies in the panel. Whether it has may be seen for the last time.
    fn cut_off(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        let Some(Pending { ticket, mask, .. }) = self.pending.take() else { return Ok(()) };
        // Unless it lies there as it was written, the board took it before the reset, or a memory test cleared it.
        self.cut_off = Some((ticket, Outcome::TimedOut));
        if self.panel.mask(bus)? == mask {
            let reason = "the board was reset, or replaced, before it took the panel request, which has been withdrawn";
            self.cut_off = Some((ticket, Outcome::Refused(Text::of(&reason))));
        }
        Ok(())
    }

    /// Takes a request in.
    pub fn submit(&mut self, ticket: Ticket, request: PanelRequest, deadline: Instant, now: Instant) {
        self.waiting.push_back(Waiting { ticket, request, deadline });
        self.next_poll = now;
    }

    /// Forgets every request that waits and is not a stop, and makes one of those that are: nobody will be told of each.
    pub fn keep_stops(&mut self) {
        self.waiting.retain(|waiting| waiting.request.is_stop());
        if let Some(mut stop) = self.waiting.pop_front() {
            for Waiting { request, deadline, .. } in self.waiting.drain(..) {
                stop.request = stop.request.together_with(&request);
                stop.deadline = stop.deadline.max(deadline);
            }
            self.waiting.push_back(stop);
        }
    }

    /// Sets or releases an override; done at once.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn set_override(
        &mut self,
        bus: &mut impl Bus,
        number: usize,
        value: Option<FeedOverride>,
    ) -> Result<Outcome, BusError> {
        let result = match value {
            Some(value) => self.panel.set_override(bus, number, value).map(|_| ()),
            None => self.panel.release_override(bus, number).map(|_| ()),
        };
        match result {
            Ok(()) => Ok(Outcome::Done),
            Err(PanelBusError::Refused(reason)) => Ok(Outcome::Refused(Text::of(&reason))),
            Err(PanelBusError::Bus(error)) => Err(error),
        }
    }

    /// When to poll next; `None` while nothing is to be done.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        let has_work = self.pending.is_some() || self.cut_off.is_some() || !self.waiting.is_empty();
        has_work.then_some(self.next_poll)
    }

    /// Does what can be done now; tells what has ended.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        self.next_poll = now + POLL;
        if let Some(Pending { ticket, deadline, .. }) = self.pending {
            if self.panel.taken(bus)? {
                self.pending = None;
                self.next_poll = now;
                return Ok(Some(Event::Done(ticket, Outcome::Done)));
            }
            if now < deadline {
                return Ok(None);
            }
            // It must not be carried out by surprise, when the panel is enabled one day.
            self.panel.withdraw(bus)?;
            self.pending = None;
            self.rests_until = Some(now + REST);
            return Ok(Some(Event::Done(ticket, self.not_taken())));
        }
        if let Some((ticket, outcome)) = self.cut_off.take() {
            return Ok(Some(Event::Done(ticket, outcome)));
        }
        let Some(next) = self.waiting.pop_front() else { return Ok(None) };
        if now >= next.deadline {
            return Ok(Some(Event::Done(next.ticket, self.not_taken())));
        }
        let rests = self.rests_until.take_if(|until| now < *until);
        if rests.is_none() && self.panel.begin(bus, &next.request)? {
            self.pending =
                Some(Pending { ticket: next.ticket, mask: next.request.mask(), deadline: next.deadline });
        } else {
            self.rests_until = rests;
            self.waiting.push_front(next);
        }
        Ok(None)
    }
}

impl<B: Bus> BoardFunction<B> for PanelQueue {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        self.due().map(|due| clock.ns_of(due))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        Ok(Polled { answer: PanelQueue::poll(self, context.bus, context.clock.now())?, ..Polled::default() })
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        Ok(PanelQueue::acquire(self, context.bus, context.clock.now())?)
    }
    /// Overrides stay: a machine's speed must not change because its daemon stops.
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        PanelQueue::leave(self, bus)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::function::panel::PanelAction;
    use crate::map::{PMAC, pmac};

    const PANEL: &crate::map::PanelBlock = &pmac::PANEL_BLOCK;

    fn memory() -> FileBoard {
        let file = tempfile::tempfile().unwrap();
        file.set_len(PMAC.length.into()).unwrap();
        FileBoard::from_file(&file, PMAC.length as usize).unwrap()
    }

    #[test]
    fn one_after_the_other_and_none_by_surprise() {
        let mut bus = memory();
        let begun = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
        queue.acquire(&mut bus, begun).unwrap();
        let request = |number| PanelRequest::of(PANEL, PanelAction::JogPlus, &[number]).unwrap();
        for number in 1..=3 {
            let deadline = begun + REST + POLL * 10;
            queue.submit(Ticket(number as u64), request(number), deadline, begun);
        }
        assert!(queue.poll(&mut bus, begun).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0, "it rests after it was taken over");
        let now = begun + REST;
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 1);
        assert!(queue.poll(&mut bus, now).unwrap().is_none(), "the board has not taken it");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 2);
        let late = now + POLL * 10;
        for ticket in [2, 3] {
            let event = queue.poll(&mut bus, late).unwrap();
            assert!(
                matches!(event, Some(Event::Done(Ticket(t), Outcome::Refused(_))) if t == ticket),
                "{event:?}"
            );
            assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0, "withdrawn, or never written");
        }
        assert!(queue.due().is_none());
    }

    #[test]
    fn at_the_end_every_stop_has_its_place() {
        let mut bus = memory();
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let deadline = now + REST;
        let jog = PanelRequest::of(PANEL, PanelAction::JogPlus, &[1]).unwrap();
        let stop = |number| PanelRequest::of(PANEL, PanelAction::JogStop, &[number]).unwrap();
        for ticket in 0..16 {
            queue.submit(Ticket(ticket), jog, deadline, now);
        }
        queue.submit(Ticket(98), stop(2), deadline, now);
        queue.keep_stops();
        for number in 1..=8 {
            queue.submit(Ticket(100), stop(number), deadline, now);
        }
        queue.keep_stops();
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0xFF, "one request for all");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(queue.poll(&mut bus, now).unwrap().is_some());
        assert_eq!(queue.due(), None, "no jog is left");
    }

    #[test]
    fn a_request_under_way_is_answered_however_often_the_board_is_taken_over() {
        let mut bus = memory();
        let begun = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
        let request = PanelRequest::of(PANEL, PanelAction::JogPlus, &[1]).unwrap();
        // What the mask is when the board is taken over, and whether the request was surely not carried out.
        for (ticket, (mask, untouched)) in (7..).zip([(1, true), (0, false), (0xFFFF, false)]) {
            let now = begun + (ticket as u32) * REST;
            queue.submit(Ticket(ticket), request, now + REST, now);
            assert!(queue.poll(&mut bus, now).unwrap().is_none());
            assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 1, "it lies in the panel");
            bus.write16(PANEL.request_enable, mask).unwrap();
            queue.leave(&mut bus).unwrap();
            queue.acquire(&mut bus, now).unwrap();
            queue.acquire(&mut bus, now).unwrap();
            let event = queue.poll(&mut bus, now).unwrap();
            let Some(Event::Done(told, outcome)) = event else { panic!("{event:?}") };
            assert_eq!((told, matches!(outcome, Outcome::TimedOut)), (Ticket(ticket), !untouched));
            if untouched {
                assert!(format!("{outcome:?}").contains("the board was reset"), "{outcome:?}");
            }
            assert_eq!((queue.due(), bus.read16(PANEL.request_enable).unwrap()), (None, 0));
        }
    }
}
