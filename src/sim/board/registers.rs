//! The registers that the board keeps for every reader: positions, velocities, status words.
//!
//! Bits: Software Reference pp. 189-198.

use crate::format::int24;
use crate::sim::board::Board;
use crate::sim::board::axes::AxisDefinition;
use crate::sim::board::gather::Activity;
use crate::sim::board::motor::{Loop, Motors};
use crate::sim::board::output::Port;

/// The bits that program buffers set in the Y word of the global status: an open buffer, and memory nearly full.
const BUFFER_BITS: u32 = 0b111 << 17 | 1 << 11;

impl Board {
    /// Units of a position register per count.
    pub(super) fn scale(&self, motor: usize) -> f64 {
        self.ix(motor, 8) * 32.0
    }

    /// The servo registers of an active motor, as each servo cycle leaves them.
    pub fn write_servo_registers(&mut self, motor: usize) {
        let scale = self.scale(motor);
        let velocity_scale = self.ix(motor, 9) * 32.0;
        let cycles = self.ix(motor, 60) + 1.0;
        let status = self.servo_status(motor);
        let addresses = [self.ix(motor, 3) as u32, self.ix(motor, 5) as u32];
        let state = &mut self.motors[motor];
        let memory = &mut self.memory;
        let at = memory.registers();
        state.shown.commanded = (state.commanded() * scale).round() as i64;
        state.shown.actual = (state.actual() * scale).round() as i64;
        memory.write_d(at.commanded.of(motor), state.shown.commanded);
        memory.write_d(at.actual.of(motor), state.shown.actual);
        if let Some(register) = at.following_error {
            let [commanded, actual, compensation] =
                [at.commanded, at.actual, at.compensation].map(|register| memory.read_d(register.of(motor)));
            memory.write_d(register.of(motor), commanded - actual - compensation);
        }
        memory.write(at.velocity.of(motor), word(state.moved() * velocity_scale * cycles));
        memory.write(at.dac.of(motor), word(state.output() * 256.0));
        memory.write(at.desired_velocity.of(motor), word(state.desired_velocity() * scale / 3.0));
        memory.write(at.time_left.of(motor), word(state.time_left().unwrap_or(0.0) * 2.0));
        memory.write(at.feedback_address.of(motor), addresses[0]);
        memory.write(at.master_address.of(motor), addresses[1]);
        memory.write(at.servo_status.of(motor), status);
    }

    /// The background registers of a motor.
    pub fn write_background_registers(&mut self, motor: usize) {
        let scale = self.scale(motor);
        let status = self.background_status(motor);
        let state = &mut self.motors[motor];
        state.shown.status = status;
        let target = (state.target() * scale).round() as i64;
        let captured = word(state.captured);
        let memory = &mut self.memory;
        let at = memory.registers();
        memory.write_d(at.target.of(motor), target);
        memory.write(at.home_capture.of(motor), captured);
        memory.write(at.background_status.of(motor), status);
    }

    /// Goes on averaging the velocity: a sixteenth of the difference a background pass.
    pub fn average_velocity(&mut self, motor: usize) {
        let at = self.memory.registers();
        let now = int24::signed(self.memory.read(at.velocity.of(motor)));
        let average = int24::signed(self.memory.read(at.average_velocity.of(motor)));
        let difference = now - average;
        // The last 15 units are single steps.
        let step = if difference.abs() < 16 { difference.signum() } else { difference / 16 };
        self.memory.write(at.average_velocity.of(motor), (average + step) as u32);
    }

    /// Makes the registers of a motor show the effect of a command at once.
    pub fn refresh(&mut self, motor: usize) {
        self.write_servo_registers(motor);
        self.write_background_registers(motor);
    }

    /// `??` words as far as they follow from the motors.
    pub fn write_coordinate_registers(&mut self, cs: usize) {
        let (mut motors, mut all_in_position, mut fatal, mut warning) = (0, true, false, false);
        for motor in (0..self.motors.len()).filter(|&motor| self.axes.coordinate_system(motor) == Some(cs)) {
            motors |= 1 << motor;
            all_in_position &= self.in_position(motor);
            fatal |= self.motors[motor].fatal;
            warning |= self.motors[motor].warning;
        }
        let at = self.memory.registers();
        if let Some(word) = at.coordinate_motors {
            self.memory.write(word.of(cs), motors);
        }
        let others = self.memory.read(at.program_status.of(cs)) & !(0b111 << 17);
        let own = bit(17, motors != 0 && all_in_position) | bit(18, warning) | bit(19, fatal);
        self.memory.write(at.program_status.of(cs), others | own);
    }

