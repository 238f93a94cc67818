//! What a rotary stream finds in the board's buffers, and what its end leaves there, whatever the end is.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use pmac_dpram::client::{RotaryFeed, RotaryLine, RotaryPlace};
use pmac_dpram::map::status::reply_has;
use pmac_dpram::map::{Family, PMAC, TURBO2};
use pmac_dpram::protocol::control;

use crate::support::jogs::signal;
use crate::support::{PATIENCE, VirtualSite, output_within};

const PLACE: RotaryPlace = RotaryPlace {
    buffer: 1,
    start: None,
    size_longs: Some(40),
    coordinate_system: 1,
    coordinate_system_base: 1,
    define_longs: Some(100),
    left: None,
    run: true,
    may_stand: false,
    modes: Vec::new(),
};

/// What this test's own connections sent, as others are told.
fn sent(what: &str) -> String {
    format!("uid {} (pid {}) sent {what}", nix::unistd::getuid(), std::process::id())
}

fn ended(site: &VirtualSite, mut child: Child) -> Output {
    site.hurried(|| output_within(&mut child, PATIENCE))
}

fn running() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site
}

/// Moves of a program that outlasts every test here, also where time runs much faster than the test's processes.
const MOVES: usize = 8000;

/// Begins to stream a program of [`MOVES`] moves by one count each, and waits until it runs.
fn long_stream(site: &VirtualSite) -> Child {
    stream_of(site, &long_program(), &["--define", "100"])
}

fn long_program() -> String {
    "LINEAR INC TM20\n".to_owned() + &"X1\n".repeat(MOVES)
}

/// Begins to stream `program`, which has many moves, and waits until it runs.
fn stream_of(site: &VirtualSite, program: &str, arguments: &[&str]) -> Child {
    let file = site.file("long.pmc", program);
    let child = site
        .command(&["rotary", "stream", &file, "--size", "40", "--run"])
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut connection = site.connection();
    site.wait_until("a program that runs", || {
        connection.rotary_state(1).is_ok_and(|state| state.sent_lines - state.ahead_lines > 150)
    });
    child
}

/// Streams a program that goes to X 7.
fn short_stream(site: &VirtualSite, arguments: &[&str]) -> (i32, String, String) {
    let file = site.file("short.pmc", "LINEAR ABS TM20\nX7\n");
    site.pmacctl(&[&["rotary", "stream", &file, "--run"], arguments].concat())
}

fn position(site: &VirtualSite) -> f64 {
    site.ask("#1P")[0].parse().unwrap()
}

/// The board's own rotary buffer holds lines, no buffer is open, the transfer is off, and nothing moves.
#[track_caller]
fn assert_ended(site: &VirtualSite) {
    site.wait_until("the end of the stream", || {
        // With a buffer open it would be no question, and is not sent.
        site.connection().send("I57", PATIENCE).is_ok_and(|reply| reply == ["0"]) && !runs(site)
    });
    let left: u64 = site.ask("&1PR")[0].parse().unwrap();
    assert!(left > 10, "{left}");
    let stands = position(site);
    site.run_for(Duration::from_millis(500));
    assert!((position(site) - stands).abs() < 1.0, "nothing moves that nobody asked for");
    site.assert_no_violations();
}

fn runs(site: &VirtualSite) -> bool {
    runs_on(site, &PMAC)
}

fn runs_on(site: &VirtualSite, family: &Family) -> bool {
    let status = site.ask("&1??");
    reply_has(&status[0], family.status.coordinate_system, "running_program")
}

#[test]
fn a_stream_after_an_abort_does_not_run_the_lines_that_are_left() {
    let site = running();
    let child = long_stream(&site);
    assert_eq!(site.pmacctl(&["abort"]).0, 0);
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert_eq!(ran.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("sent ^A") && stderr.contains("are left in &1's rotary buffer"), "{stderr}");
    assert_ended(&site);
    let (stands, left) = (position(&site), site.ask("&1PR")[0].clone());
    let (status, _, stderr) = short_stream(&site, &[]);
    assert_eq!(status, 1);
    assert!(stderr.contains(&format!("{left} lines of an earlier program are left")), "{stderr}");
    site.run_for(Duration::from_secs(1));
    assert!((position(&site) - stands).abs() < 1.0);
    assert_eq!(site.ask("&1PR"), [left], "nothing was sent");
    // Those in the DPRAM came after those in the board, and are gone: what is left cannot be continued.
    let (status, _, stderr) = short_stream(&site, &["--continue"]);
    assert!(status == 1 && stderr.contains("there would be a gap"), "{stderr}");
    let (status, _, stderr) = short_stream(&site, &["--clear"]);
    assert!(status == 0 && stderr.contains("have been deleted"), "{stderr}");
    site.wait_until("the target", || (position(&site) - 7.0).abs() < 0.6);
    site.assert_no_violations();
}

