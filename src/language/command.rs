//! The commands of a line.

use std::ops::Range;

use super::number::Numbers;
use crate::format::Text;

/// The longest name of a buffer: `PROG 32767`.
pub const NAME_MAX: usize = 16;

/// The receiver of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Neither a motor nor a coordinate system.
    Nothing,
    /// The addressed motor.
    Motor,
    /// The addressed coordinate system.
    System,
}

/// The effect of a command on variables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Does {
    /// The command asks for their values.
    Asks,
    /// The command asks where M-variables point: `M1->`.
    AsksPlace,
    /// The command points M-variables elsewhere: `M1->X:$770,8`.
    Defines,
    /// The command sets them.
    Sets {
        /// The new value, if it is a whole number.
        value: Option<u32>,
        /// The command names a Q-variable, which belongs to a coordinate system.
        of_system: bool,
    },
}

/// Whether this name stands for the rotary buffers.
pub fn is_rotary(name: &str) -> bool {
    name.starts_with("ROT")
}

/// The effect of a command, or a line, on the program buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// The command opens the buffer of this name: `PROG 77`.
    Opens(Text<NAME_MAX>),
    /// The command opens the rotary buffers for binary lines, and so not for text (Software Reference p. 271).
    OpensBinary,
    /// The command closes the open buffers: `CLOSE`, `CLOSE ALL` (Turbo Software Reference p. 381).
    Closes,
}

/// The kinds of commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `#3`: addresses this motor.
    Motor(u32),
    /// `&2`: addresses this coordinate system.
    System(u32),
    /// `##1`: on a Turbo board chooses the motors that ^B and others report; a PMAC may take the number for an
    /// address. `@0`: addresses a card.
    Group(Needs, u32),
    /// `#3->`: addresses this motor, and asks for its axis in the coordinate system.
    AxisOf(u32),
    /// `#3->100X`: addresses this motor, and defines its axis.
    DefinesAxis(u32),
    /// The command only reports.
    Asks(Needs),
    /// `LIST`: reports a program or a table.
    Lists(Needs),
    /// The command asks for the firmware's version.
    Version,
    /// The command asks for or sets variables of this letter, or their definitions.
    Variables(u8, Numbers, Does),
    /// The command writes values to consecutive addresses of the board's memory: `WX`, `WY`, `WL`, `WP`.
    WritesMemory,
    /// The command moves or stops motors or programs. The letter tells how: the command's own letter, for a jog the
    /// sign behind the J; Z is `HMZ`.
    Moves(Needs, u8),
    /// `$$$`, `$$$***`.
    Resets,
    /// The command opens a program buffer, or closes the open ones.
    Buffer(Effect),
    /// The command empties the open buffer: `CLEAR`.
    Clears,
    /// The board itself adds a line to the open buffer: `LEARN`.
    Learns,
    /// `SAVE`.
    Saves,
    /// `MSSAVE`: a station of a MACRO ring saves its settings.
    StationSaves,
    /// `ENDGATHER`.
    EndsGather,
    /// `DELETE GATHER`.
    DeletesGather,
    /// `DELETE ROT`.
    DeletesRotary,
    /// The command defines or deletes another buffer.
    Buffers(Needs),
    /// The command starts PLC programs: `ENABLE PLC`, `RESUME PLC`.
    StartsPlcs,
    /// `PASSWORD`.
    Password,
    /// The command changes another state of the board.
    Changes(Needs),
    /// A statement of a program.
    Statement(Needs),
    /// Text in quotes: a program's text.
    Quoted,
    /// A command that this module does not know; most likely a statement of a program.
    Unknown,
}

impl Kind {
    /// Whether the command changes nothing.
    #[must_use]
    pub const fn only_asks(self) -> bool {
        let asks_for_variables = matches!(self, Self::Variables(_, _, Does::Asks | Does::AsksPlace));
        let addresses = matches!(self, Self::Motor(_) | Self::System(_) | Self::AxisOf(_));
        addresses || asks_for_variables || matches!(self, Self::Asks(_) | Self::Lists(_) | Self::Version)
    }

    /// Whether the text behind the command means the same in a line of its own that repeats the address.
    #[must_use]
    pub const fn ends_its_line(self) -> bool {
        matches!(self, Self::Variables(_, _, Does::Sets { .. }) | Self::WritesMemory) || self.only_asks()
    }

    /// Whether the command can do more than ask for or set variables, address, and save, so that it may move a motor
    /// in the end. An unknown command may.
    #[must_use]
    pub const fn may_move(self) -> bool {
        !(self.ends_its_line() || matches!(self, Self::Saves | Self::Group(..)))
            || matches!(self, Self::WritesMemory)
    }

    /// The receiver of the command.
    #[must_use]
    pub const fn needs(self) -> Needs {
        match self {
            Self::Asks(needs)
            | Self::Lists(needs)
            | Self::Moves(needs, _)
            | Self::Buffers(needs)
            | Self::Changes(needs)
            | Self::Statement(needs) => needs,
            Self::Variables(b'Q', ..) | Self::Variables(_, _, Does::Sets { of_system: true, .. }) => {
                Needs::System
            }
            Self::AxisOf(_) | Self::DefinesAxis(_) | Self::DeletesRotary => Needs::System,
            _ => Needs::Nothing,
        }
    }
}

/// A command and its place in the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// Its bytes.
    pub span: Range<usize>,
    /// Its kind.
    pub kind: Kind,
}
