//! `pmacctl jog`, and what waits for a motion to end: positions, homing, programs.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::{Child, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use pmac_dpram::protocol::control;
use serde_json::Value;

use crate::support::jogs::{signal, until};
use crate::support::rig::Ran;
use crate::support::{PATIENCE, VirtualSite, output_within};

fn running(config: &str) -> VirtualSite {
    let site = VirtualSite::configured(&[], config);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("live data", || site.pmacctl(&["coordinates"]).0 == 0 && site.has_scales());
    site
}

/// What `pmacctl` does while time passes as fast as it can.
fn run(site: &VirtualSite, arguments: &[&str]) -> Ran {
    site.hurried(|| site.run(arguments))
}

#[track_caller]
fn done(site: &VirtualSite, arguments: &[&str]) -> String {
    let ran = run(site, arguments);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{arguments:?}: {}", ran.stdout);
    ran.stdout
}

/// The exit status is `code`, and stderr says `text`.
#[track_caller]
fn refused(site: &VirtualSite, arguments: &[&str], code: i32, text: &str) {
    let ran = run(site, arguments);
    assert!(ran.code == Some(code) && ran.stderr.contains(text), "{arguments:?}: {ran:?}");
}

fn number(site: &VirtualSite, line: &str) -> f64 {
    site.ask(line)[0].parse().unwrap()
}

/// A wait in the background.
fn start(site: &VirtualSite, arguments: &[&str]) -> Child {
    site.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn ended(site: &VirtualSite, mut child: Child) -> Ran {
    site.hurried(|| output_within(&mut child, PATIENCE)).into()
}

/// Another host sends a line, of which no client hears.
fn elsewhere(site: &VirtualSite, line: &str) {
    UnixStream::connect(site.path("serial")).unwrap().write_all(format!("{line}\r").as_bytes()).unwrap();
}

const UNITS: &str = "[[motor]]\nnumber = 2\nname = \"azimuth\"\nunit = \"deg\"\ncounts_per_unit = -1000\n";

#[test]
fn a_motor_is_jogged_to_a_position_and_waited_for() {
    let site = running(UNITS);
    site.ask("#5");
    assert_eq!(done(&site, &["jog", "1", "=3000", "--wait"]), "#1: 3000.0\n");
    assert!((number(&site, "#1P") - 3000.0).abs() < 1.0);
    site.ask("#5");
    assert_eq!(done(&site, &["jog", "azimuth", "=-2.5deg", "--wait"]), "#2: 2500.0 (-2.5000 deg)\n");
    assert_eq!(site.ask("#"), ["5"], "the address is put back");
    // It is there already.
    assert_eq!(done(&site, &["jog", "2", "=2500counts", "--wait"]), "#2: 2500.0 (-2.5000 deg)\n");
    let told = done(&site, &["jog", "1", "=-100.5", "--wait", "--json"]);
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["failed"], &told["motors"][0]["motor"]), (&serde_json::json!([]), &1.into()));
    assert!((told["motors"][0]["actual_position"]["value"].as_f64().unwrap() + 100.5).abs() < 0.1, "{told}");
    let log = site.log();
    assert!(log.contains("uid ") && log.contains(" pid ") && log.contains("sends \"#1J=3000#5\""), "{log}");
    site.assert_no_violations();
}

#[test]
fn a_jog_goes_on_until_it_is_stopped() {
    let site = running(UNITS);
    for (key, sign) in [("+", 1.0), ("-", -1.0)] {
        done(&site, &["jog", "azimuth", key]);
        site.wait_until("the jog", || number(&site, "#2V") * sign > 1.0);
    }
    let told = done(&site, &["jog", "azimuth", "stop", "--wait"]);
    assert!(told.starts_with("#2: ") && number(&site, "#2V").abs() < 0.1, "{told}");
    refused(&site, &["jog", "2", "+", "--wait"], 2, "cannot be waited for; nothing was sent");
    site.assert_no_violations();
}

