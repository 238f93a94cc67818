//! Binary rotary commands to motion-program text, in PMAC's short forms.

use super::codes::{Code, Shape};
use super::compile::compile;
use super::item::{ALL_AXES, Argument, Item, NoCommand, axis_letter};
use super::program::{Command, END_MARKER, Line, Program, START_OF_LINE};
use super::reason::{Reason, Report};
use super::settings::Settings;

/// The text of a sequence of commands.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decompiled {
    /// The commands with their original words, their texts, and the places of these in the text.
    pub program: Program,
    /// Where the text would not compile to the same words.
    pub notes: Report<Note>,
}

/// How a text differs from its original words.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Note {
    /// The first command has no start-of-line bit.
    #[error("the first command has no start-of-line bit: it is taken to begin a line")]
    NoStart,
    /// Commands follow the end marker; the decompiler drops them.
    #[error("{count} pairs of words after the end marker are left out")]
    AfterEnd {
        /// How many pairs.
        count: usize,
    },
    /// The command's text compiles to other words: unused bits are set, or a number is not normalised.
    #[error("{text} came as {word1:06X} {word2:06X}; its own words are {own1:06X} {own2:06X}")]
    OtherWords {
        /// The command's text.
        text: String,
        /// The first original word.
        word1: u32,
        /// The second original word.
        word2: u32,
        /// The first word of the compiled text.
        own1: u32,
        /// The second word of the compiled text.
        own2: u32,
    },
    /// The compiler would refuse the text.
    #[error("a program with this would be refused: {0}")]
    Refused(Box<Reason>),
}

/// A pair of words that is no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("pair {pair} ({word1:06X} {word2:06X}): {cause}")]
pub struct DecodeError {
    /// The number of the pair, from 1.
    pub pair: usize,
    /// Its first word.
    pub word1: u32,
    /// Its second word.
    pub word2: u32,
    /// Why it is no command.
    pub cause: NoCommand,
}

/// Converts `words`, pairs in buffer order, to text, up to an end marker.
///
/// The words from [`compile`](super::compile()) give text that compiles to the same words. `settings` must be valid.
///
/// # Errors
/// When a pair is no command.
pub fn decompile(words: &[(u32, u32)], settings: &Settings) -> Result<Decompiled, DecodeError> {
    let mut decompiled = Decompiled::default();
    let lines = &mut decompiled.program.lines;
    let end = words.iter().position(|&pair| pair == END_MARKER).unwrap_or(words.len());
    let mut width = 0;
    for (&(word1, word2), pair) in words[..end].iter().zip(1..) {
        let item = Item::from_words(word1, word2, settings).map_err(|cause| DecodeError {
            pair,
            word1,
            word2,
            cause,
        })?;
        let text = text(&item, settings);
        let continues = word1 & START_OF_LINE == 0 && !lines.is_empty();
        let blank = u32::from(continues && !text.starts_with([':', '^']));
        let column = if continues { width + blank + 1 } else { 1 };
        width = column - 1 + text.len() as u32;
        let command = Command { column, text, word1, word2 };
        match lines.last_mut().filter(|_| continues) {
            Some(line) => line.commands.push(command),
            None => {
                let number = lines.len() as u32 + 1;
                lines.push(Line { line: number, column: 1, commands: vec![command] });
            }
        }
    }
    if words[..end].first().is_some_and(|(word1, _)| word1 & START_OF_LINE == 0) {
        decompiled.notes.add(1, 1, Note::NoStart);
    }
    for line in &decompiled.program.lines {
        check(line, settings, &mut decompiled.notes);
    }
    if end + 1 < words.len() {
        let line = decompiled.program.lines.len() as u32;
        decompiled.notes.add(line, 1, Note::AfterEnd { count: words.len() - end - 1 });
    }
    Ok(decompiled)
}

