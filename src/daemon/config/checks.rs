//! Checks settings beyond their types. Each refusal says what to write instead.

use serde::Deserialize;

use super::span::Refusal;
use crate::daemon::socket::policy::{PolicyError, group_id};
use crate::map::{Family, Readings};
use crate::protocol::{Function, Functions, ServoSettings};

/// Parses an octal file mode. Refuses a number: 660 and 0o660 would mean different modes.
fn mode(key: &str, value: &toml::Value) -> Result<u32, Refusal> {
    let text = value.as_str().unwrap_or_default();
    let number = u32::from_str_radix(text, 8).ok().filter(|mode| *mode <= 0o777 && text.len() >= 3);
    number.ok_or_else(|| {
        let reason = "is not a file mode; write three or four octal digits in quotes, such as \"0660\"";
        Refusal::of(key, format!("{key} = {} {reason}", shown(value)))
    })
}

fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => format!("\"{text}\""),
        toml::Value::Integer(number) => number.to_string(),
        other => format!("of type {}", other.type_str()),
    }
}

/// Parses the mode of the socket's file. At least its owner must be able to connect, which needs the right to write.
pub(super) fn socket_mode(value: Option<&toml::Value>) -> Result<u32, Refusal> {
    let Some(value) = value else { return Ok(0o660) };
    let mode = mode("socket_mode", value)?;
    if mode & 0o200 == 0 {
        let reason = "lets nobody connect, not even the daemon's own user; write 2 or more in each digit that may connect, such as \"0660\"";
        return Err(Refusal::of("socket_mode", format!("socket_mode = {} {reason}", shown(value))));
    }
    Ok(mode)
}

/// Parses the mode of the segment. Its owner must read and write it, and no other user may write it.
pub(super) fn segment_mode(value: Option<&toml::Value>) -> Result<u32, Refusal> {
    let Some(value) = value else { return Ok(0o644) };
    let mode = mode("segment_mode", value)?;
    let reason = if mode & 0o600 != 0o600 {
        "keeps the daemon's own user from reading or writing its segment; write \"0644\", or \"0640\" or \"0600\" for fewer readers"
    } else if mode & 0o022 != 0 {
        "would let others forge live data; write \"0644\", or \"0640\" for the group alone"
    } else {
        return Ok(mode);
    };
    Err(Refusal::of("segment_mode", format!("segment_mode = {} {reason}", shown(value))))
}

/// Checks a number against its bounds.
pub(super) fn limited(key: &str, value: Option<u32>, least: u32, most: u32) -> Result<Option<u32>, Refusal> {
    match value {
        Some(value) if !(least..=most).contains(&value) => {
            Err(Refusal::of(key, format!("{key} = {value} is out of range: write {least} to {most}")))
        }
        value => Ok(value),
    }
}

/// The table of the readings. A recording of an earlier version may have others; a configuration may not.
pub(super) fn readings(table: toml::Table) -> Result<Readings, Refusal> {
    let only = "rotary_code2";
    if let Some(name) = table.keys().find(|name| *name != only) {
        let text = format!(
            "[readings] takes {only} alone, and has {name}; docs/evidence.md, \"What became of the settings\", tells what is done \
             without it: leave it out"
        );
        return Err(Refusal::of(format!("readings.{name}"), text));
    }
    Readings::deserialize(table).map_err(|error| Refusal::of(format!("readings.{only}"), error.message()))
}

/// The period of background reports, in nanoseconds.
pub(super) fn period_ns(hz: f64) -> Result<u64, Refusal> {
    if (0.1..=1000.0).contains(&hz) {
        Ok((1e9 / hz) as u64)
    } else {
        let text = format!("background_hz = {hz} is out of range: write 0.1 to 1000");
        Err(Refusal::of("background_hz", text))
    }
}

/// Refuses groups that the system does not know. A name service that fails is no fault of the configuration: the code
/// that needs the group's number finds that out, and the service manager tries again.
pub(super) fn groups(named: impl IntoIterator<Item = (String, String)>) -> Result<(), Refusal> {
    for (key, name) in named {
        if let Err(error @ PolicyError::NoSuchGroup(_)) = group_id(&name) {
            return Err(Refusal::of(key, error));
        }
    }
    Ok(())
}

/// The functions to use: the configuration's list, or every function that a board of `family` has.
pub(super) fn functions(written: Option<Functions>, family: &Family) -> Result<Functions, Refusal> {
    let Some(functions) = written else { return Ok(Functions::all(family)) };
    match functions.impossible(family) {
        Some((index, function)) => {
            Err(Refusal::of(format!("functions.{index}"), functions.why_not(function, family)))
        }
        None => Ok(functions),
    }
}

/// The functions to use although M-variables point into their words: each must be among the functions to use.
pub(super) fn shared_functions(
    written: Option<Functions>,
    functions: &Functions,
) -> Result<Functions, Refusal> {
    let Some(shared) = written else { return Ok(Functions::none()) };
    match Function::ALL.into_iter().find(|function| shared.has(*function) && !functions.has(*function)) {
        Some(function) => {
            let name = function.name();
            let text = format!("shared_functions has \"{name}\", which `functions` leaves out");
            Err(Refusal::of("shared_functions", text))
        }
        None => Ok(shared),
    }
}

/// Refuses settings that leave the daemon nothing to do.
pub(super) fn something_to_do(functions: &Functions, servo: &ServoSettings) -> Result<(), Refusal> {
    if !Function::ALL.into_iter().any(|function| functions.has(function)) {
        let text =
            "functions = [] leaves the daemon nothing to do; name some, or leave the key out for all of them";
        return Err(Refusal::of("functions", text));
    }
    if !functions.has(Function::Servo) {
        return Ok(());
    }
    let empty = [("motors", servo.motors.is_empty()), ("fields", servo.fields.is_empty())];
    match empty.into_iter().find(|(_, empty)| *empty) {
        Some((key, _)) => Err(Refusal::of(
            format!("servo.{key}"),
            format!(
                "[servo] {key} = [] leaves nothing of the servo report; name some, or leave \"servo\" out of functions"
            ),
        )),
        None => Ok(()),
    }
}
