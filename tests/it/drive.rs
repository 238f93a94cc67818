//! `pmacctl home`, `run`, `resume`, `step`, `hold` and `set-position`: the same on boards with and without a panel.

use std::process::{Child, Stdio};

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::support::jogs::signal;
use crate::support::rig::Ran;
use crate::support::{PATIENCE, VirtualSite, output_within};

const UNIT: &str = "[[motor]]\nnumber = 2\nname = \"azimuth\"\nunit = \"deg\"\ncounts_per_unit = -1000\n";

/// A board of each family: the panel of the first is off, the second has none.
fn boards() -> [VirtualSite; 2] {
    let classic = VirtualSite::configured(&[], UNIT);
    let turbo = VirtualSite::configured(&["--family", "turbo2"], &format!("family = \"turbo2\"\n{UNIT}"));
    for site in [&classic, &turbo] {
        site.wait_for_live_servo();
        site.wait_for_identity();
        site.wait_until("live data", || site.pmacctl(&["coordinates"]).0 == 0 && site.has_scales());
    }
    classic.ask("I2=1");
    [classic, turbo]
}

fn run(site: &VirtualSite, arguments: &[&str]) -> Ran {
    site.hurried(|| site.run(arguments))
}

#[track_caller]
fn done(site: &VirtualSite, arguments: &[&str]) -> String {
    let ran = run(site, arguments);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{arguments:?}: {}", ran.stdout);
    ran.stdout
}

#[track_caller]
fn refused(site: &VirtualSite, arguments: &[&str], code: i32, text: &str) {
    let ran = run(site, arguments);
    assert!(ran.code == Some(code) && ran.stderr.contains(text), "{arguments:?}: {ran:?}");
}

fn number(site: &VirtualSite, line: &str) -> f64 {
    site.ask(line)[0].parse().unwrap()
}

