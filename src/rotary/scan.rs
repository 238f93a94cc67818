//! Splits a text line into words, numbers and symbols, each with its place.
//!
//! PMAC has no separators: commands may follow each other without a blank, so a word is the longest known one that
//! fits. Blanks may stand anywhere except inside a word or a number. Case does not matter. `;` and `//` begin a
//! comment.

use std::array;
use std::cmp::Reverse;
use std::sync::LazyLock;

use super::codes::{CODES, Code, Operator};
use super::constant::Constant;
use super::refused::{REFUSED, RefusedWord};

/// A token of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Token {
    /// Its kind.
    pub kind: Kind,
    /// Its first byte in the line.
    pub start: usize,
    /// The byte after its last.
    pub end: usize,
    /// The column of its first character, from 1.
    pub column: u32,
}

/// The kinds of tokens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A command.
    Command(&'static Code),
    /// PLC, as in ENABLE PLC.
    Plc,
    /// A known word that the compiler refuses.
    Refused(&'static RefusedWord),
    /// A number without sign, and whether it is decimal.
    Number(Constant, bool),
    /// A hexadecimal number of more than 12 digits.
    LongHex,
    /// `=`, `==`, `|=`, `^=` or `&=`.
    Assign(Operator),
    /// `..`
    Range,
    /// `->`
    Arrow,
    /// Text in quotes.
    Quoted,
    /// Any other printable ASCII character.
    Symbol(u8),
    /// A byte that occurs in no command, with the rest of its character.
    Foreign(u8),
}

/// The tokens of a line, without its comment.
pub fn scan(line: &[u8]) -> Vec<Token> {
    let mut tokens = Vec::new();
    let (mut at, mut column) = (0, 1);
    while let Some(rest) = line.get(at..).filter(|rest| !rest.is_empty()) {
        if rest.starts_with(b";") || rest.starts_with(b"//") {
            break;
        }
        let (kind, length) = next(rest);
        if let Some(kind) = kind {
            tokens.push(Token { kind, start: at, end: at + length, column });
        }
        column += rest.iter().take(length).filter(|&&byte| !is_continuation(byte)).count() as u32;
        at += length;
    }
    tokens
}

/// The token at the start of `rest`, which is not empty, and its length; no token for a blank.
fn next(rest: &[u8]) -> (Option<Kind>, usize) {
    let (first, second) = (rest[0], rest.get(1).copied().unwrap_or_default());
    match (first, second) {
        (b' ' | b'\t', _) => (None, 1),
        (b'a'..=b'z' | b'A'..=b'Z', _) => {
            let (kind, length) = word(rest);
            (Some(kind), length)
        }
        (b'0'..=b'9', _) | (b'.', b'0'..=b'9') => decimal(rest),
        (b'$', digit) if digit.is_ascii_hexdigit() => hexadecimal(rest),
        (b'=', b'=') => (Some(Kind::Assign(Operator::AssignLater)), 2),
        (b'|', b'=') => (Some(Kind::Assign(Operator::Or)), 2),
        (b'^', b'=') => (Some(Kind::Assign(Operator::Xor)), 2),
        (b'&', b'=') => (Some(Kind::Assign(Operator::And)), 2),
        (b'=', _) => (Some(Kind::Assign(Operator::Assign)), 1),
        (b'.', b'.') => (Some(Kind::Range), 2),
        (b'-', b'>') => (Some(Kind::Arrow), 2),
        (b'"', _) => {
            let end = rest.iter().skip(1).position(|&byte| byte == b'"').map_or(rest.len(), |at| at + 2);
            (Some(Kind::Quoted), end)
        }
        (b'!'..=b'~', _) => (Some(Kind::Symbol(first)), 1),
        _ => (Some(Kind::Foreign(first)), 1 + count(&rest[1..], is_continuation)),
    }
}

fn is_continuation(byte: u8) -> bool {
    byte & 0xC0 == 0x80
}

fn count(bytes: &[u8], test: fn(u8) -> bool) -> usize {
    bytes.iter().take_while(|&&byte| test(byte)).count()
}

fn is_digit(byte: u8) -> bool {
    byte.is_ascii_digit()
}

fn decimal(rest: &[u8]) -> (Option<Kind>, usize) {
    let mut length = count(rest, is_digit);
    // Two points are a range: 1..8.
    if rest.get(length) == Some(&b'.') && rest.get(length + 1) != Some(&b'.') {
        length += 1 + count(&rest[length + 1..], is_digit);
    }
    (Some(Kind::Number(Constant::decimal(&rest[..length]), true)), length)
}

fn hexadecimal(rest: &[u8]) -> (Option<Kind>, usize) {
    let digits = count(&rest[1..], |byte| byte.is_ascii_hexdigit());
    let zeros = count(&rest[1..=digits], |byte| byte == b'0');
    let value = rest[1 + zeros..=digits].iter().fold(0u64, |value, &digit| {
        value << 4 | u64::from(char::from(digit).to_digit(16).unwrap_or_default())
    });
    let kind = if digits - zeros > 12 { Kind::LongHex } else { Kind::Number(Constant::whole(value), false) };
    (Some(kind), 1 + digits)
}

/// The words with the same first letter, longer ones first.
type Words = Vec<(&'static [u8], Kind)>;

/// All known words, by first letter.
static WORDS: LazyLock<[Words; 26]> = LazyLock::new(|| {
    let commands =
        CODES.iter().flat_map(|code| code.spellings().map(move |name| (name, Kind::Command(code))));
    let refused = REFUSED.iter().map(|word| (word.name, Kind::Refused(word)));
    let mut all: Words = commands
        .chain(refused)
        .chain([("PLC", Kind::Plc)])
        .map(|(name, kind)| (name.as_bytes(), kind))
        .collect();
    all.sort_by_key(|(name, _)| Reverse(name.len()));
    array::from_fn(|letter| all.iter().filter(|(name, _)| letter_index(name[0]) == letter).copied().collect())
});

/// The place of a letter in the alphabet, from 0.
fn letter_index(letter: u8) -> usize {
    usize::from(letter.to_ascii_uppercase() - b'A')
}

/// The longest known word at the start of `rest`, which begins with a letter. Every single letter is a word.
fn word(rest: &[u8]) -> (Kind, usize) {
    let fits = |name: &[u8]| rest.get(..name.len()).is_some_and(|start| start.eq_ignore_ascii_case(name));
    let longest = WORDS[letter_index(rest[0])].iter().find(|(name, _)| fits(name));
    longest.map_or((Kind::Foreign(rest[0]), 1), |&(name, kind)| (kind, name.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<&str> {
        scan(line.as_bytes()).iter().map(|token| &line[token.start..token.end]).collect()
    }

    #[test]
    fn the_longest_word_wins() {
        assert_eq!(words("linearx10Y-.5"), ["linear", "x", "10", "Y", "-", ".5"]);
        assert_eq!(words("LINABSHMZ1HM2"), ["LIN", "ABS", "HMZ", "1", "HM", "2"]);
        assert_eq!(
            words("CCR0.5CC1CALL5CIR1C1"),
            ["CCR", "0.5", "CC", "1", "CALL", "5", "CIR", "1", "C", "1"]
        );
        assert_eq!(
            words("TA1TS2TM3TSEL4TINITT5"),
            ["TA", "1", "TS", "2", "TM", "3", "TSEL", "4", "TINIT", "T", "5"]
        );
        assert_eq!(words("DISPLC3DISPLAY"), ["DIS", "PLC", "3", "DISPLAY"]);
    }

    #[test]
    fn every_letter_is_a_word() {
        for letter in b'A'..=b'Z' {
            assert!(!matches!(scan(&[letter])[0].kind, Kind::Foreign(_)), "{}", letter as char);
        }
    }

    #[test]
    fn points_belong_to_a_number_or_a_range() {
        assert_eq!(words("1..8"), ["1", "..", "8"]);
        assert_eq!(words("1.5.2"), ["1.5", ".2"]);
        assert_eq!(words("5. .5"), ["5.", ".5"]);
        assert_eq!(words("$10A5.5"), ["$10A5", ".5"]);
    }

    #[test]
    fn comments_end_a_line_except_in_quotes() {
        assert_eq!(words("X5;Y6"), ["X", "5"]);
        assert_eq!(words("X5//Y6"), ["X", "5"]);
        assert_eq!(words("X5/Y6"), ["X", "5", "/", "Y", "6"]);
        assert_eq!(words(r#"CMD"a;b//c"X"#), ["CMD", r#""a;b//c""#, "X"]);
        assert_eq!(words(r#"CMD"a;b"#), ["CMD", r#""a;b"#]);
    }

    #[test]
    fn columns_count_characters() {
        let columns: Vec<u32> = scan("\tX1 é Y2".as_bytes()).iter().map(|token| token.column).collect();
        assert_eq!(columns, [2, 3, 5, 7, 8]);
    }

    #[test]
    fn hexadecimal_constants_have_twelve_digits() {
        let kind = |text: &str| scan(text.as_bytes())[0].kind;
        assert_eq!(kind("$00ff"), Kind::Number(Constant::whole(255), false));
        assert_eq!(kind("$000000FFFFFFFFFFFF"), Kind::Number(Constant::whole(0xFFFF_FFFF_FFFF), false));
        assert_eq!(kind("$1000000000000"), Kind::LongHex);
        assert_eq!(kind("$G"), Kind::Symbol(b'$'));
        assert_eq!(kind("$0"), Kind::Number(Constant::whole(0), false));
    }
}
