//! PMAC's error numbers: their meaning, and how the DPRAM's ASCII port carries them.
//!
//! Other ports send `ERR003` as text; the DPRAM port sets bit 15 of the response control word and puts the number in
//! bits 11-0 as three BCD digits, so ERR017 is 0x8017 (DPRAM manual p. 29, Software Reference p. 25).

use super::functions::response;

/// [`ERRORS`]: a running program bars the command.
pub const PROGRAM_RUNS: u16 = 1;

/// [`ERRORS`]: the board does not know the command, or does not allow it at this place.
pub const UNRECOGNIZED: u16 = 3;

/// The last error of PMAC and PMAC2; those above are Turbo's.
pub const LAST_OF_PMAC: u16 = 17;

/// Every documented error number with its meaning, ascending.
pub const ERRORS: &[(u16, &str)] = &[
    (PROGRAM_RUNS, "command not allowed while a program is running"),
    (2, "password error"),
    (UNRECOGNIZED, "data error or unrecognized command"),
    (4, "illegal character, or serial parity or framing error"),
    (5, "command not allowed unless a buffer is open"),
    (6, "no room in the buffer for the command"),
    (7, "buffer already in use"),
    (8, "MACRO auxiliary communication error"),
    (9, "program structure error, for example ENDIF without IF"),
    (10, "both overtravel limits set for a motor of the coordinate system"),
    (11, "previous move not completed"),
    (12, "a motor of the coordinate system is open-loop"),
    (13, "a motor of the coordinate system is not activated"),
    (14, "no motor in the coordinate system"),
    (15, "not pointing to a valid program buffer"),
    (16, "running an improperly structured program"),
    (17, "motors not where they stopped when the program is resumed"),
    (
        18,
        "phase reference not possible during a move, a move not during a phase reference, or phase clock error",
    ),
    (19, "position change not possible while moves are stored in CCBUFFER"),
    (20, "FSAVE on a flash type that does not support it"),
    (21, "FSAVE while flash is being erased"),
    (22, "FREAD on bad flash"),
];

/// The meaning of error `number`, or `None` if no text explains it.
#[must_use]
pub fn meaning(number: u16) -> Option<&'static str> {
    ERRORS.iter().find(|(known, _)| *known == number).map(|(_, text)| *text)
}

/// The error number in a response control word, or `None` when the word reports no error or its digits are not
/// decimal.
#[must_use]
pub const fn from_control(control: u16) -> Option<u16> {
    let [hundreds, tens, ones] = [control >> 8 & 0xF, control >> 4 & 0xF, control & 0xF];
    if control & response::ERROR == 0 || hundreds > 9 || tens > 9 || ones > 9 {
        return None;
    }
    Some(100 * hundreds + 10 * tens + ones)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_words_carry_every_number() {
        for number in 0..1000 {
            let digits = u16::from_str_radix(&number.to_string(), 16).unwrap();
            assert_eq!(from_control(0x8000 | digits), Some(number));
        }
        assert_eq!(from_control(0x8003), Some(3));
        // Bits 14-12 belong to no digit; the host ignores them.
        assert_eq!(from_control(0xF003), Some(3));
    }

    #[test]
    fn what_is_no_error_is_not_read_as_one() {
        for control in [0x0000, 0x000D, 0x0006, 0x020D, 0x7003, 0x800A, 0x80A0, 0x8A00] {
            assert_eq!(from_control(control), None, "{control:04X}");
        }
    }

    #[test]
    fn numbers_are_unique_and_ascend() {
        assert!(ERRORS.is_sorted_by(|a, b| a.0 < b.0));
        assert_eq!(meaning(3), Some("data error or unrecognized command"));
        assert_eq!(meaning(0), None);
        assert_eq!(meaning(23), None);
    }
}
