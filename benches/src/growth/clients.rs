//! Command clients, each a process with a connection of its own.

use std::time::{Duration, Instant};

use super::running::Running;
use crate::rig::Rig;

const LINE: &str = "I122";
const ANSWER: &str = "32";

/// `count` clients that send a line as soon as the one before is answered.
pub fn send(rig: &Rig, count: usize) -> Running {
    let mut running = Running::new(count);
    for _ in 0..count {
        running.spawn(|notes| {
            let mut connection = rig.connection();
            while notes.goes_on() {
                let start = Instant::now();
                let lines = connection.send(LINE, Duration::from_secs(10)).expect("an answer");
                assert_eq!(lines, [ANSWER]);
                notes.took(start.elapsed().as_nanos() as u64);
            }
        });
    }
    running
}
