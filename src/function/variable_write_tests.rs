//! Records against the manual's table, and the hand-over against a hand-driven board.

use proptest::prelude::*;

use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::readings::RecordLayout;
use crate::map::{FAMILIES, Family, PMAC, StartRule, TURBO2};

const PLACE: Region = Region::new("variable_write", HostOffset::new(0x2880), HostOffset::new(0x2A00));

struct Rig {
    family: &'static Family,
    bus: Counted<FileBoard>,
    writer: VariableWriter,
    now: Instant,
}

impl Rig {
    fn new(family: &'static Family, place: Region) -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(family.length.into()).unwrap();
        let bus = Counted::new(FileBoard::from_file(&file, family.length as usize).unwrap());
        Self { family, bus, writer: VariableWriter::new(family, place), now: Instant::now() }
    }

    fn begin(&mut self, records: Vec<WriteRecord>) -> bool {
        self.writer.begin(&mut self.bus, records).unwrap().is_ok()
    }

    fn poll(&mut self) -> WritePoll {
        self.writer.poll(&mut self.bus, self.now).unwrap()
    }

    fn count(&mut self) -> u16 {
        self.bus.read16(self.family.variable_write.count).unwrap()
    }

    /// PMAC takes what it was handed, by what the board's words say; returns the records.
    fn take(&mut self) -> Vec<[u16; 6]> {
        let count = usize::from(self.count());
        let StartRule { from, word } = self.family.start;
        let start = self.bus.read16(self.family.variable_write.start).unwrap();
        let start = from.bytes() + 4 * u32::from(start.wrapping_sub(word));
        let mut records = vec![[0; 6]; count];
        for (index, record) in records.iter_mut().enumerate() {
            self.bus.read_block(HostOffset::new(start + 12 * index as u32), record).unwrap();
        }
        self.bus.write16(self.family.variable_write.count, 0).unwrap();
        records
    }
}

fn register(text: &str) -> PmacRegister {
    text.parse().unwrap()
}

/// A record as PMAC's DPRAM holds it.
fn words(record: WriteRecord) -> [u16; 6] {
    record.words(PMAC.variable_write.record, FieldData::AtBit0, WriteLong::Low32)
}

fn word(value: i64) -> WriteRecord {
    WriteRecord::word(register("X:$700"), 24, 0, value).unwrap()
}

#[test]
fn records_are_packed_as_the_manuals_table_says() {
    let record = WriteRecord::word(register("Y:$0700"), 8, 4, 5).unwrap();
    assert_eq!(words(record), [0x0700, 0x0440, 5, 0, 0, 0]);
    let record = WriteRecord::word(register("X:$C003"), 24, 0, -1).unwrap();
    assert_eq!(words(record), [0xC003, 0x0002, 0xFFFF, 0x00FF, 0, 0]);
    let record = WriteRecord::word(register("X:$C003"), 1, 23, 1).unwrap();
    assert_eq!(words(record), [0xC003, 0x170A, 1, 0, 0, 0]);
    // Function blocks of compiled PLCs: types 4 and 6.
    let record = WriteRecord::block(register("X:7"), 20, 4, -2).unwrap();
    assert_eq!(words(record), [7, 0x04A6, 0xFFFE, 0x000F, 0, 0]);
    let record = WriteRecord::block(register("Y:7"), 4, 0, 15).unwrap();
    assert_eq!(words(record), [7, 0x0024, 15, 0, 0, 0]);
    let long = register("D:7");
    assert_eq!(WriteRecord::block(long, 24, 0, 1), Err(RecordError::Words(long)));
    // 19 bits of address go on in the type word where the family's bits leave room for them.
    let record = WriteRecord::word(register("X:$7A205"), 8, 4, 5).unwrap();
    let words = |reading| {
        let bits = TURBO2.variable_write.record_by(reading).unwrap();
        let words = record.words(bits, FieldData::AtBit0, WriteLong::Low32);
        assert_eq!(bits.address(words[0], words[1]), 0x07_A205);
        words
    };
    assert_eq!(words(RecordLayout::AsRead), [0xA205, 4 << 11 | 8 << 6 | 2 << 4 | 7, 5, 0, 0, 0]);
    assert_eq!(words(RecordLayout::AsPmac), [0xA205, 7 << 13 | 4 << 8 | 8 << 3 | 2, 5, 0, 0, 0]);
}

#[test]
fn c1_nothing_is_written_to_a_turbo_board_while_nobody_says_how_it_reads_a_record() {
    assert_eq!(TURBO2.variable_write.record_by(RecordLayout::Unsaid), None);
    for reading in [RecordLayout::Unsaid, RecordLayout::AsRead, RecordLayout::AsPmac] {
        assert_eq!(PMAC.variable_write.record_by(reading), Some(PMAC.variable_write.record));
    }
}

