//! A Turbo PMAC2's motor report, from its DPRAM to named values: the proof that the family is data. The test plays PMAC
//! by hand, after the Turbo User Manual pp. 402-403.

use super::*;
use crate::clock::ManualTime;
use crate::decode::{Scales, ServoData, ServoDecoder};
use crate::device::{Counted, FileBoard};
use crate::format::{fixed48, split32};
use crate::map::{HostOffset, Space, TURBO2};
use crate::segment::{CreateOptions, Sample, SegmentName, Subscriber};
use std::time::Duration;

/// Motors 1, 3 and 32, a mask with holes: bit n-1 is motor n.
const MASK: u32 = 1 | 1 << 2 | 1 << 31;
const MOTORS: [usize; 3] = [1, 3, 32];
/// The servo period at I10=3713991, the default of a Turbo PMAC2 (Turbo Software Reference p. 402).
const CYCLE_NS: u64 = 442_742;
/// The value of words that no side wrote.
const GARBAGE: u16 = 0x5A5A;

struct Rig {
    bus: Counted<FileBoard>,
    mirror: ServoMirror,
    publisher: Publisher,
    subscriber: Subscriber,
    time: ManualTime,
    _directory: tempfile::TempDir,
}

impl Rig {
    fn new(reading: ServoReading) -> Self {
        let file = tempfile::tempfile().unwrap();
        let length = TURBO2.length as usize;
        file.set_len(length as u64).unwrap();
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        let name = SegmentName::new("turbo").unwrap();
        let mut options = CreateOptions::new(name.clone(), vec![region(&TURBO2.servo)]);
        directory.path().clone_into(&mut options.directory);
        let time = ManualTime::at(1_000_000_000_000);
        let mut mirror = ServoMirror::new(&TURBO2.servo, reading, crate::map::Selection::ALL, time.clock());
        mirror.configure(Motors::from_bits(MASK), Some(CYCLE_NS), Some(1));
        let mut rig = Self {
            bus: Counted::new(FileBoard::from_file(&file, length).unwrap()),
            mirror,
            publisher: Publisher::create(&options).unwrap(),
            subscriber: Subscriber::attach_in(directory.path(), &name).unwrap(),
            time,
            _directory: directory,
        };
        // The report is 0x0068 to 0x0673 (Turbo User Manual p. 402). Blocks of motors outside the mask keep old data.
        for offset in (0x0068..0x0674).step_by(2) {
            rig.put(offset, GARBAGE);
        }
        rig.put(0x006A, 0);
        rig
    }

    fn put(&mut self, offset: u32, word: u16) {
        self.bus.write16(HostOffset::new(offset), word).unwrap();
    }

    fn put_longs(&mut self, offset: u32, longs: &[u32]) {
        for (at, word) in (offset..).step_by(2).zip(longs.iter().copied().flat_map(split32)) {
            self.put(at, word);
        }
    }

    /// PMAC clears Data-Ready, copies the motors of the mask, stores the timer, sets Data-Ready (Turbo User Manual p. 403).
    fn update(&mut self, timer: u32) {
        self.put(0x006E, 0);
        self.write_motors(timer);
        self.put(0x006C, timer as u16);
        self.put(0x006E, 1 << 15 | (timer >> 16) as u16);
    }

    fn write_motors(&mut self, timer: u32) {
        for motor in MOTORS {
            let (motor, number) = (0x0074 + 0x30 * (motor as u32 - 1), motor as i64);
            self.put_longs(motor, &fixed48::encode(-number));
            self.put_longs(motor + 8, &[0xFFFF_0000 | number as u32]);
            // Bit 23 of the first word of `?`: the motor is activated (Turbo Software Reference p. 284).
            self.put_longs(motor + 12, &[0x80_0000, 0x00_0400]);
            self.put_longs(motor + 20, &fixed48::encode(1 << 40));
            self.put_longs(motor + 28, &[timer & 0x7F_FFFF, 0x1111_1111, 0x1111_1111]);
            self.put_longs(motor + 40, &fixed48::encode(number << 24 | i64::from(timer)));
        }
    }