fn start(site: &VirtualSite, arguments: &[&str]) -> Child {
    site.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn ended(site: &VirtualSite, mut child: Child) -> Ran {
    site.hurried(|| output_within(&mut child, PATIENCE)).into()
}

fn kill_motor(site: &VirtualSite, line: &str) {
    site.ask(line);
    site.wait_until("the open loop", || site.pmacctl(&["motors"]).1.contains("open-loop"));
}

#[test]
fn a_motor_is_homed_with_the_panel_off_or_without_one() {
    for site in boards() {
        site.ask("#5");
        let told = done(&site, &["home", "azimuth,4", "1", "--wait"]);
        assert_eq!(told.lines().count(), 3, "{told}");
        assert_eq!(site.ask("#"), ["5"], "the address is put back");
        let log = site.log();
        for line in ["sends \"#2HM#5\"", "sends \"#4HM#5\"", "sends \"#1HM#5\""] {
            assert!(log.contains("uid ") && log.contains(line), "{log}");
        }
        let told: Value = serde_json::from_str(&done(&site, &["home", "3", "--wait", "--json"])).unwrap();
        assert_eq!((&told["failed"], &told["motors"][0]["homed"]), (&serde_json::json!([]), &true.into()));
        // Another client's stop overtakes the search, and the wait names it.
        site.ask("I623=0.01");
        let child = start(&site, &["home", "6", "--wait"]);
        site.wait_until("the search", || site.pmacctl(&["motors"]).1.contains("homing"));
        done(&site, &["jog", "6", "stop"]);
        let ran = ended(&site, child);
        assert!(ran.code == Some(1) && ran.stderr.contains("motor 6"), "{ran:?}");
        // A client that is killed stops nothing and leaves nothing behind.
        let mut child = start(&site, &["home", "6", "--wait"]);
        site.wait_until("the search", || site.pmacctl(&["motors"]).1.contains("homing"));
        signal(&child, Signal::SIGKILL);
        child.wait().unwrap();
        assert!(site.pmacctl(&["motors"]).1.contains("homing"), "the search goes on");
        done(&site, &["abort"]);
        kill_motor(&site, "#7K");
        for arguments in [&["home", "7"] as &[&str], &["home", "7", "--wait"]] {
            refused(&site, arguments, 1, "the loop of motor 7 is open");
        }
        refused(&site, &["home", "77"], 2, "there is no motor 77");
        site.assert_no_violations();
    }
}

#[test]
fn a_program_is_run_held_resumed_and_stepped_with_the_panel_off_or_without_one() {
    for site in boards() {
        let lines = [
            "&2",
            "&1 #1->X",
            "OPEN PROG 7 CLEAR",
            "LINEAR INC TM300 TA50 TS0",
            "X20000",
            "X20000",
            "CLOSE",
            "&1 B7",
            "&2",
        ];
        lines.into_iter().for_each(|line| drop(site.ask(line)));
        done(&site, &["run", "1", "--wait"]);
        assert!((number(&site, "#1P") - 40_000.0).abs() < 1.0, "{}", number(&site, "#1P"));
        assert_eq!(site.ask("&"), ["2"], "the address is put back");
        assert!(site.log().contains("sends \"&1R&2\""), "{}", site.log());
        for line in [
            "OPEN PROG 8 CLEAR",
            "LINEAR INC TM300",
            "WHILE (P1=0)",
            "X200",
            "ENDWHILE",
            "CLOSE",
            "&1B8",
            "&2",
        ] {
            site.ask(line);
        }
        done(&site, &["run", "1"]);
        site.wait_until("the program", || number(&site, "#1V") > 0.1);
        done(&site, &["hold", "1"]);
        site.wait_until("the hold", || number(&site, "#1V").abs() < 0.01);
        refused(&site, &["run", "1"], 1, "runs a program already; pmacctl resume 1 ends a hold");
        done(&site, &["resume", "1"]);
        site.wait_until("the program again", || number(&site, "#1V") > 0.1);
        site.ask("P1=1");
        site.wait_until("its end", || number(&site, "#1V").abs() < 0.01);
        site.ask("P1=0");
        site.ask("&1B8");
        site.ask("&2");
        done(&site, &["step", "1"]);
        assert!(site.log().contains("sends \"&1S&2\""), "{}", site.log());
        done(&site, &["abort", "1"]);
        refused(&site, &["run", "3", "--wait"], 1, "ERR015");
        refused(&site, &["run", "17"], 2, "there is no coordinate system 17");
        site.assert_no_violations();
    }
}

#[test]
fn a_killed_motor_is_told_where_it_stands_in_counts_and_in_its_unit() {
    // The registers of motor 2, actual and commanded position, and the actual position of motor 1.
    let registers = [["D:$67", "D:$64", "D:$2B"], ["D:$10B", "D:$108", "D:$8B"]];
    for (site, [actual, commanded, other]) in boards().into_iter().zip(registers) {
        done(&site, &["jog", "2", "=1000counts", "--wait"]);
        site.ask("#5");
        kill_motor(&site, "#2K");
        site.ask("#5");
        for definition in [commanded, other, "*"] {
            site.ask(&format!("M262->{definition}"));
            refused(&site, &["set-position", "2", "=5000counts", "--yes"], 1, "M262 points to");
        }
        site.ask(&format!("M262->{actual}"));
        let asks = "Motor 2 is at 1000.0 (-1.0000 deg). Say that it is at 5000.0 counts (-5.0000 deg)? Nothing moves.";
        refused(&site, &["set-position", "2", "=5000counts"], 2, asks);
        assert_eq!(number(&site, "#2P"), 1000.0, "nothing was sent");
        site.ask("#5");
        let told = done(&site, &["set-position", "azimuth", "=-5deg", "--yes"]);
        assert_eq!(told, "#2: 5000.0 (-5.0000 deg)\n");
        assert_eq!(site.ask("#"), ["5"], "the address is put back");
        // The loop closes where the motor stands: it does not leap.
        site.ask("#2J/");
        site.wait_until("the closed loop", || !site.pmacctl(&["motors"]).1.contains("open-loop"));
        assert_eq!((number(&site, "#2P"), number(&site, "#2F")), (5000.0, 0.0));
        site.ask("#5");
        assert!(site.log().contains("sends \"#2K M262=5000*32*I208 #5\""), "{}", site.log());
        refused(&site, &["set-position", "2", "=90"], 2, "write =90deg or =90counts; nothing was sent");
        site.assert_no_violations();
    }
}

#[test]
fn a_closed_loop_takes_no_position_but_zero_and_a_motor_that_moves_none() {
    for site in boards() {
        done(&site, &["jog", "1", "=1000", "--wait"]);
        refused(&site, &["set-position", "1", "=5000", "--yes"], 1, "the motor would leap; nothing was sent");
        assert_eq!(done(&site, &["set-position", "1", "=0", "--yes"]), "#1: 0.0\n");
        assert_eq!((number(&site, "#1P"), number(&site, "#1F")), (0.0, 0.0), "it does not leap");
        done(&site, &["jog", "1", "=1000", "--wait"]);
        site.ask("#1J+");
        site.wait_until("the jog", || number(&site, "#1V") > 0.1);
        refused(&site, &["set-position", "1", "=0", "--yes"], 1, "motor 1 does not stand in position");
        let told = site.connection().set_position(1, 0.0).unwrap_err().to_string();
        assert!(
            told.contains("no report shows that motor 1 stands") && told.contains("nothing was sent"),
            "{told}"
        );
        done(&site, &["jog", "1", "stop", "--wait"]);
        site.assert_no_violations();
    }
}
