//! The words of the language: on-line commands, and statements that begin like one-letter commands. Words with the
//! same meaning stand together, parted by `|`.

use super::command::Effect;
use super::command::Kind::{self, Asks, Buffers, Changes, Moves, Statement};
use super::command::Needs::{self, Motor, Nothing, System};

/// The command that a word is, or begins.
#[derive(Debug, Clone, Copy)]
pub(super) enum Word {
    Is(Kind),
    List,
    Open,
    Define,
    Delete,
    Station,
}

use Word::Is;

pub(super) const WORDS: [(Word, &str); 24] = [
    (Is(Asks(Nothing)), "CHECKSUM|CHKS|CID|CPU|DATE|SID|SIZE|TIME|TODAY|TYPE|VID"),
    (Is(Asks(System)), "PC|PE|PR"),
    (Is(Kind::Version), "VER|VERSION"),
    (Is(Moves(Motor, b'H')), "HM|HOME"),
    (Is(Moves(Motor, b'Z')), "HMZ|HOMEZ"),
    // ABR aborts the program and runs it from its beginning.
    (Is(Moves(System, b'R')), "ABR"),
    (Is(Kind::Buffer(Effect::Closes)), "CLOSE|CLS"),
    (Is(Kind::Clears), "CLEAR|CLR"),
    (Is(Kind::Learns), "LEARN"),
    (Is(Kind::Saves), "SAVE"),
    (Is(Kind::StationSaves), "MSSAVE|MACROSLVSAVE"),
    (Is(Kind::EndsGather), "ENDG|ENDGATHER|END GATHER|END G"),
    (Is(Kind::Password), "PASSWORD"),
    (Is(Kind::StartsPlcs), "ENABLEPLC|ENABLE PLC|ENAPLC|ENA PLC|RESUMEPLC|RESUME PLC|RESPLC|RES PLC"),
    (Is(Changes(Nothing)), "GAT|GATHER"),
    (Is(Changes(System)), "MFLUSH|PMATCH"),
    (Is(Buffers(System)), "UNDEFINE|UNDEF|UNDEFINE ALL|UNDEFINEALL|UNDEF ALL|UNDEFALL"),
    (Is(Statement(Nothing)), STATEMENTS),
    (Is(Statement(System)), "ABS|FRAX|INC"),
    (Word::List, "LIST"),
    (Word::Open, "OPEN"),
    (Word::Define, "DEF|DEFINE"),
    (Word::Delete, "DEL|DELETE"),
    (Word::Station, "MS|MACROSLV"),
];
const STATEMENTS: &str = "ADDRESS|ADIS|ADR|AND|AROT|BLOCKSTART|BLOCKSTOP|BSTART|BSTOP|DELAY|PSET|PAUSE|PVT|RAPID|READ|RESUME|RET|RETURN|\
    RPD|SEND|SETPHASE|SPLINE|STN|STOP";

/// Statements of programs that do not begin like a command. A board takes a command right behind such a statement:
/// `LINEARJ+`.
pub(super) const PROGRAM_WORDS: [((), &str); 1] = [(
    (),
    "CALL|CIR|CIRCLE|CMD|COMMAND|DIS|DISABLE|DISP|DISPLAY|DLY|DWE|DWELL|ELSE|ENDI|ENDIF|ENDW|ENDWHILE|GOS|GOSUB|GOT|GOTO|IDIS|IF|\
        IROT|LIN|LINEAR|NORMAL|NRM|OR|PRELUDE|TA|TINIT|TM|TS|TSEL|TSELECT|WAI|WAIT|WHILE",
)];

/// The tables and buffers that commands define and delete; the kind is that of the deletion.
pub(super) const TABLES: [(Kind, &str); 5] = [
    (Kind::DeletesRotary, "ROT|ROTARY"),
    (Kind::DeletesGather, "GAT|GATHER"),
    (Buffers(Motor), "BLCOMP|COMP|TCOMP"),
    (Buffers(System), "CCBUF|CCUBUF|LOOK|LOOKAHEAD"),
    (Buffers(Nothing), "ALL|PLCC|TBUF|TBUFFER|TEMPS|TRACE|TRANS|UBUF|UBUFFER"),
];
/// The programs and tables that `LIST` lists.
pub(super) const LISTED: [(Needs, &str); 3] = [
    (Nothing, "PROGRAM|PROG|PLCC|PLC|GATHER|LINK|LDS"),
    (Motor, "BLCOMP|TCOMP|COMP"),
    (System, "ROTARY|ROT|FORWARD|INVERSE|PC|PE"),
];
/// The buffers that `OPEN` opens; the first row takes only binary lines.
pub(super) const OPENED: [(bool, &str); 2] = [
    (true, "BIN|BINARY|BIN ROT|BINARY ROT|BIN ROTARY|BINARY ROTARY"),
    (false, "PROG|PLC|PLCC|ROT|ROTARY|FORWARD|INVERSE"),
];
/// The board's memories.
pub(super) const MEMORIES: [((), &str); 1] = [((), "DP|D|F|L|X|Y")];