#[test]
fn status_tells_what_runs_and_what_is_left_whoever_started_it() {
    let site = running();
    let program = |site: &VirtualSite| {
        let (_, status, _) = site.pmacctl(&["status"]);
        status.lines().find(|line| line.starts_with("program")).map(str::to_owned).unwrap_or_default()
    };
    assert_eq!(program(&site), "", "nothing runs");
    let mut child = long_stream(&site);
    site.wait_until("a program that is told", || {
        program(&site).contains("&1 runs; ") && program(&site).ends_with(" lines left in its rotary buffer")
    });
    child.kill().unwrap();
    child.wait().unwrap();
    assert_ended(&site);
    site.wait_until("what is left", || program(&site).contains("&1 does not run; "));
}

#[test]
fn no_start_runs_what_an_aborted_stream_left_unless_that_is_asked_for() {
    let site = running();
    let child = long_stream(&site);
    assert_eq!(site.pmacctl(&["abort", "1"]).0, 0);
    ended(&site, child);
    assert_ended(&site);
    let (stands, left) = (position(&site), site.ask("&1PR")[0].clone());
    for start in [
        &["panel", "start", "1"][..],
        &["panel", "step", "1"],
        &["send", "&1R"],
        &["send", "&1 B0 S"],
        &["send", "^R"],
    ] {
        let (status, _, stderr) = site.pmacctl(start);
        assert_eq!(status, 1, "{start:?}");
        assert!(
            stderr.contains(&format!("{left} lines of it would run")) && stderr.contains("--clear"),
            "{start:?}: {stderr}"
        );
    }
    let file = site.file("start.pmc", "P5=1\n&1R\n");
    let (status, _, stderr) = site.pmacctl(&["download", &file]);
    assert!(
        status == 1
            && stderr.contains("start.pmc:2: not started")
            && stderr.contains("from its rotary buffer"),
        "{stderr}"
    );
    let refused = site.pmacctl(&["panel", "start", "2"]).2;
    assert!(!refused.contains("rotary stream"), "that is another one: {refused}");
    site.run_for(Duration::from_secs(1));
    assert!((position(&site) - stands).abs() < 1.0, "nothing was sent");
    let (status, _, stderr) = site.pmacctl(&["panel", "start", "1", "--continue"]);
    assert_eq!(status, 0, "{stderr}");
    site.wait_until("the lines that were left", || (position(&site) - stands).abs() > 5.0);
    site.assert_no_violations();
}

#[test]
fn a_program_that_was_streamed_whole_and_aborted_is_not_started_unasked() {
    for abort in [&["abort"][..], &["abort", "1"], &["send", "&1A"]] {
        let site = running();
        let lines: String = (1..=60).map(|target| format!("X{target}\n")).collect();
        let file = site.file("whole.pmc", &format!("LINEAR ABS TM1000\n{lines}"));
        let stream = ["rotary", "stream", &file, "--define", "1000", "--run"];
        let (status, _, stderr) = site.pmacctl(&stream);
        assert_eq!(status, 0, "{stderr}");
        for goes_on in [["panel", "hold", "1"], ["panel", "start", "1"]] {
            let (status, _, stderr) = site.pmacctl(&goes_on);
            assert_eq!(status, 0, "it goes on after a hold: {stderr}");
        }
        assert!(runs(&site));
        assert_eq!(site.pmacctl(abort).0, 0);
        site.wait_until("the end of the motion", || !runs(&site));
        for start in [&["panel", "start", "1"][..], &["send", "&1R"]] {
            let (status, _, stderr) = site.pmacctl(start);
            let told = stderr.contains("lines of an earlier program are left in &1's rotary buffer");
            assert!(status == 1 && told, "{abort:?}: {stderr}");
        }
        assert!(!runs(&site));
        assert_eq!(site.pmacctl(&["panel", "start", "1", "--continue"]).0, 0);
        site.wait_until("what is left", || runs(&site));
        site.assert_no_violations();
    }
}

