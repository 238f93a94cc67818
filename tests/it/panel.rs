//! The control panel and the open words from the command line to the simulated motors.

use std::io::{BufRead, BufReader};
use std::os::unix::fs::FileExt;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use pmac_dpram::client::{Connection, HeldJog};
use serde_json::Value;

use crate::support::jogs::{ask, signal, status, until};
use crate::support::{PATIENCE, VirtualSite, wait_until};

fn running() -> VirtualSite {
    enabled(VirtualSite::running(&[], &[]))
}

/// Waits until the board takes panel requests.
fn enabled(site: VirtualSite) -> VirtualSite {
    site.wait_for_live_servo();
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    site
}

fn done(site: &VirtualSite, arguments: &[&str]) -> String {
    let (status, stdout, stderr) = site.pmacctl(arguments);
    assert_eq!((status, stderr.as_str()), (0, ""), "{arguments:?}: {stdout}");
    stdout
}

/// `pmacctl` that goes on running, its input open.
fn start(site: &VirtualSite, arguments: &[&str]) -> Child {
    site.command(arguments).stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn every_action_for_motors_has_its_effect() {
    let site = running();
    let mut board = site.connection();
    done(&site, &["panel", "jog+", "1", "3"]);
    until(&mut board, "#1V", "it goes up", |speed| speed > 1.0);
    until(&mut board, "#3V", "it goes up", |speed| speed > 1.0);
    done(&site, &["panel", "jog-", "3"]);
    until(&mut board, "#3V", "it goes down", |speed| speed < -1.0);
    assert!(
        ask(&mut board, "#1V") > 1.0 && ask(&mut board, "#2V").abs() < 0.1,
        "the others go on as they were"
    );
    done(&site, &["panel", "jog-stop", "1", "3"]);
    for line in ["#1V", "#3V"] {
        until(&mut board, line, "it stands", |speed| speed.abs() < 0.1);
    }
    assert!(ask(&mut board, "#1P").abs() > 10.0);
    done(&site, &["panel", "pre-jog", "1"]);
    until(&mut board, "#1P", "it is back", |position| position.abs() < 1.0);
    board.send("#2J^500", PATIENCE).unwrap();
    until(&mut board, "#2P", "it has moved", |position| (position - 500.0).abs() < 1.0);
    done(&site, &["panel", "home", "2"]);
    // Homing ends at the index pulse; the position counts from there.
    until(&mut board, "#2P", "it is homed", |position| position.abs() < 400.0);
    // Jog plus and jog minus for one motor are a stop.
    done(&site, &["panel", "jog+", "4"]);
    until(&mut board, "#4V", "it goes", |speed| speed > 1.0);
    done(&site, &["panel", "jog-stop", "4"]);
    until(&mut board, "#4V", "it stands", |speed| speed.abs() < 0.1);
    site.assert_no_violations();
}

#[test]
fn every_action_for_coordinate_systems_has_its_effect() {
    let site = running();
    let mut board = site.connection();
    board.send("&1 #1->X I193=$806", PATIENCE).unwrap();
    board.send("#1J+", PATIENCE).unwrap();
    until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
    done(&site, &["panel", "stop", "1"]);
    until(&mut board, "#1V", "the abort stops it", |speed| speed.abs() < 0.1);
    assert_ne!(ask(&mut board, "RX$0808"), 0.0);
    done(&site, &["panel", "hold", "1"]);
    until(&mut board, "RX$0808", "no time passes for a held program", |time| time == 0.0);
    // Without a program there is nothing to run: the board takes the request and drops it.
    done(&site, &["panel", "step", "2", "3"]);
    site.assert_no_violations();
}

#[test]
fn a_program_is_stepped_run_held_and_aborted() {
    let site = running();
    let mut board = site.connection();
    let lines = ["&2 #2->X I293=$8C6", "OPEN PROG 7 CLEAR", "LINEAR INC TM50 TA20 TS0", "X20", "X20", "X20"];
    for line in lines.into_iter().chain(["WHILE (P1=0)", "X20", "ENDWHILE", "CLOSE", "&2 B7"]) {
        board.send(line, PATIENCE).unwrap();
    }
    done(&site, &["panel", "step", "2"]);
    done(&site, &["panel", "step", "2"]);
    until(&mut board, "#2P", "a step", |position| position > 15.0);
    let after = {
        until(&mut board, "#2V", "it stands again", |speed| speed.abs() < 0.01);
        ask(&mut board, "#2P")
    };
    assert!(after < 61.0, "it does not run: {after}");
    done(&site, &["panel", "start", "2"]);
    until(&mut board, "#2P", "it runs", |position| position > 200.0);
    // Half the speed takes twice the time.
    done(&site, &["panel", "feed", "2", "50%"]);
    until(&mut board, "&2%", "half", |percent| (percent - 50.0).abs() < 0.01);
    done(&site, &["panel", "hold", "2"]);
    until(&mut board, "#2V", "it is held", |speed| speed.abs() < 0.01);
    let held = ask(&mut board, "#2P");
    done(&site, &["panel", "start", "2"]);
    until(&mut board, "#2P", "it goes on", |position| position > held + 50.0);
    done(&site, &["panel", "stop", "2"]);
    until(&mut board, "#2V", "it is aborted", |speed| speed.abs() < 0.01);
    let aborted = ask(&mut board, "#2P");
    site.run_for(Duration::from_millis(300));
    assert!((ask(&mut board, "#2P") - aborted).abs() < 1.0);
    site.assert_no_violations();
}

#[test]
fn a_feed_rate_is_set_in_percent_and_raw_and_released() {
    let site = running();
    let mut board = site.connection();
    done(&site, &["panel", "feed", "1", "50%"]);
    until(&mut board, "&1%", "half", |percent| (percent - 50.0).abs() < 0.01);
    let told = done(&site, &["panel", "feed", "2", "14507"]);
    assert_eq!(told, "&2: 14507 of 32767 raw = 100.00 %\n");
    until(&mut board, "&2%", "all", |percent| (percent - 100.0).abs() < 0.01);
    for too_much in ["300%", "40000"] {
        let (status, stdout, stderr) = site.pmacctl(&["panel", "feed", "2", too_much]);
        assert_eq!((status, stdout.as_str()), (2, ""), "{too_much}: {stderr}");
        assert!(stderr.contains("225.87%") || stderr.contains("0 to 32767"), "{stderr}");
    }
    until(&mut board, "&2%", "as it was", |percent| (percent - 100.0).abs() < 0.01);
    done(&site, &["panel", "feed", "2", "225.87%"]);
    until(&mut board, "&2%", "the highest override", |percent| (percent - 225.87).abs() < 0.02);
    let shown: Value = serde_json::from_str(&done(&site, &["panel", "show", "--json"])).unwrap();
    assert_eq!((&shown["override_enable"], &shown["request_enable"]), (&3.into(), &0.into()));
    assert_eq!(shown["numbers"][0]["override_raw"], 7253);
    assert!((shown["numbers"][0]["override_percent"].as_f64().unwrap() - 50.0).abs() < 0.01);
    let told = done(&site, &["panel", "feed", "1", "off"]);
    assert!(told.starts_with("&1: off; the board keeps the last override (now 50.00 %)"), "{told}");
    assert_eq!(done(&site, &["panel", "feed", "1", "off"]), "&1: off; it was not on\n");
    // Released, it is the board's own again.
    board.send("&1%80", PATIENCE).unwrap();
    until(&mut board, "&1%", "its own", |percent| (percent - 80.0).abs() < 0.01);
    assert!(done(&site, &["panel", "show"]).lines().nth(1).unwrap().contains("off"));
    site.assert_no_violations();
}

#[test]
fn a_withdrawn_request_is_not_shown_as_taken() {
    let site = running();
    done(&site, &["panel", "jog-stop", "1"]);
    site.control("fault panel_stuck on");
    let (status, _, stderr) = site.pmacctl(&["panel", "home", "4"]);
    assert!(status == 1 && stderr.contains("withdrawn"), "{stderr}");
    let shown = done(&site, &["panel", "show"]);
    let row = |number: usize| shown.lines().nth(number).unwrap().split_whitespace().collect::<Vec<_>>();
    assert_eq!(row(0)[..4], ["number", "request", "word", "waits"]);
    assert_eq!(row(4)[..3], ["4", "home", "-"], "{shown}");
    assert_eq!(row(5)[..3], ["5", "-", "-"], "{shown}");
}

#[test]
fn without_i2_3_it_is_refused_and_nothing_written() {
    let site = running();
    site.connection().send("I2=1", PATIENCE).unwrap();
    let panel = |site: &VirtualSite| {
        let memory = std::fs::File::open(site.path("dpram")).unwrap();
        let mut words = [0; 0x24];
        memory.read_exact_at(&mut words, 0).unwrap();
        words
    };
    let before = panel(&site);
    for arguments in [
        &["panel", "jog+", "1"] as &[&str],
        &["panel", "jog+", "1", "--hold", "--seconds", "1"],
        &["panel", "feed", "1", "50%"],
    ] {
        let (status, _, error) = site.pmacctl(arguments);
        assert_eq!(status, 1, "{arguments:?}: {error}");
        assert!(error.contains("I2 is 1") && error.contains("send I2=3 first"), "{error}");
    }
    assert_eq!(panel(&site), before);
    for wrong in [
        &["panel", "jog+", "9"] as &[&str],
        &["panel", "jog+"],
        &["panel", "fly", "1"],
        &["panel", "feed", "1", "-5%"],
        &["panel", "jog+", "1", "--seconds", "1"],
    ] {
        let (status, _, error) = site.pmacctl(wrong);
        assert_eq!((status, error.lines().count()), (2, 1), "{wrong:?}: {error}");
    }
    for (wrong, reason) in [
        (&["panel", "feed", "1", "-5%"] as &[&str], "a percentage must be 0 or more"),
        (&["panel", "feed", "1", "-5", "--json"], "write 50%, a raw value from 0 to 32767, or off"),
        (&["send", "--timeout", "-1", "P1"], "must be above 0"),
    ] {
        let (status, _, error) = site.pmacctl(wrong);
        assert!(status == 2 && error.contains(reason) && !error.contains("unexpected"), "{error}");
    }
    site.assert_no_violations();
}

#[test]
fn a_jog_is_held_until_its_holder_is_silent_for_the_time_of_a_lease() {
    let site = running();
    let mut board = site.connection();
    let mut holder = site.connection();
    holder.panel_hold("jog+", &[1]).unwrap();
    for _ in 0..5 {
        site.run_for(Duration::from_millis(150));
        holder.panel_renew().unwrap();
    }
    assert!(ask(&mut board, "#1V") > 1.0, "longer than one lease");
    holder.panel_renew().unwrap();
    site.run_for(Duration::from_millis(180));
    assert!(!site.log().contains("holder is gone or silent"));
    site.run_for(Duration::from_millis(30));
    assert!(site.log().contains("holder is gone or silent"));
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    assert!(holder.panel_renew().is_err(), "what has been stopped cannot be renewed");
    site.assert_no_violations();
}

/// Whether motor 1's loop is open, as `#1?` says.
fn is_open(board: &mut Connection) -> bool {
    let status = board.send("#1?", PATIENCE).unwrap().concat();
    u32::from_str_radix(&status[..6], 16).unwrap() >> 18 & 1 == 1
}

#[test]
fn a_line_by_hand_does_not_move_a_motor_that_somebody_holds() {
    let site = running();
    let (mut holder, mut other) = (site.connection(), site.connection());
    holder.panel_hold("jog+", &[1]).unwrap();
    let mut renewed = |line: &str| {
        holder.panel_renew().unwrap();
        other.send(line, PATIENCE).map_err(|error| error.to_string())
    };
    for line in ["#1J-", "#2J+ #1J=500", "#1HM"] {
        let refused = renewed(line).unwrap_err();
        assert!(refused.contains("holds a jog of motor 1; nothing was sent"), "{line}: {refused}");
    }
    assert!(renewed("#2J+").is_ok() && renewed("#1J/").is_ok(), "another motor, and what stops");
    site.assert_no_violations();
}

#[test]
fn without_servo_data_a_killed_motor_stays_killed_too() {
    let site = running();
    let mut board = site.connection();
    for kill in ["$$$", "#1K"] {
        let _ = board.send("GATHER", PATIENCE);
        board.send("#1J/", PATIENCE).unwrap();
        site.wait_for_live_servo();
        let mut holder = site.connection();
        if kill == "#1K" {
            board.send("ENDGATHER", PATIENCE).unwrap();
            site.run_for(Duration::from_millis(200));
        }
        holder.panel_hold("jog+", &[1]).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        holder.panel_renew().unwrap();
        match kill {
            "$$$" => drop(site.control("reset")),
            _ => drop(board.send(kill, PATIENCE).unwrap()),
        }
        // The background report tells many times a second.
        let ends = (0..40).find_map(|_| {
            site.run_for(Duration::from_millis(50));
            holder.panel_renew().err()
        });
        let why = ends.expect("the hold is over").to_string();
        assert!(why.contains("the loop of motor 1 is open"), "{kill}: {why}");
        drop(holder);
        site.run_for(Duration::from_secs(1));
        assert!(is_open(&mut board), "{kill}: a stop has closed the loop");
    }
    site.assert_no_violations();
}

#[test]
fn the_end_of_a_held_jog_leaves_a_killed_motor_killed() {
    let site = running();
    let mut board = site.connection();
    // However it was killed, and whoever notices first.
    for line in ["^K", "#1K", ""] {
        let mut holder = site.connection();
        holder.panel_hold("jog+", &[1]).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        holder.panel_renew().unwrap();
        match line {
            "^K" => drop(board.control(0x0B).unwrap()),
            "#1K" => drop(board.send(line, PATIENCE).unwrap()),
            // Nobody is left to be told.
            _ => {
                drop(holder);
                board.control(0x0B).unwrap();
                site.run_for(Duration::from_secs(1));
                assert!(is_open(&mut board));
                continue;
            }
        }
        site.run_for(Duration::from_millis(20));
        let why = holder.panel_renew().unwrap_err().to_string();
        let told = if line == "^K" { "somebody sent ^K" } else { "the loop of motor 1 is open" };
        assert!(why.contains(told), "{line}: {why}");
        let why = holder.panel("jog-stop", &[1]).unwrap_err().to_string();
        assert!(why.contains(told), "{line}: {why}");
        drop(holder);
        site.run_for(Duration::from_secs(1));
        assert!(is_open(&mut board), "{line}: a stop has closed the loop");
        // The next jog closes it, and is stopped though the report has just called the loop open.
        let mut holder = site.connection();
        holder.panel_hold("jog+", &[1]).unwrap();
        drop(holder);
        site.run_for(Duration::from_millis(300));
        assert!(!is_open(&mut board), "{line}");
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    }
    assert!(site.log().contains("get no stop: their loops are open"), "{}", site.log());
    site.assert_no_violations();
}

#[test]
fn an_abort_ends_a_held_jog_and_says_so() {
    let site = running();
    let mut board = site.connection();
    let child = start(&site, &["panel", "jog+", "1", "--hold"]);
    until(&mut board, "#1V", "it is held", |speed| speed > 1.0);
    board.control(0x01).unwrap();
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    let output = site.hurried(|| child.wait_with_output().unwrap());
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("somebody sent ^A"), "{error}");
    let log = site.log();
    assert!(!log.contains("holder is gone or silent") && log.contains("it gets no stop"), "{log}");
}

