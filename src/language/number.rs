//! The numbers of variables, and expressions; this module computes an expression if it has only constants.

use super::reader::Reader;

/// How many I-variables a Turbo board has; the board takes larger numbers from 0 again.
const COUNT: u32 = 8192;
/// How often a range may wrap before every variable counts as set.
const ROUNDS: usize = 64;
/// The deepest nesting of parentheses that this module computes; no line of a site has so many.
const DEEPEST: u32 = 16;

/// The variables that a command names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbers {
    /// One.
    One(u32),
    /// Several: the first, the last, and the step between them.
    Range(u32, u32, u32),
    /// The number is an expression with variables of the board.
    Unknown,
}

impl Numbers {
    /// Whether variable `number` is among them; `false` for an expression, whose number only the board knows.
    #[must_use]
    pub fn has(self, number: u32) -> bool {
        match self {
            Self::One(one) => one == number,
            Self::Range(first, last, step) => {
                let is_in = |number: u32| {
                    first <= number && number <= last && (step == 0 || (number - first).is_multiple_of(step))
                };
                let rounds = first / COUNT..=last / COUNT;
                // A range that wraps so often has every variable.
                let mut again = rounds.map(|round| number.saturating_add(round.saturating_mul(COUNT)));
                first <= last && (again.by_ref().take(ROUNDS).any(is_in) || again.next().is_some())
            }
            Self::Unknown => false,
        }
    }

    /// At most how many variables a range names; 0 otherwise.
    pub(super) fn in_range(self) -> u32 {
        match self {
            Self::Range(first, last, step) => (last.saturating_sub(first) / step.max(1)).saturating_add(1),
            Self::One(_) | Self::Unknown => 0,
        }
    }

    /// Takes the numbers that come next: `58`, `50..60`, `108,8,100` (first, count, step); each may be an expression
    /// in parentheses.
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let first = Number::read(reader)?;
        Some(if reader.takes("..") {
            first.up_to(Number::read(reader)?)
        } else if reader.takes(",") {
            let count = Number::read(reader)?;
            let step = if reader.takes(",") { Number::read(reader)? } else { Number::One(1) };
            first.times(count, step)
        } else {
            first.alone()
        })
    }
}

/// A number as a line gives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    /// This one.
    One(u32),
    /// One of these two: no manual says how a board rounds a fraction.
    Either(u32, u32),
    /// Only the board knows the number.
    Unknown,
}

impl Number {
    /// Takes the number that comes next; `None` if none comes, or if its parentheses do not end.
    fn read(reader: &mut Reader<'_>) -> Option<Self> {
        if let Some(number) = reader.number() {
            return Some(Self::One(number));
        }
        if reader.peek() != Some(b'(') {
            return None;
        }
        let mut inside = reader.clone();
        if !reader.parenthesis_here() {
            return None;
        }
        let value = factor(&mut inside, 0).filter(|_| inside.at == reader.at);
        Some(value.map_or(Self::Unknown, Self::of_value))
    }

    /// A Turbo board takes a number below 0, too, and counts it from the other end.
    fn of_value(value: f64) -> Self {
        if !value.is_finite() {
            return Self::Unknown;
        }
        let whole = |value: f64| if value < 0.0 { value.rem_euclid(f64::from(COUNT)) } else { value } as u32;
        let (low, high) = (whole(value.floor()), whole(value.ceil()));
        if low == high { Self::One(low) } else { Self::Either(low.min(high), low.max(high)) }
    }

    fn alone(self) -> Numbers {
        match self {
            Self::One(one) => Numbers::One(one % COUNT),
            Self::Either(low, high) => Numbers::Range(low, high, 1),
            Self::Unknown => Numbers::Unknown,
        }
    }

    fn up_to(self, last: Self) -> Numbers {
        let bounds = |number| match number {
            Self::One(one) => Some((one, one)),
            Self::Either(low, high) => Some((low, high)),
            Self::Unknown => None,
        };
        match (bounds(self), bounds(last)) {
            (Some((first, _)), Some((_, last))) => Numbers::Range(first, last, 1),
            _ => Numbers::Unknown,
        }
    }

