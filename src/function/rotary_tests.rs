//! The rotary stream against a board whose reading side is played by hand, and by a consumer that strikes at any
//! access.

use proptest::prelude::*;

use super::rotary::*;
use super::testing::memory;
use crate::device::{Bus, BusError, Counted, FileBoard};
use crate::map::FAMILIES;
use crate::map::functions::rotary_header as at;
use crate::map::{Family, HostOffset, PMAC};
use crate::rotary::{END_MARKER, START_OF_LINE};

/// The start of the ring.
fn start(family: &Family) -> HostOffset {
    family.user_area.start.plus_words(0x80)
}

fn setup(family: &Family, size_longs: u32) -> RotarySetup {
    RotarySetup { start: start(family), size_longs, coordinate_system: 3, coordinate_system_base: 1 }
}

/// The family's first buffer, set up.
fn set_up(
    family: &'static Family,
    bus: &mut impl Bus,
    setup: &RotarySetup,
) -> Result<RotaryStream, RotaryError> {
    let mut stream = RotaryStream::of_family(family).remove(0);
    stream.set_up(bus, setup).map(|()| stream)
}

fn board(family: &Family) -> Counted<FileBoard> {
    Counted::new(memory(family))
}

fn command(family: &Family, bus: &mut impl Bus, index: u32) -> (u32, u32) {
    let mut words = [0; 4];
    bus.read_block(start(family).plus_words(2 * index as usize), &mut words).unwrap();
    let long = |at: usize| u32::from(words[at + 1]) << 16 | u32::from(words[at]);
    (long(0), long(2))
}

/// Where a word of the first buffer's header lies.
fn place(family: &Family, at: usize) -> HostOffset {
    family.rotary.headers[0].plus_words(at)
}

fn header(family: &Family, bus: &mut impl Bus) -> [u16; 6] {
    let mut words = [0; 6];
    bus.read_block(place(family, 0), &mut words).unwrap();
    words
}

/// A line of `commands` commands that no other line equals.
fn line(commands: usize, seed: u32) -> Vec<(u32, u32)> {
    (0..commands as u32)
        .map(|n| {
            let start = if n == 0 { START_OF_LINE } else { 0 };
            (start | 0xA0_0040 | n, 0x80_0000 | seed)
        })
        .collect()
}

#[test]
fn the_header_says_where_the_ring_lies() {
    for family in FAMILIES {
        for (index, &header) in family.rotary.headers.iter().enumerate() {
            let mut bus = board(family);
            bus.write16(header, 0x8005).unwrap();
            bus.write16(header.plus_words(at::PMAC_INDEX), 77).unwrap();
            let before = bus.accesses();
            let mut stream = RotaryStream::of_family(family).remove(index);
            stream.set_up(&mut bus, &setup(family, 100)).unwrap();
            // If no I-variable keeps PMAC out, the host first takes the header out of use.
            let more = u64::from(family.i.rotary_enable.is_none());
            assert_eq!(bus.accesses() - before, 11 + more);
            let mut words = [0; 6];
            bus.read_block(header, &mut words).unwrap();
            assert_eq!(words, [0, 3, 0, 0, 100, family.start.start_word(start(family))]);
            assert_eq!(command(family, &mut bus, 0), END_MARKER);

            let mut bus = board(family);
            let from_0 =
                RotarySetup { coordinate_system_base: 0, start: family.user_area.start, ..setup(family, 6) };
            stream.set_up(&mut bus, &from_0).unwrap();
            assert_eq!(bus.accesses(), 10 + more);
            bus.read_block(header, &mut words).unwrap();
            assert_eq!(words, [0, 2, 0, 0, 6, family.start.start_word(family.user_area.start)]);
        }
    }
}

#[test]
fn pmacs_headers_are_those_of_the_manual() {
    let mut bus = memory(&PMAC);
    for (mut stream, header) in RotaryStream::of_family(&PMAC).into_iter().zip([0x07F0, 0x07DC]) {
        stream.set_up(&mut bus, &setup(&PMAC, 100)).unwrap();
        let mut words = [0; 6];
        bus.read_block(HostOffset::new(header), &mut words).unwrap();
        assert_eq!(words, [0, 3, 0, 0, 100, 0xD240]);
    }
}

