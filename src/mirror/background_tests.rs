//! How old what is published is, on a board played by hand, in time of the test's own.

use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::PMAC;
use crate::map::pmac::{BACKGROUND_BLOCK, BACKGROUND_DATA_READY, BACKGROUND_SERVO_TIMER, DATA_READY};
use crate::segment::{CreateOptions, RegionSpec, Sample, SegmentName, Subscriber};

const MS: u64 = 1_000_000;
const PERIOD: u64 = 50 * MS;
const SECOND: u64 = 1000 * MS;
/// Any time well after the start.
const START: u64 = 1000 * SECOND;

struct Rig {
    bus: Counted<FileBoard>,
    mirror: BackgroundMirror,
    publisher: Publisher,
    subscriber: Subscriber,
    sample: Sample,
    now: u64,
    /// PMAC's background passes; each report carries the number of the one that made it.
    passes: u16,
    _directory: tempfile::TempDir,
}

impl Rig {
    fn new() -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        let region = RegionSpec {
            id: RegionId::Background,
            slots: 4,
            payload_bytes: 1200,
            first_host_offset: 0x228,
            blocks: crate::segment::BlockPlace::NONE,
            period_hint_ns: PERIOD,
            stale_after_ns: SECOND,
        };
        let name = SegmentName::new("background").unwrap();
        let mut options = CreateOptions::new(name.clone(), vec![region]);
        directory.path().clone_into(&mut options.directory);
        let mut mirror = BackgroundMirror::new(&PMAC.background, PERIOD);
        mirror.configure(2);
        Self {
            bus: Counted::new(FileBoard::from_file(&file, 0x4000).unwrap()),
            mirror,
            publisher: Publisher::create(&options).unwrap(),
            subscriber: Subscriber::attach_in(directory.path(), &name).unwrap(),
            sample: Sample::new(),
            now: START,
            passes: 0,
            _directory: directory,
        }
    }

    /// One background pass of PMAC's.
    fn pmac(&mut self) {
        self.passes += 1;
        if self.bus.read16(BACKGROUND_DATA_READY).unwrap() & DATA_READY == 0 {
            self.bus.write16(BACKGROUND_BLOCK, self.passes).unwrap();
            self.bus.write16(BACKGROUND_SERVO_TIMER, self.passes).unwrap();
            self.bus.write16(BACKGROUND_DATA_READY, DATA_READY).unwrap();
        }
    }

    fn poll(&mut self) -> Option<Transition> {
        self.mirror.poll(&mut self.bus, &mut self.publisher, self.now).unwrap()
    }

    /// The number of the sample that was published last, the pass that made its report, and its time.
    fn latest(&mut self) -> Option<(u64, u16, u64)> {
        let sequence = self.subscriber.latest(RegionId::Background, &mut self.sample).unwrap()?;
        let first = (BACKGROUND_BLOCK.bytes() - BACKGROUND_DATA_READY.bytes()) as usize / 2;
        Some((sequence, self.sample.words()[first], self.sample.stamp().time_ns))
    }

    /// Runs board and mirror, each millisecond by millisecond, until another sample is published.
    fn run_to_next(&mut self) -> (u64, u16, u64) {
        let before = self.latest();
        for _ in 0..2000 {
            self.now += MS;
            self.pmac();
            while self.mirror.due_ns() <= self.now && self.latest() == before {
                self.poll();
            }
            if self.latest() != before {
                return self.latest().unwrap();
            }
        }
        panic!("no sample");
    }
}

#[test]
fn a_report_is_made_when_it_is_due_and_not_a_period_before() {
    let mut rig = Rig::new();
    let mut last = 0;
    for sequence in 1..20 {
        let (found, pass, time_ns) = rig.run_to_next();
        assert_eq!(found, sequence);
        // A pass a millisecond: it was made after it was asked for, 2 ms before the poll that found it.
        assert!(rig.passes - pass <= 2, "made {} ms before it was read", rig.passes - pass);
        assert!(rig.now - time_ns <= 3 * MS);
        // What its time says, it is no older than.
        assert!(u64::from(pass) * MS + START >= time_ns);
        assert!(sequence == 1 || (49..=53).contains(&(pass - last)), "a report a period: {}", pass - last);
        last = pass;
    }
}