#[test]
fn a_held_jog_that_nobody_can_see_any_more_ends_and_says_so() {
    // However long the board stands still: no ^A in the place of the stop.
    let site = enabled(VirtualSite::configured(&[], "stop_all_after_ms = 0\n"));
    let mut board = site.connection();
    let mut child = start(&site, &["panel", "jog+", "1", "--hold"]);
    until(&mut board, "#1V", "it is held", |speed| speed > 1.0);
    site.board_stands_still(true);
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let first = std::thread::spawn(move || {
        let mut told = String::new();
        stderr.read_line(&mut told).unwrap();
        (told, stderr)
    });
    wait_until("its warning", || first.is_finished());
    let (told, stderr) = first.join().unwrap();
    assert!(told.starts_with("pmacctl: the data are not live (") && told.contains("MAY BE MOVING"), "{told}");
    site.board_stands_still(false);
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    let rest = std::io::read_to_string(stderr).unwrap();
    assert_eq!(status(child), Some(1), "{rest}");
    assert!(
        rest.contains("the hold of motor 1 was ended: the data were not live; the stop was taken"),
        "{rest}"
    );
    site.assert_no_violations();
}

#[test]
fn without_servo_data_a_held_jog_gets_its_stop_whatever_was_seen_before() {
    let site = running();
    let mut board = site.connection();
    board.send("#1K", PATIENCE).unwrap();
    site.run_for(Duration::from_millis(50));
    board.send("I48=0", PATIENCE).unwrap();
    site.wait_until("no servo data", || site.log().contains("servo data: stale"));
    let mut holder = site.connection();
    holder.panel_hold("jog+", &[1]).unwrap();
    drop(holder);
    site.run_for(Duration::from_millis(500));
    assert!(!is_open(&mut board));
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
}

