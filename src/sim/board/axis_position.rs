//! Axis positions at rest: from the motors' positions through the axis definitions, and back by the position bias.
//!
//! A motor's position is the sum of its terms (counts per unit times axis) and its offset. The position bias is the
//! difference between that and the position that counts from home, to which limits refer (Software Reference pp. 179,
//! 273).

use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::motor::{Motors, STILL};

/// Isx50.
const KINEMATICS: usize = 50;
/// The order of the axis registers.
const AXES: [char; 9] = ['A', 'B', 'C', 'U', 'V', 'W', 'X', 'Y', 'Z'];

/// One motor's equation: a coefficient an axis, and their sum.
type Row = [f64; AXES.len() + 1];

impl Board {
    /// `Z`: makes all axis positions of the 0-based coordinate system zero.
    ///
    /// # Errors
    /// ERR001 while a program runs, ERR011 while one of its motors moves.
    pub fn zero_axes(&mut self, cs: usize) -> Result<(), CommandError> {
        self.at_rest(cs)?;
        self.keeps_origin(cs)?;
        self.set_axes(cs, &[0.0; AXES.len()]);
        Ok(())
    }

    /// `{axis}={position}`, in user units.
    ///
    /// # Errors
    /// ERR003 when no motor of the coordinate system moves the axis, ERR001 while a program runs, ERR011 while a motor
    /// of the coordinate system moves.
    pub fn rename_axis(&mut self, cs: usize, axis: char, position: f64) -> Result<(), CommandError> {
        let index = AXES.iter().position(|&letter| letter == axis).ok_or(CommandError::SYNTAX)?;
        self.keeps_origin(cs)?;
        if !self.equations(cs).iter().any(|(_, row)| row[index] != 0.0) {
            return Err(CommandError::SYNTAX);
        }
        self.at_rest(cs)?;
        let mut axes = solve(self.equations(cs).into_iter().map(|(_, row)| row).collect());
        axes[index] = position;
        self.set_axes(cs, &axes);
        Ok(())
    }

    fn at_rest(&self, cs: usize) -> Result<(), CommandError> {
        if self.runs_program(cs) {
            return Err(CommandError::RUNNING);
        }
        if self.motors_of(cs).into_iter().any(|motor| self.motors[motor].moving()) {
            return Err(CommandError::MOVE_IN_PROGRESS);
        }
        Ok(())
    }

    /// The equation of each motor of the coordinate system, at the present commanded positions with bias.
    fn equations(&self, cs: usize) -> Vec<(usize, Row)> {
        let mut equations = Vec::new();
        for motor in self.motors_of(cs) {
            let Some(definition) = self.axes.definition(motor).filter(|axis| !axis.is_kinematic()) else {
                continue;
            };
            let mut row = [0.0; AXES.len() + 1];
            for (index, letter) in AXES.iter().enumerate() {
                row[index] = definition.terms.iter().filter(|(_, axis)| axis == letter).map(|(k, _)| k).sum();
            }
            row[AXES.len()] = self.motors[motor].commanded() + self.bias(motor) - definition.offset;
            equations.push((motor, row));
        }
        equations
    }

    /// Makes `axes` the present position, by the bias of each motor, and writes the axis registers.
    pub fn set_axes(&mut self, cs: usize, axes: &[f64; AXES.len()]) {
        for (motor, row) in self.equations(cs) {
            let counts: f64 = row.iter().zip(axes).map(|(k, axis)| k * axis).sum();
            let offset = self.axes.definition(motor).map_or(0.0, |definition| definition.offset);
            let bias = counts + offset - self.motors[motor].commanded();
            self.write_bias(motor, bias);
        }
        for (index, &axis) in axes.iter().enumerate() {
            self.memory.write_l(self.memory.registers().axis_targets.behind(cs, index), axis);
        }
    }

    /// Puts the axis positions that follow from the motors' commanded positions into `axes`; an axis that no motor moves
    /// keeps its own.
    pub fn axis_positions(&self, cs: usize, axes: &mut [f64; AXES.len()]) {
        let equations = self.equations(cs);
        let found = solve(equations.iter().map(|(_, row)| *row).collect());
        for (index, axis) in axes.iter_mut().enumerate() {
            if equations.iter().any(|(_, row)| row[index] != 0.0) {
                *axis = found[index];
            }
        }
    }

    /// The motors' positions, in counts from home, with the coordinate system's axes at `axes`; motors of other
    /// coordinate systems stay at `otherwise`.
    pub fn motor_targets(&self, cs: usize, axes: &[f64; AXES.len()], otherwise: &Motors) -> Motors {
        let vector = self.motor_vector(cs, axes);
        let mut targets = *otherwise;
        for motor in self.motors_of(cs) {
            let Some(definition) = self.axes.definition(motor).filter(|axis| !axis.is_kinematic()) else {
                continue;
            };
            let offset = definition.offset;
            targets[motor] = vector[motor] + offset - self.bias(motor);
        }
        targets
    }

