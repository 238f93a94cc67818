//! Which I-variables a command line sets.
//!
//! `I58=0`, `I50..60=0` (a range), `I108,8,100=96` (first, count, step) and `I(P1)=0` are the forms. A number may be an
//! expression in each of them; one of constants alone is computed. Blanks do not matter to PMAC, nor does case.

mod number;

pub use self::number::Numbers;
use self::number::{Number, Reader};
use super::line;

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

/// The assignment behind the I at the place before `at`, and where it ends.
fn setting_at(line: &[u8], at: usize) -> Option<(Setting, usize)> {
    let mut reader = Reader { line, at };
    let first = number::read(&mut reader)?;
    let numbers = if reader.takes(b"..") {
        first.up_to(number::read(&mut reader)?)
    } else if reader.takes(b",") {
        let count = number::read(&mut reader)?;
        let step = if reader.takes(b",") { number::read(&mut reader)? } else { Number::One(1) };
        first.times(count, step)
    } else {
        first.alone()
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
                vec![(One(58), Some(0)), (One(59), Some(8)), (One(59), Some(1))],
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
        assert!(
            Range(8200, 8260, 1).has(58) && !Range(8200, 8249, 1).has(58),
            "a Turbo board begins again at 0"
        );
        assert!(Range(0, u32::MAX, 1).has(58) && !Range(60, 50, 1).has(58));
        assert!(range.has(208) && range.has(808) && !range.has(209) && !range.has(908) && !Unknown.has(1));
    }

    #[test]
    fn a_number_that_is_an_expression_of_constants_is_computed() {
        use Numbers::{One, Range, Unknown};
        for (line, expected) in [
            ("I(57+1)=0", One(58)),
            ("I( 60 - 2 )=0", One(58)),
            ("I(29*2)=0", One(58)),
            ("I(2+7*8)=0", One(58)),
            ("I((2+5)*8+2)=0", One(58)),
            ("I($3A)=0", One(58)),
            ("I(-5+63)=0", One(58)),
            ("I(116/2)=0", One(58)),
            ("I(158%100)=0", One(58)),
            ("I(63&58)=0", One(58)),
            ("I(50|8)=0", One(58)),
            ("I(59^1)=0", One(58)),
            ("I(SQRT(3364))=0", One(58)),
            ("I(INT(58.5))=0", One(58)),
            ("I(ABS(-58))=0", One(58)),
            ("I8250=0", One(58)),
            ("I(8192+58)=0", One(58)),
            ("I(58-8192)=0", One(58)),
            ("I(57.6)=0", Range(57, 58, 1)),
            ("I(50)..60=0", Range(50, 60, 1)),
            ("I50..(50+9)=0", Range(50, 59, 1)),
            ("I(48),2,(9+1)=0", Range(48, 58, 10)),
            ("I(P1)=0", Unknown),
            ("I(P1*0+58)=0", Unknown),
            ("I(Q(5)+1)=0", Unknown),
            ("I(SIN(3))=0", Unknown),
            ("I(1/0)=0", Unknown),
            ("I50..(P1)=0", Unknown),
        ] {
            assert_eq!(found(line), [(expected, Some(0))], "{line}");
        }
        let deep = format!("I{}58{}=0", "(".repeat(100_000), ")".repeat(100_000));
        assert_eq!(found(&deep), [(Unknown, Some(0))], "and asks for no more than a part of the stack");
    }
}
