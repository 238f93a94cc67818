//! The motion of a coordinate system: calculated moves in order, evaluated each servo cycle.
//!
//! The clock of the moves runs with the time base. Blended neighbours overlap in a ramp, where their positions add up.
//! Every other move begins at the end of the move before. Positions are closed formulas of the clock, so no error
//! accumulates.

use std::collections::VecDeque;

use crate::sim::board::motor::{MOST_MOTORS, Motors, STILL};
use crate::sim::program::item::{Mode, Operator};
use crate::sim::program::path::Blend;

/// An assignment that takes effect at the start of a move: M-variable number, operator, value.
pub type Later = (usize, Operator, f64);

/// One motor's part in a RAPID move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jog {
    /// Target in counts.
    pub target: f64,
    /// Speed in counts/ms.
    pub speed: f64,
    /// After a trigger on the way, the distance from the trigger to the end, in counts.
    pub after_trigger: Option<f64>,
}

/// The shape of a move.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// LINEAR, CIRCLE, DELAY.
    Blend(Blend),
    /// SPLINE, PVT: position `c1 t + c2 t^2 + c3 t^3`, for this many ms.
    Cubic(f64, Box<[[f64; 3]; MOST_MOTORS]>),
    /// DWELL: this many ms of real time.
    Dwell(f64),
    /// RAPID: each motor moves by itself.
    Rapid(Box<[Option<Jog>; MOST_MOTORS]>),
    /// HOME, bit n for 0-based motor n.
    Home(u32),
}

/// A calculated move.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The move's shape.
    pub shape: Shape,
    /// Its start by the clock, in ms.
    pub start: f64,
    /// The motors' positions at its end.
    pub target: Motors,
    /// The axes' positions at its end, in user units.
    pub axes: [f64; 9],
    /// The mode of the move's calculation.
    pub mode: Mode,
    /// Calculated with I13>0.
    pub segmented: bool,
    /// Blends with the move before.
    pub joined: bool,
    /// No further move may blend with it.
    pub closed: bool,
    /// Whether the move has begun.
    pub started: bool,
    /// The assignments that take effect when the move begins.
    pub later: Vec<Later>,
    /// The move's line: program (0 rotary), line number, offset in the program's buffer.
    pub origin: (u32, u64, usize),
}

impl Entry {
    fn end(&self) -> f64 {
        match &self.shape {
            Shape::Blend(blend) => self.start + blend.length(),
            Shape::Cubic(time, _) => self.start + time,
            Shape::Dwell(_) | Shape::Rapid(_) | Shape::Home(_) => self.start,
        }
    }

    /// Whether motors move independently of the clock.
    #[must_use]
    pub fn breaks(&self) -> bool {
        !matches!(self.shape, Shape::Blend(_) | Shape::Cubic(..))
    }
}

/// The motors' desired motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Counts from home.
    pub position: Motors,
    /// Counts/ms at a time base of 100%.
    pub velocity: Motors,
}

/// The moves of a coordinate system.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    clock: f64,
    base: Motors,
    entries: VecDeque<Entry>,
}

impl Trajectory {
    /// Drops all moves, with the motors at `base`.
    pub fn reset(&mut self, base: Motors) {
        self.entries.clear();
        self.base = base;
        self.clock = 0.0;
    }

