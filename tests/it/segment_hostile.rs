//! Segments that are not what they should be: each is refused with a clear word or read without harm; nothing panics, hangs, faults or
//! asks for memory without measure.

use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Duration;

use pmac_dpram::segment::{
    Identity, Publisher, RegionId, Sample, SegmentError, State, Subscriber, layout, monotonic_ns,
};
use proptest::prelude::*;

use super::segment::{name, now, options, publish_numbered, spec};

/// A small sound segment as words, and a directory to put variations of it in.
fn sound() -> (tempfile::TempDir, Vec<u64>) {
    let directory = tempfile::tempdir().unwrap();
    let regions = vec![spec(RegionId::Servo, 8, 516), spec(RegionId::Board, 4, 528)];
    let mut publisher = Publisher::create(&options(directory.path(), regions)).unwrap();
    publisher.set_state(State::Live);
    for _ in 0..20 {
        publish_numbered(&mut publisher);
    }
    publisher.publish_bytes(RegionId::Board, now(), &Identity::default().encode());
    let bytes = std::fs::read(publisher.path()).unwrap();
    drop(publisher);
    let words = bytes.chunks_exact(8).map(|word| u64::from_ne_bytes(word.try_into().unwrap())).collect();
    (directory, words)
}

fn put(directory: &Path, words: &[u64], length: u64) {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
    let path = directory.join("pmac0");
    std::fs::write(&path, bytes).unwrap();
    std::fs::File::options().write(true).open(path).unwrap().set_len(length).unwrap();
}

/// Words to change: offset and value.
type Changes<'a> = &'a [(usize, u64)];

/// Makes the checksum right again, so that what lies behind it is looked at.
fn seal(words: &mut [u64]) {
    let at = |offset: u64| words.get((offset / 8) as usize).copied().unwrap_or(0);
    let fixed = [0x008, 0x018, 0x028, 0x0C0, 0x0C8, 0x0D0, 0x0D8].map(at);
    let (table, count, stride) = (at(0x0C0), at(0x0C8).min(64), at(0x0D0));
    let entries = (0..count).flat_map(|index| (0..8).map(move |word| (index, word)));
    let entries = entries
        .map(|(index, word)| at(table.wrapping_add(index.wrapping_mul(stride)).wrapping_add(word * 8)));
    words[4] = layout::layout_hash(fixed.into_iter().chain(entries));
}

/// Uses a segment in every way there is; returns why it was refused, if it was.
fn use_all(directory: &Path) -> Option<String> {
    let reader = match Subscriber::attach_in(directory, &name()) {
        Ok(reader) => reader,
        Err(error) => return Some(error.to_string()),
    };
    let mut sample = Sample::new();
    let _ = (reader.condition(), reader.header(), reader.counters().count(), reader.regions().count());
    for region in RegionId::ALL {
        let _ = reader.latest(region, &mut sample);
        let _ = Identity::decode(sample.bytes());
        let _ = reader.is_fresh(region, &sample.stamp(), monotonic_ns());
        for sequence in [0, 1, 7, u64::MAX / 2 + 1, u64::MAX] {
            let _ = reader.read(region, sequence, &mut sample);
            let _ = reader.wait_newer(region, sequence, Duration::ZERO);
            if let Ok(mut cursor) = reader.cursor(region, sequence) {
                for _ in 0..20 {
                    let _ = reader.next(&mut cursor, &mut sample);
                }
            }
        }
        assert!(sample.words().len() <= 1 << 19);
    }
    None
}

#[test]
fn a_sound_segment_is_read() {
    let (directory, mut words) = sound();
    let length = words.len() as u64 * 8;
    put(directory.path(), &words, length);
    assert_eq!(use_all(directory.path()), None);
    let hash = words[4];
    seal(&mut words);
    assert_eq!(words[4], hash, "this test computes the checksum as the page says");
}

