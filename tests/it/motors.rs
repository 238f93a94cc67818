//! What is shown of a motor: in counts, in the words of the board, and in the user's.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::rig::Rig;
use crate::support::{PATIENCE, VirtualSite};

/// `motors --json` of a site, of motor 1.
fn motor(site: &VirtualSite) -> Value {
    let (code, stdout, stderr) = site.pmacctl(&["motors", "--json"]);
    assert_eq!(code, 0, "{stderr}");
    serde_json::from_str::<Value>(&stdout).unwrap()["motors"][0].clone()
}

fn value(motor: &Value, key: &str) -> f64 {
    motor[key]["value"].as_f64().unwrap_or_else(|| panic!("{key}: {motor}"))
}

/// What the board answers to `line`.
fn number(site: &VirtualSite, line: &str) -> f64 {
    site.ask(line)[0].parse().unwrap()
}

#[test]
fn a_motor_tells_following_error_velocity_and_flags() {
    let rig = Rig::new().live();
    let document = rig.run("motors --json").json();
    let [first, second, third] = [0, 1, 2].map(|index| document["motors"][index].clone());
    assert_eq!(first["following_error"], json!({"raw": 768, "value": 0.25, "unit": "count"}));
    assert_eq!(second["velocity"]["raw"], -1536);
    // Half a count a servo cycle of 3713707/8388608 ms.
    let per_second = -0.5 * 8_388_608_000.0 / 3_713_707.0;
    assert!((value(&second, "velocity") - per_second).abs() < 1e-6, "{second}");
    assert_eq!(second["actual_velocity"]["unit"], "count per servo cycle");
    assert_eq!((&third["velocity"]["value"], &third["following_error"]["raw"]), (&Value::Null, &json!(154)));
    assert_eq!(first["position_bias"]["raw"], 0);
    for (key, flags) in
        [("homed", [true, false]), ("in_position", [true, false]), ("fatal_following_error", [false; 2])]
    {
        assert_eq!([&first[key], &second[key]], flags.map(Value::Bool).each_ref(), "{key}");
    }
    let watched = rig.run("watch --count 1 --json").json();
    assert_eq!(watched["motors"], document["motors"]);
    // What is not known is null; what the family lacks is absent.
    rig.publisher
        .set_region_state(pmac_dpram::segment::RegionId::Background, pmac_dpram::segment::RegionState::Stale);
    let stale = rig.run("motors --json").json()["motors"][0].clone();
    for key in ["homed", "in_position", "fatal_following_error", "position_bias"] {
        assert_eq!(stale.get(key), Some(&Value::Null), "{key}");
    }
    for key in ["filtered_velocity", "background_status"] {
        assert_eq!(stale.get(key), None, "{key}");
    }
}

#[test]
fn where_no_motor_is_reported_that_is_said() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.ask("I59=0");
    site.wait_until("a report without motors", || {
        site.pmacctl(&["motors"]).1.contains("no motor is in the servo report: ")
    });
}

#[test]
fn a_line_that_was_not_sent_leaves_positions_in_counts() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    site.wait_for_live_servo();
    UnixStream::connect(site.path("serial")).unwrap().write_all(b"OPEN PROG 88 CLEAR\r").unwrap();
    site.wait_until("the open buffer", || site.pmacctl(&["send", "X9"]).0 == 1);
    for line in ["$$$", "I108=5"] {
        assert_eq!(site.pmacctl(&["send", line]).0, 1, "{line}: another host has a program buffer open");
        assert_eq!(value(&motor(&site), "actual_position"), 0.0, "{line}");
    }
}

#[test]
fn the_following_error_is_what_f_answers() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    // Backlash: half a count of compensation when the motor comes back.
    for line in ["I186=800 I185=100 I122=20", "#1J=20000"] {
        site.ask(line);
    }
    site.run_for(Duration::from_millis(600));
    assert!((value(&motor(&site), "velocity") - 20_000.0).abs() < 500.0, "{}", motor(&site));
    let moving = value(&motor(&site), "following_error");
    assert!((moving - number(&site, "#1F")).abs() < 5.0 && moving > 20.0, "{moving}");
    site.run_for(Duration::from_secs(1));
    site.ask("#1J=0");
    site.run_for(Duration::from_secs(2));
    let resting = motor(&site);
    let difference = value(&resting, "commanded_position") - value(&resting, "actual_position");
    assert!(difference.abs() > 10.0, "without compensation there is nothing to see: {resting}");
    let error = value(&resting, "following_error");
    assert!((error - number(&site, "#1F")).abs() < 0.6 && error.abs() < 1.0, "{resting}");
    let reported = value(&resting, "reported_position");
    assert!((reported - number(&site, "#1P")).abs() < 0.6, "{resting}");
    site.assert_no_violations();
}