#[test]
fn a_restarted_daemon_asks_the_board_what_lies_there_before_the_first_start() {
    let site = running();
    let child = long_stream(&site);
    assert_eq!(site.pmacctl(&["abort", "1"]).0, 0);
    ended(&site, child);
    assert_ended(&site);
    let (stands, left) = (position(&site), site.ask("&1PR")[0].clone());
    let restart = |site: &VirtualSite| {
        site.stop_daemon();
        site.start_daemon(&[]);
        site.wait_for_live_servo();
        site.ask("&3");
    };
    for start in [&["panel", "start", "1"][..], &["panel", "step", "1"], &["send", "^R"]] {
        restart(&site);
        let (status, _, stderr) = site.pmacctl(start);
        assert_eq!(status, 1, "{start:?}");
        let told =
            format!("{left} lines of an earlier program are left in &1's rotary buffer, and would run now");
        assert!(stderr.contains(&told) && stderr.contains("--clear"), "{start:?}: {stderr}");
        assert_eq!(site.ask("&"), ["3"], "what was addressed is addressed again");
        let (_, _, other) = site.pmacctl(&["panel", "start", "2"]);
        assert!(!other.contains("rotary buffer"), "{start:?}: that is another one: {other}");
        assert_eq!(site.ask("&"), ["3"]);
    }
    site.run_for(Duration::from_secs(1));
    assert!((position(&site) - stands).abs() < 1.0, "nothing was sent");
    // The question is on-line only: it goes while a program buffer is open, too.
    restart(&site);
    site.ask("OPEN PLC 3 CLEAR");
    let (status, _, stderr) = site.pmacctl(&["panel", "start", "1"]);
    assert!(status == 1 && stderr.contains("lines of an earlier program are left"), "{stderr}");
    site.ask("CLOSE");
    let (status, _, stderr) = site.pmacctl(&["panel", "start", "1"]);
    assert!(status == 1 && stderr.contains(&left), "{stderr}");
    let (status, _, stderr) = site.pmacctl(&["panel", "start", "1", "--continue"]);
    assert_eq!(status, 0, "{stderr}");
    site.wait_until("the lines that were left", || (position(&site) - stands).abs() > 5.0);
    site.assert_no_violations();
}

#[test]
fn a_program_starts_after_what_a_stream_left_was_taken_away() {
    let site = running();
    let child = long_stream(&site);
    assert_eq!(site.pmacctl(&["abort"]).0, 0);
    ended(&site, child);
    assert_ended(&site);
    for line in ["OPEN PLC 3 CLEAR", "CLOSE"] {
        site.ask(line);
        assert_eq!(site.pmacctl(&["send", "&1R"]).0, 1, "after {line}");
    }
    site.ask("&1DELETE ROT");
    let (_, _, stderr) = site.pmacctl(&["send", "&1R"]);
    assert!(!stderr.contains("rotary stream"), "the board says what it is: {stderr}");
    site.assert_no_violations();
}

#[test]
fn a_stream_that_clears_what_another_left_is_held_and_started_again_at_will() {
    let site = running();
    let child = long_stream(&site);
    assert_eq!(site.pmacctl(&["abort", "1"]).0, 0);
    ended(&site, child);
    assert_ended(&site);
    assert_eq!(site.pmacctl(&["panel", "start", "1"]).0, 1, "lines are left");
    let child = stream_of(&site, &long_program(), &["--clear"]);
    // The state of the first stream's buffer was still there to be seen.
    site.wait_until("its own start", || site.log().matches("sends \"&1R\"").count() == 2);
    for goes_on in [["panel", "hold", "1"], ["panel", "start", "1"]] {
        let (status, _, stderr) = site.pmacctl(&goes_on);
        assert_eq!(status, 0, "{goes_on:?}: {stderr}");
    }
    for line in ["&1R", "&1S"] {
        let (_, _, stderr) = site.pmacctl(&["send", line]);
        assert!(!stderr.contains("not started"), "{line}: {stderr}");
    }
    assert_eq!(site.pmacctl(&["abort", "1"]).0, 0);
    ended(&site, child);
    site.assert_no_violations();
}

#[test]
fn what_is_left_runs_first_when_that_is_asked_for() {
    let site = running();
    let file = site.file("first.pmc", "LINEAR INC TM20\nX50\n");
    assert_eq!(site.pmacctl(&["rotary", "stream", &file, "--define", "100"]).0, 0);
    assert_eq!(site.ask("&1PR"), ["2"]);
    let file = site.file("second.pmc", "INC\nX30\n");
    let stream = ["rotary", "stream", &file, "--run", "--continue"];
    let (status, _, stderr) = site.pmacctl(&stream);
    assert!(
        status == 1 && stderr.contains("are to run first, but INC would be in force for them already"),
        "{stderr}"
    );
    let told = ["--set", "rotary_code2=bit16"];
    let (status, _, stderr) = site.pmacctl(&[&stream[..], &told].concat());
    assert!(status == 0 && stderr.contains("2 lines were left"), "{stderr}");
    site.wait_until("both moves", || (position(&site) - 80.0).abs() < 0.6);
    site.assert_no_violations();
}

