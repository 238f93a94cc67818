//! Motion-program text to binary rotary commands.

use super::parse::{Modes, parse};
use super::program::Program;
use super::reason::{Reason, Report, Warning};
use super::scan::scan;
use super::settings::Settings;
use crate::format::file_text;

/// A compiled text.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Compiled {
    /// The commands.
    pub program: Program,
    /// How the sent program would differ from the text.
    pub warnings: Report<Warning>,
}

/// A text that the format cannot hold.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{} lines or commands cannot be sent", errors.count())]
pub struct Refused {
    /// The reasons, from the whole text: at least one. A syntax error ends its line, any other error only its command.
    pub errors: Report<Reason>,
    /// How the rest, if sent, would differ from the text.
    pub warnings: Report<Warning>,
}

/// Compiles `text`, as [`file_text`] reads it.
///
/// Refuses ABS, INC and FRAX unless the settings say where their code stands.
///
/// Changes only the numbers: rounds each to the mantissa of its command, to nearest, ties to even. Drops comments (`;`
/// and `//`) and lines without commands. `settings` must be valid ([`Settings::check`]).
///
/// # Errors
/// When the format cannot hold a part of the text: every reason with its place.
pub fn compile(text: &[u8], settings: &Settings) -> Result<Compiled, Refused> {
    compile_with(text, settings, &mut Modes { are_over: true, ..Modes::default() })
}

/// As [`compile`], for a stream. Unless the settings say where the code of ABS, INC and FRAX stands, the compiler
/// returns those before the first move as on-line lines for the coordinate system, in which they are modal.
///
/// # Errors
/// As [`compile`].
pub fn compile_stream(text: &[u8], settings: &Settings) -> Result<(Compiled, Vec<String>), Refused> {
    let mut modes = Modes::default();
    let compiled = compile_with(text, settings, &mut modes)?;
    Ok((compiled, modes.lines))
}

fn compile_with(text: &[u8], settings: &Settings, modes: &mut Modes) -> Result<Compiled, Refused> {
    let mut compiled = Compiled::default();
    let mut errors = Report::default();
    let text = file_text::read(text).unwrap_or_else(|reason| {
        errors.add(1, 1, Reason::NotText(reason));
        "".into()
    });
    for (line, number) in text.split('\n').map(str::as_bytes).zip(1..) {
        let tokens = scan(line);
        if tokens.is_empty() {
            continue;
        }
        let parsed = parse(line, &tokens, number, settings, modes);
        errors.append(parsed.errors);
        compiled.warnings.append(parsed.warnings);
        // Keeps no commands after an error: a hostile file costs no more memory than its errors.
        if errors.is_empty() {
            compiled.program.lines.extend(parsed.line);
        }
    }
    if errors.is_empty() { Ok(compiled) } else { Err(Refused { errors, warnings: compiled.warnings }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_the_same_however_its_file_is_marked_and_ended() {
        let compiled = |text: &[u8]| -> Vec<(u32, u32)> {
            compile(text, &Settings::default()).unwrap().program.words().collect()
        };
        let plain = compiled(b"X1\nY2\n");
        let utf16: Vec<u8> = "\u{FEFF}X1\r\nY2\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
        for text in [b"\xEF\xBB\xBFX1\r\nY2\r\n\x1A", b"X1\rY2\r".as_slice(), b"\x0CX1\n\x0CY2\n", &utf16] {
            assert_eq!(compiled(text), plain, "{text:?}");
        }
        let refused = compile(b"X\x001\x00", &Settings::default()).unwrap_err();
        assert!(refused.errors.listed[0].to_string().contains("UTF-16"), "{refused:?}");
    }

    #[test]
    fn errors_are_counted_beyond_those_listed() {
        let text = "X\n".repeat(Report::<Reason>::LIMIT + 7);
        let refused = compile(text.as_bytes(), &Settings::default()).unwrap_err();
        assert_eq!((refused.errors.listed.len(), refused.errors.more), (Report::<Reason>::LIMIT, 7));
        assert_eq!(refused.to_string(), "107 lines or commands cannot be sent");
    }
}
