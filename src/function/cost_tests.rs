//! Checks the table of costs in [`super`] by counting: each function against a file whose other end plays PMAC.

use std::time::Instant;

use super::background::{BackgroundPoll, BackgroundReader};
use super::gather::{GatherBuffer, GatherPoll, GatherReader, GatherStart, report_cycles};
use super::panel::{FeedOverride, Panel, PanelAction, PanelRequest};
use super::port_cost_tests::{dpram, mailboxes};
use super::rotary::{RotarySetup, RotaryStream};
use super::servo::{ServoPoll, ServoReader, ServoReading};
use super::servo_timer::ServoTimer;
use super::testing::two_sides;
use super::variable_read::{self, VariableEntry, VariableMode, VariablePoll, VariableReader};
use super::variable_write::{VariableWriter, WritePoll, WriteRecord};
use crate::device::{Access, Bus, Counted, FileBoard};
use crate::gather::GatherMode;
use crate::map::FAMILIES;
use crate::map::functions::{VARIABLE_READ_ENTRY_READY, VARIABLE_READ_ENTRY_WORDS, rotary_header};
use crate::map::pmac::{
    BACKGROUND_DATA_READY, BACKGROUND_SERVO_TIMER, DATA_READY, SERVO_PMAC_STATUS, VARIABLE_READ_CONTROL,
    VARIABLE_WRITE_COUNT,
};
use crate::map::{Family, HostOffset, Layout, Motors, PMAC, Region, VariableKind};
use crate::rotary::START_OF_LINE;

pub const PLACE: Region =
    Region::new("variables", HostOffset::new(0x2A00), HostOffset::new(0x2A00 + 2 * 768));

/// The host's bus, which counts, and PMAC's own way to the same memory.
pub struct Rig {
    pub host: Counted<FileBoard>,
    pmac: FileBoard,
}

impl Rig {
    pub fn new() -> Self {
        Self::with_access(Access::Bits16)
    }

    pub fn with_access(access: Access) -> Self {
        Self::of(&PMAC, access)
    }

    pub fn of(family: &Family, access: Access) -> Self {
        let [host, pmac] = two_sides(family);
        Self { host: Counted::new(host.with_access(access)), pmac }
    }

    pub fn put(&mut self, offset: HostOffset, word: u16) {
        self.pmac.write16(offset, word).unwrap();
    }

    /// The result of `act`, and how many accesses it took.
    pub fn cost<T>(&mut self, act: impl FnOnce(&mut Counted<FileBoard>) -> T) -> (T, usize) {
        let before = self.host.accesses();
        let result = act(&mut self.host);
        (result, (self.host.accesses() - before) as usize)
    }
}

/// The last number of the table's row whose first cell begins with `what`.
pub fn documented(what: &str) -> usize {
    let start = format!("//! | {what}");
    let mut rows = include_str!("mod.rs").lines().filter(|line| line.starts_with(&start));
    let row = rows.next().unwrap_or_else(|| panic!("no row for {what}"));
    assert_eq!(rows.next(), None, "one row for {what}");
    row.trim_end_matches(" |").rsplit(' ').next().unwrap().parse().unwrap()
}

#[test]
fn servo() {
    for (reading, over, row) in [
        (ServoReading::Optimistic, 6, "servo update, optimistic"),
        (ServoReading::Handshake, 9, "servo update, handshake"),
    ] {
        for n in 0..=8 {
            let (mut rig, mut reader) =
                (Rig::new(), ServoReader::new(&PMAC.servo, reading, crate::map::Selection::ALL));
            reader.set_motors(Motors::first(n));
            reader.poll(&mut rig.host).unwrap();
            rig.put(SERVO_PMAC_STATUS, 1);
            let (look, cost) = rig.cost(|bus| reader.poll(bus).unwrap());
            assert_eq!((look, cost), (ServoPoll::Update(1), 30 * n + over), "{n}");
            if n == 8 {
                assert_eq!(cost, documented(row));
            }
            let idle = rig.cost(|bus| reader.poll(bus).unwrap());
            assert_eq!(idle, (ServoPoll::Unchanged, documented("servo idle poll")));
        }
    }
}

