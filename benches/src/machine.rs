//! What the figures were taken on.

use std::fmt::Write as _;

use pmac_dpram::device::{CpuLatency, Inherited, System};

use crate::{clock, process};

/// Says what runs where, in which version, and how well the clock measures.
pub fn introduce(what: &str) {
    print!("{}", introduction(what));
}

/// What [`introduce`] says.
pub fn introduction(what: &str) -> String {
    let line = |path: &str, key: &str| {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let line = text.lines().find(|line| line.starts_with(key)).unwrap_or_default().to_owned();
        line.split_once(':').map_or(line.clone(), |(_, value)| value.trim().to_owned())
    };
    let (tick, overhead) = clock::calibrate();
    let processors = std::thread::available_parallelism().map_or(0, usize::from);
    let mut text = format!("pmac-dpram-bench {what}\n");
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let priority = if process::hurry() { "nice -10" } else { "normal (nice -10 was refused)" };
    let _ = writeln!(text, "{processors} processors, {}", line("/proc/cpuinfo", "model name"));
    let _ = writeln!(text, "Linux {}", kernel.trim());
    let _ = writeln!(text, "counter: {tick:.3} ns a tick, {overhead:.0} ns a reading (taken off)");
    let _ = writeln!(text, "priority: {priority}");
    text
}

/// Processors that do not sleep while what is returned is there; `None` where this user may not ask for them.
pub fn keep_awake() -> Option<CpuLatency> {
    CpuLatency::hold(0, &System::here(), &Inherited::default()).ok()
}
