//! PLC programs: PLC 0 in the real-time interrupt, PLC 1 to 31 in the background (User Manual, "Writing a PLC
//! program").
//!
//! I5 enables PLCs: 1 PLC 0, 2 the others, 3 both. A scan goes from the top to the end, or to the `ENDWHILE` of a loop
//! that continues; the next scan resumes at its `WHILE`. Opening a PLC's buffer disables the PLC; a reset enables all
//! PLCs.

use std::sync::Arc;

use super::Programs;
use super::message::{Outlet, send};
use crate::sim::board::Board;
use crate::sim::language::expression::{check_number, condition};
use crate::sim::language::scanner::Scanner;
use crate::sim::program::item::{Item, Joint, Line, PlcSwitch};
use crate::sim::program::store::{Open, PLCS};
use crate::sim::program::structure::{Effect, Tracker};

/// Most lines of one scan, or of a kinematic program.
pub(super) const MOST_LINES: usize = 10_000;

/// The begin of a PLC's next scan, and the motor and coordinate system that the PLC has addressed.
#[derive(Debug, Clone, Copy, Default)]
struct PlcState {
    line: usize,
    motor: usize,
    cs: usize,
}

/// All PLC programs.
#[derive(Debug, Clone)]
pub struct Plcs {
    /// Bit n for PLC n.
    enabled: u32,
    /// The enabled PLCs that stand still where `PAUSE` has stopped them.
    paused: u32,
    states: [PlcState; PLCS],
}

impl Default for Plcs {
    fn default() -> Self {
        Self { enabled: u32::MAX, paused: 0, states: [PlcState::default(); PLCS] }
    }
}

impl Programs {
    /// `ENABLE PLC` and the like: bit n for PLC n. `RESUME` moves none that `DISABLE` has stopped.
    pub fn switch_plcs(&mut self, plcs: u32, switch: PlcSwitch) {
        let all = &mut self.plcs;
        match switch {
            PlcSwitch::Enable => {
                let fresh = plcs & (!all.enabled | all.paused);
                for number in (0..PLCS).filter(|number| fresh >> number & 1 == 1) {
                    all.states[number] = PlcState::default();
                }
                all.enabled |= plcs;
                all.paused &= !plcs;
            }
            PlcSwitch::Disable => {
                all.enabled &= !plcs;
                all.paused &= !plcs;
            }
            PlcSwitch::Pause => all.paused |= plcs & all.enabled,
            PlcSwitch::Resume => all.paused &= !plcs,
        }
    }

    /// PLC 0, with I5 odd.
    pub(super) fn foreground_plc(&mut self, board: &mut Board) {
        if board.variables.i(5) as u32 & 1 == 1 {
            self.scan_plc(board, 0);
        }
    }

    /// PLC 1 to 31, with I5 of 2 or 3.
    pub fn background_plcs(&mut self, board: &mut Board) {
        if board.variables.i(5) as u32 & 2 == 2 {
            for number in 1..PLCS {
                self.scan_plc(board, number);
            }
        }
    }

    fn scan_plc(&mut self, board: &mut Board, number: usize) {
        let begun = |programs: &Self| {
            programs.plcs.enabled >> number & 1 == 1 && programs.store.open() != Some(Open::Plc(number))
        };
        let paused = |programs: &Self| programs.plcs.paused >> number & 1 == 1;
        let begin = self.plcs.states[number];
        let state = PlcState { line: 0, ..begin };
        let mut scan = Scan { programs: self, board, program: Open::Plc(number), state, at: begin.line };
        for _ in 0..MOST_LINES {
            if !begun(scan.programs) || paused(scan.programs) {
                break;
            }
            let Some(line) = scan.line(scan.at) else { break };
            if scan.carry_out(&line, 0) == Next::Scan {
                break;
            }
        }
        let PlcState { line, motor, cs } = scan.state;
        let at = scan.at;
        if begun(self) {
            let line = if paused(self) { at } else { line };
            self.plcs.states[number] = PlcState { line, motor, cs };
        }
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Next {
    Line,
    Scan,
}

/// A PLC or a kinematic program on its way.
pub(super) struct Scan<'a> {
    programs: &'a mut Programs,
    board: &'a mut Board,
    program: Open,
    state: PlcState,
    at: usize,
}

impl<'a> Scan<'a> {
    /// From the top of `program`, with the 0-based coordinate system `cs` addressed.
    pub(super) fn new(programs: &'a mut Programs, board: &'a mut Board, program: Open, cs: usize) -> Self {
        Self { programs, board, program, state: PlcState { cs, ..PlcState::default() }, at: 0 }
    }