#[test]
fn only_a_renewal_renews() {
    let site = running();
    let mut board = site.connection();
    let mut holder = site.connection();
    holder.panel_hold("jog+", &[1]).unwrap();
    for _ in 0..5 {
        site.run_for(Duration::from_millis(50));
        holder.feed_override(1, None).unwrap();
    }
    assert!(site.log().contains("holder is gone or silent"));
    assert!(holder.panel_renew().unwrap_err().to_string().contains("not renewed in time"));
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
}

#[test]
fn a_hold_in_a_program_ends_when_it_is_dropped() {
    let site = running();
    let mut board = site.connection();
    let held = HeldJog::begin(site.connection(), "jog+", &[1, 2]).unwrap();
    until(&mut board, "#2V", "it goes", |speed| speed > 1.0);
    assert!(held.is_held());
    drop(held);
    for line in ["#1V", "#2V"] {
        until(&mut board, line, "it stands", |speed| speed.abs() < 0.1);
    }
    assert!(HeldJog::begin(site.connection(), "home", &[1]).is_err());
    site.assert_no_violations();
}

#[test]
fn a_stop_that_the_board_does_not_take_is_asked_for_again() {
    let site = running();
    let mut board = site.connection();
    let child = start(&site, &["panel", "jog+", "1", "--hold"]);
    until(&mut board, "#1V", "it is held", |speed| speed > 1.0);
    site.control("fault panel_stuck on");
    signal(&child, Signal::SIGKILL);
    assert_eq!(status(child), None);
    site.wait_until("the first stop to fail", || site.log().contains("did not take the stop of a held jog"));
    assert!(ask(&mut board, "#1V") > 1.0);
    site.control("fault panel_stuck off");
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
}

