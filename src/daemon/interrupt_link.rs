//! Keeps the interrupt's descriptor connected: a simulated board may come and go.

use std::os::fd::BorrowedFd;
use std::time::{Duration, Instant};

use log::{info, warn};

use crate::device::interrupt::Taken;
use crate::device::{Interrupt, InterruptSource};

/// How often a lost connection is tried again.
const RECONNECT: Duration = Duration::from_millis(500);

/// A connection that is made again when it breaks.
pub struct InterruptLink {
    source: InterruptSource,
    interrupt: Option<Interrupt>,
    next_try: Instant,
    complained: bool,
}

impl InterruptLink {
    /// Not connected yet; the first [`InterruptLink::tend`] tries.
    #[must_use]
    pub fn new(source: InterruptSource) -> Self {
        Self { source, interrupt: None, next_try: Instant::now(), complained: false }
    }

    /// Whether interrupts can arrive.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.interrupt.is_some()
    }

    /// Readable when an interrupt waits.
    #[must_use]
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.interrupt.as_ref().map(Interrupt::descriptor)
    }

    /// Connects if not connected and it is time to try. True if the connection was just made.
    pub fn tend(&mut self, now: Instant) -> bool {
        if self.interrupt.is_some() || now < self.next_try {
            return false;
        }
        self.next_try = now + RECONNECT;
        match Interrupt::connect(&self.source) {
            Ok(interrupt) => {
                info!("interrupt connected ({:?})", self.source);
                self.interrupt = Some(interrupt);
                self.complained = false;
                true
            }
            Err(error) => {
                if !std::mem::replace(&mut self.complained, true) {
                    warn!(
                        "interrupt {:?} is not there ({error}); looking for responses instead",
                        self.source
                    );
                }
                false
            }
        }
    }

    /// Takes the interrupts that wait.
    pub fn take(&mut self) -> Taken {
        let Some(interrupt) = &mut self.interrupt else { return Taken::default() };
        let taken = interrupt.take();
        if taken.closed {
            warn!(
                "interrupt {:?} was closed by the board's side; connecting again when it is back",
                self.source
            );
            self.interrupt = None;
            self.complained = true;
        }
        taken
    }
}
