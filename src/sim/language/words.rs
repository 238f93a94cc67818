//! Keywords of on-line commands, long and short forms (Software Reference, command lists).
//!
//! A board accepts the words of its generation's [`tables`]; other words of PMAC's manuals are [`Word::Foreign`].

use crate::map::Generation;
use crate::sim::program::item::PlcSwitch;

/// A command that works on buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferCommand {
    /// `OPEN PROG`, `OPEN ROT`, `OPEN PLC`.
    Open,
    /// `CLOSE`.
    Close,
    /// `CLOSE`, or `CLOSE ALL`, which closes the open buffer of any port: here at most one buffer is open.
    CloseAll,
    /// `CLEAR`.
    Clear,
    /// `LEARN`.
    Learn,
    /// `LIST` of any kind.
    List,
    /// `PC`: the line to be calculated next.
    Calculated,
    /// `PE`: the line in execution.
    Executed,
    /// `PR`.
    RotaryRemaining,
    /// `ENABLE PLC` and the like.
    Plc(PlcSwitch),
    /// `PMATCH`.
    Match,
}

/// The registers of a memory command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Space {
    /// 24-bit X words.
    X,
    /// 24-bit Y words.
    Y,
    /// 48-bit registers: X word high, Y word low.
    L,
    /// Program memory, for writing only: the firmware is in it, and a write changes nothing here.
    Program,
}

/// The registers and the number format of a read command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Form {
    /// Registers.
    pub space: Space,
    /// Hex, zero padded, unsigned; otherwise signed decimal.
    pub hex: bool,
}

/// The meaning of a keyword. Commands of one character are dispatched by that character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// `?` and longer: status words of motor (1), coordinate system (2) or board (3).
    Status(u8),
    /// `$`: reset the motor.
    ResetMotor,
    /// `$*`: read the absolute position.
    AbsolutePosition,
    /// `$$$`: reset the board.
    Reset,
    /// `$$$***`: reset it to factory defaults.
    FactoryReset,
    /// `HOME`.
    Home,
    /// `HOMEZ`.
    HomeZero,
    /// `ABS`.
    Absolute,
    /// `INC`.
    Incremental,
    /// `FRAX`.
    FeedrateAxes,
    /// `UNDEFINE`.
    Undefine,
    /// `RX` and similar: read memory.
    Read(Form),
    /// `WX` and similar: write memory.
    Write(Space),
    /// `DEFINE` a buffer.
    Define,
    /// `DELETE` a buffer.
    Delete,
    /// `GATHER`.
    Gather,
    /// `ENDGATHER`.
    EndGather,
    /// `END`; `GATHER` follows.
    End,
    /// `VERSION`.
    Version,
    /// `TYPE`.
    Type,
    /// `DATE`.
    Date,
    /// `CHECKSUM`.
    Checksum,
    /// `SIZE`.
    Size,
    /// `SAVE`.
    Save,
    /// `PASSWORD`.
    Password,
    /// A statement of a program: an error without an open buffer (ERR005).
    Program,
    /// A command on program and table buffers.
    Buffer(BufferCommand),
    /// `CID`.
    Part,
    /// `VID`.
    Vendor,
    /// `CPU`.
    Processor,
    /// `IDNUMBER`, `SID`.
    Serial,
    /// `TODAY`.
    Today,
    /// `TIME`.
    Time,
    /// `MS`: a variable of a MACRO station, or a command to the station.
    Station,
    /// `MSR`, or `MSW` with `true`: a transfer between a variable of a MACRO station and a variable of the board.
    StationTransfer(bool),
    /// `SETPHASE`.
    SetPhase,
    /// `E`: enable the killed motors of the coordinate system.
    EnableMotors,
    /// `LOCK`, or `UNLOCK` with `false`.
    Lock(bool),
    /// `MOVETIME`.
    MoveTime,
    /// `MX`: a variable of a station that speaks protocol type 0.
    Auxiliary,
    /// `MXR`, `MXW`.
    AuxiliaryTransfer,
    /// A word of another family: ERR003 here.
    Foreign,
}

impl Word {
    /// Whether words or numbers of its own may follow the word.
    #[must_use]
    pub const fn has_operands(self) -> bool {
        !matches!(
            self,
            Self::Status(_)
                | Self::ResetMotor
                | Self::AbsolutePosition
                | Self::Home
                | Self::HomeZero
                | Self::Version
                | Self::Type
                | Self::Date
                | Self::EnableMotors
                | Self::MoveTime
        )
    }
}

use BufferCommand as B;
use Word as W;

const fn read(space: Space, hex: bool) -> Word {
    W::Read(Form { space, hex })
}

