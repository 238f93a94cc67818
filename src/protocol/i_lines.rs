//! Which I-variables a command line sets.
//!
//! `I58=0`, `I50..60=0` (a range), `I108,8,100=96` (first, count, step) and `I(P1)=0` are the forms (GRAMMAR, I-variables).
//! Blanks do not matter to PMAC, nor does case.

use super::line;

/// The I-variables of an assignment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbers {
    /// One.
    One(u32),
    /// Several: the first, the last, and the step between them.
    Range(u32, u32, u32),
    /// The number is an expression.
    Unknown,
}

impl Numbers {
    /// Whether variable `number` is among them. Of an expression nobody can tell: it counts as no.
    #[must_use]
    pub const fn has(self, number: u32) -> bool {
        match self {
            Self::One(one) => one == number,
            Self::Range(first, last, step) => {
                first <= number && number <= last && (step == 0 || (number - first).is_multiple_of(step))
            }
            Self::Unknown => false,
        }
    }
}

/// What a line sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Setting {
    /// The variables.
    pub numbers: Numbers,
    /// The value, where it is a plain whole number.
    pub value: Option<u32>,
}

/// What `line` sets, in its order.
pub fn settings(line: &[u8]) -> impl Iterator<Item = Setting> + '_ {
    line::command_bytes(line).flat_map(settings_in)
}

fn settings_in(line: &[u8]) -> impl Iterator<Item = Setting> + '_ {
    let mut at = 0;
    std::iter::from_fn(move || {
        while at < line.len() {
            let is_letter = line[at].eq_ignore_ascii_case(&b'i');
            let is_start = is_letter && !is_in_word(line, at) && !is_a_stations(&line[..at]);
            at += 1;
            if is_start && let Some((setting, next)) = setting_at(line, at) {
                at = next;
                return Some(setting);
            }
        }
        None
    })
}

/// Whether the I at `at` is part of `MI` or `MSI`, which are variables of MACRO. Behind any other letter it is a command of its own:
/// `KI58=0`, `HMI58=0`.
fn is_in_word(line: &[u8], at: usize) -> bool {
    let ends = |with: &[u8]| {
        let tail = at.checked_sub(with.len()).and_then(|start| line.get(start..at));
        tail.is_some_and(|tail| tail.eq_ignore_ascii_case(with))
    };
    ends(b"MS") || ends(b"M") && !ends(b"HM")
}

/// Whether the I behind `before` is a variable of a MACRO station, as in `MS0,I910=7` (GRAMMAR 2.9).
fn is_a_stations(before: &[u8]) -> bool {
    let Some(before) = before.trim_ascii_end().strip_suffix(b",") else { return false };
    let digits = before.iter().rev().take_while(|byte| matches!(byte, b' ' | b'0'..=b'9')).count();
    let word = &before[..before.len() - digits];
    let is_node = before[word.len()..].iter().any(u8::is_ascii_digit);
    is_node && word.len() >= 2 && word[word.len() - 2..].eq_ignore_ascii_case(b"MS")
}

/// Text without the blanks in it.
struct Reader<'a> {
    line: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn peek(&mut self) -> Option<u8> {
        while self.line.get(self.at) == Some(&b' ') {
            self.at += 1;
        }
        self.line.get(self.at).copied()
    }

    fn takes(&mut self, text: &[u8]) -> bool {
        let start = self.at;
        let all = text.iter().all(|wanted| {
            let is_it = self.peek() == Some(*wanted);
            self.at += usize::from(is_it);
            is_it
        });
        if !all {
            self.at = start;
        }
        all
    }

    fn number(&mut self) -> Option<u32> {
        let mut number = None;
        while let Some(digit @ b'0'..=b'9') = self.peek() {
            self.at += 1;
            number = Some(number.unwrap_or(0_u32).saturating_mul(10).saturating_add(u32::from(digit - b'0')));
        }
        number
    }

    fn hexadecimal(&mut self) -> Option<u32> {
        let mut number = None;
        // Behind a blank, A to F are commands.
        while let Some(digit) = self.line.get(self.at).and_then(|byte| char::from(*byte).to_digit(16)) {
            self.at += 1;
            number = Some(number.unwrap_or(0_u32).saturating_mul(16).saturating_add(digit));
        }
        number
    }
}

