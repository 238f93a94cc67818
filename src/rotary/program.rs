//! A compiled program: text lines and the commands of each.

use serde::Serialize;

/// In word 1: this command begins a text line. The commands up to the next such bit form a block.
pub const START_OF_LINE: u32 = 1 << 11;

/// The two words behind the last command of a buffer, at the host index (DPRAM manual p. 30, rule 5).
pub const END_MARKER: (u32, u32) = (0x00_0800, 0x00_FFFF);

/// A program, line by line, without the lines that have no commands.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Program {
    /// Its lines in order, none empty.
    pub lines: Vec<Line>,
}

/// A text line: PMAC takes it as one block, and all of it must be in the buffer before the host index moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// Its number in the text, from 1.
    pub line: u32,
    /// The column of its first command, from 1.
    pub column: u32,
    /// Its commands; the first has [`START_OF_LINE`].
    pub commands: Vec<Command>,
}

/// One 48-bit command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Command {
    /// The column of its first character, from 1.
    pub column: u32,
    /// Its text.
    pub text: String,
    /// The first word, 24 bits.
    pub word1: u32,
    /// The second word, 24 bits.
    pub word2: u32,
}

/// A command as `pmacctl rotary encode --json` prints it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CommandDocument {
    /// The line in the text, from 1.
    pub line: u32,
    /// The column in the line, from 1.
    pub column: u32,
    /// The command's text.
    pub text: String,
    /// The first word, six upper-case hex digits.
    pub word1: String,
    /// The second word, six upper-case hex digits.
    pub word2: String,
}

impl Program {
    /// Every command with its line, in order.
    pub fn commands(&self) -> impl Iterator<Item = (u32, &Command)> {
        self.lines.iter().flat_map(|line| line.commands.iter().map(move |command| (line.line, command)))
    }

    /// The words of every command in order, without end marker.
    pub fn words(&self) -> impl Iterator<Item = (u32, u32)> {
        self.commands().map(|(_, command)| (command.word1, command.word2))
    }

    /// Every command in its JSON form.
    pub fn documents(&self) -> impl Iterator<Item = CommandDocument> {
        self.commands().map(|(line, command)| CommandDocument {
            line,
            column: command.column,
            text: command.text.clone(),
            word1: format!("{:06X}", command.word1),
            word2: format!("{:06X}", command.word2),
        })
    }
}

impl Line {
    /// The line as text: its commands in order, marks directly behind their axis.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for command in &self.commands {
            if !text.is_empty() && !command.text.starts_with([':', '^']) {
                text.push(' ');
            }
            text.push_str(&command.text);
        }
        text
    }

    /// How many 32-bit words the line takes in a buffer.
    #[must_use]
    pub fn buffer_words(&self) -> usize {
        2 * self.commands.len()
    }
}
