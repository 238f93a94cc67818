//! Lines, replies, control characters.

use std::ffi::c_char;

use super::{BOOL, DWORD, FALSE, int, truth, wide};
use crate::ascii;
use crate::border::{Room, Text, Unit, exports};
use crate::fault::Fault;

type Wide = u16;

/// Writes a reply and returns its characters; 0 if there is none, or after a failure, whose text the room then has.
fn count<U: Unit>(outcome: Result<Vec<u8>, Fault>, room: Room<U>, max: DWORD) -> wide {
    let put = put(&outcome, room, max);
    if outcome.is_ok() { put } else { 0 }
}

/// Writes a reply and returns its characters with the status bits. The upper 32 bits are 0.
fn status<U: Unit>(outcome: Result<Vec<u8>, Fault>, room: Room<U>, max: DWORD) -> wide {
    let put = put(&outcome, room, max);
    ascii::status(&outcome, put) as wide
}

fn put<U: Unit>(outcome: &Result<Vec<u8>, Fault>, room: Room<U>, max: DWORD) -> usize {
    let max = max as usize;
    match outcome {
        Ok(reply) => room.put(max, reply),
        Err(fault) => room.put(max, fault.reply().as_bytes()),
    }
}

fn response<U: Unit>(number: DWORD, command: Text<U>) -> Result<Vec<u8>, Fault> {
    ascii::response(number, command.copy().as_deref())
}

fn line<U: Unit>(number: DWORD, line: Text<U>) -> wide {
    ascii::send_line(number, line.copy().as_deref()).unwrap_or(0)
}

exports! {
    /// Sends a line and gives its reply.
    PmacGetResponseA(number: DWORD, room: Room<c_char>, max: DWORD, command: Text<c_char>) -> wide = 0 =>
        count(response(number, command), room, max);
    /// As `PmacGetResponseA`, with status bits.
    PmacGetResponseExA(number: DWORD, room: Room<c_char>, max: DWORD, command: Text<c_char>) -> wide = 0 =>
        status(response(number, command), room, max);
    /// As `PmacGetResponseA`, in characters of 16 bits.
    PmacGetResponseW(number: DWORD, room: Room<Wide>, max: DWORD, command: Text<Wide>) -> wide = 0 =>
        count(response(number, command), room, max);
    /// As `PmacGetResponseExA`, in characters of 16 bits.
    PmacGetResponseExW(number: DWORD, room: Room<Wide>, max: DWORD, command: Text<Wide>) -> wide = 0 =>
        status(response(number, command), room, max);
    /// Sends a line and drops its reply.
    PmacSendCommandA(number: DWORD, command: Text<c_char>) -> () = () =>
        drop(ascii::response(number, command.copy().as_deref()));
    /// Sends a control character and gives its answer.
    PmacGetControlResponseA(number: DWORD, room: Room<c_char>, max: DWORD, character: c_char) -> wide = 0 =>
        count(ascii::control_response(number, character.byte()), room, max);
    /// As `PmacGetControlResponseA`, with status bits.
    PmacGetControlResponseExA(number: DWORD, room: Room<c_char>, max: DWORD, character: c_char) -> wide = 0 =>
        status(ascii::control_response(number, character.byte()), room, max);
    /// As `PmacGetControlResponseA`, in characters of 16 bits.
    PmacGetControlResponseW(number: DWORD, room: Room<Wide>, max: DWORD, character: Wide) -> wide = 0 =>
        count(ascii::control_response(number, character.byte()), room, max);
    /// As `PmacGetControlResponseExA`, in characters of 16 bits.
    PmacGetControlResponseExW(number: DWORD, room: Room<Wide>, max: DWORD, character: Wide) -> wide = 0 =>
        status(ascii::control_response(number, character.byte()), room, max);
    /// Sends a control character; a board takes no single other characters.
    PmacSendCharA(number: DWORD, character: c_char) -> BOOL = FALSE =>
        truth(ascii::control_response(number, character.byte()));
    /// Sends a line; `PmacGetLineA` gives its reply.
    PmacSendLineA(number: DWORD, text: Text<c_char>) -> wide = 0 => line(number, text);
    /// As `PmacSendLineA`, in characters of 16 bits.
    PmacSendLineW(number: DWORD, text: Text<Wide>) -> wide = 0 => line(number, text);
    /// The next line of the reply; 0 at its end.
    PmacGetLineA(number: DWORD, room: Room<c_char>, max: DWORD) -> wide = 0 =>
        count(ascii::next_line(number), room, max);
    /// As `PmacGetLineA`, with status bits.
    PmacGetLineExA(number: DWORD, room: Room<c_char>, max: DWORD) -> wide = 0 =>
        ascii::line_status(number, |outcome| put(outcome, room, max)) as wide;
    /// As `PmacGetLineA`, in characters of 16 bits.
    PmacGetLineW(number: DWORD, room: Room<Wide>, max: DWORD) -> wide = 0 =>
        count(ascii::next_line(number), room, max);
    /// As `PmacGetLineExA`, in characters of 16 bits.
    PmacGetLineExW(number: DWORD, room: Room<Wide>, max: DWORD) -> wide = 0 =>
        ascii::line_status(number, |outcome| put(outcome, room, max)) as wide;
    /// All lines of the replies that wait.
    PmacGetBufferA(number: DWORD, room: Room<c_char>, max: DWORD) -> wide = 0 =>
        count(ascii::all_lines(number), room, max);
    /// Whether `PmacGetLineA` has a line, or the end of a reply.
    PmacReadReady(number: DWORD) -> BOOL = FALSE => BOOL::from(ascii::is_ready(number).unwrap_or(false));
    /// Drops the replies that wait.
    PmacFlush(number: DWORD) -> () = () => drop(ascii::flush(number));
    /// Lines go by the port that the daemon uses: the DPRAM's, whatever the program wishes.
    PmacSetAsciiComm(number: DWORD, _mode: int) -> BOOL = FALSE => truth(ascii::is_ready(number));
    /// 1: by the DPRAM.
    PmacGetAsciiComm(number: DWORD) -> int = 0 => int::from(ascii::is_ready(number).is_ok());
}