#[test]
fn a_stream_notices_that_its_program_was_stopped() {
    let site = running();
    let child = long_stream(&site);
    // ^Q ends every program; no board says so by itself.
    site.connection().control(control::QUIT).unwrap();
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert_eq!(ran.status.code(), Some(1), "{stderr}");
    let why = format!("does not run its rotary program any more: {}", sent("^Q"));
    assert!(stderr.contains(&why), "{stderr}");
    assert!(stderr.contains("lines were sent") && stderr.contains("are left in &1's"), "{stderr}");
    assert_ended(&site);
}

#[test]
fn a_stream_says_who_ended_its_program_as_far_as_known() {
    for line in ["&1A", "A"] {
        let site = running();
        let child = long_stream(&site);
        site.ask(line);
        let ran = ended(&site, child);
        let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
        let why = format!("does not run its rotary program any more: {}", sent(line));
        assert!(ran.status.code() == Some(1) && stderr.contains(&why), "{line}: {stderr}");
    }
    let site = running();
    let child = long_stream(&site);
    UnixStream::connect(site.path("serial")).unwrap().write_all(b"&1A\r").unwrap();
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    let why = "any more: an error, the serial port, another host or a program of the board ended it";
    assert!(ran.status.code() == Some(1) && stderr.contains(why), "{stderr}");
}

#[test]
fn the_end_of_a_stream_says_that_a_feed_hold_keeps_its_program() {
    let site = running();
    let child = long_stream(&site);
    site.ask("&1H");
    site.run_for(Duration::from_secs(2));
    let held = position(&site);
    signal(&child, Signal::SIGINT);
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(stderr.contains("&1Q was sent, and the program still runs"), "{stderr}");
    assert!(!stderr.contains("has been ended"), "{stderr}");
    assert!(runs(&site) && (position(&site) - held).abs() < 0.1, "it is held");
    // What was calculated comes first, and then the end.
    assert_eq!(site.pmacctl(&["send", "--yes", "&1R"]).0, 0);
    site.wait_until("the end of the program", || !runs(&site));
    site.assert_no_violations();
}

#[test]
fn a_stream_whose_client_is_killed_ends_its_program() {
    let site = running();
    let mut child = long_stream(&site);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_ended(&site);
    assert!(site.log().contains("its client is gone"), "{}", site.log());
    assert_eq!(short_stream(&site, &["--clear"]).0, 0, "the place is free");
}

#[test]
fn a_stream_whose_client_is_silent_ends_its_program() {
    let site = running();
    let lines: Vec<RotaryLine> = vec![vec![(0x000E23, 0x500000), (0x000661, 0x980000)]; 400];
    let mut owner = site.connection();
    owner.rotary_start(PLACE).unwrap();
    let mut feed = RotaryFeed::new(owner, 1, &lines);
    while feed.inside() < 60 {
        feed.step().unwrap();
    }
    let other = site.connection().rotary_start(RotaryPlace { define_longs: None, ..PLACE }).unwrap_err();
    let pid = std::process::id();
    assert!(other.to_string().contains(&format!("(pid {pid}) has run a rotary stream")), "{other}");
    let stranger = RotaryFeed::new(site.connection(), 1, &lines).step().unwrap_err();
    assert!(stranger.to_string().contains("no stream"), "{stranger}");
    site.run_for(Duration::from_secs(8));
    let stop = feed.stop().unwrap();
    assert_eq!(stop.reason.as_deref(), Some("the stream was ended: its client is silent"), "{stop:?}");
    assert!(!runs(&site) && site.ask("I57") == ["0"]);
    site.assert_no_violations();
}

#[test]
fn a_stream_whose_client_was_suspended_says_that_it_was_silent() {
    let site = running();
    let child = long_stream(&site);
    signal(&child, Signal::SIGSTOP);
    site.run_for(Duration::from_secs(8));
    assert!(site.log().contains("has been ended: its client is silent"), "{}", site.log());
    signal(&child, Signal::SIGCONT);
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr);
    let said = stderr.lines().last().unwrap();
    assert!(ran.status.code() == Some(1) && said.contains("long.pmc:"), "{stderr}");
    assert!(said.contains(": the stream was ended: its client is silent; "), "{stderr}");
    assert!(
        said.contains(&format!("of {} lines were sent, ", MOVES + 1)) && !said.contains("not known"),
        "{stderr}"
    );
    assert_ended(&site);
}

