//! The bus thread's interface to an automatic function of the board: when it is due, its work, how to acquire and leave
//! it.

use crate::clock::Clock;
use crate::daemon::bus::command_intake::CommandIntake;
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::mirror::Transition;
use crate::segment::{Counter, Publisher};

/// The context of a function's work.
pub struct Context<'a, B> {
    /// The board.
    pub bus: &'a mut B,
    /// The segment.
    pub publisher: &'a mut Publisher,
    /// The intake, which takes the answers.
    pub intake: &'a mut CommandIntake,
    /// The time.
    pub clock: &'a Clock,
}

/// The findings of a poll, besides answers to commands.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Polled {
    /// The function's data are live again, or stale.
    pub transition: Option<Transition>,
    /// The poll has found the board reset.
    pub was_reset: bool,
}

/// A function that the board's family may lack: without it the row is never due, and has nothing to take over or leave.
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

/// An automatic function of the board, as the bus thread drives it.
pub trait BoardFunction<B: Bus> {
    /// When to poll the function next, in nanoseconds of `clock`; `None` while it has no work.
    fn due_ns(&self, clock: &Clock) -> Option<u64>;

    /// Does one bounded piece of work.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError>;

    /// Puts the host's words in order and forgets earlier findings: at the start, and after the board was replaced.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError>;

    /// The board was reset: sets up again all that the reset erased. As [`BoardFunction::acquire`] unless a function
    /// has less to do.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn reset(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.acquire(context)
    }

    /// Leaves the board at the end, with no bit of the host's set and no request open.
    ///
    /// # Errors
    /// When the board cannot be reached.
    fn leave(&mut self, _bus: &mut B) -> Result<(), BusError> {
        Ok(())
    }

    /// Whether the board works at the function now; `None` if the function cannot tell.
    fn is_live(&self) -> Option<bool> {
        None
    }

    /// The counter for the function's accesses.
    fn counter(&self) -> Option<Counter> {
        None
    }

    /// Whether the function watches the board. Other functions wait while an answer finds no room, and while no board
    /// answers on the bus.
    fn watches(&self) -> bool {
        false
    }

    /// How long the function's work can wait without harm, so that one wake serves it and the servo data.
    fn spare_ns(&self) -> u64 {
        0
    }
}
