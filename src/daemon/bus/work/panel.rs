//! Requests to the control panel: one at a time, each until the board has taken it.
//!
//! The board clears the panel's mask when it has taken a request, even a request that the daemon withdrew meanwhile. So
//! the panel rests after a withdrawal, and after the start. A stop does not wait: the daemon writes it at once. While
//! the panel rests the daemon writes the stop once more, since the board's first clearing may be for the withdrawn
//! request.

use std::collections::VecDeque;
use std::time::Instant;

use log::warn;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::timing::PANEL_POLL;
use crate::daemon::bus::work::kill::Kill;
use crate::daemon::bus::work::open_loops::OpenLoops;
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket, at_once, dropped_by};
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::function::panel::{FeedOverride, PANEL_REST, Panel, PanelBusError, PanelRequest};
use crate::map::{Family, Motors};
use crate::protocol::control;

#[derive(Debug)]
struct WaitingRequest {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// The request stops a jog that no client holds any more; it leaves out motors with an open loop.
    ends_hold: bool,
    /// The outcome, once a client has stopped all motion: the request no longer goes.
    dropped: Option<Outcome>,
    /// The request is a stop, and `^K` came after it.
    before_kill: bool,
}

impl WaitingRequest {
    const fn new(ticket: Ticket, request: PanelRequest, deadline: Instant, ends_hold: bool) -> Self {
        Self { ticket, request, deadline, ends_hold, dropped: None, before_kill: false }
    }
}

#[derive(Debug, Clone, Copy)]
struct PendingRequest {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
    /// The bus thread has written the request while the panel rests, and writes it once more.
    again: bool,
    /// The request stops a jog that no client holds any more.
    ends_hold: bool,
}

/// The requests that wait, and the request in the panel.
#[derive(Debug)]
pub struct PanelQueue {
    panel: Panel,
    /// The I-variable that enables the panel.
    enable: Option<u16>,
    waiting: VecDeque<WaitingRequest>,
    /// The request in the panel.
    pending: Option<PendingRequest>,
    /// An abandoned request, with an unknown outcome.
    abandoned: Option<Ticket>,
    /// When the panel has rested: this daemon or one before it has withdrawn a request.
    rests_until: Instant,
    next_poll: Instant,
    open_loops: OpenLoops,
    kill: Kill,
}

impl PanelQueue {
    /// No requests yet, for the panel of `family`; `None` if the family has no panel.
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

    /// The outcome of a request whose time is over. `was_made`: the request was in the panel.
    fn not_taken(&self, was_made: bool) -> Outcome {
        let enable = self.enable.map_or_else(|| ".".to_owned(), |number| format!("; is I{number}=3?"));
        let told = format_args!("the board did not take the panel request in time{enable}");
        if was_made {
            // The board may have begun the request just before the withdrawal.
            Outcome::Interrupted(Text::of(&format_args!("{told} It has been withdrawn")))
        } else {
            let what = "It was not carried out: the panel was not free for it";
            Outcome::Refused(Text::of(&format_args!("{told} {what}")))
        }
    }

