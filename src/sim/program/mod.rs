//! Program buffers and what runs out of them: motion programs, rotary buffers, PLCs.
//!
//! User Manual, "Writing a motion program" (pp. 160-217) and "Writing a PLC program"; Software Reference, "Program
//! commands". A line of text or of DPRAM words becomes an [`item::Line`] in the [`store`]; calculation takes it apart
//! ahead of time and puts moves into a [`trajectory`], which tells the motors each servo cycle where to be.
//!
//! | file | idea |
//! |---|---|
//! | [`item`], [`words`], [`parse`], [`text`], [`binary`] | program lines: internal form, text, DPRAM words |
//! | [`store`], [`rotary`], [`structure`] | the buffers, their memory, their blocks |
//! | [`system`], [`place`], [`cutter_state`], `calculate` | one coordinate system's program; its lines, their order, its moves |
//! | [`path`], [`circle`], [`spline`], [`transform`], [`cutter`], [`trajectory`] | geometry and time of moves |
//! | `run`, `cycle`, `servo` | run, stop, abort; servo and real-time interrupts |
//! | [`plc`], [`message`] | PLC programs; SEND |

pub mod binary;
mod calculate;
pub mod circle;
pub mod cutter;
pub mod cutter_state;
#[cfg(test)]
mod cutting_tests;
mod cycle;
pub mod item;
pub mod message;
pub mod parse;
pub mod path;
pub mod place;
pub mod plc;
pub mod rotary;
mod run;
mod servo;
pub mod spline;
pub mod store;
pub mod structure;
pub mod system;
#[cfg(test)]
mod tests;
pub mod text;
pub mod trajectory;
pub mod transform;
pub mod words;

use std::collections::VecDeque;

use place::Cursor;
use plc::Plcs;
use store::{Store, TableKind};
use system::System;

/// What a program asks the interpreter to do, in the background.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// A command line, with the motor and coordinate system it is for.
    Line(Box<str>, usize, usize),
    /// A control character.
    Character(u8),
}

/// Buffers and programs of a board.
#[derive(Debug)]
pub struct Programs {
    /// The buffers.
    pub store: Store,
    /// The programs of the coordinate systems.
    pub systems: Vec<System>,
    /// The PLC programs.
    pub plcs: Plcs,
    requests: VecDeque<Request>,
    /// The buffers as `SAVE` has kept them.
    saved: Store,
    /// For the background report, a coordinate system each: time left in acceleration (1/2 ms), execution address offset.
    pub report: Vec<[u32; 2]>,
}

impl Programs {
    /// No programs, for a board with so many coordinate systems.
    #[must_use]
    pub fn new(coordinate_systems: usize) -> Self {
        Self::with(Store::default(), coordinate_systems)
    }

    /// As a reset leaves them when `saved` are the buffers that `SAVE` has kept.
    fn with(saved: Store, coordinate_systems: usize) -> Self {
        Self {
            store: saved.clone(),
            systems: vec![System { rematch: true, ..System::default() }; coordinate_systems],
            plcs: Plcs::default(),
            requests: VecDeque::new(),
            saved,
            report: vec![[0; 2]; coordinate_systems],
        }
    }

    /// As a reset: the saved buffers, or none with `factory_values`; nothing runs.
    pub fn reset(&mut self, factory_values: bool) {
        let saved = if factory_values { Store::default() } else { std::mem::take(&mut self.saved) };
        *self = Self::with(saved, self.systems.len());
    }

    /// Keeps the buffers for the next reset.
    pub fn save(&mut self) {
        self.saved = self.store.kept();
    }

    /// The oldest request that waits.
    pub fn take_request(&mut self) -> Option<Request> {
        self.requests.pop_front()
    }

    /// Has the interpreter carry out `text`, with a 0-based motor and coordinate system addressed.
    fn ask(&mut self, text: &str, motor: usize, cs: usize) {
        /// Lines that wait at most; a program that asks faster loses some.
        const MOST: usize = 64;
        if self.requests.len() < MOST {
            self.requests.push_back(Request::Line(text.into(), motor, cs));
        }
    }

    fn ask_character(&mut self, code: u8) {
        self.requests.push_back(Request::Character(code));
        self.requests.truncate(64);
    }

    /// Transformation matrices that `DEFINE TBUF` has made room for.
    fn transformations(&self, _cs: usize) -> usize {
        let tables = self.store.tables.iter().filter(|table| table.kind == TableKind::Transformation);
        tables.map(|table| table.size).sum()
    }

    /// Where the command at `cursor` is in its buffer, in long words.
    pub fn offset(&self, cs: usize, cursor: Cursor) -> usize {
        let (line, end) = match cursor.program {
            0 => (self.store.rotary(cs).and_then(|rotary| rotary.line(cursor.line)), 0),
            number => {
                let program = self.store.program(number);
                (
                    program.and_then(|program| program.line(cursor.line)),
                    program.map_or(0, |program| program.words()),
                )
            }
        };
        let before =
            |line: &item::Line| line.items.iter().take(cursor.item).map(item::Item::words).sum::<usize>();
        line.map_or(end, |line| line.offset + before(line))
    }

    /// Whether a motion program runs in any coordinate system.
    #[must_use]
    pub fn any_runs(&self) -> bool {
        self.systems.iter().any(|system| system.running)
    }
}
