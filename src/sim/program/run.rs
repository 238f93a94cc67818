//! Run, step, hold, quit, abort: how commands act on the program of a coordinate system (Software Reference,
//! "On-line commands"; error codes p. 25). Coordinate systems are 0-based.

use super::calculate::flow::split;
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::program::Programs;
use crate::sim::program::place::Cursor;
use crate::sim::program::store::Program;
use crate::sim::program::system::{Ending, Hold};

type Result = std::result::Result<(), CommandError>;

/// Counts by which a motor may be away from where the program stopped.
const SAME_PLACE: f64 = 1.0 / 16.0;

/// `??` word 1: running, single step, continuous mode, continuous request.
const RUNNING: u32 = 1;
const SINGLE_STEP: u32 = 1 << 1;
pub(super) const BLENDING: u32 = 1 << 2;
const CONTINUOUS: u32 = 1 << 4;
/// The bits that the end of a program clears: running, single step and continuous motion.
const NOT_RUNNING: u32 = 0b1_0111;
/// `??` word 2.
pub(super) const HOLD_STOP: u32 = 1 << 23;
pub(super) const RUN_TIME_ERROR: u32 = 1 << 22;
pub(super) const RADIUS_ERROR: u32 = 1 << 21;
pub(super) const BLOCK_STOP: u32 = 1 << 14;
pub(super) const DWELL: u32 = 1 << 12;
pub(super) const SEGMENTED: u32 = 1 << 7;
pub(super) const SEGMENTED_RAMP: u32 = 1 << 6;
pub(super) const SEGMENTED_STOP: u32 = 1 << 5;

impl Programs {
    /// The place that `B{number}` points to: a program with that label, or the rotary buffer for 0.
    fn cursor(&self, cs: usize, number: f64) -> Option<Cursor> {
        match split(number) {
            (0, 0) => self.store.rotary(cs).map(|rotary| Cursor::at(0, rotary.first())),
            (program, label) => {
                let line = self.store.program(program)?.label(label)?;
                Some(Cursor::at(program, line))
            }
        }
    }
}

impl Programs {
    /// Points to program Ix91 at power-up.
    pub fn point_at_power_up(&mut self, board: &mut Board) {
        for cs in 0..self.systems.len() {
            let number = board.variables.i(board.variables.tables().coordinate_i(cs, 91));
            let _ = self.begin(board, cs, number);
        }
    }

    /// `B{number}`: the fraction is a label; 0 is the rotary buffer.
    ///
    /// # Errors
    /// ERR001 while a program runs, ERR003 for a missing program or label.
    pub fn begin(&mut self, board: &mut Board, cs: usize, number: f64) -> Result {
        if board.runs_program(cs) {
            return Err(CommandError::RUNNING);
        }
        let cursor = self.cursor(cs, number).ok_or(CommandError::SYNTAX)?;
        self.reset_motion(board, cs);
        self.systems[cs].point(Some(cursor));
        self.systems[cs].executing = None;
        Ok(())
    }

    /// `R`: runs from the pointer; after a hold, resumes.
    ///
    /// # Errors
    /// ERR010 to ERR015 for the state of motors and pointer, ERR017 away from the place of the stop, ERR016 for open
    /// blocks.
    pub fn run(&mut self, board: &mut Board, cs: usize) -> Result {
        self.start_program(board, cs, true)
    }

    /// `S`: as [`Programs::run`], for one move.
    ///
    /// # Errors
    /// As [`Programs::run`].
    pub fn step(&mut self, board: &mut Board, cs: usize) -> Result {
        self.start_program(board, cs, false)
    }

