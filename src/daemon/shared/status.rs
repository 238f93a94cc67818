//! The bus thread's knowledge of its board: plain values held in place, so that passing them on allocates nothing.

use std::time::Instant;

use super::function_use::FunctionUse;
use super::open_buffer::Standing;
use super::origin::GivenUp;
use crate::format::Text;
use crate::function::servo::Motion;
use crate::map::{Motors, Systems};
use crate::protocol::board::Replay;
use crate::protocol::{CommandLinesInfo, Enabled, HostPortCounts, State};
use crate::segment::identity::{BOARD_TYPE_BYTES, FIRMWARE_BYTES};

/// How many I-variables the daemon watches for another host's changes.
pub const CHANGES: usize = 8;

/// An I-variable that another host has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// Its number.
    pub variable: u16,
    /// Its value before.
    pub was: u32,
    /// Its value now.
    pub is: u32,
    /// When the board last told the value before.
    pub since: Instant,
}

/// The bus thread's knowledge of its board, each part as its owner last told it. Held in place: passing it on allocates
/// nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BoardStatus {
    /// Whether the segment's data can be trusted.
    pub state: State,
    /// The automatic functions at work.
    pub enabled: Enabled,
    /// The status of the queue of command lines.
    pub lines: LinesStatus,
    /// The status of the motors, from the reports.
    pub motors: MotorsStatus,
    /// Whether the board gathers; `None` while no report tells.
    pub gathers: Option<bool>,
    /// The coordinate systems that run a motion program; `None` while no report tells of all.
    pub programs_run: Option<Systems>,
    /// The functions that the daemon uses.
    pub uses: FunctionUse,
    /// Counts of the host port's interrupts.
    pub host_port: HostPortCounts,
    /// A replay's state; `None` for a board.
    pub replay: Option<Replay>,
    /// The resets of the board that the daemon has seen since its start.
    pub resets: u32,
    /// The identity that the board or the configuration tells; `None` until the bus thread has told it.
    pub identity: Option<KnownIdentity>,
}

/// The status of the queue of command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinesStatus {
    /// The part that every client may see.
    pub info: CommandLinesInfo,
    /// Since when the board has answered no line.
    pub silent_since: Option<Instant>,
    /// Another host's changes.
    pub changes: [Option<Change>; CHANGES],
    /// The program buffer that is open.
    pub buffer: Standing,
    /// The command that holds the port: a given-up command, or a slow line.
    pub holds_port: Option<GivenUp>,
    /// The I-variables that switch functions on, by the board's answers.
    pub enabling: Enabling,
}

/// The motors, as the reports describe them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MotorsStatus {
    /// The motors that move.
    pub motion: Motion,
    /// The motors whose loop is known for sure to be open.
    pub open_loops: Motors,
    /// The motors whose loop a jog would close. Use this to refuse jogs, never to skip a stop: it may be out of date.
    pub loops_left_open: Motors,
    /// The motors that the report leaves out until the daemon knows where M-variables point.
    pub loops_untold: Motors,
}

/// Whether functions are switched on, if the daemon has asked the board since something may have changed the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Enabling {
    /// The control panel: I2=3.
    pub panel: Option<bool>,
    /// Background variables: I55=1.
    pub variables: Option<bool>,
    /// When the daemon asked the board.
    pub asked: Option<Instant>,
}

/// The board's identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KnownIdentity {
    /// The answer to `VERSION`.
    pub firmware: Option<Text<FIRMWARE_BYTES>>,
    /// The answer to `TYPE`.
    pub board_type: Option<Text<BOARD_TYPE_BYTES>>,
    /// How many motors the board reports.
    pub motors: u32,
    /// The servo cycle in nanoseconds.
    pub servo_period_ns: Option<u64>,
}