#[test]
fn b3_some_bits_stand_where_the_setting_says() {
    let words =
        |record: WriteRecord| record.words(PMAC.variable_write.record, FieldData::AtOffset, WriteLong::Low32);
    let record = WriteRecord::word(register("Y:$0700"), 8, 16, 0x85).unwrap();
    assert_eq!(words(record), [0x0700, 0x1040, 0, 0x0085, 0, 0]);
    for whole in [word(-2), WriteRecord::float48(register("L:$1005"), 0.1).unwrap()] {
        assert_eq!(
            words(whole),
            whole.words(PMAC.variable_write.record, FieldData::AtBit0, WriteLong::Low32)
        );
    }
}

#[test]
fn long_values_are_split_at_32_bits_not_at_24() {
    // 0.1 is X $666666, Y $6667FC.
    let record = WriteRecord::float48(register("L:$1005"), 0.1).unwrap();
    assert_eq!(words(record), [0x1005, 0x0001, 0x67FC, 0x6666, 0x6666, 0]);
    let record = WriteRecord::fixed48(register("D:$28"), -1).unwrap();
    assert_eq!(words(record), [0x0028, 0x0001, 0xFFFF, 0xFFFF, 0xFFFF, 0]);
    assert_eq!(WriteRecord::fixed48(register("D:$28"), 1 << 47), Err(RecordError::Fixed48(1 << 47)));
    assert!(WriteRecord::fixed48(register("D:$28"), -(1 << 47)).is_ok());
    for value in [f64::NAN, f64::INFINITY, 1e300 * 1e300] {
        assert!(WriteRecord::float48(register("L:$1005"), value).is_err(), "{value}");
    }
    assert!(WriteRecord::float48(register("L:$1005"), 0.0).is_ok());
    assert!(WriteRecord::float48(register("L:$1005"), -123.456).is_ok());
}

#[test]
fn what_would_do_harm_or_nothing_is_refused() {
    let word = |address, width, offset, value| {
        WriteRecord::word(register(&format!("Y:{address}")), width, offset, value)
    };
    let (one, two) = (register("X:1"), register("D:1"));
    assert_eq!(WriteRecord::word(two, 24, 0, 1), Err(RecordError::Words(two)));
    assert_eq!(WriteRecord::fixed48(one, 1), Err(RecordError::Words(one)));
    assert_eq!(word(0, 24, 0, 1), Err(RecordError::AddressZero));
    assert_eq!(WriteRecord::float48(register("L:0"), 1.0), Err(RecordError::AddressZero));
    assert_eq!(WriteRecord::long(register("D:0"), 1, 1), Err(RecordError::AddressZero));
    for width in [0, 2, 3, 5, 23, 25, 32, 255] {
        assert_eq!(word(1, width, 0, 0), Err(RecordError::Width(width)));
    }
    assert_eq!(word(1, 20, 5, 0), Err(RecordError::Offset { width: 20, offset: 5 }));
    assert_eq!(word(1, 24, 1, 0), Err(RecordError::Offset { width: 24, offset: 1 }));
    assert_eq!(word(1, 1, 24, 0), Err(RecordError::Offset { width: 1, offset: 24 }));
    assert_eq!(word(1, 4, 0, 16).unwrap_err().to_string(), "16 does not fit in 4 bits, which hold -8 to 15");
    assert!(word(1, 24, 0, -0x80_0001).is_err());
    assert!(word(1, 24, 0, i64::MIN).is_err());
}

#[test]
fn a_job_is_handed_over_count_last_and_done_when_pmac_says_so() {
    for family in FAMILIES {
        let mut rig = Rig::new(family, PLACE);
        assert_eq!(rig.poll(), WritePoll::Idle);
        let before = rig.bus.accesses();
        assert!(rig.begin(vec![word(1), word(2)]));
        assert_eq!(rig.poll(), WritePoll::Waiting);
        assert_eq!(rig.bus.accesses() - before, 1 + 2 * 6 + 2);
        assert!(!rig.begin(vec![word(3)]), "one job at a time");
        let before = rig.bus.accesses();
        assert_eq!(rig.poll(), WritePoll::Waiting);
        assert_eq!(rig.bus.accesses() - before, 1);
        assert_eq!(
            rig.take(),
            [
                word(1).words(family.variable_write.record, FieldData::AtBit0, WriteLong::Low32),
                word(2).words(family.variable_write.record, FieldData::AtBit0, WriteLong::Low32)
            ]
        );
        assert_eq!((rig.poll(), rig.poll()), (WritePoll::Done, WritePoll::Idle));
    }
}

