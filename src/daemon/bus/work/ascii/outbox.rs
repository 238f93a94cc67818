//! What the socket is told: at once, or as soon as its queue has room.

use crate::daemon::shared::queue::{Event, Sender};

/// Lines of a reply that the socket's thread is told at once: a long listing must not fill its queue.
const LINES_UNHEARD: u32 = 64;

/// The event that waits for room.
#[derive(Default)]
pub(super) struct Outbox {
    event: Option<Event>,
    /// Lines of a reply told since something else was.
    lines_unheard: u32,
}

impl Outbox {
    /// Whether nothing waits for room.
    pub(super) const fn is_empty(&self) -> bool {
        self.event.is_none()
    }

    /// Tries to tell what had no room.
    pub(super) fn retry(&mut self, events: &Sender<Event>) {
        if let Some(event) = self.event.take() {
            self.tell(events, event);
        }
    }

    /// Puts an event into the socket's queue, or keeps it until there is room. A line of a reply is told with the reply's end.
    pub(super) fn tell(&mut self, events: &Sender<Event>, event: Event) {
        debug_assert!(self.event.is_none(), "what waits for room is told first");
        let is_line = matches!(event, Event::Line(..));
        self.lines_unheard = if is_line { self.lines_unheard + 1 } else { 0 };
        let wakes = self.lines_unheard.is_multiple_of(LINES_UNHEARD);
        self.event = if wakes { events.try_send(event) } else { events.try_put(event) }.err();
    }
}
