//! `pmacctl tune` on a simulated board: the figures are the motor's, and the board is left as it was, whoever dies.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::process::{Child, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::table::Table;

use crate::support::VirtualSite;
use crate::support::rig::{Ran, pty};

/// What a tuning move sets.
const SET: &str = "I111 I119 I120 I121 I122";

fn site() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    site
}

#[test]
fn a_step_is_timed_drawn_and_taken_back() {
    let site = site();
    let before = site.ask(SET);
    let [csv, svg] = ["step.csv", "step.svg"].map(|name| site.path(name));
    let files = ["-o", csv.to_str().unwrap(), "--plot", svg.to_str().unwrap()];
    let tune = [&["tune", "step", "1", "--size", "200", "--yes", "--json"], &files[..]].concat();
    let ran = site.hurried(|| site.run(&tune));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let document = ran.json();
    // The simulated loop is of the first order with 3 ms: ln 9 of that from 10 % to 90 %, ln 50 until 2 %.
    let response = |name: &str| document["response"][name].as_f64().unwrap();
    let near = |name, expected: f64| assert!((response(name) - expected).abs() < 1e-3, "{name}: {document}");
    near("rise_time_s", 0.0066);
    near("settling_time_s", 0.0127);
    assert!(response("overshoot_percent") < 0.5 && response("following_error_rms") > 1.0, "{document}");
    assert_eq!((response("size"), document["lost"].as_u64()), (200.0, Some(0)));
    assert_eq!(site.ask(SET), before);
    assert_eq!(site.ask("#1P"), ["0"], "it is back");
    let log = site.log();
    assert!(log.contains("sends \"#1J=200#") && log.contains("sends \"#1J=0#"), "{log}");
    let table = Table::parse(&fs::read(&csv).unwrap()).unwrap();
    let commanded = table.column("commanded_position").unwrap();
    assert_eq!((commanded[0], commanded[commanded.len() - 1]), (0.0, 200.0));
    let picture = fs::read_to_string(&svg).unwrap();
    for text in ["motor 1: step of 200 counts", "time (ms)", "position (count)", "commanded", "rise time 6"] {
        assert!(picture.contains(text), "{text}");
    }
    site.assert_no_violations();
}

#[test]
fn what_a_motor_must_not_do_is_not_begun() {
    let site = site();
    let before = site.ask(SET);
    site.ask("#2J+#1");
    for (arguments, code, said) in [
        (
            &["tune", "step", "1", "--size", "3000", "--yes"][..],
            1,
            "not sent: a step of 3000 counts would be a fatal",
        ),
        (&["tune", "step", "1"], 2, "Nobody can answer here, so nothing was sent"),
        (&["tune", "step", "2", "--yes"], 1, "not sent: motor 2 does not stand in position"),
        (
            &["tune", "parabolic", "1", "--time", "20", "--yes"],
            1,
            "choose a smaller --size or --time 716, the shortest here",
        ),
        (&["tune", "step", "9", "--yes"], 2, "there is no motor 9"),
        (&["tune", "step", "1", "--size", "0", "--yes"], 2, "--size must be"),
    ] {
        let ran = site.run(arguments);
        assert!(ran.code == Some(code) && ran.stderr.contains(said), "{arguments:?}: {ran:?}");
    }
    assert_eq!(site.ask(SET), before);
    assert!(!site.log().contains("sends \"#1J="), "{}", site.log());
}

/// A step that is asked for on a terminal, where somebody sends `meanwhile` between the question and the answer yes.
fn step_with_a_question(site: &VirtualSite, meanwhile: Option<&str>) -> Ran {
    let pty = pty(None);
    let mut tune = site.command(&["tune", "step", "1", "--size", "200"]);
    tune.stdin(Stdio::from(pty.slave)).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = tune.spawn().unwrap();
    let (mut stderr, mut question) = (child.stderr.take().unwrap(), String::new());
    while !question.ends_with("Move it? [y/N] ") {
        let mut next = [0];
        assert_eq!(stderr.read(&mut next).unwrap(), 1, "{question}");
        question.push(next[0].into());
    }
    meanwhile.map(|line| site.ask(line));
    let mut keyboard = File::from(pty.master);
    keyboard.write_all(b"y\n").unwrap();
    site.hurried(|| {
        let said = std::io::read_to_string(stderr).unwrap();
        Ran { stderr: said, ..Ran::from(child.wait_with_output().unwrap()) }
    })
}

