//! The velocity profile of jog and home moves: trapezoids with S-curve corners.
//!
//! One change of velocity takes ta = max(Ix20, 2*Ix21) ms, of which Ix21 at each end are S-curve; when the peak
//! acceleration dV/(ta - ts) would exceed Ix19, the board lengthens both times by one factor (Software Reference
//! p. 76). Units: counts and milliseconds. Positions are closed formulas, so no error accumulates.

/// How a motor may change its velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Total acceleration time in ms.
    /// Milliseconds.
    pub time: f64,
    /// S-curve time at each end in ms.
    /// Milliseconds of S-curve at either end.
    pub s_time: f64,
    /// The most acceleration in counts/ms^2; zero or less is no limit.
    pub limit: f64,
}

impl Ramp {
    /// From Ix19 (`limit`), Ix20 and Ix21. Both times zero is undefined on the board and taken as 1 ms.
    #[must_use]
    pub fn new(limit: f64, time: f64, s_time: f64) -> Self {
        let s_time = s_time.max(0.0);
        let time = time.max(2.0 * s_time);
        Self { time: if time > 0.0 { time } else { 1.0 }, s_time, limit }
    }

    /// Total and S-curve time of a change of velocity by `change` counts/ms.
    #[must_use]
    pub fn times(&self, change: f64) -> (f64, f64) {
        let peak = change.abs() / (self.time - self.s_time);
        let factor = if self.limit > 0.0 { (peak / self.limit).max(1.0) } else { 1.0 };
        (self.time * factor, self.s_time * factor)
    }
}

/// One change of velocity, or a stretch at constant velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Velocity at its start.
    pub from: f64,
    /// Velocity at its end.
    pub to: f64,
    /// Milliseconds.
    pub time: f64,
    /// Milliseconds of S-curve at either end.
    pub s_time: f64,
}

impl Stretch {
    fn change(from: f64, to: f64, ramp: &Ramp) -> Self {
        let (time, s_time) = ramp.times(to - from);
        Self { from, to, time, s_time }
    }

    fn cruise(velocity: f64, time: f64) -> Self {
        Self { from: velocity, to: velocity, time, s_time: 0.0 }
    }

    fn distance(&self) -> f64 {
        if self.time == 0.0 { 0.0 } else { (self.from + self.to) / 2.0 * self.time }
    }

    /// Distance and velocity `t` ms after the start of the phase.
    pub fn at(&self, t: f64) -> (f64, f64) {
        let change = self.to - self.from;
        if change == 0.0 {
            return (self.from * t, self.from);
        }
        let (time, s) = (self.time, self.s_time);
        let peak = change / (time - s);
        if t < s {
            let jerk = peak / s;
            (self.from * t + jerk * t * t * t / 6.0, self.from + jerk * t * t / 2.0)
        } else if t <= time - s {
            let u = t - s;
            let corner = self.from + peak * s / 2.0;
            (self.from * s + peak * s * s / 6.0 + corner * u + peak * u * u / 2.0, corner + peak * u)
        } else {
            let left = time - t;
            let jerk = peak / s;
            (
                self.distance() - self.to * left + jerk * left * left * left / 6.0,
                self.to - jerk * left * left / 2.0,
            )
        }
    }
}

/// A planned move of one motor.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    start: f64,
    phases: [Stretch; 3],
    elapsed: f64,
    /// Where a definite move ends, exactly.
    target: Option<f64>,
}

/// Where a profile is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Commanded position in counts.
    pub position: f64,
    /// Desired velocity in counts/ms.
    pub velocity: f64,
    /// Whether the move has ended, at rest.
    pub done: bool,
}

impl Profile {
    /// From `start` at `velocity` to the speed `to` (counts/ms), and on for ever unless that is zero.
    #[must_use]
    pub fn to_velocity(start: f64, velocity: f64, to: f64, ramp: &Ramp) -> Self {
        let change =
            if velocity == to { Stretch::cruise(to, 0.0) } else { Stretch::change(velocity, to, ramp) };
        let on = if to == 0.0 { 0.0 } else { f64::INFINITY };
        let phases = [change, Stretch::cruise(to, on), Stretch::cruise(0.0, 0.0)];
        Self { start, phases, elapsed: 0.0, target: None }
    }

    /// From `start` at `velocity` to rest at `target`, not faster than `speed` (counts/ms).
    ///
    /// A move too short for that speed has a lower peak; a move that cannot stop in time goes past the target and comes
    /// back.
    #[must_use]
    pub fn to_target(start: f64, velocity: f64, target: f64, speed: f64, ramp: &Ramp) -> Self {
        let speed = speed.abs();
        if speed == 0.0 {
            return Self::to_velocity(start, velocity, 0.0, ramp);
        }
        let distance = target - start;
        if distance == 0.0 && velocity == 0.0 {
            let rest = Stretch::cruise(0.0, 0.0);
            return Self { start, phases: [rest; 3], elapsed: 0.0, target: Some(target) };
        }
        let legs = |peak: f64| (Stretch::change(velocity, peak, ramp), Stretch::change(peak, 0.0, ramp));
        let reach = |peak: f64| {
            let (first, last) = legs(peak);
            first.distance() + last.distance()
        };
        let (peak, cruise) = if reach(speed) <= distance {
            (speed, (distance - reach(speed)) / speed)
        } else if reach(-speed) >= distance {
            (-speed, (reach(-speed) - distance) / speed)
        } else {
            // reach() never falls as the peak grows, so halving finds the peak that just gets there.
            let (mut low, mut high) = (-speed, speed);
            for _ in 0..100 {
                let middle = (low + high) / 2.0;
                if reach(middle) < distance { low = middle } else { high = middle }
            }
            ((low + high) / 2.0, 0.0)
        };
        let (first, last) = legs(peak);
        Self {
            start,
            phases: [first, Stretch::cruise(peak, cruise), last],
            elapsed: 0.0,
            target: Some(target),
        }
    }

