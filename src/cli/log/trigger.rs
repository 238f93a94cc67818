//! The begin of a log: a condition on a motor's value or flag or on a word of the site, and the rows from before it.

use std::collections::VecDeque;
use std::fmt;
use std::str::FromStr;

use super::files::RowMeaning;
use super::words::PREFIX;
use crate::client::Gap;
use crate::decode::{Flags, ServoData, ServoMotor};

/// The comparison of a value with a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Above,
    Below,
}

/// The value or flag in the condition.
#[derive(Debug, Clone, PartialEq)]
enum Test {
    /// A value against a limit.
    Value { field: String, is_absolute: bool, comparison: Comparison, limit: f64 },
    /// A flag of the servo status word.
    Flag { name: String, is_set: bool },
}

/// A condition on a motor or a word of the site, as a user types it: `1.following_error>100`, `|1.following_error|>100`,
/// `1.open_loop`, `!1.open_loop`, `user.pressure>2`, `user.table[3]<0`.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// `None`: the field is a word of the site.
    motor: Option<usize>,
    test: Test,
}

/// Stands in place of a motor before a word of the site.
const USER: &str = "user";
/// The form of a condition.
const FORM: &str = "write MOTOR.FIELD>NUMBER, |MOTOR.FIELD|>NUMBER or the same with <, MOTOR.FLAG or !MOTOR.FLAG; user.NAME is a field, too";

impl FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let malformed = || format!("no condition; {FORM}");
        let text = text.trim();
        let Some(at) = text.find(['<', '>']) else {
            let (motor, name) = text.trim_start_matches('!').split_once('.').ok_or_else(malformed)?;
            let test = Test::Flag { name: name.to_owned(), is_set: !text.starts_with('!') };
            return Ok(Self { motor: Some(motor.parse().map_err(|_| malformed())?), test });
        };
        let (value, rest) = text.split_at(at);
        let comparison = if rest.starts_with('>') { Comparison::Above } else { Comparison::Below };
        let limit = rest[1..].trim().parse().map_err(|_| malformed())?;
        let value = value.trim();
        let inner = value.strip_prefix('|').and_then(|value| value.strip_suffix('|'));
        let (subject, field) = inner.unwrap_or(value).trim().split_once('.').ok_or_else(malformed)?;
        let motor = match subject.trim() {
            USER => None,
            number => Some(number.parse().map_err(|_| malformed())?),
        };
        let field = field.trim().to_owned();
        Ok(Self { motor, test: Test::Value { field, is_absolute: inner.is_some(), comparison, limit } })
    }
}

/// The condition in the user's spelling.
impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let subject = self.motor.map_or_else(|| USER.to_owned(), |motor| motor.to_string());
        match &self.test {
            Test::Flag { name, is_set } => write!(f, "{}{subject}.{name}", if *is_set { "" } else { "!" }),
            Test::Value { field, is_absolute, comparison, limit } => {
                let bar = if *is_absolute { "|" } else { "" };
                let sign = if *comparison == Comparison::Above { '>' } else { '<' };
                write!(f, "{bar}{subject}.{field}{bar}{sign}{limit}")
            }
        }
    }
}

impl Condition {
    /// The column of the word of the site in the condition.
    pub fn word(&self) -> Option<String> {
        match &self.test {
            Test::Value { field, .. } if self.motor.is_none() => Some(format!("{PREFIX}{field}")),
            _ => None,
        }
    }

    fn of<'u>(&self, update: &'u ServoData) -> Option<&'u ServoMotor> {
        update.motors.iter().find(|motor| Some(motor.motor) == self.motor)
    }

    /// The mistake in the condition on a motor, for updates like `first`.
    pub fn mistake(&self, first: &ServoData) -> Option<String> {
        let number = self.motor?;
        let Some(motor) = self.of(first) else {
            return Some(format!("--trigger: motor {number} is not in the servo report"));
        };
        let (name, has) = match &self.test {
            Test::Value { field, .. } => (field, motor.place(field).is_some()),
            Test::Flag { name, .. } => {
                let known = |flags: Flags| flags.table.flags.iter().any(|(_, flag)| flag == name);
                (name, motor.status.is_none_or(known))
            }
        };
        (!has).then(|| format!("--trigger: the servo report has no {name:?}; {FORM}"))
    }

    /// Why the condition cannot be true yet: the board has not told the scale of its value in `update`.
    pub fn lacks_scale(&self, update: &ServoData) -> Option<String> {
        let Test::Value { field, .. } = &self.test else { return None };
        let motor = self.of(update)?;
        let quantity = motor.quantities()[motor.place(field)?]?;
        quantity.number().is_none().then(|| {
            format!("--trigger: of {}.{field} only the integer is known; until the board tells its scale, it is not true", motor.motor)
        })
    }

    /// Whether the condition is true of `update` or, if the condition is on a word of the site, of its value `word`. An
    /// unknown value makes no condition true.
    pub fn is_met(&self, update: &ServoData, word: f64) -> bool {
        let motor = self.of(update);
        match &self.test {
            Test::Flag { name, is_set } => {
                motor.and_then(|motor| motor.status).is_some_and(|flags| flags.has(name) == *is_set)
            }
            Test::Value { field, is_absolute, comparison, limit } => {
                let quantity = motor.and_then(|motor| motor.quantities()[motor.place(field)?]);
                let of_motor = quantity.and_then(|quantity| quantity.number()).unwrap_or(f64::NAN);
                let value = if self.motor.is_some() { of_motor } else { word };
                let value = if *is_absolute { value.abs() } else { value };
                match comparison {
                    Comparison::Above => value > *limit,
                    Comparison::Below => value < *limit,
                }
            }
        }
    }
}

