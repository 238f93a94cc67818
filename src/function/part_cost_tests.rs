//! The rows of the table of costs in [`super`] about reading less than everything, and about reading by 32 bits.

use std::time::Instant;

use super::background::{BackgroundPoll, BackgroundReader};
use super::cost_tests::{PLACE, Rig, X, background_report, documented, variables};
use super::gather::{GatherBuffer, GatherPoll, GatherReader, GatherStart};
use super::port_cost_tests::dpram;
use super::servo::{ServoPoll, ServoReader, ServoReading};
use super::variable_read::{VariableMode, VariablePoll};
use crate::device::Access;
use crate::gather::GatherMode;
use crate::map::pmac::{
    BACKGROUND_DATA_READY, BACKGROUND_SERVO_TIMER, DATA_READY, SERVO_HOST_STATUS, SERVO_MOTOR,
    SERVO_PMAC_STATUS, VARIABLE_READ_CONTROL,
};
use crate::map::{Layout, Motors, PMAC, Selection, ServoBlock, TURBO, TURBO2};

const ALL: [usize; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

/// These words of the blocks of these numbers.
fn selected(fields: &[(usize, usize)], numbers: &[usize]) -> Selection {
    Selection::new(fields.iter().map(|(start, end)| *start..*end), numbers.iter().copied())
}

#[test]
fn a_part_of_the_servo_report() {
    let optimistic = ServoReading::Optimistic;
    for (reading, selection, reported, words, row) in [
        // Without the spare words.
        (optimistic, selected(&[(0, 26)], &ALL), 8, 8 * 26, "servo without spare words"),
        (optimistic, selected(&[(0, 26)], &ALL), 3, 3 * 26, ""),
        (ServoReading::Handshake, selected(&[(0, 26)], &ALL), 8, 8 * 26, "servo, handshake, without spare"),
        // Some motors, of which the board may report fewer.
        (optimistic, selected(&[(0, 30)], &[1, 3]), 8, 60, ""),
        (optimistic, selected(&[(0, 30)], &[1, 3]), 2, 30, ""),
        (optimistic, selected(&[(0, 30)], &[5]), 4, 0, ""),
        // Some fields, side by side or not: actual position and status of motors 1 and 3.
        (optimistic, selected(&[(4, 8), (18, 20)], &[1, 3]), 8, 12, "servo of w words"),
        (optimistic, selected(&[], &ALL), 8, 0, ""),
    ] {
        let mut rig = Rig::new();
        let mut reader = ServoReader::new(&PMAC.servo, reading, selection);
        reader.set_motors(Motors::first(reported as usize));
        reader.poll(&mut rig.host).unwrap();
        for word in 0..PMAC.servo.words() {
            rig.put(SERVO_HOST_STATUS.plus_words(word), 0x1111);
        }
        rig.put(SERVO_PMAC_STATUS, 1);
        let (look, cost) = rig.cost(|bus| reader.poll(bus).unwrap());
        let over = if reading == optimistic { 6 } else { 9 };
        assert_eq!((look, cost), (ServoPoll::Update(1), words + over), "{selection:?}");
        assert!(row.is_empty() || cost == documented(row), "{row}");
        // The words that the host read are in their places, and all others are 0: 4 words are the board's, 1 is the
        // timer.
        assert_eq!(reader.image().iter().filter(|word| **word == 0x1111).count(), words + 4);
        let first = SERVO_MOTOR.words_since(SERVO_HOST_STATUS);
        for (index, word) in reader.image().iter().enumerate().skip(first) {
            let (block, at) = ((index - first) / 30, (index - first) % 30);
            let read = selection.has_number(block + 1) && selection.has_words(at, 1);
            assert_eq!(*word == 0x1111, read, "{index}");
        }
    }
}

#[test]
fn a_part_of_the_background_report() {
    for (selection, reported, words, row) in [
        (selected(&[(0, 62)], &[2, 7]), 8, 124, ""),
        (selected(&[(0, 62)], &[2, 7]), 6, 62, ""),
        (selected(&[(8, 10), (50, 52)], &ALL), 8, 32, "background of w words"),
        (selected(&[], &ALL), 8, 0, ""),
        (selected(&[(0, 62)], &[]), 8, 0, ""),
    ] {
        let mut rig = Rig::new();
        let mut reader = BackgroundReader::new(&PMAC.background, selection);
        reader.set_numbers(reported);
        for word in 0..PMAC.background.words() {
            rig.put(BACKGROUND_DATA_READY.plus_words(word), 0x1111);
        }
        rig.put(BACKGROUND_SERVO_TIMER, 7);
        let (look, cost) = background_report(&mut rig, &mut reader);
        assert_eq!((look, cost), (Some(BackgroundPoll::Report(7)), words + 11), "{selection:?}");
        assert!(row.is_empty() || cost == documented(row), "{row}");
        assert_eq!(reader.image().iter().filter(|word| **word == 0x1111).count(), words + 6);
    }
}

/// The cost of an update of `motors` motors by 32 bits.
fn servo_by_32_bits(reading: ServoReading, selection: Selection, motors: usize) -> usize {
    let mut rig = Rig::with_access(Access::Bits32);
    let mut reader = ServoReader::new(&PMAC.servo, reading, selection);
    reader.set_motors(Motors::first(motors));
    reader.poll(&mut rig.host).unwrap();
    for word in 0..PMAC.servo.words() {
        rig.put(SERVO_HOST_STATUS.plus_words(word), word as u16);
    }
    rig.put(SERVO_PMAC_STATUS, 1);
    let (look, cost) = rig.cost(|bus| reader.poll(bus).unwrap());
    assert_eq!(look, ServoPoll::Update(1));
    let first = SERVO_MOTOR.words_since(SERVO_HOST_STATUS);
    for (index, word) in reader.image().iter().enumerate().skip(first) {
        assert_eq!(*word, if selection.has_words((index - first) % 30, 1) { index as u16 } else { 0 });
    }
    cost
}

#[test]
fn servo_data_by_32_bits() {
    let without_spare = selected(&[(0, 26)], &ALL);
    for n in 0..=8 {
        for (reading, selection, expected, row) in [
            (ServoReading::Optimistic, Selection::ALL, 15 * n + 4, "servo by 32 bits, n motors"),
            (ServoReading::Handshake, Selection::ALL, 15 * n + 7, "servo by 32 bits, handshake"),
            (ServoReading::Optimistic, without_spare, 13 * n + 4, "servo by 32 bits without spare"),
        ] {
            let cost = servo_by_32_bits(reading, selection, n);
            assert_eq!(cost, expected, "{n}");
            assert!(n != 8 || cost == documented(row));
        }
    }
    // Fields begin at whole locations, so a part is halved as well.
    assert_eq!(servo_by_32_bits(ServoReading::Optimistic, selected(&[(4, 8), (18, 20)], &ALL), 2), 4 + 6);
}

#[test]
fn the_background_report_by_32_bits() {
    for n in 0..=8 {
        let (mut rig, mut reader) = (
            Rig::with_access(Access::Bits32),
            BackgroundReader::new(&PMAC.background, crate::map::Selection::ALL),
        );
        reader.set_numbers(n);
        rig.put(BACKGROUND_SERVO_TIMER, 7);
        let (look, cost) = background_report(&mut rig, &mut reader);
        assert_eq!((look, cost), (Some(BackgroundPoll::Report(7)), 31 * n + 8), "{n}");
        assert!(n != 8 || cost == documented("background by 32 bits"));
    }
}

#[test]
fn the_other_data_by_32_bits() {
    let place = Layout::new(&PMAC, None).gather();
    for (s, l) in [(1, 1), (64, 1), (5, 3), (8, 8), (1, 48)] {
        let mut rig = Rig::with_access(Access::Bits32);
        let (mode, size_longs) = (GatherMode::Stop, 128 * l);
        let buffer = GatherBuffer {
            place,
            room_longs: 128 * 48,
            size_longs,
            sample_longs: l,
            longest_sample: 48,
            mode,
            period: 1,
        };
        rig.put(place.size, size_longs as u16);
        let mut reader = GatherReader::new(buffer, GatherStart::Defined).unwrap();
        assert_eq!(reader.poll(&mut rig.host, |_| Ok(0)).unwrap(), GatherPoll::Idle);
        rig.put(place.index, (s * l) as u16);
        let (look, cost) = rig.cost(|bus| reader.poll(bus, |_| Ok(0)).unwrap());
        assert_eq!(look, GatherPoll::Samples { first: 0, count: s as usize });
        assert_eq!(cost, (s * l) as usize + 3);
        assert!((s, l) != (8, 8) || cost == documented("gather by 32 bits"));
    }

    let mut rig = Rig::with_access(Access::Bits32);
    let (mut reader, _) = variables(&mut rig, &[X; 128], VariableMode::SingleUser);
    let now = Instant::now();
    rig.put(VARIABLE_READ_CONTROL, DATA_READY);
    let (look, cost) = rig.cost(|bus| {
        let looks = std::iter::repeat_with(|| reader.poll(bus, now).unwrap());
        looks.take(50).find(|look| *look != VariablePoll::Partial)
    });
    assert_eq!((look, cost), (Some(VariablePoll::Report(0)), documented("variable read by 32 bits")));
    assert!(PLACE.start.bytes().is_multiple_of(4));
    assert_eq!(dpram(&PMAC, 20, 20, Access::Bits32), documented("ASCII line by 32 bits"));
}

/// The firmware's writes for a report of a Turbo board whose timer is `timer`: data, timer, flag.
fn turbo_report(rig: &mut Rig, block: &ServoBlock, timer: u16) {
    rig.put(block.timer.low, timer);
    rig.put(block.pmac_status.word, block.pmac_status.mask);
}

#[test]
fn an_update_of_a_turbo_board() {
    let all = |numbers: u32| u32::MAX >> (32 - numbers);
    for family in [&TURBO, &TURBO2] {
        for (access, reading, row) in [
            (Access::Bits16, ServoReading::Optimistic, "servo of a Turbo board, n motors"),
            (Access::Bits16, ServoReading::Handshake, "servo of a Turbo board, handshake"),
            (Access::Bits32, ServoReading::Optimistic, "servo of a Turbo board by 32 bits, n motors"),
            (Access::Bits32, ServoReading::Handshake, "servo of a Turbo board by 32 bits, handshake"),
        ] {
            for n in [1, 8, 32] {
                let mut rig = Rig::of(family, access);
                let mut reader = ServoReader::new(&family.servo, reading, crate::map::Selection::ALL);
                reader.set_motors(Motors::from_bits(all(n)));
                turbo_report(&mut rig, &family.servo, 1);
                let (first, _) = rig.cost(|bus| reader.poll(bus).unwrap());
                assert_eq!(first, ServoPoll::First(1));
                // So many updates that the host reads the mask as often as in use.
                let (updates, mut counted) = (512, 0);
                for timer in 2..2 + updates {
                    turbo_report(&mut rig, &family.servo, timer);
                    let (update, cost) = rig.cost(|bus| reader.poll(bus).unwrap());
                    assert_eq!(update, ServoPoll::Update(timer.into()), "{n} {reading:?}");
                    // The flag is clear. Now and then the host also reads the mask.
                    let (idle, look) = rig.cost(|bus| reader.poll(bus).unwrap());
                    assert_eq!(idle, ServoPoll::Unchanged);
                    counted += cost + look - 1;
                }
                let words = 24 * n as usize / if access == Access::Bits32 { 2 } else { 1 };
                let mask = 2 * usize::from(updates) / 256;
                let polls = if reading == ServoReading::Handshake { 9 } else { 5 };
                assert_eq!(counted, usize::from(updates) * (words + polls) + mask, "{n} {reading:?}");
                if n == 8 {
                    assert_eq!(counted / usize::from(updates), documented(row));
                }
                // At most a twentieth more than necessary; for one motor by 32 bits the one extra look is more than
                // that already.
                let most = if (n, access, polls) == (1, Access::Bits32, 9) { 106 } else { 105 };
                let necessary = usize::from(updates) * (words + if polls == 9 { 8 } else { 5 });
                assert!(counted * 100 <= necessary * most, "{n} {reading:?}: {counted} of {necessary}");
            }
        }
    }
}
