//! Calls that have the daemon follow a gather.

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::gather::{GatherMode, GatherPlan};
use crate::map::Layout;
use crate::protocol::board::Done;
use crate::protocol::calls;

impl Connection {
    /// Has the daemon follow the buffer that `plan` has defined on a board with `layout`. Between `DEFINE GATHER` and
    /// `GATHER`. With the servo period, the host's clock counts the board's turns in its buffer; without, the servo report.
    ///
    /// # Errors
    /// [`CommandError`]; refused when the buffer is another one, or overlaps the daemon's other buffers.
    pub fn gather_begin(
        &mut self,
        plan: &GatherPlan,
        layout: &Layout,
        servo_period_ns: Option<u64>,
    ) -> Result<(), CommandError> {
        let place = layout.gather();
        let parameters = calls::GatherBegin {
            buffer: calls::Offset(place.buffer),
            size_word: calls::Offset(place.size),
            index_word: calls::Offset(place.index),
            size_longs: plan.buffer_longs,
            sample_longs: plan.sample_longs,
            period: plan.period,
            wrap: Some(plan.mode == GatherMode::Wrap),
            servo_period_ns,
        };
        let Done {} = self.call("GatherBegin", &parameters, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }

    /// Tells the daemon that the board gathers no more.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn gather_end(&mut self) -> Result<(), CommandError> {
        let Done {} = self.call("GatherEnd", &calls::NoParameters {}, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }
}
