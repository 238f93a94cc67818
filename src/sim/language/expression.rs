//! Expressions: constants, variables, functions, and operators in two levels (Software Reference p. 360-367).
//!
//! `*`, `/`, `%` and `&` bind tighter than `+`, `-`, `|` and `^`; within a level evaluation goes from left to right.
//! Only bad syntax is an error: division by zero saturates, and a function outside its domain gives 0.

use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::firmware::NumberRule;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::scanner::Scanner;

/// The result of a division by zero: 2^47.
const SATURATED: f64 = (1u64 << 47) as f64;

/// Fraction bits of the bitwise operators; more than a 48-bit float of any usual size has.
const FRACTION_BITS: i32 = 60;

/// A function of an argument, with the angles' unit in radians and Q0.
type Function = fn(f64, f64, f64) -> f64;

const FUNCTIONS: &[(&str, Function)] = &[
    ("SIN", |x, unit, _| (x * unit).sin()),
    ("COS", |x, unit, _| (x * unit).cos()),
    ("TAN", |x, unit, _| (x * unit).tan()),
    ("ASIN", |x, unit, _| x.asin() / unit),
    ("ACOS", |x, unit, _| x.acos() / unit),
    ("ATAN", |x, unit, _| x.atan() / unit),
    ("ATAN2", |x, unit, q0| x.atan2(q0) / unit),
    ("LN", |x, _, _| x.ln()),
    ("EXP", |x, _, _| x.exp()),
    ("SQRT", |x, _, _| x.sqrt()),
    ("ABS", |x, _, _| x.abs()),
    ("INT", |x, _, _| x.floor()),
];

/// Evaluates the expression at the scanner, with the Q-variables of the 0-based coordinate system `cs`.
///
/// # Errors
/// ERR003 for anything that is not an expression.
pub fn evaluate(scanner: &mut Scanner, board: &Board, cs: usize) -> Result<f64, CommandError> {
    Evaluator { board, cs, strict: true }.sum(scanner)
}

/// Parses the expression at the scanner without evaluating it, for a program line that is being entered. A computed
/// variable number need not be valid yet.
///
/// # Errors
/// ERR003 for anything that is not an expression.
pub fn check(scanner: &mut Scanner, board: &Board) -> Result<(), CommandError> {
    Evaluator { board, cs: 0, strict: false }.sum(scanner).map(|_| ())
}

/// Parses the condition at the scanner in the same way.
///
/// # Errors
/// ERR003 for anything that is not a condition.
pub fn check_condition(scanner: &mut Scanner, board: &Board) -> Result<(), CommandError> {
    Evaluator { board, cs: 0, strict: false }.condition(scanner).map(|_| ())
}

/// Whether the condition of an `IF` or `WHILE` is true: comparisons joined by `AND` and, with lower precedence, `OR`.
///
/// # Errors
/// ERR003 for anything that is not a condition.
pub fn condition(scanner: &mut Scanner, board: &Board, cs: usize) -> Result<bool, CommandError> {
    Evaluator { board, cs, strict: true }.condition(scanner)
}

/// Checks a variable number given as a constant.
///
/// # Errors
/// ERR003 for a number that no variable has.
pub fn check_number(number: f64, board: &Board) -> Result<usize, CommandError> {
    let number = number.round_ties_even();
    let tables = board.variables.tables();
    let count = tables.variables as f64;
    if (0.0..count).contains(&number) {
        return Ok(number as usize);
    }
    match tables.numbers {
        NumberRule::Wrapped => Ok(number.rem_euclid(count) as usize),
        NumberRule::Refused => Err(CommandError::SYNTAX),
    }
}

/// The number of a variable after its letter: digits, or an expression in parentheses.
///
/// # Errors
/// ERR003 without a number, or for a number that is not from 0 to `count` - 1.
pub fn variable_number(scanner: &mut Scanner, board: &Board, cs: usize) -> Result<usize, CommandError> {
    Evaluator { board, cs, strict: true }.number(scanner)
}

/// Whether a comparison holds between its left and its right value.
type Comparison = fn(f64, f64) -> bool;

