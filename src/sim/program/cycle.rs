//! The servo interrupt's and the real-time interrupt's part in running programs.
//!
//! Each servo cycle the trajectory goes on by the time base, and the motors of the coordinate system are told where to
//! be. Every I8+1 cycles the next lines are calculated, and rotary lines that are done with are freed.

use super::calculate::Calculator;
use super::item::Operator;
use super::run::{BLENDING, DWELL, RADIUS_ERROR, RUN_TIME_ERROR, SEGMENTED, SEGMENTED_RAMP};
use super::system::{Ending, Failure, Hold};
use super::trajectory::{Later, Shape};
use crate::sim::board::{Board, MOTORS};
use crate::sim::language::variables::{VariableKind, assign, value};
use crate::sim::offsets;

/// PSTATUS bit 16.
const BUFFER_REQUEST: u32 = 1 << 16;

/// What has to be done when a move begins.
struct Begun {
    later: Vec<Later>,
    axes: [f64; 9],
    segmented: bool,
    joined: bool,
    origin: (u32, u64, usize),
    shape: Option<Shape>,
}

impl Board {
    /// One servo cycle of all programs; `time_base` has 1.0 for 100%.
    pub(in crate::sim) fn programs_cycle(&mut self, ms: f64, time_base: &[f64; MOTORS]) {
        let calculates = self.stats.servo_cycles.is_multiple_of(self.variables.i(8) as u64 + 1);
        for (cs, &factor) in time_base.iter().enumerate() {
            if self.programs.systems[cs].running {
                if calculates {
                    self.real_time_interrupt(cs);
                }
                self.program_cycle(cs, ms, factor);
            }
        }
        if calculates {
            self.foreground_plc();
        }
    }

    fn real_time_interrupt(&mut self, cs: usize) {
        self.calculate(cs);
        if let Some(failure) = self.programs.systems[cs].failure.take() {
            let bit = if failure == Failure::CircleRadius { RADIUS_ERROR } else { RUN_TIME_ERROR };
            self.abort(cs);
            self.program_word(cs, 0, bit);
            for motor in self.motors_of(cs) {
                self.motors[motor].data_error = failure == Failure::RunTime;
            }
            return;
        }
        self.free_rotary_lines(cs);
    }

    fn free_rotary_lines(&mut self, cs: usize) {
        let system = &self.programs.systems[cs];
        let lines =
            system.trajectory.entries().filter(|entry| entry.origin.0 == 0).map(|entry| entry.origin.1);
        let needed = lines.min().unwrap_or(u64::MAX).min(system.rotary_line());
        if let Some(rotary) = self.programs.store.rotary_mut(cs) {
            rotary.free_before(needed);
            self.note_rotary(cs);
        }
    }

    /// Shows the lines ahead in their register, and the buffer request.
    pub(in crate::sim) fn note_rotary(&mut self, cs: usize) {
        let lines = self.rotary_remaining(cs).unwrap_or(0);
        self.memory.write_y(offsets::background(offsets::LINES_REMAINING, cs), lines as u32);
        let lines = lines as f64;
        if lines >= self.variables.i(17) {
            self.program_word(cs, 0, BUFFER_REQUEST);
        } else if lines < self.variables.i(16) {
            self.program_word(cs, BUFFER_REQUEST, 0);
        }
    }

    fn program_cycle(&mut self, cs: usize, ms: f64, time_base: f64) {
        let slew = self.variables.i(52) / self.variables.i(10).max(1.0);
        let mut begun: Vec<Begun> = Vec::new();
        let system = &mut self.programs.systems[cs];
        system.hold = match system.hold {
            Hold::Stopping(factor) => Hold::Stopping((factor - slew).max(0.0)),
            Hold::Resuming(factor) if factor + slew < 1.0 => Hold::Resuming(factor + slew),
            _ => Hold::Off,
        };
        let factor = time_base * system.hold.factor();
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
        for motor in self.motors_of(cs) {
            let state = &mut self.motors[motor];
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
            self.move_begins(cs, begun);
        }
        self.front_of_program(cs);
        self.show_motion(cs, time_left);
        let system = &self.programs.systems[cs];
        if system.hold == Hold::Stopping(0.0) {
            self.program_rests(cs, None);
        } else if system.trajectory.is_idle()
            && let Some(ending) = system.ending
        {
            self.program_rests(cs, Some(ending));
        }
    }

