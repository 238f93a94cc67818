//! The function against a hand-driven board, stale passes included.

use proptest::prelude::*;

use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::{FAMILIES, Family, Generation, TURBO2};

const PLACE: Region =
    Region::new("variable_read", HostOffset::new(0x2A00), HostOffset::new(0x2A00 + 2 * 768));

fn reader(family: &'static Family, place: Region) -> VariableReader {
    VariableReader::new(&family.variable_read, family.start, place)
}

/// A kind's code as the X word of an entry has it.
const fn kind(family: &Family, code: u16) -> u16 {
    code << family.variable_read.kind_bit
}

/// The board, and PMAC's half done by hand.
struct Rig {
    family: &'static Family,
    bus: Counted<FileBoard>,
    reader: VariableReader,
    now: Instant,
    timer: u16,
}

impl Rig {
    fn new(family: &'static Family) -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(family.length.into()).unwrap();
        Self {
            family,
            bus: Counted::new(FileBoard::from_file(&file, family.length as usize).unwrap()),
            reader: reader(family, PLACE),
            now: Instant::now(),
            timer: 0,
        }
    }

    fn control(&self) -> u32 {
        self.family.variable_read.ready.word.bytes()
    }

    fn count(&self) -> u32 {
        self.family.variable_read.count.bytes()
    }

    fn begin(&mut self, entries: &[VariableEntry], mode: VariableMode) {
        self.reader.begin(&mut self.bus, entries, mode, self.now).unwrap();
    }

    fn poll(&mut self) -> VariablePoll {
        self.reader.poll(&mut self.bus, self.now).unwrap()
    }

    fn set_up(&mut self, entries: &[VariableEntry], mode: VariableMode) {
        self.begin(entries, mode);
        self.now += READ_PASS_SILENCE;
        while !self.reader.is_running() {
            assert_eq!(self.poll(), VariablePoll::SettingUp);
        }
    }

    fn word(&mut self, offset: u32) -> u16 {
        self.bus.read16(HostOffset::new(offset)).unwrap()
    }

    fn put(&mut self, offset: u32, word: u16) {
        self.bus.write16(HostOffset::new(offset), word).unwrap();
    }

    /// A pass of PMAC's according to the board's words: every value is the entry's address plus `salt`.
    fn pass(&mut self, salt: u16) {
        let VariableRead { timer, start, kind_bit, .. } = &self.family.variable_read;
        let count = u32::from(self.word(self.count()));
        let control = self.word(self.control());
        // The start word grows by 1 a long from the rule's place on.
        let longs = self.word(start.bytes()).wrapping_sub(self.family.start.word);
        let start = self.family.start.from.bytes() + 4 * u32::from(longs);
        let multi_user = control & 0x0100 != 0;
        if count == 0 || (!multi_user && control & 1 != 0) {
            return;
        }
        let mut data = start + 4 * count;
        for entry in 0..count {
            let (address, kind) = (self.word(start + 4 * entry), self.word(start + 4 * entry + 2));
            let words = if matches!(kind >> kind_bit & 7, 1 | 4) { 4 } else { 2 };
            if !multi_user || kind & 0x8000 == 0 {
                for word in 0..words {
                    self.put(data + 2 * word, address.wrapping_add(salt).wrapping_add(word as u16));
                }
                if multi_user {
                    self.put(start + 4 * entry + 2, kind | 0x8000);
                }
            }
            data += 2 * words;
        }
        self.timer += 10;
        self.put(timer.bytes(), self.timer);
        if !multi_user {
            self.put(self.control(), control | 1);
        }
    }
}

const fn entry(address: u32, kind: VariableKind) -> VariableEntry {
    VariableEntry { address, kind }
}

const THREE: [VariableEntry; 3] =
    [entry(0x0028, VariableKind::X), entry(0x1005, VariableKind::Long), entry(0x0700, VariableKind::Y)];