/// Compiles the line's text and notes each difference from the original words.
fn check(line: &Line, settings: &Settings, notes: &mut Report<Note>) {
    match compile(line.text().as_bytes(), settings) {
        Err(refused) => {
            for error in refused.errors.listed {
                notes.add(line.line, error.column, Note::Refused(Box::new(error.what)));
            }
        }
        Ok(compiled) => {
            for (own, came) in compiled.program.words().zip(&line.commands) {
                let (word1, word2) = (came.word1 | own.0 & START_OF_LINE, came.word2);
                if own != (word1, word2) {
                    let (text, own1, own2) = (came.text.clone(), own.0, own.1);
                    notes.add(line.line, came.column, Note::OtherWords { text, word1, word2, own1, own2 });
                }
            }
        }
    }
}

/// A command's text.
#[must_use]
pub fn text(item: &Item, settings: &Settings) -> String {
    let Code { short, shape, .. } = item.code;
    match item.argument {
        Argument::None => (*short).to_owned(),
        Argument::Number(float) => format!("{short}{}", float.text(settings)),
        Argument::Assignment(number, float) => {
            let (letter, operator) = short.split_at(1);
            format!("{letter}{number}{operator}{}", float.text(settings))
        }
        Argument::Count(count) => format!("{short}{count}"),
        Argument::Axes(ALL_AXES) => (*short).to_owned(),
        Argument::Axes(axes) => {
            let letters: Vec<String> =
                (0..10).filter(|k| axes >> k & 1 == 1).map(|k| axis_letter(k).to_string()).collect();
            format!("{short}({})", letters.join(","))
        }
        Argument::Motors(motors) => format!("{short}{}", list(u64::from(motors) << 1)),
        Argument::Plcs(plcs) => {
            debug_assert!(matches!(shape, Shape::Plcs { .. }));
            format!("{short} PLC {}", list(plcs.into()))
        }
    }
}

/// The numbers of the set bits; three or more in a row become `n..m`.
fn list(bits: u64) -> String {
    let mut parts: Vec<String> = Vec::new();
    let mut n = 0;
    while n < 64 {
        let run = (bits >> n).trailing_ones();
        match run {
            0 => {}
            1 | 2 => parts.extend((n..n + run).map(|n| n.to_string())),
            _ => parts.push(format!("{n}..{}", n + run - 1)),
        }
        n += run.max(1);
    }
    parts.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_written_short() {
        assert_eq!(list(0b10), "1");
        assert_eq!(list(0b110), "1,2");
        assert_eq!(list(0b1_1110_1011), "0,1,3,5..8");
        assert_eq!(list(0xFFFF_FF00), "8..31");
        assert_eq!(list(u64::MAX), "0..63");
    }

    #[test]
    fn words_after_the_end_marker_are_left_out() {
        let words = [(0x000E23, 0x500000), END_MARKER, (0x000E23, 0x500000)];
        let decompiled = decompile(&words, &Settings::default()).unwrap();
        assert_eq!(decompiled.program.lines.len(), 1);
        assert_eq!(decompiled.notes.listed[0].what, Note::AfterEnd { count: 1 });
        let ended = decompile(&words[..2], &Settings::default()).unwrap();
        assert!(ended.notes.is_empty());
    }

    #[test]
    fn what_would_not_come_back_is_said() {
        let notes = |words: &[(u32, u32)]| {
            decompile(words, &Settings::default())
                .unwrap()
                .notes
                .listed
                .into_iter()
                .map(|note| note.what)
                .collect::<Vec<_>>()
        };
        // Unused bits 15-12, a mantissa that is not normalised, a line that does not begin.
        assert!(matches!(notes(&[(0x00FF26, 0x640000)])[..], [Note::OtherWords { own1: 0x000F26, .. }]));
        assert!(matches!(notes(&[(0x000E24, 0x280000)])[..], [Note::OtherWords { own1: 0x000E23, .. }]));
        assert!(matches!(notes(&[(0x000623, 0x500000)])[..], [Note::NoStart]));
        // NORMAL without a vector, a velocity without an axis.
        assert!(matches!(notes(&[(0x020F80, 0)])[..], [Note::Refused(_)]));
        assert!(matches!(notes(&[(0x460F25, 0x640000)])[..], [Note::Refused(_)]));
    }

    #[test]
    fn an_error_says_which_pair() {
        let error = decompile(&[(0x000E23, 0x500000), (0, 0)], &Settings::default()).unwrap_err();
        assert_eq!(error.to_string(), "pair 2 (000000 000000): no command has CODE1 0 and these codes");
    }
}
