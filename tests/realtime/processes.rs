//! Daemons and boards that are killed, stopped and started again in the middle of their work.

use std::process::Stdio;
use std::time::Duration;

use pmac_dpram::segment::{Condition, Counter, RegionId, WaitOutcome};

use crate::support::{PATIENCE, Site, counter, is_live, wait_until};

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn a_simulator_killed_in_mid_update_and_started_again() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    for _ in 0..3 {
        site.kill_simulator();
        wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
        assert_eq!(site.pmacctl(&["motors"]).0, 1);
        site.start_simulator(&["--dpram-startup"]);
        wait_until("live data", || is_live(&subscriber, RegionId::Servo));
    }
    assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    site.assert_no_violations();
    // Nobody sends a command that would find out; that the port answered once does not keep the board alive.
    site.kill_simulator();
    wait_until("the board to be called silent", || subscriber.condition() == Condition::Stale);
    wait_until("no function to be called enabled", || site.connection().info().unwrap().enabled.is_empty());
}

#[test]
fn a_daemon_killed_leaves_clients_that_notice_and_find_the_next_one() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let mut board = pmac_dpram::client::Board::attach(&site.name).unwrap();
    let subscriber = site.attach();
    site.kill_daemon();
    wait_until("the owner's end to be noticed", || subscriber.condition() == Condition::OwnerGone);
    assert_eq!(subscriber.wait_newer(RegionId::Servo, u64::MAX - 1, SECOND).unwrap(), WaitOutcome::Dead);
    assert_eq!(site.pmacctl(&["motors"]).0, 1);
    site.start_daemon(&[]);
    wait_until("the old segment to be marked", || subscriber.condition().is_over());
    site.wait_for_live_servo();
    wait_until("fresh data through the client that was attached before", || {
        board.snapshot().is_ok_and(|snapshot| snapshot.servo.is_some_and(|servo| servo.is_fresh()))
    });
    site.assert_no_violations();
}

#[test]
fn host_busy_left_by_a_dead_daemon_is_cleared() {
    let config = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(config.path(), "servo_reading = \"handshake\"\n").unwrap();
    let mut site = Site::running(&[], &["--config", config.path().to_str().unwrap()]);
    site.wait_for_live_servo();
    site.kill_daemon();
    // As if it had been killed between setting the bit and clearing it.
    let memory = std::fs::OpenOptions::new().write(true).open(site.path("dpram")).unwrap();
    std::os::unix::fs::FileExt::write_all_at(&memory, &[1, 0], 0x24).unwrap();
    site.start_daemon(&[]);
    site.wait_for_live_servo();
}

#[test]
fn a_stopped_daemon_is_stale_and_goes_on_afterwards() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    site.signal_daemon(nix::sys::signal::Signal::SIGSTOP);
    wait_until("staleness by the heartbeat", || subscriber.condition() == Condition::Stale);
    let (status, _, _) = site.pmacctl(&["motors"]);
    assert_eq!(status, 1, "old data are not shown as fresh");
    let missed = counter(&subscriber, Counter::Missed);
    site.signal_daemon(nix::sys::signal::Signal::SIGCONT);
    wait_until("fresh data", || site.pmacctl(&["motors"]).0 == 0);
    wait_until("what was not read to be counted", || counter(&subscriber, Counter::Missed) > missed);
    site.assert_no_violations();
}

#[test]
fn a_log_that_nobody_reads_holds_nothing_up() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let mut daemon = site.daemon_command(&[]).stderr(Stdio::piped()).spawn().unwrap();
    site.wait_for_live_servo();
    let mut connection = site.connection();
    // Each is one line in the log; a pipe holds 64 KiB.
    let line = format!("P1{}", " ".repeat(190));
    for _ in 0..400 {
        connection.send(&line, PATIENCE).unwrap();
    }
    site.control("fault servo_silent on");
    let subscriber = site.attach();
    wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
    assert_eq!(subscriber.condition(), Condition::Live, "the bus thread still gives its signs of life");
    nix::sys::signal::kill(
        nix::unistd::Pid::from_raw(daemon.id().cast_signed()),
        nix::sys::signal::Signal::SIGTERM,
    )
    .unwrap();
    let mut ended = None;
    wait_until("the daemon to stop", || {
        ended = daemon.try_wait().unwrap();
        ended.is_some()
    });
    assert!(ended.is_some_and(|status| status.success()));
}

#[test]
fn nothing_is_live_in_the_status_of_a_daemon_that_is_gone() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    site.kill_daemon();
    let (code, json, _) = site.pmacctl(&["status", "--json"]);
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &document["condition"]), (1, &"daemon_gone".into()));
    assert_eq!(document["regions"]["servo"]["state"], "stale");
    assert!(!json.contains("\"live\""), "{json}");
    let (_, text, _) = site.pmacctl(&["status"]);
    let data: Vec<_> = text.lines().filter(|line| line.contains(" data ")).collect();
    assert!(
        data.len() == 5 && data.iter().all(|line| !line.contains("live") && !line.contains("Hz")),
        "{text}"
    );
    assert!(text.contains(", gone after "), "{text}");
}
