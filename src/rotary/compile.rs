//! Motion-program text to binary rotary commands.

use super::parse::parse;
use super::program::Program;
use super::reason::{Reason, Report, Warning};
use super::scan::scan;
use super::settings::Settings;

/// A compiled text.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Compiled {
    /// The commands.
    pub program: Program,
    /// What sending it would change.
    pub warnings: Report<Warning>,
}

/// A text that cannot be sent.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{} lines or commands cannot be sent", errors.count())]
pub struct Refused {
    /// The reasons, from the whole text: at least one. A syntax error ends its line, any other error only its command.
    pub errors: Report<Reason>,
    /// What sending the rest would change.
    pub warnings: Report<Warning>,
}

/// Compiles `text`, with lines ended by LF, CR LF or CR.
///
/// Changes only the numbers: rounds each to the mantissa of its command, to nearest, ties to even. Drops comments (`;`
/// and `//`) and lines without commands. `settings` must be valid ([`Settings::check`]).
///
/// # Errors
/// When any part of it cannot be sent: every reason with its place.
/// When any part of it cannot be sent: every reason with its place.
pub fn compile(text: &[u8], settings: &Settings) -> Result<Compiled, Refused> {
    let mut compiled = Compiled::default();
    let mut errors = Report::default();
    for (line, number) in lines(text).zip(1..) {
        let tokens = scan(line);
        if tokens.is_empty() {
            continue;
        }
        let parsed = parse(line, &tokens, number, settings);
        errors.append(parsed.errors);
        compiled.warnings.append(parsed.warnings);
        // Keeps no commands after an error: a hostile file costs no more memory than its errors.
        if errors.is_empty() {
            compiled.program.lines.extend(parsed.line);
        }
    }
    if errors.is_empty() { Ok(compiled) } else { Err(Refused { errors, warnings: compiled.warnings }) }
}

/// The lines of a text without their ends, and without a leading byte order mark.
fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = Some(text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text));
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.iter().position(|byte| matches!(byte, b'\r' | b'\n')) else {
            rest = None;
            return Some(text);
        };
        let after = if text[end..].starts_with(b"\r\n") { end + 2 } else { end + 1 };
        rest = text.get(after..);
        Some(&text[..end])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_three_ways() {
        let split = |text: &'static str| lines(text.as_bytes()).collect::<Vec<_>>();
        assert_eq!(split("a\nb\r\nc\rd"), [b"a", b"b", b"c", b"d"]);
        assert_eq!(split("\u{FEFF}a\n\n"), [b"a".as_slice(), b"", b""]);
        assert_eq!(split(""), [b""]);
    }

    #[test]
    fn errors_are_counted_beyond_those_listed() {
        let text = "X\n".repeat(Report::<Reason>::LIMIT + 7);
        let refused = compile(text.as_bytes(), &Settings::default()).unwrap_err();
        assert_eq!((refused.errors.listed.len(), refused.errors.more), (Report::<Reason>::LIMIT, 7));
        assert_eq!(refused.to_string(), "107 lines or commands cannot be sent");
    }
}
