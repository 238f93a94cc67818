//! The board's servo interrupt and background pass, with its programs.

use super::Programs;
use super::store::{Open, TableKind};
use crate::sim::board::Board;
use crate::sim::board::motor::{Events, Loop};

/// Free long words of a board without buffers.
const FREE_LONG_WORDS: i64 = 41_301;

/// The time base of the coordinate system that the 0-based `motor` belongs to.
fn time_base_of(board: &Board, motor: usize) -> f64 {
    board.axes.coordinate_system(motor).map_or(1.0, |cs| board.time_base(cs))
}

impl Programs {
    /// One servo interrupt: time bases, programs, motors, data gathering. The servo report follows it.
    pub fn servo_interrupt(&mut self, board: &mut Board) {
        board.begin_servo_cycle();
        let ms = board.cycle_ms();
        self.cycle(board, ms);
        for motor in 0..board.motors.len() {
            if !board.active(motor) {
                continue;
            }
            let leadscrew = self.leadscrew(board, motor);
            board.compensate(motor, leadscrew);
            let events = board.servo_loop(motor, time_base_of(board, motor));
            if events != Events::default() {
                self.on_events(board, motor, events);
            }
            board.write_servo_registers(motor);
        }
        board.gather_cycle();
    }

    /// The correction of the 0-based `motor` from the leadscrew tables, in 1/16 counts.
    fn leadscrew(&self, board: &Board, motor: usize) -> f64 {
        let tables = self.store.tables.iter();
        let own = tables.filter(|table| table.kind == TableKind::Leadscrew && table.motors[1] == motor);
        own.filter_map(|table| {
            let source = board.motors.get(table.motors[0])?;
            Some(table.at(if table.desired { source.commanded() } else { source.actual() }))
        })
        .sum()
    }

    /// Updates the registers of motors and coordinate systems, once per background pass.
    pub fn background_registers(&self, board: &mut Board) {
        for motor in 0..board.motors.len() {
            board.scan_in_position(motor);
            board.average_velocity(motor);
            let mut tables = self.store.tables.iter();
            let table = tables.find(|table| table.kind == TableKind::Backlash && table.owner == motor);
            let commanded = board.motors[motor].commanded();
            board.take_up_backlash(motor, table.map_or(0.0, |table| table.at(commanded)));
            board.write_background_registers(motor);
        }
        for cs in 0..self.systems.len() {
            board.write_coordinate_registers(cs);
        }
    }

    /// Writes the global status, with the bits of the program buffers.
    pub fn write_global_status(&self, board: &mut Board) {
        let open = self.store.open();
        let full = self.free_memory(board) < board.variables.i(18) as i64;
        let bits = [
            (19, matches!(open, Some(Open::Program(_)))),
            (18, open == Some(Open::Rotary)),
            (17, matches!(open, Some(Open::Plc(_)))),
            (11, full),
        ];
        let binary = if open == Some(Open::BinaryRotary) { board.family().rotary.binary_open } else { 0 };
        board.write_global_status(bits.iter().map(|&(bit, set)| u32::from(set) << bit).sum::<u32>() | binary);
    }

    fn on_events(&mut self, board: &mut Board, motor: usize, events: Events) {
        if events.homed {
            board.home_bias(motor);
        }
        if !events.limit && !events.fatal {
            return;
        }
        let cs = board.axes.coordinate_system(motor);
        if let Some(cs) = cs {
            self.end_program(board, cs);
        }
        // Ix25 (Turbo: Ixx24) bits 21-22: the motors that a fatal error kills besides its own: 0 all, 1 those of its
        // coordinate system.
        let scope = board.setting(board.settings().flag_mode, motor) as u32 >> 21 & 3;
        for other in (0..board.motors.len()).filter(|&other| other != motor) {
            let same = cs.is_some() && board.axes.coordinate_system(other) == cs;
            if events.fatal && (scope == 0 || scope == 1 && same) {
                board.motors[other].open(Loop::Killed);
            } else if same && board.motors[other].moving() {
                let rate = board.ix(other, 15);
                board.motors[other].abort(rate);
            }
        }
    }

    /// Free long words.
    #[must_use]
    pub fn free_memory(&self, board: &Board) -> i64 {
        let buffers = self.store.words() as i64;
        FREE_LONG_WORDS - i64::from(board.gather.memory_used(&board.variables)) - buffers
    }

    /// Tells the board's memory how much of it the user buffer takes.
    pub fn note_end_of_memory(&self, board: &mut Board) {
        let user = self.store.tables.iter().find(|table| table.kind == TableKind::User);
        board.note_end_of_memory(user.map(|table| table.size));
    }

    /// `SIZE`: free long words, negative while a buffer is open.
    #[must_use]
    pub fn size(&self, board: &Board) -> i64 {
        let free = self.free_memory(board);
        if self.store.open().is_some() { -free } else { free }
    }
}
