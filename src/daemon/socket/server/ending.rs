//! The daemon's end: the server stops held jogs, ends the sequences, and answers the clients that wait.

use std::time::{Duration, Instant};

use log::error;
use nix::sys::eventfd::EventFd;

use super::Service;
use super::replies::{is_stopping, stop_not_taken};
use crate::daemon::scripts::END_STEP;
use crate::daemon::shared::leases::HOLD_LEASE;
use crate::map::Motors;
use crate::protocol::{CallError, Reply};

/// How long the ends of all sequences may take together.
const LAST_STEPS: Duration = END_STEP;
/// How long the daemon tries to stop held jogs while the board takes nothing: a SAVE or a reset takes seconds. The bus
/// thread needs half a second after that. The unit's TimeoutStopSec, 10 s, kills a daemon that goes on.
const LAST_STOPS: Duration = Duration::from_secs(8);
/// How long until a holder hears that the board has not taken the stop.
const STOP_SILENCE: Duration = Duration::from_millis(600);

impl Service {
    /// Serves on until the sequences have ended and the held motors stand, or until their time is over.
    pub(super) fn come_to_end(&mut self, stop: &EventFd) {
        // The daemon is stopping already; this wake must not end the waits that follow.
        let _ = stop.read();
        let begun = Instant::now();
        self.begin_end(begun);
        while let Some(left) = self.time_left(begun, Instant::now()) {
            match self.wait(stop, self.timeout().min(left)) {
                Ok(ready) => self.round(ready, Instant::now()),
                Err(nix::Error::EINTR) => {}
                Err(_) => break,
            }
        }
    }

    /// The daemon stops: ends held jogs, jogs that end with a connection, and sequences. The server begins nothing
    /// more.
    pub(super) fn begin_end(&mut self, now: Instant) {
        self.ledger.daemon_ends(now);
        self.tend_motion(now);
        self.stop_sequences(now);
    }

    /// How long the stops and sequences may still take, at the end that `begun`. `None` if none goes on, or if their
    /// time is over. A holder goes on renewing its jog until the daemon has stopped the jog, and then hears of the end.
    pub(super) fn time_left(&mut self, begun: Instant, now: Instant) -> Option<Duration> {
        let stops = self.ledger.holds() + self.stops.count() > 0;
        self.stood_since = if stops { None } else { self.stood_since.or(Some(now)) };
        let steps = self.has_sequences().then_some(begun + LAST_STEPS);
        let told = self.stood_since.filter(|_| self.ledger.has_untold()).map(|since| since + HOLD_LEASE);
        let latest = steps.max(stops.then_some(begun + LAST_STOPS)).max(told)?;
        Some(latest.saturating_duration_since(now)).filter(|left| !left.is_zero())
    }

    /// The answer to a renewal while the daemon stops, as long as the board has not taken the stop. The holder has to
    /// hear soon how the stop ends.
    pub(super) fn renewed_at_the_end(&self, now: Instant) -> Option<Result<(), CallError>> {
        let (since, may_move) = (self.stopping?, self.may_move());
        let is_late = now.saturating_duration_since(since) >= STOP_SILENCE;
        (!may_move.is_empty()).then(|| if is_late { Err(stop_not_taken(may_move)) } else { Ok(()) })
    }

    /// The motors of held jogs that may still move.
    pub(super) fn may_move(&self) -> Motors {
        self.ledger.held_motors().and(self.stops.motors())
    }

    /// Answers every client that waits. Returns the motors of held jogs that may still move.
    pub(super) fn end(&mut self, now: Instant) -> Motors {
        // First tells clients the commands that are done already.
        while let Some(event) = self.events.try_receive() {
            self.on_event(event, now);
        }
        let may_move = self.may_move();
        let mut reason = "pmacd stopped before the board had answered".to_owned();
        if !may_move.is_empty() {
            reason += &format!("; motor {may_move} MAY STILL MOVE");
            error!(
                target: "audit",
                "motor {may_move} MAY STILL MOVE: pmacd ends, and the board has not taken the stop of its held jog; use the emergency stop, or ^A \
                 over the serial port"
            );
        }
        self.stop_at_the_end(now);
        self.audit.end();
        // Tells each waiting client that nothing more will come, without waiting until the client reads that. The bus
        // thread may have sent the commands that it holds.
        let unsent = Reply::of_error(&is_stopping());
        let uncertain = Reply::of_error(&CallError::Interrupted { reason });
        let (clients, calls) = (&mut self.clients, &self.calls);
        let reply = |client, waits_for_board| {
            if waits_for_board && !calls.is_unsent(client) { &uncertain } else { &unsent }
        };
        clients.farewell(reply, |client| calls.is_oneway(client), now);
        may_move
    }
}
