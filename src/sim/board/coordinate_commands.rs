//! Effects of commands on coordinate systems, data gathering and ports (Software Reference, "On-line commands",
//! pp. 171-300). Motors and coordinate systems are 0-based here.

use super::Board;
use super::error::CommandError;
use super::firmware::DpramHandshake;
use super::gather::{self, GatherSources};
use super::motor::Loop;
use super::output::Port;
use crate::format::int24;

type Result = std::result::Result<(), CommandError>;

impl Board {
    /// `H`: the time base goes to zero at Ix95.
    pub fn feed_hold(&mut self, cs: usize) {
        if let Some(coordinate) = self.coordinates.get_mut(cs) {
            coordinate.hold();
        }
    }

    /// Ends a feed hold: the time base goes back at Ix94.
    pub fn release_hold(&mut self, cs: usize) {
        if let Some(coordinate) = self.coordinates.get_mut(cs) {
            coordinate.resume();
        }
    }

    /// The 0-based motors of the 0-based coordinate system `cs`.
    pub fn motors_of(&self, cs: usize) -> Vec<usize> {
        (0..self.motors.len()).filter(|&motor| self.axes.coordinate_system(motor) == Some(cs)).collect()
    }

    /// An active, killed motor closes its loop at its present position.
    pub fn enable_motor(&mut self, motor: usize) {
        if self.active(motor) && self.motors[motor].servo == Loop::Killed {
            let _ = self.reset_motor(motor);
        }
    }

    /// An active motor stops at Ix15; an open loop closes.
    pub fn abort_motor(&mut self, motor: usize) {
        if self.active(motor) {
            let rate = self.ix(motor, 15);
            self.motors[motor].abort(rate);
            self.refresh(motor);
        }
    }

    /// `%{percent}`. The board takes a negative value as zero and limits a value that is too large.
    pub fn set_override(&mut self, cs: usize, percent: f64) {
        // Largest 24-bit positive value.
        const MOST: f64 = 8_388_607.0;
        let value = (percent * self.variables.i(10) / 100.0).round().clamp(0.0, MOST);
        self.memory.write(self.memory.registers().time_base_commanded.of(cs), value as u32);
    }

    /// `%`: the commanded override in percent.
    #[must_use]
    pub fn override_percent(&self, cs: usize) -> f64 {
        let value = self.memory.read(self.memory.registers().time_base_commanded.of(cs));
        let full = self.variables.i(10);
        if full > 0.0 { 100.0 * f64::from(int24::signed(value)) / full } else { 0.0 }
    }

    /// `GATHER`, or `GATHER TRIGGER`.
    ///
    /// # Errors
    /// ERR003 when gathering would start without a buffer.
    pub fn gather(&mut self, triggered: bool) -> Result {
        self.gather.start(triggered, &self.variables)
    }

    /// The present values of the gather sources.
    pub fn gather_sources(&self) -> GatherSources {
        gather::sources(&self.family().i, &self.variables, &self.memory)
    }

    /// `ENDGATHER`.
    ///
    /// # Errors
    /// None; the form is that of the other commands.
    pub fn end_gather(&mut self) -> Result {
        self.gather.stop();
        Ok(())
    }

    /// `DEFINE GATHER [longs]`.
    ///
    /// # Errors
    /// ERR003 while gathering, or without room.
    pub fn define_gather(&mut self, longs: Option<u32>, free: i64) -> Result {
        self.gather.define(longs, &self.variables, &mut self.memory, free)
    }

    /// `DELETE GATHER`.
    ///
    /// # Errors
    /// ERR003 while gathering.
    pub fn delete_gather(&mut self) -> Result {
        self.gather.delete(&self.variables, &mut self.memory)
    }

    /// The words gathered into PMAC's own memory.
    #[must_use]
    pub fn gathered(&self) -> &[u32] {
        self.gather.stored()
    }

    /// Whether a gather buffer takes room in PMAC's own memory.
    #[must_use]
    pub fn gather_is_defined(&self) -> bool {
        self.gather.memory_used(&self.variables) > 0
    }

    /// `CHECKSUM`: 24 bits that differ from one simulated firmware to another.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let bytes = self.identity.firmware.bytes().chain(self.identity.tables.type_text.bytes());
        bytes.fold(0, |sum: u32, byte| sum.rotate_left(5).wrapping_add(byte.into())) & 0xFF_FFFF
    }

    /// `<CTRL-Z>`: the serial port takes the responses; on PMAC, DPRAM ASCII is switched off.
    pub fn serial_becomes_active(&mut self) {
        self.port = Port::Serial;
        if self.identity.tables.dpram_handshake == DpramHandshake::Forced {
            self.variables.set_i(self.family().i.ascii_enable.into(), 0.0);
        }
    }

    /// `<CTRL-X>`: empties the queues; with I58=1 also clears both ASCII control words.
    pub fn cancel_queues(&mut self) {
        self.output.cancel();
        if self.takes_ascii() {
            let ascii = &self.memory.tables().family.ascii;
            self.memory.dpram.write16(ascii.response_control, 0);
            self.memory.dpram.write16(ascii.command_loaded.word, 0);
        }
    }

    /// Kills all motors.
    pub fn kill_motors(&mut self) {
        for motor in 0..self.motors.len() {
            self.motors[motor].open(Loop::Killed);
            self.refresh(motor);
        }
    }

    /// Feed hold in all coordinate systems: `<CTRL-O>`.
    pub fn hold_all(&mut self) {
        for cs in 0..self.coordinates.len() {
            self.feed_hold(cs);
        }
    }
}
