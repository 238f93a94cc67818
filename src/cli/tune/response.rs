//! The measures of a motor's response to a move: rise time, overshoot, settling time, following error.

use serde::Serialize;

/// The part of a move that a motor may be away from its end and still count as settled.
pub const BAND: f64 = 0.02;
/// The parts of a move between which its rise is timed.
const RISE: [f64; 2] = [0.1, 0.9];

/// The start of the settling time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Settles {
    /// From the begin of the move: the move is short beside the response.
    AfterBegin,
    /// From the move's end: the motor need not be there before.
    AfterEnd,
}

/// A recording: commanded and actual position in counts at times in seconds.
#[derive(Debug, Default)]
pub struct Recording {
    pub times: Vec<f64>,
    pub commanded: Vec<f64>,
    pub actual: Vec<f64>,
}

/// The measures of a response. A measure that the recording does not show is `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Response {
    /// When the move begins, in seconds.
    #[serde(skip)]
    pub begin: f64,
    /// The length of the commanded move, in counts.
    pub size: f64,
    /// From 10 % to 90 % of the move.
    pub rise_time_s: Option<f64>,
    /// The overshoot beyond the end of the move, in percent of the move.
    pub overshoot_percent: f64,
    /// Until the motor stays within [`BAND`] of the end.
    pub settling_time_s: Option<f64>,
    /// The time from which the motor stays at the end, by the clock of `begin`.
    #[serde(skip)]
    pub settled: Option<f64>,
    /// From the beginning of the move on, in counts.
    pub following_error_rms: f64,
    /// The largest, without its sign.
    pub following_error_most: f64,
}

impl Recording {
    /// The following error of each sample.
    pub fn following_error(&self) -> Vec<f64> {
        self.commanded.iter().zip(&self.actual).map(|(commanded, actual)| commanded - actual).collect()
    }

    /// The response; `None` if the commanded position does not move in the recording.
    pub fn response(&self, settles: Settles) -> Option<Response> {
        let (base, end) = (*self.commanded.first()?, *self.commanded.last()?);
        let size = end - base;
        let first = self.commanded.iter().position(|commanded| *commanded != base)?;
        let last = self.commanded.iter().rposition(|commanded| *commanded != end)? + 1;
        // The move ends at its start: it goes to no other place.
        if size == 0.0 || first == 0 {
            return None;
        }
        // The move begins at the sample before the first sample that has moved.
        let from = first - 1;
        let part = |index: usize| (self.actual[index] - base) / size;
        let moved = || from..self.actual.len();
        let begin = self.times[from];
        let furthest = moved().map(part).fold(0.0, f64::max);
        let errors = || moved().map(|index| self.commanded[index] - self.actual[index]);
        let squares: f64 = errors().map(|error| error * error).sum();
        let [low, high] =
            RISE.map(|level| moved().skip(1).find_map(|index| self.crossing(index, level, part)));
        let since = match settles {
            Settles::AfterBegin => begin,
            Settles::AfterEnd => self.times[last],
        };
        let settled = self.settled(from, part);
        Some(Response {
            begin,
            settled,
            size,
            rise_time_s: low.zip(high).map(|(low, high)| high - low),
            overshoot_percent: (furthest - 1.0).max(0.0) * 100.0,
            settling_time_s: settled.map(|time| (time - since).max(0.0)),
            following_error_rms: (squares / moved().len() as f64).sqrt(),
            following_error_most: errors().map(f64::abs).fold(0.0, f64::max),
        })
    }

    /// The time between the sample before `index` and that sample at which the motor goes up through `level`.
    fn crossing(&self, index: usize, level: f64, part: impl Fn(usize) -> f64) -> Option<f64> {
        let (before, after) = (part(index - 1), part(index));
        let (earlier, later) = (self.times[index - 1], self.times[index]);
        (before < level && after >= level)
            .then(|| earlier + (level - before) / (after - before) * (later - earlier))
    }

