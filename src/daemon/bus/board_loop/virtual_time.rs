//! A replay in virtual time: time jumps to the next due work.

use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use super::{BoardLoop, Connections};
use crate::clock::ManualTime;
use crate::daemon::bus::readable::Descriptors;
use crate::device::Presence;

impl BoardLoop {
    /// As [`BoardLoop::run`], in `time`, which must have begun in the past. While a recording plays, time jumps to the
    /// next due work. At the recording's end time jumps to now and then runs like real time, so that clients' deadlines
    /// hold.
    pub fn run_in(mut self, time: &ManualTime) {
        loop {
            let due_ns = self.poll();
            if due_ns == u64::MAX {
                return;
            }
            let real_ns = self.clock.ns_of(Instant::now());
            if due_ns < real_ns && self.bus.replay().is_some_and(|replay| !replay.over) {
                time.move_to(due_ns);
                continue;
            }
            let left = Duration::from_nanos(due_ns.saturating_sub(real_ns));
            let Connections { intake, stop, .. } = &self.connections;
            let commands = intake.descriptor();
            // Only sleeps: the poll itself looks at the descriptors.
            let _ = Descriptors { stop: stop.as_fd(), commands, interrupts: [None; 3] }.wait(left);
            time.move_to(self.clock.ns_of(Instant::now()));
        }
    }
}
