//! The gather reader against buffers written by hand, and against a board that writes at any access of the host.

use proptest::prelude::*;

use super::gather::*;
use super::servo_timer::ServoTimer;
use crate::device::{Bus, BusError, Counted, FileBoard};
use crate::gather::GatherMode;
use crate::map::TURBO2;
use crate::map::pmac::SERVO_PMAC_STATUS;
use crate::map::{HostOffset, Layout, PMAC};

/// A board that gathers: each long holds its sample's number and its own place in it.
struct Board {
    words: Vec<u16>,
    buffer: GatherBuffer,
    cycle: u64,
    gathering: bool,
    /// Complete samples.
    stored: u64,
    /// Cycles that pass at each access of the host, round and round.
    pace: Vec<u32>,
    accesses: usize,
    /// The board is always in the middle of its next sample, and moves its index long by long.
    halfway: bool,
}

fn buffer(size_longs: u32, sample_longs: u32, mode: GatherMode) -> GatherBuffer {
    let place = Layout::new(&PMAC, Some("1.16D".parse().unwrap())).gather();
    GatherBuffer { place, room_longs: 3520, size_longs, sample_longs, longest_sample: 48, mode, period: 1 }
}

impl Board {
    fn new(buffer: GatherBuffer) -> Self {
        let mut board = Self {
            words: vec![0xDEAD; buffer.place.buffer.word() + 2 * buffer.room_longs as usize],
            buffer,
            cycle: 1000,
            gathering: true,
            stored: 0,
            pace: vec![0],
            accesses: 0,
            halfway: false,
        };
        board.note(0);
        board
    }

    fn note(&mut self, index: u32) {
        self.words[self.buffer.place.size.word()] = self.buffer.size_longs as u16;
        self.words[self.buffer.place.index.word()] = index as u16;
    }

    fn capacity(&self) -> u64 {
        self.buffer.size_longs.div_ceil(self.buffer.sample_longs).into()
    }

    /// Writes the first `longs` longs of the next sample.
    fn write(&mut self, longs: u32) {
        let slot = self.stored % self.capacity();
        for long in 0..longs {
            let value = expected(self.stored, long);
            let at = slot as u32 * self.buffer.sample_longs + long;
            let word = self.buffer.place.buffer.word() + 2 * at as usize;
            (self.words[word], self.words[word + 1]) = (value as u16, (value >> 16) as u16);
        }
    }

    fn pass(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.cycle += 1;
            if self.gathering && self.cycle.is_multiple_of(self.buffer.period.into()) {
                self.store();
            }
        }
        let slot = (self.stored % self.capacity()) as u32;
        if self.gathering && self.halfway {
            let half = self.buffer.sample_longs / 2;
            self.write(half);
            self.note(slot * self.buffer.sample_longs + half);
        }
    }

    fn store(&mut self) {
        self.write(self.buffer.sample_longs);
        self.stored += 1;
        let full = self.stored == self.capacity() && self.buffer.mode == GatherMode::Stop;
        if full {
            self.gathering = false;
        }
        let slot = if full { self.stored } else { self.stored % self.capacity() };
        self.note(slot as u32 * self.buffer.sample_longs);
    }

    fn accessed(&mut self) {
        let cycles = self.pace[self.accesses % self.pace.len()];
        self.accesses += 1;
        self.pass(cycles);
    }
}

fn expected(sample: u64, long: u32) -> u32 {
    (sample as u32) << 7 | long
}

impl Bus for Board {
    fn length(&self) -> usize {
        2 * self.words.len()
    }
    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let word = self.words[offset.word()];
        self.accessed();
        Ok(word)
    }
    fn write16(&mut self, offset: HostOffset, _: u16) -> Result<(), BusError> {
        panic!("the host writes to {offset}");
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

fn cycles(board: &mut Board) -> Result<u64, BusError> {
    let cycle = board.cycle;
    board.accessed();
    Ok(cycle)
}

/// Steps until no sample is left; checks every sample and returns the numbers taken.
fn drain(reader: &mut GatherReader, board: &mut Board) -> Vec<u64> {
    let mut numbers = Vec::new();
    while let GatherPoll::Samples { first, count } = poll(reader, board) {
        numbers.extend(first..first + count as u64);
    }
    numbers
}

fn poll(reader: &mut GatherReader, board: &mut Board) -> GatherPoll {
    let look = reader.poll(board, cycles).unwrap();
    let samples = reader.longs().chunks(reader.sample_longs());
    if let GatherPoll::Samples { first, count } = look {
        assert_eq!(samples.len(), count);
        assert!(reader.longs().len() <= chunk_longs(board.buffer.longest_sample));
        for (number, sample) in (first..).zip(samples) {
            for (long, value) in (0..).zip(sample) {
                assert_eq!(*value, expected(number, long), "sample {number} long {long}");
            }
        }
    } else {
        assert_eq!(samples.len(), 0);
    }
    look
}

fn pair(buffer: GatherBuffer) -> (GatherReader, Board) {
    (GatherReader::new(buffer, GatherStart::Defined).unwrap(), Board::new(buffer))
}

#[test]
fn samples_come_in_order_across_the_end() {
    let (mut reader, mut board) = pair(buffer(90, 3, GatherMode::Wrap));
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Idle);
    let mut numbers = Vec::new();
    for _ in 0..20 {
        board.pass(17);
        numbers.extend(drain(&mut reader, &mut board));
    }
    assert_eq!(numbers, (0..340).collect::<Vec<_>>());
    assert_eq!((reader.written(), reader.lost(), reader.waiting()), (340, 0, 0));
}

