//! A client's own copy of the DPRAM words that carry command lines and responses.
//!
//! A board has one such port for all hosts. Here each client has words of his own: the client writes a line and sets
//! its flag, and the gateway takes the line as the board would. The gateway writes the responses one by one, each after
//! the client has cleared the control word of the one before (Turbo User Manual p. 422, DPRAM manual pp. 25-29).

use std::collections::VecDeque;

use pmac_dpram::language::LINE_MAX;
use pmac_dpram::map::HostOffset;
use pmac_dpram::map::functions::{AsciiPort, RESPONSE_BYTES, response};

/// Unfetched responses. Beyond this number the gateway takes no further line and drops the reports of control
/// characters.
const WAITING_MAX: usize = 64;

/// The end of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Reply {
    /// The lines of data.
    pub(crate) lines: Vec<Vec<u8>>,
    /// The error number in place of the acknowledgement.
    pub(crate) error: Option<u16>,
}

/// A client's own words.
#[derive(Debug)]
pub(crate) struct Window {
    port: &'static AsciiPort,
    bytes: Vec<u8>,
    /// The first part of a line that is longer than the buffer.
    first_part: Vec<u8>,
    /// Responses for the client not written yet: control word and text.
    waiting: VecDeque<(u16, Vec<u8>)>,
}

impl Window {
    /// The words of `port`, all 0.
    pub(crate) fn new(port: &'static AsciiPort) -> Self {
        let length = port.response.bytes() - port.command_loaded.word.bytes();
        let bytes = vec![0; length as usize + RESPONSE_BYTES];
        Self { port, bytes, first_part: Vec::new(), waiting: VecDeque::new() }
    }

    /// The index of the byte at `offset`; outside the window, an index beyond the bytes.
    fn index(&self, offset: u32) -> usize {
        offset.checked_sub(self.port.command_loaded.word.bytes()).map_or(usize::MAX, |index| index as usize)
    }

    /// The byte at `offset`; `None` outside the window.
    pub(crate) fn byte(&mut self, offset: u32) -> Option<&mut u8> {
        let index = self.index(offset);
        self.bytes.get_mut(index)
    }

    /// The word at `place`, low byte first.
    fn word(&mut self, place: HostOffset) -> u16 {
        let mut byte = |at| self.byte(place.bytes() + at).map_or(0, |byte| *byte);
        u16::from_le_bytes([byte(0), byte(1)])
    }

    fn set_word(&mut self, place: HostOffset, value: u16) {
        self.write(place, &value.to_le_bytes());
    }

    fn write(&mut self, place: HostOffset, bytes: &[u8]) {
        for (offset, byte) in (place.bytes()..).zip(bytes) {
            if let Some(place) = self.byte(offset) {
                *place = *byte;
            }
        }
    }

    /// Takes the client's control character, if any, and clears its word.
    pub(crate) fn take_control(&mut self) -> Option<u8> {
        let [character, _] = self.word(self.port.control_character).to_le_bytes();
        if character != 0 {
            self.set_word(self.port.control_character, 0);
        }
        (character != 0).then_some(character)
    }

    /// Takes the line whose flag the client has set, and clears the flag. The first part of a line in two parts gives
    /// nothing yet.
    pub(crate) fn take_line(&mut self) -> Option<Vec<u8>> {
        let flag = self.port.command_loaded;
        let loaded = self.word(flag.word);
        if loaded & flag.mask == 0 || self.waiting.len() > WAITING_MAX {
            return None;
        }
        self.set_word(flag.word, loaded & !flag.mask);
        let command = self.index(self.port.command.bytes());
        let text = self.bytes.get(command..command + self.port.command_bytes)?;
        let end = text.iter().position(|byte| *byte == 0);
        // The last byte of a first part only says that a second part follows.
        let text = text[..end.unwrap_or(text.len() - 1)].to_vec();
        let is_first = end.is_none() && self.first_part.is_empty();
        self.first_part.extend(text);
        if is_first {
            return None;
        }
        let line = std::mem::take(&mut self.first_part);
        if line.len() > LINE_MAX {
            self.respond(Reply { lines: Vec::new(), error: Some(crate::board::NO_ROOM) });
            return None;
        }
        Some(line)
    }