    /// One poll, a servo cycle after the last one, and its bus accesses.
    fn poll(&mut self) -> (Option<Transition>, u64) {
        self.time.advance(Duration::from_nanos(CYCLE_NS));
        let before = self.bus.accesses();
        let transition = self.mirror.poll(&mut self.bus, &mut self.publisher).unwrap();
        (transition, self.bus.accesses() - before)
    }

    /// A client's view of the latest sample.
    fn latest(&self) -> Option<(Stamp, ServoData)> {
        let mut sample = Sample::new();
        self.subscriber.latest(RegionId::Servo, &mut sample).unwrap()?;
        let region = self.subscriber.region(RegionId::Servo).unwrap();
        let motors = region.blocks.held_in(2 * sample.words().len());
        let decoder = ServoDecoder::new(&TURBO2);
        let data = decoder.decode(sample.words(), motors, &Scales::default(), region.selection).unwrap();
        Some((sample.stamp(), data))
    }

    fn counter(&self, counter: Counter) -> u64 {
        self.subscriber.counter(counter)
    }
}

#[test]
fn a_turbo_pmacs_motors_come_through_the_path_of_every_family() {
    // The timer has a low and a high word: one word more than on PMAC, before the copy and after it; and the host clears the flag.
    let blocks = 24 * MOTORS.len() as u64;
    for (reading, cost) in [(ServoReading::Optimistic, blocks + 5), (ServoReading::Handshake, blocks + 9)] {
        let mut rig = Rig::new(reading);
        rig.update(0xFF_FFFE);
        assert_eq!(
            rig.poll(),
            (None, 7),
            "what lay there before is not an update; the mask is kept and written"
        );
        let mask = [0x0070, 0x0072].map(|word| rig.bus.read16(HostOffset::new(word)).unwrap());
        assert_eq!(mask, split32(MASK));
        assert_eq!(rig.poll(), (None, 1), "the flag is clear: nothing new");
        rig.update(0xFF_FFFF);
        assert_eq!(rig.poll(), (Some(Transition::Live), cost), "only motors of the mask are read");
        let (first, data) = rig.latest().unwrap();
        assert_eq!((data.servo_timer, data.pmac_busy, data.host_busy), (0xFF_FFFF, false, false));
        assert_eq!(data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>(), MOTORS);
        for motor in &data.motors {
            let number = motor.motor as i64;
            let raw = |quantity: Option<crate::decode::Quantity>| quantity.map(|quantity| quantity.raw);
            assert_eq!(raw(motor.following_error), Some(-number));
            assert_eq!(raw(motor.previous_dac), Some((0xFF_0000 | number) - (1 << 24)));
            assert_eq!(raw(motor.servo_status), Some(0x80_0000));
            assert_eq!(raw(motor.background_status), Some(0x00_0400));
            assert_eq!(raw(motor.position_bias), Some(1 << 40));
            assert_eq!(raw(motor.filtered_velocity), Some(0x7F_FFFF));
            assert_eq!(raw(motor.actual_position), Some(number << 24 | 0xFF_FFFF));
            assert!(motor.commanded_position.is_none(), "section 2: Turbo has none");
            assert!(motor.status.unwrap().has("motor_activated"));
        }

        // The timer comes round after 2^24 cycles, and counts on.
        rig.time.advance(Duration::from_nanos(CYCLE_NS));
        rig.update(0x00_0001);
        rig.poll();
        let (second, data) = rig.latest().unwrap();
        assert_eq!((data.servo_timer, second.servo_timer - first.servo_timer), (1, 2));
        let counts =
            [Counter::Updates, Counter::Missed, Counter::Skipped].map(|counter| rig.counter(counter));
        assert_eq!(counts, [2, 1, 0], "the update at 0 was not read");
        assert_eq!(rig.bus.read16(HostOffset::new(0x006A)).unwrap(), 0, "host busy is clear");
    }
}