#[test]
fn the_table_is_written_as_the_manual_says_and_the_count_last() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.put(rig.count(), 9);
        rig.begin(&THREE, VariableMode::SingleUser);
        assert_eq!(rig.word(rig.count()), 0, "PMAC is stopped first");
        assert_eq!(rig.poll(), VariablePoll::SettingUp);
        assert_eq!(rig.word(family.variable_read.start.bytes()), 0, "a pass may still be under way");
        rig.now += READ_PASS_SILENCE;
        let before = rig.bus.accesses();
        assert_eq!((rig.poll(), rig.poll()), (VariablePoll::SettingUp, VariablePoll::SettingUp));
        assert_eq!(rig.bus.accesses() - before, 1 + 2 * 3 + 2);
        let header: Vec<_> = (0..4).map(|index| rig.word(rig.control() + 2 * index)).collect();
        let start = if family.generation == Generation::Turbo { 0x0630 } else { 0xDA80 };
        assert_eq!(header, [0, 0, 3, start]);
        let table: Vec<_> = (0..6).map(|index| rig.word(0x2A00 + 2 * index)).collect();
        assert_eq!(table, [0x0028, kind(family, 2), 0x1005, kind(family, 1), 0x0700, 0]);
        assert_eq!((rig.poll(), rig.reader.is_running()), (VariablePoll::Nothing, true));
    }
}

#[test]
fn a_report_is_taken_whole_and_the_next_asked_for() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::SingleUser);
        rig.pass(0x1000);
        let before = rig.bus.accesses();
        assert_eq!(rig.poll(), VariablePoll::Partial);
        rig.pass(0x2000);
        assert_eq!(rig.poll(), VariablePoll::Report(10), "PMAC kept away while it was read");
        let words: Vec<_> = rig.reader.values().iter().map(|value| value.words).collect();
        assert_eq!(words, [[0x1028, 0x1029, 0, 0], [0x2005, 0x2006, 0x2007, 0x2008], [0x1700, 0x1701, 0, 0]]);
        assert!(rig.reader.values().iter().all(|value| (value.timer, value.updates) == (10, 1)));
        // 2 of the accesses are the test's own pass, which found the ready bit set.
        assert_eq!(rig.bus.accesses() - before - 3, 2 + 8 + 2 + 1);
        assert_eq!(rig.word(rig.control()), 0);
        assert_eq!(rig.poll(), VariablePoll::Nothing);
    }
}

#[test]
fn a_report_across_a_reset_is_not_taken() {
    for family in FAMILIES {
        let entries = [entry(0x0300, VariableKind::Long); 40];
        // The words of header, table and values.
        let control = family.variable_read.ready.word.bytes();
        let words = || (control..control + 8).step_by(2).chain((0x2A00..0x2A00 + 40 * 12).step_by(2));
        let whole = 40_usize.div_ceil(POLL_WORDS / 4);
        for looks in 1..=whole {
            for what in ["cleared", "without power", "another report"] {
                let mut rig = Rig::new(family);
                rig.set_up(&entries, VariableMode::SingleUser);
                rig.pass(2);
                for _ in 0..looks {
                    assert_eq!(rig.poll(), VariablePoll::Partial);
                }
                match what {
                    "cleared" => words().for_each(|offset| rig.put(offset, 0)),
                    "without power" => words().for_each(|offset| rig.put(offset, u16::MAX)),
                    _ => {
                        rig.put(rig.control(), 0);
                        rig.pass(3);
                    }
                }
                let writes = rig.bus.writes();
                let end = (looks..=whole).map(|_| rig.poll()).find(|look| *look != VariablePoll::Partial);
                assert_eq!(end, Some(VariablePoll::Nothing), "{what} after {looks}");
                assert!(rig.reader.values().iter().all(|value| *value == VariableValue::default()), "{what}");
                assert_eq!(rig.bus.writes(), writes, "{what}: nothing is written over what is not known");
                // The next polls take a whole report that the board made meanwhile.
                if what == "another report" {
                    let next = (0..=whole).map(|_| rig.poll()).find(|look| *look != VariablePoll::Partial);
                    assert_eq!(next, Some(VariablePoll::Report(20)));
                    assert!(rig.reader.values().iter().all(|value| value.words[0] == 0x0303));
                }
            }
        }
    }
}