    /// Adds `reply` behind the waiting responses.
    pub(crate) fn respond(&mut self, reply: Reply) {
        self.waiting.extend(reply.lines.into_iter().map(|line| (response::LINE, line)));
        let digits = |number: u16| number / 100 % 10 * 256 + number / 10 % 10 * 16 + number % 10;
        let end = reply.error.map_or(response::ACKNOWLEDGE, |number| response::ERROR | digits(number));
        self.waiting.push_back((end, Vec::new()));
    }

    /// Adds the report of a control character, if it has one and there is room.
    pub(crate) fn report(&mut self, lines: Vec<String>) {
        if !lines.is_empty() && self.waiting.len() <= WAITING_MAX {
            let lines = lines.into_iter().map(String::into_bytes).collect();
            self.respond(Reply { lines, error: None });
        }
    }

    /// Writes the next response, if the client has cleared the last one's control word: text, count and control word.
    pub(crate) fn put(&mut self) {
        if self.word(self.port.response_control) != 0 {
            return;
        }
        let Some((control, mut text)) = self.waiting.pop_front() else { return };
        text.truncate(RESPONSE_BYTES - 1);
        // The count includes the NUL.
        text.push(0);
        self.write(self.port.response, &text);
        self.set_word(self.port.response_count, u16::try_from(text.len()).unwrap_or(u16::MAX));
        self.set_word(self.port.response_control, control);
    }

    /// Does what `<CTRL-X>` does: drops the waiting responses and clears the control words.
    pub(crate) fn cancel(&mut self) {
        self.waiting.clear();
        self.first_part.clear();
        self.set_word(self.port.command_loaded.word, 0);
        self.set_word(self.port.response_control, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pmac_dpram::map::Family;

    fn windows() -> [Window; 2] {
        ["pmac", "turbo2"].map(|family| Window::new(&Family::by_name(family).unwrap().ascii))
    }

    fn load(window: &mut Window, line: &[u8]) {
        window.write(window.port.command, line);
        window.set_word(window.port.command_loaded.word, 1);
    }

    #[test]
    fn a_response_waits_until_the_word_of_the_last_is_cleared() {
        for mut window in windows() {
            let lines = vec![b"25".to_vec(), vec![b'x'; 300]];
            window.respond(Reply { lines, error: Some(12) });
            let mut seen = Vec::new();
            for _ in 0..3 {
                window.put();
                window.put();
                let port = window.port;
                seen.push((window.word(port.response_control), window.word(port.response_count)));
                window.set_word(port.response_control, 0);
            }
            assert_eq!(seen, [(0x0D, 3), (0x0D, 256), (0x8012, 1)]);
        }
    }

    #[test]
    fn a_line_is_taken_once_when_its_flag_is_set() {
        for mut window in windows() {
            window.write(window.port.command, b"P1\0");
            assert_eq!(window.take_line(), None);
            load(&mut window, b"P1=5\0");
            assert_eq!((window.take_line(), window.take_line()), (Some(b"P1=5".to_vec()), None));
            // Longer than the buffer, so in two parts; then a line that is too long.
            load(&mut window, &[b'1'; 160]);
            assert_eq!(window.take_line(), None);
            load(&mut window, b"+2\0");
            assert_eq!(window.take_line().map(|line| line.len()), Some(161));
            for part in [&[b'1'; 160][..], &[b'1'; 50]] {
                load(&mut window, part);
                assert_eq!(window.take_line(), None);
            }
            window.put();
            assert_eq!(window.word(window.port.response_control), 0x8006);
        }
    }

    #[test]
    fn a_cancel_clears_the_control_words_and_what_waits() {
        for mut window in windows() {
            window.report(vec!["1".to_owned()]);
            window.put();
            load(&mut window, b"P1\0");
            window.set_word(window.port.control_character, 0x18);
            assert_eq!((window.take_control(), window.take_control()), (Some(0x18), None));
            window.cancel();
            window.put();
            assert_eq!((window.take_line(), window.word(window.port.response_control)), (None, 0));
        }
    }
}
