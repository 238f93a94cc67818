//! The size of a process.

/// Memory, descriptors and threads of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Weight {
    /// All of its memory, including shared memory.
    pub resident_kib: u64,
    pub descriptors: usize,
    pub threads: usize,
}

impl Weight {
    pub fn of(pid: u32) -> Self {
        let count = |what: &str| std::fs::read_dir(format!("/proc/{pid}/{what}")).unwrap().count();
        Self { resident_kib: kib(pid, "status", "VmRSS:"), descriptors: count("fd"), threads: count("task") }
    }
}

impl std::fmt::Display for Weight {
    fn fmt(&self, formatter: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { resident_kib, descriptors, threads } = self;
        write!(formatter, "{resident_kib} KiB, {descriptors} descriptors, {threads} threads")
    }
}

/// The process's private memory: heap and stacks, counted by pages. A segment that fills with data does not change it.
pub fn own_kib(pid: u32) -> u64 {
    kib(pid, "smaps_rollup", "Anonymous:")
}

fn kib(pid: u32, file: &str, key: &str) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}
