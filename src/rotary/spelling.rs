//! Compares program lines regardless of spelling: a board lists a program in its own words and numbers.

use std::collections::BTreeSet;

use super::codes::{AXES, Shape};
use super::scan::{Kind, Token, scan};
use crate::map::number::same_when_listed;

/// The longest range of motors or PLCs that this module writes out.
const LONGEST_RANGE: u64 = 64;

/// A part of a line, independent of its spelling.
#[derive(Debug)]
enum Part {
    /// A word, by its full name, or an operator.
    Word(&'static str),
    Number(f64),
    /// Text in quotes, and text outside of the language, unchanged.
    Text(String),
    Symbol(u8),
}

impl Part {
    fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Word(one), Self::Word(other)) => one == other,
            (Self::Number(one), Self::Number(other)) => same_when_listed(*one, *other),
            (Self::Text(one), Self::Text(other)) => one == other,
            (Self::Symbol(one), Self::Symbol(other)) => one == other,
            _ => false,
        }
    }
}

/// Whether two lines of a motion, PLC or kinematic program mean the same. Blanks, case, short and long words, and the
/// spelling of numbers and of lists of motors, PLCs and axes do not count.
#[must_use]
pub fn same_line(one: &str, other: &str) -> bool {
    let (one, other) = (parts(one), parts(other));
    one.len() == other.len() && one.iter().zip(&other).all(|(one, other)| one.is(other))
}

fn parts(line: &str) -> Vec<Part> {
    let tokens = scan(line.as_bytes());
    let mut rest = tokens.as_slice();
    let mut parts: Vec<Part> = Vec::new();
    while let [token, behind @ ..] = rest {
        rest = behind;
        match token.kind {
            Kind::Command(code) => {
                parts.push(Part::Word(code.name));
                match code.shape {
                    Shape::Motors { .. } => rest = numbers(rest, &mut parts),
                    Shape::Axes { .. } => rest = axes(rest, &mut parts),
                    _ => {}
                }
            }
            Kind::Plc => {
                parts.push(Part::Word("PLC"));
                rest = numbers(rest, &mut parts);
            }
            Kind::Refused(word) => match word.means {
                Some(words) => parts.extend(self::parts(words)),
                None => {
                    parts.push(Part::Word(word.name));
                    if word.takes_list {
                        rest = numbers(rest, &mut parts);
                    }
                }
            },
            Kind::Number(number, _) => parts.push(Part::Number(number.value())),
            Kind::Assign(operator) => parts.push(Part::Word(operator.text())),
            Kind::Range => parts.push(Part::Word("..")),
            Kind::Arrow => parts.push(Part::Word("->")),
            Kind::Symbol(sign @ (b'+' | b'-')) if !ends_operand(&parts) => match behind {
                [Token { kind: Kind::Number(number, _), .. }, behind @ ..] => {
                    let value = if sign == b'-' { -number.value() } else { number.value() };
                    parts.push(Part::Number(value));
                    rest = behind;
                }
                _ => parts.push(Part::Symbol(sign)),
            },
            Kind::Symbol(symbol) => parts.push(Part::Symbol(symbol)),
            Kind::Quoted | Kind::LongHex | Kind::Foreign(_) => {
                parts.push(Part::Text(line.get(token.start..token.end).unwrap_or_default().to_owned()));
            }
        }
    }
    parts
}

/// Whether a sign that follows stands between two numbers.
fn ends_operand(parts: &[Part]) -> bool {
    matches!(parts.last(), Some(Part::Number(_) | Part::Symbol(b')')))
}

/// Takes a list like `1,3..5`, in any order, and adds its numbers one by one.
fn numbers<'t>(mut rest: &'t [Token], parts: &mut Vec<Part>) -> &'t [Token] {
    let mut all = BTreeSet::new();
    let mut behind = rest;
    while let [Token { kind: Kind::Number(first, _), .. }, more @ ..] = behind {
        let Some(first) = first.integer() else { break };
        let (last, more) = match more {
            [Token { kind: Kind::Range, .. }, Token { kind: Kind::Number(last, _), .. }, more @ ..] => {
                (last.integer().unwrap_or(first), more)
            }
            _ => (first, more),
        };
        all.extend(first..=last.min(first.saturating_add(LONGEST_RANGE)));
        rest = more;
        match more {
            [Token { kind: Kind::Symbol(b','), .. }, more @ ..] => behind = more,
            _ => break,
        }
    }
    parts.extend(all.into_iter().map(|number| Part::Number(number as f64)));
    rest
}

