//! Why a held jog is over, in the words for its holder and the log.

use std::fmt;

use crate::daemon::shared::open_buffer::Account;
use crate::map::Motors;
use crate::protocol::control;

/// Why a held jog is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HoldEnd {
    /// The holder was silent for too long, or is gone.
    Silent,
    /// A client sent this control character, which stops every motor.
    Control(u8),
    /// The loops of these motors have opened.
    OpenLoop(Motors),
    /// This account has stopped these motors through the daemon.
    Stopped(Account, Motors),
    /// These motors stand, whatever stopped them.
    Stands(Motors),
    /// The board has stopped reading the control panel: this account has switched the panel off, or an unknown sender.
    PanelEnded(Option<Account>),
    /// The daemon ends.
    DaemonEnds,
}

impl fmt::Display for HoldEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::Silent {
            return f.write_str("the held jog was not renewed in time; pmacd stops it");
        }
        f.write_str("the held jog is over: ")?;
        match self {
            Self::Silent => Ok(()),
            Self::Control(character) => {
                let does = if *character == control::KILL { "kills" } else { "stops" };
                write!(f, "somebody sent {}, which {does} every motor", control::name(*character))
            }
            Self::OpenLoop(motors) => {
                write!(f, "the loop of motor {motors} is open (killed, a fault, or a reset)")
            }
            Self::Stopped(by, motors) => write!(f, "{by} stopped motor {motors}"),
            Self::PanelEnded(by) => {
                match by {
                    Some(by) => write!(f, "{by} has switched the control panel off (I2)")?,
                    None => f.write_str(
                        "the control panel is off (I2 is not 3 any more), by the serial port, another host or a program of the board",
                    )?,
                }
                f.write_str("; pmacd stops it by command line")
            }
            Self::DaemonEnds => f.write_str("pmacd is stopping, and every held jog with it"),
            Self::Stands(motors) => write!(
                f,
                "motor {motors} stands; somebody stopped it, or it is at a limit; pmacd stops every motor of the hold"
            ),
        }
    }
}
