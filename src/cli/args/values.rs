//! Argument types that several commands share: durations, rates, families, layouts.

use std::path::PathBuf;
use std::time::Duration;

use clap::ValueEnum;

use crate::format::{Float48Layout, WordOrder};
use crate::map::{Family, UnknownFamily};
use crate::protocol::TIMEOUT_MAX_MS;
use crate::table::FileFormat;

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Float48 {
    Register,
    Printed,
}

impl From<Float48> for Float48Layout {
    fn from(choice: Float48) -> Self {
        match choice {
            Float48::Register => Self::Register,
            Float48::Printed => Self::Printed,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Order {
    Little,
    Swapped,
}

impl From<Order> for WordOrder {
    fn from(choice: Order) -> Self {
        match choice {
            Order::Little => Self::Little,
            Order::Swapped => Self::Swapped,
        }
    }
}

/// The number of a motor, coordinate system or buffer. The command checks the number again once it knows the board's
/// family.
pub fn number(text: &str) -> Result<u8, String> {
    let number = text.parse().ok().filter(|number| (1..=32).contains(number));
    number.ok_or_else(|| "write a number from 1 to 32; no board has more".to_owned())
}

pub fn family(name: &str) -> Result<&'static Family, UnknownFamily> {
    Family::by_name(name)
}

/// About thirty years.
const LONGEST_S: f64 = 1e9;

pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number of seconds".to_owned())?;
    if seconds > 0.0 && seconds <= LONGEST_S {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err(format!("must be above 0 and at most {LONGEST_S} seconds"))
    }
}

/// The time limit of a command line.
pub fn line_timeout(text: &str) -> Result<Duration, String> {
    let most = TIMEOUT_MAX_MS / 1000;
    seconds(text).and_then(|time| match time.as_millis() <= TIMEOUT_MAX_MS.into() {
        true => Ok(time),
        false => Err(format!("a command may take at most {most} s")),
    })
}

/// A file of a table.
pub fn table_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    FileFormat::of(&path).map(|_| path)
}

/// A number of bytes: `1500`, `64k`, `100M`, `10G`, by powers of 1000.
pub fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || "not a number of bytes above 0, as 1500, 64k, 100M or 10G".to_owned();
    let units = [('k', 1_000), ('M', 1_000_000), ('G', 1_000_000_000), ('T', 1_000_000_000_000)];
    let scaled = units.iter().find_map(|(unit, factor)| Some((text.strip_suffix(*unit)?, *factor)));
    let (digits, factor) = scaled.unwrap_or((text, 1_u64));
    let number: u64 = digits.parse().map_err(|_| wrong())?;
    number.checked_mul(factor).filter(|bytes| *bytes > 0).ok_or_else(wrong)
}

/// The time between two prints.
pub fn rate(text: &str) -> Result<Duration, String> {
    let hz: f64 = text.parse().map_err(|_| "not a number of prints a second".to_owned())?;
    if (0.001..=1000.0).contains(&hz) {
        Ok(Duration::from_secs_f64(1.0 / hz))
    } else {
        Err("must be between 0.001 and 1000 a second".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_reason_are_refused() {
        for text in ["0", "-1", "nan", "inf", "1e10", "x", ""] {
            assert!(seconds(text).is_err(), "{text}");
            assert!(rate(text).is_err(), "{text}");
        }
        for text in ["0", "1e99"] {
            assert_eq!(seconds(text), Err("must be above 0 and at most 1000000000 seconds".to_owned()));
        }
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert_eq!(rate("4"), Ok(Duration::from_millis(250)));
        for text in ["0", "-1", "1.5M", "M", "", "99999999999T", "10B"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        assert_eq!((bytes("1500"), bytes("64k"), bytes("10G")), (Ok(1500), Ok(64_000), Ok(10_000_000_000)));
    }
}