const COMPARATORS: &[(&str, Comparison)] = &[
    ("=", |left, right| left == right),
    ("!=", |left, right| left != right),
    (">", |left, right| left > right),
    ("!>", |left, right| left <= right),
    ("<", |left, right| left < right),
    ("!<", |left, right| left >= right),
    // The values differ by less than one.
    ("~", |left, right| (left - right).abs() < 1.0),
    ("!~", |left, right| (left - right).abs() >= 1.0),
];

struct Evaluator<'a> {
    board: &'a Board,
    cs: usize,
    /// Whether a computed variable number must be in range; otherwise it counts as 0.
    strict: bool,
}

impl Evaluator<'_> {
    fn condition(&self, scanner: &mut Scanner) -> Result<bool, CommandError> {
        let mut any = false;
        loop {
            let mut all = self.comparison(scanner)?;
            while scanner.take_text(b"AND") {
                all &= self.comparison(scanner)?;
            }
            any |= all;
            if !scanner.take_text(b"OR") {
                return Ok(any);
            }
        }
    }

    fn comparison(&self, scanner: &mut Scanner) -> Result<bool, CommandError> {
        let mut ahead = scanner.clone();
        if let Ok(left) = self.sum(&mut ahead)
            && let Some(holds) = ahead.keyword(&[COMPARATORS])
        {
            *scanner = ahead;
            return Ok(holds(left, self.sum(scanner)?));
        }
        scanner.expect(b'(')?;
        let holds = self.condition(scanner)?;
        scanner.expect(b')')?;
        Ok(holds)
    }

    fn number(&self, scanner: &mut Scanner) -> Result<usize, CommandError> {
        if !scanner.take(b'(') {
            return check_number(scanner.integer()? as f64, self.board);
        }
        let number = self.sum(scanner)?;
        scanner.expect(b')')?;
        match check_number(number, self.board) {
            Err(_) if !self.strict => Ok(0),
            result => result,
        }
    }

    fn sum(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        let mut left = self.product(scanner)?;
        loop {
            left = match scanner.peek() {
                Some(b'+') => left + self.operand(scanner)?,
                Some(b'-') => left - self.operand(scanner)?,
                Some(b'|') => bitwise(left, self.operand(scanner)?, |a, b| a | b),
                Some(b'^') => bitwise(left, self.operand(scanner)?, |a, b| a ^ b),
                _ => return Ok(left),
            };
        }
    }

    fn operand(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        scanner.next_character();
        self.product(scanner)
    }

    fn product(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        let mut left = self.factor(scanner)?;
        loop {
            left = match scanner.peek() {
                Some(b'*') => left * self.next_factor(scanner)?,
                Some(b'/') => divide(left, self.next_factor(scanner)?),
                Some(b'%') => modulo(left, self.next_factor(scanner)?),
                Some(b'&') => bitwise(left, self.next_factor(scanner)?, |a, b| a & b),
                _ => return Ok(left),
            };
        }
    }

    fn next_factor(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        scanner.next_character();
        self.factor(scanner)
    }

    fn factor(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        if scanner.take(b'-') {
            return Ok(-self.factor(scanner)?);
        }
        if scanner.take(b'(') {
            return self.closed(scanner);
        }
        if scanner.at_unsigned() {
            return scanner.unsigned();
        }
        if let Some(function) = scanner.keyword(&[FUNCTIONS]) {
            scanner.expect(b'(')?;
            let argument = self.closed(scanner)?;
            return Ok(self.apply(function, argument));
        }
        let kind = scanner.peek().and_then(VariableKind::from_letter).ok_or(CommandError::SYNTAX)?;
        scanner.next_character();
        let number = self.number(scanner)?;
        Ok(self.board.value(kind, self.cs, number))
    }

    fn closed(&self, scanner: &mut Scanner) -> Result<f64, CommandError> {
        let value = self.sum(scanner)?;
        scanner.expect(b')')?;
        Ok(value)
    }

    fn apply(&self, function: Function, x: f64) -> f64 {
        // I15=0 means degrees.
        let unit = if self.board.variables.i(15) == 0.0 { std::f64::consts::PI / 180.0 } else { 1.0 };
        let result = function(x, unit, self.board.value(VariableKind::Q, self.cs, 0));
        if result.is_nan() { 0.0 } else { result }
    }
}

