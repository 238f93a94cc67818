//! A gather, which the daemon runs for this connection alone.

use std::time::Duration;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::gather::{GatherMode, GatherPlan};
use crate::map::Layout;
use crate::protocol::board::{Done, GatherStopReply};
use crate::protocol::calls;

/// More than the daemon gives the lines that begin a gather, where the board answers all of them late.
const STARTS_WITHIN: Duration = Duration::from_secs(60);
/// More than it gives those of the end.
const STOPS_WITHIN: Duration = Duration::from_secs(30);

impl Connection {
    /// Has the board gather by `plan` on a board with `layout`, and the daemon follow. Returns when the board gathers.
    /// This connection owns the gather, which ends with it, or after 5 s without a call
    /// ([`Connection::sequence_renew`]). Without a servo report the servo period counts the board's turns in its
    /// buffer.
    ///
    /// # Errors
    /// [`CommandError`]; refused while another client gathers, if the buffer overlaps another one of the daemon, or if
    /// the board refuses a line: the daemon leaves the board as it was.
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
        // The daemon waits for the servo report, which comes as seldom as it gathers.
        let periods = 4 * u64::from(plan.period);
        let periods = Duration::from_nanos(periods.saturating_mul(servo_period_ns.unwrap_or_default()));
        let Done {} = self.call_used("GatherStart", &parameters, periods.saturating_add(STARTS_WITHIN))?;
        Ok(())
    }

    /// Ends this connection's gather, or another one of the same user or of the user `uid`. Returns when the daemon has
    /// put I19 back.
    ///
    /// # Errors
    /// [`CommandError`]; refused if the gather is another user's.
    pub fn gather_stop(&mut self, uid: Option<u32>) -> Result<GatherStopReply, CommandError> {
        self.call("GatherStop", &calls::GatherStop { uid }, STOPS_WITHIN)
    }

    /// Says that the owner of this connection's sequences still lives.
    ///
    /// # Errors
    /// [`CommandError`]; refused without a sequence.
    pub fn sequence_renew(&mut self) -> Result<(), CommandError> {
        let Done {} = self.call("SequenceRenew", &calls::NoParameters {}, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }
}
