//! The form of replies: the frame that I3 and I6 put around the board's lines, and how much a client fetches at a time.

use std::collections::VecDeque;

use pmac_dpram::language::number::Numbers;

use crate::packet::REPLY_MAX;

const STX: u8 = 0x02;
const ACK: u8 = 0x06;
const BELL: u8 = 0x07;
const LF: u8 = b'\n';
const CR: u8 = b'\r';

/// The communication variables of one port: I3 and I6 (Software Reference pp. 22-25). An Ethernet port has its own, so
/// each client has his own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Handshake {
    i3: u8,
    i6: u8,
}

impl Default for Handshake {
    /// The values that every known client sets first.
    fn default() -> Self {
        Self { i3: 2, i6: 1 }
    }
}

impl Handshake {
    /// The variables that each client has for himself.
    pub const VARIABLES: [u32; 3] = [3, 4, 6];

    /// Whether one of them is among `numbers`.
    #[must_use]
    pub fn has_among(numbers: Numbers) -> bool {
        Self::VARIABLES.iter().any(|own| numbers.has(*own))
    }

    /// Sets variable `number`; false if the gateway does not support the value. I4 must be 0: with another value a
    /// board sends check sums behind the ACK, where [`Pending::take`] has ended.
    pub fn set(&mut self, number: u32, value: u32) -> bool {
        match (number, u8::try_from(value)) {
            (3, Ok(value @ 0..=3)) => self.i3 = value,
            (6, Ok(value @ 0..=3)) => self.i6 = value,
            (4, Ok(0)) => {}
            _ => return false,
        }
        true
    }

    /// The client's value of variable `number`; `None` if the variable is the board's.
    #[must_use]
    pub fn get(self, number: u32) -> Option<u8> {
        match number {
            3 => Some(self.i3),
            4 => Some(0),
            6 => Some(self.i6),
            _ => None,
        }
    }
}

/// With more unfetched bytes than this a client can send no further line.
const UNFETCHED_MAX: usize = 1 << 18;

/// The replies that a client has not fetched yet.
#[derive(Debug, Default)]
pub struct Pending {
    bytes: VecDeque<u8>,
}

impl Pending {
    /// Drops everything.
    pub fn clear(&mut self) {
        self.bytes = VecDeque::new();
    }

