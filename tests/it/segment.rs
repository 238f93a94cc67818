//! The segment between one writer and its readers: the layout, what comes out of what was put in, waiting, history.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use pmac_dpram::segment::{
    BlockPlace, ClockKind, Condition, Counter, CreateOptions, Identity, Publisher, Read, RegionId,
    RegionSpec, RegionState, Sample, SegmentName, Staleness, Stamp, State, Subscriber, WaitOutcome, identity,
    layout, monotonic_ns,
};

use crate::support::wait_until;

/// Long enough for any machine; reached only when a test fails.
pub const LONG: Duration = Duration::from_secs(20);

pub fn name() -> SegmentName {
    SegmentName::new("/pmac0").unwrap()
}

pub fn spec(id: RegionId, slots: u32, payload_bytes: u32) -> RegionSpec {
    RegionSpec {
        id,
        slots,
        payload_bytes,
        first_host_offset: 0x24,
        blocks: BlockPlace::NONE,
        period_hint_ns: 442_673,
        stale_after_ns: 100_000_000,
    }
}

/// The regions of a PMAC.
pub fn regions() -> Vec<RegionSpec> {
    let blocks = |spec, start, stride| RegionSpec { blocks: BlockPlace { start, stride, count: 8 }, ..spec };
    vec![
        blocks(spec(RegionId::Servo, 4096, 516), 36, 60),
        blocks(spec(RegionId::Background, 16, 1028), 36, 124),
        spec(RegionId::Board, 4, identity::BYTES as u32),
        spec(RegionId::Panel, 4, 36),
    ]
}

pub fn options(directory: &Path, regions: Vec<RegionSpec>) -> CreateOptions {
    let mut options = CreateOptions::new(name(), regions);
    options.directory = directory.to_owned();
    options
}

pub fn attach(directory: &Path) -> Subscriber {
    Subscriber::attach_in(directory, &name()).unwrap()
}

pub fn now() -> Stamp {
    Stamp { time_ns: monotonic_ns(), servo_timer: 7, valid: true }
}

pub fn assert_unmixed(sample: &Sample) {
    let words = sample.words();
    assert_eq!(words.len(), 258);
    assert!(words.iter().all(|word| *word == words[0]), "sample {} is mixed", sample.sequence());
    assert_eq!(words[0], sample.sequence() as u16, "sample {} is another's", sample.sequence());
    assert_eq!(sample.stamp().servo_timer, sample.sequence());
}

/// Publishes a servo update in which everything carries the update's own number.
pub fn publish_numbered(publisher: &mut Publisher) -> u64 {
    let number = publisher.published(RegionId::Servo) + 1;
    let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: number, valid: true };
    publisher.publish(RegionId::Servo, stamp, &[number as u16; 258])
}

