//! Calculation: executes program lines, command by command, until enough moves are ahead for the mode.
//!
//! Calculation runs in the real-time interrupt. It calculates straight moves without segmentation one ahead of
//! execution, all other moves two ahead. Assignments take effect during calculation, not when the motion gets there
//! (User Manual pp. 213-217). After two backward jumps, or very many commands, the rest waits for the next interrupt.

pub mod flow;
mod moves;

use std::sync::Arc;

use crate::sim::board::Board;
use crate::sim::board::axes::with_mode;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::check_number;
use crate::sim::program::Programs;
use crate::sim::program::item::{Data, Item, Line, Mark, Mode, Operator, Time};
use crate::sim::program::message::{Outlet, send};
use crate::sim::program::place::Cursor;
use crate::sim::program::store::Program;
use crate::sim::program::system::{Ending, Failure, System};

/// Most commands per interrupt.
const MOST_ITEMS: usize = 1000;
/// The letters that call program 1000 and following.
pub(super) const CALLS: &[u8] = b"GMTD";
/// `S` puts its value into this Q-variable.
const SPINDLE: usize = 127;

/// How a command continues the calculation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Flow {
    /// Goes on to the next command.
    On,
    /// Repeats this command when the motion is done.
    Wait,
    /// Goes on at an earlier place.
    Back,
}

/// A calculation under way.
pub(super) struct Calculator<'a> {
    pub(super) programs: &'a mut Programs,
    pub(super) board: &'a mut Board,
    pub(super) system: &'a mut System,
    pub(super) cs: usize,
}

impl Programs {
    /// Calculates ahead for the 0-based coordinate system `cs`.
    pub fn calculate(&mut self, board: &mut Board, cs: usize) {
        let mut system = std::mem::take(&mut self.systems[cs]);
        Calculator { programs: self, board, system: &mut system, cs }.run();
        self.systems[cs] = system;
    }
}

