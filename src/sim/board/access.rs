//! Variables of all kinds by number, as programs and commands use them, and settings by name.

use super::Board;
use super::settings::{Setting, Settings};
use super::variables::{VariableKind, force_dpram_handshake};
use crate::map::IVariables;

impl Board {
    /// The value of a setting; `index` is the 0-based motor or coordinate system, whichever has its own.
    #[must_use]
    pub fn setting(&self, setting: Setting, index: usize) -> f64 {
        self.variables.i(self.variable_of(setting, index))
    }

    /// The number of the I-variable that holds the setting.
    #[must_use]
    pub const fn variable_of(&self, setting: Setting, index: usize) -> usize {
        match setting {
            Setting::Board(number) => number,
            Setting::Motor(n) => IVariables::motor(index + 1, n),
            Setting::System(n) => self.identity.tables.coordinate_i(index, n),
        }
    }

    /// Where this board's firmware keeps its settings.
    #[must_use]
    pub fn settings(&self) -> &'static Settings {
        &self.identity.tables.settings
    }

    /// The value of a variable; a Q-variable belongs to the 0-based coordinate system `cs`.
    #[must_use]
    pub fn value(&self, kind: VariableKind, cs: usize, number: usize) -> f64 {
        match kind {
            VariableKind::I => self.variables.i(number),
            VariableKind::P => self.variables.p(&self.memory, number),
            VariableKind::Q => self.variables.q(&self.memory, cs, number),
            VariableKind::M => self.variables.m(&self.memory, number),
        }
    }

    /// Assigns a variable and carries out the effects of that assignment.
    pub fn assign(&mut self, kind: VariableKind, cs: usize, number: usize, value: f64) {
        let Self { variables, memory, .. } = self;
        match kind {
            VariableKind::I => {
                variables.set_i(number, value);
                self.i_assigned(number);
            }
            VariableKind::P => variables.set_p(memory, number, value),
            VariableKind::Q => variables.set_q(memory, cs, number, value),
            VariableKind::M => {
                if let Some(address) = variables.set_m(memory, number, value) {
                    self.register_written(address);
                }
            }
        }
    }

    /// The effect of an assignment of I-variable `number`: I58=1 forces I3, I4 and I6, once. The board reads all other
    /// variables where it uses them.
    pub fn i_assigned(&mut self, number: usize) {
        let i = &self.family().i;
        // Turbo User Manual p. 403: the two ways of reporting motors exclude each other.
        if i.servo_in_background.is_some_and(|other| number == usize::from(other) && self.enabled(other)) {
            self.variables.set_i(i.servo_enable.into(), 0.0);
        }
        if number == usize::from(i.ascii_enable) && self.takes_ascii() {
            force_dpram_handshake(&mut self.variables, &self.identity.firmware);
        }
        // Ix00 and the scales show in the motor's registers.
        if let Some(motor) = (number / 100).checked_sub(1).filter(|&motor| motor < self.motors.len()) {
            self.refresh(motor);
        }
    }
}
