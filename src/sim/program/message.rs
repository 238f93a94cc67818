//! `SEND` of programs (Software Reference pp. 305-308), and the port for the answer to their `CMD`.
//!
//! A PMAC sends both to the active response port, and so does a Turbo board with a `SEND`; it sends the answer to a
//! `CMD` nowhere. A letter after either word names a port: S the serial port, P the bus, R the DPRAM, A the auxiliary
//! serial port (Turbo Software Reference pp. 421 and 471).

use crate::map::Generation;
use crate::map::functions::response;
use crate::sim::board::Board;
use crate::sim::board::output::Port;
use crate::sim::program::item::Message;

/// The tag before an unsolicited line, and in place of the `<BELL>` of a program's error, with I64=1 (Turbo Software
/// Reference p. 67).
const TAG: u8 = 2;
const BELL: u8 = 7;

/// The letters of ports.
pub const PORT_LETTERS: &[u8] = b"SPRA";

/// Where a message, or the answer to a program's command, goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlet {
    /// To the active response port.
    Active,
    /// To the port of this letter.
    Letter(u8),
    /// Nowhere.
    Nowhere,
}

impl Outlet {
    /// Of `SEND` with this letter, or none.
    #[must_use]
    pub fn of_message(letter: Option<u8>) -> Self {
        letter.map_or(Self::Active, Self::Letter)
    }

    /// Of `CMD` with this letter, or none.
    #[must_use]
    pub fn of_command(letter: Option<u8>, board: &Board) -> Self {
        match board.family().generation {
            Generation::Turbo if letter.is_none() => Self::Nowhere,
            _ => Self::of_message(letter),
        }
    }

    /// The port; `None` where the board has no such port. No simulated board has an auxiliary serial port; the only
    /// bus port of a simulated board is its mailboxes.
    #[must_use]
    pub fn port(self, board: &Board) -> Option<Port> {
        match self {
            Self::Active => Some(board.response_port()),
            Self::Letter(b'S') => Some(Port::Serial),
            Self::Letter(b'R') => Some(Port::Dpram),
            Self::Letter(b'P') if board.is_vme() => Some(Port::Mailbox),
            Self::Letter(_) | Self::Nowhere => None,
        }
    }
}

/// `SEND`, from a program or the control socket. A control character goes bare (Turbo Software Reference p. 471).
pub fn send(board: &mut Board, message: &Message, outlet: Outlet) {
    let (text, line) = match message {
        Message::Text(text) => {
            (text.as_bytes().to_vec(), unasked_line(board, text, board.variables.i(62) == 1.0))
        }
        Message::Character(code) => (vec![*code], vec![*code]),
    };
    match outlet.port(board) {
        None => {}
        Some(Port::Dpram) if !board.output.admits() => {}
        Some(Port::Dpram) => board.output.respond(response::MESSAGE, text),
        Some(port) => board.output.send(port, &line),
    }
}

/// An unsolicited line as a port sends it: `^B` before it with I64=1, `<LF>` if I3 is odd, `<CR>` after it.
pub fn unasked_line(board: &Board, text: &str, without_return: bool) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len() + 3);
    bytes.extend(is_tagged(board).then_some(TAG));
    bytes.extend((board.variables.i(3) as u32 & 1 == 1).then_some(b'\n'));
    bytes.extend_from_slice(text.as_bytes());
    bytes.extend((!without_return).then_some(b'\r'));
    bytes
}

/// The character that tells of a program's error.
#[must_use]
pub fn error_mark(board: &Board) -> u8 {
    if is_tagged(board) { TAG } else { BELL }
}

fn is_tagged(board: &Board) -> bool {
    board.variables.i(64) == 1.0
}
