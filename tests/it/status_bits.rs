//! `motor`, `system` and `explain`: status bits and I-variables in words, as the board has them.

use serde_json::Value;

use crate::support::VirtualSite;
use crate::support::rig::pmacctl;

/// A board of each generation.
fn sites() -> [VirtualSite; 2] {
    let classic = VirtualSite::running(&[], &[]);
    let turbo = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    for site in [&classic, &turbo] {
        site.wait_for_live_servo();
        site.wait_for_identity();
    }
    [classic, turbo]
}

/// The state of the bit `name` in `motor N` or `system [N]`; `None` while it is not known.
fn bit(site: &VirtualSite, command: &[&str], name: &str) -> Option<bool> {
    let (_, stdout, stderr) = site.pmacctl(&[command, &["--json"]].concat());
    let document: Value = serde_json::from_str(&stdout).unwrap_or_else(|_| panic!("{command:?}: {stderr}"));
    let words = document["words"].as_array().unwrap();
    let mut bits = words.iter().flat_map(|word| word["bits"].as_array().unwrap());
    let bit = bits.find(|bit| bit["name"] == name).unwrap_or_else(|| panic!("{name}: {document}"));
    assert!(!bit["meaning"].as_str().unwrap().is_empty(), "{bit}");
    bit["on"].as_bool()
}

fn until(site: &VirtualSite, command: &[&str], name: &str, state: bool) {
    site.wait_until(&format!("{name} {state}"), || bit(site, command, name) == Some(state));
}

#[test]
fn a_motors_bits_tell_open_loop_amplifier_and_home() {
    for site in sites() {
        let motor = ["motor", "1"];
        until(&site, &motor, "home_complete", false);
        until(&site, &motor, "motor_activated", true);
        site.ask("#1J/");
        until(&site, &motor, "amplifier_enabled", true);
        until(&site, &motor, "open_loop", false);
        site.ask("#1HMZ");
        until(&site, &motor, "home_complete", true);
        site.ask("#1K");
        until(&site, &motor, "amplifier_enabled", false);
        until(&site, &motor, "open_loop", true);
        let (status, text, told) = site.pmacctl(&motor);
        assert_eq!((status, &*told), (0, ""), "{text}");
        for row in ["word 1 of ?: $", "word 2 of ?: $", "on     open_loop", "off    amplifier_enabled"] {
            assert!(text.contains(row), "{row}: {text}");
        }
        assert!(text.contains("the amplifier enable output is on"), "{text}");
        site.assert_no_violations();
    }
}

#[test]
fn a_systems_bits_tell_its_program_and_the_boards_its_open_buffer() {
    for site in sites() {
        let system = ["system", "1"];
        for line in ["#1J/", "&1#1->10X", "OPEN PROG 7 CLEAR"] {
            site.ask(line);
        }
        until(&site, &["system"], "motion_buffer_open", true);
        for line in ["LINEAR INC TM5000 X100", "CLOSE"] {
            site.ask(line);
        }
        until(&site, &["system"], "motion_buffer_open", false);
        until(&site, &system, "running_program", false);
        site.ask("&1B7R");
        until(&site, &system, "running_program", true);
        until(&site, &system, "in_position", false);
        site.ask("&1A");
        until(&site, &system, "running_program", false);
        let (status, text, told) = site.pmacctl(&system);
        assert_eq!((status, &*told), (0, ""), "{text}");
        assert!(text.contains("\nword 2 of ??: $") && text.contains("a motion program runs"), "{text}");
        let (status, text, _) = site.pmacctl(&["system"]);
        assert!(status == 0 && text.starts_with("word 1 of ???: $"), "{text}");
        site.assert_no_violations();
    }
}

#[test]
fn what_no_report_has_is_refused_or_not_known() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    let (status, _, told) = site.pmacctl(&["motor", "9"]);
    assert!(status == 2 && told.contains("there is no motor 9; write 1 to 8"), "{told}");
    let (status, _, told) = site.pmacctl(&["system", "9"]);
    assert!(status == 2 && told.contains("there is no coordinate system 9"), "{told}");
    let (status, _, told) = site.pmacctl(&["motor", "azimuth"]);
    assert!(status == 2 && told.contains("no motor is called"), "{told}");
    site.ask("I59=1");
    site.wait_until("a report of motor 1 alone", || site.pmacctl(&["motor", "2"]).0 == 1);
    let (_, _, told) = site.pmacctl(&["motor", "2"]);
    assert!(told.starts_with("motor 2 is not in the servo report"), "{told}");
}

#[test]
fn a_name_is_explained_without_a_daemon() {
    let all = pmacctl("--name nobody explain I130 ERR003 Y:$D009 X:$003D homed");
    assert_eq!((all.code, &*all.stderr), (Some(0), ""), "{all:?}");
    for part in [
        "I130 (PMAC, PMAC2): proportional gain; a wrong sign runs away\n  of       motor 1\n  unit     Ix08/2^19 DAC bits a count\n  \
         range    -8388608 to 8388607\n  default  2000\n  page     Software Reference p. 86\n",
        "ERR003 (Turbo PMAC, Turbo PMAC2): data error or unrecognized command\n",
        "Y:$D009 (PMAC, PMAC2): ",
        "X:$003D (PMAC, PMAC2): servo status",
        "home_complete (PMAC, PMAC2): a home search has found its trigger since power-on\n  of       motor\n  word     2 of ?, bit 10\n",
    ] {
        assert!(all.stdout.contains(part), "{part}: {}", all.stdout);
    }
    let one = pmacctl("explain --family turbo2 Ixx11 I5187 ERR022 Y:$06001C --json").json();
    let told = |place: usize, key: &str| one[place][key].clone();
    assert_eq!((told(0, "of"), told(0, "default")), ("each motor".into(), "32000".into()));
    assert_eq!((told(1, "of"), told(1, "unit")), ("coordinate system 1".into(), "ms".into()));
    assert_eq!((told(2, "kind"), told(3, "register")), ("error".into(), "servo, motor_mask".into()));
    assert_eq!(told(3, "families"), serde_json::json!(["turbo2"]));
    for wrong in ["I9999", "ERR018", "sideways"] {
        let ran = pmacctl(&format!("explain --family pmac {wrong}"));
        assert!(ran.code == Some(2) && ran.stderr.contains("is not known on PMAC; write"), "{ran:?}");
    }
}
