//! What the bus thread knows of its board, as it passes it on: plain values held in place, which allocate nothing.

use std::time::Instant;

use super::function_use::FunctionUse;
use super::open_buffer::Standing;
use super::origin::GivenUp;
use crate::format::Text;
use crate::function::servo::Motion;
use crate::map::Motors;
use crate::protocol::board::Replay;
use crate::protocol::program_words::DefinitionsRead;
use crate::protocol::{CommandPort, CommandState, Enabled, State};
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

/// What was counted of the host port's interrupts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HostPortCounts {
    /// Interrupts served.
    pub served: u32,
    /// Of these, how many were old ones: no response was there any more.
    pub old: u32,
    /// Responses whose interrupt never came.
    pub unannounced: u32,
}

/// What the bus thread knows of its board. Held in place: passing it on allocates nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoardStatus {
    /// Whether the segment's data can be trusted.
    pub state: State,
    /// The automatic functions at work.
    pub enabled: Enabled,
    /// Which port command lines go through.
    pub command_port: CommandPort,
    /// What became of the last command line.
    pub command_state: CommandState,
    /// Since when none was answered.
    pub silent_since: Option<Instant>,
    /// What somebody else has changed.
    pub changes: [Option<Change>; CHANGES],
    /// The board answers command lines through the DPRAM, but marks no end of its replies.
    pub reply_end_missing: bool,
    /// The board answers the daemon's own lines otherwise than they ask, so that it gets no other line.
    pub answers_otherwise: bool,
    /// Whether the board takes control characters by the DPRAM word of their own; `None`: it was not asked yet.
    pub control_characters: Option<bool>,
    /// The program buffer that is open.
    pub buffer: Standing,
    /// The command that holds the port: one that was given up, or a slow line.
    pub holds_port: Option<GivenUp>,
    /// What the I-variables that switch functions on were when asked.
    pub enabling: Enabling,
    /// The motors whose loop is open, bit 0 being motor 1, as far as that is known for sure.
    pub open_loops: u32,
    /// The motors that a jog leaves alone, because it would close their loop.
    pub loops_left_open: u32,
    /// The motors that the report leaves out until it is known where M-variables point.
    pub loops_untold: u32,
    /// Which motors move.
    pub motion: Motion,
    /// Whether the board gathers, as the servo report tells; `None` while no report tells.
    pub gathers: Option<bool>,
    /// The coordinate systems that run a motion program, bit 0 being number 1; `None` while no report tells of all.
    pub programs_run: Option<u32>,
    /// Which functions are used.
    pub uses: FunctionUse,
    /// How far the board is asked where its M-variables point.
    pub definitions: DefinitionsRead,
    /// What the host port's interrupts have come to.
    pub host_port: HostPortCounts,
    /// What a replay has come to; `None` for a board.
    pub replay: Option<Replay>,
    /// Resets of the board seen since the start.
    pub resets: u32,
    /// What the board said, or the configuration says; `None` as long as the bus thread has not told.
    pub identity: Option<KnownIdentity>,
}

impl BoardStatus {
    /// Before anything was seen of the board.
    pub const UNKNOWN: Self = Self {
        state: State::Init,
        enabled: Enabled::empty(),
        command_port: CommandPort::Dpram,
        command_state: CommandState::Unknown,
        silent_since: None,
        changes: [None; CHANGES],
        reply_end_missing: false,
        answers_otherwise: false,
        control_characters: None,
        buffer: Standing { is_open: false, opened: None, is_unsaid: false },
        holds_port: None,
        enabling: Enabling { panel: None, variables: None, asked: None },
        open_loops: 0,
        loops_left_open: 0,
        loops_untold: 0,
        motion: Motion { moving: Motors::NONE, standing: Motors::NONE },
        gathers: None,
        programs_run: None,
        uses: FunctionUse::UNKNOWN,
        definitions: DefinitionsRead { read: 0, of: 0, seconds_left: None },
        host_port: HostPortCounts { served: 0, old: 0, unannounced: 0 },
        replay: None,
        resets: 0,
        identity: None,
    };
}

impl Default for BoardStatus {
    fn default() -> Self {
        Self::UNKNOWN
    }
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

/// Who the board is.
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