#[test]
fn a_buffer_is_used_only_between_its_set_up_and_the_boards_reset() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = RotaryStream::of_family(family).remove(0);
        let mut is_refused = |stream: &mut RotaryStream| {
            let before = bus.accesses();
            assert!(matches!(stream.offer(&mut bus, &line(1, 1)), Err(RotaryError::NotSetUp)));
            assert!(matches!(stream.state(&mut bus), Err(RotaryError::NotSetUp)));
            assert_eq!(bus.accesses(), before);
        };
        is_refused(&mut stream);
        stream.set_up(&mut memory(family), &setup(family, 20)).unwrap();
        assert!(stream.is_set_up());
        stream.reset();
        is_refused(&mut stream);
    }
}

#[test]
fn an_impossible_set_up_writes_nothing() {
    for family in FAMILIES {
        let refused = |setup: RotarySetup| {
            let mut bus = board(family);
            let error = set_up(family, &mut bus, &setup).unwrap_err();
            assert_eq!(bus.accesses(), 0);
            error
        };
        let area = family.user_area;
        let most = area.words() as u32 / 2;
        for size in [0, 4, 7, 101, most + 2] {
            assert!(matches!(refused(setup(family, size)), RotaryError::Size { .. }), "{size}");
        }
        let (first, end) = (area.start.bytes(), area.end.bytes());
        for (start, size) in [(first - 4, 6), (first + 2, 6), (first + 4, most), (end - 4, 6)] {
            let error = refused(RotarySetup { start: HostOffset::new(start), ..setup(family, size) });
            assert!(matches!(error, RotaryError::Place { .. }), "{start:x}");
        }
        for (coordinate_system, coordinate_system_base) in
            [(0, 1), (family.coordinate_systems as u8 + 1, 1), (1, 2)]
        {
            let error =
                refused(RotarySetup { coordinate_system, coordinate_system_base, ..setup(family, 6) });
            assert!(matches!(error, RotaryError::CoordinateSystem { .. }));
        }
        let last = RotarySetup { start: HostOffset::new(area.end.bytes() - 6 * 4), ..setup(family, 6) };
        assert!(set_up(family, &mut board(family), &last).is_ok());
    }
}

#[test]
fn a_line_costs_what_it_says_and_stands_before_the_index_moves() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = set_up(family, &mut bus, &setup(family, 20)).unwrap();
        let words = line(3, 1);
        let (reads, writes) = (bus.reads(), bus.writes());
        assert!(stream.offer(&mut bus, &words).unwrap());
        assert_eq!((bus.reads() - reads, bus.writes() - writes), (2, 3 * 4 + 5));
        assert_eq!(header(family, &mut bus)[at::HOST_INDEX], 6);
        assert_eq!([0, 2, 4].map(|index| command(family, &mut bus, index)).as_slice(), words);
        assert_eq!(command(family, &mut bus, 6), END_MARKER);
        let reads = bus.reads();
        let state = stream.state(&mut bus).unwrap();
        assert_eq!(bus.reads() - reads, 3);
        assert_eq!((state.ahead_longs, state.ahead_commands, state.ahead_lines), (6, 3, 1));
        let insides = [0, 2, 4, 6].map(|index| {
            bus.write16(place(family, at::PMAC_INDEX), index).unwrap();
            stream.state(&mut bus).unwrap().is_inside_line
        });
        assert_eq!(insides, [false, true, true, false]);
    }
}

#[test]
fn the_smallest_buffer_takes_one_command_and_goes_round() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = set_up(family, &mut bus, &setup(family, 6)).unwrap();
        for turn in 0..9_u16 {
            assert!(stream.offer(&mut bus, &line(1, turn.into())).unwrap());
            let (reads, writes) = (bus.reads(), bus.writes());
            // Full by the manual's rule.
            let words = header(family, &mut bus);
            assert_eq!(words[at::PMAC_INDEX], (words[at::HOST_INDEX] + 4) % 6);
            assert!(!stream.offer(&mut bus, &line(1, 99)).unwrap());
            // Until PMAC's own buffer has been full, the host also looks at the status word.
            assert_eq!((bus.reads() - reads, bus.writes() - writes), (6 + 3, 0), "nothing was written");
            assert_eq!(words[at::HOST_INDEX], 2 * (turn + 1) % 6);
            bus.write16(place(family, at::PMAC_INDEX), words[at::HOST_INDEX]).unwrap();
        }
        let error = stream.offer(&mut bus, &line(2, 1)).unwrap_err();
        assert!(matches!(error, RotaryError::TooLong { commands: 2, size: 6, most: 1 }));
    }
}

