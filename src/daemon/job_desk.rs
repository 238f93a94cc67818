//! The desks of the functions other than ASCII, as one: who gets a job, and when each is due.

use std::time::Instant;

use super::job::{Job, MaskedWord};
use super::panel_desk::PanelDesk;
use super::queue::{Event, Outcome, Ticket};
use super::rotary_desk::RotaryDesk;
use crate::device::{Bus, BusError};
use crate::map::HostOffset;

/// The desks.
#[derive(Debug, Default)]
pub struct JobDesk {
    panel: PanelDesk,
    rotary: RotaryDesk,
}

impl JobDesk {
    /// Puts the board's host words in order at the start, or after a reset.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_over(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.rotary.forget();
        self.panel.take_over(bus)
    }

    /// Leaves nothing requested on the way out. Overrides stay: a machine's speed must not change because its
    /// daemon stops.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.panel.leave(bus)
    }

    /// Takes a job in; tells its end if it has one at once.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn submit(
        &mut self,
        bus: &mut impl Bus,
        ticket: Ticket,
        job: Job,
        deadline: Instant,
    ) -> Result<Option<Event>, BusError> {
        let outcome = match job {
            Job::Panel(request) => return Ok(self.panel.submit(ticket, request, deadline)),
            Job::RotarySend { buffer, lines } => {
                return Ok(self.rotary.submit(ticket, buffer, lines, deadline));
            }
            Job::RotaryState(buffer) => return self.rotary.state(bus, ticket, buffer).map(Some),
            Job::Override { coordinate_system, value } => {
                self.panel.set_override(bus, coordinate_system, value)?
            }
            Job::Write { first, words } => write(bus, first, &words)?,
            Job::RotaryOpen(setup) => self.rotary.open(bus, &setup)?,
            Job::RotaryFinish(buffer) => self.rotary.finish(buffer),
        };
        Ok(Some(Event::Done(ticket, outcome)))
    }

    /// When to pass next; `None` while nothing is to be done.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        [self.panel.due(), self.rotary.due()].into_iter().flatten().min()
    }

    /// Does one bounded piece of what is due.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<Event>, BusError> {
        if self.panel.due().is_some_and(|due| due <= now) {
            return self.panel.pass(bus, now);
        }
        if self.rotary.due().is_some_and(|due| due <= now) {
            return self.rotary.pass(bus, now);
        }
        Ok(None)
    }
}

/// Writes words, ascending, of each only the bits of its mask.
fn write(bus: &mut impl Bus, first: HostOffset, words: &[MaskedWord]) -> Result<Outcome, BusError> {
    // Nothing is written unless all of it can be.
    let length = bus.length();
    let end = first.plus_words(words.len()).bytes() as usize;
    if end > length {
        return Ok(Outcome::OutOfRange);
    }
    for (index, word) in words.iter().enumerate() {
        let offset = first.plus_words(index);
        let value = if word.mask == u16::MAX {
            word.value
        } else {
            bus.read16(offset)? & !word.mask | word.value & word.mask
        };
        bus.write16(offset, value)?;
    }
    bus.order_writes();
    Ok(Outcome::Done)
}
