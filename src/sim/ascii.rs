//! PMAC's half of the DPRAM ASCII port (DPRAM manual pp. 25-29).
//!
//! A line is taken when bit 0 of 0x062C is set: seen in one background pass, taken in the next, so that a host that
//! goes on writing after its flag is found out. A first part of a long line has no NUL in its 160 bytes. A character
//! at 0x062E acts at once. Responses queue up; one is written when 0x06D0 is zero: text and NUL, count, then the
//! control word, and the interrupt if I56=1.
//!
//! Control words: 0x000D a line, 0x0006 the end, 0x8nnn an error (BCD), 0x010D a `CMD` response, 0x020D a `SEND`
//! message. The end is sent when I3 is 2 or 3, the modes whose handshake is `<ACK>`.

use std::collections::VecDeque;

use super::board::Board;
use super::language::{CommandError, Interpreter, Reply, takes_line};
use super::offsets;
use crate::format::TextOrder;
use crate::map::classic::{self, RESPONSE_ACKNOWLEDGE, RESPONSE_ERROR, RESPONSE_LINE};

/// The most characters a line in two parts can have.
const LONGEST: usize = classic::ASCII_LINE_LIMIT;
/// Responses kept for a host that does not fetch them; then the oldest program's messages would be lost, so new ones are.
const QUEUE: usize = 4096;

/// One filling of the response buffer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Response {
    /// The control word.
    pub control: u16,
    /// The characters, without NUL.
    pub text: Vec<u8>,
}

/// The port's state.
#[derive(Debug, Clone, Default)]
pub struct AsciiPort {
    queue: VecDeque<Response>,
    /// The text as it was when its flag was first seen.
    seen: Option<[u8; offsets::ASCII_OUT_LENGTH]>,
    /// The first part of a long line.
    first_part: Option<Vec<u8>>,
    /// Passes left until a late `<ACK>` may go.
    late: Option<u64>,
    /// Words of a torn response that are not written yet.
    rest: Vec<(u16, u16)>,
    /// The response given last is to be given again.
    repeat: Option<Response>,
    /// Lines and control characters taken.
    pub commands: u64,
    /// Interrupts raised by responses, not yet given to the hosts.
    pub interrupts: u64,
}

impl AsciiPort {
    /// Empties the queues (`<CTRL-X>`, reset).
    pub fn clear(&mut self) {
        self.queue.clear();
        self.seen = None;
        self.first_part = None;
        self.late = None;
        self.rest.clear();
        self.repeat = None;
    }

    /// Queues a response. A line longer than the buffer is cut at 255 characters.
    pub fn push(&mut self, control: u16, text: &[u8]) {
        if self.queue.len() < QUEUE {
            let length = text.len().min(offsets::ASCII_IN_CHARACTERS);
            self.queue.push_back(Response { control, text: text[..length].to_vec() });
        }
    }

    /// Queues the error's control word.
    pub fn push_error(&mut self, error: CommandError) {
        let code = error.0;
        let digits = (code / 100 % 10) << 8 | (code / 10 % 10) << 4 | (code % 10);
        self.push(RESPONSE_ERROR | digits, &[]);
    }
}

/// One background pass: takes a control character, then a line, then writes a response.
pub fn poll(board: &mut Board, interpreter: &mut Interpreter) {
    if board.variables.i(58) == 1.0 && !board.faults.ascii_deaf {
        take_character(board, interpreter);
        take_line(board, interpreter);
    }
    respond(board);
}

fn take_character(board: &mut Board, interpreter: &mut Interpreter) {
    let word = board.memory.dpram.read16(offsets::ASCII_OUT_CHARACTER);
    let character = word as u8;
    if character == 0 {
        return;
    }
    board.memory.dpram.write16(offsets::ASCII_OUT_CHARACTER, 0);
    board.ascii.commands += 1;
    board.dpram_becomes_active();
    control(board, interpreter, character);
}

/// Carries out a control character. One that reports data ends with the acknowledgement, as does the line that ^W takes;
/// others answer nothing. (^E and ^G report bytes that no text of this port can hold.)
fn control(board: &mut Board, interpreter: &mut Interpreter, character: u8) {
    if let Some(reply) = interpreter.control(board, character)
        && (reply.error.is_some() || !reply.lines.is_empty() || takes_line(character))
    {
        answer(board, reply);
    }
}