#[test]
fn nothing_is_taken_while_a_turbo_pmac_writes() {
    for reading in [ServoReading::Optimistic, ServoReading::Handshake] {
        let mut rig = Rig::new(reading);
        rig.update(5);
        rig.poll();
        // Bit 15 clear: PMAC writes.
        rig.put(0x006E, 0);
        rig.put(0x006C, 6);
        rig.write_motors(6);
        assert_eq!(rig.poll(), (None, 1), "the flag alone says so");
        rig.put(0x006E, 1 << 15);
        rig.poll();
        assert_eq!(rig.latest().unwrap().1.servo_timer, 6);
        // An absent board reads as all ones.
        rig.put(0x006E, u16::MAX);
        assert_eq!(rig.poll(), (None, 1));
    }
}

#[test]
fn other_motors_than_before_leave_nothing_of_those_before() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    rig.update(1);
    rig.poll();
    rig.update(2);
    rig.poll();
    rig.mirror.configure(Motors::of(3), Some(CYCLE_NS), Some(1));
    rig.update(3);
    assert_eq!(rig.poll().1, 4 + 24 + 5, "the mask, looked at and written, the update");
    let (_, data) = rig.latest().unwrap();
    assert_eq!(data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>(), [3]);
    let mut sample = Sample::new();
    rig.subscriber.latest(RegionId::Servo, &mut sample).unwrap();
    // 6 words of head, then three blocks; the mirror did not read the first two.
    assert_eq!(sample.words().len(), 6 + 3 * 24);
    assert!(sample.words()[6..6 + 2 * 24].iter().all(|word| *word == 0));
}

#[test]
fn motors_that_another_host_takes_out_of_the_mask_are_not_shown_any_more() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    rig.update(0);
    rig.poll();
    let shown = |rig: &Rig| {
        let (_, data) = rig.latest().unwrap();
        data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>()
    };
    let updates = |rig: &mut Rig, from: u32| {
        for timer in from..from + 257 {
            rig.update(timer);
            rig.poll();
        }
    };
    updates(&mut rig, 1);
    assert_eq!(shown(&rig), MOTORS);
    // "blocks of unmasked motors keep old data"; a motor that nobody asked for stays away.
    rig.put(0x0070, 0b1110);
    rig.put(0x0072, 0);
    updates(&mut rig, 1000);
    assert_eq!(shown(&rig), [3]);
    assert_eq!(rig.mirror.reader.take_taken_out(), Some(Motors::from_bits(1 | 1 << 31)));
    rig.put(0x0072, 0x8000);
    updates(&mut rig, 2000);
    assert_eq!(shown(&rig), [3, 32], "back as soon as it is seen");
    assert_eq!(rig.bus.read16(HostOffset::new(0x0070)).unwrap(), 0b1110, "no fight about it");
}

#[test]
fn a_board_that_was_reset_gets_its_mask_again() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    for timer in 0..3 {
        rig.update(timer);
        rig.poll();
    }
    let mask = |rig: &mut Rig| [0x0070, 0x0072].map(|at| rig.bus.read16(HostOffset::new(at)).unwrap());
    let told = mask(&mut rig);
    // The board comes back with the words that its memory had at power-on.
    rig.put(0x0070, 0x9B0C);
    rig.put(0x0072, 0xB0DE);
    rig.mirror.reader.mask_is_lost();
    for timer in 3..6 {
        rig.update(timer);
        rig.poll();
    }
    assert_eq!(mask(&mut rig), told);
    let (_, data) = rig.latest().unwrap();
    assert_eq!(data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>(), MOTORS);
}

