//! `CMD` of programs (Software Reference pp. 305-308): command lines that a program sends to the board.
//!
//! The board carries them out in the background, one a pass, and sends the data without a closing acknowledgement.

use crate::map::functions::response;
use crate::sim::board::Board;
use crate::sim::board::output::Port;
use crate::sim::language::{Interpreter, Reply};
use crate::sim::program::message::{Outlet, error_mark, unasked_line};
use crate::sim::program::{Programs, Request};

/// Carries out the oldest request of a program.
pub fn poll(board: &mut Board, programs: &mut Programs) {
    let (reply, outlet) = match programs.take_request() {
        Some(Request::Line { text, motor, cs, outlet }) => {
            (Interpreter::addressing(motor, cs).execute(board, programs, text.as_bytes()), outlet)
        }
        Some(Request::Character(code, outlet)) => {
            (Interpreter::new().control(board, programs, code).unwrap_or_default(), outlet)
        }
        None => return,
    };
    report(board, reply, outlet);
}

/// `CMD"text"` as from a program, at once; the answer goes to the active response port.
pub fn command(board: &mut Board, programs: &mut Programs, text: &str) {
    let reply = Interpreter::new().execute(board, programs, text.as_bytes());
    report(board, reply, Outlet::Active);
}

fn report(board: &mut Board, reply: Reply, outlet: Outlet) {
    match outlet.port(board) {
        None => {}
        Some(Port::Dpram) if reply.lines.is_empty() && reply.error.is_none() || !board.output.admits() => {}
        Some(Port::Dpram) => {
            for line in reply.lines {
                board.output.respond(response::TO_PROGRAM, line);
            }
            if let Some(error) = reply.error.filter(|_| reports_errors(board)) {
                board.output.respond_error(error);
            }
        }
        Some(port) => {
            let mut bytes: Vec<u8> =
                reply.lines.iter().flat_map(|line| unasked_line(board, line, false)).collect();
            if reply.error.is_some() && reports_errors(board) {
                bytes.push(error_mark(board));
            }
            board.output.send(port, &bytes);
        }
    }
}

/// Whether errors of programs are reported: not with I6=2 (Software Reference, I6).
fn reports_errors(board: &Board) -> bool {
    board.variables.i(6) != 2.0
}
