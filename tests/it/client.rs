//! The client's board: through restarts of the daemon, through bursts, and with its past.

use std::time::{Duration, Instant};

use pmac_dpram::client::{Board, ClientError, Staleness};
use pmac_dpram::segment::{RegionId, SegmentError, Stamp, State, monotonic_ns};

use crate::support::bench::Bench;
use crate::support::rig::Rig;

const TIMEOUT: Duration = Duration::from_secs(20);

#[test]
fn a_board_outlives_its_daemons() {
    let directory = tempfile::tempdir().unwrap();
    let missing = Board::attach_in(directory.path(), "pmac0");
    assert!(matches!(missing, Err(ClientError::Segment(SegmentError::NotFound { .. }))));

    let mut first = Rig::at(directory.path(), "pmac0").live();
    first.publish();
    let mut board = Board::attach_in(directory.path(), "/pmac0").unwrap();
    let live = board.snapshot().unwrap().servo.unwrap();
    assert_eq!((live.sequence, live.stale), (2, None));
    assert_eq!(live.data.motors[0].actual_position.unwrap().value, Some(999.75));
    drop(first);

    // Still readable, and old.
    let old = board.snapshot().unwrap();
    assert_eq!(old.stale, Some(Staleness::DaemonGone));
    let old = old.servo.unwrap();
    assert_eq!((old.sequence, old.stale), (2, Some(Staleness::DaemonGone)));
    assert_eq!(old.data, live.data);

    // A wait from before finds the next daemon's first update, though its numbers start again.
    let waiting = std::thread::spawn(move || {
        let found = board.wait(2, TIMEOUT).unwrap();
        (board, found)
    });
    let _second = Rig::at(directory.path(), "pmac0").live();
    let (mut board, found) = waiting.join().unwrap();
    assert!(found);
    let live = board.snapshot().unwrap().servo.unwrap();
    assert_eq!((live.sequence, live.stale), (1, None));
}

#[test]
fn waits_end() {
    let directory = tempfile::tempdir().unwrap();
    let rig = Rig::at(directory.path(), "pmac0").live();
    let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
    assert!(board.wait(0, TIMEOUT).unwrap());
    let began = Instant::now();
    assert!(!board.wait(1, Duration::from_millis(50)).unwrap());
    assert!(began.elapsed() >= Duration::from_millis(50));
    drop(rig);
    assert!(!board.wait(1, Duration::from_millis(50)).unwrap());
    assert!(!board.wait(1, Duration::ZERO).unwrap());
}

#[test]
fn the_past_is_whole_and_what_is_lost_is_counted() {
    let directory = tempfile::tempdir().unwrap();
    let mut rig = Rig::at(directory.path(), "pmac0").live();
    let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
    for _ in 1..20 {
        rig.publish();
    }
    let numbers = |history: &pmac_dpram::client::History| -> Vec<u64> {
        history.samples.iter().map(|sample| sample.sequence).collect()
    };
    let history = board.history(1, 15).unwrap();
    assert_eq!((numbers(&history), history.lost, history.next), ((1..=15).collect(), 0, 16));
    let history = board.history(history.next, 100).unwrap();
    assert_eq!((numbers(&history), history.lost, history.next), ((16..=20).collect(), 0, 21));
    for _ in 20..200 {
        rig.publish();
    }
    let history = board.history(history.next, 1000).unwrap();
    assert_eq!(history.samples.len() as u64 + history.lost, 180);
    assert!(history.lost > 0);
    assert_eq!(numbers(&history), (21 + history.lost..=200).collect::<Vec<_>>());
}

#[test]
fn a_sample_of_fewer_motors_than_the_board_says_is_shown_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let mut rig = Rig::at(directory.path(), "pmac0").live();
    let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
    let two_motors = (0x48 + 2 * 0x3C - 0x24) / 2;
    rig.servo.truncate(two_motors);
    rig.publish();
    assert_eq!(board.snapshot().unwrap().servo.unwrap().data.motors.len(), 2);
    rig.servo.truncate(3);
    rig.publish();
    assert!(matches!(board.snapshot(), Err(ClientError::Decode(_))));
}

#[test]
fn a_board_that_fell_silent_is_not_shown_as_live() {
    let directory = tempfile::tempdir().unwrap();
    let rig = Rig::at(directory.path(), "pmac0").live();
    let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
    rig.publisher.set_state(State::Stale);
    let snapshot = board.snapshot().unwrap();
    assert_eq!(snapshot.stale, Some(Staleness::BoardSilent));
    assert_eq!(snapshot.servo.unwrap().stale, Some(Staleness::BoardSilent));
    assert_eq!(snapshot.background.unwrap().stale, Some(Staleness::BoardSilent));
}

/// One rule: the client says what [`Subscriber::is_fresh`] says, also of a region with a period and no limit.
#[test]
fn a_region_without_a_limit_never_grows_old_whatever_its_period() {
    let directory = tempfile::tempdir().unwrap();
    let mut rig = Rig::at(directory.path(), "pmac0").live();
    let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
    rig.publisher.set_period(RegionId::Servo, 1, 0);
    let second_ago = Stamp { time_ns: monotonic_ns() - 1_000_000_000, servo_timer: 0, valid: true };
    rig.publisher.publish(RegionId::Servo, second_ago, &rig.servo);
    let servo = board.snapshot().unwrap().servo.unwrap();
    assert!(servo.age_ns >= 1_000_000_000);
    assert_eq!(servo.stale, None);
    assert!(board.subscriber().is_fresh(RegionId::Servo, &second_ago, board.subscriber().now_ns()));
    rig.publisher.set_period(RegionId::Servo, 1, 1);
    let servo = board.snapshot().unwrap().servo.unwrap();
    assert!(matches!(servo.stale, Some(Staleness::NoUpdates { .. })));
    assert!(!board.subscriber().is_fresh(RegionId::Servo, &second_ago, board.subscriber().now_ns()));
}

#[test]
fn commands_go_through_the_socket() {
    let directory = tempfile::tempdir().unwrap();
    let _rig = Rig::at(directory.path(), "pmac0").live();
    let bench = Bench::new();
    let board = Board::attach_in(directory.path(), "pmac0").unwrap();
    let mut board = board.with_socket(&bench.socket);
    assert_eq!(board.send("1,2", TIMEOUT).unwrap(), ["1", "2"]);
    assert_eq!(board.connection().unwrap().info().unwrap().motors, 8);
}
