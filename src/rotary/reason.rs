//! Why the format cannot hold a text, and how the sent program would differ from it.

use std::fmt;

use super::codes::Range;
use super::float::TooLarge;
use crate::format::file_text::NotText;

/// A finding and its place in the text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Placed<T> {
    /// The line, from 1.
    pub line: u32,
    /// The column, from 1, in characters.
    pub column: u32,
    /// The finding.
    pub what: T,
}

impl<T: fmt::Display> fmt::Display for Placed<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.line, self.column, self.what)
    }
}

/// Findings in text order; the report lists the first [`Report::LIMIT`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report<T> {
    /// The listed findings.
    pub listed: Vec<Placed<T>>,
    /// How many more findings the text has.
    pub more: usize,
}

impl<T> Default for Report<T> {
    fn default() -> Self {
        Self { listed: Vec::new(), more: 0 }
    }
}

impl<T> Report<T> {
    /// How many findings a report lists.
    pub const LIMIT: usize = 100;

    /// Whether the report has no finding.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// How many findings the text has in all.
    #[must_use]
    pub fn count(&self) -> usize {
        self.listed.len() + self.more
    }

    pub(super) fn add(&mut self, line: u32, column: u32, what: T) {
        if self.listed.len() < Self::LIMIT {
            self.listed.push(Placed { line, column, what });
        } else {
            self.more += 1;
        }
    }

    pub(super) fn append(&mut self, other: Self) {
        self.more += other.more;
        for placed in other.listed {
            self.add(placed.line, placed.column, placed.what);
        }
    }
}

/// Why a binary rotary buffer cannot take a piece of text.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Reason {
    /// The whole input is not a text.
    #[error(transparent)]
    NotText(NotText),
    /// A branch or loop.
    #[error("{0} cannot be sent: a rotary program has no branches, loops or subroutine ends")]
    Branch(&'static str),
    /// A statement that sends text from within a program.
    #[error("{0} cannot be sent: text in a program has no binary code; send the line through an ASCII port")]
    Text(&'static str),
    /// An on-line command.
    #[error("{0} is an on-line command, not a program command: send it through an ASCII port")]
    OnLine(String),
    /// A program command that has no code.
    #[error("{0} cannot be sent: it has no binary code")]
    NoCode(&'static str),
    /// WAIT.
    #[error("WAIT cannot be sent: its binary code is not implemented in PMAC")]
    Wait,
    /// N or O.
    #[error("{0} cannot be sent: the binary codes of N and O are those of variable assignments")]
    Label(&'static str),
    /// Parentheses or an operator where a constant must be.
    #[error("an expression cannot be sent: only constants")]
    Expression,
    /// A variable where a constant must be.
    #[error("a variable as data cannot be sent: only constants")]
    Variable,
    /// `P1..10=`.
    #[error("a range of variables cannot be assigned in a program: one assignment each")]
    VariableRange,
    /// `I5=*`.
    #[error("the default value * cannot be sent: only constants")]
    Default,
    /// An invalid variable number.
    #[error(
        "{0}: variable numbers are whole numbers from 0 to 1023; a binary command has no room for others"
    )]
    VariableNumber(String),
    /// An operator that only M-variables have.
    #[error("{0} is for M-variables only")]
    Operator(&'static str),
    /// `^=` and `&=` of M-variables.
    #[error(
        "{0} cannot be sent: the manual gives its binary code in two ways; send it as an on-line command, or the program as text \
         (OPEN ROT)"
    )]
    BitCode(&'static str),
    /// ABS, INC and FRAX, if the settings do not say where their code stands.
    #[error(
        "{0} cannot be sent: the manual's drawing has its code in two places, and a board of the other one would move elsewhere \
         (docs/evidence.md); rotary check finds out: tell rotary_code2 then, or give it before the first move of a stream"
    )]
    Untold(&'static str),
    /// A command without its number.
    #[error("{0} needs a constant")]
    NeedsNumber(&'static str),
    /// A hexadecimal constant with too many digits.
    #[error("a hexadecimal constant has 12 digits at most")]
    LongHex,
    /// A number outside a command's range.
    #[error("{text}: {name} takes {range}")]
    Range {
        /// The command.
        name: &'static str,
        /// The number as written.
        text: String,
        /// The range.
        range: Range,
    },
    /// A number beyond the largest exponent.
    #[error("{text}: {cause}")]
    TooLarge {
        /// The number as written.
        text: String,
        /// The limit.
        cause: TooLarge,
    },
    /// `:` or `^` anywhere but after an axis and its constant.
    #[error("{0} stands only after an axis and its constant, once")]
    Mark(&'static str),
    /// NORMAL without a vector.
    #[error("NORMAL needs one or more of I, J, K on the same line")]
    NeedsVector,
    /// PSET without an axis.
    #[error("PSET needs one or more axes on the same line")]
    NeedsAxis,
    /// HOME without motors.
    #[error("{0} needs motor numbers; without them it is an on-line command")]
    NeedsMotors(&'static str),
    /// HOME of a motor for which its code has no bit.
    #[error(
        "{text}: {name} takes whole numbers from 1 to {most}; its binary command has no bit for another motor"
    )]
    NoHomeBit {
        /// The command.
        name: &'static str,
        /// The number as written.
        text: String,
        /// The last motor that has one.
        most: u16,
    },
    /// ENABLE without PLC.
    #[error("{0} must be followed by PLC and the numbers of PLC programs")]
    NeedsPlc(&'static str),
    /// `n..m` with n above m.
    #[error("{first}..{last}: a range begins with the smaller number")]
    Backwards {
        /// The number before the points.
        first: u16,
        /// The number after them.
        last: u16,
    },
    /// A list of axes with other words in it.
    #[error("the list of {0} is axis letters separated by commas, in parentheses{1}")]
    AxisList(&'static str, &'static str),
    /// A number without a command.
    #[error("{0}: a number without a command before it")]
    LoneNumber(String),
    /// A sign or operator in place of a command.
    #[error("{0} does not begin a program command")]
    Unexpected(String),
    /// A byte that occurs in no command.
    #[error("the character {0} is in no command")]
    Character(String),
    /// A line too long for a buffer of this size.
    #[error("{commands} commands in a line: a buffer of {words} words takes {most}; split the line")]
    LongLine {
        /// Its number of commands.
        commands: usize,
        /// The buffer's size in 32-bit words.
        words: u32,
        /// How many fit.
        most: usize,
    },
}

/// How the sent program differs from the text, or may differ from the author's intent.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Warning {
    /// A 24-bit mantissa drops written digits.
    #[error("{text} loses precision: {name} has a 24-bit mantissa, {sent} is sent")]
    Precision {
        /// The command.
        name: &'static str,
        /// The number as written.
        text: String,
        /// The number that the board gets.
        sent: f64,
    },
    /// A number nearer to zero than the smallest.
    #[error("{text} is nearer to zero than any number of the format: 0 is sent")]
    Vanished {
        /// The number as written.
        text: String,
    },
    /// `1E3`.
    #[error("E is a letter of its own here, not an exponent; put a blank before it if that is meant")]
    NoExponent,
}
