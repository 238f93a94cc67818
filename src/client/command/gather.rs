//! A gather, which the daemon runs for this connection.

use std::time::Duration;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::gather::{GatherMode, GatherPlan};
use crate::map::Layout;
use crate::protocol::board::{Done, GatherStopReply};
use crate::protocol::calls;

/// More than the daemon gives the lines that begin a gather, even if the board answers all of them late.
const STARTS_WITHIN: Duration = Duration::from_secs(60);
/// More than the daemon gives the lines that end a gather.
const STOPS_WITHIN: Duration = Duration::from_secs(30);

impl Connection {
    /// Has the board gather by `plan` on a board with `layout`, and the daemon follow. Returns when the board gathers.
    /// This connection owns the gather, which ends with it, or after 5 s without a call
    /// ([`Connection::sequence_renew`]). Without a servo report the daemon counts the board's turns in its buffer by
    /// the servo period.
    ///
    /// # Errors
    /// [`CommandError`]. The daemon refuses while another client gathers, and if the buffer overlaps another buffer of
    /// the daemon. If the board refuses a line, the daemon leaves the board as it was.
    pub fn gather_start(
        &mut self,
        plan: &GatherPlan,
        layout: &Layout,
        servo_period_ns: Option<u64>,
    ) -> Result<(), CommandError> {
        let place = layout.gather();
        let parameters = calls::GatherStart {
            buffer: calls::Offset(place.buffer),
            size_word: calls::Offset(place.size),
            index_word: calls::Offset(place.index),
            registers: plan.registers.iter().map(ToString::to_string).collect(),
            size_longs: plan.buffer_longs,
            period: plan.period,
            wrap: Some(plan.mode == GatherMode::Wrap),
            servo_period_ns,
        };
        // The daemon waits for the servo report, which comes at the gather's rate.
        let periods = 4 * u64::from(plan.period);
        let periods = Duration::from_nanos(periods.saturating_mul(servo_period_ns.unwrap_or_default()));
        let Done {} = self.call_used("GatherStart", &parameters, periods.saturating_add(STARTS_WITHIN))?;
        Ok(())
    }

    /// Ends this connection's gather, or another connection's if its user is the same or is `uid`. Returns when the
    /// daemon has restored I19.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if the gather is another user's.
    pub fn gather_stop(&mut self, uid: Option<u32>) -> Result<GatherStopReply, CommandError> {
        self.call("GatherStop", &calls::GatherStop { uid }, STOPS_WITHIN)
    }

    /// Tells the daemon that the owner of this connection's sequences is alive.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses without a sequence.
    pub fn sequence_renew(&mut self) -> Result<(), CommandError> {
        let Done {} = self.call("SequenceRenew", &calls::NoParameters {}, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }
}