    /// Whether no move is left.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.entries.is_empty()
    }

    /// Number of moves calculated but not begun.
    #[must_use]
    pub fn ahead(&self) -> usize {
        self.entries.iter().filter(|entry| !entry.started).count()
    }

    /// Whether the last move is neither blend nor spline, so that calculation must wait for its end.
    #[must_use]
    pub fn blocked(&self) -> bool {
        self.entries.back().is_some_and(Entry::breaks)
    }

    /// The motors' positions at the end of all moves.
    #[must_use]
    pub fn target(&self) -> Motors {
        self.entries.back().map_or(self.base, |entry| entry.target)
    }

    /// The moves, in order.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter()
    }

    /// The move in progress: the last that has begun.
    #[must_use]
    pub fn executing(&self) -> Option<&Entry> {
        self.entries.iter().rev().find(|entry| entry.started)
    }

    /// The velocity at which a further move could blend.
    #[must_use]
    pub fn open_velocity(&self) -> Option<Motors> {
        let entry = self.entries.back().filter(|entry| !entry.closed)?;
        match &entry.shape {
            Shape::Blend(blend) if self.clock < entry.start + blend.coasts_until() => {
                Some(blend.end_velocity())
            }
            _ => None,
        }
    }

    /// Lets no further move blend with the last one.
    pub fn close(&mut self) {
        if let Some(entry) = self.entries.back_mut() {
            entry.closed = true;
        }
    }

    /// Appends `entry` and sets its `start`, `delay` ms from now when no move is in progress. A blend overlaps the last
    /// move in its first ramp, shortened to the time left.
    pub fn append(&mut self, mut entry: Entry, delay: f64) {
        let clock = self.clock;
        entry.start = match self.entries.back_mut() {
            None => clock + delay,
            Some(last) => {
                let end = last.end();
                match (&mut last.shape, &mut entry.shape) {
                    (Shape::Blend(before), Shape::Blend(blend)) if !last.closed => {
                        let centre = last.start + before.up.time / 2.0 + before.time;
                        let free = 2.0 * (centre - clock.max(last.start + before.up.time));
                        let ramp = blend.up.time.min(free);
                        if clock < last.start + before.coasts_until() && ramp > 0.0 {
                            blend.up = blend.up.within(ramp);
                            before.down = blend.up;
                            entry.joined = true;
                            centre - ramp / 2.0
                        } else {
                            end
                        }
                    }
                    _ => end,
                }
            }
        };
        if let Some(last) = self.entries.back_mut() {
            last.closed = true;
        }
        self.entries.push_back(entry);
    }

    /// Removes and returns the moves that have not begun, in order; the move in progress comes to rest.
    pub fn drop_ahead(&mut self) -> Vec<Entry> {
        let first = self.entries.iter().position(|entry| !entry.started).unwrap_or(self.entries.len());
        let dropped: Vec<Entry> = self.entries.drain(first..).collect();
        self.close();
        dropped
    }

    /// Ends the RAPID, HOME or DWELL move in front; its motors have stopped at `position`.
    pub fn finish_front(&mut self, position: Motors) {
        if self.entries.pop_front().is_some() {
            self.base = position;
        }
    }

    /// The first move.
    #[must_use]
    pub fn front(&self) -> Option<&Entry> {
        self.entries.front()
    }

    /// Advances by `real` ms, or `scaled` ms by the clock. Calls `begun` for each move that begins.
    ///
    /// Returns the motors' desired motion, or `None` while the clock does not move them.
    pub fn advance(&mut self, real: f64, scaled: f64, mut begun: impl FnMut(&mut Entry)) -> Option<Sample> {
        if self.entries.is_empty() {
            return None;
        }
        self.clock += scaled;
        let mut moved = false;
        loop {
            let clock = self.clock;
            let front = self.entries.front_mut()?;
            if clock < front.start {
                break;
            }
            if !front.started {
                front.started = true;
                begun(front);
            }
            let end = front.end();
            match &mut front.shape {
                Shape::Dwell(left) => {
                    *left -= real;
                    if *left > 0.0 {
                        return moved.then_some(Sample { position: self.base, velocity: STILL });
                    }
                }
                Shape::Rapid(_) | Shape::Home(_) => {
                    return moved.then_some(Sample { position: self.base, velocity: STILL });
                }
                _ if clock < end => break,
                _ => moved = true,
            }
            self.base = front.target;
            self.entries.pop_front();
            if self.entries.is_empty() {
                return moved.then_some(Sample { position: self.base, velocity: STILL });
            }
        }
        let mut sample = Sample { position: self.base, velocity: STILL };
        for entry in &mut self.entries {
            let t = self.clock - entry.start;
            if t < 0.0 {
                break;
            }
            if !entry.started {
                entry.started = true;
                begun(entry);
            }
            match &entry.shape {
                Shape::Blend(blend) => {
                    blend.add(t.min(blend.length()), &mut sample.position, &mut sample.velocity);
                }
                Shape::Cubic(time, coefficients) => {
                    let t = t.min(*time);
                    for (motor, [c1, c2, c3]) in coefficients.iter().enumerate() {
                        sample.position[motor] += t * (c1 + t * (c2 + t * c3));
                        sample.velocity[motor] += c1 + t * (2.0 * c2 + t * 3.0 * c3);
                    }
                }
                _ => break,
            }
        }
        Some(sample)
    }

    /// Milliseconds left in the move in progress and in its ramp, by the clock.
    #[must_use]
    pub fn time_left(&self) -> Option<(f64, f64)> {
        let index = self.entries.iter().rposition(|entry| entry.started)?;
        let entry = &self.entries[index];
        let t = self.clock - entry.start;
        let end =
            self.entries.get(index + 1).filter(|next| next.joined).map_or(entry.end(), |next| next.start);
        let ramp = match &entry.shape {
            Shape::Blend(blend) if t < blend.up.time => blend.up.time - t,
            Shape::Blend(blend) if t > blend.coasts_until() => blend.length() - t,
            _ => 0.0,
        };
        match &entry.shape {
            Shape::Blend(_) | Shape::Cubic(..) => Some(((end - self.clock).max(0.0), ramp)),
            _ => None,
        }
    }
}
