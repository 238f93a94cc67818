//! How the servo interrupt and the real-time interrupt execute programs.
//!
//! Each servo cycle the trajectory advances by the time base and sets the desired positions of the coordinate system's
//! motors. Every I8+1 cycles the next lines are calculated, and executed rotary lines are freed.

use crate::sim::board::Board;
use crate::sim::board::variables::VariableKind;
use crate::sim::program::Programs;
use crate::sim::program::calculate::Calculator;
use crate::sim::program::item::Operator;
use crate::sim::program::run::{BLENDING, DWELL, RADIUS_ERROR, RUN_TIME_ERROR, SEGMENTED, SEGMENTED_RAMP};
use crate::sim::program::system::{Ending, Failure, Hold};
use crate::sim::program::trajectory::{Later, Shape};

/// PSTATUS bit 16.
const BUFFER_REQUEST: u32 = 1 << 16;

/// Work due when a move begins.
struct Begun {
    later: Vec<Later>,
    axes: [f64; 9],
    segmented: bool,
    joined: bool,
    origin: (u32, u64, usize),
    shape: Option<Shape>,
}

impl Programs {
    /// One servo cycle of all programs.
    pub fn cycle(&mut self, board: &mut Board, ms: f64) {
        let calculates = board.stats.servo_cycles.is_multiple_of(board.variables.i(8) as u64 + 1);
        for cs in 0..self.systems.len() {
            if self.systems[cs].running {
                if calculates {
                    self.real_time_interrupt(board, cs);
                }
                self.program_cycle(board, cs, ms);
            }
        }
        if calculates {
            self.foreground_plc(board);
        }
    }

    fn real_time_interrupt(&mut self, board: &mut Board, cs: usize) {
        self.calculate(board, cs);
        if let Some(failure) = self.systems[cs].failure.take() {
            let bit = if failure == Failure::CircleRadius { RADIUS_ERROR } else { RUN_TIME_ERROR };
            self.abort(board, cs);
            board.program_word(cs, 0, bit);
            for motor in board.motors_of(cs) {
                board.motors[motor].data_error = failure == Failure::RunTime;
            }
            return;
        }
        self.free_rotary_lines(board, cs);
    }

    /// Frees the executed rotary lines: those before the first line in calculation or execution.
    pub(super) fn free_rotary_lines(&mut self, board: &mut Board, cs: usize) {
        let system = &self.systems[cs];
        let lines =
            system.trajectory.entries().filter(|entry| entry.origin.0 == 0).map(|entry| entry.origin.1);
        let needed = lines.min().unwrap_or(u64::MAX).min(system.first_rotary_line());
        if let Some(rotary) = self.store.rotary_mut(cs) {
            rotary.free_before(needed);
            self.note_rotary(board, cs);
        }
    }

    /// Writes the number of lines ahead to their register, and sets the buffer request.
    pub fn note_rotary(&mut self, board: &mut Board, cs: usize) {
        let lines = self.rotary_remaining(cs).unwrap_or(0);
        board.memory.write(board.memory.registers().lines_remaining.of(cs), lines as u32);
        let lines = lines as f64;
        if lines >= board.variables.i(17) {
            board.program_word(cs, 0, BUFFER_REQUEST);
        } else if lines < board.variables.i(16) {
            board.program_word(cs, BUFFER_REQUEST, 0);
        }
    }

    /// After the deletion of a rotary buffer: the coordinate system does not point there, and no lines are ahead.
    pub fn forget_rotary(&mut self, board: &mut Board, cs: usize) {
        let system = &mut self.systems[cs];
        if system.cursor.is_some_and(|cursor| cursor.program == 0) {
            system.point(None);
        }
        self.note_rotary(board, cs);
    }

    fn program_cycle(&mut self, board: &mut Board, cs: usize, ms: f64) {
        let slew = board.setting(board.settings().hold_slew, cs) / board.variables.i(10).max(1.0);
        let mut begun: Vec<Begun> = Vec::new();
        let system = &mut self.systems[cs];
        system.hold = match system.hold {
            Hold::Stopping(factor) => Hold::Stopping((factor - slew).max(0.0)),
            Hold::Resuming(factor) if factor + slew < 1.0 => Hold::Resuming(factor + slew),
            _ => Hold::Off,
        };
        let factor = board.time_base(cs) * system.hold.factor();
        let sample = system.trajectory.advance(ms, ms * factor, |entry| {
            begun.push(Begun {
                later: std::mem::take(&mut entry.later),
                axes: entry.axes,
                segmented: entry.segmented,
                joined: entry.joined,
                origin: entry.origin,
                shape: matches!(entry.shape, Shape::Rapid(_) | Shape::Home(_)).then(|| entry.shape.clone()),
            });
        });
        let time_left = system.trajectory.time_left();
        let target = system.trajectory.executing().map(|entry| entry.target);
        for motor in board.motors_of(cs) {
            let state = &mut board.motors[motor];
            match (&sample, target) {
                (Some(sample), Some(target)) => {
                    let velocity = sample.velocity[motor] * factor;
                    state.follow(
                        sample.position[motor],
                        velocity,
                        target[motor],
                        time_left.map(|(left, _)| left),
                    );
                }
                (Some(sample), None) => {
                    let position = sample.position[motor];
                    state.follow(position, 0.0, position, None);
                }
                (None, _) => state.rest(),
            }
        }
        for begun in begun {
            self.move_begins(board, cs, begun);
        }
        self.front_of_program(board, cs);
        self.show_motion(board, cs, time_left);
        let system = &self.systems[cs];
        if system.hold == Hold::Stopping(0.0) {
            self.program_rests(board, cs, None);
        } else if system.trajectory.is_idle()
            && let Some(ending) = system.ending
        {
            self.program_rests(board, cs, Some(ending));
        }
    }

