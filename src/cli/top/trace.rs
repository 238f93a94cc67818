//! The following errors of the last seconds. Of all servo updates between two pictures the largest error counts, so the
//! trace misses no peak. Also the motors' speeds between two pictures, for boards that report no velocity.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use crate::client::View;
use crate::decode::{ServoData, ServoMotor};

/// The length of a trace.
pub const WINDOW: Duration = Duration::from_secs(20);
/// The column heights of a small trace, from nothing to the largest.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// Marks a time without data.
const UNKNOWN: char = '·';

/// The traces of all motors, by number.
#[derive(Debug, Default)]
pub struct Traces {
    errors: BTreeMap<usize, Trace>,
    speeds: Speeds,
}

/// Velocities from the first to the last update of each picture, in counts a second.
#[derive(Debug, Default)]
struct Speeds {
    /// The last seen update: its time, and the actual positions in counts.
    last: Option<(u64, BTreeMap<usize, f64>)>,
    now: BTreeMap<usize, f64>,
}

/// One motor's trace: its following error in counts; `None` where live data lack it.
#[derive(Debug, Default)]
pub struct Trace(VecDeque<(Instant, Option<f64>)>);

impl Traces {
    /// Takes in the samples since the last call, until `now`. No samples, or `stale` data, leave a gap.
    pub fn add(&mut self, samples: &[View<ServoData>], stale: bool, now: Instant) {
        if stale {
            self.speeds = Speeds::default();
        } else if let Some(last) = samples.last() {
            self.speeds.add(last);
        }
        let mut peaks: BTreeMap<usize, Option<f64>> =
            self.errors.keys().map(|motor| (*motor, None)).collect();
        for motor in samples.iter().flat_map(|sample| &sample.data.motors).filter(|_| !stale) {
            let error = motor.following_error.and_then(|error| error.value);
            let peak = peaks.entry(motor.motor).or_default();
            if error.map(f64::abs) > peak.map(f64::abs) {
                *peak = error;
            }
        }
        for (motor, peak) in peaks {
            self.errors.entry(motor).or_default().push(now, peak);
        }
    }

    pub fn of(&self, motor: usize) -> Option<&Trace> {
        self.errors.get(&motor)
    }

    /// The speed of `motor` from the previous picture to this one; `None` if its positions in counts are unknown.
    pub fn velocity(&self, motor: usize) -> Option<f64> {
        self.speeds.now.get(&motor).copied()
    }
}

impl Speeds {
    fn add(&mut self, view: &View<ServoData>) {
        let position = |motor: &ServoMotor| Some((motor.motor, motor.actual_position?.value?));
        let positions: BTreeMap<_, _> = view.data.motors.iter().filter_map(position).collect();
        self.now.clear();
        if let Some((before_ns, before)) = &self.last
            && let Some(took) = view.time_ns.checked_sub(*before_ns).filter(|took| *took > 0)
        {
            let gone = positions.iter().filter_map(|(motor, now)| Some((*motor, now - before.get(motor)?)));
            self.now.extend(gone.map(|(motor, counts)| (motor, counts / (took as f64 / 1e9))));
        }
        self.last = Some((view.time_ns, positions));
    }
}

impl Trace {
    fn push(&mut self, now: Instant, peak: Option<f64>) {
        self.0.push_back((now, peak));
        while self.0.front().is_some_and(|(at, _)| now.saturating_duration_since(*at) > WINDOW) {
            self.0.pop_front();
        }
    }

    /// The largest size in the window.
    pub fn peak(&self) -> Option<f64> {
        self.0.iter().filter_map(|(_, value)| value.map(f64::abs)).max_by(f64::total_cmp)
    }

    /// Stretches without a gap: seconds before `now` as negative numbers, and counts.
    pub fn stretches(&self, now: Instant) -> Vec<Vec<(f64, f64)>> {
        let mut stretches = vec![Vec::new()];
        for (at, value) in &self.0 {
            match (value, stretches.last_mut()) {
                (Some(value), Some(last)) => {
                    last.push((-now.saturating_duration_since(*at).as_secs_f64(), *value));
                }
                (None, Some(last)) if !last.is_empty() => stretches.push(Vec::new()),
                _ => {}
            }
        }
        stretches.retain(|stretch| !stretch.is_empty());
        stretches
    }

    /// The window in `columns` characters, the latest last: the size of the largest error in each part, relative to the
    /// largest error of all, or to one count if that error is smaller.
    pub fn small(&self, columns: usize, now: Instant) -> String {
        let part = WINDOW.as_secs_f64() / columns as f64;
        let most = self.peak().unwrap_or_default().max(1.0);
        let bar = |column: usize| {
            let before = (columns - column) as f64 * part;
            let ago = |at: &Instant| now.saturating_duration_since(*at).as_secs_f64();
            let inside = |(at, _): &&(Instant, _)| (before - part..before).contains(&ago(at));
            let values = self.0.iter().filter(inside).filter_map(|(_, value)| *value);
            let Some(value) = values.map(f64::abs).max_by(f64::total_cmp) else { return UNKNOWN };
            let step = (value / most * (BARS.len() - 1) as f64).round() as usize;
            BARS[step.min(BARS.len() - 1)]
        };
        (0..columns).map(bar).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(now: Instant, values: &[(u64, Option<f64>)]) -> Trace {
        let mut trace = Trace::default();
        for (ago, value) in values {
            trace.push(now - Duration::from_secs(*ago), *value);
        }
        trace
    }

    #[test]
    fn a_small_trace_has_the_peaks_and_the_gaps() {
        let now = Instant::now() + 2 * WINDOW;
        let values =
            [(25, Some(1e9)), (19, Some(1.0)), (13, None), (9, Some(-8.0)), (8, Some(2.0)), (1, Some(0.0))];
        let trace = trace(now, &values);
        assert_eq!(trace.peak(), Some(8.0), "what is older than the window is forgotten");
        assert_eq!(trace.small(4, now), "▂·█▁");
        let stretches = trace.stretches(now);
        assert_eq!(stretches, [vec![(-19.0, 1.0)], vec![(-9.0, -8.0), (-8.0, 2.0), (-1.0, 0.0)]]);
        assert_eq!(Trace::default().small(4, now), "····");
        let values = [(19, Some(0.001)), (13, Some(0.5)), (8, Some(0.0)), (1, Some(0.0))];
        assert_eq!(self::trace(now, &values).small(4, now), "▁▅▁▁", "less than a count is no large error");
    }
}
