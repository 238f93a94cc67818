//! The number of a variable: digits, or an expression in parentheses, which is computed where it has constants alone.

/// How many I-variables a Turbo board has; a number beyond begins again at 0 there.
const COUNT: u32 = 8192;
/// How often a range may begin again before every variable counts as set.
const ROUNDS: usize = 64;

/// The I-variables of an assignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbers {
    /// One.
    One(u32),
    /// Several: the first, the last, and the step between them.
    Range(u32, u32, u32),
    /// The number is an expression that goes by variables of the board.
    Unknown,
}

impl Numbers {
    /// Whether variable `number` is among them. Of an expression nobody can tell: it counts as no.
    #[must_use]
    pub fn has(self, number: u32) -> bool {
        match self {
            Self::One(one) => one == number,
            Self::Range(first, last, step) => {
                let is_in = |number: u32| {
                    first <= number && number <= last && (step == 0 || (number - first).is_multiple_of(step))
                };
                let rounds = first / COUNT..=last / COUNT;
                // One that goes round so often has them all.
                let mut again = rounds.map(|round| number.saturating_add(round.saturating_mul(COUNT)));
                first <= last && (again.by_ref().take(ROUNDS).any(is_in) || again.next().is_some())
            }
            Self::Unknown => false,
        }
    }
}

/// Text without the blanks in it.
pub(super) struct Reader<'a> {
    pub(super) line: &'a [u8],
    pub(super) at: usize,
}

impl Reader<'_> {
    pub(super) fn peek(&mut self) -> Option<u8> {
        while self.line.get(self.at) == Some(&b' ') {
            self.at += 1;
        }
        self.line.get(self.at).copied()
    }

    pub(super) fn takes(&mut self, text: &[u8]) -> bool {
        let start = self.at;
        let all = text.iter().all(|wanted| {
            let is_it = self.peek() == Some(*wanted);
            self.at += usize::from(is_it);
            is_it
        });
        if !all {
            self.at = start;
        }
        all
    }

    pub(super) fn number(&mut self) -> Option<u32> {
        let mut number = None;
        while let Some(digit @ b'0'..=b'9') = self.peek() {
            self.at += 1;
            number = Some(number.unwrap_or(0_u32).saturating_mul(10).saturating_add(u32::from(digit - b'0')));
        }
        number
    }

    pub(super) fn hexadecimal(&mut self) -> Option<u32> {
        let mut number = None;
        // Behind a blank, A to F are commands.
        while let Some(digit) = self.line.get(self.at).and_then(|byte| char::from(*byte).to_digit(16)) {
            self.at += 1;
            number = Some(number.unwrap_or(0_u32).saturating_mul(16).saturating_add(digit));
        }
        number
    }
}

/// A number as a line gives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    /// This one.
    One(u32),
    /// One of these two: no manual says how a board makes a whole number of a fraction.
    Either(u32, u32),
    /// Nobody but the board knows.
    Unknown,
}

/// Parentheses in each other that are computed; no line of a site has so many.
const DEEPEST: u32 = 16;

impl Number {
    /// The variable of that number.
    pub(super) fn alone(self) -> Numbers {
        match self {
            Self::One(one) => Numbers::One(one % COUNT),
            Self::Either(low, high) => Numbers::Range(low, high, 1),
            Self::Unknown => Numbers::Unknown,
        }
    }

    /// The variables from this number to `last`.
    pub(super) fn up_to(self, last: Self) -> Numbers {
        match (self.bounds(), last.bounds()) {
            (Some((first, _)), Some((_, last))) => Numbers::Range(first, last, 1),
            _ => Numbers::Unknown,
        }
    }

    /// `count` variables, `step` apart, from this number on.
    pub(super) fn times(self, count: Self, step: Self) -> Numbers {
        match (self, count, step) {
            (Self::One(first), Self::One(count), Self::One(step)) => {
                let last = first.saturating_add(count.saturating_sub(1).saturating_mul(step));
                Numbers::Range(first, last, step)
            }
            _ => Numbers::Unknown,
        }
    }

    fn bounds(self) -> Option<(u32, u32)> {
        match self {
            Self::One(one) => Some((one, one)),
            Self::Either(low, high) => Some((low, high)),
            Self::Unknown => None,
        }
    }
}