fn take_line(board: &mut Board, interpreter: &mut Interpreter) {
    if board.memory.dpram.read16(offsets::ASCII_OUT_CONTROL) & 1 == 0 {
        board.ascii.seen = None;
        return;
    }
    board.memory.dpram.order_reads();
    let text = read_text(board);
    let Some(seen) = board.ascii.seen.replace(text) else { return };
    board.ascii.seen = None;
    if before_nul(&seen) != before_nul(&text) {
        let cycle = board.stats.servo_cycles;
        board.judge.record(cycle, "the command text changed after its flag was set");
    }
    match text.iter().position(|&byte| byte == 0) {
        Some(end) => {
            let mut line = board.ascii.first_part.take().unwrap_or_default();
            line.extend_from_slice(&text[..end]);
            board.ascii.commands += 1;
            board.dpram_becomes_active();
            if line.len() > LONGEST {
                board.ascii.push_error(CommandError::SYNTAX);
            } else {
                execute(board, interpreter, &line);
            }
        }
        // The last byte of a first part only shows that there is more.
        None if board.ascii.first_part.is_none() => {
            board.ascii.first_part = Some(text[..offsets::ASCII_OUT_LENGTH - 1].to_vec());
        }
        None => {
            board.ascii.first_part = None;
            board.ascii.push_error(CommandError::SYNTAX);
        }
    }
    board.memory.dpram.order_writes();
    board.memory.dpram.write16(offsets::ASCII_OUT_CONTROL, 0);
}

fn execute(board: &mut Board, interpreter: &mut Interpreter, line: &[u8]) {
    // Some hosts send a control character as a line of its own.
    if let [character @ 1..=31] = *line {
        control(board, interpreter, character);
        return;
    }
    let resets = board.stats.resets;
    let reply = interpreter.execute(board, line);
    // A reset empties the queues; its own acknowledgement is lost with them.
    if board.stats.resets == resets {
        answer(board, reply);
    }
}

fn answer(board: &mut Board, reply: Reply) {
    if board.faults.ascii_no_reply {
        return;
    }
    for text in reply.lines {
        board.ascii.push(RESPONSE_LINE, text.as_bytes());
    }
    match reply.error {
        Some(error) => board.ascii.push_error(error),
        None if board.variables.i(3) >= 2.0 => board.ascii.push(RESPONSE_ACKNOWLEDGE, &[]),
        None => {}
    }
}

fn respond(board: &mut Board) {
    for (offset, word) in std::mem::take(&mut board.ascii.rest) {
        board.memory.dpram.write16(offset, word);
    }
    if let Some(again) =
        board.ascii.repeat.take_if(|_| board.memory.dpram.read16(offsets::ASCII_IN_CONTROL) == 0)
    {
        board.ascii.queue.push_front(again);
        put(board);
        return;
    }
    let Some(next) = board.ascii.queue.front() else { return };
    if next.control == RESPONSE_ACKNOWLEDGE && board.faults.ascii_late_ack > 0 {
        let left = board.ascii.late.get_or_insert(board.faults.ascii_late_ack);
        if *left > 0 {
            *left -= 1;
            return;
        }
    }
    if board.memory.dpram.read16(offsets::ASCII_IN_CONTROL) != 0 {
        return;
    }
    board.ascii.late = None;
    if board.faults.ascii_repeat {
        board.ascii.repeat = board.ascii.queue.front().cloned();
    }
    put(board);
}

/// Writes the first response of the queue.
fn put(board: &mut Board) {
    let Some(Response { control, text }) = board.ascii.queue.pop_front() else { return };
    let dpram = &mut board.memory.dpram;
    // One NUL at least; the second half of the last word is a NUL too.
    let words = (0..=text.len()).step_by(2).map(|place| {
        let character = |at: usize| text.get(at).copied().unwrap_or(0);
        let word = TextOrder::LowFirst.pack(character(place), character(place + 1));
        (offsets::ASCII_IN_TEXT + place as u16, word)
    });
    let whole = if board.faults.ascii_torn { text.len() / 4 } else { usize::MAX };
    for (index, (offset, word)) in words.enumerate() {
        if index < whole {
            dpram.write16(offset, word);
        } else {
            board.ascii.rest.push((offset, word));
        }
    }
    dpram.write16(offsets::ASCII_IN_COUNT, board.faults.ascii_count.unwrap_or(text.len() as u16 + 1));
    dpram.order_writes();
    dpram.write16(offsets::ASCII_IN_CONTROL, control);
    if board.variables.i(56) == 1.0 {
        board.ascii.interrupts += 1;
    }
}

fn read_text(board: &Board) -> [u8; offsets::ASCII_OUT_LENGTH] {
    let mut text = [0; offsets::ASCII_OUT_LENGTH];
    for (index, pair) in text.chunks_exact_mut(2).enumerate() {
        let word = board.memory.dpram.read16(offsets::ASCII_OUT_TEXT + 2 * index as u16);
        pair.copy_from_slice(&TextOrder::LowFirst.unpack(word));
    }
    text
}

/// What counts of a text: what stands before its NUL.
fn before_nul(text: &[u8]) -> &[u8] {
    text.split(|&byte| byte == 0).next().unwrap_or(text)
}
