//! PMAC's half of the DPRAM ASCII port (DPRAM manual pp. 25-29).
//!
//! PMAC sees a line's flag in one background pass and takes the line in the next, to catch a host that goes on writing
//! after its flag. The first part of a long line has no NUL in the buffer. A control character acts at once. Responses
//! queue up. PMAC writes a response when the response's control word is 0: text and NUL, count, then the control word,
//! and the interrupt if I56=1.
//!
//! Control words: 0x000D a line, 0x0006 the end, 0x8nnn an error (BCD), 0x010D a `CMD` response, 0x020D a `SEND`
//! message.
//!
//! The count includes the NUL, and PMAC writes the count before the control word. A control character needs only its
//! own word. While PMAC works at a line it looks at nothing else: the same background pass does both.

use crate::format::TextOrder;
use crate::map::HostOffset;
use crate::map::functions::response;
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::output::Response;
use crate::sim::language::control::takes_line;
use crate::sim::language::interpreter::Interpreter;
use crate::sim::language::reply::Reply;
use crate::sim::program::Programs;

/// `<CTRL-X>`.
const CANCEL: u8 = 0x18;

/// The port's state.
#[derive(Debug, Clone, Default)]
pub struct AsciiPort {
    /// The text as it was when its flag was first seen.
    seen: Option<Vec<u8>>,
    /// The first part of a long line.
    first_part: Option<Vec<u8>>,
    /// The line at work.
    work: Option<Work>,
    /// Passes left until a late response may go.
    late: Option<u64>,
    /// Passes left until the words are cleared for a `^X`.
    cancel: Option<u64>,
    /// Words of a torn response that are not written yet.
    rest: Vec<(HostOffset, u16)>,
    /// The last response, which a fault has PMAC give again.
    repeat: Option<Response>,
    /// Lines and control characters taken.
    pub commands: u64,
    /// Interrupts raised by responses, not yet given to the hosts.
    pub interrupts: u64,
    /// [`crate::sim::board::output::Output::lost`] at the last pass.
    lost: u64,
    /// The value of [`crate::sim::board::output::Output::cancelled`] at the start of this state.
    cancelled: u64,
}

/// A line at work.
#[derive(Debug, Clone)]
struct Work {
    line: Vec<u8>,
    /// Passes that the line still takes.
    left: u64,
}

impl AsciiPort {
    /// Whether PMAC keeps the first part of a line, and waits for the second.
    #[must_use]
    pub const fn has_first_part(&self) -> bool {
        self.first_part.is_some()
    }

