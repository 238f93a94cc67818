//! What a line does to the program buffers: opens one, closes what is open, or enters what is open.

use super::line::{command_bytes, resets};
use crate::format::Text;

/// The longest name of a buffer: `PROG 32767`.
pub const NAME_MAX: usize = 16;
const OPEN: &str = "OPEN";
const CLOSES: [&str; 2] = ["CLOSE", "CLS"];
const CLEARS: [&str; 2] = ["CLEAR", "CLR"];
const BUFFERS: [&str; 8] = ["PROG", "PLCC", "PLC", "BINARY", "ROTARY", "ROT", "FORWARD", "INVERSE"];

/// What a line does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// It opens the buffer of this name: `PROG 77`.
    Opens(Text<NAME_MAX>),
    /// It closes what is open.
    Closes,
}

/// Whether `line` is `CLOSE`, or `CLOSE ALL` (Turbo Software Reference p. 381), and nothing else.
#[must_use]
pub fn is_close(line: &[u8]) -> bool {
    let is_closes = |line: &[u8]| CLOSES.iter().any(|word| line.eq_ignore_ascii_case(word.as_bytes()));
    let line = line.trim_ascii();
    let before_all =
        line.split_last_chunk().filter(|(_, all): &(_, &[u8; 3])| all.eq_ignore_ascii_case(b"ALL"));
    is_closes(line) || before_all.is_some_and(|(before, _)| is_closes(before.trim_ascii_end()))
}

/// Whether `line` only addresses, reports and stops: `#1P`, `&2?`, `#1J/`, `&1A`, `#`. The board carries such letters out while a
/// buffer is open, too, and stores nothing: a letter of a program has a number behind it, these have none (Software Reference
/// p. 273 has `&1R &2R` under `OPEN ROT`; of the other letters it is what boards are known to do). The other reading is
/// [`crate::map::readings::BufferCommands::Refused`].
pub fn enters_nothing(line: &[u8]) -> bool {
    let mut rest = line.trim_ascii();
    let mut acts = false;
    while let Some((&first, behind)) = rest.split_first() {
        rest = match first.to_ascii_uppercase() {
            b'#' | b'&' => &behind[behind.iter().take_while(|byte| byte.is_ascii_digit()).count()..],
            b'J' if behind.first() == Some(&b'/') => &behind[1..],
            b'?' | b'A' | b'F' | b'H' | b'K' | b'P' | b'Q' | b'V' => behind,
            b' ' => {
                rest = behind;
                continue;
            }
            _ => return false,
        };
        // Two letters together are another command, and a letter with a number or a value a piece of a program.
        acts |= !matches!(first, b'#' | b'&') || behind.len() == rest.len();
        if first.is_ascii_alphabetic() && rest.first().is_some_and(|byte| !matches!(byte, b' ' | b'#' | b'&'))
        {
            return false;
        }
    }
    acts
}

/// Whether program statements of `line` enter a buffer that is open: it opens, closes and empties none, and does not only report or
/// stop.
#[must_use]
pub fn enters(line: &[u8]) -> bool {
    let empties = CLEARS.iter().any(|word| line.trim_ascii().eq_ignore_ascii_case(word.as_bytes()));
    effect(line).is_none() && !empties && !enters_nothing(line)
}

/// What `line` does to the buffers in the end; `None` when it leaves them as they are.
#[must_use]
pub fn effect(line: &[u8]) -> Option<Effect> {
    let mut effect = None;
    for part in command_bytes(line) {
        let mut rest = part;
        while let Some(start) = rest.iter().position(u8::is_ascii_alphabetic) {
            rest = &rest[start..];
            let end = rest.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(rest.len());
            let (word, behind) = rest.split_at(end);
            if CLOSES.iter().any(|close| word.eq_ignore_ascii_case(close.as_bytes())) {
                effect = Some(Effect::Closes);
            } else if let Some(name) = opened_by(word, behind) {
                effect = Some(Effect::Opens(name));
            }
            rest = behind;
        }
        // No buffer is open after a reset.
        if resets(part) {
            effect = Some(Effect::Closes);
        }
    }
    effect
}

/// The buffer that `word` opens, or `word` together with what stands `behind` it; `None` when it opens none. Letters before
/// `OPEN` are commands of their own: `#8KOPENPROG3`.
fn opened_by(word: &[u8], behind: &[u8]) -> Option<Text<NAME_MAX>> {
    let at = word.windows(OPEN.len()).rposition(|part| part.eq_ignore_ascii_case(OPEN.as_bytes()))?;
    let kind = &word[at + OPEN.len()..];
    let known =
        |kind: &[u8]| BUFFERS.iter().find(|known| kind.eq_ignore_ascii_case(known.as_bytes())).copied();
    let spaces = |text: &[u8]| text.iter().take_while(|byte| **byte == b' ').count();
    let (name, number) = if kind.is_empty() {
        let behind = &behind[spaces(behind)..];
        let end = behind.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(behind.len());
        (known(&behind[..end]).unwrap_or(""), &behind[end..])
    } else {
        (known(kind)?, behind)
    };
    let number = &number[spaces(number)..];
    let digits = number.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut text = [b' '; NAME_MAX];
    let letters = name.len().min(NAME_MAX);
    text[..letters].copy_from_slice(&name.as_bytes()[..letters]);
    let room = digits.min(NAME_MAX - letters - 1);
    text[letters + 1..letters + 1 + room].copy_from_slice(&number[..room]);
    Some(Text::from_bytes(text.trim_ascii()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_2_a_buffer_is_opened_behind_other_letters_too() {
        for line in ["OPEN PROG 3", "#8KOPENPROG3", "LISTLINKOPENPROG3", "k open prog 3", "#1J/OPEN PROG3"] {
            let Some(Effect::Opens(name)) = effect(line.as_bytes()) else { panic!("{line}") };
            assert_eq!(name.as_bytes(), b"PROG 3", "{line}");
        }
    }

    #[test]
    fn a_line_enters_what_is_open_unless_it_opens_closes_empties_reports_or_stops() {
        for (line, expected) in [("P20=77", true), ("X1", true), ("I57", true), ("P1 CLEAR", true)] {
            assert_eq!(enters(line.as_bytes()), expected, "{line}");
        }
        for line in
            ["OPEN PROG 3 CLEAR", "CLOSE", "close all", " clear ", "CLR", "#1P", "#1J/", "&1A", "???", "$$$"]
        {
            assert!(!enters(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn b1_2_what_only_reports_or_stops_enters_no_buffer() {
        for line in [
            "#1P",
            "#3 P V F",
            "&2?",
            "???",
            "#1J/",
            "&1A",
            "#1k",
            " #1 #2 p ",
            "#",
            "&",
            "&1Q",
            "#1J/#3J/#2",
            "&2A&1",
        ] {
            assert!(enters_nothing(line.as_bytes()), "{line}");
        }
        for line in [
            "P1", "#1P1", "P=1", "A10", "#1J+", "#1J=5", "F100", "K5", "I57", "PR1", "&1R", "&1 B1", "#1",
            "", "H(P1)", "P,5",
        ] {
            assert!(!enters_nothing(line.as_bytes()), "{line}");
        }
    }
}
