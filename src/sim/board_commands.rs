//! What on-line commands do to coordinate systems and to the board as a whole (Software Reference, "On-line commands",
//! pp. 171-300). Motors and coordinate systems are 0-based here.

use super::board::{Board, MOTORS, Port};
use super::gather::Activity;
use super::language::CommandError;
use super::language::variables::force_dpram_handshake;
use super::motor::Loop;
use super::{coordinate, offsets};

type Result = std::result::Result<(), CommandError>;

/// Long words free on a board without buffers.
const FREE_LONG_WORDS: i64 = 41_301;

impl Board {
    /// `A`: every motor of the coordinate system stops at Ix15; open loops close.
    pub fn abort(&mut self, cs: usize) {
        self.end_program(cs);
        self.release_hold(cs);
        for motor in self.motors_of(cs) {
            self.abort_motor(motor);
        }
    }

    /// `H`: the time base goes to zero at Ix95.
    pub fn feed_hold(&mut self, cs: usize) {
        if let Some(coordinate) = self.coordinates.get_mut(cs) {
            coordinate.hold();
        }
    }

    pub(super) fn release_hold(&mut self, cs: usize) {
        if let Some(coordinate) = self.coordinates.get_mut(cs) {
            coordinate.resume();
        }
    }

    pub(super) fn motors_of(&self, cs: usize) -> Vec<usize> {
        (0..self.motors.len()).filter(|&motor| self.axes.coordinate_system(motor) == Some(cs)).collect()
    }

    fn abort_motor(&mut self, motor: usize) {
        if self.active(motor) {
            let rate = self.ix(motor, 15);
            self.motors[motor].abort(rate);
            self.refresh(motor);
        }
    }

    /// `%{percent}`. Negative is taken as zero, too much saturates.
    pub fn set_override(&mut self, cs: usize, percent: f64) {
        coordinate::set_override(cs.min(MOTORS - 1), percent, &self.variables, &mut self.memory);
    }

    /// `%`: the commanded override in percent.
    #[must_use]
    pub fn override_percent(&self, cs: usize) -> f64 {
        coordinate::override_percent(cs.min(MOTORS - 1), &self.variables, &self.memory)
    }

    /// `GATHER`, or `GATHER TRIGGER`.
    ///
    /// # Errors
    /// ERR003 when gathering would start without a buffer.
    pub fn gather(&mut self, triggered: bool) -> Result {
        self.gather.start(triggered, &self.variables)
    }

    /// What the gather sources hold now.
    pub(super) fn gather_sources(&self) -> [Option<u32>; 48] {
        super::gather::sources(&self.variables, &self.memory)
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
    pub fn define_gather(&mut self, longs: Option<u32>) -> Result {
        let free = self.free_memory();
        self.gather.define(longs, &self.variables, &mut self.memory, free)
    }

    /// `DELETE GATHER`.
    ///
    /// # Errors
    /// ERR003 while gathering.
    pub fn delete_gather(&mut self) -> Result {
        self.gather.delete(&self.variables, &mut self.memory)
    }

    /// Whether data gathering runs.
    #[must_use]
    pub fn gathering(&self) -> bool {
        self.gather.runs(Activity::Gathering)
    }

    /// What has to follow the assignment of I-variable `number`: I58=1 forces I3, I4 and I6, once. All other variables are
    /// looked at where they are used.
    pub fn i_assigned(&mut self, number: usize) {
        if number == 58 && self.variables.i(58) == 1.0 {
            force_dpram_handshake(&mut self.variables, &self.identity.firmware);
        }
        // Ix00 and the scales show in the motor's registers.
        if let Some(motor) = (number / 100).checked_sub(1).filter(|&motor| motor < self.motors.len()) {
            self.refresh(motor);
        }
    }

    /// Free long words.
    #[must_use]
    pub fn free_memory(&self) -> i64 {
        let buffers = self.programs.store.words() as i64;
        FREE_LONG_WORDS - i64::from(self.gather.memory_used(&self.variables)) - buffers
    }

    /// `SIZE`: free long words, negative while a buffer is open.
    #[must_use]
    pub fn size(&self) -> i64 {
        let free = self.free_memory();
        if self.programs.store.open().is_some() { -free } else { free }
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

    /// `$$$`, or `$$$***` with `factory`.
    pub fn reset(&mut self, factory: bool) {
        self.restart(factory);
    }

    /// `VERSION`.
    #[must_use]
    pub fn firmware(&self) -> &str {
        &self.identity.firmware
    }

    /// `TYPE`.
    #[must_use]
    pub fn type_text(&self) -> &str {
        self.identity.type_text
    }

    /// `DATE`.
    #[must_use]
    pub fn date_text(&self) -> &str {
        self.identity.date_text
    }

    /// `CHECKSUM`: 24 bits that differ from one simulated firmware to another.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        let bytes = self.identity.firmware.bytes().chain(self.identity.type_text.bytes());
        bytes.fold(0, |sum: u32, byte| sum.rotate_left(5).wrapping_add(byte.into())) & 0xFF_FFFF
    }

    /// `<CTRL-Z>`: the serial port takes the responses, DPRAM ASCII is switched off.
    pub fn serial_becomes_active(&mut self) {
        self.port = Port::Serial;
        self.variables.set_i(58, 0.0);
    }

    /// `<CTRL-X>`: empties the queues; with I58=1 also clears both ASCII control words.
    pub fn cancel_queues(&mut self) {
        self.ascii.clear();
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.cancel();
        }
        if self.variables.i(58) == 1.0 {
            self.memory.dpram.write16(offsets::ASCII_IN_CONTROL, 0);
            self.memory.dpram.write16(offsets::ASCII_OUT_CONTROL, 0);
        }
    }

    /// `<CTRL-K>`.
    pub fn kill_all(&mut self) {
        for motor in 0..self.motors.len() {
            self.motors[motor].open(Loop::Killed);
            self.refresh(motor);
        }
        for cs in 0..MOTORS {
            self.end_program(cs);
        }
    }

    /// `<CTRL-A>`: every active motor stops, those in no coordinate system too.
    pub fn abort_all(&mut self) {
        for cs in 0..MOTORS {
            self.end_program(cs);
            self.release_hold(cs);
        }
        for motor in 0..self.motors.len() {
            self.abort_motor(motor);
        }
    }

    /// `<CTRL-O>`.
    pub fn hold_all(&mut self) {
        for cs in 0..MOTORS {
            self.feed_hold(cs);
        }
    }

    /// `<CTRL-Q>`.
    pub fn quit_all(&mut self) {
        for cs in 0..MOTORS {
            self.quit(cs);
        }
    }

    /// `<CTRL-R>`. A control character reports no error: what cannot run stays as it is.
    pub fn run_all(&mut self) {
        for cs in 0..MOTORS {
            let _ = self.run(cs);
        }
    }

    /// `<CTRL-S>`.
    pub fn step_all(&mut self) {
        for cs in 0..MOTORS {
            let _ = Board::step(self, cs);
        }
    }

    /// `<CTRL-D>`: disables all PLCs.
    pub fn disable_plcs(&mut self) {
        self.enable_plcs(u32::MAX, false);
    }
}