/// The number that comes next. `None` where none does, or where its parentheses do not end.
pub(super) fn read(reader: &mut Reader<'_>) -> Option<Number> {
    if let Some(number) = reader.number() {
        return Some(Number::One(number));
    }
    if !reader.takes(b"(") {
        return None;
    }
    let inside = reader.at;
    if let Some(value) = sum(reader, 0)
        && reader.takes(b")")
    {
        return Some(of_value(value));
    }
    reader.at = inside;
    skip_parenthesis(reader)?;
    Some(Number::Unknown)
}

/// Goes behind the parenthesis that ends what begins here.
fn skip_parenthesis(reader: &mut Reader<'_>) -> Option<()> {
    let mut depth = 1;
    while depth > 0 {
        match reader.peek()? {
            b'(' => depth += 1,
            b')' => depth -= 1,
            _ => {}
        }
        reader.at += 1;
    }
    Some(())
}

/// A Turbo board takes a number below 0, too: it begins again at the other end.
fn of_value(value: f64) -> Number {
    if !value.is_finite() {
        return Number::Unknown;
    }
    let whole = |value: f64| if value < 0.0 { value.rem_euclid(f64::from(COUNT)) } else { value } as u32;
    let (low, high) = (whole(value.floor()), whole(value.ceil()));
    if low == high { Number::One(low) } else { Number::Either(low.min(high), low.max(high)) }
}

/// A sum; not a number where it goes by a variable. `None` where it is no expression that is known here. `* / % &` go before
/// `+ - | ^`, each from left to right.
fn sum(reader: &mut Reader<'_>, depth: u32) -> Option<f64> {
    let mut left = product(reader, depth)?;
    loop {
        let Some(sign @ (b'+' | b'-' | b'|' | b'^')) = reader.peek() else { return Some(left) };
        reader.at += 1;
        let right = product(reader, depth)?;
        left = match sign {
            b'+' => left + right,
            b'-' => left - right,
            b'|' => bitwise(left, right, |a, b| a | b),
            _ => bitwise(left, right, |a, b| a ^ b),
        };
    }
}

fn product(reader: &mut Reader<'_>, depth: u32) -> Option<f64> {
    let mut left = factor(reader, depth)?;
    loop {
        let Some(sign @ (b'*' | b'/' | b'%' | b'&')) = reader.peek() else { return Some(left) };
        reader.at += 1;
        let right = factor(reader, depth)?;
        left = match sign {
            b'*' => left * right,
            b'/' => left / right,
            b'%' => left.rem_euclid(right),
            _ => bitwise(left, right, |a, b| a & b),
        };
    }
}

fn factor(reader: &mut Reader<'_>, depth: u32) -> Option<f64> {
    if depth > DEEPEST {
        return None;
    }
    match reader.peek()? {
        b'-' | b'+' => {
            let is_negative = reader.line[reader.at] == b'-';
            reader.at += 1;
            factor(reader, depth + 1).map(|value| if is_negative { -value } else { value })
        }
        b'(' => {
            reader.at += 1;
            let value = sum(reader, depth + 1)?;
            reader.takes(b")").then_some(value)
        }
        b'$' => {
            reader.at += 1;
            reader.hexadecimal().map(f64::from)
        }
        b'0'..=b'9' | b'.' => decimal(reader),
        byte if byte.is_ascii_alphabetic() => {
            let start = reader.at;
            while reader.peek().is_some_and(|byte| byte.is_ascii_alphabetic()) {
                reader.at += 1;
            }
            let name = &reader.line[start..reader.at];
            let is = |function: &[u8]| name.trim_ascii_end().eq_ignore_ascii_case(function);
            let compute: fn(f64) -> f64 = match () {
                () if is(b"ABS") => f64::abs,
                () if is(b"INT") => f64::floor,
                () if is(b"SQRT") => f64::sqrt,
                // A variable of this number, or a function that goes by I15.
                () => |_| f64::NAN,
            };
            factor(reader, depth + 1).map(compute)
        }
        _ => None,
    }
}

fn decimal(reader: &mut Reader<'_>) -> Option<f64> {
    let whole = reader.number().map_or(0.0, f64::from);
    let mut value = whole;
    if reader.peek() == Some(b'.') {
        reader.at += 1;
        let mut place = 1.0;
        while let Some(digit @ b'0'..=b'9') = reader.peek() {
            reader.at += 1;
            place /= 10.0;
            value += f64::from(digit - b'0') * place;
        }
    }
    Some(value)
}

/// On the whole parts.
fn bitwise(left: f64, right: f64, of: fn(i64, i64) -> i64) -> f64 {
    if left.is_nan() || right.is_nan() {
        return f64::NAN;
    }
    of(left.floor() as i64, right.floor() as i64) as f64
}
