//! The age of published data, on a board played by hand, in the test's own time.

use super::*;
use crate::decode::{Scales, background};
use crate::device::{Counted, FileBoard};
use crate::format::Float48Layout;
use crate::map::TURBO2;
use crate::map::pmac::{BACKGROUND_BLOCK, BACKGROUND_DATA_READY, BACKGROUND_SERVO_TIMER, DATA_READY};
use crate::map::{HostOffset, PMAC};
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
    /// PMAC's background passes; each report carries the number of its pass.
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
        let mut mirror = BackgroundMirror::new(&PMAC.background, PERIOD, crate::map::Selection::ALL);
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

    /// The number of the last published sample, the pass that made its report, and its time.
    fn latest(&mut self) -> Option<(u64, u16, u64)> {
        let sequence = self.subscriber.latest(RegionId::Background, &mut self.sample).unwrap()?;
        let first = (BACKGROUND_BLOCK.bytes() - BACKGROUND_DATA_READY.bytes()) as usize / 2;
        Some((sequence, self.sample.words()[first], self.sample.stamp().time_ns))
    }

    /// Runs board and mirror millisecond by millisecond until the mirror publishes another sample.
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
fn whether_a_motion_program_runs_is_told_where_every_coordinate_system_is_reported() {
    let mut rig = Rig::new();
    rig.run_to_next();
    let told = |rig: &Rig| rig.mirror.programs_run(rig.now, SECOND).map(|(systems, _)| !systems.is_empty());
    assert_eq!(told(&rig), None, "the report has two of eight");
    rig.mirror.configure(8);
    let third = PMAC.background.program_runs.word.plus_words(2 * PMAC.background.blocks.words);
    for (word, runs) in [(0xFFFE, false), (0x0001, true)] {
        rig.bus.write16(third, word).unwrap();
        let asked = rig.now;
        rig.run_to_next();
        rig.run_to_next();
        assert_eq!(told(&rig), Some(runs));
        assert!(rig.mirror.programs_run(rig.now, SECOND).unwrap().1 > asked, "when it was asked for");
    }
    rig.now += 2 * SECOND;
    assert_eq!(told(&rig), None, "too old");
}

