//! Lexical rules of a command line: blanks, letter case, numbers, keywords (Software Reference p. 17).
//!
//! Blanks and tabs only separate; case does not matter. A keyword or number contains no blank. At each place the
//! longest keyword that fits applies.

use crate::sim::board::error::CommandError;

/// Digits of a 24-bit hex constant.
pub const HEX_24: usize = 6;
/// Digits of a 48-bit hex constant.
pub const HEX_48: usize = 12;

/// A reading position in a command line.
#[derive(Debug, Clone)]
pub struct Scanner<'a> {
    text: &'a [u8],
    at: usize,
}

impl<'a> Scanner<'a> {
    /// Starts at the beginning of `text`.
    #[must_use]
    pub const fn new(text: &'a [u8]) -> Self {
        Self { text, at: 0 }
    }

    /// The next character in upper case, after blanks; `None` at the end of the line.
    pub fn peek(&mut self) -> Option<u8> {
        while matches!(self.text.get(self.at), Some(b' ' | b'\t')) {
            self.at += 1;
        }
        self.ahead(0)
    }

    /// The character `distance` after the present one, in upper case; does not skip blanks.
    fn ahead(&self, distance: usize) -> Option<u8> {
        self.text.get(self.at + distance).map(u8::to_ascii_uppercase)
    }

    /// Takes the next character, whichever it is.
    pub fn next_character(&mut self) -> Option<u8> {
        let character = self.peek()?;
        self.at += 1;
        Some(character)
    }

    /// Takes the next character if it is `character` (upper case).
    pub fn take(&mut self, character: u8) -> bool {
        let found = self.peek() == Some(character);
        if found {
            self.at += 1;
        }
        found
    }

    /// Takes the next character or reports ERR003.
    pub fn expect(&mut self, character: u8) -> Result<(), CommandError> {
        if self.take(character) { Ok(()) } else { Err(CommandError::SYNTAX) }
    }

    /// Takes `text` (upper case) if it follows without a blank before it or inside: the `->` of a definition.
    pub fn take_tight(&mut self, text: &[u8]) -> bool {
        let found = text.iter().enumerate().all(|(i, &c)| self.ahead(i) == Some(c));
        if found {
            self.at += text.len();
        }
        found
    }

    /// Takes `text` (upper case, no blank inside) if it follows, after blanks.
    pub fn take_text(&mut self, text: &[u8]) -> bool {
        self.peek();
        self.take_tight(text)
    }

    /// Takes the longest keyword of `tables` at this place.
    pub fn keyword<T: Clone>(&mut self, tables: &[&[(&str, T)]]) -> Option<T> {
        self.peek();
        let here = &self.text[self.at..];
        let (text, meaning) = tables
            .iter()
            .flat_map(|table| table.iter())
            .filter(|(text, _)| {
                here.get(..text.len()).is_some_and(|start| start.eq_ignore_ascii_case(text.as_bytes()))
            })
            .max_by_key(|(text, _)| text.len())?;
        self.at += text.len();
        Some(meaning.clone())
    }