#[test]
fn a_daemon_that_stops_ends_the_program_of_a_stream() {
    let site = running();
    let child = long_stream(&site);
    site.stop_daemon();
    let ran = ended(&site, child);
    assert_ne!(ran.status.code(), Some(0), "{ran:?}");
    site.start_daemon(&[]);
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I58"]).0 == 0);
    assert_ended(&site);
}

#[test]
fn a_stream_whose_buffer_somebody_closes_ends_within_a_second_and_says_why() {
    for is_serial in [false, true] {
        let site = running();
        let child = long_stream(&site);
        if is_serial {
            UnixStream::connect(site.path("serial")).unwrap().write_all(b"CLOSE\r").unwrap();
        } else {
            site.ask("CLOSE");
        }
        site.run_for(Duration::from_secs(1));
        assert!(site.log().contains("(rotary stream) sends \"I57=0\""), "{}", site.log());
        let ran = ended(&site, child);
        let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert_eq!(ran.status.code(), Some(1), "{stderr}");
        let by = if is_serial {
            "the rotary buffers are closed, so the board takes no more lines: somebody sent CLOSE, on the serial port"
        } else {
            ") closed the rotary buffers; "
        };
        assert!(stderr.contains(by), "{stderr}");
        assert!(stderr.contains("long.pmc:") && stderr.contains("lines were sent"), "{stderr}");
        assert_ended(&site);
    }
}

#[test]
fn an_abort_of_its_coordinate_system_ends_a_stream_whose_program_may_stand() {
    let site = running();
    let child = stream_of(&site, &(long_program() + "STOP\n"), &["--define", "100"]);
    assert_eq!(site.pmacctl(&["abort", "2"]).0, 0);
    site.run_for(Duration::from_secs(1));
    assert!(runs(&site), "that was another one");
    assert_eq!(site.pmacctl(&["abort", "1"]).0, 0);
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.code() == Some(1) && stderr.contains("aborted its coordinate system"), "{stderr}");
    assert_ended(&site);
}

#[test]
fn a_stream_notices_that_the_board_was_reset() {
    let site = running();
    let child = long_stream(&site);
    site.control("reset");
    let ran = ended(&site, child);
    let stderr = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert_eq!(ran.status.code(), Some(1), "{stderr}");
    let said = stderr
        .lines()
        .find(|line| line.contains("the board was reset"))
        .unwrap_or_else(|| panic!("{stderr}"));
    let line: u64 =
        said.split("long.pmc:").nth(1).and_then(|rest| rest.split(':').next()).unwrap().parse().unwrap();
    assert!((100..MOVES as u64).contains(&line) && said.contains("lines were sent"), "{said}");
}

/// Streams one after the other: none counts or runs a line of the one before it, however that ended, and where the board's
/// count has a line that it has begun, too.
#[test]
fn streams_in_series_begin_with_their_own_lines() {
    for (name, family) in [("pmac", &PMAC), ("turbo2", &TURBO2)] {
        let site = VirtualSite::configured(&["--family", name], &format!("family = \"{name}\"\n"));
        site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J/"]).0 == 0);
        site.ask("&1#1->X");
        site.ask("&1DEFINE ROT 50");
        let stream = |lines: usize| {
            let text = "LINEAR INC\n".to_owned() + &"X1 TM20\nX-1 TM20\n".repeat(lines / 2);
            let file = site.file("series.pmc", &text);
            let (status, _, stderr) = site.hurried(|| site.pmacctl(&["rotary", "stream", &file, "--run"]));
            (status, stderr)
        };
        for (torn, lines, end) in [("off", 10, "&1Q"), ("off", 60, "&1Q &1B0"), ("on", 60, "&1A")] {
            let what = format!("{name} {torn} {lines} {end}");
            site.control(&format!("fault rotary_torn {torn}"));
            let (status, stderr) = stream(lines);
            assert_eq!(status, 0, "{what}: {stderr}");
            // The last lines are calculated, and in execution.
            site.wait_until("the last move", || site.ask("&1PR") == ["0"]);
            for line in end.split(' ') {
                site.wait_until("the board to take it", || site.pmacctl(&["send", line]).0 == 0);
            }
            site.wait_until("rest", || !runs_on(&site, family));
            let left = [site.ask("&1PR"), site.ask("&1LIST ROT")];
            assert_eq!(left, [vec!["0".to_owned()], Vec::new()], "{what}");
            site.run_for(Duration::from_millis(300));
        }
        site.assert_no_violations();
    }
}