#[test]
fn a_request_that_the_board_does_not_take_is_withdrawn() {
    let site = running();
    site.control("fault panel_stuck on");
    let (status, _, error) = site.pmacctl(&["panel", "jog+", "1"]);
    assert_eq!(status, 1);
    assert!(error.contains("did not take the panel request in time"), "{error}");
    assert_eq!(done(&site, &["read", "0x0000"]).split_whitespace().last(), Some("0"));
    site.control("fault panel_stuck off");
    done(&site, &["panel", "jog+", "1"]);
    done(&site, &["panel", "jog-stop", "1"]);
}

#[test]
fn words_and_bits_are_written_where_they_are_open() {
    let site = running();
    let value = |address: &str| {
        let document: Value = serde_json::from_str(&done(&site, &["--json", "read", address])).unwrap();
        document[0]["value"].clone()
    };
    let between = value("X:$D800");
    done(&site, &["write", "Y:$D800", "-5", "$1F", "65535"]);
    assert_eq!(value("Y:$D800"), 0xFFFB);
    assert_eq!((value("Y:$D801"), value("Y:$D802")), (0x1F.into(), 0xFFFF.into()));
    assert_eq!(value("X:$D800"), between, "what lies between is not touched");
    done(&site, &["write", "Y:$D800,8,4", "3"]);
    assert_eq!((value("Y:$D800"), value("Y:$D800,8,4")), (0xF3FB.into(), 3.into()));
    done(&site, &["write", "DP:$D803", "-70000"]);
    assert_eq!(value("DP:$D803"), -70_000);
    done(&site, &["write", "DP:$D803,12,8", "$A5"]);
    assert_eq!(value("DP:$D803,12,8"), 0xA5);
    done(&site, &["write", "F:$D804", "-2.5", "1e3"]);
    assert_eq!((value("F:$D804"), value("F:$D805")), ((-2.5).into(), 1000.0.into()));
    done(&site, &["write", "0x2030", "7"]);
    assert_eq!(value("0x2030"), 7);
    // The board sees the same.
    assert_eq!(ask(&mut site.connection(), "RY$D801"), 31.0);
    let reserved = value("Y:$DC00");
    // The panel's own words, a table in the plan, and the headers.
    for address in ["X:$D000", "Y:$D1FC", "0x0024", "Y:$DC00"] {
        let (status, _, error) = site.pmacctl(&["write", address, "1"]);
        assert_eq!(status, 1, "{address}: {error}");
        assert!(error.contains("belongs to"), "{error}");
    }
    assert_eq!(value("Y:$DC00"), reserved, "nothing was written");
    done(&site, &["write", "Y:$DC00", "1", "--engineer"]);
    assert_eq!(value("Y:$DC00"), 1);
    for wrong in [
        &["write", "Y:$D800"] as &[&str],
        &["write", "Y:$D800", "65536"],
        &["write", "L:$D800", "1"],
        &["write", "Y:$D800,12,8", "1"],
        &["read", "F:$D800,0,8"],
    ] {
        let (status, _, error) = site.pmacctl(wrong);
        assert_eq!((status, error.lines().count()), (2, 1), "{wrong:?}: {error}");
    }
    site.assert_no_violations();
}

