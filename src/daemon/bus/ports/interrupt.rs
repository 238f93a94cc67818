//! Keeps the interrupt's descriptor connected: a simulated board may come and go.

use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use log::{info, warn};

use crate::daemon::bus::timing::INTERRUPT_RECONNECT;
use crate::device::interrupt::Taken;
use crate::device::{Interrupt, InterruptSource};

/// More wakes than this in a second are not from a board's responses: something keeps the line raised.
const STORM: u32 = 10_000;

/// A connection that the daemon makes again when it breaks.
pub struct InterruptLink {
    /// Where to connect again; `None` for the interrupt of the board's own device, which comes back with the board.
    source: Option<InterruptSource>,
    interrupt: Option<Interrupt>,
    /// When to try next; `None` before the first try, which comes at once.
    next_try: Option<Instant>,
    complained: bool,
    /// Interrupts that came without an announcement of their own, so far.
    missed: u64,
    rate: Rate,
}

/// Counts wakes, to see when they come faster than a board can have responses.
#[derive(Debug, Default)]
struct Rate {
    since: Option<Instant>,
    wakes: u32,
}

impl Rate {
    /// Counts a wake at `now`. True if the last [`STORM`] wakes took less than a second.
    fn is_storm(&mut self, now: Instant) -> bool {
        self.wakes += 1;
        let since = *self.since.get_or_insert(now);
        if self.wakes < STORM {
            return false;
        }
        let took = now.duration_since(since);
        *self = Self { since: Some(now), wakes: 0 };
        took < Duration::from_secs(1)
    }
}

impl InterruptLink {
    /// A link not connected yet; the first [`InterruptLink::tend`] tries.
    #[must_use]
    pub fn new(source: InterruptSource) -> Self {
        Self { source: Some(source), ..Self::of_board(None) }
    }

    /// An open link; the daemon opens it again from `source` when it breaks.
    #[must_use]
    pub fn opened(source: InterruptSource, interrupt: Interrupt) -> Self {
        Self { source: Some(source), ..Self::of_board(Some(interrupt)) }
    }

    /// The interrupt of the board's own device, if the device has a usable one.
    #[must_use]
    pub fn of_board(interrupt: Option<Interrupt>) -> Self {
        Self { source: None, interrupt, next_try: None, complained: false, missed: 0, rate: Rate::default() }
    }

    /// The daemon has opened the board again: its device's own interrupt takes the place of the former one.
    pub fn replace(&mut self, interrupt: Option<Interrupt>) {
        if self.source.is_none() {
            self.interrupt = interrupt;
        }
    }

    /// Whether interrupts can arrive.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.interrupt.is_some()
    }

    /// The descriptor, readable while an interrupt waits.
    #[must_use]
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.interrupt.as_ref().map(Interrupt::descriptor)
    }

    /// Connects if not connected and a try is due. Returns whether this call has made the connection.
    pub fn tend(&mut self, now: Instant) -> bool {
        let Some(source) = &self.source else { return false };
        if self.interrupt.is_some() || self.next_try.is_some_and(|next| now < next) {
            return false;
        }
        self.next_try = Some(now + INTERRUPT_RECONNECT);
        match Interrupt::connect(source) {
            Ok(interrupt) => {
                info!("interrupt connected ({source})");
                self.interrupt = Some(interrupt);
                self.complained = false;
                true
            }
            Err(error) => {
                if !std::mem::replace(&mut self.complained, true) {
                    warn!("interrupt {source} is not there ({error}); looking for responses instead");
                }
                false
            }
        }
    }

    /// Takes the interrupts that wait.
    pub fn take(&mut self, now: Instant) -> Taken {
        let Some(interrupt) = &mut self.interrupt else { return Taken::default() };
        let taken = interrupt.take();
        self.tell_missed(taken.missed);
        if taken.closed {
            match &self.source {
                Some(source) => {
                    warn!(
                        "interrupt {source} was closed by the board's side; connecting again when it is back"
                    );
                }
                None => warn!("the interrupt went away with the board's device"),
            }
            self.complained = true;
        }
        if taken.disarmed {
            warn!("the interrupt cannot be armed again; looking for responses instead");
            // Another opening would end the same way.
            self.source = None;
        }
        let storms = taken.interrupts > 0 && self.rate.is_storm(now);
        if storms {
            warn!(
                "interrupts come without end, as if nobody acknowledged them; given up, looking for responses instead"
            );
            self.source = None;
        }
        if taken.closed || taken.disarmed || storms {
            self.interrupt = None;
        }
        taken
    }

    /// Logs how many interrupts came while the thread was busy with others: at the first, and then each time their
    /// number has doubled. The daemon loses nothing by that: it looks for a response after each wake.
    fn tell_missed(&mut self, missed: u32) {
        let before = self.missed;
        self.missed += u64::from(missed);
        if self.missed.checked_ilog2() != before.checked_ilog2() {
            info!("{} interrupts so far came together with another", self.missed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_no_board_could_mean_is_a_storm() {
        let begin = Instant::now();
        for (wakes_a_second, storms) in [(5_000, false), (9_000, false), (11_000, true), (1_000_000, true)] {
            let mut rate = Rate { since: Some(begin), wakes: 0 };
            let step = Duration::from_secs(1) / wakes_a_second;
            let stormy = (1..=3 * STORM).any(|wake| rate.is_storm(begin + wake * step));
            assert_eq!(stormy, storms, "{wakes_a_second}");
        }
    }
}
