//! Checks before a client moves a motor, or sets its position: no other client may hold the motor, and its loop must be
//! as the order needs it.

use super::Service;
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::socket::order::Order;
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

    /// Checks that `caller` may give `order` now: no other client holds its motors, and the daemon knows whether their
    /// loops are open. Only a position can be set in an open loop, and only of a motor that stands. The daemon assumes
    /// that every jog and every home search closes a killed motor's loop, as `J/` does (Turbo Software Reference p.
    /// 275).
    pub(super) fn may_order(&self, caller: Caller, order: Order) -> Result<(), CallError> {
        let motors = order.motors();
        self.spares_holds(caller.client, motors)?;
        let untold = motors.among(self.info.loops_untold());
        if !untold.is_empty() {
            return Err(CallError::refused(format_args!(
                "whether the loop of motor {untold} is open is not known until the board has told where its M-variables point \
                 (pmacctl status tells how far that is); nothing was sent"
            )));
        }
        if let Order::SetPosition(..) = order {
            let moving = motors.without(self.info.motion().standing);
            return match moving.is_empty() {
                true => Ok(()),
                false => Err(CallError::refused(format_args!(
                    "no report shows that motor {moving} stands, and a position is set only then; nothing was sent"
                ))),
            };
        }
        if let (Order::Home(motor), Some(open)) = (order, &self.info.board().open_buffer) {
            return Err(CallError::refused(format_args!(
                "{open}, and no manual says whether a board stores #{motor}HM there; nothing was sent"
            )));
        }
        let open = motors.among(self.info.loops_left_open());
        match open.numbers().next() {
            None => Ok(()),
            Some(first) => Err(CallError::refused(format_args!(
                "the loop of motor {open} is open (killed, or a fault), and this would close it; nothing was sent; pmacctl send \
                 '#{first}J/' closes it where the motor stands"
            ))),
        }
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