#[test]
fn more_than_a_cycle_holds_goes_in_order() {
    for family in FAMILIES {
        for (place, cycle) in
            [(PLACE, 32), (Region::new("w", PLACE.start, HostOffset::new(0x2880 + 5 * 12)), 5)]
        {
            for total in [1, 5, 31, 32, 33, 64, 65, 100] {
                let mut rig = Rig::new(family, place);
                assert_eq!(rig.writer.records_per_cycle(), cycle);
                assert!(rig.begin((1..=total).map(word).collect()));
                let mut taken = Vec::new();
                let mut announced = 0;
                for _ in 0..200 {
                    let before = rig.bus.accesses();
                    let step = rig.poll();
                    assert!(rig.bus.accesses() - before <= 6 * POLL_RECORDS as u64 + 2);
                    match step {
                        WritePoll::Done => break,
                        WritePoll::Progress(records) => announced += records,
                        _ => {}
                    }
                    if rig.count() != 0 {
                        taken.extend(rig.take());
                        assert!(taken.len() - announced <= cycle);
                    }
                }
                assert!(rig.writer.is_idle());
                let expected: Vec<_> = (1..=total)
                    .map(|value| {
                        word(value).words(family.variable_write.record, FieldData::AtBit0, WriteLong::Low32)
                    })
                    .collect();
                assert_eq!(taken, expected);
            }
        }
    }
}

#[test]
fn no_records_are_done_at_once_and_no_room_takes_none() {
    for family in FAMILIES {
        let mut rig = Rig::new(family, PLACE);
        assert!(rig.begin(Vec::new()));
        assert_eq!(rig.poll(), WritePoll::Done);
        assert_eq!(rig.count(), 0);
        let mut rig = Rig::new(family, Region::new("w", PLACE.start, PLACE.start));
        assert!(!rig.begin(vec![word(1)]));
    }
}

#[test]
fn a_job_given_up_tells_what_is_certain_and_rests() {
    for family in FAMILIES {
        let mut rig = Rig::new(family, PLACE);
        assert!(rig.begin((1..=40).map(word).collect()));
        let nothing_yet = rig.writer.give_up(&mut rig.bus, rig.now).unwrap();
        assert_eq!(nothing_yet, GivenUp { done: 0, uncertain: 0 });
        assert!(rig.writer.is_idle());

        assert!(rig.begin((1..=40).map(word).collect()));
        while rig.count() == 0 {
            rig.poll();
        }
        rig.take();
        assert_eq!(rig.poll(), WritePoll::Progress(32));
        while rig.count() == 0 {
            rig.poll();
        }
        let given_up = rig.writer.give_up(&mut rig.bus, rig.now).unwrap();
        assert_eq!(given_up, GivenUp { done: 32, uncertain: 8 });
        assert_eq!(rig.count(), 0);
        assert_eq!(rig.poll(), WritePoll::Waiting);
        assert!(!rig.begin(vec![word(1)]), "PMAC may still be at them, and clear the count when it is done");
        rig.now += SETTLE;
        assert_eq!(rig.poll(), WritePoll::Idle);
        assert!(rig.begin(vec![word(1)]));
    }
}

#[test]
fn b3_8_a_late_clearing_of_the_count_is_not_taken_for_the_next_job() {
    for family in FAMILIES {
        let mut rig = Rig::new(family, PLACE);
        assert!(rig.begin(vec![word(1)]));
        rig.poll();
        rig.writer.give_up(&mut rig.bus, rig.now).unwrap();
        rig.now += SETTLE;
        assert_eq!(rig.poll(), WritePoll::Idle);
        assert!(rig.begin(vec![word(2)]));
        rig.poll();
        // PMAC had begun with the first job, and is done with it only now.
        rig.bus.write16(family.variable_write.count, 0).unwrap();
        assert_eq!(rig.poll(), WritePoll::Waiting, "that was not the second job");
        // What PMAC is asked first changes a word of the record alone.
        let [address, kind, number, ..] = rig.take()[0];
        let answer = family.pmac_number(PLACE.start) + 2;
        assert_eq!(u32::from(address), answer & 0xFFFF);
        assert_eq!(u32::from(kind), answer >> 16, "a whole Y word");
        rig.bus.write16(PLACE.start.plus_words(4), number).unwrap();
        assert_eq!(rig.poll(), WritePoll::Waiting);
        assert_eq!(rig.poll(), WritePoll::Waiting);
        assert_eq!(
            rig.take(),
            [word(2).words(family.variable_write.record, FieldData::AtBit0, WriteLong::Low32)]
        );
        assert_eq!(rig.poll(), WritePoll::Done);
        // Once PMAC has answered there is no more doubt.
        assert!(rig.begin(vec![word(3)]));
        rig.poll();
        assert_eq!(
            rig.take(),
            [word(3).words(family.variable_write.record, FieldData::AtBit0, WriteLong::Low32)]
        );
    }
}