    /// Whether no reply waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Whether the client must fetch replies before his next line.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.bytes.len() > UNFETCHED_MAX
    }

    /// Adds the replies of `other`.
    pub(crate) fn append(&mut self, other: Self) {
        self.bytes.extend(other.bytes);
    }

    /// Adds data lines of the board.
    pub fn lines(&mut self, lines: &[String], handshake: Handshake) {
        for line in lines {
            if handshake.i3 & 1 != 0 {
                self.bytes.push_back(LF);
            }
            // The client library keeps the board's bytes as Latin-1.
            self.bytes.extend(line.chars().map(|character| u8::try_from(character).unwrap_or(b'?')));
            self.bytes.push_back(CR);
        }
    }

    /// Adds the acknowledgement of a command line that the board has taken.
    pub fn end(&mut self, handshake: Handshake) {
        match handshake.i3 {
            0 => {}
            1 => self.bytes.push_back(LF),
            _ => self.bytes.push_back(ACK),
        }
    }

    /// Adds a text that a board's program has sent, with its mark. No acknowledgement follows.
    pub fn text(&mut self, text: String, handshake: Handshake) {
        // The mark stands right before the text: a client that fetches line by line would take an unmarked text for a
        // reply.
        self.lines(&[format!("{}{text}", char::from(STX))], handshake);
    }

    /// Adds an error. No acknowledgement follows.
    pub fn error(&mut self, code: u16, handshake: Handshake) {
        self.bytes.push_back(BELL);
        if handshake.i6 & 1 == 0 {
            return;
        }
        if handshake.i6 == 3 {
            self.bytes.push_back(CR);
        }
        if handshake.i3 & 1 != 0 {
            self.bytes.push_back(LF);
        }
        self.bytes.extend(format!("ERR{code:03}\r").bytes());
    }

    /// The next reply or a part of it: up to an ACK or LF; an error or a program's text up to the next CR. At most
    /// [`REPLY_MAX`] bytes; a single 0 when nothing waits.
    pub fn take(&mut self) -> Vec<u8> {
        let mut found = None;
        let mut is_told = false;
        for (at, byte) in self.bytes.iter().enumerate().take(REPLY_MAX) {
            match *byte {
                BELL | STX => is_told = true,
                ACK => found = Some(at),
                // With I6=3 an error has a CR of its own first.
                CR if is_told && self.bytes.get(at.wrapping_sub(1)) != Some(&BELL) => found = Some(at),
                LF if !is_told => found = Some(at),
                _ => {}
            }
            if found.is_some() {
                break;
            }
        }
        self.cut(found)
    }

    /// The data lines without the frame of I3.
    pub fn into_lines(self) -> Vec<Vec<u8>> {
        let mut bytes = Vec::from(self.bytes);
        bytes.retain(|byte| ![LF, ACK].contains(byte));
        let mut lines: Vec<Vec<u8>> = bytes.split(|byte| *byte == CR).map(<[u8]>::to_vec).collect();
        // The last CR ends the last line; drop the empty piece behind it.
        lines.pop();
        lines
    }

    /// The next line: up to a CR, an ACK or an LF.
    pub fn take_line(&mut self) -> Vec<u8> {
        let found = self.bytes.iter().take(REPLY_MAX).position(|byte| [CR, ACK, LF].contains(byte));
        self.cut(found)
    }

    fn cut(&mut self, last: Option<usize>) -> Vec<u8> {
        if self.bytes.is_empty() {
            return vec![0];
        }
        let count = last.map_or(REPLY_MAX, |last| last + 1).min(self.bytes.len());
        let taken = self.bytes.drain(..count).collect();
        if self.bytes.is_empty() {
            // Frees the memory of a long reply.
            self.clear();
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(lines: &[&str]) -> Vec<String> {
        lines.iter().map(|line| (*line).to_owned()).collect()
    }

    fn handshake(i3: u32, i6: u32) -> Handshake {
        let mut handshake = Handshake::default();
        assert!(handshake.set(3, i3) && handshake.set(6, i6));
        handshake
    }

    #[test]
    fn a_text_is_fetched_with_its_mark_line_by_line_too() {
        let mut pending = Pending::default();
        pending.text("x".to_owned(), handshake(3, 1));
        assert_eq!((pending.take_line(), pending.take_line()), (b"\n".to_vec(), b"\x02x\r".to_vec()));
    }

    #[test]
    fn replies_have_the_form_of_the_clients_own_i3_and_i6() {
        // The rows of the Software Reference, pp. 22-25.
        for (i3, i6, good, bad) in [
            (0, 0, "25\r50\r", "\x07"),
            (1, 0, "\n25\r\n50\r\n", "\x07"),
            (2, 0, "25\r50\r\x06", "\x07"),
            (3, 0, "\n25\r\n50\r\x06", "\x07"),
            (0, 1, "25\r50\r", "\x07ERR003\r"),
            (2, 1, "25\r50\r\x06", "\x07ERR003\r"),
            (2, 3, "25\r50\r\x06", "\x07\rERR003\r"),
            (1, 1, "\n25\r\n50\r\n", "\x07\nERR003\r"),
            (2, 2, "25\r50\r\x06", "\x07"),
        ] {
            let handshake = handshake(i3, i6);
            let mut pending = Pending::default();
            pending.lines(&lines(&["25", "50"]), handshake);
            pending.end(handshake);
            let told: Vec<u8> = pending.bytes.drain(..).collect();
            assert_eq!(told, good.as_bytes(), "I3={i3}");
            pending.error(3, handshake);
            assert_eq!(pending.take(), bad.as_bytes(), "I3={i3} I6={i6}");
            assert_eq!(pending.take(), [0]);
        }
    }

    #[test]
    fn a_long_reply_comes_in_parts_of_1400_bytes() {
        let mut pending = Pending::default();
        pending.lines(&vec!["123456789".to_owned(); 300], Handshake::default());
        pending.end(Handshake::default());
        let parts: Vec<usize> = std::iter::from_fn(|| Some(pending.take().len())).take(4).collect();
        assert_eq!(parts, [1400, 1400, 201, 1]);
    }

    #[test]
    fn two_replies_are_fetched_one_after_the_other() {
        let mut pending = Pending::default();
        pending.lines(&lines(&["7"]), Handshake::default());
        pending.end(Handshake::default());
        pending.lines(&lines(&["1"]), Handshake::default());
        pending.error(3, Handshake::default());
        pending.end(Handshake::default());
        assert_eq!(pending.take(), b"7\r\x06");
        assert_eq!(pending.take_line(), b"1\r");
        assert_eq!(pending.take(), b"\x07ERR003\r");
        assert_eq!(pending.take(), b"\x06");
        assert!(pending.is_empty());
    }

    #[test]
    fn only_values_that_are_kept_are_taken() {
        let mut handshake = Handshake::default();
        for (number, value) in [(3, 4), (3, 256 + 2), (4, 1), (6, 4), (5, 0)] {
            assert!(!handshake.set(number, value), "I{number}={value}");
        }
        assert!(handshake.set(4, 0));
        assert_eq!((handshake.get(3), handshake.get(4), handshake.get(6)), (Some(2), Some(0), Some(1)));
        assert_eq!(handshake.get(5), None);
    }
}
