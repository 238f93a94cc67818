//! Events for the socket's thread: sent at once, or as soon as its queue has room.

use std::collections::VecDeque;

use super::check::REPLY_LINES;
use crate::daemon::shared::queue::{Event, Sender};

/// After so many reply lines the daemon wakes the socket's thread: a long listing must not fill its queue.
const LINES_UNHEARD: u32 = 64;
/// The most events of one response: the held-back lines, the line that settles them, programs' errors, the end.
const AT_ONCE: usize = REPLY_LINES + 4;

/// The events that wait for room.
pub(super) struct Outbox {
    events: VecDeque<Event>,
    /// Reply lines sent since the last other event.
    lines_unheard: u32,
}

impl Default for Outbox {
    fn default() -> Self {
        Self { events: VecDeque::with_capacity(AT_ONCE), lines_unheard: 0 }
    }
}

impl Outbox {
    /// Whether no event waits for room.
    pub(super) fn is_empty(&self) -> bool {
        self.events.is_empty()
    }

    /// Sends the events that had no room.
    pub(super) fn retry(&mut self, events: &Sender<Event>) {
        while let Some(event) = self.events.pop_front() {
            if let Some(event) = self.offer(events, event) {
                return self.events.push_front(event);
            }
        }
    }

    /// Puts an event into the socket's queue, or keeps it until there is room. Reply lines do not wake the socket's
    /// thread; the reply's end does.
    pub(super) fn tell(&mut self, events: &Sender<Event>, event: Event) {
        debug_assert!(self.events.len() < AT_ONCE, "what waits for room is told first");
        let unsent = if self.is_empty() { self.offer(events, event) } else { Some(event) };
        self.events.extend(unsent);
    }

    /// Puts the event into the queue, or returns it if the queue is full.
    fn offer(&mut self, events: &Sender<Event>, event: Event) -> Option<Event> {
        let is_line = matches!(event, Event::Line(..));
        self.lines_unheard = if is_line { self.lines_unheard + 1 } else { 0 };
        let wakes = self.lines_unheard.is_multiple_of(LINES_UNHEARD);
        if wakes { events.try_send(event) } else { events.try_put(event) }.err()
    }
}
