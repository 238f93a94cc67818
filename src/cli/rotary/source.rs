//! Reads a motion program and the settings for compiling it.

use std::fmt::Display;

use clap::Args;
use serde::Deserialize;

use crate::cli::console::input;
use crate::cli::console::note;
use crate::cli::context::Failure;
use crate::client::{Connection, circles};
use crate::map::readings::RotaryCode2;
use crate::preprocess::shown;
use crate::rotary::{Compiled, Line, Program, Refused, Report, Settings, compile, compile_stream};

/// Largest file: above any machine's program and below the memory.
const LARGEST_PROGRAM: u64 = 256 << 20;

/// A hint for a board that has never taken a line.
pub const NOTHING_TAKEN: &str = "; a board that has never taken a line may have start and size the other way round in the \
    buffer's header (docs/evidence.md)";

#[derive(Debug, Args)]
pub struct Format {
    /// Choices where the manual is unclear about the format, and the buffer's size: exponent_bias, zero_exponent,
    /// rotary_code2 (bit12, bit16), mode_code_bit, abs_inc_axis_bit, abs_inc_vector_bit, frax_axis_bit,
    /// coordinate_system_base, buffer_words. Defaults: the likeliest reading, but none for rotary_code2; for stream and
    /// check, the daemon's settings
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting)]
    pub settings: Vec<(String, toml::Value)>,
}

impl Format {
    /// The settings of `base`, changed by `--set`.
    pub fn over(&self, base: &Settings) -> Result<Settings, Failure> {
        let mut table = toml::Table::try_from(base).map_err(Failure::request)?;
        let mut rotary_code2 = base.rotary_code2;
        let wrong = |error: toml::de::Error| Failure::Request(format!("--set: {}", error.to_string().trim()));
        for (name, value) in &self.settings {
            if name == "rotary_code2" {
                rotary_code2 = Some(RotaryCode2::deserialize(value.clone()).map_err(wrong)?);
            } else {
                table.insert(name.clone(), value.clone());
            }
        }
        let settings = Settings::deserialize(table).map_err(wrong)?;
        let settings = Settings { rotary_code2, home_motors: base.home_motors, ..settings };
        settings.check().map_err(|error| Failure::Request(format!("--set {error}")))?;
        Ok(settings)
    }
}

fn setting(text: &str) -> Result<(String, toml::Value), String> {
    let (name, value) = text.split_once('=').ok_or("not NAME=VALUE")?;
    let value = match value.parse() {
        Ok(number) => toml::Value::Integer(number),
        Err(_) => toml::Value::String(value.to_owned()),
    };
    Ok((name.to_owned(), value))
}

/// The program in `file`. Warnings go to stderr.
///
/// # Errors
/// Each error on a line: `FILE:LINE:COLUMN: reason`.
pub fn compiled(file: &str, settings: &Settings) -> Result<Program, Failure> {
    let (program, ()) = reported(file, compile(&read(file)?, settings).map(|compiled| (compiled, ())))?;
    Ok(program)
}

/// As [`compiled`], and the ABS, INC and FRAX that must precede the stream.
///
/// # Errors
/// As [`compiled`].
pub fn compiled_stream(file: &str, settings: &Settings) -> Result<(Program, Vec<String>), Failure> {
    reported(file, compile_stream(&read(file)?, settings))
}

fn reported<T>(file: &str, outcome: Result<(Compiled, T), Refused>) -> Result<(Program, T), Failure> {
    let name = shown(file);
    match outcome {
        Ok((compiled, rest)) => {
            warn(&name, &compiled.warnings);
            Ok((compiled.program, rest))
        }
        Err(refused) => {
            warn(&name, &refused.warnings);
            Err(Failure::Refused(listing(&name, "", &refused.errors)))
        }
    }
}

/// The warning for the first circle of `program`, from the file `name`, if the board would not draw a circle in
/// coordinate system `cs`.
pub fn circle_warning(board: &mut Connection, name: &str, program: &Program, cs: u8) -> Option<String> {
    let has_circle = |line: &&Line| line.commands.iter().any(|command| circles::is_circle(&command.text));
    let line = program.lines.iter().find(has_circle)?;
    circles::warning(board, format_args!("{name}:{}", line.line), Some(cs.into()))
}

/// The file's bytes.
pub fn read(file: &str) -> Result<Vec<u8>, Failure> {
    input::read(file, LARGEST_PROGRAM).map_err(|why| Failure::Request(format!("{}: {why}", shown(file))))
}

/// Each finding on a line: `FILE:LINE:COLUMN: text`.
pub fn listing<T: Display>(name: &str, kind: &str, report: &Report<T>) -> String {
    let mut lines: Vec<String> = report
        .listed
        .iter()
        .map(|placed| format!("{name}:{}:{}: {kind}{}", placed.line, placed.column, placed.what))
        .collect();
    if report.more > 0 {
        lines.push(format!("{name}: {kind}and {} more", report.more));
    }
    lines.join("\n")
}

pub fn warn<T: Display>(name: &str, report: &Report<T>) {
    if !report.is_empty() {
        note(listing(name, "warning: ", report));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_set_by_name() {
        let settings = |parts: &[&str]| {
            let settings = parts.iter().map(|part| setting(part).unwrap()).collect();
            Format { settings }.over(&Settings::default())
        };
        assert_eq!(settings(&[]).unwrap(), Settings::default());
        let set = settings(&["exponent_bias=30", "rotary_code2=bit16"]).unwrap();
        assert_eq!((set.exponent_bias, set.rotary_code2), (30, Some(RotaryCode2::Bit16)));
        let of_the_daemon = Settings { exponent_bias: 29, frax_axis_bit: 6, ..Settings::default() };
        let over =
            Format { settings: vec![setting("exponent_bias=30").unwrap()] }.over(&of_the_daemon).unwrap();
        assert_eq!((over.exponent_bias, over.frax_axis_bit), (30, 6));
        for wrong in [
            "bias=1",
            "exponent_bias=64",
            "exponent_bias=-1",
            "rotary_code2=other",
            "rotary_code2=1",
            "exponent_bias=",
        ] {
            assert!(matches!(settings(&[wrong]), Err(Failure::Request(_))), "{wrong}");
        }
        assert!(setting("exponent_bias").is_err());
    }
}