    /// `???`. `buffers` are the bits of the Y word that program buffers set: of `BUFFER_BITS`, and that of binary entry.
    pub fn write_global_status(&mut self, buffers: u32) {
        let x = bit(19, self.gather.runs(Activity::Gathering)) | bit(17, self.gather.runs(Activity::Armed));
        let host = self.response_port() != Port::Serial;
        let bits = &self.identity.tables.status_bits;
        let own = BUFFER_BITS | self.family().rotary.binary_open | bits.host_port | bits.vme_board;
        let at = self.memory.registers();
        let y = self.memory.read(at.global_buffers) & !own | buffers;
        let others = self.memory.read(at.global_status) & !(1 << 19 | 1 << 17);
        // Bit 21 of both words (Turbo Software Reference p. 289). A PMAC is of kind 0.
        let processor = self.identity.processor.kind;
        self.memory.write(at.global_status, others | x | bit(21, processor & 2 != 0));
        let vme = mask(bits.vme_board, self.saved.vme);
        let y = y | mask(bits.host_port, host) | vme | bit(21, processor & 1 != 0);
        self.memory.write(at.global_buffers, y);
    }

    fn servo_status(&self, motor: usize) -> u32 {
        if !self.active(motor) {
            return 0;
        }
        let state = &self.motors[motor];
        let bits = &self.identity.tables.status_bits;
        let definite = state.time_left().is_some();
        let closed = state.servo == Loop::Closed;
        bit(23, true)
            | bit(22, state.limits[1])
            | bit(21, state.limits[0])
            | mask(bits.following, self.ix(motor, 6) as u32 & 1 == 1)
            | mask(bits.phased, self.ix(motor, 1) as u32 & 1 == 1)
            | mask(bits.amplifier_in_first, state.servo != Loop::Killed)
            | bit(18, !closed)
            | bit(17, definite)
            | bit(16, self.ix(motor, 34) == 1.0)
            | bit(15, state.dwelling)
            | bit(14, state.data_error)
            | mask(bits.standing, state.desired_velocity() == 0.0 && (closed || bits.stands_in_open_loop))
            | bit(12, state.aborting())
            | bit(10, state.searching())
    }

    fn background_status(&self, motor: usize) -> u32 {
        let state = &self.motors[motor];
        let cs = self.axes.coordinate_system(motor);
        let bits = &self.identity.tables.status_bits;
        let axis = self.axes.definition(motor).filter(|_| bits.axis_codes).map_or(0, AxisDefinition::code);
        mask(bits.assigned, cs.is_some())
            | axis << 16
            | (cs.unwrap_or(0) as u32) << 20
            | mask(bits.amplifier_in_second, state.servo != Loop::Killed)
            | bit(11, state.on_limit)
            | bit(10, state.home_complete)
            | bit(7, state.trigger_move)
            | bit(4, state.backlash.negative)
            | bit(2, state.fatal)
            | bit(1, state.warning)
            | bit(0, self.in_position(motor))
    }

    /// In position: for I7+1 (Turbo: Ixx88+1) background passes in a row closed, at rest and within Ix28.
    fn in_position(&self, motor: usize) -> bool {
        let scans = self.setting(self.settings().in_position_scans, motor);
        f64::from(self.motors[motor].in_position_scans) > scans
    }

    /// Counts the background passes in a row in which the 0-based `motor` was in position.
    pub fn scan_in_position(&mut self, motor: usize) {
        let band = self.ix(motor, 28) / 16.0;
        let active = self.active(motor);
        let state = &mut self.motors[motor];
        let now = active
            && state.servo == Loop::Closed
            && state.desired_velocity() == 0.0
            && state.time_left().is_none()
            && (state.commanded() - state.corrected()).abs() < band;
        state.in_position_scans = if now { state.in_position_scans.saturating_add(1).min(1000) } else { 0 };
    }

    /// Position of the 0-based `motor` in counts, with bias and compensation: `P`.
    #[must_use]
    pub fn position(&self, motor: usize) -> f64 {
        let at = self.memory.registers();
        let sum = self.memory.read_d(at.actual.of(motor))
            + self.memory.read_d(at.bias.of(motor))
            + self.memory.read_d(at.compensation.of(motor));
        divide(sum as f64, self.scale(motor))
    }

