//! Run, step, hold, quit, abort: what commands do to the program of a coordinate system (Software Reference,
//! "On-line commands"; error codes p. 25). Coordinate systems are 0-based.

use super::path::Motors;
use super::store::Program;
use super::system::{Cursor, Ending, Hold};
use super::{Programs, split};
use crate::sim::board::{Board, MOTORS};
use crate::sim::language::{CommandError, check_start};
use crate::sim::{coordinate, offsets};

type Result = std::result::Result<(), CommandError>;

/// Counts that a motor may be off the place where the program stopped.
const SAME_PLACE: f64 = 1.0 / 16.0;

/// `??` word 1: running, single step, continuous mode, continuous request.
const RUNNING: u32 = 1;
const SINGLE_STEP: u32 = 1 << 1;
pub(super) const BLENDING: u32 = 1 << 2;
const CONTINUOUS: u32 = 1 << 4;
/// `??` word 2.
pub(super) const HOLD_STOP: u32 = 1 << 23;
pub(super) const RUN_TIME_ERROR: u32 = 1 << 22;
pub(super) const RADIUS_ERROR: u32 = 1 << 21;
pub(super) const BLOCK_STOP: u32 = 1 << 14;
pub(super) const DWELL: u32 = 1 << 12;
pub(super) const SEGMENTED: u32 = 1 << 7;
pub(super) const SEGMENTED_RAMP: u32 = 1 << 6;
pub(super) const SEGMENTED_STOP: u32 = 1 << 5;

impl Programs {
    /// Whether `B{number}` can point there: a program with that label, or the rotary buffer for 0.
    fn cursor(&self, cs: usize, number: f64) -> Option<Cursor> {
        match split(number) {
            (0, 0) => self.store.rotary(cs).map(|rotary| Cursor::at(0, rotary.first())),
            (program, label) => {
                let line = self.store.program(program)?.label(label)?;
                Some(Cursor::at(program, line))
            }
        }
    }
}

impl Board {
    /// `B{number}`: the fraction is a label, 0 the rotary buffer.
    ///
    /// # Errors
    /// ERR001 while a program runs, ERR003 when there is no such program or label.
    pub fn begin(&mut self, cs: usize, number: f64) -> Result {
        if coordinate::running(cs.min(MOTORS - 1), &self.memory) {
            return Err(CommandError::RUNNING);
        }
        let cursor = self.programs.cursor(cs, number).ok_or(CommandError::SYNTAX)?;
        self.forget_motion(cs);
        self.programs.systems[cs].point(Some(cursor));
        self.programs.systems[cs].executing = None;
        Ok(())
    }

    /// `R`: runs on from the pointer; out of a hold, goes on.
    ///
    /// # Errors
    /// ERR015 to ERR010 as the motors and the pointer are, ERR017 away from where it stopped, ERR016 for open blocks.
    pub fn run(&mut self, cs: usize) -> Result {
        self.start_program(cs, true)
    }

    /// `S`: as [`Board::run`], for one move.
    ///
    /// # Errors
    /// As [`Board::run`].
    pub fn step(&mut self, cs: usize) -> Result {
        self.start_program(cs, false)
    }

    fn start_program(&mut self, cs: usize, continuous: bool) -> Result {
        self.release_hold(cs);
        let Some(system) = self.programs.systems.get(cs) else { return Err(CommandError::SYNTAX) };
        if system.running {
            return Ok(());
        }
        let pointed = system.cursor.is_some() && self.programs.store.open_program().is_none();
        check_start(self, cs, pointed)?;
        let commanded = self.commanded();
        let system = &self.programs.systems[cs];
        if let Some(place) = system.stopped_at {
            let off = |motor: &usize| (place[*motor] - commanded[*motor]).abs() > SAME_PLACE;
            if self.motors_of(cs).iter().any(off) {
                return Err(CommandError::NOT_AT_STOP);
            }
        }
        let number = system.pointed()?.program;
        if !self.programs.store.program(number).is_none_or(Program::is_structured) {
            return Err(CommandError::BAD_STRUCTURE);
        }
        let resumes = matches!(system.hold, Hold::Stopping(_));
        let matching = self.variables.i(14) == 1.0 || system.rematch;
        let mut axes = system.axes;
        if !resumes && matching {
            self.axis_positions(cs, &mut axes);
        }
        let system = &mut self.programs.systems[cs];
        if resumes {
            system.hold = Hold::Resuming(system.hold.factor());
        } else {
            system.trajectory.reset(commanded);
            system.axes = axes;
            system.rematch = false;
        }
        system.running = true;
        system.continuous = continuous;
        system.ending = None;
        system.failure = None;
        system.stopped_at = None;
        let mode = system.mode.status();
        let kind = if continuous { CONTINUOUS } else { SINGLE_STEP };
        self.coordinate_word(cs, RUNNING | SINGLE_STEP | BLENDING | CONTINUOUS, RUNNING | kind);
        let cleared =
            HOLD_STOP | RUN_TIME_ERROR | RADIUS_ERROR | BLOCK_STOP | DWELL | SEGMENTED_STOP | 0b1_0011;
        self.program_word(cs, cleared, mode);
        for motor in self.motors_of(cs) {
            self.motors[motor].data_error = false;
        }
        self.write_axes(cs, &axes, false);
        Ok(())
    }

