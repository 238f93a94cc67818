//! Readers of the segment: such as look now and then, and such as follow every update.

use std::time::{Duration, Instant};

use pmac_dpram::segment::{RegionId, Sample, Subscriber};

use super::running::Running;
use crate::rig::Rig;

/// The readers' processes at most; a thousand processes would measure the kernel's scheduler.
const PROCESSES: usize = 8;
const WOKEN_PROCESSES: usize = 10;
/// How often each takes the latest sample.
const EVERY: Duration = Duration::from_millis(100);

/// `count` readers that each take the latest sample every [`EVERY`], spread evenly over that time.
pub fn look(rig: &Rig, count: usize) -> Running {
    let mut running = Running::new(PROCESSES);
    for process in 0..PROCESSES {
        let own = (process..count).step_by(PROCESSES).count();
        if own == 0 {
            continue;
        }
        running.spawn(|notes| {
            let readers: Vec<Subscriber> = (0..own).map(|_| rig.subscriber()).collect();
            let mut sample = Sample::new();
            let step = EVERY / own as u32;
            let mut due = Instant::now() + step * process as u32 / PROCESSES as u32;
            for reader in readers.iter().cycle() {
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                due += step;
                if !notes.goes_on() {
                    break;
                }
                let found = reader.latest(RegionId::Servo, &mut sample).expect("servo data");
                assert!(found.is_some(), "there are servo data");
                notes.did();
            }
        });
    }
    running
}

/// `count` readers that sleep until there is a new sample, and take every one.
pub fn follow(rig: &Rig, count: usize) -> Running {
    let mut running = Running::new(WOKEN_PROCESSES);
    for process in 0..WOKEN_PROCESSES.min(count) {
        let own = (process..count).step_by(WOKEN_PROCESSES).count();
        running.spawn(|notes| {
            std::thread::scope(|scope| {
                for _ in 0..own {
                    scope.spawn(|| {
                        let reader = rig.subscriber();
                        let next = reader.published(RegionId::Servo).expect("servo data") + 1;
                        let mut cursor = reader.cursor(RegionId::Servo, next).expect("servo data");
                        let (mut sample, mut lost) = (Sample::new(), 0);
                        while notes.goes_on() {
                            let last = cursor.position() - 1;
                            let waited = reader.wait_newer(RegionId::Servo, last, Duration::from_millis(200));
                            waited.expect("servo data");
                            while reader.next(&mut cursor, &mut sample).expect("a sample") {
                                notes.did();
                            }
                            notes.lost(cursor.lost() - lost);
                            lost = cursor.lost();
                        }
                    });
                }
            });
        });
    }
    running
}