#[test]
fn a_jog_of_a_turbo_board_closes_no_loop_of_a_killed_motor_either() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.ask("#3K");
    site.wait_until("the open loop", || site.pmacctl(&["motors"]).1.contains("open-loop"));
    refused(&site, &["jog", "3", "=1000"], 1, "not sent: the loop of motor 3 is open");
    assert!(!site.log().contains("J="), "{}", site.log());
    done(&site, &["jog", "3", "stop"]);
    site.run_for(Duration::from_millis(100));
    assert!(site.pmacctl(&["motors"]).1.contains("open-loop"), "a stop enables nothing");
    site.ask("#3J/");
    site.wait_until("the closed loop", || !site.pmacctl(&["motors"]).1.contains("open-loop"));
    done(&site, &["jog", "3", "=1000"]);
}

#[test]
fn a_jog_is_refused_with_nothing_sent() {
    let site = running(UNITS);
    site.ask("#3K");
    site.wait_until("the open loop", || site.pmacctl(&["motors"]).1.contains("open-loop"));
    for (arguments, code, why) in [
        (["jog", "9", "=1"], 2, "there is no motor 9"),
        (["jog", "elevation", "=1"], 2, "no motor is called \"elevation\""),
        (["jog", "azimuth", "=90"], 2, "write =90deg or =90counts; nothing was sent"),
        (["jog", "1", "=1mm"], 2, "it knows counts"),
        (["jog", "1", "5000"], 2, "write a position as =5000"),
        (["jog", "3", "=1000"], 1, "not sent: the loop of motor 3 is open"),
    ] {
        refused(&site, &arguments, code, why);
    }
    site.ask("I500=0");
    site.wait_until("motor 5 off", || !site.pmacctl(&["motors"]).1.contains("#5"));
    refused(&site, &["jog", "5", "=1000"], 1, "not sent: motor 5 is off; I500=1 activates it");
    site.ask("I49=0");
    site.wait_until("old background data", || site.pmacctl(&["coordinates"]).0 == 1);
    refused(&site, &["jog", "1", "=1000"], 1, "not sent: the background data are not live");
    for motor in [1, 3, 5] {
        assert!(number(&site, &format!("#{motor}P")).abs() < 0.5, "motor {motor} has moved");
    }
    site.assert_no_violations();
}

#[test]
fn a_jog_to_a_position_is_refused_while_somebody_else_holds_the_motor() {
    let site = running("");
    let (mut holder, mut other, mut board) = (site.connection(), site.connection(), site.connection());
    board.send("#5", PATIENCE).unwrap();
    holder.panel_hold("jog+", &[1]).unwrap();
    site.run_for(Duration::from_millis(100));
    holder.panel_renew().unwrap();
    let told = other.jog_to(1, -5000.0).unwrap_err().to_string();
    assert!(
        told.contains("holds a jog of motor 1; nothing was sent; pmacctl jog N stop or abort ends that"),
        "{told}"
    );
    other.jog_to(2, 100.0).unwrap();
    holder.panel_renew().unwrap();
    holder.jog_to(1, 0.0).unwrap();
    // Time would wait for who holds a jog.
    drop(holder);
    board.send("#3K#5", PATIENCE).unwrap();
    site.wait_until("the open loop", || site.pmacctl(&["motors"]).1.contains("open-loop"));
    let told = other.jog_to(3, 100.0).unwrap_err().to_string();
    assert!(told.contains("the loop of motor 3 is open") && told.contains("nothing was sent"), "{told}");
    let log = site.log();
    assert!(log.contains("sends \"#2J=100#5\"") && log.contains("sends \"#1J=0#5\""), "{log}");
    assert!(!log.contains("J=-5000") && !log.contains("sends \"#3J"), "{log}");
    assert_eq!(site.ask("#"), ["5"], "the address is put back");
    refused(&site, &["jog", "1", "=40000000000"], 2, "a motor counts no farther");
    site.assert_no_violations();
}

