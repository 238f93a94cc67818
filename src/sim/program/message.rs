//! `SEND` of programs (Software Reference pp. 305-308): a message to the active response port.

use crate::map::functions::response;
use crate::sim::board::Board;
use crate::sim::board::output::Port;

/// The tag before an unsolicited line, with I64=1.
const TAG: u8 = 2;

/// `SEND"text"`, from a program or the control socket.
pub fn send_message(board: &mut Board, text: &str) {
    match board.response_port() {
        Port::Dpram => board.output.respond(response::MESSAGE, text.as_bytes()),
        port => {
            let line = unasked_line(board, text, board.variables.i(62) == 1.0);
            board.output.send(port, &line);
        }
    }
}

/// An unsolicited line as a port sends it: `^B` before it with I64=1, `<LF>` if I3 is odd, `<CR>` after it.
pub fn unasked_line(board: &Board, text: &str, without_return: bool) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len() + 3);
    bytes.extend((board.variables.i(64) == 1.0).then_some(TAG));
    bytes.extend((board.variables.i(3) as u32 & 1 == 1).then_some(b'\n'));
    bytes.extend_from_slice(text.as_bytes());
    bytes.extend((!without_return).then_some(b'\r'));
    bytes
}
