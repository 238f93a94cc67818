//! Command lines as a function of the board.

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::bus::ports::host_port::HostPortLink;
use crate::daemon::bus::work::ascii::AsciiDesk;
use crate::device::{Bus, BusError};
use crate::protocol::CommandState;
use crate::segment::Counter;

/// Command lines: their desk, and the interrupt controller that announces replies, where it has to be served.
pub struct CommandLines {
    /// Who waits for whom.
    pub desk: AsciiDesk,
    /// The controller.
    pub host_port: Option<HostPortLink>,
}

impl<B: Bus> BoardFunction<B> for CommandLines {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        Some(clock.ns_of(self.desk.due()))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        let now = context.clock.now();
        let registers = self.desk.port().register_accesses();
        self.desk.pass(context.bus, context.events, context.publisher, now)?;
        if let Some(host_port) = &mut self.host_port {
            host_port.serve(context.bus, &mut self.desk, now)?;
        }
        let registers = self.desk.port().register_accesses() - registers;
        context.publisher.counters().add(Counter::AsciiAccesses, registers);
        Ok(Polled::default())
    }
    fn take_over(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        Ok(self.desk.port().dpram.release(context.bus)?)
    }
    fn reset(&mut self, _context: &mut Context<'_, B>) -> Result<(), PortError> {
        Ok(())
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        self.desk.port().dpram.release(bus)
    }
    fn is_live(&self) -> Option<bool> {
        Some(self.desk.state() == CommandState::Answers)
    }
    fn counter(&self) -> Option<Counter> {
        Some(Counter::AsciiAccesses)
    }
    fn watches(&self) -> bool {
        true
    }
}
