//! THE table: every command of the binary rotary format, with its names, codes and ranges.
//!
//! DPRAM manual pp. 31-35: types 0 (letters and data), 1 (modes, lists) and 2 (variable assignments). Names and ranges
//! are those of motion program text. The manual's tables spell some names differently (NORM, CIRn, TSELn); the
//! compiler reads both spellings. A command's shape says which fields of its two words it uses; [`super::item`] packs
//! and unpacks them.

use std::fmt;

/// The role of a letter, as far as other commands depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A, B, C, U, V, W, X, Y, Z.
    Axis,
    /// I, J, K: circle and normal vectors.
    Vector,
    /// Any other, CALL included.
    Other,
}

/// The fields that a command uses. The numbers are CODE1 and CODE2 of the manual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Type 0 A: CODE1 is the letter's place in the alphabet, or 27 for CALL; a 36-bit number.
    Letter {
        /// 1 to 13 and 16 to 27.
        code1: u8,
        /// The letter's role.
        role: Role,
    },
    /// Type 0 B, CODE1 28: CODE2 in word 1 bits 23-16, a 24-bit number in word 2.
    Data {
        /// 0 to 2 and 67 to 72.
        code2: u8,
    },
    /// As [`Shape::Data`], but it stands behind an axis and its position, as `:` or `^`.
    Mark {
        /// 70 or 71.
        code2: u8,
    },
    /// Type 2: the variable's number in word 1 bits 23-14, CODE2 in bits 13-12, a 24-bit number in word 2.
    Assignment {
        /// 14, or 15 for the assignments that wait for the next move.
        code1: u8,
        /// 0 to 3.
        code2: u8,
        /// I, M, P or Q.
        variable: u8,
        /// The operator between the variable and its value.
        operator: Operator,
    },
    /// Type 1 E, CODE1 30: a whole number in word 2, in which 1024 stands for 0.
    Count {
        /// 0, 4 and 10 to 15.
        code2: u8,
    },
    /// Type 1 F, CODE1 30: no data.
    Bare {
        /// 1 to 9 and 16.
        code2: u8,
    },
    /// Type 1 B and C, CODE1 30, sub-code 2: CODE2 in word 1 bits 13-12, an axis mask in word 2.
    Axes {
        /// 0 to 2.
        code2: u8,
        /// Whether the list may contain R, the circle vectors.
        vectors: bool,
    },
    /// Type 1 D, CODE1 30: motor n is bit n-1 of word 2. The settings say how many motors it can name.
    Motors {
        /// 3 or 6, in the place of the exponent.
        subcode: u8,
    },
    /// Type 1 A, CODE1 30, sub-code 1: PLC 0-7 in word 1 bits 16-23, PLC 8-31 in word 2.
    Plcs {
        /// 0 or 1, in word 1 bit 12.
        code2: u8,
    },
}

/// How to assign a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operator {
    /// `=`, when the line is calculated.
    Assign,
    /// `==`, at the start of the next move.
    AssignLater,
    /// `|=`, at the start of the next move.
    Or,
    /// `^=`, at the start of the next move. The manual contradicts itself on its code.
    Xor,
    /// `&=`, at the start of the next move. The manual contradicts itself on its code.
    And,
}

impl Operator {
    /// The operator in program text.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Assign => "=",
            Self::AssignLater => "==",
            Self::Or => "|=",
            Self::Xor => "^=",
            Self::And => "&=",
        }
    }
}

/// The numbers that a command takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// Any number that mantissa and exponent can hold.
    Any,
    /// More than 0.
    Positive,
    /// From the first to the second, both included.
    Between(f64, f64),
    /// From 0 to below this.
    Below(f64),
    /// Whole numbers from the first to the second, both included.
    Whole(u16, u16),
}

impl Range {
    /// Whether `value` is in this range.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        match self {
            Self::Any => true,
            Self::Positive => value > 0.0,
            Self::Between(least, most) => (least..=most).contains(&value),
            Self::Below(limit) => (0.0..limit).contains(&value),
            Self::Whole(least, most) => {
                value.fract() == 0.0 && (f64::from(least)..=f64::from(most)).contains(&value)
            }
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => f.write_str("any number"),
            Self::Positive => f.write_str("numbers above 0"),
            Self::Between(least, most) => write!(f, "{least} to {most}"),
            Self::Below(limit) => write!(f, "0 to below {limit}"),
            Self::Whole(least, most) => write!(f, "whole numbers from {least} to {most}"),
        }
    }
}

/// One command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Code {
    /// Its full name in program text.
    pub name: &'static str,
    /// Its short name, which [`super::decompile()`] writes.
    pub short: &'static str,
    /// A third spelling that the compiler reads.
    pub also: Option<&'static str>,
    /// The fields it uses.
    pub shape: Shape,
    /// The numbers it takes.
    pub range: Range,
}