    /// One background pass: takes a control character, then a line, then writes a response.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter) {
        self.follow_cancel(board);
        self.cancel_late(board);
        if self.work.is_none() && board.takes_ascii() && !board.faults.ascii_deaf {
            self.take_character(board, programs, interpreter);
            // A board that has much to say yet takes no further line.
            if board.output.has_room() {
                self.take_line(board);
            }
        }
        self.work(board, programs, interpreter);
        if !board.is_at_work() {
            self.respond(board);
        }
        let lost = board.output.lost;
        let what = (lost > self.lost).then(|| {
            "no host fetches the responses at the DPRAM: what programs and control characters say is lost"
                .to_owned()
        });
        if what.is_some() || board.output.has_room() {
            board.judge.state(board.stats.servo_cycles, "responses", what);
        }
        self.lost = lost;
    }

    /// Drops the work under way when the board's output was cancelled (`<CTRL-X>`, reset).
    fn follow_cancel(&mut self, board: &Board) {
        if self.cancelled != board.output.cancelled {
            let Self { commands, interrupts, lost, .. } = *self;
            *self = Self { commands, interrupts, lost, cancelled: board.output.cancelled, ..Self::default() };
        }
    }

    fn take_character(&mut self, board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter) {
        let place = board.family().ascii.control_character;
        let character = board.memory.dpram.read16(place) as u8;
        if character == 0 {
            return;
        }
        board.memory.dpram.write16(place, 0);
        self.commands += 1;
        board.dpram_becomes_active();
        control(board, programs, interpreter, character);
        self.follow_cancel(board);
        if character == CANCEL && board.faults.ascii_late_cancel > 0 {
            self.cancel = Some(board.faults.ascii_late_cancel);
        }
    }

    /// The manual has `^X` "clear the control words" (p. 27), and does not say when.
    fn cancel_late(&mut self, board: &mut Board) {
        match &mut self.cancel {
            Some(0) => {
                self.cancel = None;
                board.cancel_queues();
                self.follow_cancel(board);
            }
            Some(left) => *left -= 1,
            None => {}
        }
    }

    fn take_line(&mut self, board: &mut Board) {
        let port = &board.family().ascii;
        if !board.memory.dpram.is_set(port.command_loaded) {
            self.seen = None;
            return;
        }
        board.memory.dpram.order_reads();
        let text = read_text(board);
        let Some(seen) = self.seen.take() else {
            self.seen = Some(text);
            return;
        };
        // A host that stops the machine may make its line empty.
        if before_nul(&seen) != before_nul(&text) && text[0] != 0 {
            let cycle = board.stats.servo_cycles;
            board.judge.record(cycle, "the command text changed after its flag was set");
        }
        match text.iter().position(|&byte| byte == 0) {
            Some(end) => {
                let mut line = self.first_part.take().unwrap_or_default();
                line.extend_from_slice(&text[..end]);
                self.commands += 1;
                board.dpram_becomes_active();
                if line.len() > port.line_limit {
                    refuse(board, CommandError::SYNTAX);
                } else {
                    self.work = Some(Work { line, left: board.faults.ascii_slow });
                }
            }
            // The last byte of a first part only shows that a second part follows.
            None if self.first_part.is_none() => self.first_part = Some(text[..text.len() - 1].to_vec()),
            None => {
                self.first_part = None;
                refuse(board, CommandError::SYNTAX);
            }
        }
        board.memory.dpram.order_writes();
        board.memory.dpram.write16(port.command_loaded.word, 0);
    }

    /// Works at the line that PMAC took; carries the line out when its time is over.
    fn work(&mut self, board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter) {
        let Some(Work { line, mut left }) = self.work.take() else { return };
        // A user who takes the fault back while a line is at work ends the wait.
        left = left.min(board.faults.ascii_slow);
        if left > 0 {
            self.work = Some(Work { line, left: left - 1 });
            return;
        }
        execute(board, programs, interpreter, &line);
        self.follow_cancel(board);
    }

    fn respond(&mut self, board: &mut Board) {
        for (offset, word) in std::mem::take(&mut self.rest) {
            board.memory.dpram.write16(offset, word);
        }
        let free = board.memory.dpram.read16(board.family().ascii.response_control) == 0;
        if let Some(again) = self.repeat.take_if(|_| free) {
            board.output.dpram.push_front(again);
            self.put(board);
            return;
        }
        let Some(next) = board.output.dpram.front() else { return };
        let late = match next.control {
            response::ACKNOWLEDGE => board.faults.ascii_late_ack,
            response::LINE => board.faults.ascii_slow_lines,
            _ => 0,
        };
        if late > 0 {
            let left = self.late.get_or_insert(late);
            if *left > 0 {
                *left -= 1;
                return;
            }
        }
        if !free {
            return;
        }
        self.late = None;
        if board.faults.ascii_repeat {
            self.repeat = board.output.dpram.front().cloned();
        }
        self.put(board);
    }

    /// Writes the oldest response.
    fn put(&mut self, board: &mut Board) {
        let Some(Response { control, text }) = board.output.dpram.pop_front() else { return };
        let family = board.family();
        let dpram = &mut board.memory.dpram;
        // One NUL at least; the second half of the last word is a NUL too.
        let words = (0..=text.len()).step_by(2).map(|place| {
            let character = |at: usize| text.get(at).copied().unwrap_or(0);
            let word = TextOrder::LowFirst.pack(character(place), character(place + 1));
            (family.ascii.response.plus_words(place / 2), word)
        });
        let whole = if board.faults.ascii_torn { text.len() / 4 } else { usize::MAX };
        for (index, (offset, word)) in words.enumerate() {
            if index < whole {
                dpram.write16(offset, word);
            } else {
                self.rest.push((offset, word));
            }
        }
        let count = board.faults.ascii_count.unwrap_or(text.len() as u16 + 1);
        dpram.write16(family.ascii.response_count, count);
        dpram.order_writes();
        dpram.write16(family.ascii.response_control, control);
        self.interrupt(board);
    }

    fn interrupt(&mut self, board: &Board) {
        if board.enabled(board.family().i.interrupt) {
            self.interrupts += 1;
        }
    }
}

/// Carries out a control character. After a character that reports data the acknowledgement follows, and after the line
/// that ^W takes; other characters answer nothing. (^E and ^G report bytes that no text of this port can hold.)
fn control(board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter, character: u8) {
    if let Some(reply) = interpreter.control(board, programs, character)
        && (reply.error.is_some() || !reply.lines.is_empty() || takes_line(character))
        && board.output.admits()
    {
        answer(board, reply);
    }
}

fn execute(board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter, line: &[u8]) {
    // Some hosts send a control character as a line of its own.
    if let [character @ 1..=31] = *line {
        control(board, programs, interpreter, character);
        return;
    }
    if board.faults.ascii_no_size && line.starts_with(b"SIZE") {
        refuse(board, CommandError::SYNTAX);
        return;
    }
    let resets = board.stats.resets;
    let reply = interpreter.execute(board, programs, line);
    // A reset empties the queues; its own acknowledgement is lost with them.
    if board.stats.resets == resets {
        board.output.asked = reply.lines.len();
        answer(board, reply);
    }
}

fn answer(board: &mut Board, reply: Reply) {
    if board.faults.ascii_no_reply {
        return;
    }
    for text in reply.lines {
        board.output.respond(response::LINE, text);
    }
    match reply.error {
        Some(error) => refuse(board, error),
        None => board.output.respond(response::ACKNOWLEDGE, []),
    }
}

fn refuse(board: &mut Board, error: CommandError) {
    board.output.respond_error(error);
}

fn read_text(board: &Board) -> Vec<u8> {
    let port = &board.family().ascii;
    let words =
        (0..port.command_bytes / 2).map(|word| board.memory.dpram.read16(port.command.plus_words(word)));
    words.flat_map(|word| TextOrder::LowFirst.unpack(word)).collect()
}

/// A text up to its NUL.
fn before_nul(text: &[u8]) -> &[u8] {
    text.split(|&byte| byte == 0).next().unwrap_or(text)
}