#[test]
fn the_layout_is_the_one_that_was_published() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Background, RegionState::Stale);
    publisher.set_period(RegionId::Panel, 11, 22);
    publisher.counters().set(Counter::BusErrors, 33);
    publisher.counters().add(Counter::Wakes, 44);
    let file = std::fs::read(directory.path().join("pmac0")).unwrap();
    let word = |offset: usize| u64::from_ne_bytes(file[offset..offset + 8].try_into().unwrap());

    if cfg!(target_endian = "little") {
        assert_eq!(&file[..8], b"PMACDPRM");
    }
    let golden = [
        (0x008, 1),
        (0x010, 5),
        (0x018, 0x500),
        (0x028, file.len() as u64),
        (0x030, 0x0102_0304_0506_0708),
        (0x038, 8),
        (0x040, 1),
        (0x048, publisher.generation()),
        (0x050, u64::from(std::process::id())),
        (0x058, u64::from(nix::unistd::geteuid().as_raw())),
        (0x060, 1),
        (0x070, 300_000_000),
        (0x088, 1),
        (0x0C0, 0x300),
        (0x0C8, 4),
        (0x0D0, 128),
        (0x0D8, 0x200),
        (0x0E0, 20),
        (0x200 + 6 * 8, 33),
        (0x200 + 16 * 8, 44),
        // servo: head, slots, count, stride, payload, host offset, reserved; state, period, stale after; block start, stride, count
        (0x300, 1),
        (0x308, 0x500),
        (0x310, 0x580),
        (0x318, 4096),
        (0x320, 576),
        (0x328, 516),
        (0x330, 0x24),
        (0x338, 0),
        (0x340, 0),
        (0x348, 442_673),
        (0x350, 100_000_000),
        (0x368, 36),
        (0x370, 60),
        (0x378, 8),
        // background
        (0x380, 2),
        (0x388, 0x0024_0580),
        (0x390, 0x0024_0600),
        (0x398, 16),
        (0x3A0, 1088),
        (0x3A8, 1028),
        (0x3C0, 2),
        (0x3E8, 36),
        (0x3F0, 124),
        (0x3F8, 8),
        // panel
        (0x480, 4),
        (0x4F8, 0),
        (0x4A0, 128),
        (0x4A8, 36),
        (0x4C8, 11),
        (0x4D0, 22),
    ];
    for (offset, value) in golden {
        assert_eq!(word(offset), value, "at {offset:#05x}");
    }
    assert!(word(0x080) >= word(0x068) && word(0x068) > 0, "heartbeat after creation");
    assert!(file[0x100..0x200].iter().all(|byte| *byte == 0), "reserved bytes are zero");
    assert_eq!(layout::layout_hash([0x6463_6261]), 0xFA9C_8D4B_F0DF_2D2D, "FNV-1a of abcd and four zeros");
}

#[test]
fn what_is_published_comes_out_as_it_was() {
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let mut sample = Sample::new();
    assert_eq!(reader.latest(RegionId::Servo, &mut sample).unwrap(), None);
    assert!(sample.words().is_empty());

    for length in [258, 257, 4, 3, 1, 0] {
        let words: Vec<u16> = (0..length).map(|index| 0x8000 | index).collect();
        let stamp = Stamp { time_ns: 1 << 60, servo_timer: (1 << 40) + 5, valid: length % 2 == 0 };
        let sequence = publisher.publish(RegionId::Servo, stamp, &words);
        assert_eq!(reader.latest(RegionId::Servo, &mut sample).unwrap(), Some(sequence));
        assert_eq!((sample.words(), sample.stamp(), sample.sequence()), (&words[..], stamp, sequence));
        assert_eq!(sample.bytes().len(), usize::from(length) * 2);
    }
    let who = Identity { family: Some(1), firmware: Some("1.16D".into()), ..Identity::default() };
    publisher.publish_bytes(RegionId::Board, now(), &who.encode());
    reader.latest(RegionId::Board, &mut sample).unwrap();
    assert_eq!(Identity::decode(sample.bytes()), Some(who));
    publisher.publish_bytes(RegionId::Panel, now(), b"odd");
    reader.latest(RegionId::Panel, &mut sample).unwrap();
    assert_eq!((sample.bytes(), sample.words().len()), (&b"odd"[..], 1));

    assert_eq!(publisher.publish(RegionId::Servo, now(), &[0; 259]), 0, "too long");
    assert_eq!(publisher.publish(RegionId::Gather, now(), &[1]), 0, "no such region");
    assert!(reader.latest(RegionId::Gather, &mut sample).is_err());
    assert_eq!(reader.published(RegionId::Servo).unwrap(), 6);
    let servo = reader.region(RegionId::Servo).unwrap();
    assert_eq!((servo.slots, servo.payload_bytes, servo.first_host_offset), (4096, 516, 0x24));
    assert_eq!(servo.blocks, BlockPlace { start: 36, stride: 60, count: 8 });
}