fn divide(a: f64, b: f64) -> f64 {
    if b == 0.0 { SATURATED.copysign(a) } else { a / b }
}

/// The remainder: in 0..b for a positive divisor, in -|b|..|b| for a negative divisor, 0 for a divisor of zero.
fn modulo(a: f64, b: f64) -> f64 {
    let result = if b > 0.0 {
        a.rem_euclid(b)
    } else if b < 0.0 {
        (a - b).rem_euclid(-2.0 * b) + b
    } else {
        0.0
    };
    if result.is_nan() { 0.0 } else { result }
}

/// A bitwise operation on the two's complement of both numbers, fraction bits included.
fn bitwise(a: f64, b: f64, operation: impl Fn(i128, i128) -> i128) -> f64 {
    let scale = 2f64.powi(FRACTION_BITS);
    operation((a * scale) as i128, (b * scale) as i128) as f64 / scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::testing;

    fn evaluated(text: &str) -> Result<f64, CommandError> {
        let mut board = testing::board();
        let Board { memory, variables, .. } = &mut board;
        variables.set_p(memory, 1, 2.0);
        variables.set_q(memory, 0, 0, -1.0);
        let mut scanner = Scanner::new(text.as_bytes());
        let result = evaluate(&mut scanner, &board, 0);
        if scanner.peek().is_some() { Err(CommandError::SYNTAX) } else { result }
    }

    #[test]
    fn examples_of_the_reference() {
        for (text, result) in [
            ("11%4", 3.0),
            ("-11%4", 1.0),
            ("11%-4", 3.0),
            ("-11%-4", -3.0),
            ("3%2.5", 0.5),
            ("-3%2.5", 2.0),
            ("3%-2.5", -2.0),
            ("-3%-2.5", 2.0),
            ("3&1", 1.0),
            ("3&4", 0.0),
            ("3&-3", 1.0),
            ("0.875&1.75", 0.75),
            ("0.875&-1.75", 0.25),
            ("4|3", 7.0),
            ("$F0|$4", 244.0),
            ("3|-3", -1.0),
            ("0.5|0.375", 0.875),
            // The page prints -0.375, against its own 0.25 for `&`: a|b = a + b - (a&b).
            ("0.875|-1.75", -1.125),
            ("2^1", 3.0),
            ("$AA^$55", 255.0),
            ("3^-3", -2.0),
            ("0.5^0.875", 0.375),
            ("5/0", SATURATED),
            ("-5/0", -SATURATED),
            ("5%0", 0.0),
        ] {
            assert_eq!(evaluated(text), Ok(result), "{text}");
        }
    }

    #[test]
    fn precedence_and_order() {
        for (text, result) in [
            ("1+2*3", 7.0),
            ("(1+2)*3", 9.0),
            ("10-4-3", 3.0),
            ("100/10/5", 2.0),
            ("1|2&0", 1.0),
            ("8-1|1", 7.0),
            ("--3", 3.0),
            ("-(2+3)*2", -10.0),
            ("2*-3", -6.0),
            ("P1*3", 6.0),
            ("P(P1-1)", 2.0),
            ("INT(-3.2)", -4.0),
            ("ABS(-P1)", 2.0),
            ("SQRT(16)", 4.0),
            ("SQRT(-1)", 0.0),
            ("ATAN2(0)", 180.0),
            (" 1 + 2 ", 3.0),
        ] {
            assert_eq!(evaluated(text), Ok(result), "{text}");
        }
        assert!((evaluated("SIN(30)").unwrap() - 0.5).abs() < 1e-12);
        assert!((evaluated("ACOS(0)").unwrap() - 90.0).abs() < 1e-12);
        assert!((evaluated("LN(EXP(2))").unwrap() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_an_expression() {
        for text in
            ["", "+P1", "1+", "(1", "SIN 30", "SIN(", "P", "P1024", "P(-1)", "P(1024)", "X", "1)", "*"]
        {
            assert_eq!(evaluated(text), Err(CommandError::SYNTAX), "{text}");
        }
    }

    #[test]
    fn depth_is_bounded_by_the_line() {
        let deep = format!("{}1{}", "(".repeat(127), ")".repeat(127));
        assert_eq!(evaluated(&deep), Ok(1.0));
    }
}