#[test]
fn a_wait_tells_why_a_motor_did_not_arrive() {
    let site = running("");
    site.ask("I113=1000");
    refused(&site, &["jog", "1", "=5000", "--wait"], 1, ", not at 5000.0 (+limit");
    // Killed on its way.
    site.ask("I322=5");
    let child = start(&site, &["jog", "3", "=1000000", "--wait"]);
    site.wait_until("the jog", || number(&site, "#3V") > 1.0);
    elsewhere(&site, "#3K");
    let ran = ended(&site, child);
    assert!(
        ran.code == Some(1) && ran.stderr.contains("motor 3: its loop is open: it was killed"),
        "{ran:?}"
    );
    // Its following error becomes fatal, which kills all motors.
    site.ask("I211=16 I212=0");
    refused(&site, &["jog", "2", "=50000", "--wait"], 1, "motor 2: its following error is fatal (Ix11)");
    site.assert_no_violations();
}

/// Its position in raw units is nowhere near the target in counts.
#[test]
fn a_wait_judges_no_motor_whose_scale_is_not_known() {
    let site = VirtualSite::new();
    site.start_simulator(&["--dpram-startup"]);
    site.start_daemon(&["--config", &site.file("silent.toml", "ask_board = false\n")]);
    site.wait_for_live_servo();
    refused(&site, &["jog", "1", "=1500", "--wait"], 1, "whether that is 1500.0 is not known");
    assert!((number(&site, "#1P") - 1500.0).abs() < 1.0);
}

#[test]
fn the_end_of_a_wait_is_not_the_end_of_the_motion() {
    let site = running("");
    site.ask("I122=5 I222=5");
    let waits = ["jog", "1", "=1000000", "--wait", "--timeout", "0.2"];
    refused(&site, &waits, 1, "0.2 s are over; motor 1 MAY BE MOVING: only the wait has ended");
    assert!(number(&site, "#1V") > 1.0, "it moves on");
    let child = start(&site, &["jog", "2", "=1000000", "--wait"]);
    site.wait_until("the jog", || number(&site, "#2V") > 1.0);
    signal(&child, Signal::SIGINT);
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("interrupted; motor 2 MAY BE MOVING"), "{ran:?}");
    assert!(number(&site, "#2V") > 1.0, "it moves on");
    site.ask("I322=5");
    let child = start(&site, &["jog", "3", "=1000000", "--wait"]);
    site.wait_until("the jog", || number(&site, "#3V") > 1.0);
    site.board_stands_still(true);
    let ran = ended(&site, child);
    assert!(
        ran.code == Some(1) && ran.stderr.contains("no report has come for 2 s; motor 3 MAY BE MOVING"),
        "{ran:?}"
    );
}

#[test]
fn a_wait_whose_daemon_is_gone_says_so() {
    let site = running("");
    site.ask("I122=5");
    let child = start(&site, &["jog", "1", "=1000000", "--wait"]);
    site.wait_until("the jog", || number(&site, "#1V") > 1.0);
    site.stop_daemon();
    let ran = ended(&site, child);
    let told = ran.stderr.contains("pmacd is gone") && ran.stderr.contains("motor 1 MAY BE MOVING");
    assert!(ran.code == Some(1) && told, "{ran:?}");
}

#[test]
fn a_wait_names_the_reset_that_ended_it() {
    // Its reports go on after a reset.
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_until("the board's answers", || site.run(&["send", "SAVE"]).code == Some(0));
    let child = start(&site, &["jog", "1", "=500000", "--wait"]);
    site.wait_until("the jog", || number(&site, "#1V") > 0.1);
    site.control("reset");
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("the board was reset; motor 1"), "{ran:?}");
}