    /// `Q`: what is calculated still moves; the pointer is at the next line.
    pub fn quit(&mut self, cs: usize) {
        if self.programs.systems.get(cs).is_some_and(|system| system.running) {
            self.finish_calculation(cs);
        } else {
            coordinate::stop_program(cs.min(MOTORS - 1), &mut self.memory);
        }
    }

    /// `/`: the move under way is the last one; the pointer is at the one after it.
    pub fn stop_after_move(&mut self, cs: usize) {
        let Some(system) = self.programs.systems.get_mut(cs).filter(|system| system.running) else {
            coordinate::stop_program(cs.min(MOTORS - 1), &mut self.memory);
            return;
        };
        let dropped = system.trajectory.drop_ahead();
        let held = system.cutter.forget().map(|cursor| Cursor::at(cursor.program, cursor.line));
        let first = dropped.first().map(|first| Cursor::at(first.origin.0, first.origin.1));
        if let Some(first) = first.or(held) {
            system.cursor = Some(first);
            system.spline = None;
            system.request = Default::default();
            match system.trajectory.entries().last() {
                Some(last) => system.axes = last.axes,
                None => system.rematch = true,
            }
        }
        system.end(Ending::Here);
        self.program_word(cs, BLOCK_STOP, BLOCK_STOP);
    }

    /// `\`: segmented moves stop on their path, at the I52 rate; others at their end.
    pub fn program_hold(&mut self, cs: usize) {
        let segmented = |system: &super::System| {
            system.running
                && system.trajectory.executing().is_some_and(|entry| entry.segmented && !entry.breaks())
        };
        match self.programs.systems.get_mut(cs) {
            Some(system) if segmented(system) => {
                system.hold = Hold::Stopping(system.hold.factor());
                self.program_word(cs, SEGMENTED_STOP, SEGMENTED_STOP);
            }
            _ => self.stop_after_move(cs),
        }
    }

    /// Ends the program of `cs` at once: for aborts, limits and fatal errors, which see to the motors themselves.
    pub(in crate::sim) fn end_program(&mut self, cs: usize) {
        coordinate::stop_program(cs, &mut self.memory);
        self.program_word(cs, SEGMENTED | SEGMENTED_RAMP | SEGMENTED_STOP | DWELL, 0);
        let system = &mut self.programs.systems[cs];
        system.running = false;
        system.rematch = true;
        system.ending = None;
        system.stopped_at = None;
        self.forget_motion(cs);
    }

    /// Drops the calculated moves.
    fn forget_motion(&mut self, cs: usize) {
        let commanded = self.commanded();
        let system = &mut self.programs.systems[cs];
        system.trajectory.reset(commanded);
        system.spline = None;
        system.cutter.forget();
        system.request = Default::default();
        system.later.clear();
        system.hold = Hold::Off;
    }

    /// The program has come to rest: as its `ending` says, or held in mid-path by `\`.
    pub(super) fn program_rests(&mut self, cs: usize, ending: Option<Ending>) {
        coordinate::stop_program(cs, &mut self.memory);
        let commanded = self.commanded();
        let system = &mut self.programs.systems[cs];
        system.running = false;
        system.ending = None;
        match ending {
            Some(Ending::Program) => {
                let main = system.frames.first().map(|frame| frame.back).or(system.cursor);
                let begin = main.map(|cursor| Cursor::at(cursor.program, 0));
                system.point(begin);
            }
            _ => system.stopped_at = Some(commanded),
        }
        let (clear, set) = match ending {
            None => (0, HOLD_STOP),
            Some(_) => (SEGMENTED | SEGMENTED_RAMP | SEGMENTED_STOP | DWELL, 0),
        };
        self.program_word(cs, clear, set);
        for motor in self.motors_of(cs) {
            let motor = &mut self.motors[motor];
            motor.rest();
            motor.set_pre_jog(motor.commanded());
        }
    }

    /// Opening a fixed program makes every coordinate system forget where it points to.
    pub fn forget_pointers(&mut self) {
        for system in &mut self.programs.systems {
            system.point(None);
        }
    }

    /// The commanded positions of all motors in counts.
    pub(super) fn commanded(&self) -> Motors {
        std::array::from_fn(|motor| self.motors.get(motor).map_or(0.0, |motor| motor.commanded()))
    }

    /// Changes the first `??` word: clears `clear`, then sets `set`.
    pub(super) fn coordinate_word(&mut self, cs: usize, clear: u32, set: u32) {
        let address = offsets::background(offsets::COORDINATE_STATUS, cs);
        let word = self.memory.read_x(address);
        self.memory.write_x(address, word & !clear | set);
    }

    /// Changes the second `??` word likewise.
    pub(super) fn program_word(&mut self, cs: usize, clear: u32, set: u32) {
        let address = offsets::background(offsets::PROGRAM_STATUS, cs);
        let word = self.memory.read_y(address);
        self.memory.write_y(address, word & !clear | set);
    }

    /// Writes the axis target registers; those of segmented moves too when they are in use.
    pub(super) fn write_axes(&mut self, cs: usize, axes: &[f64; 9], segmented: bool) {
        for (index, &axis) in axes.iter().enumerate() {
            let register = |first| offsets::background(first, cs) + index as u16;
            self.memory.write_l(register(offsets::AXIS_TARGET_C), axis);
            if segmented {
                self.memory.write_l(register(offsets::AXIS_TARGET_A), axis);
            }
        }
    }
}