    /// The rest of the line, as typed; moves the scanner to the end.
    pub fn rest(&mut self) -> &'a [u8] {
        self.peek();
        let rest = &self.text[self.at..];
        self.at = self.text.len();
        rest
    }

    /// The text from here to `other`, a later position in the same line.
    #[must_use]
    pub fn up_to(&self, other: &Self) -> &'a [u8] {
        self.text.get(self.at..other.at).unwrap_or(&[])
    }

    /// Takes the text up to the next `end`, as typed, and `end` too. `None` without an `end`.
    pub fn until(&mut self, end: u8) -> Option<&'a [u8]> {
        let rest = &self.text[self.at..];
        let length = rest.iter().position(|&c| c == end)?;
        self.at += length + 1;
        Some(&rest[..length])
    }

    /// Whether an unsigned constant follows.
    pub fn at_unsigned(&mut self) -> bool {
        self.peek();
        self.unsigned_at(0)
    }

    fn unsigned_at(&self, distance: usize) -> bool {
        match self.ahead(distance) {
            Some(b'0'..=b'9') => true,
            Some(b'.') => self.ahead(distance + 1).is_some_and(|c| c.is_ascii_digit()),
            Some(b'$') => self.ahead(distance + 1).is_some_and(|c| c.is_ascii_hexdigit()),
            _ => false,
        }
    }

    /// Whether a constant follows, with an optional sign directly before it.
    pub fn at_constant(&mut self) -> bool {
        match self.peek() {
            Some(b'+' | b'-') => self.unsigned_at(1),
            _ => self.unsigned_at(0),
        }
    }

    /// A decimal or `$` hex constant without sign.
    pub fn unsigned(&mut self) -> Result<f64, CommandError> {
        if !self.at_unsigned() {
            return Err(CommandError::SYNTAX);
        }
        if self.ahead(0) == Some(b'$') {
            self.at += 1;
            return Ok(self.hex_digits(HEX_24)? as f64);
        }
        let start = self.at;
        self.skip_digits();
        if self.ahead(0) == Some(b'.') && self.ahead(1).is_some_and(|c| c.is_ascii_digit()) {
            self.at += 1;
            self.skip_digits();
        }
        let text = std::str::from_utf8(&self.text[start..self.at]).map_err(|_| CommandError::SYNTAX)?;
        let value = text.parse().map_err(|_| CommandError::SYNTAX)?;
        // A point without digits after it belongs to the number; the first of two points (a range) does not.
        if self.ahead(0) == Some(b'.') && self.ahead(1) != Some(b'.') {
            self.at += 1;
        }
        Ok(value)
    }

    /// A constant with an optional sign.
    pub fn constant(&mut self) -> Result<f64, CommandError> {
        if self.take(b'-') {
            return Ok(-self.unsigned()?);
        }
        self.take(b'+');
        self.unsigned()
    }

    /// The value of a register of up to 48 bits: hex of up to 12 digits, or a signed decimal integer.
    pub fn register(&mut self, hex_digits: usize) -> Result<i64, CommandError> {
        let negative = self.take(b'-');
        let value = if self.take(b'$') {
            self.hex_digits(hex_digits)? as i64
        } else {
            let value = self.unsigned()?.round_ties_even();
            if value > (1u64 << 48) as f64 {
                return Err(CommandError::SYNTAX);
            }
            value as i64
        };
        Ok(if negative { -value } else { value })
    }

    /// An unsigned integer, decimal digits only: the number of a variable, motor or coordinate system.
    pub fn integer(&mut self) -> Result<usize, CommandError> {
        self.peek();
        let start = self.at;
        self.skip_digits();
        let digits = &self.text[start..self.at];
        if digits.is_empty() || digits.len() > 9 {
            return Err(CommandError::SYNTAX);
        }
        Ok(digits.iter().fold(0, |value, digit| value * 10 + usize::from(digit - b'0')))
    }

    /// An address up to `last`, decimal or hex.
    pub fn address(&mut self, last: u32) -> Result<u32, CommandError> {
        let value = self.unsigned()?;
        if value > f64::from(last) || value.fract() != 0.0 {
            return Err(CommandError::SYNTAX);
        }
        Ok(value as u32)
    }

    fn skip_digits(&mut self) {
        while self.ahead(0).is_some_and(|c| c.is_ascii_digit()) {
            self.at += 1;
        }
    }

    fn hex_digits(&mut self, limit: usize) -> Result<u64, CommandError> {
        let start = self.at;
        let mut value = 0u64;
        while let Some(digit) = self.ahead(0).and_then(|c| char::from(c).to_digit(16)) {
            if self.at - start == limit {
                return Err(CommandError::SYNTAX);
            }
            value = value << 4 | u64::from(digit);
            self.at += 1;
        }
        if self.at == start { Err(CommandError::SYNTAX) } else { Ok(value) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(text: &str) -> Result<f64, CommandError> {
        Scanner::new(text.as_bytes()).constant()
    }

    #[test]
    fn constants() {
        for (text, value) in [
            ("5", 5.0),
            ("5.", 5.0),
            (".5", 0.5),
            ("-29.1X", -29.1),
            ("+7", 7.0),
            ("$00ff", 255.0),
            ("-$10", -16.0),
            ("$FFFFFF", 16_777_215.0),
            ("1E3", 1.0),
            (" 42", 42.0),
        ] {
            assert_eq!(constant(text), Ok(value), "{text}");
        }
        for text in ["", "-", "$", "$G", ".", "$1000000", "A"] {
            assert_eq!(constant(text), Err(CommandError::SYNTAX), "{text}");
        }
    }

    #[test]
    fn a_range_is_not_a_decimal_point() {
        let mut scanner = Scanner::new(b"1..3");
        assert_eq!(scanner.unsigned(), Ok(1.0));
        assert!(scanner.take_text(b".."));
        assert_eq!(scanner.integer(), Ok(3));
    }

    #[test]
    fn the_longest_keyword_wins() {
        let words: &[(&str, u8)] = &[("HM", 1), ("HOME", 2), ("HOMEZ", 3), ("H", 4)];
        for (text, meaning) in [("homez", 3), ("HOME1", 2), ("hm", 1), ("HO", 4)] {
            assert_eq!(Scanner::new(text.as_bytes()).keyword(&[words]), Some(meaning), "{text}");
        }
        assert_eq!(Scanner::new(b"Z").keyword(&[words]), None);
    }

    #[test]
    fn blanks_separate_and_are_otherwise_nothing() {
        let mut scanner = Scanner::new(b" \tJ + ");
        assert_eq!(scanner.next_character(), Some(b'J'));
        assert!(scanner.take(b'+'));
        assert_eq!(scanner.peek(), None);
        assert!(!Scanner::new(b" ->").take_tight(b"->"));
    }
}
