//! Times measured during a capture.

use std::time::Duration;

use serde_json::{Value, json};

/// The most times kept of one kind.
const MOST_TIMES: usize = 100_000;

/// Times of one kind.
#[derive(Debug, Default)]
pub struct Times(Vec<u64>);

impl Times {
    /// Notes a time.
    pub fn note(&mut self, time: Duration) {
        if self.0.len() < MOST_TIMES {
            self.0.push(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
        }
    }

    /// The number of times, the median, the 99th percentile and the longest, in nanoseconds.
    pub fn document(&self) -> Value {
        let mut sorted = self.0.clone();
        sorted.sort_unstable();
        let at = |percent: usize| sorted.get(sorted.len().saturating_sub(1) * percent / 100);
        json!({ "count": sorted.len(), "median_ns": at(50), "p99_ns": at(99), "longest_ns": at(100) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distribution_is_told_by_four_numbers() {
        let mut times = Times::default();
        assert_eq!(times.document()["median_ns"], Value::Null);
        (1..=101).rev().for_each(|ns| times.note(Duration::from_nanos(ns)));
        let expected = json!({ "count": 101, "median_ns": 51, "p99_ns": 100, "longest_ns": 101 });
        assert_eq!(times.document(), expected);
    }
}