#[test]
fn the_following_error_of_a_turbo_board_is_what_f_answers() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    // Backlash: half a count of compensation when the motor comes back.
    for line in ["I187=800 I186=8 I185=100 I122=20", "#1J=20000"] {
        site.ask(line);
    }
    site.run_for(Duration::from_millis(600));
    let moving = value(&motor(&site), "following_error");
    assert!((moving - number(&site, "#1F")).abs() < 5.0 && moving > 20.0, "{moving}");
    let (status, rows, told) =
        site.pmacctl(&["gather", "-s", "1.following_error", "--seconds", "0.1", "-o", "-"]);
    assert_eq!(status, 0, "{told}");
    let gathered: f64 = rows.trim().rsplit([',', '\n']).next().unwrap().parse().unwrap();
    assert!((gathered - moving).abs() < 20.0 && gathered > 20.0, "{gathered}, {moving}");
    site.ask("#1J/");
    site.run_for(Duration::from_secs(1));
    assert!(value(&motor(&site), "following_error").abs() < 1.0, "{}", motor(&site));
    site.assert_no_violations();
}

#[test]
fn a_gathered_following_error_and_commanded_position_are_the_boards_own() {
    let turbo = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    for site in [VirtualSite::running(&[], &[]), turbo] {
        site.wait_for_live_servo();
        site.wait_for_identity();
        for line in ["#1J/", "I122=20", "#1J=20000"] {
            site.ask(line);
        }
        site.run_for(Duration::from_millis(600));
        let sources = ["1.following_error", "1.commanded_position", "1.actual_position"];
        let sources = sources.iter().flat_map(|source| ["-s", source]);
        let line = ["gather", "--seconds", "0.05", "-o", "-"].into_iter().chain(sources);
        let (status, rows, told) = site.pmacctl(&line.collect::<Vec<_>>());
        assert_eq!(status, 0, "{told}");
        let mut lines = rows.lines();
        let head = lines.next().unwrap();
        assert!(
            head.ends_with(
                "1.following_error [count],1.commanded_position [count],1.actual_position [count]"
            ),
            "{head}"
        );
        let values: Vec<f64> = lines.last().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
        let [error, commanded, actual] = values[2..] else { panic!("{values:?}") };
        assert!(error > 20.0 && (commanded - actual - error).abs() < 0.01, "{values:?}");
        let asked: f64 = site.ask("#1F")[0].parse().unwrap();
        assert!((asked - error).abs() < 20.0, "{asked}, {error}");
        site.assert_no_violations();
    }
}

#[test]
fn motors_say_why_p_answers_something_else() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    for line in ["&1#1->10X", "X=50"] {
        site.ask(line);
    }
    site.wait_until("the bias", || value(&motor(&site), "position_bias") != 0.0);
    let shown = motor(&site);
    assert_eq!(number(&site, "#1P"), 500.0);
    assert_eq!(
        [value(&shown, "actual_position"), value(&shown, "reported_position")].map(f64::round),
        [0.0, 500.0]
    );
    let text = site.pmacctl(&["motors"]).1;
    let why = "#1P answers 500.0: 500.0 more, by the bias (PSET, axis definitions) and compensation\n";
    assert!(text.ends_with(why), "{text}");
}

const NAMED: &str = "[[motor]]\nnumber = 1\nname = \"azimuth\"\nunit = \"deg\"\ncounts_per_unit = -1000\n\
                     [[motor]]\nnumber = 3\nname = \"focus\"\n";

#[test]
fn names_and_units_stand_beside_the_counts() {
    let site = VirtualSite::configured(&[], NAMED);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.connection().send("#1J=2500", PATIENCE).unwrap();
    site.run_for(Duration::from_secs(2));
    let shown = motor(&site);
    assert_eq!((&shown["name"], &shown["user"]["unit"]), (&json!("azimuth"), &json!("deg")));
    let position = shown["user"]["actual_position"].as_f64().unwrap();
    assert!((position + 2.5).abs() < 0.001, "{shown}");
    let (_, text, _) = site.pmacctl(&["motors"]);
    let row = text.lines().nth(1).unwrap();
    assert!(row.contains("#1  azimuth ") && row.contains(" -2.5000 deg "), "{text}");
    assert!(text.lines().nth(3).unwrap().contains("#3  focus "), "{text}");
    let (_, text, _) = site.pmacctl(&["status"]);
    assert!(
        text.contains("motor           #1 azimuth, -1000.0 counts a deg\nmotor           #3 focus\n"),
        "{text}"
    );
    let (_, watched, _) = site.pmacctl(&["watch", "--count", "1"]);
    assert!(watched.contains(" #1=2500.0 azimuth=-2.5000deg following_error="), "{watched}");
}