    /// Executes a line of a program that goes through its loops to its end without a pause; whether there was none left.
    pub(super) fn is_over_after_a_line(&mut self) -> bool {
        let Some(line) = self.line(self.at) else { return true };
        if self.carry_out(&line, 0) == Next::Scan {
            self.at = self.state.line;
        }
        false
    }

    fn line(&self, number: usize) -> Option<Arc<Line>> {
        self.programs.store.fixed(self.program)?.line(number as u64).cloned()
    }

    /// Executes the line at `at` from item `first` on, and advances `at`.
    fn carry_out(&mut self, line: &Line, first: usize) -> Next {
        for (index, item) in line.items.iter().enumerate().skip(first) {
            let last = index + 1 == line.items.len();
            let cs = self.state.cs;
            match item {
                Item::If(text) if !self.holds(text, last) => {
                    return if last { self.skip(Tracker::in_if(), true) } else { self.skip_short() };
                }
                Item::While(text) if !self.holds(text, last) => {
                    return if last {
                        self.skip(Tracker::in_while(), false)
                    } else {
                        self.at += 1;
                        Next::Line
                    };
                }
                Item::Else if last => return self.skip(Tracker::in_if(), false),
                Item::Else => break,
                Item::EndWhile => {
                    self.state.line = self.begin_of_loop();
                    return Next::Scan;
                }
                Item::Assign(kind, number, _, value) => {
                    let number = number.value(self.board, cs);
                    let value = value.value(self.board, cs);
                    if let Ok(number) = check_number(number, self.board) {
                        self.board.assign(*kind, cs, number, value);
                    }
                }
                Item::Return => {
                    self.at = usize::MAX;
                    return Next::Line;
                }
                Item::Station(transfer) => transfer.carry_out(self.board, cs),
                Item::Lock(lock) => lock.carry_out(self.board),
                Item::Plc(switch, plcs) => self.programs.switch_plcs(*plcs, *switch),
                Item::Command(letter, message) => {
                    let addressed = (self.state.motor, self.state.cs);
                    self.programs.ask(message, addressed, Outlet::of_command(*letter, self.board));
                }
                Item::Send(letter, message) => send(self.board, message, Outlet::of_message(*letter)),
                Item::Address(motor, cs) => {
                    self.state.motor = motor.unwrap_or(self.state.motor);
                    self.state.cs = cs.unwrap_or(self.state.cs);
                }
                _ => {}
            }
        }
        // `WHILE(…) statement`: the next scan repeats the loop.
        if line.items.len() > 1 && line.items.iter().any(|item| matches!(item, Item::While(_))) {
            self.state.line = self.at;
            return Next::Scan;
        }
        self.at += 1;
        Next::Line
    }

    /// Whether the condition on the line at `at` is true; with `goes_on`, together with the lines below that continue
    /// it.
    fn holds(&self, text: &str, goes_on: bool) -> bool {
        let mut whole = format!("({text})");
        for line in (self.at + 1..).map_while(|number| self.line(number).filter(|_| goes_on)) {
            let Some(Item::Also(joint, text)) = line.items.first() else { break };
            whole += if *joint == Joint::And { "AND(" } else { "OR(" };
            whole += text;
            whole.push(')');
        }
        condition(&mut Scanner::new(whole.as_bytes()), self.board, self.state.cs).unwrap_or(false)
    }

    /// Skips a short IF; continues in the `ELSE` of the next line, if any.
    fn skip_short(&mut self) -> Next {
        self.at += 1;
        match self.line(self.at) {
            Some(line) if line.items.first() == Some(&Item::Else) => self.carry_out(&line, 1),
            _ => Next::Line,
        }
    }

    fn skip(&mut self, mut tracker: Tracker, stop_at_else: bool) -> Next {
        loop {
            self.at += 1;
            let Some(line) = self.line(self.at) else { return Next::Scan };
            for index in 0..line.items.len() {
                let outermost = tracker.depth() == 1;
                let found = match tracker.item(&line, index) {
                    Ok(Effect::Else) => outermost && stop_at_else,
                    Ok(Effect::Ends) => outermost,
                    Ok(Effect::None) => false,
                    Err(_) => return Next::Scan,
                };
                if found {
                    return self.carry_out(&line, index + 1);
                }
            }
        }
    }

    /// The line of the `WHILE` that belongs to the `ENDWHILE` at `at`.
    fn begin_of_loop(&self) -> usize {
        let mut depth = 0;
        for number in (0..self.at).rev() {
            let Some(line) = self.line(number) else { break };
            for (index, item) in line.items.iter().enumerate().rev() {
                match item {
                    Item::EndWhile => depth += 1,
                    Item::While(_) if index + 1 == line.items.len() && depth == 0 => return number,
                    Item::While(_) if index + 1 == line.items.len() => depth -= 1,
                    _ => {}
                }
            }
        }
        0
    }
}