#[test]
fn asking_and_reading_cost_what_they_did() {
    let mut rig = Rig::new();
    rig.poll();
    rig.pmac();
    rig.run_to_next();
    rig.now = rig.mirror.due_ns();
    let before = rig.bus.accesses();
    rig.poll();
    rig.pmac();
    while rig.latest().unwrap().0 == 1 {
        rig.poll();
    }
    // 4 are the board's own.
    assert_eq!(rig.bus.accesses() - before - 4, 2 * 62 + 11);
}

#[test]
fn a_report_that_lay_there_while_the_daemon_stood_still_is_as_old_as_it_says() {
    // After so many polls: asked for; half read; wherever it is.
    for looks in 1..=3 {
        for (stop, is_told) in [(SECOND / 2, true), (60 * SECOND, false)] {
            let mut rig = Rig::new();
            let (_, _, first) = rig.run_to_next();
            rig.now = rig.mirror.due_ns();
            let asked = rig.now;
            rig.poll();
            rig.pmac();
            let made = rig.passes;
            for _ in 1..looks {
                rig.poll();
            }
            assert_eq!(rig.latest().unwrap().2, first);
            rig.now += stop;
            for _ in 0..100 {
                rig.pmac();
            }
            assert_eq!((1..8).find_map(|_| rig.poll()), None, "still live: nobody looked meanwhile");
            let (_, pass, time_ns) = rig.latest().unwrap();
            if is_told {
                assert_eq!((pass, time_ns), (made, asked), "told, but as of then");
            } else {
                assert_eq!(time_ns, first, "too old to be told");
                let (_, pass, time_ns) = rig.run_to_next();
                assert!(pass > made + 100 && rig.now - time_ns <= 4 * MS, "{pass} {made}");
            }
        }
    }
}

#[test]
fn the_report_after_one_that_did_not_stand_has_a_time_of_its_own() {
    let mut rig = Rig::new();
    rig.run_to_next();
    rig.now = rig.mirror.due_ns();
    rig.poll();
    rig.pmac();
    rig.now += 2 * MS;
    let began = rig.now;
    rig.poll();
    // Reset in the middle, with another report right after it.
    rig.bus.write16(BACKGROUND_DATA_READY, 0).unwrap();
    rig.pmac();
    let made = rig.passes;
    rig.now += MS;
    rig.poll();
    rig.poll();
    assert_eq!(rig.latest().unwrap().0, 1, "the first one is not told");
    let (_, pass, time_ns) = rig.run_to_next();
    assert_eq!((pass, time_ns), (made, began), "it was not there when the first one's first words were read");
    // One that does not come for a while is not told as of then.
    rig.now = rig.mirror.due_ns();
    rig.poll();
    rig.pmac();
    rig.poll();
    rig.bus.write16(BACKGROUND_DATA_READY, 0).unwrap();
    rig.poll();
    rig.poll();
    for _ in 0..300 {
        rig.now = rig.mirror.due_ns();
        rig.poll();
    }
    let (_, _, time_ns) = rig.run_to_next();
    assert!(rig.now - time_ns <= 3 * MS, "{} ms", (rig.now - time_ns) / MS);
}

#[test]
fn silence_is_told_once_by_looks() {
    let mut rig = Rig::new();
    rig.run_to_next();
    let mut told = Vec::new();
    for _ in 0..2000 {
        rig.now += MS;
        if rig.mirror.due_ns() <= rig.now {
            told.extend(rig.poll());
        }
    }
    assert_eq!(told, [Transition::Stale]);
    rig.run_to_next();
    assert!(rig.mirror.is_live());
}
