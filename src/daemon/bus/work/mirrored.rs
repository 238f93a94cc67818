//! The functions that only fill a region of the segment: servo and background data, gathered samples.

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::mirror::{BackgroundMirror, GatherMirror, ServoMirror};
use crate::segment::Counter;

impl<B: Bus> BoardFunction<B> for ServoMirror {
    fn due_ns(&self, _clock: &Clock) -> Option<u64> {
        Some(ServoMirror::due_ns(self))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        let transition = self.poll(context.bus, context.publisher)?;
        Ok(Polled { transition, was_reset: self.take_reset() })
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.reset();
        Ok(self.release(context.bus)?)
    }
    fn reset(&mut self, _context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.reader.mask_is_lost();
        Ok(())
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        let released = self.release(bus);
        released.and(self.reader.give_back(bus))
    }
    fn is_live(&self) -> Option<bool> {
        Some(ServoMirror::is_live(self))
    }
    fn counter(&self) -> Option<Counter> {
        Some(Counter::ServoAccesses)
    }
    fn watches(&self) -> bool {
        true
    }
}

impl<B: Bus> BoardFunction<B> for BackgroundMirror {
    fn due_ns(&self, _clock: &Clock) -> Option<u64> {
        Some(BackgroundMirror::due_ns(self))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        let transition = self.poll(context.bus, context.publisher, context.clock.ns())?;
        Ok(Polled { transition, ..Polled::default() })
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.reset();
        Ok(self.release(context.bus)?)
    }
    fn reset(&mut self, _context: &mut Context<'_, B>) -> Result<(), PortError> {
        // A half-read report is of no use.
        self.reset();
        Ok(())
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        let released = self.release(bus);
        released.and(self.reader.give_back(bus))
    }
    fn is_live(&self) -> Option<bool> {
        Some(BackgroundMirror::is_live(self))
    }
    fn counter(&self) -> Option<Counter> {
        Some(Counter::BackgroundAccesses)
    }
    fn watches(&self) -> bool {
        true
    }
    fn spare_ns(&self) -> u64 {
        BackgroundMirror::spare_ns(self)
    }
}

impl<B: Bus> BoardFunction<B> for GatherMirror {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        self.due().map(|due| clock.ns_of(due))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        self.poll(context.bus, context.publisher, context.clock.now())?;
        Ok(Polled::default())
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.reset(context.publisher);
        Ok(())
    }
}