    fn start_program(&mut self, board: &mut Board, cs: usize, continuous: bool) -> Result {
        board.release_hold(cs);
        let Some(system) = self.systems.get(cs) else { return Err(CommandError::SYNTAX) };
        if system.running {
            return Ok(());
        }
        let pointed = system.cursor.is_some() && self.store.open_program().is_none();
        check_start(board, cs, pointed)?;
        let commanded = board.commanded();
        let system = &self.systems[cs];
        if let Some(place) = system.stopped_at {
            let off = |motor: &usize| (place[*motor] - commanded[*motor]).abs() > SAME_PLACE;
            if board.motors_of(cs).iter().any(off) {
                return Err(CommandError::NOT_AT_STOP);
            }
        }
        let number = system.pointed()?.program;
        if !self.store.program(number).is_none_or(Program::is_structured) {
            return Err(CommandError::BAD_STRUCTURE);
        }
        self.check_kinematics(board, cs)?;
        let system = &self.systems[cs];
        let resumes = matches!(system.hold, Hold::Stopping(_));
        let matching =
            board.variables.i(14) == 1.0 || system.rematch || !board.kinematic_motors(cs).is_empty();
        let mut axes = system.axes;
        if !resumes && matching && !self.axis_positions(board, cs, &mut axes) {
            return Err(CommandError::BAD_STRUCTURE);
        }
        let system = &mut self.systems[cs];
        if resumes {
            system.hold = Hold::Resuming(system.hold.factor());
        } else {
            system.trajectory.reset(commanded);
            system.axes = axes;
            system.rematch = false;
        }
        system.running = true;
        system.continuous = continuous;
        system.ending = None;
        system.failure = None;
        system.stopped_at = None;
        let mode = system.mode.status();
        let kind = if continuous { CONTINUOUS } else { SINGLE_STEP };
        board.coordinate_word(cs, RUNNING | SINGLE_STEP | BLENDING | CONTINUOUS, RUNNING | kind);
        let cleared =
            HOLD_STOP | RUN_TIME_ERROR | RADIUS_ERROR | BLOCK_STOP | DWELL | SEGMENTED_STOP | 0b1_0011;
        board.program_word(cs, cleared, mode);
        for motor in board.motors_of(cs) {
            board.motors[motor].data_error = false;
        }
        board.write_axes(cs, &axes, false);
        Ok(())
    }

    /// `Q`: moves already calculated still execute; the pointer is at the next line.
    pub fn quit(&mut self, board: &mut Board, cs: usize) {
        if self.systems.get(cs).is_some_and(|system| system.running) {
            self.finish_calculation(board, cs);
        } else {
            board.coordinate_word(cs, NOT_RUNNING, 0);
        }
    }

    /// `/`: stops after the move in progress; the pointer is at the move after it.
    pub fn stop_after_move(&mut self, board: &mut Board, cs: usize) {
        let Some(system) = self.systems.get_mut(cs).filter(|system| system.running) else {
            board.coordinate_word(cs, NOT_RUNNING, 0);
            return;
        };
        let dropped = system.trajectory.drop_ahead();
        if let Some(first) = dropped.first() {
            system.cursor = Some(Cursor::at(first.origin.0, first.origin.1));
            system.spline = None;
            system.request = Default::default();
            match system.trajectory.entries().last() {
                Some(last) => system.axes = last.axes,
                None => system.rematch = true,
            }
        }
        system.end(Ending::Here);
        board.program_word(cs, BLOCK_STOP, BLOCK_STOP);
    }

    /// `\`: segmented moves stop on their path, at the I52 rate; others at their end.
    pub fn program_hold(&mut self, board: &mut Board, cs: usize) {
        let segmented = |system: &crate::sim::program::System| {
            system.running
                && system.trajectory.executing().is_some_and(|entry| entry.segmented && !entry.breaks())
        };
        match self.systems.get_mut(cs) {
            Some(system) if segmented(system) => {
                system.hold = Hold::Stopping(system.hold.factor());
                board.program_word(cs, SEGMENTED_STOP, SEGMENTED_STOP);
            }
            _ => self.stop_after_move(board, cs),
        }
    }

    /// Ends the program of `cs` at once: for aborts, limits and fatal errors, which stop the motors themselves.
    pub fn end_program(&mut self, board: &mut Board, cs: usize) {
        board.coordinate_word(cs, NOT_RUNNING, 0);
        board.program_word(cs, SEGMENTED | SEGMENTED_RAMP | SEGMENTED_STOP | DWELL, 0);
        let system = &mut self.systems[cs];
        system.running = false;
        system.rematch = true;
        system.ending = None;
        system.stopped_at = None;
        self.reset_motion(board, cs);
        self.free_rotary_lines(board, cs);
    }

    /// Drops the calculated moves.
    fn reset_motion(&mut self, board: &mut Board, cs: usize) {
        let commanded = board.commanded();
        let system = &mut self.systems[cs];
        system.trajectory.reset(commanded);
        system.spline = None;
        system.request = Default::default();
        system.later.clear();
        system.hold = Hold::Off;
    }

    /// The program has come to rest: ended by `ending`, or held in mid-path by `\`.
    pub(super) fn program_rests(&mut self, board: &mut Board, cs: usize, ending: Option<Ending>) {
        board.coordinate_word(cs, NOT_RUNNING, 0);
        let commanded = board.commanded();
        let system = &mut self.systems[cs];
        system.running = false;
        system.ending = None;
        match ending {
            Some(Ending::Program) => {
                let main = system.frames.first().map(|frame| frame.back).or(system.cursor);
                let begin = main.map(|cursor| Cursor::at(cursor.program, 0));
                system.point(begin);
            }
            _ => system.stopped_at = Some(commanded),
        }
        let (clear, set) = match ending {
            None => (0, HOLD_STOP),
            Some(_) => (SEGMENTED | SEGMENTED_RAMP | SEGMENTED_STOP | DWELL, 0),
        };
        board.program_word(cs, clear, set);
        for motor in board.motors_of(cs) {
            let motor = &mut board.motors[motor];
            motor.rest();
            motor.set_pre_jog(motor.commanded());
        }
        // No interrupt calculates any more, so this is the last chance to free the executed lines: B0 would point to
        // them.
        self.free_rotary_lines(board, cs);
    }