    /// Velocity of the 0-based `motor` in counts per servo cycle: `V`.
    #[must_use]
    pub fn velocity(&self, motor: usize) -> f64 {
        let raw = int24::signed(self.memory.read(self.memory.registers().reported_velocity.of(motor)));
        divide(f64::from(raw), self.ix(motor, 9) * 32.0)
    }

    /// Following error of the 0-based `motor` in counts: `F`.
    #[must_use]
    pub fn following_error(&self, motor: usize) -> f64 {
        let at = self.memory.registers();
        let commanded = self.memory.read_d(at.commanded.of(motor));
        let actual = self.memory.read_d(at.actual.of(motor));
        let compensation = self.memory.read_d(at.compensation.of(motor));
        divide((commanded - actual - compensation) as f64, self.scale(motor))
    }

    /// The two words of `?` for the 0-based `motor`.
    #[must_use]
    pub fn motor_status(&self, motor: usize) -> [u32; 2] {
        let at = self.memory.registers();
        [at.servo_status, at.background_status].map(|register| self.memory.read(register.of(motor)))
    }

    /// The first two words of `??` for the 0-based coordinate system.
    #[must_use]
    pub fn coordinate_status(&self, cs: usize) -> [u32; 2] {
        let at = self.memory.registers();
        [at.coordinate_status, at.program_status].map(|register| self.memory.read(register.of(cs)))
    }

    /// The words of `??` in the order of the reply, for the 0-based coordinate system.
    #[must_use]
    pub fn coordinate_report(&self, cs: usize) -> Vec<u32> {
        let third =
            self.memory.registers().coordinate_status_3.map(|register| self.memory.read(register.of(cs)));
        self.coordinate_status(cs).into_iter().chain(third).collect()
    }

    /// The two words of `???`.
    #[must_use]
    pub fn global_status(&self) -> [u32; 2] {
        let at = self.memory.registers();
        [at.global_status, at.global_buffers].map(|register| self.memory.read(register))
    }

    /// Whether a motion program runs in the 0-based coordinate system `cs`: bit 0 of the first `??` word.
    #[must_use]
    pub fn runs_program(&self, cs: usize) -> bool {
        self.coordinate_status(cs)[0] & 1 != 0
    }

    /// Whether a motion program runs in the coordinate system of the 0-based `motor`.
    pub fn program_runs(&self, motor: usize) -> bool {
        self.axes.coordinate_system(motor).is_some_and(|cs| self.runs_program(cs))
    }

    /// The commanded positions of all motors in counts.
    pub fn commanded(&self) -> Motors {
        std::array::from_fn(|motor| self.motors.get(motor).map_or(0.0, |motor| motor.commanded()))
    }

    /// Changes the first `??` word: clears `clear`, then sets `set`.
    pub fn coordinate_word(&mut self, cs: usize, clear: u32, set: u32) {
        let address = self.memory.registers().coordinate_status.of(cs);
        let word = self.memory.read(address);
        self.memory.write(address, word & !clear | set);
    }

    /// Changes the second `??` word likewise.
    pub fn program_word(&mut self, cs: usize, clear: u32, set: u32) {
        let address = self.memory.registers().program_status.of(cs);
        let word = self.memory.read(address);
        self.memory.write(address, word & !clear | set);
    }

    /// Writes the axis target registers, and with `segmented` those of segmented moves, too.
    pub fn write_axes(&mut self, cs: usize, axes: &[f64; 9], segmented: bool) {
        let at = self.memory.registers();
        for (index, &axis) in axes.iter().enumerate() {
            self.memory.write_l(at.axis_targets.behind(cs, index), axis);
            if segmented {
                self.memory.write_l(at.segmented_axis_targets.behind(cs, index), axis);
            }
        }
    }
}

/// A register's signed 24 bits; a larger value saturates.
fn word(value: f64) -> u32 {
    const MOST: f64 = 8_388_607.0;
    value.round().clamp(-MOST - 1.0, MOST) as i32 as u32
}

fn bit(number: u32, set: bool) -> u32 {
    mask(1 << number, set)
}

fn mask(mask: u32, set: bool) -> u32 {
    if set { mask } else { 0 }
}

fn divide(value: f64, by: f64) -> f64 {
    if by == 0.0 { 0.0 } else { value / by }
}