#[test]
fn words_that_are_no_line_are_refused_without_an_access() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = set_up(family, &mut bus, &setup(family, 20)).unwrap();
        let before = bus.accesses();
        assert!(matches!(stream.offer(&mut bus, &[]), Err(RotaryError::Empty)));
        let bad: [(&[(u32, u32)], usize); 4] = [
            (&[(0x40, 1)], 1),
            (&[(0x840, 1), (0x840, 1)], 2),
            (&[(0x100_0840, 1)], 1),
            (&[(0x840, 0x100_0000)], 1),
        ];
        for (words, which) in bad {
            let error = stream.offer(&mut bus, words).unwrap_err();
            assert!(matches!(error, RotaryError::NotALine { number, .. } if number == which), "{error}");
        }
        assert_eq!(bus.accesses(), before);
    }
}

#[test]
fn status_and_underruns() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = set_up(family, &mut bus, &setup(family, 20)).unwrap();
        assert_eq!(stream.state(&mut bus).unwrap().underruns, 0, "nothing sent yet");
        let pmac = place(family, at::PMAC_INDEX);
        stream.offer(&mut bus, &line(2, 1)).unwrap();
        stream.offer(&mut bus, &line(1, 2)).unwrap();
        bus.write16(pmac, 2).unwrap();
        bus.write16(place(family, at::STATUS), at::BUSY).unwrap();
        let state = stream.state(&mut bus).unwrap();
        assert_eq!((state.ahead_commands, state.ahead_lines, state.sent_lines), (2, 2, 2));
        assert_eq!((state.busy, state.error, state.underruns), (true, None, 0));
        bus.write16(pmac, 6).unwrap();
        bus.write16(place(family, at::STATUS), at::ERROR | 7).unwrap();
        for _ in 0..2 {
            let state = stream.state(&mut bus).unwrap();
            assert_eq!((state.busy, state.error, state.underruns), (false, Some(7), 1), "counted once");
            assert_eq!(state.ahead_lines, 0);
        }
        // The next line itself finds the empty ring, too.
        stream.offer(&mut bus, &line(1, 3)).unwrap();
        bus.write16(pmac, 8).unwrap();
        stream.offer(&mut bus, &line(1, 4)).unwrap();
        stream.finish();
        bus.write16(pmac, 10).unwrap();
        assert_eq!(stream.state(&mut bus).unwrap().underruns, 2);
    }
}

#[test]
fn a_header_that_somebody_else_wrote_is_not_followed() {
    for family in FAMILIES {
        for (word, value) in [
            (at::HOST_INDEX, 4),
            (at::HOST_INDEX, 0),
            (at::PMAC_INDEX, 20),
            (at::PMAC_INDEX, 0xFFFF),
            (at::PMAC_INDEX, 3),
            // Ahead of the host, and back to where it has been.
            (at::PMAC_INDEX, 8),
            (at::PMAC_INDEX, 0),
        ] {
            let mut bus = board(family);
            let mut stream = set_up(family, &mut bus, &setup(family, 20)).unwrap();
            stream.offer(&mut bus, &line(3, 1)).unwrap();
            bus.write16(place(family, at::PMAC_INDEX), 2).unwrap();
            stream.state(&mut bus).unwrap();
            bus.write16(place(family, word), value).unwrap();
            let writes = bus.writes();
            let error = stream.offer(&mut bus, &line(1, 2)).unwrap_err();
            assert!(matches!(error, RotaryError::Header { .. }), "{word} {value}");
            assert!(stream.state(&mut bus).is_err());
            assert_eq!(bus.writes(), writes);
        }
    }
}

/// A board whose PMAC looks at the ring after every access of the host, and takes some commands when it likes to.
struct Consumer {
    family: &'static Family,
    words: Vec<u16>,
    size: u32,
    /// Every word that will be sent, and after how many commands a line ends.
    sent: Vec<(u32, u32)>,
    ends: Vec<usize>,
    taken: usize,
    /// How many commands to take at each access, round and round.
    appetite: Vec<u8>,
    accesses: usize,
}

impl Consumer {
    fn word(&self, offset: HostOffset) -> u16 {
        self.words[offset.word()]
    }

    fn command(&self, index: u32) -> (u32, u32) {
        let at = start(self.family).plus_words(2 * index as usize);
        let long = |word| {
            u32::from(self.word(at.plus_words(word + 1))) << 16 | u32::from(self.word(at.plus_words(word)))
        };
        (long(0), long(2))
    }

