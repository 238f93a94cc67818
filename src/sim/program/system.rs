//! What a coordinate system knows of the program it runs.

use crate::sim::board::error::CommandError;
use crate::sim::board::motor::Motors;
use crate::sim::program::cutter_state::Cutter;
use crate::sim::program::item::Mode;
use crate::sim::program::place::Cursor;
use crate::sim::program::spline::Spline;
use crate::sim::program::trajectory::{Later, Trajectory};
use crate::sim::program::transform::Transformations;

/// A caller: where to go back to, and its loops.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The command after the call.
    pub back: Cursor,
    /// The loops it is in.
    pub loops: Vec<Cursor>,
}

/// Why calculation has ended; execution ends when the calculated moves are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The end of the program: the pointer goes to its begin.
    Program,
    /// `Q`, `/`, `STOP`, end of a step: the pointer stays.
    Here,
}

/// `\`: how the motion slows down on its path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Hold {
    /// It does not.
    #[default]
    Off,
    /// Stopping, or stopped when the factor is 0.
    Stopping(f64),
    /// Going again.
    Resuming(f64),
}

impl Hold {
    /// The factor of the clock.
    #[must_use]
    pub fn factor(self) -> f64 {
        match self {
            Self::Off => 1.0,
            Self::Stopping(factor) | Self::Resuming(factor) => factor,
        }
    }
}

/// The words of one line that make a move.
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
    /// Whether there is nothing to move.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes.iter().all(Option::is_none) && self.vectors.iter().all(Option::is_none)
    }
}

/// The program of a coordinate system.
#[derive(Debug, Clone, Default)]
pub struct System {
    /// The command to be calculated next, when the coordinate system points to a program.
    pub cursor: Option<Cursor>,
    /// The callers, outermost first.
    pub frames: Vec<Frame>,
    /// The `WHILE`s of the present program that it is in.
    pub loops: Vec<Cursor>,
    /// It runs; `??` shows it.
    pub running: bool,
    /// `R` rather than `S`.
    pub continuous: bool,
    /// Calculation has ended.
    pub ending: Option<Ending>,
    /// Inside BLOCKSTART and BLOCKSTOP.
    pub in_block: bool,
    /// The line under calculation has made a move or dwell.
    pub moved: bool,
    /// The words of the line so far.
    pub request: Request,
    /// The move mode.
    pub mode: Mode,
    /// The vector arcs turn around; `None` is K-1.
    pub normal: Option<[f64; 3]>,
    /// Axis positions at the end of the last calculated move, in user units.
    pub axes: [f64; 9],
    /// Axis velocities there in PVT mode, user units per ms.
    pub velocities: [f64; 9],
    /// Cutter radius compensation.
    pub cutter: Cutter,
    /// The spline under way.
    pub spline: Option<Spline>,
    /// Assignments that wait for the next move.
    pub later: Vec<Later>,
    /// Motors have moved by themselves: axis positions follow from theirs.
    pub rematch: bool,
    /// The moves.
    pub trajectory: Trajectory,
    /// The line under execution: program, line, offset.
    pub executing: Option<(u32, u64, usize)>,
    /// Where the motors stood when the program stopped in its middle.
    pub stopped_at: Option<Motors>,
    /// `\`.
    pub hold: Hold,
    /// Axis transformations.
    pub transformations: Transformations,
    /// The error that ended the program, if one did: what a host sees is PSTATUS.
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
    /// Points to `cursor`, with nothing called.
    pub fn point(&mut self, cursor: Option<Cursor>) {
        self.cursor = cursor;
        self.frames.clear();
        self.loops.clear();
        self.request = Request::default();
        self.cutter = Cutter::default();
        self.in_block = false;
        self.moved = false;
        self.later.clear();
        self.stopped_at = None;
    }

    /// The rotary line under calculation: the lines from it on are ahead. 0 when it is not in a rotary program.
    #[must_use]
    pub fn rotary_line(&self) -> u64 {
        let bottom = self.frames.first().map(|frame| frame.back).or(self.cursor);
        match bottom {
            Some(Cursor { program: 0, line, item }) => line + u64::from(item > 0),
            _ => 0,
        }
    }

    /// Ends calculation; what is calculated still moves.
    pub fn end(&mut self, ending: Ending) {
        self.ending.get_or_insert(ending);
        self.trajectory.close();
    }

    /// ERR015 when it points nowhere.
    ///
    /// # Errors
    /// That.
    pub fn pointed(&self) -> Result<Cursor, CommandError> {
        self.cursor.ok_or(CommandError::NO_PROGRAM)
    }
}
