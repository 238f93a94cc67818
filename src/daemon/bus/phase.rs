//! How the loop begins and ends: the DPRAM brought into reach, the host's words put in order, what is held stopped.

use std::time::{Duration, Instant};

use crate::daemon::bus::board_loop::BoardLoop;
use crate::daemon::bus::ports::host_port::HostPortLink;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Command;
use crate::protocol::State;

/// How long the board may take, at the start, to bring the DPRAM into reach, and how often to look whether it has.
const FIRST_REACH: Duration = Duration::from_millis(200);
const REACH_POLL_NS: u64 = 1_000_000;
/// How long the board may take, at the daemon's end, to stop what was held.
const LAST_STOP: Duration = Duration::from_millis(500);

/// Between start and end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The board has not been touched.
    Begin,
    /// Its page is written; the DPRAM has to come into reach until a time. Looked at again when due.
    Reaching {
        /// No longer than this.
        until: Instant,
        /// When to look again.
        due_ns: u64,
    },
    /// At work.
    Running,
    /// What is held is being stopped.
    Stopping {
        /// No longer than this.
        until: Instant,
        /// When to go on.
        due_ns: u64,
    },
    /// The board has been left.
    Ended,
}

impl Phase {
    /// The board's page has been written `now`.
    pub(in crate::daemon) fn reaching(now: Instant) -> Self {
        Self::Reaching { until: now + FIRST_REACH, due_ns: 0 }
    }
}

impl BoardLoop {
    /// Asks the loop to end: stops what is held, then leaves the board. [`BoardLoop::poll`] says when that is done.
    pub fn stop(&mut self) {
        if matches!(self.phase, Phase::Stopping { .. } | Phase::Ended) {
            return;
        }
        let _ = self.stop.read();
        self.info.set(|status| status.state = State::Dead);
        self.info.poll(&self.events, true);
        let until = self.clock.now() + LAST_STOP;
        self.collect_stops(until);
        self.phase = Phase::Stopping { until, due_ns: 0 };
    }

    /// Waits until the DPRAM is in reach, where its page has to be written, before it is touched for the first time.
    pub(in crate::daemon) fn reach_dpram(&mut self) {
        let Phase::Reaching { until, due_ns } = &mut self.phase else { return };
        let has_page =
            self.functions.ascii.desk.port().mailbox.as_ref().is_some_and(|mailbox| mailbox.page().is_some());
        let waits = has_page && self.clock.now() < *until;
        if waits
            && !matches!(self.functions.ascii.desk.port().dpram.is_out_of_reach(&mut self.bus), Ok(false))
        {
            *due_ns = self.clock.ns() + REACH_POLL_NS;
            return;
        }
        self.phase = Phase::Running;
        self.take_over_board();
        // What the configuration says of the board is known without asking.
        self.take_identity();
        if let Err(error) = self.forget_commands() {
            self.bus_failed(&error);
        }
    }

    /// What is left in the queue is not begun any more, except for the stop of a jog that somebody held.
    fn collect_stops(&mut self, deadline: Instant) {
        self.functions.keep_stops();
        while let Some(command) = self.commands.try_receive() {
            if let Command::Job { ticket, job, .. } = command
                && let Job::Panel(request) = *job
                && request.is_stop()
            {
                let _ = self.functions.submit(
                    &mut self.bus,
                    &self.publisher,
                    ticket,
                    Job::Panel(request),
                    deadline,
                );
            }
        }
        self.functions.keep_stops();
    }

    /// Hands over the stops that are left, as long as there is time, then leaves the board.
    pub(in crate::daemon) fn finish_stops(&mut self, until: Instant) {
        match self.functions.finish_stops(&mut self.bus) {
            Ok(Some(due)) if self.clock.now() < until => {
                let due_ns = self.clock.ns_of(due.min(until));
                self.phase = Phase::Stopping { until, due_ns };
                return;
            }
            Ok(_) => {}
            Err(error) => self.bus_failed(&error),
        }
        self.leave_board();
        if let Some(Err(error)) = self.functions.ascii.host_port.as_mut().map(HostPortLink::leave) {
            self.bus_failed(&error);
        }
        self.phase = Phase::Ended;
    }

    /// Puts the host's words in order, as at the start.
    pub(in crate::daemon) fn take_over_board(&mut self) {
        let (functions, mut context) = self.functions_in_context();
        if let Err(error) = functions.take_over(&mut context) {
            self.bus_failed(&error);
        }
        if let Some(Err(error)) = self.functions.ascii.host_port.as_mut().map(HostPortLink::enable) {
            self.bus_failed(&error);
        }
    }

    /// Clears every bit a host may have left set; Host-Busy left by a dead one would stop the servo data for ever.
    fn leave_board(&mut self) {
        if let Err(error) = self.functions.leave(&mut self.bus) {
            self.bus_failed(&error);
        }
    }
}
