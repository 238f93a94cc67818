//! The loop's start and end, and its reactions to a board that goes, comes back or is reset.

use std::time::Instant;

use super::BoardLoop;
use crate::daemon::bus::phase::LoopPhase;
use crate::daemon::bus::presence::Change;
use crate::daemon::shared::queue::Command;
use crate::function::line_port::PortError;
use crate::protocol::Function;
use crate::segment::Counter;

/// How often to look, at the start, whether the DPRAM is in reach.
const REACH_POLL_NS: u64 = 1_000_000;

impl BoardLoop {
    /// Asks the loop to end: the loop stops the held jogs, then leaves the board. [`BoardLoop::poll`] tells when the
    /// loop has ended.
    pub fn stop(&mut self) {
        if matches!(self.phase, LoopPhase::Stopping { .. } | LoopPhase::Ended) {
            return;
        }
        let _ = self.connections.stop.read();
        self.reporter.end(self.connections.intake.events());
        self.phase = LoopPhase::stopping(self.clock.now());
        self.collect_stops();
    }

    /// Checks that the board is there, and opens the board again after it was replaced or came back.
    pub(super) fn check_board(&mut self) -> Result<(), PortError> {
        let change = self.presence.check(&mut self.bus);
        let is_replaced = matches!(change, Some(Change::Replaced(_)));
        if let Some(change) = change {
            self.follow(change)?;
        }
        if self.presence.is_there() && !is_replaced { self.let_board_speak() } else { Ok(()) }
    }

    /// Writes the DPRAM's page if the board has lost it.
    pub(super) fn check_page(&mut self) -> Result<(), PortError> {
        let ports = &mut self.functions.ascii.queue.ports;
        let change = self.presence.check_page(&mut self.bus, ports)?;
        change.map_or(Ok(()), |change| self.follow(change))
    }

    /// Acts on a change of the board's presence.
    pub(super) fn follow(&mut self, change: Change) -> Result<(), PortError> {
        match change {
            Change::Replaced(interrupt) => {
                self.functions.ascii.reopen(interrupt);
                self.write_page();
                self.begin_again()
            }
            Change::Answers => self.begin_again(),
            Change::PageLost => self.after_reset(true),
            Change::PageBack => {
                self.acquire_again();
                Ok(())
            }
        }
    }

    /// The board is another one, or was without power.
    fn begin_again(&mut self) -> Result<(), PortError> {
        // Before the loop puts the words in order: they tell which commands the board has taken.
        let result = self.reset_commands();
        self.note_failure(result);
        self.acquire_again();
        self.after_reset(true)
    }

    /// Takes the board over anew, and counts the reset: earlier findings say nothing about this board.
    fn acquire_again(&mut self) {
        self.connections.publisher.counters().add(Counter::Resets, 1);
        self.acquire_board();
    }

    /// Frees the reports and the interrupt's line. A memory test, a power failure or another host may have left the
    /// host's own words in a state that holds off the reports for ever. A reset too quick for the daemon to notice has
    /// shut the interrupt's line.
    fn let_board_speak(&mut self) -> Result<(), PortError> {
        if self.functions.uses(Function::Servo) && !self.functions.servo.is_live() {
            self.functions.servo.release(&mut self.bus)?;
        }
        if self.functions.uses(Function::Background) && !self.functions.background.is_live() {
            self.functions.background.ask(&mut self.bus, self.clock.ns())?;
        }
        self.functions.ascii.keep_line_open()
    }

    /// Writes the DPRAM's page, where the board has pages. Writing the page that is already selected does no harm.
    pub(super) fn write_page(&mut self) {
        let result = self.functions.ascii.queue.ports.select_page();
        self.note_failure(result);
    }

    /// The board was reset: the loop tells the board again all that a reset erases. If the reset `is_new`, the commands
    /// now in the mailboxes began before the reset.
    pub(super) fn after_reset(&mut self, is_new: bool) -> Result<(), PortError> {
        self.reporter.status.resets += u32::from(is_new);
        self.write_page();
        self.functions.ascii.open_line()?;
        let (functions, mut context) = self.functions_in_context();
        functions.reset(&mut context)?;
        let now = self.clock.now();
        let queue = &mut self.functions.ascii.queue;
        queue.identifier.begin_anew(now);
        queue.scan.begin_anew(now);
        if is_new { self.reset_commands() } else { Ok(()) }
    }

    /// Ends the commands under way: they belong to the board before the reset. Touches nothing where the daemon sends
    /// no lines.
    fn reset_commands(&mut self) -> Result<(), PortError> {
        if !self.functions.uses(Function::Ascii) {
            return Ok(());
        }
        self.functions.ascii.queue.reset(&mut self.bus, self.clock.now())
    }

    /// Where the daemon has to write the DPRAM's page, waits until the DPRAM is in reach before the first access.
    pub(super) fn reach_dpram(&mut self) {
        let LoopPhase::Reaching { until, due_ns } = &mut self.phase else { return };
        let ports = &self.functions.ascii.queue.ports;
        let waits = ports.page().is_some() && self.clock.now() < *until;
        if waits && !matches!(ports.dpram.is_out_of_reach(&mut self.bus), Ok(false)) {
            *due_ns = self.clock.ns() + REACH_POLL_NS;
            return;
        }
        self.phase = LoopPhase::Running;
        self.acquire_board();
        // The configuration already tells a part of the board's identity.
        self.take_identity();
        let result = self.reset_commands();
        self.note_failure(result);
    }

    /// Puts the host's words in order, as at the start of the daemon.
    fn acquire_board(&mut self) {
        let (functions, mut context) = self.functions_in_context();
        let result = functions.acquire(&mut context);
        self.note_failure(result);
        let result = self.functions.ascii.open_line();
        self.note_failure(result);
    }

    /// Drops the commands left in the queue, except for stops of held jogs.
    fn collect_stops(&mut self) {
        let LoopPhase::Stopping { until, .. } = self.phase else { return };
        self.functions.keep_stops();
        while let Some(command) = self.connections.intake.drain() {
            if let Command::Job { ticket, job, .. } = command
                && job.is_stop()
            {
                let (functions, mut context) = self.functions_in_context();
                let _ = functions.submit(&mut context, ticket, *job, until);
            }
        }
        self.functions.keep_stops();
    }

    /// Hands over the stops that are left until the time is up, then leaves the board: clears every bit that a host may
    /// have left set. A Host-Busy bit left by a dead host would stop the servo data for ever.
    pub(super) fn finish_stops(&mut self, until: Instant) {
        match self.functions.finish_stops(&mut self.bus) {
            Ok(Some(due)) if self.clock.now() < until => {
                self.phase = LoopPhase::Stopping { until, due_ns: self.clock.ns_of(due.min(until)) };
                return;
            }
            Ok(_) => {}
            Err(error) => self.bus_failed(&error),
        }
        if let Err(error) = self.functions.leave(&mut self.bus) {
            self.bus_failed(&error);
        }
        let result = self.functions.ascii.leave_line();
        self.note_failure(result);
        self.phase = LoopPhase::Ended;
    }
}
