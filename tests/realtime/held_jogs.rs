//! Jogs that last as long as somebody holds them, and holders and daemons that end in every way.

use std::os::unix::fs::FileExt;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use pmac_dpram::client::Connection;

use crate::support::jogs::{ask, signal, status, until};
use crate::support::{PATIENCE, Site, wait_until};

/// Motor 1's actual velocity in the servo report.
const VELOCITY: u64 = 0x70;

fn running() -> Site {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    site.wait_for_its_functions();
    site
}

fn done(site: &Site, arguments: &[&str]) -> String {
    let (status, stdout, stderr) = site.pmacctl(arguments);
    assert_eq!((status, stderr.as_str()), (0, ""), "{arguments:?}: {stdout}");
    stdout
}

/// `pmacctl` that goes on running, its input open.
fn start(site: &Site, arguments: &[&str]) -> Child {
    site.command(arguments).stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Motor 1 of a board with no daemon: whether it moves, straight from the report.
fn moves_by_itself(site: &Site) -> bool {
    let memory = std::fs::File::open(site.path("dpram")).unwrap();
    let mut long = [0; 4];
    memory.read_exact_at(&mut long, VELOCITY).unwrap();
    i32::from_le_bytes(long) != 0
}

#[test]
fn a_held_jog_ends_with_its_holder_however_that_ends() {
    let site = running();
    let mut board = site.connection();
    let hold = |board: &mut Connection| {
        let child = start(&site, &["panel", "jog+", "1", "--hold"]);
        until(board, "#1V", "it is held", |speed| speed > 1.0);
        child
    };
    let stands = |board: &mut Connection| until(board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    let child = hold(&mut board);
    std::thread::sleep(Duration::from_millis(600));
    assert!(ask(&mut board, "#1V") > 1.0, "longer than the lease");
    signal(&child, Signal::SIGINT);
    stands(&mut board);
    assert_eq!(status(child), Some(0));
    let mut child = hold(&mut board);
    drop(child.stdin.take());
    stands(&mut board);
    assert_eq!(status(child), Some(0));
    let child = hold(&mut board);
    signal(&child, Signal::SIGKILL);
    stands(&mut board);
    assert_eq!(status(child), None);
    // Alive, but it does nothing.
    let child = hold(&mut board);
    signal(&child, Signal::SIGSTOP);
    stands(&mut board);
    signal(&child, Signal::SIGCONT);
    assert_eq!(status(child), Some(1), "it says that it was stopped");
    let child = start(&site, &["panel", "jog-", "1", "--hold", "--seconds", "0.5"]);
    until(&mut board, "#1V", "it goes", |speed| speed < -1.0);
    stands(&mut board);
    assert_eq!(status(child), Some(0));
    let log = site.log();
    assert_eq!(log.matches("holder is gone or silent").count(), 2, "{log}");
    site.assert_no_violations();
}

/// One client that holds so many jogs, of all motors in turn, until it is told to end or the daemon does.
fn hold_many(site: &Site, jogs: usize, are_held: &AtomicBool, end: &AtomicBool) {
    let mut held: Vec<(Connection, usize)> = Vec::new();
    let given_up = Instant::now() + 3 * PATIENCE;
    while !end.load(Ordering::Relaxed) && Instant::now() < given_up {
        if held.len() < jogs {
            let motor = held.len() % 8 + 1;
            let mut connection = site.connection();
            connection.panel_hold("jog+", &[motor as u8]).unwrap();
            held.push((connection, motor));
            are_held.store(held.len() == jogs, Ordering::Relaxed);
        }
        for (connection, motor) in &mut held {
            // A machine that was too busy to renew it in time begins it again.
            if connection.panel_renew().is_err() && connection.panel_hold("jog+", &[*motor as u8]).is_err() {
                return;
            }
        }
    }
}

#[test]
fn many_held_jogs_end_with_their_client() {
    let site = running();
    let mut board = site.connection();
    let (are_held, end) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let client = scope.spawn(|| hold_many(&site, 8, &are_held, &end));
        wait_until("all to be held", || are_held.load(Ordering::Relaxed));
        for motor in 1..=8 {
            until(&mut board, &format!("#{motor}V"), "it goes", |speed| speed > 1.0);
        }
        // No stop is over while the next ones come.
        site.control("fault panel_stuck on");
        end.store(true, Ordering::Relaxed);
        client.join().unwrap();
    });
    wait_until("a stop to be requested", || site.log().contains("holder is gone or silent"));
    std::thread::sleep(Duration::from_millis(300));
    site.control("fault panel_stuck off");
    for motor in 1..=8 {
        until(&mut board, &format!("#{motor}V"), "it stands", |speed| speed.abs() < 0.1);
    }
}

