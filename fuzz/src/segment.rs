//! A segment as a hostile or broken daemon leaves it: a client attaches, and reads in every way there is while the file is
//! written to. No sample is longer than its region, no cursor goes backwards or miscounts, nothing waits.

use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::time::Duration;

use pmac_dpram::client::{Board, GatherChunk, VariableTable};
use pmac_dpram::map::user_word::USER_WORDS;
use pmac_dpram::segment::payload::user;
use pmac_dpram::segment::{
    BlockPlace, CreateOptions, Identity, Publisher, RegionId, RegionSpec, Sample, SegmentName, Stamp, State,
    Subscriber, layout, monotonic_ns,
};

use super::tape::Tape;

/// Offsets of the words a header's checksum is over, and of it: `src/segment/layout.rs`.
const SUMMED: [usize; 7] = [0x008, 0x018, 0x028, 0x0C0, 0x0C8, 0x0D0, 0x0D8];
const SUM: usize = 0x020;
/// Regions, slots and payloads of the sound segment: small, so that changes meet something.
const REGIONS: [(RegionId, u32, u32); 5] = [
    (RegionId::Servo, 4, 516),
    (RegionId::Background, 2, 1028),
    (RegionId::Board, 2, 528),
    (RegionId::Variable, 2, 200),
    (RegionId::Gather, 4, 160),
];

struct Place {
    directory: tempfile::TempDir,
    file: File,
    sound: Vec<u64>,
    /// The file's length in bytes.
    length: u64,
}

thread_local! {
    static PLACE: RefCell<Option<Place>> = const { RefCell::new(None) };
}

/// First byte: whether the checksum is made right, and whether the rest is the file itself. Else changes of words, a byte 0xFF
/// ends those made before the client attaches.
pub fn body(data: &[u8]) {
    PLACE.with_borrow_mut(|place| {
        let place = place.get_or_insert_with(sound);
        let mut tape = Tape::new(data);
        let way = tape.u8();
        if way & 0xC0 == 0xC0 {
            place.put_bytes(tape.rest());
        } else {
            let mut words = place.sound.clone();
            while let Some((at, value)) = change(&mut tape) {
                let at = at % words.len();
                words[at] = value(words[at]);
            }
            if way & 1 == 0 {
                seal(&mut words);
            }
            let length = if way & 0x30 == 0x30 { u64::from(tape.u16()) } else { words.len() as u64 * 8 };
            place.put(&words, length);
        }
        read(place, way, &mut tape);
    });
}

fn name() -> SegmentName {
    SegmentName::new("pmac0").unwrap()
}

fn sound() -> Place {
    let directory = tempfile::tempdir_in("/dev/shm").unwrap();
    let regions = REGIONS.map(|(id, slots, payload_bytes)| RegionSpec {
        id,
        slots,
        payload_bytes,
        first_host_offset: 0x24,
        blocks: match id {
            RegionId::Servo => BlockPlace { start: 36, stride: 60, count: 8 },
            RegionId::Background => BlockPlace { start: 36, stride: 124, count: 8 },
            _ => BlockPlace::NONE,
        },
        period_hint_ns: 442_673,
        stale_after_ns: 100_000_000,
    });
    let mut options = CreateOptions::new(name(), regions.to_vec());
    options.directory = directory.path().to_owned();
    let mut publisher = Publisher::create(&options).unwrap();
    publisher.set_state(State::Live);
    let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 7, valid: true };
    for number in 1..=5 {
        publisher.publish(RegionId::Servo, stamp, &[number; 258]);
        publisher.publish(RegionId::Background, stamp, &[number; 514]);
        publisher.publish(RegionId::Variable, stamp, &[1, 0, 1, 0, 0x700, 0, number, 0, 1, 2, 3, 4]);
        let gathered = [1, 0, 0, 0, 1, 0, 2, 0, number, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4];
        publisher.publish(RegionId::Gather, stamp, &gathered);
    }
    let identity = Identity { family: Some(1), motor_mask: Some(0xFF), ..Identity::default() };
    publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
    let bytes = std::fs::read(publisher.path()).unwrap();
    drop(publisher);
    let mut sound: Vec<u64> = bytes.as_chunks().0.iter().map(|word| u64::from_ne_bytes(*word)).collect();
    let hash = sound[SUM / 8];
    seal(&mut sound);
    assert_eq!(sound[SUM / 8], hash, "the checksum is computed as the layout says");
    let path = directory.path().join("pmac0");
    std::fs::write(&path, []).unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o644)).unwrap();
    let file = File::options().write(true).open(path).unwrap();
    Place { directory, file, sound, length: 0 }
}

impl Place {
    fn put(&mut self, words: &[u64], length: u64) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
        self.put_bytes(&bytes[..bytes.len().min(length as usize)]);
        self.set_length(length);
    }

    fn put_bytes(&mut self, bytes: &[u8]) {
        self.length = self.length.max(bytes.len() as u64);
        self.file.write_all_at(bytes, 0).unwrap();
        self.set_length(bytes.len() as u64);
    }

    /// Most inputs leave it as it is, which saves a lot of time.
    fn set_length(&mut self, length: u64) {
        if self.length != length {
            // What is behind a shorter file is zero when it grows again.
            self.file.set_len(length).unwrap();
            self.length = length;
        }
    }
}