#[test]
fn a_jog_that_a_home_search_took_over_has_not_arrived() {
    let site = running("");
    site.ask("#3J=5000");
    site.wait_until("the start", || number(&site, "#3P") > 4999.0);
    // Slow, so that the search comes while the motor is on its way to 0, which home is then too.
    site.ask("I322=1");
    let child = start(&site, &["jog", "3", "=0", "--wait"]);
    site.wait_until("the jog", || number(&site, "#3V") < -0.1);
    elsewhere(&site, "#3HM");
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("searched for home meanwhile"), "{ran:?}");
}

#[test]
fn a_home_search_is_waited_for() {
    let site = running("");
    site.ask("#4J=5000");
    site.wait_until("the start", || number(&site, "#4P") > 4999.0);
    let told = done(&site, &["panel", "home", "4", "5", "--wait"]);
    assert_eq!(told.lines().count(), 2, "{told}");
    site.wait_until("the flag", || site.pmacctl(&["motors"]).1.contains("homed"));
    // The board drops the request of a motor that a program has, whose flag is of the search before.
    for line in ["&1 #4->X", "OPEN PROG 5 CLEAR", "DWELL 60000", "CLOSE", "&1B5R"] {
        site.ask(line);
    }
    let ran = site.run(&["panel", "home", "4", "--wait"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("has not searched for home"), "{ran:?}");
    site.ask("&1A");
    // A search that is stopped has not found home.
    site.ask("I623=0.01");
    let child = start(&site, &["panel", "home", "6", "--wait"]);
    site.wait_until("the search", || site.pmacctl(&["motors"]).1.contains("homing"));
    elsewhere(&site, "#6J/");
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("and has not found home"), "{ran:?}");
    site.assert_no_violations();
}

#[test]
fn a_wait_says_which_motors_nobody_reports() {
    let site = running("[servo]\nmotors = [1, 2]\n");
    for line in ["&1 #1->X", "OPEN PROG 7 CLEAR", "LINEAR INC TM300 TA50 TS0", "X2000", "CLOSE", "&1 B7"] {
        site.ask(line);
    }
    let ran = run(&site, &["panel", "start", "1", "--wait"]);
    assert!(ran.code == Some(0) && ran.stderr.contains("stands is not known: nothing reports it"), "{ran:?}");
}

#[test]
fn a_program_is_waited_for() {
    let site = running("");
    let lines =
        ["&1 #1->X", "OPEN PROG 7 CLEAR", "LINEAR INC TM300 TA50 TS0", "X2000", "X2000", "CLOSE", "&1 B7"];
    lines.into_iter().for_each(|line| drop(site.ask(line)));
    done(&site, &["panel", "start", "1", "--wait"]);
    assert!((number(&site, "#1P") - 4000.0).abs() < 1.0, "the last move has ended");
    for line in
        ["OPEN PROG 8 CLEAR", "LINEAR INC TM300", "WHILE (P1=0)", "X200", "ENDWHILE", "CLOSE", "&1 B8"]
    {
        site.ask(line);
    }
    let child = start(&site, &["panel", "start", "1", "--wait"]);
    site.wait_until("the program", || number(&site, "#1V") > 0.1);
    refused(
        &site,
        &["panel", "start", "1", "--wait"],
        1,
        "not sent: coordinate system 1 runs a program already",
    );
    let told = "&1 runs a program; &1Q ends it after the move under way, &1A at once\n";
    refused(&site, &["send", "#1HM"], 1, &format!("{told}ERR001"));
    site.run_for(Duration::from_millis(300));
    assert_eq!(site.pmacctl(&["panel", "stop", "1"]).0, 0);
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("sent panel stop"), "{ran:?}");
    // There is no program: the board takes the key and does nothing.
    refused(&site, &["panel", "start", "3", "--wait"], 1, "was not seen to run");
    refused(&site, &["panel", "start", "3"], 1, "coordinate system 3 was not seen to run");
    site.ask("#1K");
    site.wait_until("the open loop", || site.pmacctl(&["motors"]).1.contains("open-loop"));
    refused(
        &site,
        &["panel", "start", "1"],
        1,
        "program ended at once; motor 1: its loop is open: it was killed",
    );
    site.assert_no_violations();
}

