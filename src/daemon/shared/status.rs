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

/// How many I-variables are watched for changes by somebody else.
pub const CHANGES: usize = 8;

/// An I-variable that somebody else has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// Its number.
    pub variable: u16,
    /// Its value before.
    pub was: u32,
    /// Its value now.
    pub is: u32,
    /// When the board told the value before for the last time.
    pub since: Instant,
}

/// What the bus thread knows of its board, each part as its owner told it last. Held in place: passing it on allocates nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BoardStatus {
    /// Whether the segment's data can be trusted.
    pub state: State,
    /// The automatic functions at work.
    pub enabled: Enabled,
    /// Of the queue of command lines.
    pub lines: LinesStatus,
    /// Of the reports, about the motors.
    pub motors: MotorsStatus,
    /// Whether the board gathers, as a report tells; `None` while no report tells.
    pub gathers: Option<bool>,
    /// The coordinate systems that run a motion program; `None` while no report tells of all.
    pub programs_run: Option<Systems>,
    /// Which functions are used.
    pub uses: FunctionUse,
    /// Counts of the host port's interrupts.
    pub host_port: HostPortCounts,
    /// A replay's state; `None` for a board.
    pub replay: Option<Replay>,
    /// Resets of the board seen since the start.
    pub resets: u32,
    /// What the board said, or the configuration says; `None` as long as the bus thread has not told.
    pub identity: Option<KnownIdentity>,
}

/// The part of the queue of command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinesStatus {
    /// The part for every client.
    pub info: CommandLinesInfo,
    /// Since when the board has answered no line.
    pub silent_since: Option<Instant>,
    /// Another host's changes.
    pub changes: [Option<Change>; CHANGES],
    /// The program buffer that is open.
    pub buffer: Standing,
    /// The command that holds the port: one that was given up, or a slow line.
    pub holds_port: Option<GivenUp>,
    /// The I-variables that switch functions on, as the board answered.
    pub enabling: Enabling,
}

/// The motors, as the reports describe them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MotorsStatus {
    /// Which of them move.
    pub motion: Motion,
    /// Their loop is open, as far as that is known for sure.
    pub open_loops: Motors,
    /// A jog would close their loop. Use this to refuse jogs, never to skip a stop: it may be out of date.
    pub loops_left_open: Motors,
    /// The report leaves them out until it is known where M-variables point.
    pub loops_untold: Motors,
}

/// Whether functions are switched on, where the board was asked since something may have changed it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Enabling {
    /// The control panel: I2=3.
    pub panel: Option<bool>,
    /// Background variables: I55=1.
    pub variables: Option<bool>,
    /// When the board was asked.
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