#[test]
fn a_long_table_is_set_up_and_read_in_bounded_steps() {
    for family in FAMILIES {
        let entries = [entry(0x0300, VariableKind::Long); 128];
        let mut rig = Rig::new(family);
        rig.begin(&entries, VariableMode::SingleUser);
        rig.now += READ_PASS_SILENCE;
        let (mut steps, mut reports) = (0, 0);
        while reports == 0 {
            let before = rig.bus.accesses();
            if let VariablePoll::Report(_) = rig.poll() {
                reports += 1;
            }
            assert!(rig.bus.accesses() - before <= POLL_WORDS as u64 + 3);
            if rig.reader.state == (ReaderState::Running { next: 0 }) {
                rig.pass(7);
            }
            steps += 1;
            assert!(steps < 100);
        }
        assert!(rig.reader.values().iter().all(|value| value.words == [0x0307, 0x0308, 0x0309, 0x030A]));
    }
}

#[test]
fn in_multi_user_mode_entries_are_taken_and_freed_one_by_one() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::MultiUser);
        assert_eq!(rig.word(rig.control()), 0x0100);
        rig.pass(0x1000);
        let before = rig.bus.accesses();
        assert_eq!(rig.poll(), VariablePoll::Values(0b111));
        assert_eq!(rig.bus.accesses() - before, 1 + 3 + 8 + 3 + 1);
        assert_eq!(rig.reader.values()[2].words, [0x1700, 0x1701, 0, 0]);
        // PMAC has brought one entry so far.
        rig.put(0x2A00 + 12 + 4, 0xAAAA);
        rig.put(0x2A06, 0x8000 | kind(family, 1));
        let before = rig.bus.accesses();
        assert_eq!(rig.poll(), VariablePoll::Values(0b010));
        assert_eq!(rig.bus.accesses() - before, 1 + 3 + 4 + 1 + 1);
        assert_eq!(rig.reader.values()[1].words[0], 0xAAAA);
        assert_eq!(rig.reader.values().iter().map(|value| value.updates).collect::<Vec<_>>(), [1, 2, 1]);
        assert_eq!(rig.word(0x2A06), kind(family, 1), "free for the next");
        assert_eq!(rig.word(rig.control()), 0x0100);
        assert_eq!(rig.poll(), VariablePoll::Nothing);
    }
}

#[test]
fn no_entry_of_a_long_table_starves() {
    for family in FAMILIES {
        let entries = [entry(0x0300, VariableKind::Long); 128];
        let mut rig = Rig::new(family);
        rig.set_up(&entries, VariableMode::MultiUser);
        for _ in 0..200 {
            rig.pass(1);
            let before = rig.bus.accesses();
            rig.poll();
            assert!(rig.bus.accesses() - before <= POLL_WORDS as u64 + 3);
        }
        let updates = rig.reader.values().iter().map(|value| value.updates);
        assert!(updates.clone().min().unwrap() + 1 >= updates.max().unwrap());
        assert!(rig.reader.values()[127].updates > 0);
    }
}

#[test]
fn what_somebody_else_writes_over_the_mode_or_a_kind_is_set_again() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::SingleUser);
        rig.put(rig.control(), 0x0100);
        assert_eq!((rig.poll(), rig.word(rig.control())), (VariablePoll::Nothing, 0));
        assert_eq!(rig.reader.repairs(), 1);

        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::MultiUser);
        rig.put(rig.control(), 1);
        assert_eq!(rig.poll(), VariablePoll::Nothing);
        assert_eq!((rig.word(rig.control()), rig.reader.repairs()), (0x0100, 1));

        rig.put(0x2A02, 0x8000 | kind(family, 1));
        assert_eq!(rig.poll(), VariablePoll::Nothing);
        assert_eq!((rig.word(0x2A02), rig.reader.repairs()), (kind(family, 2), 2));
        rig.pass(0);
        assert_eq!(rig.poll(), VariablePoll::Values(0b111));
    }
}