#[test]
fn every_lap_is_counted_and_its_samples_are_lost() {
    for period in [1, 5] {
        let (mut reader, mut board) = pair(GatherBuffer { period, ..buffer(40, 2, GatherMode::Wrap) });
        poll(&mut reader, &mut board);
        board.pass(7 * period);
        assert_eq!(drain(&mut reader, &mut board).len(), 7);
        // Twenty samples fill the buffer; three laps later the index stands where it stood.
        board.pass(60 * period);
        let numbers = drain(&mut reader, &mut board);
        // The oldest sample is where the board stores next.
        assert_eq!(numbers, (48..67).collect::<Vec<_>>(), "{period}");
        assert_eq!((reader.written(), reader.lost()), (67, 41));
    }
}

#[test]
fn a_stopped_gather_is_read_to_its_end() {
    let (mut reader, mut board) = pair(buffer(40, 2, GatherMode::Wrap));
    poll(&mut reader, &mut board);
    board.pass(20);
    board.gathering = false;
    reader.stopped();
    // The board no longer stores over the oldest sample.
    assert_eq!(drain(&mut reader, &mut board).len(), 20);
    // Time goes on, and no longer counts.
    board.pass(1000);
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Ended);
    assert_eq!((reader.written(), reader.lost()), (20, 0));
}

#[test]
fn the_end_of_the_buffer_ends_a_gather_that_does_not_go_round() {
    // 10 longs of 3 are 12 really.
    let (mut reader, mut board) = pair(buffer(10, 3, GatherMode::Stop));
    poll(&mut reader, &mut board);
    board.pass(3);
    assert_eq!(drain(&mut reader, &mut board), [0, 1, 2]);
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Idle);
    board.pass(100);
    assert_eq!(drain(&mut reader, &mut board), [3]);
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Ended);
    // DEFINE GATHER again.
    board.note(0);
    let redefined = GatherPoll::Redefined { size: 10, index: 0 };
    assert_eq!(poll(&mut reader, &mut board), redefined);
    (board.stored, board.gathering) = (0, true);
    board.pass(4);
    assert_eq!(poll(&mut reader, &mut board), redefined, "until it is told");
    reader.restart(GatherStart::Defined);
    assert_eq!(drain(&mut reader, &mut board), [0, 1, 2, 3]);
}

#[test]
fn another_definition_is_not_followed() {
    for (size, index) in [(0, 0), (38, 0), (44, 0), (0xFFFF, 0xFFFF), (40, 0), (39, 0)] {
        let (mut reader, mut board) = pair(buffer(40, 2, GatherMode::Wrap));
        poll(&mut reader, &mut board);
        board.pass(11);
        drain(&mut reader, &mut board);
        board.words[board.buffer.place.size.word()] = size;
        board.words[board.buffer.place.index.word()] = index;
        let mut found = poll(&mut reader, &mut board);
        if found == GatherPoll::Idle {
            // The size is the same: the clock that goes on says that the index cannot have come so far.
            board.cycle += 1;
            found = poll(&mut reader, &mut board);
        }
        assert_eq!(found, GatherPoll::Redefined { size, index }, "{size}");
    }
}

#[test]
fn a_clock_that_pauses_is_not_the_end() {
    let (mut reader, mut board) = pair(buffer(2000, 2, GatherMode::Wrap));
    poll(&mut reader, &mut board);
    board.pass(20);
    assert_eq!(drain(&mut reader, &mut board).len(), 20);
    // A host holds off the servo report for 250 ms, 565 servo cycles, and gathering goes on.
    let stands = board.cycle;
    for _ in 0..113 {
        board.pass(5);
        let look = reader.poll(&mut board, |_| Ok(stands)).unwrap();
        assert!(matches!(look, GatherPoll::Idle | GatherPoll::Samples { .. }), "{look:?}");
    }
    // The reader may have taken samples from before it noticed the pause; none is lost, and none comes twice.
    let numbers = drain(&mut reader, &mut board);
    assert_eq!(numbers.last(), Some(&584));
    assert_eq!((reader.written(), reader.lost(), reader.waiting()), (585, 0, 0));
}

