//! PMAC's half of the ASCII port, as far as a recording can play it. The replay answers a line that the recording
//! answers, and refuses any other line with an error without a number: silence would hold up the next line.

use std::collections::VecDeque;
use std::sync::Arc;

use super::differences::Differences;
use crate::format::TextOrder;
use crate::map::functions::{RESPONSE_BYTES, response};
use crate::map::{AsciiPort, HostOffset};
use crate::protocol::control;
use crate::protocol::control::CANCEL;
use crate::recording::{Answer, Replies};

/// The port, as PMAC sees it.
pub struct AsciiHalf {
    port: &'static AsciiPort,
    order: TextOrder,
    replies: Arc<Replies>,
    /// The first part of a line in two parts.
    part: Vec<u8>,
    /// The responses that wait for the response buffer: a control word and a text each.
    responses: VecDeque<(u16, String)>,
}

impl AsciiHalf {
    /// A port that answers from `replies`.
    pub fn new(port: &'static AsciiPort, order: TextOrder, replies: Arc<Replies>) -> Self {
        Self { port, order, replies, part: Vec::new(), responses: VecDeque::new() }
    }

    /// Clears the port's words.
    pub fn clear(&self, window: &mut [u16]) {
        for word in [self.port.command_loaded.word, self.port.control_character, self.port.response_control] {
            put(window, word, 0);
        }
    }

    /// The host has written the word at `offset`. Returns whether the host has asked a question.
    pub fn written(&mut self, window: &mut [u16], offset: HostOffset, differences: &mut Differences) -> bool {
        let port = self.port;
        let mut has_asked = true;
        let value = get(window, offset);
        if offset == port.command_loaded.word && port.command_loaded.is_set(value) {
            put(window, offset, value & !port.command_loaded.mask);
            self.take_line(window, differences);
        } else if offset == port.control_character && value != 0 {
            put(window, offset, 0);
            self.take_character(value.to_le_bytes()[0]);
        } else if offset == port.response_control && value == 0 {
            has_asked = false;
        } else {
            return false;
        }
        self.respond(window);
        has_asked
    }

    fn take_line(&mut self, window: &[u16], differences: &mut Differences) {
        let bytes = self.port.command_bytes;
        let text: Vec<u8> = (0..bytes / 2)
            .flat_map(|word| self.order.unpack(get(window, self.port.command.plus_words(word))))
            .collect();
        let end = text.iter().position(|byte| *byte == 0);
        // The last byte of a first part is no character, but not NUL (DPRAM manual p. 28).
        self.part.extend(&text[..end.unwrap_or(bytes - 1)]);
        if end.is_none() && self.part.len() <= self.port.line_limit {
            return;
        }
        let line = String::from_utf8_lossy(&std::mem::take(&mut self.part)).into_owned();
        let answer = if line.trim().is_empty() {
            Answer { line, reply: Vec::new(), refused: None }
        } else {
            self.answer(line.trim(), differences)
        };
        self.responses.extend(answer.reply.into_iter().map(|line| (response::LINE, line)));
        // The last transmission is an `<ACK>` (p. 29), so that the host does not wait for one in vain.
        let refused = answer.refused.map(|why| response::ERROR | error_digits(&why));
        self.responses
            .extend(refused.into_iter().chain([response::ACKNOWLEDGE]).map(|end| (end, String::new())));
    }

    /// At its start the driver asks by `^F` whether the board listens, and a recording begins later. So the replay
    /// acknowledges a character without an answer, and does not count it as a difference.
    fn take_character(&mut self, character: u8) {
        if character == CANCEL {
            self.part.clear();
            self.responses.clear();
            return;
        }
        let answer = self.replies.to(&control::name(character));
        let lines = answer.map_or_else(Vec::new, |answer| answer.reply);
        self.responses.extend(lines.into_iter().map(|line| (response::LINE, line)));
        self.responses.push_back((response::ACKNOWLEDGE, String::new()));
    }

    fn answer(&self, line: &str, differences: &mut Differences) -> Answer {
        self.replies.to(line).unwrap_or_else(|| {
            differences.asked(line);
            Answer { line: line.to_owned(), reply: Vec::new(), refused: Some(String::new()) }
        })
    }

    /// Puts the next response into the buffer if the buffer is empty: data before flag.
    fn respond(&mut self, window: &mut [u16]) {
        if get(window, self.port.response_control) != 0 {
            return;
        }
        let Some((control, text)) = self.responses.pop_front() else { return };
        if control == response::LINE {
            let mut bytes: Vec<u8> = text.bytes().take(RESPONSE_BYTES - 2).collect();
            bytes.push(0);
            put(window, self.port.response_count, bytes.len() as u16);
            for (word, pair) in bytes.chunks(2).enumerate() {
                let [first, second] = [pair[0], pair.get(1).copied().unwrap_or(0)];
                put(window, self.port.response.plus_words(word), self.order.pack(first, second));
            }
        }
        put(window, self.port.response_control, control);
    }
}

/// The three digits of `ERRnnn`, as the control word has them; 0 without digits.
fn error_digits(why: &str) -> u16 {
    let digits = why.split_once("ERR").and_then(|(_, rest)| rest.get(..3));
    digits.and_then(|digits| u16::from_str_radix(digits, 16).ok()).unwrap_or(0)
}

fn get(window: &[u16], offset: HostOffset) -> u16 {
    window.get(offset.word()).copied().unwrap_or(0)
}

fn put(window: &mut [u16], offset: HostOffset, value: u16) {
    if let Some(word) = window.get_mut(offset.word()) {
        *word = value;
    }
}