/// A Turbo board reports no commanded position: it is the actual one and the following error.
#[test]
fn a_motor_of_a_turbo_board_is_jogged_to_a_position_and_waited_for() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("scales", || site.has_scales());
    assert_eq!(done(&site, &["jog", "32", "=3000", "--wait"]), "#32: 3000.0\n");
    // Held up on its way: it stands elsewhere.
    let wait = start(&site, &["jog", "32", "=-300000", "--wait"]);
    site.wait_until("the motor to be on its way", || number(&site, "#32P") < 0.0);
    elsewhere(&site, "#32J/");
    let ran = ended(&site, wait);
    assert!(ran.code == Some(1) && ran.stderr.contains("not at -300000.0"), "{ran:?}");
    site.assert_no_violations();
}

/// A program that goes on and on, and its wait.
fn endless(site: &VirtualSite) -> Child {
    let lines = [
        "&1 #1->X",
        "OPEN PROG 8 CLEAR",
        "LINEAR INC TM300",
        "WHILE (P1=0)",
        "X200",
        "ENDWHILE",
        "CLOSE",
        "&1 B8",
    ];
    lines.into_iter().for_each(|line| drop(site.ask(line)));
    // The reports say no more that the program before runs.
    site.run_for(Duration::from_millis(500));
    let child = start(site, &["panel", "start", "1", "--wait"]);
    site.wait_until("the program", || number(site, "#1V") > 0.1);
    child
}

#[test]
fn a_wait_ends_when_somebody_ends_what_it_waits_for_and_names_him() {
    let site = running("");
    let sent = |what: &str| format!("uid {} (pid {}) sent {what}", nix::unistd::getuid(), std::process::id());
    let mut board = site.connection();
    for stop in ["&1Q", "&1A", "Q"] {
        let child = endless(&site);
        site.ask(stop);
        let ran = ended(&site, child);
        let told = ran.stderr.contains("the program of coordinate system 1 was ")
            && ran.stderr.contains(&sent(stop));
        assert!(ran.code == Some(1) && told, "{stop}: {ran:?}");
        site.ask("&1A");
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    }
    let child = endless(&site);
    // What is held goes on later, and another coordinate system is another one.
    site.ask("&1H");
    assert_eq!(site.pmacctl(&["abort", "2"]).0, 0);
    site.run_for(Duration::from_millis(500));
    site.ask("&1R");
    board.control(control::QUIT).unwrap();
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains(&sent("^Q")), "{ran:?}");
    site.ask("I322=5 I623=0.01");
    let child = start(&site, &["jog", "3", "=1000000", "--wait"]);
    site.wait_until("the motion", || number(&site, "#3V").abs() > 0.1);
    site.ask("#3J/");
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains(&sent("#3J/")), "{ran:?}");
    let child = start(&site, &["panel", "home", "6", "--wait"]);
    site.wait_until("the search", || site.pmacctl(&["motors"]).1.contains("homing"));
    site.ask("#6J/");
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains(&sent("#6J/")), "{ran:?}");
    let child = start(&site, &["jog", "3", "=1000000", "--wait"]);
    site.wait_until("the motion", || number(&site, "#3V").abs() > 0.1);
    assert_eq!(site.pmacctl(&["jog", "3", "stop"]).0, 0);
    let ran = ended(&site, child);
    assert!(ran.code == Some(1) && ran.stderr.contains("motor 3"), "{ran:?}");
    assert!(ran.stderr.contains("sent panel jog-stop"), "{ran:?}");
    site.assert_no_violations();
}

#[test]
fn a_start_of_which_nobody_sees_a_program_run_is_no_success() {
    let site = VirtualSite::configured(&[], "functions = ['ascii', 'panel']\n");
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    let ran = site.run(&["panel", "start", "1"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("whether the program runs is not known"), "{ran:?}");
}