    fn move_begins(&mut self, board: &mut Board, cs: usize, begun: Begun) {
        for (number, operator, operand) in begun.later {
            let old = board.value(VariableKind::M, cs, number) as i64;
            let bits = operand as i64;
            let result = match operator {
                Operator::Or => (old | bits) as f64,
                Operator::Xor => (old ^ bits) as f64,
                Operator::And => (old & bits) as f64,
                Operator::Assign | Operator::AssignLater => operand,
            };
            board.assign(VariableKind::M, cs, number, result);
        }
        board.write_axes(cs, &begun.axes, begun.segmented);
        self.systems[cs].executing = Some(begun.origin);
        board.coordinate_word(cs, BLENDING, if begun.joined { BLENDING } else { 0 });
        match begun.shape {
            Some(Shape::Rapid(jogs)) => {
                for (motor, jog) in jogs.iter().enumerate() {
                    if let (Some(jog), true) = (jog, board.active(motor)) {
                        board.rapid(motor, jog.target, jog.speed, jog.after_trigger);
                    }
                }
            }
            Some(Shape::Home(motors)) => {
                for motor in (0..board.motors.len()).filter(|motor| motors >> motor & 1 == 1) {
                    if board.active(motor) {
                        board.search_home(motor);
                    }
                }
            }
            _ => {}
        }
    }

    /// Ends a move in front that motors execute by themselves, once they have stopped.
    fn front_of_program(&mut self, board: &mut Board, cs: usize) {
        let system = &self.systems[cs];
        let Some(entry) = system.trajectory.front().filter(|entry| entry.started) else { return };
        let motors: u32 = match &entry.shape {
            Shape::Home(motors) => *motors,
            Shape::Rapid(jogs) => {
                jogs.iter().enumerate().map(|(motor, jog)| u32::from(jog.is_some()) << motor).sum()
            }
            _ => return,
        };
        let moves = |motor: usize| motors >> motor & 1 == 1 && board.motors[motor].moving();
        if !(0..board.motors.len()).any(moves) {
            let commanded = board.commanded();
            self.systems[cs].trajectory.finish_front(commanded);
        }
    }

    fn show_motion(&mut self, board: &mut Board, cs: usize, time_left: Option<(f64, f64)>) {
        let system = &self.systems[cs];
        let executing = system.trajectory.executing();
        let segmented =
            executing.is_some_and(|entry| entry.segmented && matches!(entry.shape, Shape::Blend(_)));
        let dwelling = executing.is_some_and(|entry| matches!(entry.shape, Shape::Dwell(_)));
        let dwell =
            dwelling || system.trajectory.entries().any(|entry| matches!(entry.shape, Shape::Dwell(_)));
        let ramp = time_left.map_or(0.0, |(_, ramp)| ramp);
        let offset = system.executing.map_or(0, |(_, _, offset)| offset);
        let left = time_left.map_or(0.0, |(left, _)| left);
        self.report[cs] = [(ramp * 2.0).round() as u32, offset as u32, (left * 2.0).round() as u32];
        let mut bits = 0;
        for (bit, set) in [(SEGMENTED, segmented), (SEGMENTED_RAMP, segmented && ramp > 0.0), (DWELL, dwell)]
        {
            bits |= if set { bit } else { 0 };
        }
        board.program_word(cs, SEGMENTED | SEGMENTED_RAMP | DWELL, bits);
        for motor in board.motors_of(cs) {
            board.motors[motor].dwelling = dwelling;
        }
    }

    /// Ends calculation after the moves already calculated.
    pub(super) fn finish_calculation(&mut self, board: &mut Board, cs: usize) {
        let mut system = std::mem::take(&mut self.systems[cs]);
        Calculator { programs: self, board, system: &mut system, cs }.end(Ending::Here);
        self.systems[cs] = system;
    }
}