/// The newest rows, of a bounded time.
#[derive(Debug, Default)]
pub struct Before {
    span_ns: u64,
    rows: VecDeque<Kept>,
}

#[derive(Debug)]
struct Kept {
    time_ns: u64,
    meaning: RowMeaning,
    row: Vec<f64>,
}

impl Before {
    /// Keeps rows for `span_ns`.
    pub const fn new(span_ns: u64) -> Self {
        Self { span_ns, rows: VecDeque::new() }
    }

    /// Keeps the row of an update at `time_ns`, and forgets rows that are then too old. Reuses their memory.
    pub fn keep(&mut self, time_ns: u64, meaning: RowMeaning, row: &[f64]) {
        let mut spare = Vec::new();
        while self.rows.front().is_some_and(|kept| time_ns.saturating_sub(kept.time_ns) > self.span_ns) {
            spare = self.rows.pop_front().map(|kept| kept.row).unwrap_or_default();
        }
        spare.clear();
        spare.extend_from_slice(row);
        self.rows.push_back(Kept { time_ns, meaning, row: spare });
    }

    /// Keeps the row of a gap after the last update, for as long as that update's row. Before the first update no gap
    /// counts.
    pub fn keep_gap(&mut self, gap: Gap, row: &[f64]) {
        if let Some(Kept { time_ns, .. }) = self.rows.back() {
            let (time_ns, row) = (*time_ns, row.to_vec());
            self.rows.push_back(Kept { time_ns, meaning: RowMeaning::Gap(gap), row });
        }
    }

    /// The rows, oldest first.
    pub fn take(&mut self) -> impl Iterator<Item = (RowMeaning, Vec<f64>)> {
        std::mem::take(&mut self.rows).into_iter().map(|Kept { meaning, row, .. }| (meaning, row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_as_they_are_typed() {
        let parse = |text: &str| text.parse::<Condition>();
        let value = |is_absolute, comparison, limit| Condition {
            motor: Some(12),
            test: Test::Value { field: "following_error".to_owned(), is_absolute, comparison, limit },
        };
        assert_eq!(parse("12.following_error>100"), Ok(value(false, Comparison::Above, 100.0)));
        assert_eq!(parse(" |12.following_error| > 1e2 "), Ok(value(true, Comparison::Above, 100.0)));
        assert_eq!(parse("12.following_error < -2.5"), Ok(value(false, Comparison::Below, -2.5)));
        let flag =
            |is_set| Condition { motor: Some(1), test: Test::Flag { name: "open_loop".to_owned(), is_set } };
        assert_eq!((parse("1.open_loop"), parse("!1.open_loop")), (Ok(flag(true)), Ok(flag(false))));
        let word = parse("|user.a.table[2]|>3").unwrap();
        assert_eq!(word.word().as_deref(), Some("user.a.table[2]"));
        assert_eq!(parse("1.velocity>3").unwrap().word(), None);
        for text in [
            "12.following_error>100",
            "|1.velocity|<-2.5",
            "1.open_loop",
            "!1.open_loop",
            "|user.a.table[2]|>3",
        ] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
        for wrong in [
            "",
            "open_loop",
            "x.open_loop",
            "user.open",
            "1.velocity>",
            "1.velocity>x",
            "|1.velocity>3",
            ">3",
        ] {
            assert!(parse(wrong).is_err_and(|text| text.contains("write MOTOR")), "{wrong}");
        }
    }

    #[test]
    fn rows_from_before_are_of_a_bounded_time() {
        let mut before = Before::new(10);
        for time in [0, 5, 9, 10, 11, 20, 21] {
            before.keep(time, RowMeaning::Update, &[time as f64]);
            before.keep_gap(Gap { missed: time, ..Gap::default() }, &[-(time as f64)]);
        }
        let kept: Vec<_> = before.take().map(|(meaning, row)| (meaning, row[0])).collect();
        let both = |time: u64| {
            let gap = RowMeaning::Gap(Gap { missed: time, ..Gap::default() });
            [(RowMeaning::Update, time as f64), (gap, -(time as f64))]
        };
        assert_eq!(kept, [both(11), both(20), both(21)].concat());
        before.keep_gap(Gap::default(), &[0.0]);
        assert_eq!(before.take().count(), 0, "nothing is missing before the first");
    }
}