#[test]
fn background() {
    for n in 0..=8 {
        let (mut rig, mut reader) =
            (Rig::new(), BackgroundReader::new(&PMAC.background, crate::map::Selection::ALL));
        reader.set_numbers(n);
        let idle = rig.cost(|bus| reader.poll(bus).unwrap());
        assert_eq!(idle, (BackgroundPoll::Nothing, documented("background idle poll")));
        rig.put(BACKGROUND_SERVO_TIMER, 7);
        let (look, cost) = background_report(&mut rig, &mut reader);
        assert_eq!((look, cost), (Some(BackgroundPoll::Report(7)), 62 * n + 11), "{n}");
        if n == 8 {
            assert_eq!(cost, documented("background report"));
        }
    }
}

/// Asks for a report and reads it; returns the result and the cost.
pub fn background_report(rig: &mut Rig, reader: &mut BackgroundReader) -> (Option<BackgroundPoll>, usize) {
    let ((), asked) = rig.cost(|bus| reader.ask(bus).unwrap());
    rig.put(BACKGROUND_DATA_READY, DATA_READY);
    let (look, read) = rig.cost(|bus| {
        let looks = std::iter::repeat_with(|| reader.poll(bus).unwrap());
        looks.take(20).find(|look| *look != BackgroundPoll::Partial)
    });
    (look, asked + read)
}

/// A reader that has set up a table of `entries`, and the cost.
pub fn variables(rig: &mut Rig, entries: &[VariableEntry], mode: VariableMode) -> (VariableReader, usize) {
    let (now, mut reader) = (Instant::now(), VariableReader::new(&PMAC.variable_read, PMAC.start, PLACE));
    let later = now + variable_read::READ_PASS_SILENCE;
    let polls = 1 + (entries.len() * VARIABLE_READ_ENTRY_WORDS).div_ceil(variable_read::POLL_WORDS);
    let ((), set_up) = rig.cost(|bus| {
        reader.begin(bus, entries, mode, now).unwrap();
        (0..polls).for_each(|_| assert_eq!(reader.poll(bus, later).unwrap(), VariablePoll::SettingUp));
    });
    assert!(reader.is_running());
    (reader, set_up)
}

pub const X: VariableEntry = VariableEntry { address: 0x0028, kind: VariableKind::X };
pub const L: VariableEntry = VariableEntry { address: 0x1005, kind: VariableKind::Long };

#[test]
fn variable_read() {
    for entries in [vec![X], vec![L], vec![X, L, X], vec![L; 40], [X, L].repeat(20), vec![X; 128]] {
        let mut rig = Rig::new();
        let now = Instant::now();
        let (mut reader, cost) = variables(&mut rig, &entries, VariableMode::SingleUser);
        assert_eq!(cost, 2 * entries.len() + 4);
        let all = entries.len() == 128;
        assert!(!all || cost == documented("variable read set-up"));
        let idle = rig.cost(|bus| reader.poll(bus, now).unwrap());
        assert_eq!(idle, (VariablePoll::Nothing, documented("variable read idle poll")));
        rig.put(VARIABLE_READ_CONTROL, DATA_READY);
        let (look, cost) = rig.cost(|bus| {
            let looks = std::iter::repeat_with(|| reader.poll(bus, now).unwrap());
            looks.take(50).find(|look| *look != VariablePoll::Partial)
        });
        let words: usize = entries.iter().map(|entry| entry.kind.words()).sum();
        assert_eq!((look, cost), (Some(VariablePoll::Report(0)), words + 5));
        assert!(!all || cost == documented("variable read report"));
    }
}

#[test]
fn variable_read_in_multi_user_mode() {
    for (entries, new) in
        [(vec![X; 1], 1), (vec![X; 8], 8), (vec![X; 8], 3), (vec![L, X, L], 2), (vec![L; 5], 5)]
    {
        let mut rig = Rig::new();
        let (now, e) = (Instant::now(), entries.len());
        let (mut reader, _) = variables(&mut rig, &entries, VariableMode::MultiUser);
        let announce = |rig: &mut Rig, count: usize| {
            for (index, entry) in entries.iter().enumerate().take(count) {
                let word = entry.kind.code() | VARIABLE_READ_ENTRY_READY;
                rig.put(PLACE.start.plus_words(2 * index + 1), word);
            }
        };
        let look =
            |rig: &mut Rig, reader: &mut VariableReader| rig.cost(|bus| reader.poll(bus, now).unwrap());
        let (idle, cost) = look(&mut rig, &mut reader);
        assert_eq!((idle, cost), (VariablePoll::Nothing, e + 1));
        assert!(e != 5 || cost == documented("variable read multi-user idle poll"));
        announce(&mut rig, new);
        let words: usize = entries[..new].iter().map(|entry| entry.kind.words()).sum();
        let (values, cost) = look(&mut rig, &mut reader);
        assert_eq!((values, cost), (VariablePoll::Values((1 << new) - 1), e + words + new + 2));
        assert!(e != 5 || cost == documented("variable read multi-user, a idle poll"));
    }
}