#[test]
fn many_held_jogs_end_with_the_daemon() {
    let mut site = running();
    let mut board = site.connection();
    let (are_held, end) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        scope.spawn(|| hold_many(&site, 8, &are_held, &end));
        wait_until("all to be held", || are_held.load(Ordering::Relaxed));
        for motor in 1..=8 {
            until(&mut board, &format!("#{motor}V"), "it goes", |speed| speed > 1.0);
        }
        site.signal_daemon(Signal::SIGTERM);
    });
    assert_eq!(site.stop_daemon(), 0);
    site.start_daemon(&[]);
    let mut board = site.connection();
    wait_until("a board that answers", || board.send("#1V", PATIENCE).is_ok());
    for motor in 1..=8 {
        until(&mut board, &format!("#{motor}V"), "it stands", |speed| speed.abs() < 0.1);
    }
    site.assert_no_violations();
}

#[test]
fn with_the_daemon_stopped_the_holder_soon_says_that_the_motor_may_move() {
    let site = running();
    let mut child = start(&site, &["panel", "jog+", "1", "--hold"]);
    wait_until("the jog", || moves_by_itself(&site));
    site.signal_daemon(Signal::SIGSTOP);
    let begun = Instant::now();
    signal(&child, Signal::SIGINT);
    let mut told = String::new();
    let stderr = child.stderr.take().unwrap();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stderr), &mut told).unwrap();
    let took = begun.elapsed();
    assert!(told.contains("motor 1 MAY BE MOVING") && took < Duration::from_secs(1), "{took:?}: {told}");
    assert!(moves_by_itself(&site), "and so it does");
    site.signal_daemon(Signal::SIGCONT);
    wait_until("the stop", || !moves_by_itself(&site));
    // The stop was answered after all, if that came within its time.
    assert!(matches!(status(child), Some(0 | 2)));
}

#[test]
fn with_the_daemon_stopped_an_abort_soon_says_that_nothing_may_stand() {
    let site = running();
    for stop in [&["abort"][..], &["send", "^A"], &["panel", "jog-stop", "1"], &["jog", "1", "stop"]] {
        site.signal_daemon(Signal::SIGSTOP);
        let begun = Instant::now();
        let mut child = start(&site, stop);
        let mut told = String::new();
        let stderr = child.stderr.take().unwrap();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(stderr), &mut told).unwrap();
        let took = begun.elapsed();
        let is_soon = took < Duration::from_secs(2);
        assert!(told.contains("use the emergency stop") && is_soon, "{stop:?}: {took:?}: {told}");
        site.signal_daemon(Signal::SIGCONT);
        // Answered after all.
        assert_eq!(status(child), Some(0), "{stop:?}");
    }
}

#[test]
fn a_daemon_that_is_stopped_stops_what_is_held() {
    let mut site = running();
    let child = start(&site, &["panel", "jog+", "1", "--hold"]);
    wait_until("the jog", || moves_by_itself(&site));
    assert_eq!(site.stop_daemon(), 0);
    wait_until("the stop", || !moves_by_itself(&site));
    // By a renewal that was refused, by a connection that broke, or by its own signal: it ends.
    assert!(matches!(status(child), Some(0..=2)));
    site.assert_no_violations();
}

#[test]
fn a_jog_outlives_a_killed_daemon_and_a_request_does_not() {
    let mut site = running();
    let child = start(&site, &["panel", "jog+", "1", "--hold"]);
    wait_until("the jog", || moves_by_itself(&site));
    site.kill_daemon();
    let output = child.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && told.contains("motor 1 MAY BE MOVING"), "{told}");
    std::thread::sleep(Duration::from_millis(500));
    assert!(moves_by_itself(&site), "nobody is left who could stop it but the board");
    site.start_daemon(&[]);
    site.wait_for_its_functions();
    let mut board = site.connection();
    until(&mut board, "#1V", "it goes on", |speed| speed > 1.0);
    done(&site, &["panel", "jog-stop", "1"]);
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    // A request that the board has not taken is withdrawn by the next daemon.
    site.control("fault panel_stuck on");
    let asking = start(&site, &["panel", "jog+", "2"]);
    let requested = |site: &Site| {
        let memory = std::fs::File::open(site.path("dpram")).unwrap();
        let mut word = [0; 2];
        memory.read_exact_at(&mut word, 0).unwrap();
        u16::from_le_bytes(word)
    };
    wait_until("the request", || requested(&site) == 2);
    site.kill_daemon();
    assert_eq!(status(asking), Some(2));
    assert_eq!(requested(&site), 2);
    site.start_daemon(&[]);
    wait_until("its withdrawal", || requested(&site) == 0);
    site.control("fault panel_stuck off");
    let mut board = site.connection();
    wait_until("a board that answers", || board.send("#2V", PATIENCE).is_ok());
    std::thread::sleep(Duration::from_millis(200));
    assert!(ask(&mut board, "#2V").abs() < 0.1);
}