#[test]
fn nothing_moves_by_variables_that_somebody_set_after_the_question() {
    let site = site();
    for (line, said) in
        [("I120=3", "I120 was 200, and is 3 now"), ("I111=1000", "I111 was 32000, and is 1000 now")]
    {
        let before = site.ask(SET);
        let ran = step_with_a_question(&site, Some(line));
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(
            ran.stderr.contains(said) && ran.stderr.contains("since the question; begin again"),
            "{ran:?}"
        );
        assert_ne!(site.ask(SET), before, "what somebody has set stays");
        assert!(!site.log().contains("sends \"#1J="), "{}", site.log());
    }
    site.ask("I111=32000");
    let before = site.ask(SET);
    let ran = step_with_a_question(&site, None);
    assert_eq!((ran.code, site.ask(SET)), (Some(0), before), "{ran:?}");
    site.assert_no_violations();
}

#[test]
fn the_board_kills_a_motor_that_falls_behind() {
    let site = site();
    let before = site.ask(SET);
    site.control("stall 1 on");
    let tune = ["tune", "parabolic", "1", "--limit", "50", "--yes"];
    let ran = site.hurried(|| site.run(&tune));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stderr.contains("motor 1: its following error is fatal (Ix11)"), "{ran:?}");
    assert!(ran.stdout.contains("at the most"), "the recording is told all the same: {ran:?}");
    assert_eq!(site.ask(SET), before);
    assert_eq!(site.log().matches("sends \"#1J=").count(), 1, "it is not sent back: {}", site.log());
}

#[test]
fn the_daemon_puts_back_what_a_killed_client_has_set() {
    let site = site();
    let before = site.ask(SET);
    let tune = ["tune", "parabolic", "1", "--time", "20000", "--size", "20000", "--limit", "500", "--yes"];
    let mut child = site.command(&tune).spawn().unwrap();
    site.wait_until("the move", || site.log().contains("sends \"#1J="));
    // Only the limit stays until the end: a jog of somebody else's would be as steep.
    site.wait_until("its own jog variables", || site.ask(SET)[1..] == before[1..]);
    assert_eq!(site.ask("I111"), ["8000"]);
    kill(Pid::from_raw(child.id().cast_signed()), Signal::SIGKILL).unwrap();
    child.wait().unwrap();
    site.wait_until("the variables to be put back", || site.ask(SET) == before);
    site.wait_until("the end of the gather", || {
        site.run(&["gather", "--stop"]).stdout.contains("gathers nothing")
    });
}

/// A slow move that has begun, with a fatal limit of its own: I111 is 8000.
fn moving(site: &VirtualSite) -> Child {
    let tune = ["tune", "parabolic", "1", "--time", "4000", "--size", "10000", "--limit", "500", "--yes"];
    let mut tune = site.command(&tune);
    let child = tune.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    site.wait_until("the move", || site.log().contains("sends \"#1J="));
    site.wait_until("its own jog variables", || site.log().matches("sends \"I122=").count() == 2);
    child
}

fn end(site: &VirtualSite, child: Child) -> Ran {
    site.hurried(|| Ran::from(child.wait_with_output().unwrap()))
}

#[test]
fn what_an_open_buffer_keeps_back_is_told_and_put_back_when_it_is_closed() {
    let site = site();
    let before = site.ask(SET);
    let child = moving(&site);
    site.ask("OPEN PROG 7 CLEAR");
    let ran = end(&site, child);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let kept = "I111 is 8000 by a tune that has ended; pmacd sets it to 32000 again when the open program buffer is closed";
    assert!(ran.stderr.contains(kept), "{ran:?}");
    let status = site.run(&["status"]).stdout;
    assert!(status.contains(kept), "{status}");
    site.ask("CLOSE");
    site.wait_until("the variables to be put back", || site.ask(SET) == before);
    site.assert_no_violations();
}

