//! Calls for the control panel, and writes of DPRAM words.
//!
//! Every call is bounded: by the daemon's time for the board, and a margin for the daemon's answer.

use std::time::Duration;

use serde::Serialize;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::map::HostOffset;
use crate::protocol::board::{Done, JogRenewReply, NotesReply};
use crate::protocol::calls;

/// More than the daemon gives the board for a job and the question before it.
const JOB_TIMEOUT: Duration = Duration::from_secs(5);
/// The time limit of a renewal; the lease is over long before.
const RENEW_TIMEOUT: Duration = Duration::from_secs(1);

impl Connection {
    fn panel_call(&self, action: &str, numbers: &[u8]) -> calls::Panel {
        calls::Panel {
            action: action.to_owned(),
            numbers: numbers.iter().copied().map(usize::from).collect(),
            confirmed: self.confirmed(),
            by_line: None,
        }
    }

    fn job(&mut self, method: &str, parameters: &impl Serialize) -> Result<(), CommandError> {
        let Done {} = self.call(method, parameters, JOB_TIMEOUT + MARGIN)?;
        Ok(())
    }

    /// Has the control panel do `action` (`jog-`, `jog+`, `jog-stop`, `pre-jog`, `home` for motors; `start`, `step`,
    /// `stop`, `hold` for coordinate systems) for `numbers`, from 1, all at once. Returns when the board has taken it.
    ///
    /// # Errors
    /// [`CommandError`], with [`crate::protocol::CallError::Refused`] inside if I2 is not 3, or if the board did not
    /// take the request in time: then the daemon has withdrawn it.
    pub fn panel(&mut self, action: &str, numbers: &[u8]) -> Result<(), CommandError> {
        self.job("Panel", &self.panel_call(action, numbers))
    }

    /// As [`Connection::panel`], but has a motor home and a coordinate system start or step by command line where the
    /// daemon sends lines: the board needs no panel then.
    ///
    /// # Errors
    /// As [`Connection::jog_to`].
    pub fn panel_or_line(&mut self, action: &str, number: u8) -> Result<(), CommandError> {
        self.job("Panel", &calls::Panel { by_line: Some(true), ..self.panel_call(action, &[number]) })
    }

    /// Begins a jog (`jog-` or `jog+`) that goes on only while [`Connection::panel_renew`] follows at least every 200
    /// ms. [`crate::client::HeldJog`] sends these renewals.
    ///
    /// # Errors
    /// As [`Connection::panel`].
    pub fn panel_hold(&mut self, action: &str, numbers: &[u8]) -> Result<(), CommandError> {
        self.job("PanelHold", &self.panel_call(action, numbers))
    }

    /// Tells the daemon that the holder of this connection's jogs is alive. Waits a second at most.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses without a held jog.
    pub fn panel_renew(&mut self) -> Result<(), CommandError> {
        let Done {} = self.call("PanelRenew", &calls::NoParameters {}, RENEW_TIMEOUT)?;
        Ok(())
    }

    /// Tells the daemon that this client is alive, as any call does ([`crate::client::command::SendAs::silence_ms`]).
    /// Returns the motors that must stop with this connection and may still jog.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn jog_renew(&mut self) -> Result<Vec<u8>, CommandError> {
        let reply: JogRenewReply = self.call("JogRenew", &calls::NoParameters {}, DAEMON_TIMEOUT)?;
        Ok(reply.motors)
    }

    /// Jogs `motor` (from 1) to `position`, in counts from home, rounded to 1/32 of a count. Returns when the board has
    /// taken the line.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses, with nothing sent, while another connection holds a jog of the motor,
    /// while the motor's loop is open, and while a program buffer is open.
    pub fn jog_to(&mut self, motor: u8, position: f64) -> Result<(), CommandError> {
        self.job("JogTo", &calls::MotorPosition { motor: motor.into(), position })
    }

    /// Tells `motor` (from 1), which stands, that it is at `position`, in counts, rounded to 1/32 of a count. Returns
    /// when the board has taken the line; the next reports show the position.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses, with nothing sent, any position but 0 while the motor's loop is closed, and
    /// while its loop is open, if `M162` (of motor 1) is not its actual position.
    pub fn set_position(&mut self, motor: u8, position: f64) -> Result<(), CommandError> {
        self.job("SetPosition", &calls::MotorPosition { motor: motor.into(), position })
    }

    /// Overrides the feed rate of `coordinate_system` (from 1) with `raw` (1/32768 ms, 0 to 32767; 14507 is 100 % at
    /// the default I10), until `None` releases it. Returns why the override may have no effect: an Ix93 that points
    /// elsewhere, or a board that did not answer.
    ///
    /// # Errors
    /// As [`Connection::panel`].
    pub fn feed_override(
        &mut self,
        coordinate_system: u8,
        raw: Option<u16>,
    ) -> Result<Vec<String>, CommandError> {
        let parameters =
            calls::FeedOverride { coordinate_system: coordinate_system.into(), raw: raw.map(u32::from) };
        let reply: NotesReply = self.call("FeedOverride", &parameters, JOB_TIMEOUT + MARGIN)?;
        Ok(reply.notes)
    }

    /// Writes consecutive 16-bit words (1 to 64) from `first` on: each with its value and the mask of the bits to
    /// change. A word with mask 0 stays untouched. Unless `anywhere`, all words must lie in the user area.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses, with nothing written, if a function owns one of the words.
    pub fn write(
        &mut self,
        first: HostOffset,
        words: &[(u16, u16)],
        anywhere: bool,
    ) -> Result<(), CommandError> {
        let (values, masks): (Vec<u16>, Vec<u16>) = words.iter().copied().unzip();
        let parameters = calls::Write {
            host_offset: calls::Offset(first),
            words: values,
            masks: Some(masks),
            anywhere: Some(anywhere),
        };
        self.job("Write", &parameters)
    }
}
