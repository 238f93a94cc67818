//! The serial port as a stream of raw bytes: line collection, line editing, and the handshake around replies.
//!
//! I3 chooses the characters around data and the acknowledgement, I4 adds checksum bytes, I6 the error text (Software
//! Reference p. 22-25). The board reads all three when it sends the reply, so it acknowledges `I3=2` in the new form.

use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::variables::Variables;
use crate::sim::language::control::{TAKE, binary_report, control, dpram_line};
use crate::sim::language::interpreter::Interpreter;
use crate::sim::language::reply::{LONGEST_LINE, Reply};
use crate::sim::program::Programs;

const ACK: u8 = 0x06;
const BELL: u8 = 0x07;
const LF: u8 = b'\n';
const CR: u8 = b'\r';

const BACKSPACE: u8 = control(b'H');
const REPEAT: u8 = control(b'I');
const CHECKSUM: u8 = control(b'N');
const CANCEL: u8 = control(b'X');
const LAST_LINE: u8 = control(b'Y');

/// The handshake in force: I3, I4 and I6.
#[derive(Debug, Clone, Copy)]
struct Handshake {
    line_feeds: bool,
    acknowledge: bool,
    checksum: bool,
    error_text: bool,
    error_return: bool,
}

impl Handshake {
    fn of(variables: &Variables) -> Self {
        let bit = |number, mask| variables.i_integer(number) & mask != 0;
        Self {
            line_feeds: bit(3, 1),
            acknowledge: bit(3, 2),
            checksum: bit(4, 1),
            error_text: bit(6, 1),
            error_return: bit(6, 1) && bit(6, 2),
        }
    }

    fn data(self, lines: &[String], out: &mut Vec<u8>) {
        for line in lines {
            if self.line_feeds {
                out.push(LF);
            }
            out.extend_from_slice(line.as_bytes());
            out.push(CR);
            if self.checksum {
                out.push(sum(line.as_bytes()));
            }
        }
    }

    fn error(self, error: CommandError, out: &mut Vec<u8>) {
        out.push(BELL);
        if !self.error_text {
            return;
        }
        if self.error_return {
            out.push(CR);
        }
        if self.line_feeds {
            out.push(LF);
        }
        out.extend_from_slice(error.to_string().as_bytes());
        out.push(CR);
    }

    fn acknowledgement(self, command: &[u8], out: &mut Vec<u8>) {
        if self.acknowledge {
            out.push(ACK);
        } else if self.line_feeds {
            out.push(LF);
        }
        if self.checksum {
            out.push(sum(command));
        }
    }
}

/// The sum of the characters, modulo 256, which I4 and ^N report.
fn sum(text: &[u8]) -> u8 {
    text.iter().fold(0, |sum, character| sum.wrapping_add(*character))
}

/// The board's end of a serial line.
#[derive(Debug, Clone, Default)]
pub struct SerialPort {
    line: Vec<u8>,
    last_line: Vec<u8>,
}

impl SerialPort {
    /// A port that has received nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one byte from the host and appends the board's answer to `out`.
    ///
    /// PMAC and PMAC2 have one addressing for all ports: give each port the same `interpreter`. The port ignores line
    /// feeds and NULs. It keeps only the start of a line that is too long, and answers that line with an error.
    pub fn receive(
        &mut self,
        board: &mut Board,
        programs: &mut Programs,
        interpreter: &mut Interpreter,
        byte: u8,
        out: &mut Vec<u8>,
    ) {
        match byte {
            CR => {
                self.last_line = std::mem::take(&mut self.line);
                self.enter(board, programs, interpreter, out);
            }
            REPEAT => self.enter(board, programs, interpreter, out),
            BACKSPACE => {
                self.line.pop();
            }
            CHECKSUM => out.push(sum(&self.line)),
            CANCEL => {
                self.line.clear();
                interpreter.control(board, programs, CANCEL);
                if board.variables.i_integer(63) != 0 {
                    out.push(CANCEL);
                }
            }
            LAST_LINE => {
                let text = String::from_utf8_lossy(&self.last_line).into_owned();
                report(board, &Reply { lines: vec![text], error: None }, out);
            }
            TAKE => {
                if let Some(line) = dpram_line(board) {
                    Self::carry_out(&line, board, programs, interpreter, out);
                }
            }
            0..b' ' => {
                if let Some(bytes) = binary_report(board, byte) {
                    out.extend_from_slice(&bytes);
                } else if let Some(reply) = interpreter.control(board, programs, byte) {
                    report(board, &reply, out);
                }
            }
            _ if self.line.len() <= LONGEST_LINE => self.line.push(byte),
            _ => {}
        }
    }

    /// Executes the line just entered and sends its reply.
    fn enter(
        &self,
        board: &mut Board,
        programs: &mut Programs,
        interpreter: &mut Interpreter,
        out: &mut Vec<u8>,
    ) {
        Self::carry_out(&self.last_line, board, programs, interpreter, out);
    }

    fn carry_out(
        line: &[u8],
        board: &mut Board,
        programs: &mut Programs,
        interpreter: &mut Interpreter,
        out: &mut Vec<u8>,
    ) {
        let reply = interpreter.execute(board, programs, line);
        let handshake = Handshake::of(&board.variables);
        handshake.data(&reply.lines, out);
        match reply.error {
            Some(error) => handshake.error(error, out),
            None => handshake.acknowledgement(line, out),
        }
    }
}

