//! The state of a coordinate system's program.

use crate::sim::board::error::CommandError;
use crate::sim::board::motor::Motors;
use crate::sim::program::item::Mode;
use crate::sim::program::place::Cursor;
use crate::sim::program::spline::Spline;
use crate::sim::program::trajectory::{Later, Trajectory};
use crate::sim::program::transform::Transformations;

/// A caller: where to return to, and its loops.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The command after the call.
    pub back: Cursor,
    /// The `WHILE` loops around the call.
    pub loops: Vec<Cursor>,
}

/// The reason for the end of calculation; execution ends when the calculated moves are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The end of the program: the pointer goes to its start.
    Program,
    /// `Q`, `/`, `STOP`, end of a step: the pointer stays.
    Here,
}

/// `\`: slows down the motion on its path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Hold {
    /// No hold.
    #[default]
    Off,
    /// Slowing down; stopped when the factor is 0.
    Stopping(f64),
    /// Speeding up again.
    Resuming(f64),
}

impl Hold {
    /// The factor by which the clock is slowed down.
    #[must_use]
    pub fn factor(self) -> f64 {
        match self {
            Self::Off => 1.0,
            Self::Stopping(factor) | Self::Resuming(factor) => factor,
        }
    }
}

/// The words of a line that make a move.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Request {
    /// Axis positions or distances.
    pub axes: [Option<f64>; 9],
    /// End velocities behind `:`.
    pub velocities: [f64; 9],
    /// Distances behind `^`.
    pub triggers: [Option<f64>; 9],
    /// I, J, K.
    pub vectors: [Option<f64>; 3],
    /// R.
    pub radius: Option<f64>,
}

impl Request {
    /// Whether the request moves no axis.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes.iter().all(Option::is_none) && self.vectors.iter().all(Option::is_none)
    }
}

/// The program of a coordinate system.
#[derive(Debug, Clone, Default)]
pub struct System {
    /// The next command to calculate, if the coordinate system points to a program.
    pub cursor: Option<Cursor>,
    /// The callers, outermost first.
    pub frames: Vec<Frame>,
    /// The `WHILE` loops around the cursor in the present program.
    pub loops: Vec<Cursor>,
    /// Whether the program runs, as `??` shows.
    pub running: bool,
    /// Started by `R`, not by `S`.
    pub continuous: bool,
    /// Set when calculation has ended.
    pub ending: Option<Ending>,
    /// Inside BLOCKSTART and BLOCKSTOP.
    pub in_block: bool,
    /// The line in calculation has made a move or dwell.
    pub moved: bool,
    /// The words of the line so far.
    pub request: Request,
    /// The move mode.
    pub mode: Mode,
    /// The normal vector of arcs; `None` is K-1.
    pub normal: Option<[f64; 3]>,
    /// Axis positions at the end of the last calculated move, in user units.
    pub axes: [f64; 9],
    /// The motors' velocities there in PVT mode, counts/ms.
    pub velocities: Motors,
    /// The spline in progress.
    pub spline: Option<Spline>,
    /// Assignments that wait for the next move.
    pub later: Vec<Later>,
    /// Motors have moved independently: take the axis positions from theirs.
    pub rematch: bool,
    /// The moves.
    pub trajectory: Trajectory,
    /// The line in execution: program, line, offset.
    pub executing: Option<(u32, u64, usize)>,
    /// The motors' positions when the program stopped midway.
    pub stopped_at: Option<Motors>,
    /// `\`.
    pub hold: Hold,
    /// Axis transformations.
    pub transformations: Transformations,
    /// The error that ended the program, if any; a host sees it in PSTATUS.
    pub failure: Option<Failure>,
}

/// A run-time error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// PSTATUS bit 21.
    CircleRadius,
    /// PSTATUS bit 22.
    RunTime,
}

impl System {
    /// Points to `cursor` and clears the calls.
    pub fn point(&mut self, cursor: Option<Cursor>) {
        self.cursor = cursor;
        self.frames.clear();
        self.loops.clear();
        self.request = Request::default();
        self.in_block = false;
        self.moved = false;
        self.later.clear();
        self.stopped_at = None;
    }

    /// The rotary line in calculation; lines from this line on are ahead. 0 outside a rotary program.
    #[must_use]
    pub fn rotary_line(&self) -> u64 {
        self.rotary_cursor().map_or(0, |cursor| cursor.line + u64::from(cursor.item > 0))
    }

    /// The first rotary line that calculation still needs: also a line that it has begun. 0 outside a rotary program.
    #[must_use]
    pub fn first_rotary_line(&self) -> u64 {
        self.rotary_cursor().map_or(0, |cursor| cursor.line)
    }

    /// Where the rotary program is, behind the calls.
    fn rotary_cursor(&self) -> Option<Cursor> {
        let bottom = self.frames.first().map(|frame| frame.back).or(self.cursor);
        bottom.filter(|cursor| cursor.program == 0)
    }

    /// Ends calculation; moves already calculated still execute.
    pub fn end(&mut self, ending: Ending) {
        self.ending.get_or_insert(ending);
        self.trajectory.close();
    }

    /// The command that the system points to.
    ///
    /// # Errors
    /// ERR015 when the system points to no command.
    pub fn pointed(&self) -> Result<Cursor, CommandError> {
        self.cursor.ok_or(CommandError::NO_PROGRAM)
    }
}