    fn look(&mut self) {
        let [host, pmac] =
            [at::HOST_INDEX, at::PMAC_INDEX].map(|at| u32::from(self.word(place(self.family, at))));
        if self.word(place(self.family, at::SIZE)) == 0 {
            return;
        }
        let visible = ((host + self.size - pmac) % self.size / 2) as usize;
        for n in 0..visible {
            let found = self.command((pmac + 2 * n as u32) % self.size);
            assert_eq!(found, self.sent[self.taken + n], "command {}", self.taken + n);
        }
        let end = self.taken + visible;
        assert!(end == 0 || self.ends.contains(&end), "the host's index splits a line");
        // The words behind the last line begin a line: PMAC finds the line's end by them.
        assert_ne!(self.command(host).0 & START_OF_LINE, 0);
        let appetite = self.appetite[self.accesses % self.appetite.len()] as usize;
        self.accesses += 1;
        let eaten = appetite.min(visible);
        self.taken += eaten;
        let pmac = (pmac + 2 * eaten as u32) % self.size;
        self.words[place(self.family, at::PMAC_INDEX).word()] = pmac as u16;
    }
}

impl Bus for Consumer {
    fn length(&self) -> usize {
        2 * self.words.len()
    }
    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let word = self.word(offset);
        self.look();
        Ok(word)
    }
    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.words[offset.word()] = value;
        self.look();
        Ok(())
    }
    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        for (n, word) in words.iter_mut().enumerate() {
            *word = self.read16(first.plus_words(n))?;
        }
        Ok(())
    }
    fn order_reads(&mut self) {}
    fn order_writes(&mut self) {}
}

proptest! {
    #[test]
    fn every_line_arrives_whole_and_in_order(
        half_size in 3_u32..24,
        lengths in prop::collection::vec(1_usize..24, 1..40),
        mut appetite in prop::collection::vec(0_u8..4, 1..50),
    ) {
        for family in FAMILIES {
        // A consumer that never eats never finishes.
        appetite.push(1);
        let size = 2 * half_size;
        let most = half_size as usize - 2;
        let lines: Vec<_> =
            lengths.iter().zip(0..).map(|(length, seed)| line((*length - 1) % most + 1, seed)).collect();
        let sent = lines.concat();
        let ends = lines.iter().scan(0, |end, line| { *end += line.len(); Some(*end) }).collect();
        let mut bus =
            Consumer { family, words: vec![0; family.length as usize / 2], size, sent, ends, taken: 0, appetite: appetite.clone(), accesses: 0 };
        let mut stream = set_up(family, &mut bus, &setup(family, size)).unwrap();
        for words in &lines {
            let mut tries = 0;
            while !stream.offer(&mut bus, words).unwrap() {
                tries += 1;
                prop_assert!(tries < 10_000);
            }
            let host = u32::from(bus.word(place(family, at::HOST_INDEX)));
            prop_assert_eq!(bus.command(host), END_MARKER);
        }
        stream.finish();
        let mut tries = 0;
        while stream.state(&mut bus).unwrap().ahead_longs > 0 {
            tries += 1;
            prop_assert!(tries < 10_000);
        }
        prop_assert_eq!(bus.taken, bus.sent.len());
        prop_assert_eq!(stream.state(&mut bus).unwrap().sent_lines, lines.len() as u64);
        }
    }
}

#[test]
fn what_pmac_takes_to_fill_its_own_buffer_is_no_underrun() {
    for family in FAMILIES {
        let mut bus = board(family);
        let mut stream = set_up(family, &mut bus, &setup(family, 6)).unwrap();
        for word in 0..3 {
            assert!(stream.offer(&mut bus, &line(1, word)).unwrap());
            take_all(family, &mut bus);
        }
        assert_eq!(stream.state(&mut bus).unwrap().underruns, 3, "it may be that the motors wait");
        assert!(stream.offer(&mut bus, &line(1, 3)).unwrap());
        bus.write16(place(family, at::STATUS), at::BUSY).unwrap();
        assert!(!stream.offer(&mut bus, &line(1, 4)).unwrap());
        assert_eq!(stream.state(&mut bus).unwrap().underruns, 0, "they did not");
        take_all(family, &mut bus);
        assert_eq!(stream.state(&mut bus).unwrap().underruns, 1, "now they may");
    }
}

/// PMAC takes every command.
fn take_all(family: &Family, bus: &mut impl Bus) {
    let host = bus.read16(place(family, at::HOST_INDEX)).unwrap();
    bus.write16(place(family, at::PMAC_INDEX), host).unwrap();
}
