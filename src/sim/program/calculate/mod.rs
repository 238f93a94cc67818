//! Calculation: executes program lines, command by command, until enough moves are ahead for the mode.
//!
//! It runs in the real-time interrupt. Straight moves without segmentation are calculated one ahead of execution, all
//! others two. Assignments take effect during calculation, not when the motion gets there (User Manual pp. 213-217).
//! After two backward jumps, or very many commands, the rest waits for the next interrupt.

pub mod flow;
mod moves;

use std::sync::Arc;

use crate::sim::board::Board;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::check_number;
use crate::sim::program::Programs;
use crate::sim::program::item::{Data, Item, Line, Mark, Mode, Operator, Time};
use crate::sim::program::message::{Outlet, send_character, send_message};
use crate::sim::program::place::Cursor;
use crate::sim::program::store::Program;
use crate::sim::program::structure::Tracker;
use crate::sim::program::system::{Ending, Failure, System};

/// Most commands per interrupt.
const MOST_ITEMS: usize = 1000;
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
            // The buffer ran empty: without segmentation the motion comes to rest now; with it, a line may still come
            // in time.
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

    /// Whether the motion is at rest; if not, closes the last move, so that nothing blends with it.
    fn at_rest(&mut self) -> bool {
        self.end_spline();
        self.system.trajectory.close();
        self.system.trajectory.is_idle()
    }

    fn item(&mut self, item: &Item, line: &Arc<Line>, cursor: Cursor) -> Flow {
        if !matches!(
            item,
            Item::Axis(..)
                | Item::Vector(..)
                | Item::Letter(..)
                | Item::Mode(_)
                | Item::Feedrate(_)
                | Item::Time(..)
                | Item::Axes(..)
                | Item::Assign(..)
        ) {
            self.make_move();
        }
        match item {
            Item::Axis(axis, position, mark) => {
                let value = self.value(position);
                let request = &mut self.system.request;
                request.axes[*axis] = Some(value);
                (request.velocities[*axis], request.triggers[*axis]) = (0.0, None);
                if let Some((mark, data)) = mark {
                    let value = self.value(data);
                    match mark {
                        Mark::Velocity => self.system.request.velocities[*axis] = value,
                        Mark::Trigger => self.system.request.triggers[*axis] = Some(value),
                    }
                }
            }
            Item::Vector(index, value) => self.system.request.vectors[*index] = Some(self.value(value)),
            Item::Letter(b'R', value) => self.system.request.radius = Some(self.value(value)),
            Item::Letter(b'S', value) => {
                let value = self.value(value);
                self.board.assign(VariableKind::Q, self.cs, SPINDLE, value);
            }
            // An argument that no `READ` took.
            Item::Letter(..)
            | Item::Label(_)
            | Item::Wait
            | Item::Address(..)
            | Item::Also(..)
            | Item::EndIf => {}
            Item::Mode(mode) => self.set_mode(*mode),
            Item::Pvt(time) => {
                let time = self.value(time);
                self.set_mode(Mode::Pvt);
                self.set_time(Time::Acceleration, time);
            }
            Item::Feedrate(value) => {
                let value = self.value(value);
                self.set_ix(89, value);
                self.board.coordinate_word(self.cs, 1 << 3, 0);
            }
            Item::Time(time, value) => {
                let value = self.value(value);
                self.set_time(*time, value);
            }
            Item::Axes(mode, list) => {
                let status = self.board.coordinate_status(self.cs)[0];
                if let Ok(status) = crate::sim::board::axes::with_mode(status, *mode, list.as_deref()) {
                    self.board.coordinate_word(self.cs, 0xFF_FFFF, status);
                }
            }
            Item::Dwell(time) => {
                let time = self.value(time);
                self.dwell(time);
            }
            Item::Delay(time) => {
                let time = self.value(time);
                self.delay(time);
            }
            Item::Home { zero: false, motors } => self.home(*motors),
            Item::Home { zero: true, motors } => {
                if !self.at_rest() {
                    return Flow::Wait;
                }
                self.home_zero(*motors);
            }
            Item::Normal => {
                let vector = following(line, cursor.item + 1, |item| match item {
                    Item::Vector(index, data) => Some((*index, data)),
                    _ => None,
                });
                let mut normal = [0.0; 3];
                for (index, data) in &vector {
                    normal[*index] = self.value(data);
                }
                self.system.normal = Some(normal);
                self.system.cursor = Some(Cursor { item: cursor.item + 1 + vector.len(), ..cursor });
            }
            Item::Pset => {
                if !self.at_rest() {
                    return Flow::Wait;
                }
                let axes = following(line, cursor.item + 1, |item| match item {
                    Item::Axis(axis, data, _) => Some((*axis, data)),
                    _ => None,
                });
                let mut target = self.system.axes;
                for (axis, data) in &axes {
                    target[*axis] = self.value(data);
                }
                self.position_set(target);
                self.system.cursor = Some(Cursor { item: cursor.item + 1 + axes.len(), ..cursor });
            }
            Item::Stop => {
                self.system.cursor = Some(if cursor.item + 1 < line.items.len() {
                    Cursor { item: cursor.item + 1, ..cursor }
                } else {
                    Cursor::at(cursor.program, cursor.line + 1)
                });
                self.end(Ending::Here);
                return Flow::Wait;
            }
            Item::BlockStart => self.system.in_block = true,
            Item::BlockStop => {
                self.system.in_block = false;
                // In step mode the whole block is one step, which ends here.
                self.system.moved = !self.system.continuous;
            }
            // The compensation is off as it is.
            Item::CutterCompensation(0) | Item::CutterRadius(_) => {}
            // It is not played: the program ends rather than moves beside its path.
            Item::CutterCompensation(_) => return self.fail(Failure::RunTime),
            Item::Select(number) => {
                let number = self.value(number).round().max(0.0) as usize;
                let count = self.programs.transformations(self.cs);
                self.system.transformations.select(number, count);
            }
            Item::Identity => {
                if let Some(matrix) = self.system.transformations.selected_mut() {
                    *matrix = Default::default();
                }
            }
            Item::Transform(transform, number) => {
                let first = self.value(number).round().max(0.0) as usize;
                self.transform(*transform, first);
            }
            Item::Plc(switch, plcs) => self.programs.switch_plcs(*plcs, *switch),
            // A compiler on the host makes compiled PLCs: this board has none.
            Item::Compiled(..) => {}
            Item::Station(transfer) => transfer.carry_out(self.board, self.cs),
            Item::Lock(lock) => lock.carry_out(self.board),
            // No motor here is commutated.
            Item::SetPhase(_) => {}
            Item::Assign(kind, number, operator, value) => self.assign(*kind, number, *operator, value),
            Item::Command(letter, text) => {
                self.programs.ask(text, 0, 0, Outlet::of_command(*letter, self.board));
            }
            Item::CommandCharacter(letter, code) => {
                self.programs.ask_character(*code, Outlet::of_command(*letter, self.board));
            }
            Item::Send(letter, text) => send_message(self.board, text, Outlet::of_message(*letter)),
            Item::SendCharacter(letter, code) => {
                send_character(self.board, *code, Outlet::of_message(*letter));
            }
            // The simulator has no display.
            Item::Display(_) => {}
            Item::Call(value) => {
                let value = self.value(value);
                return self.call(value, cursor, true);
            }
            Item::Code(letter, value) => {
                let value = self.value(value);
                let kind = match letter {
                    b'M' => 1,
                    b'T' => 2,
                    b'D' => 3,
                    _ => 0,
                };
                let program = 1000.0 + 10.0 * (value / 100.0).floor() + f64::from(kind);
                // A five-digit label: two digits of the number, three behind its point.
                return self.call(program + (value % 100.0) / 100.0, cursor, false);
            }
            Item::Gosub(label) => {
                let label = self.value(label);
                if self.push_frame(cursor) {
                    return self.jump(cursor.program, label);
                }
                return self.fail(Failure::RunTime);
            }
            Item::Goto(label) => {
                let label = self.value(label);
                return self.jump(cursor.program, label);
            }
            Item::Return if self.system.frames.is_empty() => {
                self.end(Ending::Program);
                return Flow::Wait;
            }
            Item::Return => self.give_back(),
            Item::Read(letters) => self.read(letters),
            Item::If(text) if !self.holds(text) => {
                return if cursor.item + 1 < line.items.len() {
                    self.skip_line(cursor)
                } else {
                    self.skip_block(cursor, Tracker::in_if(), true)
                };
            }
            Item::If(_) => {}
            // Reached at the end of the branch above it.
            Item::Else if cursor.item + 1 < line.items.len() => {
                self.system.cursor = Some(Cursor::at(cursor.program, cursor.line + 1));
            }
            Item::Else => return self.skip_block(cursor, Tracker::in_if(), false),
            Item::While(text) => return self.begin_loop(text, line, cursor),
            Item::EndWhile => match self.system.loops.pop() {
                Some(begin) => {
                    self.system.cursor = Some(begin);
                    return Flow::Back;
                }
                None => return self.fail(Failure::RunTime),
            },
        }
        if self.system.failure.is_some() { Flow::Wait } else { Flow::On }
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

/// The items from `first` on that `pick` accepts, up to the first that it rejects.
fn following(
    line: &Line,
    first: usize,
    pick: impl Fn(&Item) -> Option<(usize, &Data)>,
) -> Vec<(usize, &Data)> {
    line.items.iter().skip(first).map_while(pick).collect()
}