    /// When the motor has come to stay within the band; `None` if the last sample is outside.
    fn settled(&self, from: usize, part: impl Fn(usize) -> f64) -> Option<f64> {
        let away = |index: usize| (part(index) - 1.0).abs() - BAND;
        let Some(last) = (from..self.actual.len()).rfind(|index| away(*index) > 0.0) else {
            return Some(self.times[from]);
        };
        let next = *self.times.get(last + 1)?;
        let (outside, inside) = (away(last), away(last + 1));
        Some(self.times[last] + outside / (outside - inside) * (next - self.times[last]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1e-5;
    const BEFORE: usize = 100;

    fn recording(samples: usize, commanded: impl Fn(f64) -> f64, actual: impl Fn(f64) -> f64) -> Recording {
        let times: Vec<f64> =
            (0..samples).map(|index| (index as f64 - BEFORE as f64) * STEP_S + 7.0).collect();
        let at = |value: &dyn Fn(f64) -> f64| times.iter().map(|time| value(time - 7.0)).collect();
        Recording { commanded: at(&commanded), actual: at(&actual), times }
    }

    /// The response of a second-order loop, at rest at `base`, to a step at time 0: `damping`, and 100 rad/s undamped.
    fn second_order(damping: f64, base: f64, size: f64) -> Recording {
        let (w, z) = (100.0_f64, damping);
        let answer = move |t: f64| {
            if z < 1.0 {
                let d = (1.0 - z * z).sqrt();
                1.0 - (-z * w * t).exp() * ((w * d * t).cos() + z / d * (w * d * t).sin())
            } else {
                1.0 - (-w * t).exp() * (1.0 + w * t)
            }
        };
        recording(
            40_000,
            move |t| base + if t > 0.0 { size } else { 0.0 },
            move |t| base + if t > 0.0 { size * answer(t) } else { 0.0 },
        )
    }

    /// Text-book figures, times in units of 1/w: rise from 10 % to 90 %, overshoot exp(-pi z / sqrt(1 - z^2)), settling to 2 %.
    const KNOWN: [(f64, f64, f64, f64); 4] = [
        (0.3, 1.321, 37.23, 11.23),
        (0.5, 1.638, 16.30, 8.076),
        (0.7, 2.126, 4.60, 5.979),
        (1.0, 3.358, 0.0, 5.834),
    ];

    #[test]
    fn the_figures_of_loops_of_the_second_order_are_known() {
        for (damping, rise, overshoot, settling) in KNOWN {
            for (base, size) in [(0.0, 1000.0), (-5000.0, -40.0), (1e6, 0.5)] {
                let response = second_order(damping, base, size).response(Settles::AfterBegin).unwrap();
                let near = |found: f64, known: f64, by: f64| {
                    assert!((found - known).abs() < by, "{damping}, {size}: {found} is not {known}");
                };
                near(response.rise_time_s.unwrap() * 100.0, rise, 0.01);
                near(response.overshoot_percent, overshoot, 0.02);
                near(response.settling_time_s.unwrap() * 100.0, settling, 0.02);
                near(response.size, size, 1e-9);
                near(response.following_error_most / size.abs(), 1.0, 0.01);
                near(response.begin, 7.0, 2.0 * STEP_S);
            }
        }
    }

    #[test]
    fn the_following_error_is_that_of_the_move() {
        // A quarter of the samples after the beginning are 8 counts behind.
        let behind = |t: f64| if t > 0.0 && t <= 100.0 * STEP_S { 8.0 } else { 0.0 };
        let commanded = |t: f64| if t > 0.0 { 100.0 } else { 0.0 };
        let response =
            recording(BEFORE + 400, commanded, |t| commanded(t) - behind(t)).response(Settles::AfterBegin);
        let response = response.unwrap();
        assert!((response.following_error_rms - 4.0).abs() < 0.05, "{response:?}");
        assert_eq!((response.following_error_most, response.overshoot_percent), (8.0, 0.0));
    }

    #[test]
    fn what_the_recording_does_not_show_is_not_told() {
        let slow = second_order(0.5, 0.0, 100.0);
        let cut = |samples: usize| Recording {
            times: slow.times[..samples].to_vec(),
            commanded: slow.commanded[..samples].to_vec(),
            actual: slow.actual[..samples].to_vec(),
        };
        let response = cut(BEFORE + 100).response(Settles::AfterBegin).unwrap();
        assert_eq!((response.rise_time_s, response.settling_time_s), (None, None));
        assert_eq!(cut(BEFORE).response(Settles::AfterBegin), None, "no move");
        assert_eq!(Recording::default().response(Settles::AfterBegin), None);
    }

    #[test]
    fn a_long_move_settles_after_its_end() {
        // A ramp of 10 ms that the motor follows 1 ms behind.
        let ramp = |t: f64| (t / 0.01).clamp(0.0, 1.0) * 1000.0;
        let recording = recording(5000, ramp, |t| ramp(t - 0.001));
        let response = recording.response(Settles::AfterEnd).unwrap();
        // 2 % of the move before its end are 0.2 ms.
        assert!((response.settling_time_s.unwrap() - 0.0008).abs() < 2e-5, "{response:?}");
        let response = recording.response(Settles::AfterBegin).unwrap();
        assert!((response.settling_time_s.unwrap() - 0.0108).abs() < 2e-5, "{response:?}");
    }
}
