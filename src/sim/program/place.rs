//! A place in a program.

/// A place in a program: program 0 is the rotary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cursor {
    /// The program's number.
    pub program: u32,
    /// The line's number, from 0.
    pub line: u64,
    /// The command in the line, from 0.
    pub item: usize,
}

impl Cursor {
    /// The start of a line.
    #[must_use]
    pub const fn at(program: u32, line: u64) -> Self {
        Self { program, line, item: 0 }
    }
}