/// The board's time that `call` takes from when the daemon has `logged` it. None passes before, nor while the machine is busy.
fn board_time_of(site: &VirtualSite, logged: &str, call: impl FnOnce() + Send) -> Duration {
    const STEP: Duration = Duration::from_millis(5);
    site.hold();
    std::thread::scope(|scope| {
        let call = scope.spawn(call);
        let is_over_within = |time: Duration, over: &dyn Fn() -> bool| {
            let until = Instant::now() + time;
            while !over() && Instant::now() < until {
                std::thread::sleep(Duration::from_micros(300));
            }
            over()
        };
        let has_begun = is_over_within(PATIENCE, &|| site.log().contains(logged));
        let mut took = Duration::ZERO;
        while !is_over_within(Duration::from_millis(20), &|| call.is_finished()) && took < PATIENCE {
            site.run_for(STEP);
            took += STEP;
        }
        // The call ends in any case.
        site.go_on();
        assert!(has_begun, "{logged}: never begun");
        took
    })
}

#[test]
fn what_stops_waits_for_nobody_elses_lines() {
    let site = running();
    let mut board = site.connection();
    board.send("&1 #1->X", PATIENCE).unwrap();
    // The board takes no line: a question would be asked until its time is over.
    site.connection().confirming(true).send("I58=0", PATIENCE).unwrap();
    let lines = start(&site, &["send", "P1=1"]);
    site.wait_until("the line to be sent", || site.log().contains("sends \"P1=1\""));
    for stop in ["jog-stop", "hold", "stop"] {
        let took = board_time_of(&site, &format!("panel {stop} [1]"), || board.panel(stop, &[1]).unwrap());
        // A question takes 500 ms.
        assert!(took < Duration::from_millis(400), "{stop}: {took:?}");
    }
    let _ = status(lines);
    site.assert_no_violations();
}