    fn move_begins(&mut self, cs: usize, begun: Begun) {
        for (number, operator, operand) in begun.later {
            let old = value(self, VariableKind::M, cs, number) as i64;
            let bits = operand as i64;
            let result = match operator {
                Operator::Or => (old | bits) as f64,
                Operator::Xor => (old ^ bits) as f64,
                Operator::And => (old & bits) as f64,
                Operator::Assign | Operator::AssignLater => operand,
            };
            assign(self, VariableKind::M, cs, number, result);
        }
        self.write_axes(cs, &begun.axes, begun.segmented);
        self.programs.systems[cs].executing = Some(begun.origin);
        self.coordinate_word(cs, BLENDING, if begun.joined { BLENDING } else { 0 });
        match begun.shape {
            Some(Shape::Rapid(jogs)) => {
                for (motor, jog) in jogs.iter().enumerate() {
                    if let (Some(jog), true) = (jog, self.active(motor)) {
                        self.rapid(motor, jog.target, jog.speed, jog.after_trigger);
                    }
                }
            }
            Some(Shape::Home(motors)) => {
                for motor in (0..MOTORS).filter(|motor| motors >> motor & 1 == 1) {
                    if self.active(motor) {
                        self.search_home(motor);
                    }
                }
            }
            _ => {}
        }
    }

    /// Ends a move that motors make by themselves when they have stopped.
    fn front_of_program(&mut self, cs: usize) {
        let system = &self.programs.systems[cs];
        let Some(entry) = system.trajectory.front().filter(|entry| entry.started) else { return };
        let motors: u8 = match &entry.shape {
            Shape::Home(motors) => *motors,
            Shape::Rapid(jogs) => {
                (0..MOTORS).filter(|&motor| jogs[motor].is_some()).map(|motor| 1 << motor).sum()
            }
            _ => return,
        };
        let moves = |motor: usize| motors >> motor & 1 == 1 && self.motors[motor].moving();
        if !(0..self.motors.len()).any(moves) {
            let commanded = self.commanded();
            self.programs.systems[cs].trajectory.finish_front(commanded);
        }
    }

    fn show_motion(&mut self, cs: usize, time_left: Option<(f64, f64)>) {
        let system = &self.programs.systems[cs];
        let executing = system.trajectory.executing();
        let segmented =
            executing.is_some_and(|entry| entry.segmented && matches!(entry.shape, Shape::Blend(_)));
        let dwelling = executing.is_some_and(|entry| matches!(entry.shape, Shape::Dwell(_)));
        let dwell =
            dwelling || system.trajectory.entries().any(|entry| matches!(entry.shape, Shape::Dwell(_)));
        let ramp = time_left.map_or(0.0, |(_, ramp)| ramp);
        let offset = system.executing.map_or(0, |(_, _, offset)| offset);
        self.programs.report[cs] = [(ramp * 2.0).round() as u32, offset as u32];
        let mut bits = 0;
        for (bit, set) in [(SEGMENTED, segmented), (SEGMENTED_RAMP, segmented && ramp > 0.0), (DWELL, dwell)]
        {
            bits |= if set { bit } else { 0 };
        }
        self.program_word(cs, SEGMENTED | SEGMENTED_RAMP | DWELL, bits);
        for motor in self.motors_of(cs) {
            self.motors[motor].dwelling = dwelling;
        }
    }

    /// Ends calculation after what is there.
    pub(super) fn finish_calculation(&mut self, cs: usize) {
        let mut system = std::mem::take(&mut self.programs.systems[cs]);
        Calculator { board: self, system: &mut system, cs }.end(Ending::Here);
        self.programs.systems[cs] = system;
    }
}
