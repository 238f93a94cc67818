//! Text that waits at each port, until the port's function puts it where the host finds it.

use std::collections::VecDeque;

use super::error::CommandError;
use crate::map::functions::{RESPONSE_BYTES, response};

/// Responses kept for a host that does not fetch them. At this number the board takes no further line, and loses the
/// words of programs and the reports of control characters. The reply to a line that the board took is whole, however
/// long: the board waits until the host has fetched it. A DPRAM line of 200 characters can list 41 301 words of
/// programs 18 times: some 60 MB.
const MOST_RESPONSES: usize = 4096;
/// Bytes kept at the serial port, which a process that serves no serial port never fetches, and at the mailboxes.
const MOST_BYTES: usize = 65_536;
/// The most characters that one response of the DPRAM can have, without its NUL.
const MOST_CHARACTERS: usize = RESPONSE_BYTES - 1;

/// The port for responses that no command asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Port {
    /// The serial port.
    Serial,
    /// The DPRAM.
    Dpram,
    /// The VME mailboxes.
    Mailbox,
}

/// One filling of the DPRAM's response buffer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    /// The control word.
    pub control: u16,
    /// The characters, without NUL.
    pub text: Vec<u8>,
}

/// The text that waits at each port.
#[derive(Debug, Clone, Default)]
pub struct Output {
    /// For the DPRAM.
    pub dpram: VecDeque<Response>,
    /// For the mailboxes.
    pub mailbox: VecDeque<u8>,
    /// Unasked text for the serial port.
    pub serial: Vec<u8>,
    /// How many replies and messages found no room at the DPRAM and were lost.
    pub lost: u64,
    /// The lines of the last reply to a line of the DPRAM: later text waits behind the reply while the host fetches it.
    pub asked: usize,
    /// How often everything was dropped (`<CTRL-X>`, reset).
    pub cancelled: u64,
}

impl Output {
    /// Whether the DPRAM has room for the reply to a further line.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.dpram.len() < MOST_RESPONSES
    }

    /// Whether the DPRAM has room for text that cannot wait: a program's words, the report of a control character. If
    /// not, the board loses all of that text, and counts the loss.
    pub fn admits(&mut self) -> bool {
        let admits = self.dpram.len() < MOST_RESPONSES + self.asked;
        self.lost += u64::from(!admits);
        admits
    }

    /// Queues a response for the DPRAM. A line longer than the buffer is cut.
    pub fn respond(&mut self, control: u16, text: impl Into<Vec<u8>>) {
        let mut text = text.into();
        text.truncate(MOST_CHARACTERS);
        self.dpram.push_back(Response { control, text });
    }

    /// Queues the error's control word for the DPRAM.
    pub fn respond_error(&mut self, error: CommandError) {
        let code = error.0;
        let digits = (code / 100 % 10) << 8 | (code / 10 % 10) << 4 | (code % 10);
        self.respond(response::ERROR | digits, []);
    }

    /// Queues bytes for the mailboxes or the serial port.
    pub fn send(&mut self, port: Port, bytes: &[u8]) {
        match port {
            Port::Mailbox if self.mailbox.len() < MOST_BYTES => self.mailbox.extend(bytes),
            Port::Serial if self.serial.len() < MOST_BYTES => self.serial.extend_from_slice(bytes),
            _ => {}
        }
    }

    /// Drops the text that waits at the DPRAM and the mailboxes.
    pub fn cancel(&mut self) {
        // Gives back the room of a long reply.
        (self.dpram, self.asked) = (VecDeque::new(), 0);
        self.mailbox.clear();
        self.cancelled += 1;
    }
}
