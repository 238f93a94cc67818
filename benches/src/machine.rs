//! What the figures were taken on.

use crate::{clock, process};

/// Says what runs where, in which version, and how well the clock measures.
pub fn introduce(what: &str) {
    let line = |path: &str, key: &str| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let line = text.lines().find(|line| line.starts_with(key)).unwrap_or_default().to_owned();
        line.split_once(':').map_or(line.clone(), |(_, value)| value.trim().to_owned())
    };
    let (tick, overhead) = clock::calibrate();
    let processors = std::thread::available_parallelism().map_or(0, usize::from);
    println!("pmac-dpram-bench {what}");
    println!("{processors} processors, {}", line("/proc/cpuinfo", "model name"));
    println!("Linux {}", std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default().trim());
    println!("counter: {tick:.3} ns a tick, {overhead:.0} ns a reading (taken off)");
    println!("priority: {}", if process::hurry() { "nice -10" } else { "normal (nice -10 was refused)" });
}