    /// The position at the end of the move; `None` for a move without an end.
    #[must_use]
    pub fn end(&self) -> Option<f64> {
        self.target.or_else(|| {
            let length: f64 = self.phases.iter().map(Stretch::distance).sum();
            length.is_finite().then_some(self.start + length)
        })
    }

    /// Milliseconds left, or `None` for a move without end.
    #[must_use]
    pub fn time_left(&self) -> Option<f64> {
        let total: f64 = self.phases.iter().map(|phase| phase.time).sum();
        total.is_finite().then(|| (total - self.elapsed).max(0.0))
    }

    /// Moves the whole profile by `shift` counts: the position's zero has been moved.
    pub fn shift(&mut self, shift: f64) {
        self.start += shift;
        self.target = self.target.map(|target| target + shift);
    }

    /// Goes on by `time` ms.
    pub fn advance(&mut self, time: f64) -> Sample {
        self.elapsed += time;
        let mut t = self.elapsed;
        let mut position = self.start;
        for phase in &self.phases {
            if t < phase.time {
                let (distance, velocity) = phase.at(t);
                return Sample { position: position + distance, velocity, done: false };
            }
            t -= phase.time;
            position += phase.distance();
        }
        Sample { position: self.target.unwrap_or(position), velocity: 0.0, done: true }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs to the end in steps of `step` ms; gives the samples.
    fn run(mut profile: Profile, step: f64) -> Vec<Sample> {
        let mut samples = Vec::new();
        for _ in 0..1_000_000 {
            let sample = profile.advance(step);
            samples.push(sample);
            if sample.done {
                return samples;
            }
        }
        panic!("the move does not end");
    }

    #[test]
    fn the_manuals_example_takes_200_ms() {
        let (time, s) = Ramp::new(0.25, 100.0, 0.0).times(50.0);
        assert_eq!((time, s), (200.0, 0.0));
    }

    #[test]
    fn both_times_zero_is_one_millisecond() {
        assert_eq!(Ramp::new(0.0, 0.0, 0.0).times(10.0), (1.0, 0.0));
    }

    #[test]
    fn definite_moves_end_exactly_and_keep_their_limits() {
        for (velocity, target, speed, ramp) in [
            (0.0, 10_000.0, 32.0, Ramp::new(0.5, 100.0, 30.0)),
            (0.0, -7.25, 32.0, Ramp::new(0.015625, 0.0, 50.0)),
            (20.0, 3.0, 32.0, Ramp::new(0.25, 50.0, 10.0)),
            (-20.0, 500.0, 10.0, Ramp::new(0.25, 0.0, 0.0)),
            (40.0, 100_000.0, 10.0, Ramp::new(1.0, 20.0, 10.0)),
            (5.0, 0.0, 10.0, Ramp::new(1.0, 20.0, 0.0)),
        ] {
            let step = 0.4427;
            let samples = run(Profile::to_target(0.0, velocity, target, speed, &ramp), step);
            assert_eq!(samples.last().unwrap().position, target);
            let mut last = Sample { position: 0.0, velocity, done: false };
            let fastest = speed.max(velocity.abs()) + 1e-9;
            for sample in samples {
                assert!(sample.velocity.abs() <= fastest, "{sample:?}");
                assert!(
                    (sample.velocity - last.velocity).abs() <= ramp.limit * step * 1.001 + 1e-9,
                    "{sample:?}"
                );
                assert!(
                    (sample.position - last.position).abs() <= fastest * step + 1e-6,
                    "{sample:?} {last:?}"
                );
                last = sample;
            }
        }
    }

    #[test]
    fn position_is_the_integral_of_velocity() {
        let mut profile = Profile::to_velocity(100.0, -4.0, 32.0, &Ramp::new(0.25, 100.0, 40.0));
        let (mut position, step) = (100.0, 0.001);
        let mut before = -4.0;
        for _ in 0..400_000 {
            let sample = profile.advance(step);
            position += (before + sample.velocity) / 2.0 * step;
            before = sample.velocity;
            assert!((position - sample.position).abs() < 1e-3, "{position} {sample:?}");
        }
        assert_eq!(before, 32.0);
        assert_eq!(profile.time_left(), None);
    }

    #[test]
    fn a_stop_ends_where_it_says() {
        let profile = Profile::to_velocity(0.0, 32.0, 0.0, &Ramp::new(0.25, 0.0, 0.0));
        let end = profile.end().unwrap();
        assert!((end - 32.0 * 32.0 / 0.25 / 2.0).abs() < 1e-9);
        assert_eq!(run(profile, 1.0).last().unwrap().position, end);
    }
}
