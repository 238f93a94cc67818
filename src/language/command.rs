//! What a command of a line is.

use std::ops::Range;

use super::number::Numbers;
use crate::format::Text;

/// The longest name of a buffer: `PROG 32767`.
pub const NAME_MAX: usize = 16;

/// Whom a command goes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nobody.
    Nothing,
    /// The motor that is addressed.
    Motor,
    /// The coordinate system that is addressed.
    System,
}

/// What a command does with variables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Does {
    /// It asks for their values.
    Asks,
    /// It asks where M-variables point: `M1->`.
    AsksPlace,
    /// It points M-variables elsewhere: `M1->X:$770,8`.
    Defines,
    /// It sets them.
    Sets {
        /// To what, where that is a whole number.
        value: Option<u32>,
        /// A Q-variable is in it, one of a coordinate system's own.
        of_system: bool,
    },
}

/// Whether the program buffer of this name is the rotary ones.
pub fn is_rotary(name: &str) -> bool {
    name.starts_with("ROT")
}

/// What a command, or a line, does to the program buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// It opens the buffer of this name: `PROG 77`.
    Opens(Text<NAME_MAX>),
    /// It opens the rotary buffers for binary lines, and so for no text (Software Reference p. 271).
    OpensBinary,
    /// It closes what is open: `CLOSE`, `CLOSE ALL` (Turbo Software Reference p. 381).
    Closes,
}

/// What a command is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `#3`: this motor is addressed.
    Motor(u32),
    /// `&2`: this coordinate system is addressed.
    System(u32),
    /// `##1`: of a Turbo board, which motors ^B and others report; a PMAC may take the number for an address. `@0`: a card.
    Group(Needs, u32),
    /// `#3->`: this motor is addressed, and its axis in the coordinate system asked for.
    AxisOf(u32),
    /// `#3->100X`: this motor is addressed, and its axis defined.
    DefinesAxis(u32),
    /// It reports something, and does nothing else.
    Asks(Needs),
    /// `LIST`: it reports a program or a table.
    Lists(Needs),
    /// It asks for the firmware's version.
    Version,
    /// It is about variables of this letter.
    Variables(u8, Numbers, Does),
    /// It writes values to consecutive addresses of the board's memory: `WX`, `WY`, `WL`, `WP`.
    WritesMemory,
    /// It moves or stops something. The letter tells how: the command's own, of a jog the sign behind it; Z is `HMZ`.
    Moves(Needs, u8),
    /// `$$$`, `$$$***`.
    Resets,
    /// It opens a program buffer, or closes what is open.
    Buffer(Effect),
    /// It empties what is open: `CLEAR`.
    Clears,
    /// It adds to what is open by itself: `LEARN`.
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
    /// It defines or deletes another buffer.
    Buffers(Needs),
    /// It has PLC programs run: `ENABLE PLC`, `RESUME PLC`.
    StartsPlcs,
    /// `PASSWORD`.
    Password,
    /// It changes something else.
    Changes(Needs),
    /// A statement of a program.
    Statement(Needs),
    /// What stands in quotes: a program's text.
    Quoted,
    /// Nobody here knows; a statement of a program, most likely.
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

    /// Whether what stands behind the command means the same in a line of its own, told whom it addresses.
    #[must_use]
    pub const fn ends_its_line(self) -> bool {
        matches!(self, Self::Variables(_, _, Does::Sets { .. }) | Self::WritesMemory) || self.only_asks()
    }

    /// Whether the command can do more than ask for, or set, variables, say whom it addresses, and save: to move something, in the
    /// end. What is not known may.
    #[must_use]
    pub const fn may_move(self) -> bool {
        !(self.ends_its_line() || matches!(self, Self::Saves | Self::Group(..)))
            || matches!(self, Self::WritesMemory)
    }

    /// Whom the command goes to.
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

/// A command, and where it stands in its line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// Its bytes.
    pub span: Range<usize>,
    /// What it is.
    pub kind: Kind,
}
