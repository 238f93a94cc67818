//! Whether interrupts announce responses. A connected interrupt may never come: I56 is 0, the jumper is missing, or the
//! interrupt belongs to another line.

use std::time::Instant;

use crate::daemon::bus::timing::INTERRUPT_APART;
use crate::function::line_port::AsciiEvent;

/// The reliability of the interrupts of the port in use.
#[derive(Debug, Default)]
pub(super) struct Announced {
    is_connected: bool,
    /// Interrupts have come, and since then no response without an interrupt.
    is_proven: bool,
    last: Option<Instant>,
    /// Since when a response waits for its interrupt.
    unannounced: Option<Instant>,
}

impl Announced {
    /// Interrupts can come, or not. Returns whether that is new.
    pub(super) fn connect(&mut self, is_connected: bool) -> bool {
        let is_new = self.is_connected != is_connected;
        if is_new {
            *self = Self { is_connected, ..Self::default() };
        }
        is_new
    }

    /// An interrupt came.
    pub(super) const fn interrupt(&mut self, now: Instant) {
        (self.is_proven, self.last, self.unannounced) = (true, Some(now), None);
    }

    /// The port has told `event`. If the board put out a text, an interrupt should announce it.
    pub(super) fn see(&mut self, event: &AsciiEvent, now: Instant) {
        if matches!(
            event,
            AsciiEvent::Line(_) | AsciiEvent::ProgramResponse(_) | AsciiEvent::ProgramMessage(_)
        ) {
            self.response(now);
        }
    }

    fn response(&mut self, now: Instant) {
        if self.last.is_none_or(|last| now.saturating_duration_since(last) > INTERRUPT_APART) {
            self.unannounced.get_or_insert(now);
        }
    }

    /// Gives up an interrupt that did not come in time.
    pub(super) fn tend(&mut self, now: Instant) {
        self.is_proven &=
            self.unannounced.is_none_or(|since| now.saturating_duration_since(since) <= INTERRUPT_APART);
    }

    /// Whether interrupts announce responses.
    pub(super) const fn is_proven(&self) -> bool {
        self.is_connected && self.is_proven
    }

    /// Whether the daemon need not poll for responses: none waits for its interrupt.
    pub(super) const fn is_sure(&self) -> bool {
        self.is_proven() && self.unannounced.is_none()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn interrupts_are_relied_on_while_they_come() {
        let begin = Instant::now();
        let at = |ms| begin + Duration::from_millis(ms);
        let mut announced = Announced::default();
        assert!(announced.connect(true) && !announced.connect(true));
        assert!(!announced.is_proven(), "none has come yet");
        announced.response(at(0));
        announced.interrupt(at(1));
        announced.tend(at(500));
        assert!(announced.is_proven(), "a poll may take the response first");
        announced.interrupt(at(1000));
        announced.response(at(1001));
        announced.tend(at(2000));
        assert!(announced.is_proven());
        announced.response(at(3000));
        announced.tend(at(3100));
        assert!(announced.is_proven(), "it may still come");
        announced.response(at(3101));
        announced.tend(at(3101));
        assert!(!announced.is_proven(), "it has not come");
        announced.interrupt(at(4000));
        assert!(announced.is_proven());
        assert!(announced.connect(false) && !announced.is_proven());
        assert!(announced.connect(true) && !announced.is_proven(), "it may be another one");
    }
}
