//! Kinematic programs: the relation between the axes of a coordinate system and its motors that are defined as `#n->I`
//! (Turbo User Manual pp. 261-267).
//!
//! The forward program makes axis positions, Q1 (A) to Q9 (Z), from motor positions, P1 to P32: at `R`, `S` and
//! `PMATCH`. The inverse program makes motor positions from axis positions: at the end of each segment of a LINEAR or
//! CIRCLE move, at the end of every other move. Isx50 enables both.

use super::Programs;
use super::plc::{MOST_LINES, Scan};
use super::store::{Open, Program};
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::motor::{Motors, STILL};
use crate::sim::board::variables::VariableKind::{P, Q};

/// Q10 tells the inverse program whether to make velocities, too: from Q11 to Q19, into P101 to P132.
const WITH_VELOCITIES: usize = 10;
const MOTOR_VELOCITIES: usize = 100;

impl Programs {
    /// Whether the kinematic programs that the coordinate system needs are present and whole.
    ///
    /// # Errors
    /// ERR015 for an empty program, ERR016 for a program with a block that does not end.
    pub fn check_kinematics(&self, board: &mut Board, cs: usize) -> Result<(), CommandError> {
        if board.kinematic_motors(cs).is_empty() {
            return Ok(());
        }
        for inverse in [false, true] {
            let program = self.store.kinematics(cs, inverse).filter(|program| program.words() > 0);
            let (error, reason) = match program.map(Program::is_structured) {
                None => (CommandError::NO_PROGRAM, "is empty"),
                Some(false) => (CommandError::BAD_STRUCTURE, "has a block that does not end"),
                Some(true) => continue,
            };
            let name = name(inverse);
            board.note(format!(
                "coordinate system {} does not start: its {name} kinematic program {reason}",
                cs + 1
            ));
            return Err(error);
        }
        Ok(())
    }

    /// `PMATCH`: takes the axis positions from the motors, unless a program runs.
    ///
    /// # Errors
    /// The errors of a start that lacks a kinematic program.
    pub fn match_positions(&mut self, board: &mut Board, cs: usize) -> Result<(), CommandError> {
        let Some(system) = self.systems.get_mut(cs).filter(|system| !system.running) else { return Ok(()) };
        system.rematch = true;
        let mut axes = system.axes;
        self.check_kinematics(board, cs)?;
        if self.axis_positions(board, cs, &mut axes) { Ok(()) } else { Err(CommandError::BAD_STRUCTURE) }
    }

    /// Puts the axis positions that follow from the motors' commanded positions into `axes`; `false` when the forward kinematic
    /// program does not end.
    pub fn axis_positions(&mut self, board: &mut Board, cs: usize, axes: &mut [f64; 9]) -> bool {
        board.axis_positions(cs, axes);
        if board.kinematic_motors(cs).is_empty() {
            return true;
        }
        for motor in board.motors_of(cs) {
            let position = board.motors[motor].commanded() + board.bias(motor);
            board.assign(P, cs, motor + 1, position);
        }
        put_axes(board, cs, 1, axes);
        let ends = self.run_kinematics(board, cs, false);
        for (index, axis) in axes.iter_mut().enumerate() {
            *axis = board.value(Q, cs, 1 + index);
        }
        ends
    }

    /// Where the motors of the coordinate system are when its axes are at `axes`, and how fast when the axes go at `velocities`; motors
    /// of others stay at `otherwise`. `None` when the inverse kinematic program does not end.
    pub fn motor_targets(
        &mut self,
        board: &mut Board,
        cs: usize,
        axes: &[f64; 9],
        velocities: Option<&[f64; 9]>,
        otherwise: &Motors,
    ) -> Option<[Motors; 2]> {
        let mut targets = board.motor_targets(cs, axes, otherwise);
        let mut speeds = velocities.map_or(STILL, |velocities| board.motor_vector(cs, velocities));
        let motors = board.kinematic_motors(cs);
        if motors.is_empty() {
            return Some([targets, speeds]);
        }
        put_axes(board, cs, 1, axes);
        board.assign(Q, cs, WITH_VELOCITIES, f64::from(u8::from(velocities.is_some())));
        if let Some(velocities) = velocities {
            put_axes(board, cs, WITH_VELOCITIES + 1, velocities);
        }
        if !self.run_kinematics(board, cs, true) {
            return None;
        }
        for motor in motors {
            targets[motor] = board.value(P, cs, motor + 1) - board.bias(motor);
            if velocities.is_some() {
                speeds[motor] = board.value(P, cs, MOTOR_VELOCITIES + motor + 1);
            }
        }
        Some([targets, speeds])
    }

    /// Runs a kinematic program from its top to its end; `false` when it does not come to its end.
    fn run_kinematics(&mut self, board: &mut Board, cs: usize, inverse: bool) -> bool {
        let mut scan = Scan::new(self, board, Open::Kinematics { inverse, cs }, cs);
        let ends = (0..MOST_LINES).any(|_| scan.is_over_after_a_line());
        if !ends {
            let name = name(inverse);
            board.note(format!(
                "coordinate system {}: its {name} kinematic program does not come to its end",
                cs + 1
            ));
        }
        ends
    }
}

fn name(inverse: bool) -> &'static str {
    if inverse { "inverse" } else { "forward" }
}

fn put_axes(board: &mut Board, cs: usize, first: usize, axes: &[f64; 9]) {
    for (index, &axis) in axes.iter().enumerate() {
        board.assign(Q, cs, first + index, axis);
    }
}