#[test]
fn each_flaw_is_named() {
    let (directory, sound) = sound();
    let length = sound.len() as u64 * 8;
    let flaws: [(Changes<'_>, u64, &str); 23] = [
        (&[], length - 4096, "header says"),
        (&[], length + 4096, "header says"),
        (&[], 0x2F8, "too short"),
        (&[], 0, "too short"),
        (&[(0x000, 0)], length, "mark of a segment"),
        (&[(0x000, layout::MAGIC.swap_bytes())], length, "other byte order"),
        (&[(0x008, 2)], length, "layout version 2"),
        (&[(0x030, 0x0807_0605_0403_0201)], length, "size or byte order"),
        (&[(0x060, 3)], length, "unknown clock"),
        (&[(0x018, 1 << 40)], length, "no header is"),
        (&[(0x0C8, 65)], length, "region table"),
        (&[(0x0D0, 64)], length, "region table"),
        (&[(0x0C0, u64::MAX - 7)], length, "region table"),
        (&[(0x0E0, u64::MAX)], length, "counters"),
        (&[(0x318, 0)], length, "0 slots"),
        (&[(0x318, 1 << 60)], length, "outside the segment"),
        (&[(0x320, 64)], length, "slots of 64 bytes"),
        (&[(0x328, 1 << 40)], length, "a payload of"),
        (&[(0x308, u64::MAX - 63)], length, "outside the segment"),
        (&[(0x378, 1 << 40)], length, "blocks outside its payload"),
        (&[(0x370, 60), (0x378, 9)], length, "blocks outside its payload"),
        (&[(0x370, 0), (0x378, 1)], length, "blocks outside its payload"),
        (&[(0x380, 1)], length, "two servo regions"),
    ];
    for (changes, length, expected) in flaws {
        let mut words = sound.clone();
        for (offset, value) in changes {
            words[offset / 8] = *value;
        }
        seal(&mut words);
        put(directory.path(), &words, length);
        let refused = use_all(directory.path()).unwrap_or_default();
        assert!(refused.contains(expected), "{changes:x?} {length}: {refused:?}, expected {expected:?}");
        assert!(refused.contains("pmac0") && !refused.contains('\n'), "{refused}");
    }
    let mut unsealed = sound;
    unsealed[0x318 / 8] = 4;
    put(directory.path(), &unsealed, length);
    assert!(use_all(directory.path()).unwrap().contains("checksum"));
}

#[test]
fn what_is_not_a_file_is_refused_at_once() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0");
    std::fs::create_dir(&path).unwrap();
    assert!(use_all(directory.path()).unwrap().contains("not a regular file"));
    std::fs::remove_dir(&path).unwrap();
    nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
    assert!(use_all(directory.path()).unwrap().contains("not a regular file"));
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink("/etc/passwd", &path).unwrap();
    assert!(matches!(
        Subscriber::attach_in(directory.path(), &name()),
        Err(SegmentError::Io { what: "open", .. })
    ));
}

/// A head that counts to the end of all numbers leaves no next one to follow from.
#[test]
fn nothing_follows_the_last_number() {
    let directory = tempfile::tempdir().unwrap();
    let regions = vec![spec(RegionId::Gather, 4, 160)];
    let publisher = Publisher::create(&options(directory.path(), regions)).unwrap();
    let bytes = std::fs::read(publisher.path()).unwrap();
    drop(publisher);
    let mut words: Vec<u64> = bytes.as_chunks().0.iter().map(|word| u64::from_ne_bytes(*word)).collect();
    let head = words[0x308 / 8] as usize;
    words[head / 8] = u64::MAX;
    put(directory.path(), &words, bytes.len() as u64);
    let mut board = pmac_dpram::client::Board::attach_in(directory.path(), "pmac0").unwrap();
    let mut follower = board.follow_gather().unwrap();
    assert!(!matches!(follower.next(&mut board), Ok(Some(_))));
}

/// A sample whose length cannot be is an error, and nothing of it is handed out.
#[test]
fn a_corrupt_slot_is_named() {
    let (directory, words) = sound();
    put(directory.path(), &words, words.len() as u64 * 8);
    let file = std::fs::File::options().write(true).open(directory.path().join("pmac0")).unwrap();
    let reader = Subscriber::attach_in(directory.path(), &name()).unwrap();
    let mut sample = Sample::new();
    assert_eq!(reader.latest(RegionId::Servo, &mut sample).unwrap(), Some(20));
    let slot = words[0x310 / 8] + 3 * words[0x320 / 8];
    file.write_all_at(&(517u64 << 32 | 1).to_ne_bytes(), slot + 0x18).unwrap();
    let error = reader.latest(RegionId::Servo, &mut sample).unwrap_err().to_string();
    assert!(error.contains("sample 20 of the servo region is corrupt"), "{error}");
    assert!(sample.words().is_empty() && sample.sequence() == 0);
}

fn nasty() -> impl Strategy<Value = u64> {
    prop_oneof![
        any::<u64>(),
        0..0x3000u64,
        (0..0x60u64).prop_map(|lines| lines * 64),
        (0..64u32).prop_map(|bit| 1 << bit),
        (0..0x3000u64).prop_map(|below| u64::MAX - below),
        Just(0),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any words of the header changed, with the checksum made right and not.
    #[test]
    fn no_header_does_harm(
        changes in prop::collection::vec((0..0x400usize / 8, nasty()), 1..6),
        sealed in prop::bool::weighted(0.9),
        cut in prop::option::weighted(0.1, 0..20_000u64),
    ) {
        thread_local!(static SOUND: (tempfile::TempDir, Vec<u64>) = sound());
        SOUND.with(|(directory, sound)| {
            let mut words = sound.clone();
            for (index, value) in changes {
                words[index] = value;
            }
            if sealed {
                seal(&mut words);
            }
            put(directory.path(), &words, cut.unwrap_or(words.len() as u64 * 8));
            use_all(directory.path());
        });
    }

    /// A sound header, and anything at all in heads and slots.
    #[test]
    fn no_content_does_harm(changes in prop::collection::vec((0x400usize / 8..10_000, nasty()), 1..40)) {
        thread_local!(static SOUND: (tempfile::TempDir, Vec<u64>) = sound());
        SOUND.with(|(directory, sound)| {
            let mut words = sound.clone();
            for (index, value) in changes {
                let index = 0x400 / 8 + index % (words.len() - 0x400 / 8);
                words[index] = value;
            }
            put(directory.path(), &words, words.len() as u64 * 8);
            prop_assert_eq!(use_all(directory.path()), None);
            Ok(())
        })?;
    }
}