impl Code {
    const fn new(name: &'static str, short: &'static str, shape: Shape, range: Range) -> Self {
        Self { name, short, also: None, shape, range }
    }

    const fn also(self, also: &'static str) -> Self {
        Self { also: Some(also), ..self }
    }

    /// Its spellings in program text. Assignments and marks have none of their own.
    pub fn spellings(&self) -> impl Iterator<Item = &'static str> + use<> {
        let own = !matches!(self.shape, Shape::Assignment { .. } | Shape::Mark { .. });
        let short = (self.short != self.name).then_some(self.short);
        [Some(self.name), short, self.also].into_iter().flatten().filter(move |_| own)
    }

    /// Whether the command moves or stops motors, or calls a program that may: ABS, INC or FRAX before it and behind
    /// it differ.
    #[must_use]
    pub fn moves(&self) -> bool {
        match self.shape {
            Shape::Letter { .. } => self.name != "F",
            Shape::Motors { .. } => true,
            _ => self.name == "STOP",
        }
    }

    /// Its letter's role; [`Role::Other`] if it is no letter.
    #[must_use]
    pub const fn role(&self) -> Role {
        match self.shape {
            Shape::Letter { role, .. } => role,
            _ => Role::Other,
        }
    }
}

/// CODE1 of CALL.
pub const CALL: u8 = 27;
/// CODE1 of [`Shape::Data`] and [`Shape::Mark`].
pub const DATA: u8 = 28;
/// CODE1 of type 1.
pub const MODES: u8 = 30;
/// CODE1 of the assignments to M-variables that wait for the next move.
pub const LATER: u8 = 15;
/// CODE1 of the assignments that happen when the line is calculated.
pub const ASSIGN: u8 = 14;

/// The axes in the order of their bits in an axis mask, lowest first.
pub const AXES: [u8; 9] = *b"ABCUVWXYZ";

const fn letter(name: &'static str, role: Role, range: Range) -> Code {
    let code1 = name.as_bytes()[0] - b'A' + 1;
    Code::new(name, name, Shape::Letter { code1, role }, range)
}

const fn axis(name: &'static str) -> Code {
    letter(name, Role::Axis, Range::Any)
}

const fn vector(name: &'static str) -> Code {
    letter(name, Role::Vector, Range::Any)
}

const fn data(name: &'static str, short: &'static str, code2: u8, range: Range) -> Code {
    Code::new(name, short, Shape::Data { code2 }, range)
}

const fn mark(name: &'static str, code2: u8) -> Code {
    Code::new(name, name, Shape::Mark { code2 }, Range::Any)
}

const fn assignment(name: &'static str, code1: u8, code2: u8, operator: Operator) -> Code {
    let variable = name.as_bytes()[0];
    Code::new(name, name, Shape::Assignment { code1, code2, variable, operator }, Range::Any)
}

const fn count(name: &'static str, short: &'static str, code2: u8, least: u16, most: u16) -> Code {
    Code::new(name, short, Shape::Count { code2 }, Range::Whole(least, most))
}

const fn bare(name: &'static str, short: &'static str, code2: u8) -> Code {
    Code::new(name, short, Shape::Bare { code2 }, Range::Any)
}

const fn axes(name: &'static str, code2: u8, vectors: bool) -> Code {
    Code::new(name, name, Shape::Axes { code2, vectors }, Range::Any)
}

const fn motors(name: &'static str, short: &'static str, subcode: u8) -> Code {
    Code::new(name, short, Shape::Motors { subcode }, Range::Whole(1, 24))
}

const fn plcs(name: &'static str, short: &'static str, code2: u8) -> Code {
    Code::new(name, short, Shape::Plcs { code2 }, Range::Whole(0, 31))
}

/// Times in milliseconds.
const TIME: Range = Range::Between(0.0, 8_388_607.0);
/// Subroutine numbers of G, M, T and D: program 10n0 and a five-digit label.
const ROUTINE: Range = Range::Below(1000.0);

