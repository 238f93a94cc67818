//! Registers that a program, a memory command or a host writes: the board obeys some and only keeps the others.
//!
//! The board obeys a write of a position: drivers write the actual and the commanded position of a killed motor.

use crate::sim::board::Board;
use crate::sim::board::register_table::{Each, RegisterTable};

/// `?` word 2, bit 10.
const HOME_COMPLETE: u32 = 1 << 10;

/// The place of a motor's register in the table.
type Place = fn(&RegisterTable) -> Each;

/// The registers of a motor that this board computes anew and never reads: a real board acts on some of them when a program writes
/// there. `docs/simulator.md` has the same table.
const IGNORED: [(&str, Place); 12] = [
    ("the time left in the move", |at| at.time_left),
    ("the desired velocity", |at| at.desired_velocity),
    ("the actual velocity", |at| at.velocity),
    ("the averaged velocity", |at| at.average_velocity),
    ("the output", |at| at.dac),
    ("the compensation", |at| at.compensation),
    ("the target position", |at| at.target),
    ("the captured home position", |at| at.home_capture),
    ("the copy of Ix03", |at| at.feedback_address),
    ("the copy of Ix05", |at| at.master_address),
    ("the first status word", |at| at.servo_status),
    ("the second status word, but for \"home complete\"", |at| at.background_status),
];

/// The values that the board last wrote to a motor's registers. Another value in a register comes from a program or a
/// host.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shown {
    pub commanded: i64,
    pub actual: i64,
    pub status: u32,
}

impl Board {
    /// A program or a host has written to `address`, in X, Y or both: the board acts on the new value, or notes that it
    /// does not.
    pub fn register_written(&mut self, address: u32) {
        let (at, motors) = (self.memory.registers(), self.motors.len());
        let obeyed = [at.commanded, at.actual, at.background_status];
        if let Some(motor) = obeyed.into_iter().find_map(|register| register.index_of(address, motors)) {
            self.obey(motor);
        }
        if at.hardware.contains(&address) {
            self.note_ignored(address, "an output, encoder or flag");
        }
        for (name, register) in IGNORED {
            if let Some(motor) = register(at).index_of(address, motors) {
                self.note_ignored(address, &format!("{name} of motor {}", motor + 1));
            }
        }
    }

    /// Takes over the 0-based `motor`'s position registers and "home complete" bit.
    fn obey(&mut self, motor: usize) {
        let (at, scale) = (self.memory.registers(), self.scale(motor));
        let [commanded, actual] =
            [at.commanded, at.actual].map(|register| self.memory.read_d(register.of(motor)));
        let status = self.memory.read(at.background_status.of(motor));
        let state = &mut self.motors[motor];
        let shown = state.shown;
        if scale != 0.0 && actual != shown.actual {
            state.set_actual(actual as f64 / scale);
        }
        if scale != 0.0 && commanded != shown.commanded {
            state.set_commanded(commanded as f64 / scale);
        }
        if (status ^ shown.status) & HOME_COMPLETE != 0 {
            state.home_complete = status & HOME_COMPLETE != 0;
        }
        self.refresh(motor);
    }

    fn note_ignored(&mut self, address: u32, what: &str) {
        self.note(format!(
            "${address:04X}, {what}, has been written: the board keeps the value and does nothing"
        ));
    }

    /// Notes, once, that the simulator does less for a program or a host than either may expect.
    pub fn note(&mut self, what: String) {
        /// The most notes kept: a program that writes everywhere has made its point.
        const MOST: usize = 64;
        if self.notes.len() < MOST && !self.notes.contains(&what) {
            self.notes.push(what);
        }
    }
}
