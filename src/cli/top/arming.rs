//! Decides when a jog key may move a motor.
//!
//! The user arms the keys for one motor. A motor jogs only while a key repeats, as a terminal repeats a key that is
//! held down: a single press moves no motor. Without a press for [`RELEASED`] the jog stops. Any other key disarms.
//! Presses that arrive all at once were delayed while this program or the connection stood still: they count as one,
//! for the user may have released the key by now.

use std::time::{Duration, Instant};

use super::hand::Order;
use crate::function::panel::PanelAction;

/// A key that repeats does so within this time. Terminals repeat every 25 to 100 ms.
pub const RELEASED: Duration = Duration::from_millis(200);
/// No terminal repeats a key faster.
const AT_ONCE: Duration = Duration::from_millis(10);
/// A held key begins to repeat within this time. Terminals wait 250 to 660 ms.
const REPEATS: Duration = Duration::from_millis(800);
/// After this time without a press, armed keys are disarmed.
pub const IDLE: Duration = Duration::from_secs(30);

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub enum Arming {
    #[default]
    Off,
    /// The program is asking the daemon whether this user may jog.
    Asked(u8),
    On {
        motor: u8,
        /// The time at which the user armed the keys, or last pressed a jog key.
        used: Instant,
        press: Option<Press>,
    },
}

/// The last press of a jog key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Press {
    action: PanelAction,
    at: Instant,
    /// The key has repeated, so the motor jogs.
    jogs: bool,
}

impl Arming {
    /// The motor that the keys are armed for.
    pub const fn motor(&self) -> Option<u8> {
        match self {
            Self::On { motor, .. } => Some(*motor),
            Self::Off | Self::Asked(_) => None,
        }
    }

    /// The daemon has allowed the jog, at `now`.
    pub fn allowed(&mut self, motor: u8, now: Instant) {
        if *self == Self::Asked(motor) {
            *self = Self::On { motor, used: now, press: None };
        }
    }

    /// The user has pressed a jog key. `None` if the keys are not armed, else the hand's next order, if any.
    pub fn press(&mut self, action: PanelAction, now: Instant) -> Option<Option<Order>> {
        let Self::On { motor, used, press } = self else { return None };
        *used = now;
        let before = press.filter(|press| press.action == action);
        let silent = before.map(|press| now.saturating_duration_since(press.at));
        let (jogs, order) = match (before, silent) {
            (Some(press), Some(silent)) if silent < AT_ONCE => (press.jogs, None),
            (Some(Press { jogs: true, .. }), _) => (true, Some(Order::Keep(now + RELEASED))),
            (Some(_), Some(silent)) if silent < REPEATS => {
                (true, Some(Order::Jog { motor: *motor, action, until: now + RELEASED }))
            }
            // The first press, or the first press of the other key.
            _ => (false, press.is_some_and(|press| press.jogs).then_some(Order::Stop)),
        };
        *press = Some(Press { action, at: now, jogs });
        Some(order)
    }

    /// Disarms the keys. Returns the order that stops a jog.
    pub fn disarm(&mut self) -> Option<Order> {
        match std::mem::take(self) {
            Self::On { press: Some(Press { jogs: true, .. }), .. } => Some(Order::Stop),
            _ => None,
        }
    }

    /// At `now`: forgets a key that the user has released; the hand then has stopped by itself. True when the keys went
    /// unused for so long that they are disarmed.
    pub fn idles(&mut self, now: Instant) -> bool {
        let Self::On { used, press, .. } = self else { return false };
        if press.is_some_and(|press| press.jogs && now.saturating_duration_since(press.at) >= RELEASED) {
            *press = None;
        }
        let idle = now.saturating_duration_since(*used) >= IDLE;
        if idle {
            *self = Self::Off;
        }
        idle
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use PanelAction::{JogMinus, JogPlus};

    const MS: fn(u64) -> Duration = Duration::from_millis;

    fn armed(now: Instant) -> Arming {
        let mut arming = Arming::Asked(3);
        arming.allowed(3, now);
        arming
    }

    #[test]
    fn a_key_moves_a_motor_only_while_it_repeats() {
        let now = Instant::now();
        let mut arming = armed(now);
        assert_eq!(arming.press(JogPlus, now), Some(None), "a single press moves nothing");
        let repeat = now + MS(500);
        let jog = Order::Jog { motor: 3, action: JogPlus, until: repeat + RELEASED };
        assert_eq!(arming.press(JogPlus, repeat), Some(Some(jog)));
        let again = repeat + MS(30);
        assert_eq!(arming.press(JogPlus, again), Some(Some(Order::Keep(again + RELEASED))));
        assert!(!arming.idles(again + MS(100)));
        assert_eq!(arming.press(JogPlus, again + MS(110)), Some(Some(Order::Keep(again + MS(310)))));
        // Released: the next press is a first press again.
        assert!(!arming.idles(again + MS(310)));
        assert_eq!(arming.press(JogPlus, again + MS(320)), Some(None));
    }

    #[test]
    fn presses_that_lay_waiting_are_one() {
        let now = Instant::now();
        let mut arming = armed(now);
        for press in 0..40 {
            assert_eq!(arming.press(JogPlus, now + MS(press)), Some(None), "{press}");
        }
        let held = now + MS(39 + 30);
        assert!(matches!(arming.press(JogPlus, held), Some(Some(Order::Jog { .. }))), "it is held after all");
        assert_eq!(arming.press(JogPlus, held + MS(1)), Some(None), "nor do they keep a jog");
    }

    #[test]
    fn two_presses_far_apart_and_two_directions_move_nothing() {
        let now = Instant::now();
        let mut arming = armed(now);
        assert_eq!(arming.press(JogPlus, now), Some(None));
        assert_eq!(arming.press(JogPlus, now + MS(900)), Some(None));
        assert_eq!(arming.press(JogMinus, now + MS(950)), Some(None));
        assert!(matches!(arming.press(JogMinus, now + MS(980)), Some(Some(Order::Jog { .. }))));
        assert_eq!(
            arming.press(JogPlus, now + MS(990)),
            Some(Some(Order::Stop)),
            "the other direction stops"
        );
    }

    #[test]
    fn keys_that_are_not_armed_do_nothing_and_disarming_stops() {
        let now = Instant::now();
        let mut arming = Arming::Off;
        assert_eq!(arming.press(JogPlus, now), None);
        arming = Arming::Asked(3);
        assert_eq!(arming.press(JogPlus, now), None, "not before the daemon has allowed it");
        arming.allowed(4, now);
        assert_eq!(arming, Arming::Asked(3), "an answer for another motor");
        arming = armed(now);
        assert_eq!(arming.disarm(), None);
        arming = armed(now);
        arming.press(JogPlus, now);
        arming.press(JogPlus, now + MS(300));
        assert_eq!(arming.disarm(), Some(Order::Stop));
        assert_eq!(arming, Arming::Off);
        arming = armed(now);
        assert!(!arming.idles(now + IDLE - MS(1)) && arming.motor() == Some(3));
        assert!(arming.idles(now + IDLE) && arming.motor().is_none());
    }
}
