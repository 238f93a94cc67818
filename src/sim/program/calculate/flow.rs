//! The flow of calculation: conditions, loops, jumps, calls and their arguments (Software Reference, program commands).

use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::condition;
use crate::sim::language::scanner::Scanner;
use crate::sim::program::calculate::{CALLS, Calculator, Flow};
use crate::sim::program::item::{AXES, Data, Item, Line};
use crate::sim::program::place::Cursor;
use crate::sim::program::structure::{Effect, Tracker};
use crate::sim::program::system::{Ending, Failure, Frame};

/// Deepest nesting of calls.
const MOST_FRAMES: usize = 15;
/// `READ` reports in this Q-variable the letters that it found; letter A goes into the next variable.
const READ_MASK: usize = 100;

impl Calculator<'_> {
    /// Carries out a statement of the program's flow; `None` for another statement.
    pub(super) fn branch(&mut self, item: &Item, line: &Line, cursor: Cursor) -> Option<Flow> {
        let is_last = cursor.item + 1 == line.items.len();
        let number = item.number().map_or(0.0, |number| self.value(number));
        let next_line = Cursor::at(cursor.program, cursor.line + 1);
        Some(match item {
            Item::Stop => {
                let next = Cursor { item: cursor.item + 1, ..cursor };
                self.system.cursor = Some(if is_last { next_line } else { next });
                self.end(Ending::Here);
                Flow::Wait
            }
            Item::BlockStart => {
                self.system.in_block = true;
                Flow::On
            }
            Item::BlockStop => {
                self.system.in_block = false;
                // In step mode the whole block is one step. The step ends here.
                self.system.moved = !self.system.continuous;
                Flow::On
            }
            Item::Call(_) => self.call(number, cursor, true),
            Item::Letter(letter, _) if CALLS.contains(letter) => {
                let kind = match letter {
                    b'M' => 1.0,
                    b'T' => 2.0,
                    b'D' => 3.0,
                    _ => 0.0,
                };
                let program = 1000.0 + 10.0 * (number / 100.0).floor() + kind;
                // A five-digit label: two digits of the number, three behind its point.
                self.call(program + (number % 100.0) / 100.0, cursor, false)
            }
            Item::Gosub(_) if !self.push_frame(cursor) => self.fail(Failure::RunTime),
            Item::Gosub(_) | Item::Goto(_) => self.jump(cursor.program, number),
            Item::Return if self.system.frames.is_empty() => {
                self.end(Ending::Program);
                Flow::Wait
            }
            Item::Return => {
                self.give_back();
                Flow::On
            }
            Item::Read(letters) => {
                self.read(letters);
                Flow::On
            }
            Item::If(text) if self.holds(text) => Flow::On,
            Item::If(_) if is_last => self.skip_block(cursor, Tracker::in_if(), true),
            Item::If(_) => self.skip_line(cursor),
            // The program has reached this `ELSE` at the end of the branch above.
            Item::Else if is_last => self.skip_block(cursor, Tracker::in_if(), false),
            Item::Else => {
                self.system.cursor = Some(next_line);
                Flow::On
            }
            Item::While(text) => self.begin_loop(text, line, cursor),
            Item::EndWhile => match self.system.loops.pop() {
                Some(begin) => {
                    self.system.cursor = Some(begin);
                    Flow::Back
                }
                None => self.fail(Failure::RunTime),
            },
            _ => return None,
        })
    }

    fn holds(&self, text: &str) -> bool {
        condition(&mut Scanner::new(text.as_bytes()), self.board, self.cs).unwrap_or(false)
    }

    fn begin_loop(&mut self, text: &str, line: &Line, cursor: Cursor) -> Flow {
        let short = cursor.item + 1 < line.items.len();
        match (self.holds(text), short) {
            (true, true) => Flow::On,
            (true, false) => {
                if let Some(outer) = self.system.loops.iter().position(|&begin| begin == cursor) {
                    self.system.loops.truncate(outer);
                }
                self.system.loops.push(cursor);
                Flow::On
            }
            (false, true) => {
                self.system.cursor = Some(Cursor::at(cursor.program, cursor.line + 1));
                Flow::On
            }
            (false, false) => self.skip_block(cursor, Tracker::in_while(), false),
        }
    }

    /// Skips a short IF whose condition is false; continues in an `ELSE` on the next line.
    fn skip_line(&mut self, cursor: Cursor) -> Flow {
        let mut next = Cursor::at(cursor.program, cursor.line + 1);
        if self.line(next).is_some_and(|line| line.items.first() == Some(&Item::Else)) {
            next.item = 1;
        }
        self.system.cursor = Some(next);
        Flow::On
    }

    /// Skips to the end of the block that begins after `cursor`, or into its `ELSE`.
    fn skip_block(&mut self, cursor: Cursor, mut tracker: Tracker, stop_at_else: bool) -> Flow {
        let depth = tracker.depth();
        let mut at = Cursor::at(cursor.program, cursor.line + 1);
        while let Some(line) = self.line(at) {
            for item in 0..line.items.len() {
                let outermost = tracker.depth() == depth;
                let Ok(effect) = tracker.item(&line, item) else { return self.fail(Failure::RunTime) };
                let found = match effect {
                    Effect::Else => stop_at_else && outermost,
                    Effect::Ends => outermost,
                    Effect::None => false,
                };
                if found {
                    self.system.cursor = Some(Cursor { item: item + 1, ..at });
                    return Flow::On;
                }
            }
            at.line += 1;
        }
        self.fail(Failure::RunTime)
    }

    fn push_frame(&mut self, cursor: Cursor) -> bool {
        let back = Cursor { item: cursor.item + 1, ..cursor };
        let loops = std::mem::take(&mut self.system.loops);
        self.system.frames.push(Frame { back, loops });
        self.system.frames.len() <= MOST_FRAMES
    }

    pub(super) fn give_back(&mut self) {
        if let Some(frame) = self.system.frames.pop() {
            self.system.cursor = Some(frame.back);
            self.system.loops = frame.loops;
        }
    }

    /// Calls a program; five digits behind the point are the label. A letter's call of a missing target has no effect;
    /// any other such call is a run-time error.
    fn call(&mut self, value: f64, cursor: Cursor, must_exist: bool) -> Flow {
        let (program, label) = split(value);
        match self.program(program).and_then(|program| program.label(label)) {
            Some(line) if self.push_frame(cursor) => {
                self.system.cursor = Some(Cursor::at(program, line));
                Flow::On
            }
            None if !must_exist => Flow::On,
            _ => self.fail(Failure::RunTime),
        }
    }

    fn jump(&mut self, program: u32, label: f64) -> Flow {
        let before = self.system.cursor;
        match self.program(program).and_then(|program| program.label(label.round().max(0.0) as u32)) {
            Some(line) => {
                let back = before.is_some_and(|cursor| cursor.program == program && line <= cursor.line);
                self.system.cursor = Some(Cursor::at(program, line));
                if back { Flow::Back } else { Flow::On }
            }
            None => self.fail(Failure::RunTime),
        }
    }

    /// Puts the caller's letters into Q101 (A) to Q126 (Z), up to the first letter that `READ` does not request; Q100
    /// reports the letters found.
    fn read(&mut self, letters: &[u8]) {
        let Some(back) = self.system.frames.last().map(|frame| frame.back) else { return };
        let Some(line) = self.line(back) else { return };
        let (mut mask, mut taken) = (0u32, 0);
        for item in line.items.iter().skip(back.item) {
            let Some((letter, data)) = lettered(item) else { break };
            if !letters.contains(&letter) {
                break;
            }
            let (index, value) = (usize::from(letter - b'A'), self.value(data));
            self.board.assign(VariableKind::Q, self.cs, READ_MASK + 1 + index, value);
            mask |= 1 << index;
            taken += 1;
        }
        self.board.assign(VariableKind::Q, self.cs, READ_MASK, mask.into());
        if let Some(frame) = self.system.frames.last_mut() {
            frame.back.item += taken;
        }
    }
}

/// A letter with its number, for `READ`.
fn lettered(item: &Item) -> Option<(u8, &Data)> {
    match item {
        Item::Axis(axis, data, None) => Some((*AXES.get(*axis)?, data)),
        Item::Letter(letter, data) => Some((*letter, data)),
        _ => None,
    }
}

/// A program's number, and the label: five digits behind the point.
#[must_use]
pub fn split(value: f64) -> (u32, u32) {
    let hundred_thousandths = (value.max(0.0) * 100_000.0).round() as u64;
    ((hundred_thousandths / 100_000) as u32, (hundred_thousandths % 100_000) as u32)
}