/// The assignment behind the I at the place before `at`, and where it ends.
fn setting_at(line: &[u8], at: usize) -> Option<(Setting, usize)> {
    let mut reader = Reader { line, at };
    let numbers = match reader.number() {
        Some(first) if reader.takes(b"..") => Numbers::Range(first, reader.number()?, 1),
        Some(first) if reader.takes(b",") => {
            let count = reader.number()?;
            let step = if reader.takes(b",") { reader.number()? } else { 1 };
            Numbers::Range(first, first.saturating_add(count.saturating_sub(1).saturating_mul(step)), step)
        }
        Some(one) => Numbers::One(one),
        None if reader.takes(b"(") => {
            let inside = reader.at;
            if let Some(one) = reader.number()
                && reader.takes(b")")
            {
                return value_behind(reader, Numbers::One(one));
            }
            reader.at = inside;
            let mut depth = 1;
            while depth > 0 {
                match reader.peek()? {
                    b'(' => depth += 1,
                    b')' => depth -= 1,
                    _ => {}
                }
                reader.at += 1;
            }
            Numbers::Unknown
        }
        None => return None,
    };
    value_behind(reader, numbers)
}

/// The assignment to `numbers`, of which what is behind them is to be read, and where it ends.
fn value_behind(mut reader: Reader<'_>, numbers: Numbers) -> Option<(Setting, usize)> {
    if !reader.takes(b"=") || reader.peek() == Some(b'=') {
        return None;
    }
    let value = if reader.takes(b"$") { reader.hexadecimal() } else { reader.number() };
    // With an operator behind it the number is only a part of the value.
    let goes_on = matches!(reader.peek(), Some(b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^' | b'.'));
    Some((Setting { numbers, value: value.filter(|_| !goes_on) }, reader.at))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(line: &str) -> Vec<(Numbers, Option<u32>)> {
        settings(line.as_bytes()).map(|setting| (setting.numbers, setting.value)).collect()
    }

    #[test]
    fn every_form_of_an_assignment_is_known() {
        use Numbers::{One, Range, Unknown};
        for (line, expected) in [
            ("I58=0", vec![(One(58), Some(0))]),
            (" i 5 8 = 1 ", vec![(One(58), Some(1))]),
            ("P1=3 I58=1I59=8#1J+", vec![(One(58), Some(1)), (One(59), Some(8))]),
            ("I50..60=0", vec![(Range(50, 60, 1), Some(0))]),
            ("I108,8,100=96", vec![(Range(108, 808, 100), Some(96))]),
            ("I1,2=3", vec![(Range(1, 2, 1), Some(3))]),
            ("I(P1+(2))=7", vec![(Unknown, Some(7))]),
            (
                "I(58)=0 I( 5 9 )=8 I(58+1)=1",
                vec![(One(58), Some(0)), (One(59), Some(8)), (Unknown, Some(1))],
            ),
            ("I58=$0", vec![(One(58), Some(0))]),
            ("MS0,I58=0 ms 16 , i 58 = 0 MSI58=0", vec![]),
            ("M0,I58=0 MS,I58=0", vec![(One(58), Some(0)), (One(58), Some(0))]),
            ("I58=P1", vec![(One(58), None)]),
            ("I58=1&0 I2=1.0 I3=*", vec![(One(58), None), (One(2), None), (One(3), None)]),
            ("SEND\"I58=0\"I2=3", vec![(One(2), Some(3))]),
            ("#8KI58=0", vec![(One(58), Some(0))]),
            ("#1HMI58=0", vec![(One(58), Some(0))]),
            ("&1SI2=3", vec![(One(2), Some(3))]),
            ("I58 MI58=0 INC IF(I58=0) I100>I=3 I(P1", vec![(One(58), Some(0))]),
        ] {
            assert_eq!(found(line), expected, "{line}");
        }
        let range = Range(108, 808, 100);
        assert!(range.has(208) && range.has(808) && !range.has(209) && !range.has(908) && !Unknown.has(1));
    }
}
