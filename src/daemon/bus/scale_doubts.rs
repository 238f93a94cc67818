//! Which motors' scales a command line may change: until the board has told them again, they are not known.

use crate::segment::Identity;

/// Of Ix07, Ix08 and Ix09 each the motors whose value is in doubt, bit n-1 for motor n.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ScaleDoubts([u32; 3]);

impl ScaleDoubts {
    const ALL: Self = Self([u32::MAX; 3]);

    /// The scales that `line` may change: those that it sets by number; all of them where it gives a range or an expression,
    /// or resets the board.
    #[must_use]
    pub fn of_line(line: &[u8]) -> Self {
        let mut doubts = Self::default();
        if line.windows(3).any(|three| three == b"$$$") {
            return Self::ALL;
        }
        for at in (0..line.len()).filter(|&at| line[at].eq_ignore_ascii_case(&b'i')) {
            let (before, after) = (line[..at].last(), line[at + 1..].trim_ascii_start());
            if before.is_some_and(u8::is_ascii_alphabetic) {
                continue;
            }
            let digits = after.iter().take_while(|byte| byte.is_ascii_digit()).count();
            let (number, behind) = after.split_at(digits);
            match behind.trim_ascii_start() {
                [b'=', ..] if digits > 0 => {
                    let number: usize =
                        std::str::from_utf8(number).ok().and_then(|n| n.parse().ok()).unwrap_or(0);
                    let (motor, which) = (number / 100, number % 100);
                    if let (1..=32, Some(index)) = (motor, which.checked_sub(7).filter(|index| *index < 3)) {
                        doubts.0[index] |= 1 << (motor - 1);
                    }
                }
                [b'.' | b',' | b'(', ..] => return Self::ALL,
                _ => {}
            }
        }
        doubts
    }

    /// More doubts.
    pub fn add(&mut self, more: Self) {
        for (motors, more) in self.0.iter_mut().zip(more.0) {
            *motors |= more;
        }
    }

    /// `identity` without the scales that are in doubt.
    #[must_use]
    pub fn leave_out(self, mut identity: Identity) -> Identity {
        let tables = [&mut identity.ix07, &mut identity.ix08, &mut identity.ix09];
        for (table, motors) in tables.into_iter().zip(self.0) {
            for (index, scale) in table.iter_mut().enumerate() {
                *scale = scale.filter(|_| motors >> index & 1 == 0);
            }
        }
        identity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_puts_in_doubt_the_scales_that_it_may_change() {
        for (line, expected) in [
            ("I108=48", [0, 1, 0]),
            ("i 3209 = 96", [0, 0, 1 << 31]),
            ("I122=I108", [0; 3]),
            ("I307=1I408=2", [1 << 2, 1 << 3, 0]),
            ("I8=1 I9908=1 I109>I108", [0; 3]),
            ("LINEAR X8=1 DWELL7=8", [0; 3]),
            ("I100..199=0", [u32::MAX; 3]),
            ("I108,8,100=96", [u32::MAX; 3]),
            ("I(P1)=7", [u32::MAX; 3]),
            ("$$$", [u32::MAX; 3]),
            ("M1->X:$C000,8", [0; 3]),
        ] {
            assert_eq!(ScaleDoubts::of_line(line.as_bytes()), ScaleDoubts(expected), "{line}");
        }
    }
}