#[test]
fn records_of_another_host_and_an_absent_board_are_waited_for() {
    for family in FAMILIES {
        let mut rig = Rig::new(family, PLACE);
        for count in [3, u16::MAX] {
            rig.bus.write16(family.variable_write.count, count).unwrap();
            assert!(!rig.begin(vec![word(1)]));
        }
        rig.writer.release(&mut rig.bus).unwrap();
        assert!(rig.begin(vec![word(1)]));
        rig.poll();
        rig.bus.write16(family.variable_write.count, u16::MAX).unwrap();
        assert_eq!(rig.poll(), WritePoll::Waiting);
    }
}

proptest! {
    #[test]
    fn every_combination_of_the_table_says_where_its_bits_go(
        width in proptest::sample::select(&WIDTHS[..]),
        offset in 0u8..24,
        address in 1u16..,
        raw in any::<u32>(),
    ) {
        let mask = (1u32 << width) - 1;
        let register = register(&format!("X:{address}"));
        let record = WriteRecord::word(register, width, offset, i64::from(raw & mask));
        if width + offset > 24 {
            prop_assert_eq!(record, Err(RecordError::Offset { width, offset }));
        } else {
            let record = record.unwrap();
            let [_, type_word, data @ ..] = words(record);
            let stored_width = type_word >> 3 & 0x1F;
            prop_assert_eq!(type_word & 7, 2);
            prop_assert_eq!(if stored_width == 0 { 24 } else { stored_width }, u16::from(width));
            prop_assert_eq!(type_word >> 8 & 0x1F, u16::from(offset));
            prop_assert_eq!(type_word >> 13, 0);
            let [low, high] = split32(raw & mask);
            prop_assert_eq!(data, [low, high, 0, 0]);
            // The signed reading of the same bits is the same record.
            let signed = i64::from((raw << (32 - width)) as i32 >> (32 - width));
            prop_assert_eq!(WriteRecord::word(register, width, offset, signed).unwrap(), record);
        }
    }
}

/// A board that does the records of 48 bits in the rig, by `long`.
fn write_longs(rig: &mut Rig, long: WriteLong) -> Vec<(u32, [u32; 2])> {
    let bits = rig.family.variable_write.record;
    let base = rig.family.pmac_number(HostOffset::new(0));
    let records = rig.take();
    let longs = records.into_iter().map(|words| {
        let address = bits.address(words[0], words[1]);
        let data = [0, 1].map(|long| u32::from(words[2 + 2 * long]) | u32::from(words[3 + 2 * long]) << 16);
        let [y, x] = match long {
            WriteLong::Low32 => write48::unpack(data),
            WriteLong::Halves => data,
        };
        // What lies in the DPRAM has 16 bits.
        if let Some(at) = address.checked_sub(base).map(|longs| HostOffset::new(4 * longs)) {
            for (word, value) in [y, x].into_iter().enumerate() {
                rig.bus.write16(at.plus_words(word), value as u16).unwrap();
            }
        }
        (address, [y, x].map(int24::unsigned))
    });
    longs.collect()
}

#[test]
fn b3_a_turbo_board_tells_how_it_has_48_bits_before_the_first_is_written() {
    for long in [WriteLong::Low32, WriteLong::Halves] {
        let mut rig = Rig::new(&TURBO2, PLACE);
        let [value, again] =
            [0.1, -3.0].map(|value| WriteRecord::float48(register("L:$1005"), value).unwrap());
        assert!(rig.begin(vec![value]));
        rig.poll();
        assert_eq!(write_longs(&mut rig, long).len(), 1, "the question");
        rig.poll();
        rig.poll();
        assert_eq!(
            write_longs(&mut rig, long),
            [(0x1005, float48::encode(0.1).map(int24::unsigned))],
            "{long:?}"
        );
        assert_eq!(rig.poll(), WritePoll::Done);
        // It is asked once.
        assert!(rig.begin(vec![again]));
        rig.poll();
        assert_eq!(write_longs(&mut rig, long), [(0x1005, float48::encode(-3.0).map(int24::unsigned))]);
        assert_eq!(rig.poll(), WritePoll::Done);
    }
    // One that answers nothing is given nothing.
    let mut rig = Rig::new(&TURBO2, PLACE);
    assert!(rig.begin(vec![WriteRecord::fixed48(register("D:$1005"), 7).unwrap()]));
    rig.poll();
    for _ in 0..2 {
        assert_eq!(rig.take()[0][0] as u32, TURBO2.pmac_number(PLACE.start.plus_words(4)) & 0xFFFF);
        let told = rig.poll();
        assert!(matches!(told, WritePoll::Waiting | WritePoll::LongMisread), "{told:?}");
    }
    assert!(rig.writer.is_idle() && rig.count() == 0);
}