#[test]
fn what_cannot_be_read_is_refused_before_anything_is_written() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::SingleUser);
        let writes = rig.bus.writes();
        let many = [THREE[0]; 129];
        let error = rig.reader.begin(&mut rig.bus, &many, VariableMode::SingleUser, rig.now).unwrap_err();
        assert!(error.to_string().contains("128 registers at most, not 129"));
        let mut small = reader(family, Region::new("r", HostOffset::new(0x800), HostOffset::new(0x80C)));
        assert!(small.check(&THREE[..1]).is_ok());
        let error = small.begin(&mut rig.bus, &THREE, VariableMode::SingleUser, rig.now).unwrap_err();
        assert!(error.to_string().contains("take 18 words, the plan keeps 6"), "{error}");
        assert_eq!(rig.bus.writes(), writes);
        assert!(rig.reader.is_running(), "the table there was goes on");
    }
}

#[test]
fn no_entries_and_an_absent_board_give_nothing() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.set_up(&THREE, VariableMode::MultiUser);
        for offset in (0..family.length).step_by(2) {
            rig.put(offset, u16::MAX);
        }
        let writes = rig.bus.writes();
        assert_eq!(rig.poll(), VariablePoll::Nothing);
        assert_eq!(rig.bus.writes(), writes);
        rig.begin(&[], VariableMode::MultiUser);
        assert_eq!(rig.poll(), VariablePoll::Off);
        assert_eq!(rig.word(rig.count()), 0);
        rig.reader.release(&mut rig.bus).unwrap();
        assert_eq!(rig.word(rig.control()), 0);
    }
}

#[test]
fn an_entry_into_which_somebody_wrote_high_address_bits_is_set_again() {
    let mut rig = Rig::new(&TURBO2);
    rig.set_up(&[entry(0x8000, VariableKind::X)], VariableMode::MultiUser);
    assert_eq!([rig.word(0x2A00), rig.word(0x2A02)], [0x8000, 0x0020]);
    rig.put(0x2A02, 0x8027);
    assert_eq!((rig.poll(), rig.word(0x2A02)), (VariablePoll::Nothing, 0x0020));
    rig.pass(1);
    assert_eq!(rig.poll(), VariablePoll::Values(1));
    assert_eq!((rig.reader.values()[0].words[0], rig.reader.repairs()), (0x8001, 1));
}

proptest! {
    #[test]
    fn every_table_brings_each_entry_its_own_value(
        kinds in proptest::collection::vec(0usize..4, 1..=128),
        multi_user in any::<bool>(),
        family in proptest::sample::select(FAMILIES),
    ) {
        let all = [VariableKind::Y, VariableKind::X, VariableKind::Long, VariableKind::Special];
        let entries: Vec<_> =
            kinds.iter().enumerate().map(|(index, &kind)| entry(index as u32 * 16, all[kind])).collect();
        let mut rig = Rig::new(family);
        rig.set_up(&entries, if multi_user { VariableMode::MultiUser } else { VariableMode::SingleUser });
        for _ in 0..100 {
            rig.pass(0x0100);
            rig.poll();
        }
        for (entry, value) in entries.iter().zip(rig.reader.values()) {
            let expected: Vec<_> = (0..entry.kind.words()).map(|word| entry.address as u16 + 0x0100 + word as u16).collect();
            prop_assert_eq!(&value.words[..expected.len()], &expected[..]);
            prop_assert!(value.updates > 0);
        }
    }
}
