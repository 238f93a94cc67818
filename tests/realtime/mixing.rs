//! No snapshot is ever mixed: every field of a servo update carries the update's own number, and reading processes
//! check each snapshot they take.
//!
//! The long run: `PMAC_SNAPSHOTS=10000000 cargo test --release --test realtime mixing:: -- --nocapture`.

use std::process::{Command, Stdio};

use pmac_dpram::map::{Family, PMAC, TURBO2};
use pmac_dpram::segment::{RegionId, Sample, SegmentName, Subscriber, WaitOutcome};

use crate::board_words::tagged_longs;
use crate::support::{PATIENCE, Site};

const READERS: usize = 3;
const NAME: &str = "PMAC_MIXING_SEGMENT";
const FAMILY: &str = "PMAC_MIXING_FAMILY";
const COUNT: &str = "PMAC_SNAPSHOTS";

/// Checks that all longs of all motors are the same number.
fn is_whole(family: &Family, words: &[u16]) -> bool {
    let tag = tagged_longs(family, words).next();
    tag.is_some() && tagged_longs(family, words).all(|long| Some(long) == tag)
}

/// The family whose reports the readers check.
fn family() -> &'static Family {
    Family::by_name(&std::env::var(FAMILY).unwrap()).unwrap()
}

fn snapshots() -> u64 {
    std::env::var(COUNT).ok().and_then(|text| text.parse().ok()).unwrap_or(30_000)
}

#[test]
#[ignore = "no test of its own: a process that the next one starts"]
fn reader() {
    let name = std::env::var(NAME).unwrap();
    let subscriber = Subscriber::attach(&SegmentName::new(&name).unwrap()).unwrap();
    let family = family();
    let mut sample = Sample::new();
    let (mut checked, mut mixed, mut updates, mut last) = (0u64, 0u64, 0u64, 0);
    // Some readers sleep until each update, which takes its time; the others read as fast as they can.
    let sleeps = std::process::id().is_multiple_of(3);
    let share = snapshots() / READERS as u64;
    while checked < if sleeps { share.min(30_000) } else { share } {
        if sleeps {
            let outcome = subscriber.wait_newer(RegionId::Servo, last, PATIENCE).unwrap();
            assert_ne!(outcome, WaitOutcome::Dead);
        }
        let Some(sequence) = subscriber.latest(RegionId::Servo, &mut sample).unwrap() else { continue };
        checked += 1;
        updates += u64::from(sequence != last);
        last = sequence;
        mixed += u64::from(!is_whole(family, sample.words()));
    }
    println!("checked={checked} updates={updates} mixed={mixed}");
}

#[test]
fn no_snapshot_is_mixed() {
    no_snapshot_is_mixed_on(&PMAC);
}

#[test]
fn no_snapshot_of_a_turbo_board_is_mixed() {
    no_snapshot_is_mixed_on(&TURBO2);
}

fn no_snapshot_is_mixed_on(family: &'static Family) {
    let config = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(config.path(), format!("family = {:?}\n", family.name)).unwrap();
    let config = config.path().to_str().unwrap();
    let site = Site::running(&["--servo-hz", "4000", "--family", family.name], &["--config", config]);
    site.control("tag on");
    site.wait_for_live_servo();
    // Until every update in the ring's latest slot is a tagged one.
    let subscriber = site.attach();
    let start = subscriber.published(RegionId::Servo).unwrap();
    assert_eq!(subscriber.wait_newer(RegionId::Servo, start + 2, PATIENCE).unwrap(), WaitOutcome::Newer);
    let readers: Vec<_> = (0..READERS)
        .map(|_| {
            Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "mixing::reader", "--ignored", "--nocapture"])
                .env(NAME, &site.name)
                .env(FAMILY, family.name)
                .stdout(Stdio::piped())
                .spawn()
                .unwrap()
        })
        .collect();
    for reader in readers {
        let output = reader.wait_with_output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let line = text.lines().find(|line| line.contains("checked=")).expect("a reader's result");
        println!("{line}");
        assert!(output.status.success() && line.ends_with(" mixed=0"), "{text}");
    }
    let mut sample = Sample::new();
    subscriber.latest(RegionId::Servo, &mut sample).unwrap();
    assert!(is_whole(family, sample.words()));
    let mut broken = sample.words().to_vec();
    broken[family.servo.index(family.servo.motors.at(8).unwrap()) + 4] ^= 1;
    assert!(!is_whole(family, &broken), "the check sees a mixed snapshot");
    site.assert_no_violations();
}