    /// How far the motors of the coordinate system go when its axes go by `axes`, in counts.
    pub fn motor_vector(&self, cs: usize, axes: &[f64; AXES.len()]) -> Motors {
        let mut counts = STILL;
        for motor in self.motors_of(cs) {
            let Some(definition) = self.axes.definition(motor) else { continue };
            for (scale, letter) in &definition.terms {
                let axis = AXES.iter().position(|axis| axis == letter);
                counts[motor] += scale * axis.map_or(0.0, |axis| axes[axis]);
            }
        }
        counts
    }

    /// The motors of the coordinate system that move axis number `axis`.
    pub fn motors_on(&self, cs: usize, axis: usize) -> Vec<usize> {
        let moves = |motor: &usize| {
            self.axes.definition(*motor).is_some_and(|definition| {
                definition.terms.iter().any(|(_, letter)| AXES.get(axis) == Some(letter))
            })
        };
        self.motors_of(cs).into_iter().filter(moves).collect()
    }

    /// The motors of the coordinate system whose position comes from the inverse kinematic program; none while Isx50 is
    /// 0.
    #[must_use]
    pub fn kinematic_motors(&self, cs: usize) -> Vec<usize> {
        let kinematic = |motor: &usize| self.axes.definition(*motor).is_some_and(|axis| axis.is_kinematic());
        let mut motors = self.motors_of(cs);
        motors.retain(kinematic);
        if !motors.is_empty() && self.variables.i(self.identity.tables.coordinate_i(cs, KINEMATICS)) == 0.0 {
            motors.clear();
        }
        motors
    }

    /// Refuses to move the origin of axes that motors follow by a kinematic program: the simulator does not play that.
    ///
    /// # Errors
    /// ERR003.
    pub fn keeps_origin(&mut self, cs: usize) -> Result<(), CommandError> {
        if self.kinematic_motors(cs).is_empty() {
            return Ok(());
        }
        self.note(format!(
            "coordinate system {}: the simulator does not move the origin of kinematic axes",
            cs + 1
        ));
        Err(CommandError::SYNTAX)
    }

    /// The position bias of a motor in counts.
    pub fn bias(&self, motor: usize) -> f64 {
        let scale = self.ix(motor, 8) * 32.0;
        let bias = self.memory.read_d(self.memory.registers().bias.of(motor)) as f64;
        if scale == 0.0 { 0.0 } else { bias / scale }
    }

    /// After homing, home is at the axis definition's offset.
    pub fn home_bias(&mut self, motor: usize) {
        let offset = self.axes.definition(motor).map_or(0.0, |definition| definition.offset);
        self.write_bias(motor, offset);
    }

    fn write_bias(&mut self, motor: usize, counts: f64) {
        let scale = self.ix(motor, 8) * 32.0;
        self.memory.write_d(self.memory.registers().bias.of(motor), (counts * scale).round() as i64);
    }
}

/// The axis positions that fulfil the equations; an axis that they leave open is zero.
fn solve(mut rows: Vec<Row>) -> [f64; AXES.len()] {
    let mut axes = [0.0; AXES.len()];
    let mut pivots = [None; AXES.len()];
    let mut used = 0;
    for column in 0..AXES.len() {
        let size = |row: &Row| row[column].abs();
        let Some(best) = (used..rows.len()).max_by(|&a, &b| size(&rows[a]).total_cmp(&size(&rows[b]))) else {
            break;
        };
        if size(&rows[best]) < 1e-9 {
            continue;
        }
        rows.swap(used, best);
        let pivot = rows[used];
        for (index, row) in rows.iter_mut().enumerate() {
            if index != used {
                let factor = row[column] / pivot[column];
                for (value, of_pivot) in row.iter_mut().zip(&pivot) {
                    *value -= factor * of_pivot;
                }
            }
        }
        pivots[column] = Some(used);
        used += 1;
    }
    for (column, pivot) in pivots.into_iter().enumerate() {
        if let Some(row) = pivot {
            axes[column] = rows[row][AXES.len()] / rows[row][column];
        }
    }
    axes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_axes_are_found_again() {
        // #1->8660X-5000Y, #2->5000X+8660Y at X=2, Y=-3; A moved alone.
        let mut rows = vec![[0.0; 10]; 3];
        (rows[0][6], rows[0][7], rows[0][9]) = (8660.0, -5000.0, 2.0 * 8660.0 + 3.0 * 5000.0);
        (rows[1][6], rows[1][7], rows[1][9]) = (5000.0, 8660.0, 2.0 * 5000.0 - 3.0 * 8660.0);
        (rows[2][0], rows[2][9]) = (-10.0, 25.0);
        let axes = solve(rows);
        for (index, expected) in [(6, 2.0), (7, -3.0), (0, -2.5), (8, 0.0)] {
            assert!((axes[index] - expected).abs() < 1e-9, "{axes:?}");
        }
    }
}
