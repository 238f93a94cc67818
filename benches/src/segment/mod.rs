//! `segment`: publishing and reading through the shared-memory segment, row by row against its bars.
//!
//! All rows are measured once a round, ours and the peer's right after each other, so that both see the same minutes of the
//! machine; what is told is the ratio. Writer and reader are processes, the writer on processor 0, the reader on processor 1.

mod fresh;
mod hot;
mod loss;
mod ours;
mod peer;
mod wake;

use std::time::{Duration, Instant};

use crate::machine;
use crate::process;
use crate::table::Table;

/// Measures `rounds` rounds, and at last `checked` copies word by word against a writer at full speed.
pub fn run(rounds: usize, checked: u64, only: &str) {
    machine::introduce("segment");
    let directory =
        tempfile::Builder::new().prefix("pmac-bench-").tempdir_in("/dev/shm").expect("a directory");
    let mut table = Table::default();
    for round in 0..rounds {
        process::quiet(Duration::from_secs(2));
        let (start, (others, stolen)) = (Instant::now(), process::others());
        if only.contains('h') {
            hot::round(&mut table, directory.path());
        }
        if only.contains('f') {
            fresh::round(&mut table, directory.path());
        }
        if only.contains('w') {
            wake::round(&mut table, directory.path());
        }
        if only.contains('l') {
            loss::round(&mut table, directory.path(), 3);
        }
        let seconds = start.elapsed().as_secs_f64();
        let (others_now, stolen_now) = process::others();
        println!(
            "round {round}: {seconds:.1} s, others used {:.2} of 2 processors, the hypervisor stole {:.2} s",
            (others_now - others) / seconds,
            stolen_now - stolen
        );
    }
    println!("\n{}", table.text());
    if checked > 0 {
        let (mixed, retries, most) = loss::checked_reads(directory.path(), checked);
        println!(
            "row 11: {checked} copies checked against a writer at full speed: {mixed} mixed, {retries} retries, at most {most} a read"
        );
    }
}