#[test]
fn an_index_outside_the_buffer_is_reported_and_not_followed() {
    for mode in [GatherMode::Stop, GatherMode::Wrap] {
        let (mut reader, mut board) = pair(buffer(40, 2, mode));
        poll(&mut reader, &mut board);
        board.pass(5);
        board.words[board.buffer.place.index.word()] = 41;
        assert_eq!(poll(&mut reader, &mut board), GatherPoll::OutOfRange { index: 41 });
        board.pass(1);
        assert_eq!(drain(&mut reader, &mut board), [0, 1, 2, 3, 4, 5], "the board's own words stand again");
    }
}

#[test]
fn a_pause_is_harmless_while_somebody_looks_and_known_when_nobody_does() {
    let (mut reader, mut board) = pair(buffer(40, 2, GatherMode::Wrap));
    poll(&mut reader, &mut board);
    for gathering in [true, false, true, false, true] {
        board.gathering = gathering;
        for _ in 0..10 {
            board.pass(9);
            drain(&mut reader, &mut board);
        }
    }
    assert_eq!((reader.written(), reader.lost()), (270, 0));
    board.pass(30);
    board.gathering = false;
    board.pass(1008);
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Interrupted);
    assert_eq!(poll(&mut reader, &mut board), GatherPoll::Interrupted);
}

#[test]
fn a_host_held_up_between_its_accesses_takes_nothing_and_loses_count_of_nothing() {
    let (mut reader, mut board) = pair(buffer(40, 2, GatherMode::Wrap));
    poll(&mut reader, &mut board);
    for at in 0..60 {
        // At each access of a step in turn: ten laps and a bit.
        board.pass(3);
        let mut pace = vec![0; 1000];
        pace[at] = 207;
        (board.pace, board.accesses) = (pace, 0);
        poll(&mut reader, &mut board);
        board.pace = vec![0];
        drain(&mut reader, &mut board);
        assert_eq!(reader.written(), board.stored, "{at}");
    }
}

#[test]
fn a_gather_that_runs_already_is_joined() {
    for mode in [GatherMode::Wrap, GatherMode::Stop] {
        let buffer = buffer(40, 2, mode);
        let mut board = Board::new(buffer);
        board.pass(13);
        let mut reader = GatherReader::new(buffer, GatherStart::Running).unwrap();
        assert_eq!(poll(&mut reader, &mut board), GatherPoll::Idle);
        board.pass(4);
        let mut first = Vec::new();
        while let GatherPoll::Samples { first: number, count } = reader.poll(&mut board, cycles).unwrap() {
            first.extend(reader.longs().iter().step_by(2).map(|long| long >> 7));
            assert_eq!(number + count as u64, 4);
        }
        assert_eq!(first, [13, 14, 15, 16]);
        board.pass(3);
        if mode == GatherMode::Stop {
            let look = reader.poll(&mut board, cycles).unwrap();
            assert_eq!(look, GatherPoll::Samples { first: 4, count: 3 });
            assert_eq!(reader.poll(&mut board, cycles).unwrap(), GatherPoll::Ended);
        }
    }
}

#[test]
fn the_longest_sample_of_a_turbo_pmac_is_read_whole() {
    // Turbo Software Reference p. 170: 48 sources, I5001 to I5048. Each may have two longs.
    let longest_sample = TURBO2.i.longest_gather_sample();
    assert_eq!((longest_sample, PMAC.i.longest_gather_sample()), (96, 48));
    let (mut reader, mut board) = pair(GatherBuffer {
        place: TURBO2.gather,
        room_longs: (TURBO2.length - TURBO2.gather.buffer.bytes()) / 4,
        longest_sample,
        ..buffer(longest_sample * 16, longest_sample, GatherMode::Wrap)
    });
    poll(&mut reader, &mut board);
    board.pass(20);
    assert_eq!(drain(&mut reader, &mut board), (5..20).collect::<Vec<_>>());
    assert_eq!(reader.lost(), 5);
}

