//! Requests to the control panel: one at a time, each until the board has taken it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use log::warn;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::bus::work::open_loops::OpenLoops;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once};
use crate::device::{Bus, BusError};
use crate::function::panel::{FeedOverride, Panel, PanelBusError, PanelRequest};
use crate::map::Family;

/// How long the panel is left alone after a request was withdrawn; longer than two background passes of a busy board. Not
/// for a stop, which is requested twice then.
const REST: Duration = Duration::from_millis(50);
/// How often to ask whether the board has taken a request.
const POLL: Duration = Duration::from_millis(1);

#[derive(Debug)]
struct Waiting {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// It stops a jog that nobody holds any more, and leaves out motors whose loop is open.
    ends_hold: bool,
}

#[derive(Debug, Clone, Copy)]
struct Pending {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// It goes once more when the board has taken it.
    twice: bool,
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
    /// A request was withdrawn, and no stop was seen to be taken since. PMAC clears the mask once more when it was at work on
    /// that request; the second clearing of a stop that is requested twice is the stop's own.
    doubtful: bool,
    next_poll: Instant,
    open_loops: OpenLoops,
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
            doubtful: false,
            next_poll: now,
            open_loops: OpenLoops::default(),
        })
    }

    fn not_taken(&self) -> Outcome {
        let enable = self.enable.map_or_else(|| ".".to_owned(), |number| format!("; is I{number}=3?"));
        Outcome::Refused(Text::of(&format_args!(
            "the board did not take the panel request in time{enable} It has been withdrawn; had the board just begun with it, it \
             may have been carried out"
        )))
    }

    /// Withdraws what a dead host left requested, and takes over the overrides that are in force.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.cut_off(bus)?;
        self.doubtful |= self.panel.acquire(bus)? != 0;
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
        let Some(Pending { ticket, request, .. }) = self.pending.take() else { return Ok(()) };
        // Unless it lies there as it was written, the board took it before the reset, or a memory test cleared it.
        self.cut_off = Some((ticket, Outcome::TimedOut));
        if self.panel.mask(bus)? == request.mask() {
            let reason = "the board was reset, or replaced, before it took the panel request, which has been withdrawn";
            self.cut_off = Some((ticket, Outcome::Refused(Text::of(&reason))));
        }
        Ok(())
    }

    /// Takes a request in.
    pub fn submit(&mut self, ticket: Ticket, request: PanelRequest, deadline: Instant, now: Instant) {
        self.waiting.push_back(Waiting { ticket, request, deadline, ends_hold: false });
        self.next_poll = now;
    }

    /// Takes in the stop of motors whose held jog is over; bit 0 is motor 1.
    pub fn end_hold(&mut self, ticket: Ticket, motors: u32, deadline: Instant, now: Instant) {
        let request = PanelRequest::jog_stop(motors);
        self.waiting.push_back(Waiting { ticket, request, deadline, ends_hold: true });
        self.next_poll = now;
    }

    /// Takes note of the motors whose loop was open when the servo report was updated for the `updates`th time.
    pub fn see_report(&mut self, open: u32, updates: u64) {
        self.open_loops.see(open, updates);
    }

    /// The motors whose loop is open, bit 0 being motor 1, as far as that is known for sure.
    #[must_use]
    pub const fn open_loops(&self) -> u32 {
        self.open_loops.known()
    }

    /// Forgets every request that waits and is not a stop, and makes one of those that are, or two where jogs that were held are
    /// among them: nobody will be told of each.
    pub fn keep_stops(&mut self) {
        self.waiting.retain(|waiting| waiting.request.is_stop());
        let mut kept: [Option<Waiting>; 2] = [None, None];
        for next in self.waiting.drain(..) {
            match &mut kept[usize::from(next.ends_hold)] {
                Some(stop) => {
                    stop.request = stop.request.together_with(&next.request);
                    stop.deadline = stop.deadline.max(next.deadline);
                }
                empty => *empty = Some(next),
            }
        }
        self.waiting.extend(kept.into_iter().flatten());
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
        if let Some(Pending { ticket, deadline, request, twice }) = self.pending {
            self.open_loops.doubt(request.mask());
            if twice {
                if self.panel.begin(bus, &request)? {
                    self.doubtful = false;
                    self.pending = Some(Pending { ticket, deadline, request, twice: false });
                    return Ok(None);
                }
            } else if self.panel.taken(bus)? {
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
            self.doubtful = true;
            self.rests_until = Some(now + REST);
            return Ok(Some(Event::Done(ticket, self.not_taken())));
        }
        if let Some((ticket, outcome)) = self.cut_off.take() {
            return Ok(Some(Event::Done(ticket, outcome)));
        }
        let Some(mut next) = self.waiting.pop_front() else { return Ok(None) };
        if now >= next.deadline {
            return Ok(Some(Event::Done(next.ticket, self.not_taken())));
        }
        let stops = next.request.is_stop();
        let rests = self.rests_until.filter(|until| now < *until && !stops);
        if next.ends_hold && rests.is_none() {
            next.request = self.without_open_loops(next.request);
            if next.request.mask() == 0 {
                return Ok(Some(Event::Done(next.ticket, Outcome::Done)));
            }
        }
        if rests.is_none() && self.panel.begin(bus, &next.request)? {
            let Waiting { ticket, request, deadline, .. } = next;
            self.pending = Some(Pending { ticket, request, deadline, twice: stops && self.doubtful });
        } else {
            self.waiting.push_front(next);
        }
        Ok(None)
    }

    /// Of the stop of a held jog, what is left without the motors whose loop is open.
    fn without_open_loops(&self, stop: PanelRequest) -> PanelRequest {
        let open = stop.mask() & self.open_loops.known();
        if open == 0 {
            return stop;
        }
        warn!(
            target: "audit",
            "a held jog is over, and its motors (mask {open:#04x}) get no stop: their loops are open (killed, or a fault), \
             and a stop would close them"
        );
        PanelRequest::jog_stop(stop.mask() & !open)
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
    fn the_stop_of_a_held_jog_leaves_a_killed_motor_alone() {
        let mut bus = memory();
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let deadline = now + REST;
        let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
        queue.see_report(0b010, 10);
        queue.end_hold(Ticket(1), 0b111, deadline, now);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b101);
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
        queue.end_hold(Ticket(2), 0b010, deadline, now);
        assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(2), Outcome::Done))));
        assert_eq!((mask(&mut bus), queue.due()), (0, None), "nothing was to be done");
        // A jog has just closed the loop, which the report does not know yet.
        let jog = PanelRequest::of(PANEL, PanelAction::JogPlus, &[2]).unwrap();
        queue.submit(Ticket(3), jog, deadline, now);
        queue.end_hold(Ticket(4), 0b010, deadline, now);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(queue.poll(&mut bus, now).unwrap().is_some());
        queue.see_report(0b010, 11);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b010, "it may be moving");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(queue.poll(&mut bus, now).unwrap().is_some());
        // What somebody asks for by himself is done, also at the end.
        queue.see_report(0b011, 20);
        let stop = PanelRequest::of(PANEL, PanelAction::JogStop, &[1]).unwrap();
        queue.end_hold(Ticket(5), 0b010, deadline, now);
        queue.submit(Ticket(6), stop, deadline, now);
        queue.keep_stops();
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b001);
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