    /// Clears the pointer of every coordinate system, as opening a fixed program does.
    pub fn reset_pointers(&mut self) {
        for system in &mut self.systems {
            system.point(None);
        }
    }

    /// `A`: every motor of the coordinate system stops at rate Ix15; open loops close.
    pub fn abort(&mut self, board: &mut Board, cs: usize) {
        self.end_program(board, cs);
        board.release_hold(cs);
        for motor in board.motors_of(cs) {
            board.abort_motor(motor);
        }
    }

    /// `<CTRL-K>`.
    pub fn kill_all(&mut self, board: &mut Board) {
        board.kill_motors();
        for cs in 0..self.systems.len() {
            self.end_program(board, cs);
        }
    }

    /// `<CTRL-A>`: every active motor stops, even outside a coordinate system.
    pub fn abort_all(&mut self, board: &mut Board) {
        for cs in 0..self.systems.len() {
            self.end_program(board, cs);
            board.release_hold(cs);
        }
        for motor in 0..board.motors.len() {
            board.abort_motor(motor);
        }
    }

    /// `<CTRL-Q>`.
    pub fn quit_all(&mut self, board: &mut Board) {
        for cs in 0..self.systems.len() {
            self.quit(board, cs);
        }
    }

    /// `<CTRL-R>`. A control character reports no error: a coordinate system that cannot run does not change.
    pub fn run_all(&mut self, board: &mut Board) {
        for cs in 0..self.systems.len() {
            let _ = self.run(board, cs);
        }
    }

    /// `<CTRL-S>`.
    pub fn step_all(&mut self, board: &mut Board) {
        for cs in 0..self.systems.len() {
            let _ = self.step(board, cs);
        }
    }
}

/// The first obstacle to the start of a program, in the order of the board's checks (Software Reference p. 25; the
/// order itself is not printed). `pointed`: the coordinate system points to a program.
///
/// # Errors
/// ERR015, ERR014, ERR013, ERR012, ERR010, ERR011.
pub fn check_start(board: &Board, cs: usize, pointed: bool) -> Result {
    let motors: Vec<usize> = board.axes.motors_in(cs).collect();
    let status = |motor: usize| board.motor_status(motor)[0];
    let bits_set = |motor: &usize, mask: u32| status(*motor) & mask == mask;
    if !pointed {
        return Err(CommandError::NO_PROGRAM);
    }
    if motors.is_empty() {
        return Err(CommandError::NO_MOTOR);
    }
    if motors.iter().any(|&motor| !board.active(motor)) {
        return Err(CommandError::NOT_ACTIVATED);
    }
    if motors.iter().any(|motor| bits_set(motor, 1 << 18)) {
        return Err(CommandError::OPEN_LOOP);
    }
    if motors.iter().any(|motor| bits_set(motor, 1 << 22 | 1 << 21)) {
        return Err(CommandError::BOTH_LIMITS);
    }
    if motors.iter().any(|motor| !bits_set(motor, 1 << 13)) {
        return Err(CommandError::MOVE_IN_PROGRESS);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::firmware;
    use crate::sim::world::World;

    #[test]
    fn what_stops_a_program_from_starting_in_order() {
        let mut world = World::alone(&firmware::PMAC).unwrap();
        let send = |world: &mut World, line: &str| {
            assert_eq!(world.execute(line.as_bytes()).error, None, "{line}");
        };
        assert_eq!(check_start(&world.board, 0, false), Err(CommandError::NO_PROGRAM));
        assert_eq!(check_start(&world.board, 0, true), Err(CommandError::NO_MOTOR));
        send(&mut world, "#2->X");
        assert_eq!(check_start(&world.board, 0, true), Err(CommandError::NOT_ACTIVATED));
        // The first status word of motor 2 is X:$0079.
        send(&mut world, "I200=1 WX$79,$640000");
        assert_eq!(check_start(&world.board, 0, true), Err(CommandError::OPEN_LOOP));
        send(&mut world, "WX$79,$600000");
        assert_eq!(check_start(&world.board, 0, true), Err(CommandError::BOTH_LIMITS));
        send(&mut world, "WX$79,$400000");
        assert_eq!(check_start(&world.board, 0, true), Err(CommandError::MOVE_IN_PROGRESS));
        send(&mut world, "WX$79,$002000");
        assert_eq!(check_start(&world.board, 0, true), Ok(()));
    }
}