/// Sends the answer to a control character: data as for a line, and an `<ACK>` only after data and where I3 requires
/// it.
fn report(board: &Board, reply: &Reply, out: &mut Vec<u8>) {
    let handshake = Handshake::of(&board.variables);
    handshake.data(&reply.lines, out);
    match reply.error {
        Some(error) => handshake.error(error, out),
        None if handshake.acknowledge && !reply.lines.is_empty() => out.push(ACK),
        None => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::HostOffset;
    use crate::sim::testing;

    struct Rig {
        board: Board,
        programs: Programs,
        interpreter: Interpreter,
        port: SerialPort,
    }

    impl Rig {
        fn new() -> Self {
            let mut rig = Self {
                board: testing::board(),
                programs: Programs::new(8),
                interpreter: Interpreter::new(),
                port: SerialPort::new(),
            };
            rig.send(b"I3=2 I6=1\r");
            rig
        }

        fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
            let mut out = Vec::new();
            for &byte in bytes {
                self.port.receive(&mut self.board, &mut self.programs, &mut self.interpreter, byte, &mut out);
            }
            out
        }
    }

    #[test]
    fn backspace_removes_and_line_feeds_vanish() {
        let mut rig = Rig::new();
        assert_eq!(rig.send(b"P1=22\x08\x087\r\nP\n1\r"), b"\x067\r\x06");
    }

    #[test]
    fn data_comes_before_the_error_and_nothing_after_it() {
        let mut rig = Rig::new();
        assert_eq!(rig.send(b"P1=3 P1 P2 #99 P3=5\r"), b"3\r0\r\x07ERR003\r");
        assert_eq!(rig.send(b"P3\r"), b"0\r\x06");
    }

    #[test]
    fn checksums_follow_lines_and_handshake() {
        let mut rig = Rig::new();
        rig.send(b"I4=1\r");
        let command = b"P1..2".iter().fold(0u8, |sum, c| sum.wrapping_add(*c));
        assert_eq!(rig.send(b"P1..2\r"), [b'0', CR, b'0', b'0', CR, b'0', ACK, command]);
    }

    #[test]
    fn cancel_empties_the_line_and_echoes_if_asked() {
        let mut rig = Rig::new();
        assert_eq!(rig.send(b"UUU\x18\r"), b"\x06");
        rig.send(b"I63=1\r");
        assert_eq!(rig.send(b"\x18"), b"\x18");
    }

    #[test]
    fn the_last_line_repeats_and_is_reported() {
        let mut rig = Rig::new();
        rig.send(b"P1=P1+1\r");
        assert_eq!(rig.send(b"\t\t"), b"\x06\x06");
        assert_eq!(rig.send(b"\x19"), b"P1=P1+1\r\x06");
        assert_eq!(rig.send(b"P1\r"), b"3\r\x06");
    }

    #[test]
    fn characters_above_127_and_long_lines_are_refused_whole() {
        let mut rig = Rig::new();
        assert_eq!(rig.send(b"P1=5 \xE4\r"), b"\x07ERR004\r");
        assert_eq!(rig.send(b"P1\r"), b"0\r\x06");
        let mut line = b"P1=5".to_vec();
        line.resize(255, b' ');
        line.push(b'\r');
        assert_eq!(rig.send(&line), b"\x06");
        line.insert(0, b' ');
        assert_eq!(rig.send(&line), b"\x07ERR003\r");
        line.splice(0..0, [b' '; 1000]);
        assert_eq!(rig.send(&line), b"\x07ERR003\r");
    }

    #[test]
    fn control_reports_of_all_motors() {
        let mut rig = Rig::new();
        assert_eq!(rig.send(b"\x10"), b"0 0 0 0 0 0 0 0\r\x06");
        rig.send(b"I3=1\r");
        assert_eq!(rig.send(b"\x16"), b"\n0 0 0 0 0 0 0 0\r");
        let status = rig.send(b"\x02");
        assert_eq!(status.len(), 1 + 8 * 12 + 7 + 1);
        assert_eq!(rig.send(b"\x15"), b"\x07\nERR003\r", "no rotary buffer to open");
        assert_eq!(rig.send(b"\x0c\x01\x0b\x0f"), b"");
    }

    #[test]
    fn a_line_from_the_dpram_and_binary_reports() {
        let mut rig = Rig::new();
        for (index, pair) in b"I3 #99\r\0".chunks(2).enumerate() {
            let word = u16::from_le_bytes([pair[0], pair[1]]);
            rig.board.memory.dpram.write16(HostOffset::new(0x0C00).plus_words(index), word);
        }
        rig.send(b"I47=$D300\r");
        assert_eq!(rig.send(b"P1\x17=5\r"), b"2\r\x07ERR003\r\x06", "the line under way goes on");
        rig.send(b"I20=5 I21=$400003 I23=$80002B WX$3,$123456 WL$2B,$112233445566\r");
        assert_eq!(rig.send(b"\x05"), b"\x12\x34\x56\x44\x55\x66\x11\x22\x33");
        rig.send(b"WY$3,$010203\r");
        assert_eq!(rig.send(b"\x07"), b"\x12\x34\x56\x01\x02\x03");
    }
}