#[test]
fn variable_write() {
    let small = Region::new("small", PLACE.start, PLACE.start.plus_words(5 * 6));
    for (place, r, c) in
        [(PLACE, 1, 1), (PLACE, 7, 1), (PLACE, 32, 1), (PLACE, 33, 2), (PLACE, 100, 4), (small, 7, 2)]
    {
        let (mut rig, mut writer, now) = (Rig::new(), VariableWriter::new(&PMAC, place), Instant::now());
        let records = vec![WriteRecord::word("X:$770".parse().unwrap(), 24, 0, 1).unwrap(); r];
        let (begun, mut sum) = rig.cost(|bus| writer.begin(bus, records).unwrap());
        assert!(begun.is_ok());
        let mut cycles = 0;
        for _ in 0..200 {
            let (step, cost) = rig.cost(|bus| writer.poll(bus, now).unwrap());
            sum += cost;
            if step == WritePoll::Done {
                break;
            }
            if rig.pmac.read16(VARIABLE_WRITE_COUNT).unwrap() != 0 {
                let idle = rig.cost(|bus| writer.poll(bus, now).unwrap());
                assert_eq!(idle, (WritePoll::Waiting, documented("variable write idle poll")));
                rig.put(VARIABLE_WRITE_COUNT, 0);
                cycles += 1;
            }
        }
        assert!(writer.is_idle());
        assert_eq!((cycles, sum), (c, 6 * r + 3 * c + 1), "{r}");
        assert!(r != 32 || sum == documented("variable write, "));
    }
}

#[test]
fn panel_and_overrides() {
    let panels = FAMILIES.iter().filter_map(|family| Some((family, family.panel.as_ref()?)));
    for ((family, words), n) in panels.flat_map(|panel| (1..=8).map(move |n| (panel, n))) {
        let (mut rig, mut panel) = (Rig::of(family, Access::Bits16), Panel::new(words));
        let numbers: Vec<usize> = (1..=n).collect();
        let request = PanelRequest::of(words, PanelAction::JogPlus, &numbers).unwrap();
        let (begun, begin) = rig.cost(|bus| panel.begin(bus, &request).unwrap());
        assert!(begun);
        assert_eq!(rig.cost(|bus| panel.taken(bus).unwrap()), (false, documented("panel idle poll")));
        rig.put(words.request_enable, 0);
        let (taken, seen) = rig.cost(|bus| panel.taken(bus).unwrap());
        assert_eq!((taken, begin + seen), (true, n + 3));
        assert!(n != 8 || begin + seen == documented("panel request"));

        let value = FeedOverride::MAXIMUM;
        let set = documented("feed override set");
        assert_eq!(rig.cost(|bus| panel.set_override(bus, n, value).unwrap()), (true, set + 1));
        assert_eq!(rig.cost(|bus| panel.set_override(bus, n, value).unwrap()), (true, set));
        let ended = documented("feed override ended");
        assert_eq!(rig.cost(|bus| panel.release_override(bus, n).unwrap()), (true, ended));
    }
}