/// The tables of the boards of a generation.
#[must_use]
pub const fn tables(generation: Generation) -> &'static [&'static [(&'static str, Word)]] {
    match generation {
        Generation::Pmac => &[COMMON],
        Generation::Turbo => &[COMMON, TURBO],
    }
}

/// Turbo PMAC's additional words, and its replacements of words above.
const TURBO: &[(&str, Word)] = &[
    ("CID", W::Part),
    ("VID", W::Vendor),
    ("CPU", W::Processor),
    ("IDNUMBER", W::Serial),
    ("IDNUM", W::Serial),
    ("SID", W::Serial),
    ("TODAY", W::Today),
    ("TIME", W::Time),
    ("CLOSE", W::Buffer(B::CloseAll)),
    ("CLS", W::Buffer(B::CloseAll)),
    ("MS", W::Station),
    ("MACROSLV", W::Station),
    ("MSR", W::StationTransfer(false)),
    ("MSW", W::StationTransfer(true)),
    ("MACROSLVREAD", W::StationTransfer(false)),
    ("MACROSLVWRITE", W::StationTransfer(true)),
    ("SETPHASE", W::SetPhase),
    ("PAUSE", W::Buffer(B::Plc(PlcSwitch::Pause))),
    ("PAU", W::Buffer(B::Plc(PlcSwitch::Pause))),
    ("RESUME", W::Buffer(B::Plc(PlcSwitch::Resume))),
    ("RES", W::Buffer(B::Plc(PlcSwitch::Resume))),
    ("E", W::EnableMotors),
    ("LOCK", W::Lock(true)),
    ("UNLOCK", W::Lock(false)),
    ("MOVETIME", W::MoveTime),
    ("MX", W::Auxiliary),
    ("MACROAUX", W::Auxiliary),
    ("MXR", W::AuxiliaryTransfer),
    ("MACROAUXREAD", W::AuxiliaryTransfer),
    ("MXW", W::AuxiliaryTransfer),
    ("MACROAUXWRITE", W::AuxiliaryTransfer),
    // The version of a part that this board does not have: no manual seen gives the answer of a board without that
    // part.
    ("EAVERSION", W::Foreign),
];

/// Keywords of every board.
pub const COMMON: &[(&str, Word)] = &[
    ("?", W::Status(1)),
    ("??", W::Status(2)),
    ("???", W::Status(3)),
    ("$", W::ResetMotor),
    ("$*", W::AbsolutePosition),
    ("$$", W::Foreign),
    ("$$*", W::Foreign),
    ("$$$", W::Reset),
    ("$$$***", W::FactoryReset),
    ("HOME", W::Home),
    ("HM", W::Home),
    ("HOMEZ", W::HomeZero),
    ("HMZ", W::HomeZero),
    ("ABS", W::Absolute),
    ("INC", W::Incremental),
    ("FRAX", W::FeedrateAxes),
    ("UNDEFINE", W::Undefine),
    ("UNDEF", W::Undefine),
    ("RX", read(Space::X, false)),
    ("RY", read(Space::Y, false)),
    ("RL", read(Space::L, false)),
    ("RHX", read(Space::X, true)),
    ("RHY", read(Space::Y, true)),
    ("RHL", read(Space::L, true)),
    ("WX", W::Write(Space::X)),
    ("WY", W::Write(Space::Y)),
    ("WL", W::Write(Space::L)),
    ("WP", W::Write(Space::Program)),
    ("DEFINE", W::Define),
    ("DEF", W::Define),
    ("DELETE", W::Delete),
    ("DEL", W::Delete),
    ("GATHER", W::Gather),
    ("GAT", W::Gather),
    ("ENDGATHER", W::EndGather),
    ("ENDG", W::EndGather),
    ("END", W::End),
    ("VERSION", W::Version),
    ("VER", W::Version),
    ("TYPE", W::Type),
    ("DATE", W::Date),
    ("CHECKSUM", W::Checksum),
    ("CHKS", W::Checksum),
    ("SIZE", W::Size),
    ("SAVE", W::Save),
    ("PASSWORD", W::Password),
    ("OPEN", W::Buffer(B::Open)),
    ("CLOSE", W::Buffer(B::Close)),
    ("CLS", W::Buffer(B::Close)),
    ("CLEAR", W::Buffer(B::Clear)),
    ("CLR", W::Buffer(B::Clear)),
    ("LEARN", W::Buffer(B::Learn)),
    ("LIST", W::Buffer(B::List)),
    ("PC", W::Buffer(B::Calculated)),
    ("PE", W::Buffer(B::Executed)),
    ("PR", W::Buffer(B::RotaryRemaining)),
    ("ENABLE", W::Buffer(B::Plc(PlcSwitch::Enable))),
    ("ENA", W::Buffer(B::Plc(PlcSwitch::Enable))),
    ("DISABLE", W::Buffer(B::Plc(PlcSwitch::Disable))),
    ("DIS", W::Buffer(B::Plc(PlcSwitch::Disable))),
    ("PAUSE", W::Foreign),
    ("PAU", W::Foreign),
    ("RES", W::Foreign),
    ("RESUME", W::Foreign),
    ("PMATCH", W::Buffer(B::Match)),
];