    /// Withdraws a dead host's request, and adopts the overrides in force.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.abandon();
        self.panel.acquire(bus)?;
        self.rests_until = now + PANEL_REST;
        Ok(())
    }

    /// Withdraws a request that the board has not taken: the daemon ends and cannot watch it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.abandon();
        self.panel.withdraw(bus)
    }

    /// Stops waiting for the board to take the request. Even while the mask is set the board may have carried the
    /// request out: a board may clear the mask only afterwards.
    fn abandon(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.abandoned = Some(pending.ticket);
        }
    }

    /// Accepts a request.
    pub fn submit(&mut self, ticket: Ticket, request: PanelRequest, deadline: Instant, now: Instant) {
        self.waiting.push_back(WaitingRequest::new(ticket, request, deadline, false));
        self.next_poll = now;
    }

    /// Accepts the stop of motors whose held jog is over.
    pub fn end_hold(&mut self, ticket: Ticket, motors: Motors, deadline: Instant, now: Instant) {
        let request = PanelRequest::jog_stop(motors.bits());
        self.waiting.push_back(WaitingRequest::new(ticket, request, deadline, true));
        self.next_poll = now;
    }

    /// User `uid` is about to stop all motion by `character`. No request that moves a motor goes after it. A stop would
    /// close the loops that `^K` opens: so stops wait until the board has taken `^K`, and are then done. The daemon
    /// withdraws the request in the panel before it writes the character: the board looks at both in one pass, in an
    /// unknown order.
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
            (self.pending, self.rests_until) = (None, now + PANEL_REST);
            let PendingRequest { ticket, request, deadline, ends_hold, .. } = pending;
            let mut taken_back = WaitingRequest::new(ticket, request, deadline, ends_hold);
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

    /// Notes the state of `^K`.
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

    /// The reports' view of the motors' loops.
    pub fn loops_mut(&mut self) -> &mut OpenLoops {
        &mut self.open_loops
    }

    /// The motors whose loop is known for sure to be open, except those of the request in the panel: it may close their
    /// loop at any time.
    #[must_use]
    pub fn open_loops(&self) -> Motors {
        let requested = self.pending.map_or(Motors::NONE, |pending| motors_of(&pending.request));
        self.open_loops.known().without(requested)
    }

    /// Forgets every waiting request except stops. Joins the stops to one, or to two with the stops of held jogs: no
    /// caller waits for the outcome of each.
    pub fn keep_stops(&mut self) {
        self.waiting.retain(|waiting| waiting.request.is_stop());
        let mut kept: [Option<WaitingRequest>; 2] = [None, None];
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

    /// Sets or releases an override at once.
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

    /// When to poll next; `None` while no request waits.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        self.is_busy().then_some(self.next_poll)
    }

    /// Whether a request waits, or is in the panel.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.pending.is_some() || self.abandoned.is_some() || !self.waiting.is_empty()
    }

    /// Does the work that is due; returns a request's end.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        self.next_poll = now + PANEL_POLL;
        if let Some(pending) = self.pending {
            let PendingRequest { ticket, request, deadline, again, .. } = pending;
            self.open_loops.doubt(motors_of(&request));
            if again {
                if self.panel.begin(bus, &request)? {
                    self.pending = Some(PendingRequest { again: false, ..pending });
                    return Ok(None);
                }
            } else if self.panel.taken(bus)? {
                self.pending = None;
                self.next_poll = now;
                return Ok(Some(Event::Done(ticket, Outcome::Done)));
            }
            if now < deadline {
                // A stop that has waited past its deadline ends here: the daemon sends it another way.
                let is_late =
                    |waiting: &WaitingRequest| waiting.request.ends_motion() && now >= waiting.deadline;
                let late = self.waiting.iter().position(is_late).and_then(|index| self.waiting.remove(index));
                return Ok(late.map(|stop| Event::Done(stop.ticket, self.not_taken(false))));
            }
            // Otherwise the board would carry the request out by surprise, once somebody enables the panel.
            self.panel.withdraw(bus)?;
            self.pending = None;
            self.rests_until = now + PANEL_REST;
            return Ok(Some(Event::Done(ticket, self.not_taken(true))));
        }
        if let Some(ticket) = self.abandoned.take() {
            return Ok(Some(Event::Done(ticket, Outcome::TimedOut)));
        }
        let dropped = self.waiting.iter().position(|waiting| waiting.dropped.is_some());
        if let Some(WaitingRequest { ticket, dropped: Some(outcome), .. }) =
            dropped.and_then(|index| self.waiting.remove(index))
        {
            self.next_poll = now;
            return Ok(Some(Event::Done(ticket, outcome)));
        }
        let rests = now < self.rests_until;
        let goes =
            |waiting: &WaitingRequest| !rests || waiting.request.ends_motion() || now >= waiting.deadline;
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
        let WaitingRequest { ticket, request, deadline, ends_hold, .. } = next;
        if self.panel.begin(bus, &request)? {
            self.pending = Some(PendingRequest { ticket, request, deadline, again: rests, ends_hold });
            // A request that the stop has overtaken must not move a motor after it.
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

    /// The stop of a held jog, without the motors whose loop is open.
    fn without_open_loops(&self, stop: PanelRequest) -> PanelRequest {
        let (motors, open) = (motors_of(&stop), self.open_loops.known());
        if !motors.meets(open) {
            return stop;
        }
        warn!(
            target: "audit",
            "a held jog is over, and its motors (mask {:#04x}) get no stop: their loops are open (killed, a fault, or a reset), \
             and a stop would close them",
            motors.among(open).bits()
        );
        PanelRequest::jog_stop(motors.without(open).bits())
    }
}

/// The motors that a request may move. A number may be a coordinate system's, whose motors the daemon does not know.
fn motors_of(request: &PanelRequest) -> Motors {
    Motors::from_bits(request.mask())
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
#[path = "panel_tests.rs"]
mod tests;
