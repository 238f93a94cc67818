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
    /// Stop these motors, whose held jog is over. Not those whose loop is open: a stop closes it, and a killed motor must stay
    /// killed.
    EndHold(Motors),
    /// Set a coordinate system's feed rate override, or stop overriding it.
    Override {
        /// The coordinate system, from 1.
        coordinate_system: usize,
        /// The override, or `None` to leave the board's own.
        value: Option<FeedOverride>,
    },
    /// Write words, ascending; of each only the bits set in its mask (others keep what they are).
    Write {
        /// The first word.
        first: HostOffset,
        /// Values and masks.
        words: Vec<MaskedWord>,
        /// Also where an automatic function or a buffer owns the words.
        anywhere: bool,
    },
    /// Have PMAC copy these registers in the background, instead of those it copied before; none stops it.
    WatchVariables(Vec<VariableEntry>),
    /// Have PMAC write registers, in their order; done when it has.
    WriteVariables(Vec<WriteRecord>),
    /// Follow the gather buffer that was just defined, from its first sample on, into the segment.
    GatherBegin {
        /// The buffer.
        buffer: GatherBuffer,
        /// By which clock the board's turns in it are counted.
        clock: GatherClock,
    },
    /// The board gathers no more: publish what is left.
    GatherEnd,
    /// Set a rotary buffer up, empty.
    RotaryOpen {
        /// Which buffer, by its place in [`crate::map::RotaryHeaders`].
        buffer: usize,
        /// Its first word; where the plan has it when not given.
        start: Option<HostOffset>,
        /// Its size in longs; what the plan keeps for it when not given.
        size_longs: Option<u32>,
        /// The coordinate system, from 1.
        coordinate_system: u8,
        /// What the header calls coordinate system 1.
        coordinate_system_base: u8,
    },
    /// Put lines into a rotary buffer, as there is room; done when the last one is in.
    RotarySend {
        /// Which buffer, by its place in [`crate::map::RotaryHeaders`].
        buffer: usize,
        /// The number the first of them has to have, counted from 0 since the buffer was set up.
        first: Option<u64>,
        /// The commands of each line, two words a command.
        lines: Vec<Vec<(u32, u32)>>,
    },
    /// No line will follow: running empty is no underrun any more.
    RotaryFinish(usize),
    /// How far a rotary buffer is. Answered by [`super::queue::Event::Rotary`].
    RotaryState(usize),
}

impl Job {
    /// The function that it is for; `None`: words that an engineer writes.
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
            | Self::RotaryState(_) => Some(Function::Rotary),
        }
    }

    /// Whether it only stops motors that jog.
    #[must_use]
    pub fn is_stop(&self) -> bool {
        match self {
            Self::Panel(request) => request.is_stop(),
            Self::EndHold(_) => true,
            _ => false,
        }
    }
}

/// A word to write, and which of its bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaskedWord {
    /// The value.
    pub value: u16,
    /// The bits to change.
    pub mask: u16,
}
