//! What waits to be sent at each port, until the port's function puts it where the host finds it.

use std::collections::VecDeque;

use super::error::CommandError;
use crate::map::functions::{RESPONSE_BYTES, response};

/// Responses kept for a host that does not fetch them; then the oldest program's messages would be lost, so new ones are.
const MOST_RESPONSES: usize = 4096;
/// Bytes kept at the serial port, which a process that serves no serial port never fetches, and at the mailboxes.
const MOST_BYTES: usize = 65_536;
/// The most characters that one response of the DPRAM can have, without its NUL.
const MOST_CHARACTERS: usize = RESPONSE_BYTES - 1;

/// The port that responses not asked for go to.
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

/// What waits at each port.
#[derive(Debug, Clone, Default)]
pub struct Output {
    /// For the DPRAM.
    pub dpram: VecDeque<Response>,
    /// For the mailboxes.
    pub mailbox: VecDeque<u8>,
    /// For the serial port: what was not asked for.
    pub serial: Vec<u8>,
    /// How often everything was dropped (`<CTRL-X>`, reset).
    pub cancelled: u64,
}

impl Output {
    /// Queues a response for the DPRAM. A line longer than the buffer is cut.
    pub fn respond(&mut self, control: u16, text: &[u8]) {
        if self.dpram.len() < MOST_RESPONSES {
            let length = text.len().min(MOST_CHARACTERS);
            self.dpram.push_back(Response { control, text: text[..length].to_vec() });
        }
    }

    /// Queues the error's control word for the DPRAM.
    pub fn respond_error(&mut self, error: CommandError) {
        let code = error.0;
        let digits = (code / 100 % 10) << 8 | (code / 10 % 10) << 4 | (code % 10);
        self.respond(response::ERROR | digits, &[]);
    }

    /// Queues bytes for the mailboxes or the serial port.
    pub fn send(&mut self, port: Port, bytes: &[u8]) {
        match port {
            Port::Mailbox if self.mailbox.len() < MOST_BYTES => self.mailbox.extend(bytes),
            Port::Serial if self.serial.len() < MOST_BYTES => self.serial.extend_from_slice(bytes),
            _ => {}
        }
    }

    /// Drops what the DPRAM and the mailboxes have to say.
    pub fn cancel(&mut self) {
        self.dpram.clear();
        self.mailbox.clear();
        self.cancelled += 1;
    }
}
