//! Checks before a client jogs a motor, or moves it by a line or a panel request: no other client may hold the motor,
//! and a jog needs a closed loop.

use super::Service;
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::socket::jog_to::JogTo;
use crate::map::Motors;
use crate::protocol::CallError;

impl Service {
    /// Checks that `client` may move `motors`: no other client holds any of them, and no stop of any waits for the
    /// board. A stop needs no such check.
    ///
    /// # Errors
    /// Names the holder and the motors; the daemon has sent nothing.
    pub(super) fn spares_holds(&self, client: u64, motors: Motors) -> Result<(), CallError> {
        let due = motors.among(self.stops.due_motors());
        match self.ledger.held_by_another(client, motors) {
            Some((holder, held)) => Err(held_by_another(Some(holder), held)),
            None if !due.is_empty() => Err(held_by_another(None, due)),
            None => Ok(()),
        }
    }

    /// Checks that `caller` may jog the motor now: no other client holds the motor, and the daemon knows that the loop
    /// is not open. The daemon assumes that every jog closes a killed motor's loop, as `J/` does (Turbo Software
    /// Reference p. 275).
    pub(super) fn may_jog(&self, caller: Caller, jog: JogTo) -> Result<(), CallError> {
        self.spares_holds(caller.client, jog.motors())?;
        if self.info.loops_untold().meets(jog.motors()) {
            return Err(CallError::refused(format_args!(
                "whether the loop of motor {} is open is not known until the board has told where its M-variables point \
                 (pmacctl status tells how far that is); nothing was sent",
                jog.motors()
            )));
        }
        if self.info.loops_left_open().meets(jog.motors()) {
            return Err(CallError::refused(format_args!(
                "the loop of motor {0} is open (killed, or a fault), and a jog would close it; nothing was sent; pmacctl send \
                 '#{0}J/' closes it where the motor stands",
                jog.motors()
            )));
        }
        Ok(())
    }
}

/// The refusal for a client that would move these `motors`: the `holder` holds them, or their stop waits for the board.
fn held_by_another(holder: Option<Account>, motors: Motors) -> CallError {
    match holder {
        Some(holder) => CallError::refused(format_args!(
            "{holder} holds a jog of motor {motors}; nothing was sent; pmacctl jog N stop or abort ends that"
        )),
        None => CallError::refused(format_args!(
            "the board has not taken the stop of motor {motors} yet, which pmacd requests again; nothing was sent; abort stops it"
        )),
    }
}