#[test]
fn what_the_board_reports_is_shown() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("background data", || site.pmacctl(&["coordinates"]).0 == 0);
    let system = || {
        let document: Value = serde_json::from_str(&site.pmacctl(&["coordinates", "--json"]).1).unwrap();
        document["coordinate_systems"][0].clone()
    };
    assert_eq!(system()["feed_override"], json!({"on": false, "raw": null, "percent": null}));
    assert_eq!(site.pmacctl(&["panel", "feed", "1", "50%"]).0, 0);
    let half = system()["feed_override"].clone();
    assert_eq!((&half["on"], half["percent"].as_f64().map(f64::round)), (&json!(true), Some(50.0)));
    let (_, text, _) = site.pmacctl(&["coordinates"]);
    assert!(text.lines().nth(1).unwrap().contains("50.00%"), "{text}");
    assert!(text.ends_with("ports: JPAN $000000  JTHW $000000  JOPTO $000000\n"), "{text}");
    let (_, text, _) = site.pmacctl(&["status"]);
    let told = site.ask("???")[0].clone();
    let line = text.lines().find(|line| line.starts_with("global status")).unwrap();
    assert!(line.contains(&format!("${} ${}: ", &told[..6], &told[6..])), "{told}: {line}");
    site.ask("#1J=1000");
    site.wait_until("the target", || value(&motor(&site), "target_position") == 1000.0);
}

#[test]
fn a_reset_that_is_not_acknowledged_is_no_failure() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.ask("P1=5");
    let (code, stdout, stderr) = site.pmacctl(&["send", "$$$"]);
    assert_eq!((code, stdout.as_str()), (0, ""), "{stderr}");
    assert!(stderr.starts_with("sent; no board has to acknowledge a reset."), "{stderr}");
    site.wait_until("the board after its reset", || site.pmacctl(&["send", "P1"]).1 == "0\n");
}

#[test]
fn a_feed_rate_in_percent_goes_by_the_i10_of_now() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    for (i10, raw) in [(3_713_707, "7253 of"), (1_856_853, "3627 of")] {
        site.ask(&format!("I10={i10}"));
        let (code, text, error) = site.pmacctl(&["panel", "feed", "1", "50%"]);
        assert!(code == 0 && text.starts_with(&format!("&1: {raw}")), "I10={i10}: {text}{error}");
    }
}

#[test]
fn a_held_jog_without_input_goes_by_its_time() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    let (code, _, error) = site.pmacctl(&["panel", "jog+", "1", "--hold"]);
    assert!(code == 2 && error.contains("nothing was sent"), "{error}");
    assert_eq!(value(&motor(&site), "commanded_position"), 0.0);
    // `pmacctl` goes by the machine's clock; the board's time goes on as the machine has time for it.
    let before = Instant::now();
    let (code, _, error) = site.pmacctl(&["panel", "jog+", "1", "--hold", "--seconds", "0.3"]);
    let took = before.elapsed();
    assert_eq!((code, error.as_str()), (0, ""));
    let went = value(&motor(&site), "commanded_position");
    assert!(went > 0.0 && took >= Duration::from_millis(300), "{went} counts in {took:?}");
}

#[test]
fn a_report_on_request_stays_as_fast_as_it_was() {
    // Turbo User Manual p. 403: with I47=0 the board makes a report in the servo cycle after the host has taken the last one.
    let site = VirtualSite::new();
    site.start_simulator(&["--family", "turbo2", "--dpram-startup"]);
    site.with_board(|board| board.execute(b"I57=0 I47=0 I48=1"));
    let config =
        site.file("pmacd.toml", "family = \"turbo2\"\nask_m_variables = false\n[servo]\nmotors = [1]\n");
    site.start_daemon(&["--config", &config]);
    site.wait_for_identity();
    site.run_for(Duration::from_secs(8));
    let status = site.hurried(|| site.pmacctl(&["status", "--json"]).1);
    let status: serde_json::Value = serde_json::from_str(&status).unwrap();
    assert_eq!(status["counters"]["missed"], 0, "{status}");
    let period = status["regions"]["servo"]["period_ns"].as_u64().unwrap();
    assert!((410_000..475_000).contains(&period), "{period} ns");
    let updates = status["counters"]["updates"].as_u64().unwrap();
    assert!(updates > 8 * 2258 * 9 / 10, "{updates} in 8 s of 2258 a second");
    site.assert_no_violations();
}
