//! Control characters as people write them: `^K` for 0x0B.
//!
//! A control character's number is its letter's code less 64; the board's control-character register takes the same
//! number (DPRAM manual p. 28).

/// `^A`: every coordinate system stops, at the rates of Ix15, and open loops close.
pub const ABORT: u8 = 0x01;
/// `^K`: every motor's loop opens, with zero output and its amplifier disabled.
pub const KILL: u8 = 0x0B;
/// `^L`: PMAC closes the rotary buffers, as by `CLOSE`.
pub const CLOSE_ROTARY: u8 = 0x0C;
/// `^O`: feed hold of every coordinate system.
pub const HOLD: u8 = 0x0F;
/// `^Q`: every program ends after the moves that PMAC has calculated.
pub const QUIT: u8 = 0x11;
/// `^R`: the programs of every coordinate system run.
pub const RUN: u8 = 0x12;
/// `^S`: the programs of every coordinate system do one step.
pub const STEP: u8 = 0x13;
/// `^U`: PMAC opens the rotary buffers, as by `OPEN ROT`.
pub const OPEN_ROTARY: u8 = 0x15;
/// `^X`: PMAC empties its command and response queues, and does not carry out a half-sent line.
pub const CANCEL: u8 = 0x18;
/// `^Z`: the serial port becomes the active response port, and I58 becomes 0.
pub const SERIAL: u8 = 0x1A;

/// Whether a control character stops motion and starts none.
#[must_use]
pub const fn stops(character: u8) -> bool {
    matches!(character, ABORT | KILL | HOLD)
}

/// Whether `character` only reports numbers and status: `^B ^C ^F ^G ^P ^V` (Software Reference, on-line control
/// characters).
#[must_use]
pub const fn only_reports(character: u8) -> bool {
    matches!(character, 0x02 | 0x03 | 0x06 | 0x07 | 0x10 | 0x16)
}

/// The control character (1 to 31) that `text` names: `^A` … `^_`, letters in either case, or the character itself.
#[must_use]
pub fn parse(text: &str) -> Option<u8> {
    let byte = match text.as_bytes() {
        [byte] => *byte,
        [b'^', letter] => letter.to_ascii_uppercase().checked_sub(64)?,
        _ => return None,
    };
    (1..=31).contains(&byte).then_some(byte)
}

/// How people write the control character `byte`: `^K` for 0x0B.
#[must_use]
pub fn name(byte: u8) -> String {
    format!("^{}", letter(byte))
}

/// The letter of the control character `byte`, without allocating: `K` for 0x0B.
#[must_use]
pub const fn letter(byte: u8) -> char {
    ((byte & 0x1F) + 64) as char
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_control_character_is_its_own_name() {
        for byte in 1..=31 {
            assert_eq!(parse(&name(byte)), Some(byte));
            assert_eq!(parse(&char::from(byte).to_string()), Some(byte));
        }
        assert_eq!(parse("^K"), Some(0x0B));
        assert_eq!(parse("^k"), Some(0x0B));
    }

    #[test]
    fn nothing_else_is_one() {
        for text in ["", "K", "^", "^@", "^1", "^KK", "K^", " ", "\u{7f}", "ü", "^ü"] {
            assert_eq!(parse(text), None, "{text:?}");
        }
    }
}
