//! What every automatic function of the board is to the bus thread: when it is due, what it does then, how it is acquired
//! and left.

use crate::clock::Clock;
use crate::daemon::bus::command_intake::CommandIntake;
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::mirror::Transition;
use crate::segment::{Counter, Publisher};

/// What a function works with, and when.
pub struct Context<'a, B> {
    /// The board.
    pub bus: &'a mut B,
    /// The segment.
    pub publisher: &'a mut Publisher,
    /// Where answers go.
    pub intake: &'a mut CommandIntake,
    /// The time.
    pub clock: &'a Clock,
}

/// What came of a poll, but for answers to commands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Polled {
    /// The function's data are live again, or stale.
    pub transition: Option<Transition>,
    /// The board was found reset.
    pub was_reset: bool,
}

/// A function that the board's family may lack: never due then, and nothing to take over or leave.
impl<B: Bus, F: BoardFunction<B>> BoardFunction<B> for Option<F> {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        self.as_ref()?.due_ns(clock)
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        self.as_mut().map_or(Ok(Polled::default()), |function| function.poll(context))
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.as_mut().map_or(Ok(()), |function| function.acquire(context))
    }
    fn reset(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.as_mut().map_or(Ok(()), |function| function.reset(context))
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        self.as_mut().map_or(Ok(()), |function| function.leave(bus))
    }
    fn is_live(&self) -> Option<bool> {
        self.as_ref()?.is_live()
    }
    fn counter(&self) -> Option<Counter> {
        self.as_ref()?.counter()
    }
    fn watches(&self) -> bool {
        self.as_ref().is_some_and(|function| function.watches())
    }
    fn spare_ns(&self) -> u64 {
        self.as_ref().map_or(0, |function| function.spare_ns())
    }
}

/// One automatic function, as the bus thread works it.
pub trait BoardFunction<B: Bus> {
    /// When to poll it next, in nanoseconds of `clock`; `None` while nothing is to be done.
    fn due_ns(&self, clock: &Clock) -> Option<u64>;

    /// Does one bounded piece of work.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError>;

    /// Puts the host's words in order and forgets what was seen: at the start, and when the board is another one.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError>;

    /// The board was reset: what it forgot is set up again. As [`BoardFunction::acquire`] unless a function has less to do.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn reset(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.acquire(context)
    }

    /// Leaves the board at the end: no bit of the host's set, nothing requested.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn leave(&mut self, _bus: &mut B) -> Result<(), BusError> {
        Ok(())
    }

    /// Whether the board works at it now; `None` where the function cannot tell.
    fn is_live(&self) -> Option<bool> {
        None
    }

    /// What its accesses are counted as.
    fn counter(&self) -> Option<Counter> {
        None
    }

    /// Whether it watches the board. What does not waits while an answer finds no room, and while nothing answers on the
    /// bus.
    fn watches(&self) -> bool {
        false
    }

    /// How long its work can wait without harm, so that one wake serves the servo data and it.
    fn spare_ns(&self) -> u64 {
        0
    }
}
