//! Background variables as a function of the board.

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::work::write::WriteQueue;
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::mirror::VariableMirror;

/// Background variables: those that the daemon reads, and those that it writes.
pub struct Variables {
    /// The variables that the daemon reads.
    pub read: VariableMirror,
    /// The variables that the daemon writes.
    pub write: WriteQueue,
}

impl<B: Bus> BoardFunction<B> for Variables {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        [self.write.due(), self.read.due()].into_iter().flatten().min().map(|due| clock.ns_of(due))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        let now = context.clock.now();
        let read_first =
            self.read.due().is_some_and(|read| self.write.due().is_none_or(|write| read < write));
        if read_first {
            self.read.poll(context.bus, context.publisher, now)?;
        } else if let Some(answer) = self.write.poll(context.bus, now)? {
            context.intake.answer(answer);
        }
        Ok(Polled::default())
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        let now = context.clock.now();
        self.write.acquire(context.bus, now)?;
        self.read.release(context.bus)?;
        Ok(self.read.acquire(context.bus, context.publisher, now)?)
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        self.write.release(bus)?;
        self.read.release(bus)
    }
}