#[test]
fn what_somebody_else_sets_during_a_move_stays() {
    let site = site();
    let before = site.ask(SET);
    let child = moving(&site);
    // By then pmacd has asked what I122 is that the tune itself has put back.
    site.wait_until("the motor to move", || site.ask("#1P")[0].parse::<f64>().unwrap() > 10.0);
    site.ask("I111=1600 I119=0.5 I122=7");
    let ran = end(&site, child);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for (name, value) in [("I111", "1600"), ("I119", "0.5"), ("I122", "7")] {
        let stays = format!("somebody else has set {name} to {value} meanwhile; it stays {value}");
        assert!(ran.stderr.contains(&stays), "{ran:?}");
    }
    assert_eq!(site.ask(SET), ["1600", "0.5", &before[2], &before[3], "7"]);
}

#[test]
fn a_motor_that_is_not_brought_back_is_told_of() {
    let site = site();
    site.ask("#1J=500");
    site.wait_until("the motor to stand", || site.ask("#1P") == ["500"]);
    let child = moving(&site);
    assert_eq!(site.run(&["gather", "--stop"]).code, Some(0));
    let ran = end(&site, child);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for said in [
        "the gather was ended: ",
        "motor 1 stands 10000.0 counts from where it was; pmacctl jog 1 =500 brings it back",
    ] {
        assert!(ran.stderr.contains(said), "{said}: {ran:?}");
    }
    assert_eq!(site.ask("#1P"), ["10500"], "nothing moves it");
    site.assert_no_violations();
}

#[test]
fn a_parabolic_move_takes_a_time_that_the_motor_keeps_and_tells_it() {
    let site = site();
    for (line, ms) in [("I117=0.01", 896), ("I119=0.005", 1268), ("I122=1", 2000)] {
        site.ask(line);
        let ran = site.hurried(|| site.run(&["tune", "parabolic", "1", "--yes", "--json"]));
        assert_eq!(ran.code, Some(0), "{ran:?}");
        assert_eq!(ran.stderr, format!("the move takes {ms} ms, the shortest time that {line} allows\n"));
        let document = ran.json();
        assert_eq!(document["time_s"].as_f64(), Some(f64::from(ms) / 1e3), "{document}");
        assert!(document["response"]["settling_time_s"].as_f64().unwrap() < 0.05, "{document}");
    }
    let ran = site.hurried(|| site.run(&["tune", "parabolic", "1", "--time", "1000", "--yes"]));
    assert!(ran.code == Some(0) && ran.stderr.contains("than its jogs do (I119=0.005)"), "{ran:?}");
}

#[test]
fn each_variable_is_put_back_once() {
    let site = site();
    let ran = site.hurried(|| site.run(&["tune", "step", "1", "--stay", "--yes"]));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for variable in SET.split(' ') {
        assert_eq!(site.log().matches(&format!("sends \"{variable}=")).count(), 2, "{}", site.log());
    }
}

#[test]
fn a_move_that_does_not_come_to_its_end_has_no_figures() {
    for stops in ["kill", "interrupt", "reset"] {
        let site = site();
        let child = moving(&site);
        match stops {
            "kill" => assert_eq!(site.run(&["kill"]).code, Some(0)),
            // So near to its end that the size alone is that of the whole move.
            "reset" => {
                site.wait_until("most of the way", || site.ask("#1P")[0].parse::<f64>().unwrap() > 9_950.0);
                site.control("reset");
            }
            _ => kill(Pid::from_raw(child.id().cast_signed()), Signal::SIGINT).unwrap(),
        }
        let ran = end(&site, child);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(!ran.stdout.contains("overshoot") && !ran.stdout.contains("settling"), "{ran:?}");
        if stops == "interrupt" {
            assert!(ran.stderr.contains("interrupted; motor 1 was stopped"), "{ran:?}");
            assert!(!ran.stderr.contains("MAY BE MOVING"), "{ran:?}");
        }
    }
}
