//! I-, M-, P- and Q-variables by letter and number, and what a board is.

use pmac_dpram::client::Connection;
use pmac_dpram::language::deadlines::PLAIN;
use pmac_dpram::map::{Family, Generation};
use pmac_dpram::protocol::BoardInfo;

use crate::device::Device;
use crate::fault::Fault;
use crate::process::with;

/// The variable's name, as `P1`.
fn name(letter: u8, index: u32) -> Result<String, Fault> {
    match letter.to_ascii_uppercase() {
        letter @ (b'I' | b'M' | b'P' | b'Q') => Ok(format!("{}{index}", char::from(letter))),
        _ => Err(Fault::argument(format!("{:?} is no kind of variable: I, M, P, Q", char::from(letter)))),
    }
}

/// The board's answer for a variable, without its CR.
pub(crate) fn text(number: u32, letter: u8, index: u32) -> Result<String, Fault> {
    with(number, |device| {
        drop(device.turn()?);
        let name = [name(letter, index)?];
        let values = device.ask(|connection| connection.ask_variables(&name, PLAIN))?;
        values.into_iter().next().ok_or_else(|| Fault::refused("the board gave no value"))
    })
}

/// A variable's value.
pub(crate) fn value(number: u32, letter: u8, index: u32) -> Result<f64, Fault> {
    let text = text(number, letter, index)?;
    parse(&text).ok_or_else(|| Fault::refused(format!("{text:?} is no number")))
}

/// A number as the board writes it; in hexadecimal for some I-variables while I9 is 2 or 3.
fn parse(text: &str) -> Option<f64> {
    match text.strip_prefix('$') {
        Some(digits) => u64::from_str_radix(digits, 16).ok().map(|value| value as f64),
        None => text.parse().ok(),
    }
}

/// Sets a variable.
pub(crate) fn set(number: u32, letter: u8, index: u32, value: f64) -> Result<(), Fault> {
    with(number, |device| {
        if !value.is_finite() {
            return Err(Fault::argument(format!("{value} is no number for a board")));
        }
        drop(device.turn()?);
        // The shortest digits that give the same number, never with an exponent, which no board reads.
        device.send(&format!("{}={value}", name(letter, index)?), PLAIN).map(drop)
    })
}

/// What the daemon says about its board.
pub(crate) fn info(device: &Device) -> Result<BoardInfo, Fault> {
    device.ask(Connection::info)
}

/// The board's family, with as much DPRAM as the board has.
pub(crate) fn family(device: &Device) -> Result<&'static Family, Fault> {
    info(device)?.known_family().map_err(|error| Fault::refused(error.to_string()))
}

/// The board's firmware.
pub(crate) fn version(number: u32) -> Result<String, Fault> {
    with(number, |device| match info(device)?.firmware {
        Some(version) => Ok(version),
        None => ask(device, "VERSION"),
    })
}

/// The date of the board's firmware.
pub(crate) fn date(number: u32) -> Result<String, Fault> {
    with(number, |device| ask(device, "DATE"))
}

fn ask(device: &Device, line: &str) -> Result<String, Fault> {
    let lines = device.ask(|connection| connection.question(line, PLAIN))?;
    Ok(lines.into_iter().next().unwrap_or_default().trim().to_owned())
}

/// The board's number among the vendor's: 1 PMAC, 2 PMAC2, 3 PMAC2 Ultralite, 5 to 7 their Turbo boards.
pub(crate) fn kind(number: u32) -> Result<i32, Fault> {
    with(number, |device| {
        let info = info(device)?;
        let family = info.known_family().map_err(|error| Fault::refused(error.to_string()))?;
        let said = info.board_type.unwrap_or_default();
        let is_ultralite = ["PMACUL", "TURBOU"].iter().any(|name| said.trim_start().starts_with(name));
        let (own, first) = match family.generation {
            Generation::Pmac => (family.number as i32, 0),
            Generation::Turbo => (family.number as i32 - 2, 4),
        };
        Ok(first + if is_ultralite { 3 } else { own })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_a_board_writes_them() {
        for (text, value) in
            [("5", Some(5.0)), ("-0.25", Some(-0.25)), ("$7F", Some(127.0)), ("ERR003", None), ("", None)]
        {
            assert_eq!(parse(text), value, "{text}");
        }
    }

    #[test]
    fn only_four_letters_are_variables() {
        assert_eq!(name(b'p', 12).unwrap(), "P12");
        assert!(name(b'X', 12).is_err() && name(0, 0).is_err() && name(0xFF, 0).is_err());
    }
}