impl Calculator<'_> {
    fn run(&mut self) {
        let mut back = 0;
        for _ in 0..MOST_ITEMS {
            let ahead = if self.system.mode == Mode::Linear && !self.segmented() { 1 } else { 2 };
            let trajectory = &self.system.trajectory;
            if !self.system.running
                || self.system.ending.is_some()
                || trajectory.blocked()
                || trajectory.ahead() >= ahead
            {
                return;
            }
            match self.step() {
                Flow::On => {}
                Flow::Wait => return,
                Flow::Back => back += 1,
            }
            if back == 2 {
                return;
            }
        }
    }

    pub(super) fn segmented(&self) -> bool {
        self.board.setting(self.board.settings().segmentation, self.cs) > 0.0
    }

    /// Coordinate-system variable Ix`n`.
    pub(super) fn ix(&self, n: usize) -> f64 {
        self.board.variables.i(self.board.variables.tables().coordinate_i(self.cs, n))
    }

    pub(super) fn value(&self, data: &Data) -> f64 {
        data.value(self.board, self.cs)
    }

    pub(super) fn program(&self, number: u32) -> Option<&Program> {
        self.programs.store.program(number)
    }

    pub(super) fn line(&self, cursor: Cursor) -> Option<Arc<Line>> {
        match cursor.program {
            0 => self.programs.store.rotary(self.cs)?.line(cursor.line).cloned(),
            number => self.program(number)?.line(cursor.line).cloned(),
        }
    }

    fn step(&mut self) -> Flow {
        let Some(cursor) = self.system.cursor else {
            self.end(Ending::Here);
            return Flow::Wait;
        };
        let Some(line) = self.line(cursor) else { return self.past_the_end(cursor) };
        let Some(item) = line.items.get(cursor.item) else { return self.end_of_line(cursor, &line) };
        let flow = self.item(item, &line, cursor);
        if flow == Flow::On && self.system.cursor == Some(cursor) {
            self.system.cursor = Some(Cursor { item: cursor.item + 1, ..cursor });
        }
        flow
    }

    fn past_the_end(&mut self, cursor: Cursor) -> Flow {
        if !self.system.frames.is_empty() {
            self.give_back();
            return Flow::On;
        }
        if cursor.program == 0 {
            // The buffer ran empty: without segmentation the motion comes to rest now; with segmentation, a line may
            // still come in time.
            self.end_spline();
            if !self.segmented() {
                self.system.trajectory.close();
            }
            return Flow::Wait;
        }
        self.end(Ending::Program);
        Flow::Wait
    }

    fn end_of_line(&mut self, cursor: Cursor, line: &Line) -> Flow {
        self.make_move();
        if self.system.failure.is_some() {
            return Flow::Wait;
        }
        let moved = std::mem::take(&mut self.system.moved);
        // `WHILE(…) statement` is a loop on one line.
        let repeated = line.items.iter().position(|item| matches!(item, Item::While(_)));
        let flow = match repeated {
            Some(item) if item + 1 < line.items.len() => {
                self.system.cursor = Some(Cursor { item, ..cursor });
                Flow::Back
            }
            _ => {
                self.system.cursor = Some(Cursor::at(cursor.program, cursor.line + 1));
                Flow::On
            }
        };
        let one_line = self.board.setting(self.board.settings().step_mode, self.cs) == 1.0;
        if !self.system.continuous && !self.system.in_block && (moved || one_line) {
            self.end(Ending::Here);
        }
        flow
    }

    /// Ends calculation; moves already calculated still execute.
    pub(super) fn end(&mut self, ending: Ending) {
        self.end_spline();
        self.system.end(ending);
    }

    pub(super) fn fail(&mut self, failure: Failure) -> Flow {
        self.system.failure = Some(failure);
        Flow::Wait
    }

    /// Whether the motion is at rest; if not, closes the last move, so that no move blends with it.
    fn at_rest(&mut self) -> bool {
        self.end_spline();
        self.system.trajectory.close();
        self.system.trajectory.is_idle()
    }

    fn item(&mut self, item: &Item, line: &Line, cursor: Cursor) -> Flow {
        let belongs_to_move = match item {
            Item::Letter(letter, _) => !CALLS.contains(letter),
            Item::Axis(..) | Item::Mode(_) | Item::Time(..) | Item::Axes(..) | Item::Assign(..) => true,
            _ => false,
        };
        if !belongs_to_move {
            self.make_move();
        }
        let branch = self.branch(item, line, cursor);
        let flow = match branch {
            Some(flow) => flow,
            None => self.motion(item, line, cursor).unwrap_or_else(|| {
                self.order(item);
                Flow::On
            }),
        };
        if flow == Flow::On && self.system.failure.is_some() { Flow::Wait } else { flow }
    }

    /// Carries out a statement that belongs to moves; `None` for another statement.
    fn motion(&mut self, item: &Item, line: &Line, cursor: Cursor) -> Option<Flow> {
        let number = item.number().map_or(0.0, |number| self.value(number));
        match item {
            Item::Axis(axis, position, mark) => {
                let value = self.value(position);
                let mark = mark.as_ref().map(|(mark, data)| (*mark, self.value(data)));
                let request = &mut self.system.request;
                request.axes[*axis] = Some(value);
                (request.velocities[*axis], request.triggers[*axis]) = match mark {
                    Some((Mark::Velocity, velocity)) => (velocity, None),
                    Some((Mark::Trigger, distance)) => (0.0, Some(distance)),
                    None => (0.0, None),
                };
            }
            Item::Letter(letter @ b'I'..=b'K', _) => {
                self.system.request.vectors[usize::from(letter - b'I')] = Some(number);
            }
            Item::Letter(b'R', _) => self.system.request.radius = Some(number),
            Item::Letter(b'S', _) => self.board.assign(VariableKind::Q, self.cs, SPINDLE, number),
            Item::Letter(b'F', _) => {
                self.set_ix(89, number);
                self.board.coordinate_word(self.cs, 1 << 3, 0);
            }
            Item::Mode(mode) => self.set_mode(*mode),
            Item::Pvt(_) => {
                self.set_mode(Mode::Pvt);
                self.set_time(Time::Acceleration, number);
            }
            Item::Time(time, _) => self.set_time(*time, number),
            Item::Axes(mode, list) => {
                let status = self.board.coordinate_status(self.cs)[0];
                if let Ok(status) = with_mode(status, *mode, list.as_deref()) {
                    self.board.coordinate_word(self.cs, 0xFF_FFFF, status);
                }
            }
            Item::Dwell(_) => self.dwell(number),
            Item::Delay(_) => self.delay(number),
            Item::Home { zero: false, motors } => self.home(*motors),
            Item::Home { zero: true, .. } | Item::Pset if !self.at_rest() => return Some(Flow::Wait),
            Item::Home { zero: true, motors } => self.home_zero(*motors),
            Item::Normal => {
                let mut normal = [0.0; 3];
                let vectors = line.items.iter().skip(cursor.item + 1).map_while(|item| match item {
                    Item::Letter(letter @ b'I'..=b'K', data) => Some((usize::from(letter - b'I'), data)),
                    _ => None,
                });
                let next = cursor.item + 1 + self.values(vectors, &mut normal);
                self.system.normal = Some(normal);
                self.system.cursor = Some(Cursor { item: next, ..cursor });
            }
            Item::Pset => {
                if self.board.keeps_origin(self.cs).is_err() {
                    return Some(self.fail(Failure::RunTime));
                }
                let mut target = self.system.axes;
                let axes = line.items.iter().skip(cursor.item + 1).map_while(|item| match item {
                    Item::Axis(axis, data, _) => Some((*axis, data)),
                    _ => None,
                });
                let next = cursor.item + 1 + self.values(axes, &mut target);
                self.position_set(target);
                self.system.cursor = Some(Cursor { item: next, ..cursor });
            }
            Item::Select(_) => {
                let count = self.programs.transformations();
                self.system.transformations.select(number.round().max(0.0) as usize, count);
            }
            Item::Identity => {
                if let Some(matrix) = self.system.transformations.selected_mut() {
                    *matrix = Default::default();
                }
            }
            Item::Transform(transform, _) => self.transform(*transform, number.round().max(0.0) as usize),
            // The program ends rather than moves beside its path.
            Item::CutterCompensation(1..) => return Some(self.fail(Failure::RunTime)),
            _ => return None,
        }
        Some(Flow::On)
    }

    /// Puts the values of numbered data into their places; says how many they are.
    fn values<'d>(&self, data: impl Iterator<Item = (usize, &'d Data)>, places: &mut [f64]) -> usize {
        data.map(|(place, data)| places[place] = self.value(data)).count()
    }

    /// Carries out a statement that neither moves nor branches. The simulated board has no display, no motor that it
    /// commutates and no compiled PLC, so statements about these do nothing, and neither does a letter that no `READ`
    /// has taken.
    fn order(&mut self, item: &Item) {
        match item {
            Item::Plc(switch, plcs) => self.programs.switch_plcs(*plcs, *switch),
            Item::Station(transfer) => transfer.carry_out(self.board, self.cs),
            Item::Lock(lock) => lock.carry_out(self.board),
            Item::Assign(kind, number, operator, value) => self.assign(*kind, number, *operator, value),
            Item::Command(letter, message) => {
                self.programs.ask(message, (0, 0), Outlet::of_command(*letter, self.board));
            }
            Item::Send(letter, message) => send(self.board, message, Outlet::of_message(*letter)),
            _ => {}
        }
    }

    fn assign(&mut self, kind: VariableKind, number: &Data, operator: Operator, value: &Data) {
        let Ok(number) = check_number(self.value(number), self.board) else { return };
        let value = self.value(value);
        if operator == Operator::Assign {
            self.board.assign(kind, self.cs, number, value);
        } else {
            self.system.later.push((number, operator, value));
        }
    }
}
