//! SPLINE and PVT moves: cubics between waypoints (User Manual pp. 180-183).
//!
//! A spline does not pass through its programmed points: waypoint n is (X(n-1) + 4 X(n) + X(n+1)) / 6, its velocity
//! (X(n+1) - X(n-1)) / 2 TA. Both end points count twice more, so n segments take n + 2 times TA.

use crate::sim::board::motor::{Motors, STILL};
use crate::sim::program::trajectory::Shape;

/// A spline in progress: its last three points, and the times of the last two segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    points: [Motors; 3],
    times: [f64; 2],
    /// Position and velocity at the end of the last segment.
    at: Motors,
    velocity: Motors,
}

impl Spline {
    /// At rest at `from`.
    #[must_use]
    pub fn new(from: Motors, time: f64) -> Self {
        Self { points: [from; 3], times: [time; 2], at: from, velocity: STILL }
    }

    /// The time of the last segment.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.times[1]
    }

    /// Takes the next point, `time` ms after the last one; returns the segment that it completes, and its end.
    pub fn next(&mut self, point: Motors, time: f64) -> (Shape, Motors) {
        self.points = [self.points[1], self.points[2], point];
        self.times = [self.times[1], time];
        let [before, after] = self.times;
        // With equal times these are 1/6, 1/6 and 1/(2 TA).
        let from_before = after * after / ((before + after) * (2.0 * before + after));
        let from_after = before * before / ((before + after) * (before + 2.0 * after));
        let (mut end, mut velocity) = (STILL, STILL);
        for motor in 0..end.len() {
            let [a, b, c] = self.points.map(|point| point[motor]);
            end[motor] = b + from_before * (a - b) + from_after * (c - b);
            velocity[motor] = (c - a) / (before + after);
        }
        let segment = cubic(before, &self.at, &end, &self.velocity, &velocity);
        (self.at, self.velocity) = (end, velocity);
        (segment, end)
    }
}

/// From one position and velocity to another in `time` ms.
#[must_use]
pub fn cubic(time: f64, from: &Motors, to: &Motors, from_velocity: &Motors, to_velocity: &Motors) -> Shape {
    let coefficients = std::array::from_fn(|motor| {
        let way = to[motor] - from[motor];
        let (v0, v1) = (from_velocity[motor], to_velocity[motor]);
        [v0, (3.0 * way / time - 2.0 * v0 - v1) / time, (v0 + v1 - 2.0 * way / time) / (time * time)]
    });
    Shape::Cubic(time, Box::new(coefficients))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::motor::MOST_MOTORS;

    #[test]
    fn a_uniform_spline_is_the_manuals() {
        let point = |x: f64| [x; MOST_MOTORS];
        let mut spline = Spline::new(point(0.0), 100.0);
        let mut at = |x: f64| {
            let (_, end) = spline.next(point(x), 100.0);
            (end[0], spline.velocity[0])
        };
        let close = |(a, b): (f64, f64), (c, d): (f64, f64)| (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12;
        assert!(close(at(6.0), (1.0, 0.03)));
        assert!(close(at(12.0), (6.0, 0.06)));
        assert!(close(at(12.0), (11.0, 0.03)));
        assert!(close(at(12.0), (12.0, 0.0)));
    }

    #[test]
    fn a_cubic_meets_both_ends() {
        let (from, to) = ([1.0; MOST_MOTORS], [5.0; MOST_MOTORS]);
        let Shape::Cubic(t, coefficients) =
            cubic(50.0, &from, &to, &[0.2; MOST_MOTORS], &[-0.1; MOST_MOTORS])
        else {
            panic!()
        };
        let [a, b, c] = coefficients[3];
        assert!((1.0 + t * (a + t * (b + t * c)) - 5.0).abs() < 1e-12);
        assert!((a + t * (2.0 * b + t * 3.0 * c) + 0.1).abs() < 1e-12);
    }
}