#[test]
fn what_the_board_made_under_the_mask_as_found_is_not_taken_for_motors_that_came_in_later() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    rig.mirror.reader.keep_as_found(true);
    rig.put(0x0070, 1);
    rig.put(0x0072, 0);
    for timer in 0..3 {
        rig.update(timer);
        rig.poll();
    }
    let shown = |rig: &Rig| {
        let (stamp, data) = rig.latest().unwrap();
        (stamp.servo_timer, data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>())
    };
    let [(before, first), after] = [shown(&rig), {
        rig.mirror.reader.keep_as_found(false);
        // This report is there before the host writes the mask.
        rig.update(3);
        rig.poll();
        shown(&rig)
    }];
    assert_eq!(first, [1]);
    assert_eq!(after, (before, vec![1]), "it has motor 1 alone");
    rig.update(4);
    rig.poll();
    assert_eq!(shown(&rig), (before + 2, MOTORS.to_vec()));
}

#[test]
fn a_motor_that_another_host_had_taken_out_of_the_mask_comes_back_with_the_next_update() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    for timer in 0..3 {
        rig.update(timer);
        rig.poll();
    }
    rig.put(0x0072, 0);
    // This report has motor 32's old words.
    rig.update(3);
    rig.mirror.configure(Motors::from_bits(MASK), Some(CYCLE_NS), Some(1));
    rig.poll();
    let servo_timer = |rig: &Rig| rig.latest().unwrap().1.servo_timer;
    assert_eq!(servo_timer(&rig), 2);
    rig.update(4);
    rig.poll();
    assert_eq!(servo_timer(&rig), 4);
}

#[test]
fn the_mask_is_put_back_as_it_was_found_also_behind_a_reset_that_kept_it() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    rig.put(0x0070, 0b1);
    rig.put(0x0072, 0);
    for timer in 0..3 {
        rig.update(timer);
        rig.poll();
        rig.mirror.reader.mask_is_lost();
    }
    let mask = |rig: &mut Rig| [0x0070, 0x0072].map(|at| rig.bus.read16(HostOffset::new(at)).unwrap());
    assert_eq!(mask(&mut rig), split32(MASK));
    rig.mirror.reader.give_back(&mut rig.bus).unwrap();
    assert_eq!(mask(&mut rig), [1, 0]);
}

#[test]
fn until_somebody_says_which_motors_there_are_the_mask_that_lies_there_counts() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    rig.mirror = ServoMirror::new(
        &TURBO2.servo,
        ServoReading::Optimistic,
        crate::map::Selection::ALL,
        rig.time.clock(),
    );
    rig.put(0x0070, 0b100);
    rig.put(0x0072, 0);
    rig.update(1);
    assert_eq!(rig.poll().1, 2 + 2 + 1, "the mask is read, not written");
    rig.update(2);
    rig.poll();
    let (_, data) = rig.latest().unwrap();
    assert_eq!(data.motors.iter().map(|motor| motor.motor).collect::<Vec<_>>(), [3]);
    assert_eq!(rig.bus.read16(HostOffset::new(0x0070)).unwrap(), 0b100);
}

#[test]
fn the_segment_says_where_the_motors_lie() {
    let region = region(&TURBO2.servo);
    assert_eq!(region.first_host_offset, 0x0068);
    assert_eq!(region.blocks, BlockPlace { start: 12, stride: 0x30, count: 32 });
    assert_eq!(region.payload_bytes, 0x0674 - 0x0068);
}

#[test]
fn addresses_of_a_turbo_pmac_go_both_ways() {
    // Turbo User Manual p. 402: the last long, 0xFFFC, is $063FFF. Motor n begins at $06001D + $0C*(n-1), as drivers in
    // production read it (epics-modules/tpmac).
    let last = TURBO2.host_offset(Space::X, 0x06_3FFF);
    assert_eq!(last, Some(HostOffset::new(0xFFFE)));
    assert_eq!(TURBO2.host_offset(Space::Y, 0x06_4000), None);
    for motor in 1..=TURBO2.motors {
        let block = TURBO2.servo.motors.at(motor).unwrap();
        assert_eq!(TURBO2.pmac_number(block), 0x06_001D + 0x0C * (motor as u32 - 1));
    }
    // A driver in production writes $F0 for a table at $060540 (epics-modules/tpmac).
    let table = TURBO2.host_offset(Space::Y, 0x06_0540).unwrap();
    assert_eq!(TURBO2.start.start_word(table), 0xF0);
}

