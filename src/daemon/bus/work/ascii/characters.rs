//! Whether the board takes control characters by the word of their own alone: `^A` and `^K` go that way.
//!
//! At the start and after each reset the daemon sends `^F` (the following errors of all motors), which has no side
//! effect. `status`, `doctor` and `abort` report at once a board that does not take it. Until the board has, a stop
//! also sets the flag of an empty line ([`crate::function::ascii::control`]).

use std::time::{Duration, Instant};

use log::warn;

use super::{AsciiQueue, InFlight, Poll};
use crate::daemon::bus::timing::{CHARACTER_AGAIN, CHARACTER_TAKEN};
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::{CommandPort, CommandState};

/// `^F`.
const QUESTION: u8 = b'F' - 64;

/// The daemon's knowledge of that.
#[derive(Debug)]
pub(super) struct Characters {
    not_before: Instant,
    /// The board did not take `^F`.
    in_vain: bool,
}

impl Characters {
    pub(super) const fn new(now: Instant) -> Self {
        Self { not_before: now, in_vain: false }
    }

    /// How long until the next `^F`.
    fn due_in(&self, now: Instant) -> Duration {
        self.not_before.saturating_duration_since(now)
    }

    /// The daemon took `^F` back, or another character replaced it.
    pub(super) fn not_taken(&mut self, now: Instant) {
        self.not_before = now + CHARACTER_AGAIN;
    }
}

impl AsciiQueue {
    /// Whether the board takes control characters by their word alone; `None`: the daemon has not asked yet.
    #[must_use]
    pub fn takes_characters(&self) -> Option<bool> {
        let takes = self.ports.dpram.takes_characters();
        (takes || self.characters.in_vain).then_some(takes)
    }

    /// How long until the next `^F`. A board that answers no lines gets none, nor does a recording.
    pub(super) fn characters_due_in(&self, now: Instant) -> Duration {
        let is_open = self.ports.in_use() == CommandPort::Dpram
            && !self.ports.dpram.takes_characters()
            && self.state == CommandState::Answers
            && !self.programs.is_replay;
        if is_open { self.characters.due_in(now) } else { Duration::MAX }
    }

    /// Sends `^F`; false: not now.
    pub(super) fn ask_for_characters(
        &mut self,
        bus: &mut impl Bus,
        poll: Poll<'_>,
    ) -> Result<bool, PortError> {
        let now = poll.now;
        let asked =
            self.control_pending.is_none() && self.ports.current_mut().control(bus, QUESTION, true, now)?;
        if asked {
            self.start(InFlight::Character, now + CHARACTER_TAKEN, poll);
        } else {
            // Another control character is in the word.
            self.characters.not_taken(now);
        }
        Ok(asked)
    }

    /// The board did not take `^F` in time.
    pub(super) fn characters_not_taken(&mut self, now: Instant) {
        self.characters.not_taken(now);
        if !self.ports.dpram.takes_characters() && !std::mem::replace(&mut self.characters.in_vain, true) {
            let word = self.ports.dpram.character_word();
            warn!(
                "the board does not take control characters at {word}: ^A and ^K may not reach it; \
                 see docs/first-board.md before you move a motor"
            );
        }
    }
}