#[test]
fn regions_that_cannot_be_are_refused_before_anything_is_made() {
    let directory = tempfile::tempdir().unwrap();
    let twice = vec![spec(RegionId::Panel, 4, 36), spec(RegionId::Panel, 4, 36)];
    for bad in [
        vec![spec(RegionId::Servo, 3, 8)],
        vec![spec(RegionId::Servo, 1, 8)],
        vec![spec(RegionId::Servo, 4, 1 << 21)],
        vec![spec(RegionId::Servo, 1 << 31, 1 << 20)],
        vec![RegionSpec {
            blocks: BlockPlace { start: 36, stride: 60, count: 9 },
            ..spec(RegionId::Servo, 4, 516)
        }],
        twice,
    ] {
        let error = Publisher::create(&options(directory.path(), bad)).err().unwrap().to_string();
        assert!(error.contains("cannot be laid out"), "{error}");
    }
    let mut open_to_all = options(directory.path(), regions());
    open_to_all.mode = 0o666;
    assert!(Publisher::create(&open_to_all).is_err());
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn only_what_is_live_valid_and_young_is_fresh() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let at = monotonic_ns();
    let fresh = |stamp: Stamp, later_ns: u64| reader.is_fresh(RegionId::Servo, &stamp, at + later_ns);
    let good = Stamp { time_ns: at, servo_timer: 0, valid: true };
    assert!(!fresh(good, 0), "the daemon is only starting");
    publisher.set_state(State::Live);
    assert!(!fresh(good, 0), "the region is off");
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    publisher.beat(at);
    assert!(fresh(good, 0) && fresh(good, 100_000_000));
    assert!(!fresh(good, 100_000_001), "the sample is old");
    assert!(!fresh(Stamp { valid: false, ..good }, 0), "the sample is not valid");
    publisher.set_period(RegionId::Servo, 0, 0);
    assert!(fresh(good, 300_000_000));
    assert!(!fresh(good, 300_000_001), "the heartbeat is old");
    assert_eq!(reader.header_condition(at + 300_000_001), Condition::Stale);
    publisher.set_region_state(RegionId::Servo, RegionState::Stale);
    assert!(!fresh(good, 0), "the region is stale");
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    publisher.set_state(State::Stale);
    assert!(!fresh(good, 0), "the board does not answer");
    publisher.set_state(State::Live);
    assert!(fresh(good, 0));
    publisher.set_state(State::Dead);
    assert!(!fresh(good, 0), "the owner said farewell");
}

/// As in a time namespace, or of a container that was restored on a machine that has run for less time.
#[test]
fn a_heartbeat_or_a_sample_more_than_a_second_ahead_of_now_is_no_sign_of_life() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    let now = monotonic_ns();
    let day_ahead = now + 86_400_000_000_000;
    let stamp = |time_ns: u64| Stamp { time_ns, servo_timer: 0, valid: true };
    let why = |time_ns: u64| {
        let region = reader.region(RegionId::Servo).unwrap();
        let segment = Staleness::of_segment(reader.header_condition(now), &reader.header(), now);
        segment.or_else(|| Staleness::of_sample(&region, &stamp(time_ns), now))
    };
    publisher.beat(now + 1_000_000_000);
    assert_eq!(why(now + 1_000_000_000), None);
    let other_clock = Staleness::OtherClock { ahead_ns: 86_400_000_000_000 };
    assert_eq!(why(day_ahead), Some(other_clock), "the daemon was restored, and the board is silent since");
    publisher.beat(day_ahead);
    assert_eq!((reader.header_condition(now), why(now)), (Condition::Stale, Some(other_clock)));
    assert!(!reader.is_fresh(RegionId::Servo, &stamp(now), now));
    assert!(other_clock.to_string().starts_with("pmacd's times are 86400.0 s ahead of"));
}

