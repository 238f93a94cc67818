//! Effects of on-line commands on motors (Software Reference, "On-line commands", pp. 171-300).
//!
//! Motors are 0-based here. A command to a missing or not activated motor (Ix00=0) ends in ERR003, a command to a motor
//! whose coordinate system runs a program in ERR001.

use crate::map::IVariables;
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::motor::{Loop, ramp};

type Result = std::result::Result<(), CommandError>;

/// A jog command. Positions and distances in counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jog {
    /// `J+`
    Plus,
    /// `J-`
    Minus,
    /// `J/`; closes an open loop.
    Stop,
    /// `J=`: to the position of the last program stop.
    PreJog,
    /// `J={c}`
    To(f64),
    /// `J=={c}`: as `J={c}`, and makes `c` the pre-jog position.
    ToAsPreJog(f64),
    /// `J:{c}`: from the commanded position.
    ByCommanded(f64),
    /// `J^{c}`: from the actual position.
    ByActual(f64),
    /// `J=*`: to the position in the motor's jog register.
    ToVariable,
    /// `J:*`: the jog register's distance from the commanded position.
    ByCommandedVariable,
    /// `J^*`: the jog register's distance from the actual position.
    ByActualVariable,
    /// `J!`: round the commanded position to a whole count.
    RoundCommanded,
}

impl Board {
    /// A jog; `until_trigger` is the distance in counts to go on after a trigger (`J={c}^{c2}`).
    ///
    /// # Errors
    /// ERR001, ERR003; ERR003 also for `until_trigger` with a jog that has no end.
    pub fn jog(&mut self, motor: usize, jog: Jog, until_trigger: Option<f64>) -> Result {
        self.may_move(motor)?;
        self.start_jog(motor, jog, until_trigger)?;
        self.refresh(motor);
        Ok(())
    }

    fn start_jog(&mut self, motor: usize, jog: Jog, until_trigger: Option<f64>) -> Result {
        let x = IVariables::motor(motor + 1, 0);
        let ramp = ramp(x, &self.variables);
        let speed = self.ix(motor, 22);
        let register = self.memory.read_l(self.memory.registers().jog_variable.of(motor));
        let state = &mut self.motors[motor];
        let definite = !matches!(jog, Jog::Plus | Jog::Minus | Jog::Stop | Jog::RoundCommanded);
        if until_trigger.is_some() && !definite {
            return Err(CommandError::SYNTAX);
        }
        // An open loop closes where the motor is; distances count from there.
        if definite {
            state.close_loop();
        }
        let target = match jog {
            Jog::Plus | Jog::Minus | Jog::Stop => {
                let direction = match jog {
                    Jog::Plus => 1.0,
                    Jog::Minus => -1.0,
                    _ => 0.0,
                };
                state.jog_at(direction * speed, &ramp);
                return Ok(());
            }
            Jog::RoundCommanded => {
                state.round_commanded();
                return Ok(());
            }
            Jog::PreJog => state.pre_jog(),
            Jog::To(position) => position,
            Jog::ToAsPreJog(position) => {
                state.set_pre_jog(position);
                position
            }
            Jog::ByCommanded(distance) => state.commanded() + distance,
            Jog::ByActual(distance) => state.corrected() + distance,
            Jog::ToVariable => register,
            Jog::ByCommandedVariable => state.commanded() + register,
            Jog::ByActualVariable => state.corrected() + register,
        };
        let target = (target * 32.0).round() / 32.0;
        state.jog_to(target, speed, &ramp, until_trigger);
        Ok(())
    }

    /// `HM`.
    ///
    /// # Errors
    /// ERR001, ERR003.
    pub fn home(&mut self, motor: usize) -> Result {
        self.may_move(motor)?;
        let ramp = ramp(IVariables::motor(motor + 1, 0), &self.variables);
        let speed = self.ix(motor, 23);
        self.motors[motor].home(speed, &ramp);
        self.refresh(motor);
        Ok(())
    }

    /// `HMZ`.
    ///
    /// # Errors
    /// ERR001, ERR003.
    pub fn home_zero(&mut self, motor: usize) -> Result {
        self.may_move(motor)?;
        self.home_here(motor);
        Ok(())
    }

    /// `K`. Also allowed on a motor that is not activated, where the board has nothing to kill.
    ///
    /// # Errors
    /// ERR001 while a program runs in the motor's coordinate system.
    pub fn kill(&mut self, motor: usize) -> Result {
        if self.program_runs(motor) {
            return Err(CommandError::RUNNING);
        }
        if let Some(state) = self.motors.get_mut(motor) {
            state.open(Loop::Killed);
            self.refresh(motor);
        }
        Ok(())
    }

    /// `O{percent}` of Ix69.
    ///
    /// # Errors
    /// ERR001, ERR003; ERR003 also beyond 100%.
    pub fn open_loop(&mut self, motor: usize, percent: f64) -> Result {
        if !(-100.0..=100.0).contains(&percent) {
            return Err(CommandError::SYNTAX);
        }
        self.may_move(motor)?;
        self.motors[motor].open(Loop::Open(percent));
        self.refresh(motor);
        Ok(())
    }

    /// `$`: a motor that PMAC does not commutate closes its loop.
    ///
    /// # Errors
    /// ERR001, ERR003.
    pub fn reset_motor(&mut self, motor: usize) -> Result {
        self.jog(motor, Jog::Stop, None)
    }

    /// `$*`: position from the absolute sensor that Ix10 names, or zero without one; the motor stays killed.
    ///
    /// # Errors
    /// ERR001, ERR003.
    pub fn absolute_position(&mut self, motor: usize) -> Result {
        self.may_move(motor)?;
        let position = self.sensed_position(motor);
        self.memory.write_d(self.memory.registers().bias.of(motor), 0);
        self.motors[motor].absolute(position);
        self.refresh(motor);
        Ok(())
    }

    /// A program's `RAPID`: to `target` at `speed` counts/ms, or to `after` counts from a trigger.
    pub fn rapid(&mut self, motor: usize, target: f64, speed: f64, after: Option<f64>) {
        let ramp = ramp(IVariables::motor(motor + 1, 0), &self.variables);
        self.motors[motor].jog_to(target, speed, &ramp, after);
    }

    /// A program's `HOME`.
    pub fn search_home(&mut self, motor: usize) {
        let ramp = ramp(IVariables::motor(motor + 1, 0), &self.variables);
        let speed = self.ix(motor, 23);
        self.motors[motor].home(speed, &ramp);
    }

    /// Makes the commanded position home, as `HMZ` does.
    pub fn home_here(&mut self, motor: usize) {
        if self.active(motor) {
            let offset = self.ix(motor, 26) / 16.0;
            self.motors[motor].home_here(offset);
            self.home_bias(motor);
            self.refresh(motor);
        }
    }

    fn may_move(&self, motor: usize) -> Result {
        if self.program_runs(motor) {
            return Err(CommandError::RUNNING);
        }
        if self.active(motor) { Ok(()) } else { Err(CommandError::SYNTAX) }
    }
}