#[test]
fn a_report_is_made_when_it_is_due_and_not_a_period_before() {
    let mut rig = Rig::new();
    let mut last = 0;
    for sequence in 1..20 {
        let (found, pass, time_ns) = rig.run_to_next();
        assert_eq!(found, sequence);
        // A pass a millisecond: PMAC made the report after the request, which came 2 ms before the poll that found it.
        assert!(rig.passes - pass <= 2, "made {} ms before it was read", rig.passes - pass);
        assert!(rig.now - time_ns <= 3 * MS);
        // The data are no older than the sample's time says.
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
    // 4 accesses are the board's own.
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
    // A reset in the middle, with another report right after it.
    rig.bus.write16(BACKGROUND_DATA_READY, 0).unwrap();
    rig.pmac();
    let made = rig.passes;
    rig.now += MS;
    rig.poll();
    rig.poll();
    assert_eq!(rig.latest().unwrap().0, 1, "the first one is not told");
    let (_, pass, time_ns) = rig.run_to_next();
    assert_eq!((pass, time_ns), (made, began), "it was not there when the first one's first words were read");
    // A report that takes long does not get the time of the request.
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

/// A segment with a Turbo board's background report, and the segment's directory.
fn turbo_segment() -> (Publisher, Subscriber, tempfile::TempDir) {
    let directory = tempfile::tempdir_in("/dev/shm").unwrap();
    let name = SegmentName::new("turbo").unwrap();
    let mut options = CreateOptions::new(name.clone(), vec![region(&TURBO2.background, PERIOD)]);
    directory.path().clone_into(&mut options.directory);
    let publisher = Publisher::create(&options).unwrap();
    let subscriber = Subscriber::attach_in(directory.path(), &name).unwrap();
    (publisher, subscriber, directory)
}

#[test]
fn a_report_made_under_the_count_as_found_is_not_read_with_more_blocks() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(TURBO2.length.into()).unwrap();
    let mut bus = FileBoard::from_file(&file, TURBO2.length as usize).unwrap();
    let (mut publisher, subscriber, _directory) = turbo_segment();
    let [count, timer, ready] = [0x0674, 0x0678, 0x067A].map(HostOffset::new);
    // The count becomes the host's while a report is there or half read, or while the board is making a report.
    for polls in [Some(0), Some(1), Some(2), None] {
        let mut mirror = BackgroundMirror::new(&TURBO2.background, PERIOD, crate::map::Selection::ALL);
        mirror.configure(3);
        mirror.keep_as_found(true);
        bus.write16(count, 2).unwrap();
        let mut now = START;
        let mut poll = |mirror: &mut BackgroundMirror, bus: &mut FileBoard| {
            now += MS;
            mirror.poll(bus, &mut publisher, now).unwrap();
            mirror.reports()
        };
        poll(&mut mirror, &mut bus);
        if polls.is_none() {
            mirror.keep_as_found(false);
            poll(&mut mirror, &mut bus);
        }
        bus.write16(timer, 1).unwrap();
        bus.write16(ready, 0x8000).unwrap();
        for _ in 0..polls.unwrap_or(0) {
            poll(&mut mirror, &mut bus);
        }
        mirror.keep_as_found(false);
        for _ in 0..50 {
            assert_eq!(poll(&mut mirror, &mut bus), 0, "{polls:?}: the board made it for two");
        }
        assert_eq!([count, ready].map(|word| bus.read16(word).unwrap()), [16, 0], "{polls:?}");
        bus.write16(timer, 2).unwrap();
        bus.write16(ready, 0x8000).unwrap();
        assert!((0..50).any(|_| poll(&mut mirror, &mut bus) == 1), "{polls:?}");
        let mut sample = Sample::new();
        subscriber.latest(RegionId::Background, &mut sample).unwrap().unwrap();
        let blocks = subscriber.region(RegionId::Background).unwrap().blocks;
        assert_eq!(blocks.held_in(2 * sample.words().len()), 16);
    }
}

#[test]
fn a_turbo_pmacs_coordinate_systems_come_through_the_path_of_every_family() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(TURBO2.length.into()).unwrap();
    let mut bus = Counted::new(FileBoard::from_file(&file, TURBO2.length as usize).unwrap());
    let (mut publisher, subscriber, _directory) = turbo_segment();
    let mut mirror = BackgroundMirror::new(&TURBO2.background, PERIOD, crate::map::Selection::ALL);
    // The reported motors do not matter: these blocks are coordinate systems.
    mirror.configure(3);
    let at = HostOffset::new;
    for word in [0x0676, 0x067A] {
        bus.write16(at(word), u16::MAX).unwrap();
    }
    mirror.poll(&mut bus, &mut publisher, START).unwrap();
    // Turbo User Manual p. 405: the host writes the highest coordinate system to bits 0-7 of 0x0674; Host-Busy is bit 15 of
    // 0x0676.
    let header = [0x0674, 0x0676, 0x067A].map(|word| bus.read16(at(word)).unwrap());
    assert_eq!(header, [16, 0, 0], "all of them, PMAC is not held off, and a report is asked for");

    // PMAC copies the global words and each coordinate system, stores the timer, sets Data-Ready (p. 405).
    for (offset, long) in [(0x067C, 0x11_u32), (0x0680, 0x22), (0x0684, 0x33)] {
        bus.write16(at(offset), long as u16).unwrap();
    }
    for number in 1..=16_u32 {
        let block = 0x069C + 0x80 * (number - 1);
        // Long 5 of a block is word 1 of `??`, long 25 the value of `PR`.
        bus.write16(at(block + 4 * 5), number as u16).unwrap();
        bus.write16(at(block + 4 * 25), 100 + number as u16).unwrap();
    }
    // The second word of `???`, Y:$000006: a buffer is open (Turbo Software Reference p. 290).
    bus.write16(at(0x068A), 1 << 3).unwrap();
    bus.write16(at(0x0678), 0x5678).unwrap();
    bus.write16(at(0x067A), 0x8012).unwrap();
    let before = bus.accesses();
    for poll in 1..=17 {
        mirror.poll(&mut bus, &mut publisher, START + poll * MS).unwrap();
    }
    assert_eq!(bus.accesses() - before, 2 + 10 + 16 * 64 + 2);

    let told = WholeBoard { program_buffer_open: true, gathering: false };
    assert!(mirror.whole_board() == Some(told) && mirror.is_new(START, SECOND));

    let mut sample = Sample::new();
    subscriber.latest(RegionId::Background, &mut sample).unwrap().unwrap();
    let place = subscriber.region(RegionId::Background).unwrap().blocks;
    let numbers = place.held_in(2 * sample.words().len());
    let data =
        background(&TURBO2, sample.words(), numbers, &Scales::default(), Float48Layout::default()).unwrap();
    assert_eq!((data.ready, data.servo_timer), (true, 0x12_5678));
    assert_eq!([data.ports.control_panel, data.ports.thumbwheel, data.ports.machine_io], [0x11, 0x33, 0x22]);
    assert!(data.motors.is_empty(), "the motors' data are in the servo report");
    assert_eq!(data.coordinate_systems.len(), 16);
    for (number, system) in (1..).zip(&data.coordinate_systems) {
        assert_eq!((system.coordinate_system, system.status_word), (number, Some(number as u32)));
        assert_eq!(system.lines_remaining, Some(100 + number as i32));
        assert!(system.axis_targets.axis("Z").is_some() && system.pmac.is_none());
    }
}