#[test]
fn a_report_made_in_the_background_or_on_request_misses_nothing() {
    let mut rig = Rig::new(ServoReading::Optimistic);
    // Section 4: with I57=1 "when more than I50 servo cycles have passed since the last copy", with I47=0 when the host
    // has taken the last one. The daemon's old period no longer counts.
    rig.mirror.configure(Motors::from_bits(MASK), Some(CYCLE_NS), Some(0));
    let mut timer = 1000;
    rig.update(timer);
    rig.poll();
    for step in [11, 12, 11, 14, 23, 22, 33].into_iter().cycle().take(200) {
        rig.time.advance(Duration::from_nanos(CYCLE_NS * (u64::from(step) - 1)));
        timer += step;
        rig.update(timer);
        rig.poll();
    }
    assert_eq!((rig.counter(Counter::Updates), rig.counter(Counter::Missed)), (200, 0));
    rig.mirror.configure(Motors::from_bits(MASK), Some(CYCLE_NS), Some(10));
    rig.time.advance(Duration::from_nanos(CYCLE_NS * 29));
    rig.update(timer + 30);
    rig.poll();
    assert_eq!(rig.counter(Counter::Missed), 2, "a period that is told counts");
}

#[test]
fn a_report_on_request_comes_every_servo_cycle_for_as_long_as_it_is_taken() {
    // With I47=0 PMAC looks every servo cycle, and copies once the host has cleared Data-Ready (Turbo User Manual p. 403).
    // The daemon learns I47 before the first update, or in the middle. A poll wakes up late, at times very late.
    const CYCLES: u64 = 20_000;
    let late = [400_000, 90_000, 2_000_000, 20_000, 900_000];
    for told_at in [0, CYCLES / 2, CYCLES] {
        let mut rig = Rig::new(ServoReading::Optimistic);
        rig.mirror = ServoMirror::new(
            &TURBO2.servo,
            ServoReading::Optimistic,
            crate::map::Selection::ALL,
            rig.time.clock(),
        );
        let start = rig.time.ns();
        let (mut wake, mut last_quarter) = (0, 0);
        for cycle in 0..CYCLES {
            if cycle == told_at {
                rig.mirror.configure(Motors::from_bits(MASK), Some(CYCLE_NS), Some(0));
                rig.mirror.set_on_request(true);
            }
            while wake < start + cycle * CYCLE_NS {
                rig.time.move_to(wake);
                rig.mirror.poll(&mut rig.bus, &mut rig.publisher).unwrap();
                let updates = rig.mirror.updates() as usize;
                let held = if updates.is_multiple_of(97) { late[updates / 97 % late.len()] } else { 40_000 };
                wake = rig.mirror.due_ns().max(wake) + held;
            }
            rig.time.move_to(start + cycle * CYCLE_NS);
            if rig.bus.read16(HostOffset::new(0x006E)).unwrap() & 1 << 15 == 0 {
                rig.update(cycle as u32 + 1);
            }
            if cycle == CYCLES * 3 / 4 {
                last_quarter = rig.mirror.updates();
            }
        }
        let taken = rig.mirror.updates() - last_quarter;
        assert!(taken > CYCLES / 4 * 19 / 20, "told at {told_at}: {taken} of {} cycles", CYCLES / 4);
        // An update was there when the mask changed.
        assert_eq!(rig.counter(Counter::Missed), u64::from(told_at == CYCLES / 2), "told at {told_at}");
    }
}
