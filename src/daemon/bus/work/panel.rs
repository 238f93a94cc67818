//! Requests to the control panel: one at a time, each until the board has taken it.
//!
//! The board clears the panel's mask when it has taken a request, also one that was withdrawn while it did. So after a
//! withdrawal, and after the start, the panel rests. A stop does not wait: it goes at once, and in that time once more, since its
//! first clearing may be the withdrawn request's.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use log::warn;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::bus::work::kill::Kill;
use crate::daemon::bus::work::open_loops::OpenLoops;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once, dropped_by};
use crate::device::{Bus, BusError};
use crate::function::panel::{FeedOverride, Panel, PanelBusError, PanelRequest, SETTLE};
use crate::map::Family;
use crate::protocol::control;

/// How often to ask whether the board has taken a request.
const POLL: Duration = Duration::from_millis(1);
#[derive(Debug)]
struct Waiting {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// It stops a jog that nobody holds any more, and leaves out motors whose loop is open.
    ends_hold: bool,
    /// It is not to go any more: somebody has stopped all motion.
    dropped: Option<Outcome>,
    /// It stops, and `^K` came after it.
    before_kill: bool,
}

impl Waiting {
    const fn new(ticket: Ticket, request: PanelRequest, deadline: Instant, ends_hold: bool) -> Self {
        Self { ticket, request, deadline, ends_hold, dropped: None, before_kill: false }
    }
}

