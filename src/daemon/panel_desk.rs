//! The desk in front of the control panel: one request at a time, each until the board has taken it.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::queue::{Event, Outcome, Text, Ticket};
use crate::device::{Bus, BusError};
use crate::function::panel::{FeedOverride, Panel, PanelBusError, PanelRequest};

/// How long the panel is left alone after a request was withdrawn; longer than two background passes of a busy board.
const REST: Duration = Duration::from_millis(50);
/// Requests that may wait.
const WAITING_MAX: usize = 32;
/// How often to look whether the board has taken a request.
const LOOK: Duration = Duration::from_millis(1);

#[derive(Debug)]
struct Waiting {
    ticket: Ticket,
    request: PanelRequest,
    deadline: Instant,
}

/// The desk.
#[derive(Debug)]
pub struct PanelDesk {
    panel: Panel,
    waiting: VecDeque<Waiting>,
    /// The request that lies in the panel.
    lying: Option<(Ticket, Instant)>,
    /// Of a request that was withdrawn, whose it was, and until when the panel rests: PMAC may have been at work on it, and
    /// clears the mask when it is done, which must not look as if it had taken the next one.
    withdrawn: Option<Ticket>,
    rests_until: Option<Instant>,
    next_look: Instant,
}

impl PanelDesk {
    /// A desk that has not looked at the board yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            panel: Panel::new(),
            waiting: VecDeque::with_capacity(WAITING_MAX),
            lying: None,
            withdrawn: None,
            rests_until: None,
            next_look: Instant::now(),
        }
    }

    /// Withdraws what a dead host left requested, and takes over the overrides that are in force.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_over(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.panel.take_over(bus)?;
        // Taken over again before its answer went out, it still has to have one.
        if let Some((ticket, _)) = self.lying.take() {
            self.withdrawn = Some(ticket);
        }
        self.rests_until = Some(Instant::now() + REST);
        Ok(())
    }

    /// Withdraws a request the board has not taken: nobody will be there to know what becomes of it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        Panel::withdraw(bus)
    }

    /// Takes a request in, or refuses it.
    pub fn submit(&mut self, ticket: Ticket, request: PanelRequest, deadline: Instant) -> Option<Event> {
        if self.waiting.len() == WAITING_MAX {
            return Some(Event::Done(ticket, Outcome::Refused(Text::of(&"too many panel requests wait"))));
        }
        self.waiting.push_back(Waiting { ticket, request, deadline });
        self.next_look = Instant::now();
        None
    }

    /// Forgets every request that waits and is not a stop.
    pub fn keep_stops(&mut self) {
        self.waiting.retain(|waiting| waiting.request.stops() == waiting.request.mask);
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

    /// When to pass next; `None` while nothing is to be done.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        let has_work = self.lying.is_some() || self.withdrawn.is_some() || !self.waiting.is_empty();
        has_work.then_some(self.next_look)
    }

    /// Does what can be done now; tells what has ended.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        self.next_look = now + LOOK;
        if let Some((ticket, deadline)) = self.lying {
            if Panel::taken(bus)? {
                self.lying = None;
                self.next_look = now;
                return Ok(Some(Event::Done(ticket, Outcome::Done)));
            }
            if now < deadline {
                return Ok(None);
            }
            // It must not be carried out by surprise, when the panel is enabled one day.
            Panel::withdraw(bus)?;
            self.lying = None;
            self.rests_until = Some(now + REST);
            return Ok(Some(Event::Done(ticket, not_taken())));
        }
        if let Some(ticket) = self.withdrawn.take() {
            return Ok(Some(Event::Done(ticket, not_taken())));
        }
        let Some(next) = self.waiting.pop_front() else { return Ok(None) };
        if now >= next.deadline {
            return Ok(Some(Event::Done(next.ticket, not_taken())));
        }
        let rests = self.rests_until.take_if(|until| now < *until);
        if rests.is_none() && Panel::begin(bus, &next.request)? {
            self.lying = Some((next.ticket, next.deadline));
        } else {
            self.rests_until = rests;
            self.waiting.push_front(next);
        }
        Ok(None)
    }
}

impl Default for PanelDesk {
    fn default() -> Self {
        Self::new()
    }
}

fn not_taken() -> Outcome {
    Outcome::Refused(Text::of(
        &"the board did not take the panel request in time; is I2=3? It has been withdrawn",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::function::panel::PanelAction;
    use crate::map::classic::PANEL_REQUEST_ENABLE;

    #[test]
    fn one_after_the_other_and_none_by_surprise() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut desk = PanelDesk::new();
        desk.take_over(&mut bus).unwrap();
        let begun = Instant::now();
        let request = |number| PanelRequest::of(PanelAction::JogPlus, &[number]).unwrap();
        for number in 1..=3 {
            let deadline = begun + REST + LOOK * 10;
            assert!(desk.submit(Ticket(number as u64), request(number), deadline).is_none());
        }
        assert!(desk.pass(&mut bus, begun).unwrap().is_none());
        assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 0, "it rests after it was taken over");
        let now = begun + REST;
        assert!(desk.pass(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 1);
        assert!(desk.pass(&mut bus, now).unwrap().is_none(), "the board has not taken it");
        bus.write16(PANEL_REQUEST_ENABLE, 0).unwrap();
        assert!(matches!(desk.pass(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
        assert!(desk.pass(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 2);
        let late = now + LOOK * 10;
        for ticket in [2, 3] {
            let event = desk.pass(&mut bus, late).unwrap();
            assert!(
                matches!(event, Some(Event::Done(Ticket(t), Outcome::Refused(_))) if t == ticket),
                "{event:?}"
            );
            assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 0, "withdrawn, or never written");
        }
        assert!(desk.due().is_none());
    }

    #[test]
    fn a_request_under_way_is_answered_however_often_the_board_is_taken_over() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut desk = PanelDesk::new();
        let now = Instant::now();
        let request = PanelRequest::of(PanelAction::JogPlus, &[1]).unwrap();
        assert!(desk.submit(Ticket(7), request, now + REST).is_none());
        assert!(desk.pass(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 1, "it lies in the panel");
        desk.take_over(&mut bus).unwrap();
        desk.take_over(&mut bus).unwrap();
        assert!(matches!(
            desk.pass(&mut bus, now).unwrap(),
            Some(Event::Done(Ticket(7), Outcome::Refused(_)))
        ));
        assert_eq!(desk.due(), None);
    }
}
