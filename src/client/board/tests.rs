//! The system calls of the client's methods, and the state that the client keeps.

use super::*;
use crate::map::PMAC;
use crate::segment::{
    BlockPlace, CreateOptions, KERNEL_ASKED, Publisher, RegionSpec, RegionState, Stamp, State, monotonic_ns,
};

const SAMPLES: u64 = 4096;
const WORDS: usize = 258;

struct Rig {
    publisher: Publisher,
    board: Board,
    _directory: tempfile::TempDir,
}

impl Rig {
    fn new() -> Self {
        let directory = tempfile::tempdir_in(DIRECTORY).unwrap();
        let region = |id, slots, payload_bytes| RegionSpec {
            id,
            slots,
            payload_bytes,
            first_host_offset: 0,
            blocks: BlockPlace::NONE,
            period_hint_ns: 0,
            stale_after_ns: 0,
        };
        let place = BlockPlace::new(PMAC.servo.motors, PMAC.servo.region.start);
        let servo = RegionSpec { blocks: place, ..region(RegionId::Servo, 8192, 2 * WORDS as u32) };
        let regions = vec![servo, region(RegionId::Board, 4, crate::segment::identity::BYTES as u32)];
        let mut options = CreateOptions::new(SegmentName::new("pmac0").unwrap(), regions);
        directory.path().clone_into(&mut options.directory);
        options.heartbeat_limit_ns = 0;
        let publisher = Publisher::create(&options).unwrap();
        publisher.set_state(State::Live);
        publisher.set_region_state(RegionId::Servo, RegionState::Live);
        let board = Board::attach_in(directory.path(), "pmac0").unwrap();
        Self { publisher, board, _directory: directory }
    }

    fn publish(&mut self) {
        let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 0, valid: true };
        // A block of zeros belongs to no motor.
        let words: [u16; WORDS] = std::array::from_fn(|word| u16::from(word % 2 == 0));
        self.publisher.publish(RegionId::Servo, stamp, &words);
    }

    fn identify(&mut self, identity: &Identity) {
        let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 0, valid: true };
        self.publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
    }
}

/// What `call` returns, and the system calls that it made.
fn counted<T>(call: impl FnOnce() -> T) -> (T, u64) {
    let before = KERNEL_ASKED.get();
    let result = call();
    (result, KERNEL_ASKED.get() - before)
}

#[test]
fn a_call_makes_as_many_system_calls_for_one_sample_as_for_thousands() {
    let mut rig = Rig::new();
    rig.identify(&Identity { family: Some(1), ..Identity::default() });
    for _ in 0..SAMPLES {
        rig.publish();
    }
    for most in [0, 1, 10, SAMPLES as usize] {
        let (history, calls) = counted(|| rig.board.history(1, most).unwrap());
        assert_eq!((history.samples.len(), calls), (most, 2));
        assert!(history.samples.iter().all(View::is_fresh));
    }
    let (snapshot, calls) = counted(|| rig.board.snapshot().unwrap());
    assert!(snapshot.servo.is_some_and(|servo| servo.is_fresh()));
    assert_eq!(calls, 2);
    assert_eq!(counted(|| rig.board.identity().unwrap()).1, 0);
    assert_eq!(counted(|| rig.board.subscriber().condition()).1, 2, "this is what is counted");
}

#[test]
fn all_of_a_history_is_judged_at_one_moment() {
    let mut rig = Rig::new();
    rig.identify(&Identity { family: Some(1), ..Identity::default() });
    rig.publish();
    rig.publish();
    let samples = rig.board.history(1, 10).unwrap().samples;
    let moments: Vec<u64> = samples.iter().map(|sample| sample.time_ns + sample.age_ns).collect();
    assert_eq!((moments.len(), moments[0]), (2, moments[1]));
    rig.publisher.set_region_state(RegionId::Servo, RegionState::Stale);
    assert!(rig.board.history(1, 10).unwrap().samples.iter().all(|sample| !sample.is_fresh()));
}

#[test]
fn a_new_identity_is_seen_at_once() {
    let mut rig = Rig::new();
    rig.publish();
    assert_eq!(rig.board.identity().unwrap(), Identity::default());
    let motors = |board: &mut Board| board.snapshot().unwrap().servo.unwrap().data.motors.len();
    assert_eq!(motors(&mut rig.board), 8, "all of the first family while nothing is known");
    let three = Identity { family: Some(1), motor_mask: Some(0b111), ..Identity::default() };
    rig.identify(&three);
    assert_eq!(motors(&mut rig.board), 3);
    assert_eq!(rig.board.snapshot().unwrap().identity, three);
    rig.identify(&Identity { family: Some(99), ..three });
    assert!(matches!(rig.board.snapshot(), Err(ClientError::Family(99))));
    assert!(matches!(rig.board.history(1, 1), Err(ClientError::Family(99))));
}
