//! The socket's jobs for the other functions: panel requests, words of the user area, rotary programs.

use crate::function::gather::GatherBuffer;
use crate::function::panel::{FeedOverride, PanelRequest};
use crate::function::variable_read::VariableEntry;
use crate::function::variable_write::WriteRecord;
use crate::map::{Function, HostOffset, Motors};
use crate::mirror::GatherClock;

/// A job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Job {
    /// Hand a control panel request to the board; done when the board has taken it.
    Panel(PanelRequest),
    /// Stop these motors, whose held jog is over. Leave out the motors whose loop is open: a stop would close the loop,
    /// and a killed motor must stay killed.
    EndHold(Motors),
    /// Set a coordinate system's feed rate override, or stop overriding it.
    Override {
        /// The coordinate system, from 1.
        coordinate_system: usize,
        /// The override, or `None` to leave the board's own.
        value: Option<FeedOverride>,
    },
    /// Write words, ascending. Change only the bits in each word's mask.
    Write {
        /// The first word.
        first: HostOffset,
        /// Values and masks.
        words: Vec<MaskedWord>,
        /// Write the words even if an automatic function or a buffer owns them.
        anywhere: bool,
    },
    /// Have PMAC copy these registers in the background, in place of the earlier ones. An empty list ends the copying.
    WatchVariables(Vec<VariableEntry>),
    /// Have PMAC write registers, in their order; done when it has.
    WriteVariables(Vec<WriteRecord>),
    /// Follow the newly defined gather buffer, from its first sample on, into the segment.
    GatherBegin {
        /// The buffer.
        buffer: GatherBuffer,
        /// The clock that counts the board's turns in the buffer.
        clock: GatherClock,
    },
    /// The board gathers no more: publish the rest.
    GatherEnd,
    /// Set a rotary buffer up, empty.
    RotaryOpen {
        /// The buffer, by its place in [`crate::map::RotaryHeaders`].
        buffer: usize,
        /// The buffer's first word; if `None`, as the plan has it.
        start: Option<HostOffset>,
        /// The buffer's size in longs; if `None`, the size that the plan keeps for it.
        size_longs: Option<u32>,
        /// The coordinate system, from 1.
        coordinate_system: u8,
        /// The header's number for coordinate system 1.
        coordinate_system_base: u8,
    },
    /// Put lines into a rotary buffer as it has room; done when the last line is in.
    RotarySend {
        /// The buffer, by its place in [`crate::map::RotaryHeaders`].
        buffer: usize,
        /// The number that the first line has to have, counted from 0 since the daemon has set up the buffer.
        first: Option<u64>,
        /// The commands of each line, two words a command.
        lines: Vec<Vec<(u32, u32)>>,
    },
    /// No line will follow: an empty buffer is no underrun any more.
    RotaryFinish(usize),
    /// Mark a rotary buffer's header as not in use: the board takes no more lines out of the buffer.
    RotaryClose(usize),
    /// Tell a rotary buffer's progress. [`super::queue::Event::Rotary`] is the answer.
    RotaryState(usize),
}

impl Job {
    /// The job's function; `None` for words that an engineer writes.
    #[must_use]
    pub const fn function(&self) -> Option<Function> {
        match self {
            Self::Panel(_) | Self::EndHold(_) | Self::Override { .. } => Some(Function::Panel),
            Self::Write { .. } => None,
            Self::WatchVariables(_) | Self::WriteVariables(_) => Some(Function::Variables),
            Self::GatherBegin { .. } | Self::GatherEnd => Some(Function::Gather),
            Self::RotaryOpen { .. }
            | Self::RotarySend { .. }
            | Self::RotaryFinish(_)
            | Self::RotaryClose(_)
            | Self::RotaryState(_) => Some(Function::Rotary),
        }
    }

    /// Whether the job only stops motors that jog.
    #[must_use]
    pub fn is_stop(&self) -> bool {
        match self {
            Self::Panel(request) => request.is_stop(),
            Self::EndHold(_) => true,
            _ => false,
        }
    }
}

/// A word to write, and the bits to change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaskedWord {
    /// The value.
    pub value: u16,
    /// The bits to change.
    pub mask: u16,
}