/// Every command that has a code and that PMAC executes.
pub static CODES: &[Code] = &[
    axis("A"),
    axis("B"),
    axis("C"),
    letter("D", Role::Other, ROUTINE),
    letter("E", Role::Other, Range::Any),
    letter("F", Role::Other, Range::Positive),
    letter("G", Role::Other, ROUTINE),
    letter("H", Role::Other, Range::Any),
    vector("I"),
    vector("J"),
    vector("K"),
    letter("L", Role::Other, Range::Any),
    letter("M", Role::Other, ROUTINE),
    // 14 and 15 would be N and O; they are the codes of assignments below.
    letter("P", Role::Other, Range::Any),
    letter("Q", Role::Other, Range::Any),
    letter("R", Role::Other, Range::Any),
    letter("S", Role::Other, Range::Any),
    letter("T", Role::Other, ROUTINE),
    axis("U"),
    axis("V"),
    axis("W"),
    axis("X"),
    axis("Y"),
    axis("Z"),
    Code::new("CALL", "CALL", Shape::Letter { code1: CALL, role: Role::Other }, Range::Below(32_768.0)),
    data("TA", "TA", 0, TIME),
    data("TS", "TS", 1, TIME),
    data("PVT", "PVT", 2, Range::Positive),
    data("TM", "TM", 67, TIME),
    data("DWELL", "DWE", 68, TIME),
    data("DELAY", "DLY", 69, TIME),
    mark(":", 70),
    mark("^", 71),
    data("CCR", "CCR", 72, Range::Any),
    plcs("ENABLE", "ENA", 0),
    plcs("DISABLE", "DIS", 1),
    axes("ABS", 0, true),
    axes("INC", 1, true),
    axes("FRAX", 2, false),
    motors("HOME", "HM", 3),
    motors("HOMEZ", "HMZ", 6),
    count("CIRCLE", "CIR", 0, 1, 2),
    count("SPLINE", "SPLINE", 4, 1, 2),
    count("CC", "CC", 10, 0, 2),
    count("TSELECT", "TSEL", 11, 0, 1023),
    count("ADIS", "ADIS", 12, 0, 1023),
    count("AROT", "AROT", 13, 0, 1023),
    count("IDIS", "IDIS", 14, 0, 1023),
    count("IROT", "IROT", 15, 0, 1023),
    bare("LINEAR", "LIN", 1),
    bare("NORMAL", "NRM", 2).also("NORM"),
    bare("PSET", "PSET", 3),
    bare("STOP", "STOP", 5),
    bare("BLOCKSTART", "BSTART", 6),
    bare("BLOCKSTOP", "BSTOP", 7),
    // 8 is WAIT, which PMAC does not implement.
    bare("RAPID", "RPD", 9),
    bare("TINIT", "TINIT", 16),
    assignment("I=", ASSIGN, 0, Operator::Assign),
    assignment("M=", ASSIGN, 1, Operator::Assign),
    assignment("P=", ASSIGN, 2, Operator::Assign),
    assignment("Q=", ASSIGN, 3, Operator::Assign),
    assignment("M|=", LATER, 0, Operator::Or),
    // 1 and 2 are `^=` and `&=`: the manual contradicts itself on which is which (pp. 31 and 35).
    assignment("M==", LATER, 3, Operator::AssignLater),
];

/// The assignment of `variable` (I, M, P or Q) by `operator`, if the format has one.
#[must_use]
pub fn find_assignment(letter: u8, wanted: Operator) -> Option<&'static Code> {
    CODES.iter().find(|code| {
        matches!(code.shape, Shape::Assignment { variable, operator, .. }
            if variable == letter.to_ascii_uppercase() && operator == wanted)
    })
}

/// The command named exactly `name`, in its full form and in capitals.
#[must_use]
pub fn find(name: &str) -> Option<&'static Code> {
    CODES.iter().find(|code| code.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_of_the_manual_is_there_once() {
        let mut letters: Vec<u8> = Vec::new();
        let mut data = Vec::new();
        let (mut modes, mut assignments) = (Vec::new(), Vec::new());
        for code in CODES {
            match code.shape {
                Shape::Letter { code1, .. } => letters.push(code1),
                Shape::Data { code2 } | Shape::Mark { code2 } => data.push(code2),
                Shape::Count { code2 } | Shape::Bare { code2 } => modes.push(code2),
                Shape::Assignment { code1, code2, .. } => assignments.push((code1, code2)),
                Shape::Axes { .. } | Shape::Motors { .. } | Shape::Plcs { .. } => {}
            }
        }
        for list in [&mut letters, &mut data, &mut modes] {
            list.sort_unstable();
        }
        assignments.sort_unstable();
        assert_eq!(letters, (1..=13).chain(16..=27).collect::<Vec<u8>>());
        assert_eq!(data, [0, 1, 2, 67, 68, 69, 70, 71, 72]);
        assert_eq!(modes, [0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 16]);
        assert_eq!(assignments, [(14, 0), (14, 1), (14, 2), (14, 3), (15, 0), (15, 3)]);
    }

    #[test]
    fn spellings_are_unique() {
        let mut names: Vec<&str> = CODES.iter().flat_map(Code::spellings).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        assert!(names.iter().all(|name| name.bytes().all(|b| b.is_ascii_uppercase())));
    }

    #[test]
    fn assignments_are_found_by_letter_and_operator() {
        assert_eq!(find_assignment(b'm', Operator::Or).map(|code| code.name), Some("M|="));
        assert_eq!(find_assignment(b'M', Operator::Xor), None);
        assert_eq!(find_assignment(b'P', Operator::Or), None);
        assert_eq!(find_assignment(b'X', Operator::Assign), None);
    }
}
