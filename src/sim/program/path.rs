//! The path of one blended move: straight or arc, in motor counts from its start (User Manual pp. 166-177).
//!
//! An axis is a sum over motors, so an arc in XYZ is an arc of vectors in motor space: `r (cos e1 + sin e2)`. Its
//! radius may grow (a spiral), and all other motion adds a straight part.

use crate::sim::board::motor::{Motors, STILL};

/// The path of a move, for `u` from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Path {
    /// A straight line: the displacement.
    Line(Box<Motors>),
    /// An arc.
    Arc(Box<Arc>),
    /// A smooth curve through displacements at equal steps of `u`, the first displacement zero; at least two.
    Points(Box<[Motors]>),
}

/// An arc.
#[derive(Debug, Clone, PartialEq)]
pub struct Arc {
    /// Toward the start, per unit of radius.
    pub e1: Motors,
    /// A quarter turn further, per unit of radius.
    pub e2: Motors,
    /// Radius at start and end.
    pub radius: [f64; 2],
    /// Angle in radians, positive.
    pub sweep: f64,
    /// Straight motion at the same time.
    pub straight: Motors,
}

impl Path {
    /// Adds the displacement at `u` and the velocity for `rate` (du/dt) to the sums.
    pub fn add(&self, u: f64, rate: f64, position: &mut Motors, velocity: &mut Motors) {
        match self {
            Self::Line(way) => {
                for motor in 0..position.len() {
                    position[motor] += way[motor] * u;
                    velocity[motor] += way[motor] * rate;
                }
            }
            Self::Points(points) => Self::add_curve(points, u, rate, position, velocity),
            Self::Arc(arc) => {
                let grown = arc.radius[1] - arc.radius[0];
                let radius = arc.radius[0] + grown * u;
                let (sin, cos) = (arc.sweep * u).sin_cos();
                for motor in 0..position.len() {
                    let (e1, e2) = (arc.e1[motor], arc.e2[motor]);
                    let outward = cos * e1 + sin * e2;
                    let along = cos * e2 - sin * e1;
                    position[motor] += radius * outward - arc.radius[0] * e1 + arc.straight[motor] * u;
                    velocity[motor] +=
                        (grown * outward + radius * arc.sweep * along + arc.straight[motor]) * rate;
                }
            }
        }
    }

    /// Adds the displacement at `u` on the curve through `points`: a cubic between each two neighbours.
    fn add_curve(points: &[Motors], u: f64, rate: f64, position: &mut Motors, velocity: &mut Motors) {
        let Some(last) = points.len().checked_sub(1).filter(|&last| last > 0) else { return };
        let place = u.clamp(0.0, 1.0) * last as f64;
        let index = (place as usize).min(last - 1);
        let t = place - index as f64;
        let slope = |at: usize, motor: usize| {
            let (before, after) = (at.saturating_sub(1), (at + 1).min(last));
            (points[after][motor] - points[before][motor]) / (after - before) as f64
        };
        for motor in 0..position.len() {
            let (from, way) = (points[index][motor], points[index + 1][motor] - points[index][motor]);
            let (first, second) = (slope(index, motor), slope(index + 1, motor));
            let (square, cube) = (3.0 * way - 2.0 * first - second, first + second - 2.0 * way);
            position[motor] += from + t * (first + t * (square + t * cube));
            velocity[motor] += (first + t * (2.0 * square + 3.0 * t * cube)) * last as f64 * rate;
        }
    }

    /// The velocity at the start (`u` 0) or end (1) for `rate`.
    #[must_use]
    pub fn velocity(&self, u: f64, rate: f64) -> Motors {
        let (mut position, mut velocity) = (STILL, STILL);
        self.add(u, rate, &mut position, &mut velocity);
        velocity
    }
}

/// A move that may blend with its neighbours: its progress along its path over time.
///
/// It begins and ends with a ramp; half of each overlaps the neighbour's. Alone it takes its time plus both halves.
#[derive(Debug, Clone, PartialEq)]
pub struct Blend {
    /// The path.
    pub path: Path,
    /// Move time in ms, from the middle of one ramp to the middle of the other.
    pub time: f64,
    /// The ramp it begins with.
    pub up: Ramp,
    /// The ramp it ends with.
    pub down: Ramp,
}

/// Total and S-curve time of a ramp in ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Total.
    pub time: f64,
    /// S-curve at each end.
    pub s_time: f64,
}

impl Ramp {
    /// The same shape, shortened to `time`.
    #[must_use]
    pub fn within(self, time: f64) -> Self {
        let factor = if self.time > 0.0 { time / self.time } else { 1.0 };
        Self { time, s_time: self.s_time * factor }
    }

    fn phase(self, from: f64, to: f64) -> crate::sim::board::profile::Stretch {
        crate::sim::board::profile::Stretch { from, to, time: self.time, s_time: self.s_time }
    }
}

impl Blend {
    /// Its duration in ms.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.time + (self.up.time + self.down.time) / 2.0
    }

    /// When the final ramp begins, in ms from the start.
    #[must_use]
    pub fn coasts_until(&self) -> f64 {
        self.length() - self.down.time
    }

    /// Adds the displacement and velocity at `t` ms after the start.
    pub fn add(&self, t: f64, position: &mut Motors, velocity: &mut Motors) {
        let rate = 1.0 / self.time;
        let (u, rate) = if t < self.up.time {
            self.up.phase(0.0, rate).at(t)
        } else {
            let coast = self.coasts_until();
            let before = rate * self.up.time / 2.0;
            if t <= coast {
                (before + rate * (t - self.up.time), rate)
            } else {
                let (u, rate_now) = self.down.phase(rate, 0.0).at(t - coast);
                (before + rate * (coast - self.up.time) + u, rate_now)
            }
        };
        self.path.add(u, rate, position, velocity);
    }

    /// Velocity at the start of the final ramp, where the next move takes over.
    #[must_use]
    pub fn end_velocity(&self) -> Motors {
        self.path.velocity(1.0, 1.0 / self.time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blend_covers_its_way_in_its_time_and_both_half_ramps() {
        let mut way = STILL;
        way[1] = 500.0;
        let blend = Blend {
            path: Path::Line(Box::new(way)),
            time: 100.0,
            up: Ramp { time: 40.0, s_time: 10.0 },
            down: Ramp { time: 20.0, s_time: 0.0 },
        };
        assert_eq!(blend.length(), 130.0);
        assert_eq!(blend.coasts_until(), 110.0);
        let at = |t: f64| {
            let (mut position, mut velocity) = (STILL, STILL);
            blend.add(t, &mut position, &mut velocity);
            (position[1], velocity[1])
        };
        assert_eq!(at(0.0), (0.0, 0.0));
        for (t, position, velocity) in [(40.0, 100.0, 5.0), (110.0, 450.0, 5.0), (130.0, 500.0, 0.0)] {
            let found = at(t);
            assert!((found.0 - position).abs() < 1e-9 && (found.1 - velocity).abs() < 1e-9, "{t}: {found:?}");
        }
    }
}