#[test]
fn a_segment_with_a_clock_of_its_own_counts_every_age_by_it() {
    let directory = tempfile::tempdir().unwrap();
    let mut own = options(directory.path(), regions());
    own.clock = ClockKind::Own;
    let mut publisher = Publisher::create(&own).unwrap();
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    let reader = attach(directory.path());
    let header = reader.header();
    assert_eq!(
        (header.clock, header.created_ns, header.heartbeat_ns, reader.now_ns()),
        (ClockKind::Own, 0, 0, 0)
    );

    publisher.beat(1_000);
    let stamp = Stamp { time_ns: 900, servo_timer: 0, valid: true };
    publisher.publish(RegionId::Servo, stamp, &[1]);
    assert_eq!(reader.now_ns(), 1_000, "a sample of the past leaves the clock alone");
    publisher.publish(RegionId::Servo, Stamp { time_ns: 1_500, ..stamp }, &[2]);
    assert_eq!(reader.now_ns(), 1_500, "no sample is of the future");
    assert!(reader.is_fresh(RegionId::Servo, &stamp, reader.now_ns()));

    publisher.set_now(900 + 100_000_000);
    assert!(reader.is_fresh(RegionId::Servo, &stamp, reader.now_ns()));
    publisher.set_now(901 + 100_000_000);
    assert!(!reader.is_fresh(RegionId::Servo, &stamp, reader.now_ns()), "the sample is old");
    assert_eq!(reader.condition(), Condition::Live);
    publisher.set_now(1_001 + 300_000_000);
    assert_eq!(reader.condition(), Condition::Stale, "the heartbeat is old");
    publisher.beat(1_001 + 300_000_000);
    assert_eq!((reader.condition(), reader.header().heartbeat_ns), (Condition::Live, 300_001_001));
    let realtime = std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap().as_nanos() as i128;
    let by_segment = i128::from(reader.now_ns()) + i128::from(reader.header().realtime_offset_ns);
    assert!((realtime - by_segment).abs() < 1_000_000_000, "{realtime} {by_segment}");
}

#[test]
fn a_segment_that_runs_by_the_machines_clock_ignores_other_times() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    publisher.set_now(5);
    let before = monotonic_ns();
    assert!(reader.now_ns() >= before);
    assert_eq!(reader.header().clock, ClockKind::Monotonic);
    let file = std::fs::read(publisher.path()).unwrap();
    assert_eq!(file[0x0A0..0x0A8], [0; 8], "its own clock stands at 0");
}

#[test]
fn the_heartbeat_carries_the_offset_of_real_time() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    publisher.beat(123);
    let header = attach(directory.path()).header();
    assert_eq!((header.heartbeat_ns, header.beats), (123, 2));
    let real = std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap().as_nanos() as i128;
    let by_segment = i128::from(monotonic_ns()) + i128::from(header.realtime_offset_ns);
    assert!((real - by_segment).abs() < 1_000_000_000, "{real} {by_segment}");
}

#[test]
fn waiting_ends_at_the_next_sample_at_the_time_out_and_at_the_end() {
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let wait = |sequence, timeout| reader.wait_newer(RegionId::Panel, sequence, timeout).unwrap();
    assert_eq!(wait(0, Duration::ZERO), WaitOutcome::TimedOut);
    let start = Instant::now();
    assert_eq!(wait(0, Duration::from_millis(250)), WaitOutcome::TimedOut);
    assert!(start.elapsed() >= Duration::from_millis(250));
    publisher.publish(RegionId::Panel, now(), &[1]);
    assert_eq!(wait(0, Duration::ZERO), WaitOutcome::Newer);
    thread::scope(|scope| {
        let (told, asleep) = std::sync::mpsc::channel();
        let sleep = |sequence| {
            let told = told.clone();
            let sleeper = scope.spawn(move || {
                told.send(nix::unistd::gettid()).unwrap();
                wait(sequence, LONG)
            });
            let state = format!("/proc/self/task/{}/syscall", asleep.recv().unwrap());
            let number = if cfg!(target_pointer_width = "64") { nix::libc::SYS_futex } else { 422 };
            let futex = format!("{number} ");
            wait_until("a reader that sleeps", || {
                std::fs::read_to_string(&state).unwrap().starts_with(&futex)
            });
            sleeper
        };
        let sleeper = sleep(1);
        publisher.publish(RegionId::Panel, now(), &[2]);
        assert_eq!(sleeper.join().unwrap(), WaitOutcome::Newer);
        let sleeper = sleep(2);
        drop(publisher);
        assert_eq!(sleeper.join().unwrap(), WaitOutcome::Dead);
    });
    assert_eq!(wait(1, Duration::ZERO), WaitOutcome::Newer, "what was published can still be had");
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0, "nothing is left behind");
}

