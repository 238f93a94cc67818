//! What programs say and ask: `SEND` and `CMD` (Software Reference pp. 305-308).
//!
//! Both go to the active response port. A command is carried out in the background; its data come back unasked for,
//! without a closing acknowledgement.

use super::Request;
use crate::map::classic::{RESPONSE_MESSAGE, RESPONSE_TO_PROGRAM};
use crate::sim::board::{Board, Port};
use crate::sim::language::{Interpreter, Reply};

/// The tag before what goes out unasked for, with I64=1.
const TAG: u8 = 2;
const BELL: u8 = 7;

impl Board {
    /// `SEND"text"`.
    pub fn send_message(&mut self, text: &str) {
        match self.response_port() {
            Port::Dpram => self.ascii.push(RESPONSE_MESSAGE, text.as_bytes()),
            port => {
                let line = self.unasked_line(text, self.variables.i(62) == 1.0);
                self.transmit(port, &line);
            }
        }
    }

    /// Carries out what programs have asked for, one request a call.
    pub(in crate::sim) fn serve_requests(&mut self) {
        let reply = match self.programs.requests.pop_front() {
            Some(Request::Line(text, motor, cs)) => {
                Interpreter::addressing(motor, cs).execute(self, text.as_bytes())
            }
            Some(Request::Character(code)) => Interpreter::new().control(self, code).unwrap_or_default(),
            None => return,
        };
        self.report_to_port(reply);
    }

    /// `CMD"text"` as from a program, at once.
    pub fn command_message(&mut self, text: &str) {
        let reply = Interpreter::new().execute(self, text.as_bytes());
        self.report_to_port(reply);
    }

    fn report_to_port(&mut self, reply: Reply) {
        match self.response_port() {
            Port::Dpram => {
                for line in reply.lines {
                    self.ascii.push(RESPONSE_TO_PROGRAM, line.as_bytes());
                }
                if let Some(error) = reply.error {
                    self.ascii.push_error(error);
                }
            }
            port => {
                let mut bytes: Vec<u8> =
                    reply.lines.iter().flat_map(|line| self.unasked_line(line, false)).collect();
                // I6=0 and 1 report a program's errors too, I6=2 and 3 only a host's.
                if reply.error.is_some() && self.variables.i(6) < 2.0 {
                    bytes.push(BELL);
                }
                self.transmit(port, &bytes);
            }
        }
    }

    /// Bytes to the mailboxes, or to the serial port.
    fn transmit(&mut self, port: Port, bytes: &[u8]) {
        /// What nobody fetches is lost from here on.
        const MOST: usize = 65_536;
        match &mut self.mailbox {
            Some(mailbox) if port == Port::Mailbox => mailbox.push(bytes),
            _ if self.serial_output.len() < MOST => self.serial_output.extend_from_slice(bytes),
            _ => {}
        }
    }

    /// A line as a port sends it unasked: `^B` before it with I64=1, `<LF>` if I3 is odd, `<CR>` after it.
    fn unasked_line(&self, text: &str, without_return: bool) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(text.len() + 3);
        bytes.extend((self.variables.i(64) == 1.0).then_some(TAG));
        bytes.extend((self.variables.i(3) as u32 & 1 == 1).then_some(b'\n'));
        bytes.extend_from_slice(text.as_bytes());
        bytes.extend((!without_return).then_some(b'\r'));
        bytes
    }
}
