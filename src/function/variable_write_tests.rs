//! Records against the manual's table, and the hand-over against a hand-driven board.

use proptest::prelude::*;

use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::{HostOffset, PMAC, StartRule};

const PLACE: Region = Region::new("variable_write", HostOffset::new(0x2880), HostOffset::new(0x2A00));

struct Rig {
    bus: Counted<FileBoard>,
    writer: VariableWriter,
    now: Instant,
}

impl Rig {
    fn new(place: Region) -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(PMAC.length.into()).unwrap();
        let bus = Counted::new(FileBoard::from_file(&file, PMAC.length as usize).unwrap());
        Self { bus, writer: VariableWriter::new(&PMAC, place), now: Instant::now() }
    }

    fn begin(&mut self, records: Vec<WriteRecord>) -> bool {
        self.writer.begin(&mut self.bus, records).unwrap().is_ok()
    }

    fn poll(&mut self) -> WritePoll {
        self.writer.poll(&mut self.bus, self.now).unwrap()
    }

    fn count(&mut self) -> u16 {
        self.bus.read16(PMAC.variable_write.count).unwrap()
    }

    /// PMAC takes the records that the board's words name; returns them.
    fn take(&mut self) -> Vec<[u16; 6]> {
        let count = usize::from(self.count());
        let StartRule { from, word } = PMAC.start;
        let start = self.bus.read16(PMAC.variable_write.start).unwrap();
        let start = from.bytes() + 4 * u32::from(start.wrapping_sub(word));
        let mut records = vec![[0; 6]; count];
        for (index, record) in records.iter_mut().enumerate() {
            self.bus.read_block(HostOffset::new(start + 12 * index as u32), record).unwrap();
        }
        self.bus.write16(PMAC.variable_write.count, 0).unwrap();
        records
    }
}

fn register(text: &str) -> PmacRegister {
    text.parse().unwrap()
}

fn word(value: i64) -> WriteRecord {
    WriteRecord::word(register("X:$770"), 24, 0, value).unwrap()
}

#[test]
fn records_are_packed_as_the_manuals_table_says() {
    let record = WriteRecord::word(register("Y:$0770"), 8, 4, 5).unwrap();
    assert_eq!(record.words(), [0x0770, 0x0440, 5, 0, 0, 0]);
    let record = WriteRecord::word(register("X:$C003"), 24, 0, -1).unwrap();
    assert_eq!(record.words(), [0xC003, 0x0002, 0xFFFF, 0x00FF, 0, 0]);
    let record = WriteRecord::word(register("X:$C003"), 1, 23, 1).unwrap();
    assert_eq!(record.words(), [0xC003, 0x170A, 1, 0, 0, 0]);
    // Function blocks of compiled PLCs: types 4 and 6.
    let record = WriteRecord::block(register("X:7"), 20, 4, -2).unwrap();
    assert_eq!(record.words(), [7, 0x04A6, 0xFFFE, 0x000F, 0, 0]);
    let record = WriteRecord::block(register("Y:7"), 4, 0, 15).unwrap();
    assert_eq!(record.words(), [7, 0x0024, 15, 0, 0, 0]);
    let long = register("D:7");
    assert_eq!(WriteRecord::block(long, 24, 0, 1), Err(RecordError::Words(long)));
}

#[test]
fn long_values_are_split_at_32_bits_not_at_24() {
    // 0.1 is X $666666, Y $6667FC.
    let record = WriteRecord::float48(register("L:$1005"), 0.1).unwrap();
    assert_eq!(record.words(), [0x1005, 0x0001, 0x67FC, 0x6666, 0x6666, 0]);
    let record = WriteRecord::fixed48(register("D:$28"), -1).unwrap();
    assert_eq!(record.words(), [0x0028, 0x0001, 0xFFFF, 0xFFFF, 0xFFFF, 0]);
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
    let mut rig = Rig::new(PLACE);
    assert_eq!(rig.poll(), WritePoll::Idle);
    let before = rig.bus.accesses();
    assert!(rig.begin(vec![word(1), word(2)]));
    assert_eq!(rig.poll(), WritePoll::Waiting);
    assert_eq!(rig.bus.accesses() - before, 1 + 2 * 6 + 2);
    assert!(!rig.begin(vec![word(3)]), "one job at a time");
    let before = rig.bus.accesses();
    assert_eq!(rig.poll(), WritePoll::Waiting);
    assert_eq!(rig.bus.accesses() - before, 1);
    assert_eq!(rig.take(), [word(1).words(), word(2).words()]);
    assert_eq!((rig.poll(), rig.poll()), (WritePoll::Done, WritePoll::Idle));
}

#[test]
fn more_than_a_cycle_holds_goes_in_order() {
    for (place, cycle) in [(PLACE, 32), (Region::new("w", PLACE.start, HostOffset::new(0x2880 + 5 * 12)), 5)]
    {
        for total in [1, 5, 31, 32, 33, 64, 65, 100] {
            let mut rig = Rig::new(place);
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
            let expected: Vec<_> = (1..=total).map(|value| word(value).words()).collect();
            assert_eq!(taken, expected);
        }
    }
}

#[test]
fn no_records_are_done_at_once_and_no_room_takes_none() {
    let mut rig = Rig::new(PLACE);
    assert!(rig.begin(Vec::new()));
    assert_eq!(rig.poll(), WritePoll::Done);
    assert_eq!(rig.count(), 0);
    let mut rig = Rig::new(Region::new("w", PLACE.start, PLACE.start));
    assert!(!rig.begin(vec![word(1)]));
}

#[test]
fn a_job_given_up_tells_what_is_certain_and_rests() {
    let mut rig = Rig::new(PLACE);
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
    rig.now += WITHDRAWN_RECORDS_REST;
    assert_eq!(rig.poll(), WritePoll::Idle);
    assert!(rig.begin(vec![word(1)]));
}

#[test]
fn records_of_another_host_and_an_absent_board_are_waited_for() {
    let mut rig = Rig::new(PLACE);
    for count in [3, u16::MAX] {
        rig.bus.write16(PMAC.variable_write.count, count).unwrap();
        assert!(!rig.begin(vec![word(1)]));
    }
    rig.writer.release(&mut rig.bus).unwrap();
    assert!(rig.begin(vec![word(1)]));
    rig.poll();
    rig.bus.write16(PMAC.variable_write.count, u16::MAX).unwrap();
    assert_eq!(rig.poll(), WritePoll::Waiting);
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
            let [_, type_word, data @ ..] = record.words();
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