/// Two readers and a writer hand each other the turn; a wake-up lost anywhere would end in a time-out.
#[test]
fn no_wake_up_is_lost() {
    const TURNS: u64 = 3000;
    let (there, back) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut ping = Publisher::create(&options(there.path(), regions())).unwrap();
    let mut pong = Publisher::create(&options(back.path(), regions())).unwrap();
    let (hear_ping, hear_pong) = (attach(there.path()), attach(back.path()));
    thread::scope(|scope| {
        scope.spawn(move || {
            for turn in 0..TURNS {
                assert_eq!(hear_ping.wait_newer(RegionId::Servo, turn, LONG).unwrap(), WaitOutcome::Newer);
                publish_numbered(&mut pong);
            }
        });
        for turn in 0..TURNS {
            publish_numbered(&mut ping);
            assert_eq!(hear_pong.wait_newer(RegionId::Servo, turn, LONG).unwrap(), WaitOutcome::Newer);
        }
    });
}

#[test]
fn history_since_a_number_with_the_exact_count_lost() {
    let directory = tempfile::tempdir().unwrap();
    let regions = vec![spec(RegionId::Servo, 16, 516)];
    let mut publisher = Publisher::create(&options(directory.path(), regions)).unwrap();
    let reader = attach(directory.path());
    let mut sample = Sample::new();
    let mut cursor = reader.cursor(RegionId::Servo, 0).unwrap();
    assert!(!reader.next(&mut cursor, &mut sample).unwrap());
    for _ in 0..16 {
        publish_numbered(&mut publisher);
    }
    for sequence in 1..=16 {
        assert!(reader.next(&mut cursor, &mut sample).unwrap());
        assert_unmixed(&sample);
        assert_eq!(sample.sequence(), sequence);
    }
    assert_eq!((cursor.lost(), reader.next(&mut cursor, &mut sample).unwrap()), (0, false));
    assert_eq!(sample.sequence(), 0, "a sample that was not read is empty");
    for _ in 16..100 {
        publish_numbered(&mut publisher);
    }
    assert_eq!(reader.read(RegionId::Servo, 17, &mut sample).unwrap(), Read::Lost { first_available: 85 });
    assert_eq!(reader.read(RegionId::Servo, 85, &mut sample).unwrap(), Read::Sample);
    assert_unmixed(&sample);
    assert_eq!(reader.read(RegionId::Servo, 101, &mut sample).unwrap(), Read::NotYet);
    let mut got = 16;
    while reader.next(&mut cursor, &mut sample).unwrap() {
        assert_unmixed(&sample);
        got += 1;
    }
    assert_eq!((got, cursor.lost()), (16 + 9, 75), "16 read, then half a ring behind sample 100");
}

/// A writer at full speed, a reader that keeps looking at the latest, and one that follows all: nothing mixed, and what the follower
/// got and what it lost add up to what was published.
#[test]
fn readers_in_the_way_of_a_writer_at_full_speed() {
    let directory = tempfile::tempdir().unwrap();
    let regions = vec![spec(RegionId::Servo, 4, 516)];
    let mut publisher = Publisher::create(&options(directory.path(), regions)).unwrap();
    let (looker, follower) = (attach(directory.path()), attach(directory.path()));
    let done = AtomicBool::new(false);
    let (published, looks, got, lost) = thread::scope(|scope| {
        let look = scope.spawn(|| {
            let (mut sample, mut looks) = (Sample::new(), 0u64);
            while !done.load(Ordering::Relaxed) {
                if looker.latest(RegionId::Servo, &mut sample).is_ok_and(|sequence| sequence.is_some()) {
                    assert_unmixed(&sample);
                    looks += 1;
                }
            }
            looks
        });
        let follow = scope.spawn(|| {
            let (mut sample, mut got) = (Sample::new(), 0u64);
            let mut cursor = follower.cursor(RegionId::Servo, 1).unwrap();
            loop {
                // Read before the attempt, so that a sample published after it is not left out.
                let last = done.load(Ordering::Acquire);
                match follower.next(&mut cursor, &mut sample) {
                    Ok(true) => {
                        assert_unmixed(&sample);
                        assert_eq!(sample.sequence() + 1, cursor.position());
                        got += 1;
                    }
                    Ok(false) if last => return (got, cursor.lost()),
                    _ => {}
                }
            }
        });
        let end = Instant::now() + Duration::from_secs(2);
        while Instant::now() < end {
            for _ in 0..100 {
                publish_numbered(&mut publisher);
            }
        }
        done.store(true, Ordering::Release);
        let (got, lost) = follow.join().unwrap();
        (publisher.published(RegionId::Servo), look.join().unwrap(), got, lost)
    });
    println!("published {published}, looked {looks}, followed {got}, lost {lost}, none mixed");
    assert_eq!(got + lost, published);
    assert!(looks > 0 && got > 0);
}