    fn times(self, count: Self, step: Self) -> Numbers {
        match (self, count, step) {
            (Self::One(first), Self::One(count), Self::One(step)) => {
                let last = first.saturating_add(count.saturating_sub(1).saturating_mul(step));
                Numbers::Range(first, last, step)
            }
            _ => Numbers::Unknown,
        }
    }
}

/// Takes a value: an expression, or `*`, a variable's default. NaN if the value depends on variables of the board.
/// `None` if no known value comes next; an operator without a value behind it is a command.
pub(super) fn value(reader: &mut Reader<'_>) -> Option<f64> {
    let start = reader.clone();
    if reader.takes("*") {
        return Some(f64::NAN);
    }
    let value = sum(reader, 0);
    if value.is_none() {
        *reader = start;
    }
    value
}

/// `* / % &` go before `+ - | ^`, each from left to right.
fn sum(reader: &mut Reader<'_>, depth: u32) -> Option<f64> {
    operations(reader, b"+-|^", |reader| operations(reader, b"*/%&", |reader| factor(reader, depth)))
}

fn operations(
    reader: &mut Reader<'_>,
    operators: &[u8],
    operand: impl Fn(&mut Reader<'_>) -> Option<f64>,
) -> Option<f64> {
    let mut left = operand(reader)?;
    loop {
        let before = reader.at;
        let operator = reader.peek().filter(|byte| operators.contains(byte));
        reader.at += 1;
        let Some((operator, right)) = operator.and_then(|operator| Some((operator, operand(reader)?))) else {
            reader.at = before;
            return Some(left);
        };
        // On the whole parts.
        let bitwise = |of: fn(i64, i64) -> i64| match left.is_nan() || right.is_nan() {
            true => f64::NAN,
            false => of(left.floor() as i64, right.floor() as i64) as f64,
        };
        left = match operator {
            b'+' => left + right,
            b'-' => left - right,
            b'*' => left * right,
            b'/' => left / right,
            b'%' => left.rem_euclid(right),
            b'&' => bitwise(|a, b| a & b),
            b'|' => bitwise(|a, b| a | b),
            _ => bitwise(|a, b| a ^ b),
        };
    }
}

fn factor(reader: &mut Reader<'_>, depth: u32) -> Option<f64> {
    if depth > DEEPEST {
        return None;
    }
    match reader.peek()? {
        sign @ (b'-' | b'+') => {
            reader.at += 1;
            factor(reader, depth + 1).map(|value| if sign == b'-' { -value } else { value })
        }
        b'(' => {
            reader.at += 1;
            let value = sum(reader, depth + 1)?;
            reader.takes(")").then_some(value)
        }
        b'$' => {
            reader.at += 1;
            reader.hexadecimal().map(f64::from)
        }
        b'0'..=b'9' | b'.' => decimal(reader),
        byte if byte.is_ascii_alphabetic() => {
            let start = reader.at;
            reader.skip_while(|byte| byte.is_ascii_alphabetic());
            let is = |name: &str| reader.line[start..reader.at].eq_ignore_ascii_case(name.as_bytes());
            let compute: fn(f64) -> f64 = match () {
                () if is("ABS") => f64::abs,
                () if is("INT") => f64::floor,
                () if is("SQRT") => f64::sqrt,
                // A variable with this number, or a function that depends on I15.
                () => |_| f64::NAN,
            };
            // `ATAN2(P1)` has a number and a parenthesis.
            let number = reader.number().map(|_| f64::NAN);
            let argument = if reader.is_next(b"(") { Some(factor(reader, depth + 1)?) } else { None };
            argument.map(|argument| number.unwrap_or_else(|| compute(argument))).or(number)
        }
        _ => None,
    }
}

fn decimal(reader: &mut Reader<'_>) -> Option<f64> {
    let mut value = reader.number().map_or(0.0, f64::from);
    if reader.takes(".") {
        let mut place = 1.0;
        while let Some(digit @ b'0'..=b'9') = reader.byte() {
            reader.at += 1;
            place /= 10.0;
            value += f64::from(digit - b'0') * place;
        }
    }
    Some(value)
}
