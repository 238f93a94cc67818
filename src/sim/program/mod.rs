//! Program buffers and their execution: motion programs, rotary buffers, PLCs.
//!
//! User Manual, "Writing a motion program" (pp. 160-217) and "Writing a PLC program"; Software Reference, "Program
//! commands". A line of text or of DPRAM words becomes an [`item::Line`] in the [`store`]. Calculation interprets it
//! ahead of time and puts moves into a [`trajectory`], which sets the motors' desired positions each servo cycle.
//!
//! | file | idea |
//! |---|---|
//! | [`item`], [`words`], [`parse`], [`text`], [`binary`] | program lines: internal form, text, DPRAM words |
//! | [`store`], [`rotary`], [`structure`] | the buffers, their memory, their blocks |
//! | [`system`], [`place`], `calculate` | the program of one coordinate system, its lines and moves |
//! | [`path`], [`circle`], [`spline`], [`transform`], [`trajectory`] | geometry and time of moves |
//! | `run`, `cycle`, `servo` | run, stop, abort; servo and real-time interrupts |
//! | [`plc`], `kinematics`, [`message`] | PLC programs; kinematic programs; SEND |
//!
//! Not played: cutter radius compensation. The board stores and lists a program that holds `CC1` or `CC2`; the program
//! ends with a run-time error when it gets there.

pub mod binary;
mod calculate;
pub mod circle;
mod cycle;
pub mod item;
#[cfg(test)]
mod kinematic_tests;
mod kinematics;
#[cfg(test)]
mod list_tests;
pub mod message;
pub mod parse;
pub mod path;
pub mod place;
pub mod plc;
pub mod rotary;
mod run;
mod servo;
#[cfg(test)]
mod site_tests;
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

use item::Message;
use message::Outlet;
use place::Cursor;
use plc::Plcs;
use store::{Store, TableKind};
use system::System;

/// A program's request to the interpreter, executed in the background.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// A command line.
    Line {
        /// Its text.
        text: Box<str>,
        /// The addressed motor, 0-based.
        motor: usize,
        /// The addressed coordinate system, 0-based.
        cs: usize,
        /// Where its answer goes.
        outlet: Outlet,
    },
    /// A control character, and where its answer goes.
    Character(u8, Outlet),
}

/// A board's buffers and programs.
#[derive(Debug)]
pub struct Programs {
    /// The buffers.
    pub store: Store,
    /// The programs of the coordinate systems.
    pub systems: Vec<System>,
    /// The PLC programs.
    pub plcs: Plcs,
    requests: VecDeque<Request>,
    /// The buffers as `SAVE` stored them.
    saved: Store,
    /// For the background report, per coordinate system: time left in acceleration (1/2 ms), execution address
    /// offset, time left in the move (1/2 ms).
    pub report: Vec<[u32; 3]>,
}

impl Programs {
    /// No programs, for a board with `coordinate_systems`.
    #[must_use]
    pub fn new(coordinate_systems: usize) -> Self {
        Self::with(Store::default(), Store::default(), coordinate_systems)
    }

    /// The state after a reset: `store` has the buffers to begin with, `saved` those that `SAVE` stored.
    fn with(store: Store, saved: Store, coordinate_systems: usize) -> Self {
        Self {
            store,
            systems: vec![System { rematch: true, ..System::default() }; coordinate_systems],
            plcs: Plcs::default(),
            requests: VecDeque::new(),
            saved,
            report: vec![[0; 3]; coordinate_systems],
        }
    }

    /// Resets: back to the saved buffers, or with `factory_values` no buffers until the next reset; no program runs.
    pub fn reset(&mut self, factory_values: bool) {
        let saved = std::mem::take(&mut self.saved);
        let store = if factory_values { Store::default() } else { saved.clone() };
        *self = Self::with(store, saved, self.systems.len());
    }

    /// Saves the buffers for the next reset.
    pub fn save(&mut self) {
        self.saved = self.store.kept();
    }

    /// The oldest waiting request.
    pub fn take_request(&mut self) -> Option<Request> {
        self.requests.pop_front()
    }

    /// Queues the operand of a `CMD` for the interpreter, with a 0-based motor and coordinate system addressed.
    fn ask(&mut self, message: &Message, (motor, cs): (usize, usize), outlet: Outlet) {
        /// Most waiting lines; a program that asks faster loses some.
        const MOST: usize = 64;
        if self.requests.len() < MOST {
            self.requests.push_back(match message {
                Message::Text(text) => Request::Line { text: text.clone(), motor, cs, outlet },
                Message::Character(code) => Request::Character(*code, outlet),
            });
        }
    }

    /// Number of transformation matrices that `DEFINE TBUF` reserved.
    fn transformations(&self) -> usize {
        let tables = self.store.tables.iter().filter(|table| table.kind == TableKind::Transformation);
        tables.map(|table| table.size).sum()
    }

    /// Offset of the command at `cursor` in its buffer, in long words.
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