#[test]
fn counters_and_names_agree() {
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    for (index, counter) in Counter::ALL.into_iter().enumerate() {
        assert_eq!(counter as usize, index);
        publisher.counters().set(counter, index as u64 * 10);
        publisher.counters().add(counter, 1);
    }
    let reader = attach(directory.path());
    for (index, (counter, value)) in reader.counters().enumerate() {
        assert_eq!((value, reader.counter(counter)), (index as u64 * 10 + 1, value), "{}", counter.name());
    }
    for region in RegionId::ALL {
        assert_eq!(RegionId::from_number(region as u64), Some(region));
    }
}

/// The page `docs/segment.md` is enough to read a segment from another language.
#[test]
#[ignore = "needs python3"]
fn with_python_a_program_written_from_the_page_reads_the_same() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/segment_reader.py");
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    publisher.counters().set(Counter::BusAccesses, 246);
    for round in 0..5000u64 {
        let stamp = Stamp { time_ns: round, servo_timer: 1 << 40 | round, valid: true };
        publisher.publish(
            RegionId::Servo,
            stamp,
            &std::array::from_fn::<u16, 258, _>(|i| i as u16 ^ round as u16),
        );
    }
    publisher.publish_bytes(RegionId::Board, now(), &Identity::default().encode());
    let path = publisher.path().to_owned();
    let run = |arguments: &[&str]| {
        let output = Command::new("python3").arg(script).arg(&path).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let read = run(&[]);
    assert_eq!(read["header"]["generation"], publisher.generation());
    assert_eq!(read["header"]["state"], 1);
    assert_eq!(read["header"]["counters"][Counter::BusAccesses as usize], 246);
    let mut sample = Sample::new();
    let reader = attach(directory.path());
    for region in reader.regions() {
        let theirs = &read["regions"][region.id.name()];
        assert_eq!(theirs["slots"], region.slots);
        assert_eq!(theirs["first_host_offset"], region.first_host_offset);
        let blocks = [region.blocks.start, region.blocks.stride, region.blocks.count];
        assert_eq!(theirs["blocks"], serde_json::json!(blocks));
        match reader.latest(region.id, &mut sample).unwrap() {
            None => assert!(theirs["latest"].is_null()),
            Some(sequence) => {
                let latest = &theirs["latest"];
                assert_eq!(latest["sequence"], sequence);
                assert_eq!(latest["time_ns"], sample.stamp().time_ns);
                assert_eq!(latest["servo_timer"], sample.stamp().servo_timer);
                assert_eq!(latest["valid"], sample.stamp().valid);
                assert_eq!(latest["words"], serde_json::json!(sample.words()));
            }
        }
    }
    drop((reader, publisher));

    // And it follows a live ring, losing nothing that it does not count.
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let done = AtomicBool::new(false);
    let followed = thread::scope(|scope| {
        let writer = scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                publish_numbered(&mut publisher);
                thread::sleep(Duration::from_micros(100));
            }
        });
        let followed = run(&["servo", "3000", "--numbered"]);
        done.store(true, Ordering::Relaxed);
        writer.join().unwrap();
        followed
    });
    assert_eq!(followed["mixed"], 0);
    assert!(followed["got"].as_u64().unwrap() + followed["lost"].as_u64().unwrap() >= 3000, "{followed}");
}