#[test]
fn impossible_buffers_are_refused() {
    let refused = |buffer| GatherReader::new(buffer, GatherStart::Defined).unwrap_err();
    let wrap = |size, sample| buffer(size, sample, GatherMode::Wrap);
    assert_eq!(refused(wrap(40, 0)), GatherError::Sample { longs: 0, most: 48 });
    assert_eq!(refused(wrap(3520, 49)), GatherError::Sample { longs: 49, most: 48 });
    assert_eq!(refused(GatherBuffer { period: 0, ..wrap(40, 2) }), GatherError::Period);
    assert_eq!(refused(wrap(0, 2)), GatherError::Size { longs: 0, room: 3520 });
    assert_eq!(refused(wrap(3520, 3)), GatherError::Size { longs: 3522, room: 3520 });
    assert_eq!(refused(wrap(u32::MAX, 48)), GatherError::Size { longs: u32::MAX, room: 3520 });
    assert_eq!(refused(wrap(30, 2)), GatherError::TooShort { samples: 15 });
    assert!(GatherReader::new(buffer(1, 1, GatherMode::Stop), GatherStart::Defined).is_ok());
}

#[test]
fn a_step_costs_what_it_says() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x4000).unwrap();
    let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
    let buffer = buffer(60, 3, GatherMode::Wrap);
    let mut timer = ServoTimer::new(15);
    bus.write16(buffer.place.size, 60).unwrap();
    let mut reader = GatherReader::new(buffer, GatherStart::Defined).unwrap();
    let mut cost = |bus: &mut Counted<FileBoard>| {
        let before = (bus.reads(), bus.writes());
        let look = reader.poll(bus, |bus| report_cycles(bus, &PMAC.servo, &mut timer)).unwrap();
        (look, bus.reads() - before.0, bus.writes() - before.1)
    };
    assert_eq!(cost(&mut bus), (GatherPoll::Idle, 2 + 2, 0));
    bus.write16(SERVO_PMAC_STATUS, 5).unwrap();
    bus.write16(buffer.place.index, 15).unwrap();
    assert_eq!(cost(&mut bus), (GatherPoll::Samples { first: 0, count: 5 }, 3 + 3 + 2 * 15, 0));
    // Without a clock.
    let mut reader =
        GatherReader::new(GatherBuffer { mode: GatherMode::Stop, ..buffer }, GatherStart::Defined).unwrap();
    let before = bus.reads();
    let look = reader.poll(&mut bus, |_| panic!("no clock is needed")).unwrap();
    assert_eq!((look, bus.reads() - before), (GatherPoll::Samples { first: 0, count: 5 }, 3 + 2 * 15));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever the board does between the host's accesses, no sample is torn or misnumbered, and the taken and lost
    /// samples add up to the stored ones.
    #[test]
    fn taken_and_lost_are_all_there_were(
        sample_longs in 1_u32..=48,
        samples in 16_u32..70,
        odd in 0_u32..48,
        period in 1_u32..5,
        halfway: bool,
        // Mostly the board stores no sample between two accesses; sometimes a few, seldom many laps.
        pace in prop::collection::vec(prop_oneof![40 => Just(0), 10 => 0_u32..3, 1 => 0_u32..700], 1..400),
        between in prop::collection::vec(prop_oneof![20 => 0_u32..30, 1 => 0_u32..2000], 1..40),
    ) {
        let longs = samples * sample_longs;
        prop_assume!(longs <= 3520);
        let buffer = GatherBuffer {
            // A size that is no multiple of the sample's is rounded up.
            period, ..self::buffer(longs - odd % sample_longs, sample_longs, GatherMode::Wrap)
        };
        let (mut reader, mut board) = pair(buffer);
        poll(&mut reader, &mut board);
        board.halfway = halfway;
        board.pace = pace;
        let mut taken = 0;
        let mut next = 0;
        let mut note = |look| {
            if let GatherPoll::Samples { first, count } = look {
                assert!(first >= next);
                next = first + count as u64;
                taken += count as u64;
            }
            look
        };
        for pause in between {
            board.pass(pause);
            for _ in 0..4 {
                let look = note(poll(&mut reader, &mut board));
                prop_assert!(
                    matches!(look, GatherPoll::Samples { .. } | GatherPoll::Idle | GatherPoll::Disturbed),
                    "{:?}", look
                );
            }
        }
        board.pace = vec![0];
        step_until_known(&mut reader, &mut board, &mut note);
        board.gathering = false;
        reader.stopped();
        let mut tries = 0;
        loop {
            match note(poll(&mut reader, &mut board)) {
                GatherPoll::Ended => break,
                GatherPoll::Samples { .. } | GatherPoll::Idle if tries < 1000 => tries += 1,
                look => prop_assert!(false, "{:?}", look),
            }
        }
        prop_assert_eq!(reader.written(), board.stored);
        prop_assert_eq!(taken + reader.lost(), board.stored);
    }
}

/// Polls until a poll is not disturbed, before gathering ends.
fn step_until_known(
    reader: &mut GatherReader,
    board: &mut Board,
    note: &mut impl FnMut(GatherPoll) -> GatherPoll,
) {
    for _ in 0..3 {
        if note(poll(reader, board)) != GatherPoll::Disturbed {
            return;
        }
    }
    panic!("always disturbed");
}