/// The index of a word and what becomes of it. Headers and heads are where most is to be found.
fn change(tape: &mut Tape<'_>) -> Option<(usize, impl Fn(u64) -> u64 + use<>)> {
    if tape.is_over() {
        return None;
    }
    let how = tape.u8();
    if how == 0xFF {
        return None;
    }
    let at = match how & 3 {
        0 => usize::from(tape.u8()) % (0x300 / 8),
        1 => 0x300 / 8 + usize::from(tape.u8()) % (REGIONS.len() * 0x80 / 8),
        2 => 0x580 / 8 + usize::from(tape.u16()),
        _ => usize::from(tape.u16()),
    };
    let value = match how >> 2 & 7 {
        0 => u64::from(tape.u8()),
        1 => u64::from(tape.u16()),
        2 => tape.u64(),
        3 => u64::MAX - u64::from(tape.u8()),
        4 => 1 << (tape.u8() & 63),
        5 => u64::from(tape.u8()) << 32 | 1,
        _ => u64::from(tape.u8()),
    };
    Some((at, move |old: u64| match how >> 2 & 7 {
        6 => old.wrapping_add(value),
        7 => old.wrapping_sub(value),
        _ => value,
    }))
}

/// Makes the checksum right again, so that what lies behind it is looked at.
fn seal(words: &mut [u64]) {
    let at = |offset: u64| words.get((offset / 8) as usize).copied().unwrap_or(0);
    let fixed = SUMMED.map(|offset| at(offset as u64));
    let (table, count, stride) = (at(0x0C0), at(0x0C8).min(64), at(0x0D0));
    let entries = (0..count).flat_map(|index| (0..8).map(move |word| (index, word)));
    let entries = entries
        .map(|(index, word)| at(table.wrapping_add(index.wrapping_mul(stride)).wrapping_add(word * 8)));
    words[SUM / 8] = layout::layout_hash(fixed.into_iter().chain(entries));
}

fn read(place: &mut Place, way: u8, tape: &mut Tape<'_>) {
    let reader = match Subscriber::attach_in(place.directory.path(), &name()) {
        Ok(reader) => reader,
        Err(error) => {
            assert!(!error.to_string().contains('\n'), "{error}");
            return;
        }
    };
    let attach = || Board::attach_in(place.directory.path(), "pmac0").expect("attached to a moment ago");
    let mut board = (way & 14 == 0).then(attach);
    // From here on the file keeps its length, as the owner's does; the words change under the reader.
    let length = reader.header().total_length;
    let _ = (reader.condition(), reader.counters().count());
    let mut sample = Sample::new();
    let regions: Vec<RegionId> = reader.regions().map(|region| region.id).collect();
    loop {
        for &region in &regions {
            read_region(&reader, region, &mut sample, tape.u64() >> (tape.u8() & 63));
        }
        if let Some(board) = &mut board {
            as_programs_do(board, u64::from(tape.u8()));
        }
        let Some((at, value)) = change(tape) else { break };
        let old = place.sound[at % place.sound.len()];
        if (at + 1) * 8 <= length {
            place.file.write_all_at(&value(old).to_ne_bytes(), at as u64 * 8).unwrap();
        }
    }
}

fn as_programs_do(board: &mut Board, since: u64) {
    let _ = board.snapshot().map(|snapshot| snapshot.servo.map(|view| view.is_fresh()));
    let _ = (board.history(since, 8), board.variables());
    if let Ok(mut follower) = board.follow_gather() {
        let _ = (follower.next(board), follower.next(board));
    }
}

fn read_region(reader: &Subscriber, region: RegionId, sample: &mut Sample, sequence: u64) {
    let info = reader.region(region).expect("the segment said that it has it");
    let within = |sample: &Sample| {
        assert!(sample.bytes().len() <= info.payload_bytes && sample.words().len() * 2 <= info.payload_bytes);
    };
    match reader.latest(region, sample) {
        Ok(Some(number)) => {
            assert_eq!(sample.sequence(), number);
            let _ = reader.is_fresh(region, &sample.stamp(), monotonic_ns());
            decode(region, sample);
        }
        _ => assert!(sample.words().is_empty() && sample.sequence() == 0),
    }
    within(sample);
    for wanted in [sequence, 0, 5, u64::MAX] {
        let _ = reader.read(region, wanted, sample);
        assert!(sample.sequence() == 0 || sample.sequence() == wanted);
        within(sample);
    }
    // Looks at the file itself, which takes long.
    if sequence & 15 == 1 {
        let _ = reader.wait_newer(region, sequence, Duration::ZERO);
    }
    let Ok(mut cursor) = reader.cursor(region, sequence) else { return };
    for taken in 0..8 {
        let before = (cursor.position(), cursor.lost());
        let found = reader.next(&mut cursor, sample);
        within(sample);
        assert!(cursor.position() >= before.0);
        if matches!(found, Ok(true)) {
            let lost = cursor.lost().wrapping_sub(before.1);
            assert_eq!(sample.sequence(), before.0.wrapping_add(lost), "sample {taken}");
        }
    }
}

fn decode(region: RegionId, sample: &Sample) {
    let words = sample.words();
    match region {
        RegionId::Board => drop(Identity::decode(sample.bytes())),
        RegionId::Gather => {
            if let Some(chunk) = GatherChunk::decode(words) {
                assert!(
                    chunk.longs.len() * 2 <= words.len()
                        && chunk.longs.len().is_multiple_of(chunk.sample_longs)
                );
            }
        }
        RegionId::UserTable => {
            if let Some(table) = user::decode_table(sample.bytes()) {
                assert!(table.len() <= USER_WORDS);
                let _ = user::split(&table, words);
            }
        }
        RegionId::Variable => {
            if let Some(table) = VariableTable::decode(words) {
                assert!(table.variables.len() * 8 <= words.len());
                assert!(table.variables.iter().all(|variable| (1..=2).contains(&variable.value().len())));
            }
        }
        _ => {}
    }
}