#[test]
fn gather() {
    let place = Layout::new(&PMAC, Some("1.16D".parse().unwrap())).gather();
    for (mode, clock, row) in [(GatherMode::Stop, 0, ""), (GatherMode::Wrap, 1, ", round and round")] {
        for (s, l) in [(1, 1), (64, 1), (5, 3), (8, 8), (1, 48), (2, 32)] {
            let (mut rig, mut timer) = (Rig::new(), ServoTimer::new(15));
            // The buffer has 128 samples, so none parts at its end.
            let buffer = GatherBuffer {
                place,
                room_longs: 128 * 48,
                size_longs: 128 * l,
                sample_longs: l,
                longest_sample: 48,
                mode,
                period: 1,
            };
            rig.put(place.size, (128 * l) as u16);
            let mut reader = GatherReader::new(buffer, GatherStart::Defined).unwrap();
            let mut step = |rig: &mut Rig| {
                rig.cost(|bus| reader.poll(bus, |bus| report_cycles(bus, &PMAC.servo, &mut timer)).unwrap())
            };
            let look = documented(&format!("gather idle poll{row} |"));
            assert_eq!(step(&mut rig), (GatherPoll::Idle, look));
            assert_eq!(look, 2 + 2 * clock);
            rig.put(SERVO_PMAC_STATUS, s as u16);
            rig.put(place.index, (s * l) as u16);
            let (samples, cost) = step(&mut rig);
            assert_eq!(samples, GatherPoll::Samples { first: 0, count: s as usize });
            assert_eq!(cost, 2 * (s * l) as usize + 3 + 3 * clock);
            if (s, l) == (8, 8) {
                let row = if clock == 0 { "gather, s samples" } else { "gather round and round" };
                assert_eq!(cost, documented(row));
            }
        }
    }
}

#[test]
fn rotary() {
    for (family, c) in FAMILIES.iter().flat_map(|family| [1, 2, 3, 10, 48].map(|c| (family, c))) {
        let mut rig = Rig::of(family, Access::Bits16);
        let header = family.rotary.headers[0];
        let size_longs = 2 * c + 4;
        let setup = RotarySetup {
            start: family.user_area.start,
            size_longs,
            coordinate_system: 1,
            coordinate_system_base: 1,
        };
        let mut stream = RotaryStream::of_family(family).remove(0);
        let ((), cost) = rig.cost(|bus| stream.set_up(bus, &setup).unwrap());
        // One access more if no I-variable keeps PMAC out.
        let set_up = documented("rotary set-up") + usize::from(family.i.rotary_enable.is_none());
        assert_eq!(cost, set_up);
        let line: Vec<_> =
            (0..c).map(|command| (if command == 0 { START_OF_LINE } else { 0 } | 0x40, 0x80_0000)).collect();
        let (sent, cost) = rig.cost(|bus| stream.offer(bus, &line).unwrap());
        assert_eq!((sent, cost), (true, 4 * c as usize + 7));
        assert!(c != 3 || cost == documented("rotary line"));
        let look = documented("rotary idle poll");
        assert_eq!(rig.cost(|bus| stream.offer(bus, &line).unwrap()), (false, look + 1));
        rig.put(header.plus_words(rotary_header::STATUS), rotary_header::BUSY);
        let (state, cost) = rig.cost(|bus| stream.state(bus).unwrap());
        assert_eq!((state.busy, cost), (true, documented("rotary state")));
        assert_eq!(rig.cost(|bus| stream.offer(bus, &line).unwrap()), (false, look));
        rig.put(header.plus_words(rotary_header::PMAC_INDEX), (2 * c) as u16);
        assert_eq!(rig.cost(|bus| stream.offer(bus, &line).unwrap()), (true, 4 * c as usize + 7));
        rig.put(header.plus_words(rotary_header::STATUS), rotary_header::BUSY | 1);
        let ((), again) = rig.cost(|bus| stream.set_up(bus, &setup).unwrap());
        assert_eq!(again, set_up + 1);
    }
}

#[test]
fn lines_and_releases() {
    assert_eq!(dpram(&PMAC, 20, 20, Access::Bits16), documented("ASCII line of n"));
    assert_eq!(mailboxes(20, 20), documented("mailbox line"));
    let mut rig = Rig::new();
    let variables = VariableReader::new(&PMAC.variable_read, PMAC.start, PLACE);
    let writer = VariableWriter::new(&PMAC, PLACE);
    let costs = [
        rig.cost(|bus| ServoReader::release(&PMAC.servo, bus).unwrap()).1,
        rig.cost(|bus| BackgroundReader::release(&PMAC.background, bus).unwrap()).1,
        rig.cost(|bus| variables.release(bus).unwrap()).1,
        rig.cost(|bus| writer.release(bus).unwrap()).1,
        rig.cost(|bus| Panel::new(PMAC.panel.as_ref().unwrap()).acquire(bus).unwrap()).1,
    ];
    assert_eq!(costs, [1, 1, 2, 1, 2]);
    assert_eq!(costs.iter().sum::<usize>(), documented("released at start"));
}