/// Takes a list like `(X,Y)`, in any order. A list of all axes means the same as no list.
fn axes<'t>(rest: &'t [Token], parts: &mut Vec<Part>) -> &'t [Token] {
    let [Token { kind: Kind::Symbol(b'('), .. }, inside @ ..] = rest else { return rest };
    let Some(end) = inside.iter().position(|token| token.kind == Kind::Symbol(b')')) else { return rest };
    let names: BTreeSet<&str> = inside
        .iter()
        .take(end)
        .filter_map(|token| match token.kind {
            Kind::Command(code) => Some(code.name),
            _ => None,
        })
        .collect();
    let is_all = names.len() == AXES.len() && !names.contains("R");
    parts.extend(names.into_iter().filter(|_| !is_all).map(Part::Word));
    inside.get(end + 1..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_listing_is_the_same_program_however_it_is_spelled() {
        for (typed, listed) in [
            ("linear abs tm 100 ta20", "LIN ABS TM100 TA20"),
            ("RAPID X10.0 Y+.5 Z-0", "RPD X10 Y0.5 Z0"),
            ("Circle 1 X 10 I$A", "CIR1 X10 I10"),
            ("P1 = $0F + 2", "P1=15+2"),
            ("P1=-5 P2=+5 P3=P1--5 P4=(-5)", "P1=-5P2=5P3=P1 - -5P4=(-5)"),
            ("if ( P1 = 1 and P2 !> 2 )", "IF(P1=1 AND P2!>2)"),
            ("END IF", "ENDI"),
            ("ENDIF", "ENDI"),
            ("while (i5413>0) end while", "WHILE(I5413>0) ENDW"),
            ("ENDWHILE", "ENDW"),
            ("RETURN", "RET"),
            ("GOSUB 100", "GOS100"),
            ("COMMAND\"#1J/\"", "CMD\"#1J/\""),
            ("DISPLAY 3,\"Hi;\"", "DISP3,\"Hi;\""),
            ("ADDRESS#1&2", "ADR#1&2"),
            ("DWELL 250.00", "DWE250"),
            ("DELAY10", "DLY10"),
            ("HOME 1,2,3", "HM1..3"),
            ("HOMEZ3,1..2", "HMZ1..3"),
            ("ENABLE PLC 1 , 2, 3,7", "ENAPLC1..3,7"),
            ("DISABLE PLCC 5", "DIS PLCC5"),
            ("INC(Y,X)", "INC(X,Y)"),
            ("FRAX(A,B,C,U,V,W,X,Y,Z)", "FRAX"),
            ("NORMAL K-1", "NRM K-1"),
            ("BLOCKSTART", "BSTART"),
            ("TSELECT 2", "TSEL2"),
            ("G01 X1.23456789012", "G1 X1.23456789"),
            ("X(P1*2)Y(P2)", "X(P1*2) Y(P2)"),
        ] {
            assert!(same_line(typed, listed), "{typed}: {:?}\n{listed}: {:?}", parts(typed), parts(listed));
        }
    }

    #[test]
    fn other_programs_are_others() {
        for (one, other) in [
            ("X10", "X11"),
            ("X10", "Y10"),
            ("X10 Y5", "X10"),
            ("P1=1-5", "P1=-5"),
            ("SEND\"a b\"", "SEND\"ab\""),
            ("SEND\"a\"", "SEND\"A\""),
            ("CIR1", "CIR2"),
            ("HM1,2", "HM1,3"),
            ("HM1", "HMZ1"),
            ("ABS(X,Y)", "ABS"),
            ("ABS(X)", "INC(X)"),
            ("IF(P1=1)", "IF(P1>1)"),
            ("ENA PLC1", "DIS PLC1"),
            ("ENA PLC1", "ENA PLCC1"),
            ("M1=1", "M1==1"),
            ("X0.1", "X0.100001"),
            ("", "X1"),
        ] {
            assert!(!same_line(one, other), "{one} {other}");
        }
    }

    proptest::proptest! {
        #[test]
        fn a_line_is_itself(line in "\\PC{0,30}") {
            proptest::prop_assert!(same_line(&line, &line));
        }
    }
}