#[derive(Debug, Clone, Copy)]
struct Pending {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// It was put there while the panel rests, and goes once more.
    again: bool,
    /// It stops a jog that nobody holds any more.
    ends_hold: bool,
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
    /// A request that was abandoned: nobody knows what became of it.
    abandoned: Option<Ticket>,
    /// A request was withdrawn, by this daemon or one before it: when the panel has rested.
    rests_until: Instant,
    next_poll: Instant,
    open_loops: OpenLoops,
    kill: Kill,
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
            abandoned: None,
            rests_until: now,
            next_poll: now,
            open_loops: OpenLoops::default(),
            kill: Kill::default(),
        })
    }

    /// The time of a request is over.
    fn not_taken(&self, was_made: bool) -> Outcome {
        let enable = self.enable.map_or_else(|| ".".to_owned(), |number| format!("; is I{number}=3?"));
        let told = format_args!("the board did not take the panel request in time{enable}");
        if was_made {
            // The board may have begun with it just before it was withdrawn.
            Outcome::Interrupted(Text::of(&format_args!("{told} It has been withdrawn")))
        } else {
            let what = "It was not carried out: the panel was not free for it";
            Outcome::Refused(Text::of(&format_args!("{told} {what}")))
        }
    }

    /// Withdraws what a dead host left requested, and takes over the overrides that are in force.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.abandon();
        self.panel.acquire(bus)?;
        self.rests_until = now + SETTLE;
        Ok(())
    }

    /// Withdraws a request the board has not taken: nobody will be there to know what becomes of it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.abandon();
        self.panel.withdraw(bus)
    }

    /// Nobody waits any more for the board to take what lies in the panel. Also where the mask is still set the board may have
    /// carried the request out: it may clear the mask only then.
    fn abandon(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.abandoned = Some(pending.ticket);
        }
    }

    /// Takes a request in.
    pub fn submit(&mut self, ticket: Ticket, request: PanelRequest, deadline: Instant, now: Instant) {
        self.waiting.push_back(Waiting::new(ticket, request, deadline, false));
        self.next_poll = now;
    }

    /// Takes in the stop of motors whose held jog is over; bit 0 is motor 1.
    pub fn end_hold(&mut self, ticket: Ticket, motors: u32, deadline: Instant, now: Instant) {
        let request = PanelRequest::jog_stop(motors);
        self.waiting.push_back(Waiting::new(ticket, request, deadline, true));
        self.next_poll = now;
    }

    /// User `uid` is about to stop all motion by `character`. Nothing that moves a motor goes after it. A stop would close the
    /// loops that `^K` opens, so stops wait until the board has taken `^K`, and are done by it. What lies in the panel is
    /// withdrawn before the character is written: the board looks at both in one pass, and nobody knows at which first.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn make_way(
        &mut self,
        bus: &mut impl Bus,
        uid: u32,
        character: u8,
        now: Instant,
    ) -> Result<(), BusError> {
        let kills = character == control::KILL;
        let dropped = Outcome::Dropped(dropped_by(uid, character));
        if let Some(pending) = self.pending.filter(|pending| kills || !pending.request.is_stop()) {
            self.panel.withdraw(bus)?;
            (self.pending, self.rests_until) = (None, now + SETTLE);
            let Pending { ticket, request, deadline, ends_hold, .. } = pending;
            let mut taken_back = Waiting::new(ticket, request, deadline, ends_hold);
            let reason = "withdrawn, for somebody stopped all motion; it may have been carried out before";
            taken_back.dropped = Some(Outcome::Interrupted(Text::of(&reason)));
            self.waiting.push_front(taken_back);
        }
        for waiting in &mut self.waiting {
            if waiting.request.is_stop() {
                waiting.dropped = waiting.dropped.filter(|told| *told == Outcome::Done);
                waiting.before_kill |= kills;
            } else {
                waiting.dropped = waiting.dropped.or(Some(dropped));
            }
        }
        self.kill.is_under_way |= kills;
        Ok(())
    }

    /// Takes note of how far `^K` is.
    pub fn see_kill(&mut self, kill: Kill) {
        let was_taken = kill.taken != self.kill.taken;
        if was_taken || !kill.is_under_way {
            for waiting in self.waiting.iter_mut().filter(|waiting| waiting.before_kill) {
                waiting.before_kill = false;
                waiting.dropped = was_taken.then_some(Outcome::Done);
            }
        }
        self.kill = kill;
    }

    /// What the reports tell of the motors' loops goes here.
    pub fn loops_mut(&mut self) -> &mut OpenLoops {
        &mut self.open_loops
    }

    /// The motors whose loop is open, bit 0 being motor 1, as far as that is known for sure: not of those for which a request
    /// lies in the panel, which may close it at any time.
    #[must_use]
    pub fn open_loops(&self) -> u32 {
        let requested = self.pending.map_or(0, |pending| pending.request.mask());
        self.open_loops.known() & !requested
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
        self.is_busy().then_some(self.next_poll)
    }

    /// Whether a request waits, or lies in the panel.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.pending.is_some() || self.abandoned.is_some() || !self.waiting.is_empty()
    }

    /// Does what can be done now; tells what has ended.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        self.next_poll = now + POLL;
        if let Some(pending) = self.pending {
            let Pending { ticket, request, deadline, again, .. } = pending;
            self.open_loops.doubt(request.mask());
            if again {
                if self.panel.begin(bus, &request)? {
                    self.pending = Some(Pending { again: false, ..pending });
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
            self.rests_until = now + SETTLE;
            return Ok(Some(Event::Done(ticket, self.not_taken(true))));
        }
        if let Some(ticket) = self.abandoned.take() {
            return Ok(Some(Event::Done(ticket, Outcome::TimedOut)));
        }
        let dropped = self.waiting.iter().position(|waiting| waiting.dropped.is_some());
        if let Some(Waiting { ticket, dropped: Some(outcome), .. }) =
            dropped.and_then(|index| self.waiting.remove(index))
        {
            self.next_poll = now;
            return Ok(Some(Event::Done(ticket, outcome)));
        }
        let rests = now < self.rests_until;
        let goes = |waiting: &Waiting| !rests || waiting.request.ends_motion() || now >= waiting.deadline;
        let Some(index) = self.waiting.iter().position(goes) else { return Ok(None) };
        let Some(mut next) = self.waiting.remove(index) else { return Ok(None) };
        if now >= next.deadline {
            return Ok(Some(Event::Done(next.ticket, self.not_taken(false))));
        }
        if self.kill.is_under_way {
            self.waiting.insert(index, next);
            return Ok(None);
        }
        if next.ends_hold {
            next.request = self.without_open_loops(next.request);
            if next.request.mask() == 0 {
                return Ok(Some(Event::Done(next.ticket, Outcome::Done)));
            }
        }
        let Waiting { ticket, request, deadline, ends_hold, .. } = next;
        if self.panel.begin(bus, &request)? {
            self.pending = Some(Pending { ticket, request, deadline, again: rests, ends_hold });
            // What a stop has overtaken must not move a motor after it.
            let overtaken = Text::of(
                &"the panel request was not carried out: a stop came before the panel was free for it",
            );
            let overtaken = Some(Outcome::Refused(overtaken));
            self.waiting.range_mut(..index).for_each(|waiting| waiting.dropped = overtaken);
        } else {
            self.waiting.insert(index, next);
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
            "a held jog is over, and its motors (mask {open:#04x}) get no stop: their loops are open (killed, a fault, or a reset), \
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
        if let Some(answer) = PanelQueue::poll(self, context.bus, context.clock.now())? {
            context.intake.answer(answer);
        }
        Ok(Polled::default())
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        let now = context.clock.now();
        Ok(PanelQueue::acquire(self, context.bus, now)?)
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
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let request = |number| PanelRequest::of(PANEL, PanelAction::JogPlus, &[number]).unwrap();
        for number in 1..=3 {
            queue.submit(Ticket(number as u64), request(number), now + POLL * 10, now);
        }
        let first =
            |bus: &mut FileBoard| [PANEL.request_enable, PANEL.request].map(|at| bus.read16(at).unwrap());
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(first(&mut bus), [1, PanelAction::JogPlus.bits()]);
        assert!(queue.poll(&mut bus, now).unwrap().is_none(), "the board has not taken it");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 2);
        let late = now + POLL * 10;
        for ticket in [2, 3] {
            let event = queue.poll(&mut bus, late).unwrap();
            let Some(Event::Done(Ticket(of), outcome)) = event else { panic!("{event:?}") };
            assert_eq!((of, outcome.is_unsent()), (ticket, ticket == 3), "{outcome:?}");
            let told = if ticket == 2 { "It has been withdrawn" } else { "It was not carried out" };
            assert!(format!("{outcome:?}").contains(told), "{outcome:?}");
            assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0, "withdrawn, or never written");
        }
        assert!(queue.due().is_none());
    }

    #[test]
    fn after_a_withdrawal_what_moves_waits_and_a_stop_goes_at_once_and_twice() {
        let mut bus = memory();
        let begun = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
        queue.acquire(&mut bus, begun).unwrap();
        let request = |action, number| PanelRequest::of(PANEL, action, &[number]).unwrap();
        let (jog, stop) = (request(PanelAction::JogPlus, 1), request(PanelAction::JogStop, 2));
        let deadline = begun + SETTLE * 10;
        let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
        queue.submit(Ticket(1), jog, deadline, begun);
        assert!(queue.poll(&mut bus, begun).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0, "the jog waits");
        queue.submit(Ticket(2), stop, deadline, begun);
        for _ in 0..2 {
            assert!(queue.poll(&mut bus, begun).unwrap().is_none());
            assert_eq!(mask(&mut bus), 0b10, "the first clearing may be that of what was withdrawn");
            bus.write16(PANEL.request_enable, 0).unwrap();
        }
        let told = told(&mut queue, &mut bus, begun);
        let [(2, Outcome::Done), (1, Outcome::Refused(why))] = told[..] else { panic!("{told:?}") };
        assert!(why.contains("a stop came before the panel was free for it"), "{why:?}");
        queue.submit(Ticket(3), jog, begun + POLL, begun);
        queue.submit(Ticket(4), jog, deadline, begun);
        let told = self::told(&mut queue, &mut bus, begun + POLL);
        assert!(matches!(told[..], [(3, Outcome::Refused(_))]), "in its time: {told:?}");
        assert!(queue.poll(&mut bus, begun + SETTLE).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b01, "the panel has rested");
        bus.write16(PANEL.request_enable, 0).unwrap();
        let told = self::told(&mut queue, &mut bus, begun + SETTLE);
        assert_eq!(told, [(4, Outcome::Done)]);
    }

    #[test]
    fn at_the_end_every_stop_has_its_place() {
        let mut bus = memory();
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let deadline = now + POLL * 50;
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
        let deadline = now + POLL * 50;
        let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
        queue.loops_mut().see_servo(0b010, 10);
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
        assert_eq!(queue.open_loops(), 0b010);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(queue.open_loops(), 0, "the jog lies in the panel");
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        queue.loops_mut().see_servo(0b010, 11);
        queue.loops_mut().see_servo(0b010, 20);
        assert_eq!(queue.open_loops(), 0, "still, however many reports come");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(queue.poll(&mut bus, now).unwrap().is_some());
        queue.loops_mut().see_servo(0b010, 21);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b010, "it may be moving");
        bus.write16(PANEL.request_enable, 0).unwrap();
        assert!(queue.poll(&mut bus, now).unwrap().is_some());
        // What somebody asks for by himself is done, also at the end.
        queue.loops_mut().see_servo(0b011, 30);
        let stop = PanelRequest::of(PANEL, PanelAction::JogStop, &[1]).unwrap();
        queue.end_hold(Ticket(5), 0b010, deadline, now);
        queue.submit(Ticket(6), stop, deadline, now);
        queue.keep_stops();
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b001);
    }

    /// Polls until nothing is told any more: what was told.
    fn told(queue: &mut PanelQueue, bus: &mut FileBoard, now: Instant) -> Vec<(u64, Outcome)> {
        let events = (0..10).filter_map(|_| queue.poll(bus, now).unwrap());
        let told = events.map(|event| match event {
            Event::Done(Ticket(ticket), outcome) => (ticket, outcome),
            other => panic!("{other:?}"),
        });
        told.collect()
    }

    #[test]
    fn b2_6_a_stop_in_the_panel_never_closes_the_loop_that_a_kill_opens() {
        for is_taken in [true, false] {
            let mut bus = memory();
            let now = Instant::now();
            let mut queue = PanelQueue::new(&PMAC, now).unwrap();
            let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
            queue.end_hold(Ticket(1), 0b1, now + POLL * 50, now);
            let stop = PanelRequest::of(PANEL, PanelAction::JogStop, &[2]).unwrap();
            queue.submit(Ticket(2), stop, now + POLL * 50, now);
            assert!(queue.poll(&mut bus, now).unwrap().is_none());
            assert_eq!(mask(&mut bus), 0b1);
            queue.make_way(&mut bus, 7, control::KILL, now).unwrap();
            queue.make_way(&mut bus, 7, control::ABORT, now).unwrap();
            assert_eq!(mask(&mut bus), 0, "withdrawn before ^K is written");
            queue.see_kill(Kill { is_under_way: true, taken: 0 });
            assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (vec![], 0));
            queue.see_kill(Kill { is_under_way: false, taken: is_taken.into() });
            if is_taken {
                let done = vec![(1, Outcome::Done), (2, Outcome::Done)];
                assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (done, 0));
                assert_eq!(queue.due(), None);
            } else {
                assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (vec![], 0b1), "it goes on");
            }
        }
    }

    #[test]
    fn b1_6_nothing_that_moves_goes_after_an_abort() {
        for character in [control::ABORT, control::KILL] {
            let mut bus = memory();
            let now = Instant::now();
            let mut queue = PanelQueue::new(&PMAC, now).unwrap();
            let jog = |number| PanelRequest::of(PANEL, PanelAction::JogPlus, &[number]).unwrap();
            for number in 1..=2 {
                queue.submit(Ticket(number as u64), jog(number), now + POLL * 50, now);
            }
            assert!(queue.poll(&mut bus, now).unwrap().is_none());
            queue.make_way(&mut bus, 7, character, now).unwrap();
            assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0);
            let told = told(&mut queue, &mut bus, now);
            let [(1, Outcome::Interrupted(first)), (2, second)] = told[..] else { panic!("{told:?}") };
            assert!(first.contains("it may have been carried out before"), "{first:?}");
            assert_eq!(second, Outcome::Dropped(dropped_by(7, character)));
            assert_eq!((queue.due(), bus.read16(PANEL.request_enable).unwrap()), (None, 0));
        }
    }

    #[test]
    fn a_request_under_way_is_answered_however_often_the_board_is_taken_over() {
        let mut bus = memory();
        let begun = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
        let request = PanelRequest::of(PANEL, PanelAction::JogPlus, &[1]).unwrap();
        // What the mask is when the board is taken over: whatever it is, the board may have seen the request.
        for (ticket, mask) in (7..).zip([1, 0, 0xFFFF]) {
            let now = begun + (ticket as u32) * SETTLE;
            queue.submit(Ticket(ticket), request, now + POLL, now);
            assert!(queue.poll(&mut bus, now).unwrap().is_none());
            assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 1, "it lies in the panel");
            bus.write16(PANEL.request_enable, mask).unwrap();
            queue.leave(&mut bus).unwrap();
            queue.acquire(&mut bus, now).unwrap();
            queue.acquire(&mut bus, now).unwrap();
            let event = queue.poll(&mut bus, now).unwrap();
            assert!(
                matches!(event, Some(Event::Done(Ticket(t), Outcome::TimedOut)) if t == ticket),
                "{event:?}"
            );
            assert_eq!((queue.due(), bus.read16(PANEL.request_enable).unwrap()), (None, 0));
        }
    }
}