#[test]
fn feed_rate_0_is_set_before_the_board_is_asked_whether_it_has_an_effect() {
    let site = running();
    let mut board = site.connection();
    board.send("I193=$C000", PATIENCE).unwrap();
    let notes = board.feed_override(1, Some(0)).unwrap();
    assert!(notes.len() == 1 && notes[0].contains("I193=$806"), "{notes:?}");
    board.send("I2=1", PATIENCE).unwrap();
    let notes = board.feed_override(2, Some(0)).unwrap();
    assert!(notes.iter().any(|note| note.contains("no effect") && note.contains("I2 is 1")), "{notes:?}");
    let shown: Value = serde_json::from_str(&done(&site, &["panel", "show", "--json"])).unwrap();
    assert_eq!(shown["override_enable"], 3);
}

/// What `panel feed` says beside doing it.
fn feed_note(site: &VirtualSite) -> String {
    let (status, _, stderr) = site.pmacctl(&["panel", "feed", "1", "7000"]);
    assert_eq!(status, 0, "{stderr}");
    stderr
}

#[test]
fn an_override_that_nobody_reads_is_said_to_have_no_effect() {
    let site = running();
    let mut board = site.connection();
    assert_eq!(feed_note(&site), "");
    board.send("I193=$C000", PATIENCE).unwrap();
    let note = feed_note(&site);
    assert!(note.contains("no effect") && note.contains("I193=$806"), "{note}");
    assert_eq!(board.feed_override(1, Some(7000)).unwrap().len(), 1);
    assert!(board.feed_override(2, Some(7000)).unwrap().is_empty(), "the other one's");
    board.send("I193=$806", PATIENCE).unwrap();
    assert_eq!(feed_note(&site), "");
    for wrong in ["0", "9"] {
        let (status, _, stderr) = site.pmacctl(&["panel", "feed", wrong, "7000"]);
        assert!(status == 2 && !stderr.is_empty(), "{stderr}");
    }
    assert!(board.feed_override(0, Some(7000)).is_err());
    site.assert_no_violations();
}

#[test]
fn a_buffer_that_somebody_else_opened_is_noticed_and_no_question_gets_into_it() {
    use std::io::{Read, Write};
    let site = running();
    let mut serial = std::os::unix::net::UnixStream::connect(site.path("serial")).unwrap();
    serial.set_read_timeout(Some(PATIENCE)).unwrap();
    serial.write_all(b"OPEN PROG 5 CLEAR\r").unwrap();
    assert_eq!(serial.read(&mut [0; 16]).unwrap(), 1, "<ACK>");
    serial.write_all(b"X1\r").unwrap();
    // The servo report tells; the next one is a servo cycle away.
    site.run_for(Duration::from_millis(10));
    site.wait_until("a question that is not asked", || feed_note(&site).contains("could not be asked"));
    for _ in 0..5 {
        assert!(feed_note(&site).contains("could not be asked"));
    }
    serial.write_all(b"CLOSE\r").unwrap();
    site.wait_until("questions again", || feed_note(&site).is_empty());
    let listed = site.connection().send("LIST PROG 5", PATIENCE).unwrap();
    assert!(listed.iter().any(|line| line.contains("X1")) && !listed.concat().contains('I'), "{listed:?}");
    site.assert_no_violations();
}
