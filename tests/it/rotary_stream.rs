//! `pmacctl rotary stream` against the simulated board, as real processes.

use std::path::PathBuf;
use std::process::{Output, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::{Connection, RotaryFeed, RotaryLine, RotaryPlace};

use crate::support::{PATIENCE, VirtualSite};

fn running() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site
}

/// A program of so many lines of two commands, in a file of the site.
fn program(site: &VirtualSite, lines: usize) -> PathBuf {
    let path = site.path("program.pmc");
    let mut text = "; two commands a line, and this one takes none\n".to_owned();
    for line in 0..lines {
        text += &format!("X{} Y{}\n", line % 1000, line * 7 % 500);
    }
    std::fs::write(&path, text).unwrap();
    path
}

fn stream(site: &VirtualSite, arguments: &[&str]) -> (i32, String, String) {
    site.pmacctl(&[&["rotary", "stream"], arguments].concat())
}

/// The numbers of `lines=N commands=N underruns=N seconds=S`.
fn summary(stdout: &str) -> [f64; 4] {
    let values = stdout.trim_end().split(' ').map(|part| part.split_once('=').unwrap().1.parse().unwrap());
    values.collect::<Vec<f64>>().try_into().unwrap()
}

#[test]
fn a_program_goes_in_whole_through_either_buffer() {
    let site = running();
    let file = program(&site, 9000);
    let file = file.to_str().unwrap();
    let (status, stdout, stderr) = stream(&site, &[file, "--define", "37000"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.starts_with("lines=9000 commands=18000 underruns="), "{stdout}");
    println!("{:.0} commands/s", 18000.0 / summary(&stdout)[3]);
    // Nothing is left open: this would be a program line otherwise.
    assert_eq!(site.connection().send("I57", PATIENCE).unwrap(), ["0"]);
    site.assert_no_violations();
    // The other buffer, small, elsewhere, for the other coordinate system: after a reset, which forgets the first one.
    site.control("reset");
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I58"]).0 == 0);
    let short = program(&site, 500);
    let short = short.to_str().unwrap();
    let options = ["--cs", "2", "--buffer", "2", "--size", "20", "--start", "DP:$D800", "--define", "2100"];
    let (status, stdout, stderr) = stream(&site, &[&[short, "--json"], &options[..]].concat());
    assert_eq!(status, 0, "{stderr}");
    let document: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((&document["lines"], &document["commands"]), (&500.into(), &1000.into()));
    assert_eq!((&document["ahead_lines"], &document["finished"]), (&0.into(), &true.into()));
    site.assert_no_violations();
}

#[test]
fn what_cannot_be_sent_is_told_before_anything_is() {
    let site = running();
    let path = site.path("bad.pmc");
    std::fs::write(&path, "X1\nIF (P1>0)\nX(P1+2)\n").unwrap();
    let file = path.to_str().unwrap();
    let (status, stdout, stderr) = stream(&site, &[file, "--define", "100"]);
    assert_eq!((status, stdout.as_str()), (1, ""));
    let lines: Vec<&str> = stderr.lines().collect();
    assert!(
        lines[0].starts_with(&format!("{file}:2:1: ")) && lines[1].starts_with(&format!("{file}:3:")),
        "{stderr}"
    );
    assert!(!site.log().contains("DEFINE"), "nothing was sent");
    // A line that the buffer could never hold.
    std::fs::write(&path, "X1\nX1 Y2 Z3\n").unwrap();
    let (status, _, stderr) = stream(&site, &[file, "--size", "8"]);
    assert_eq!(status, 1);
    assert!(stderr.starts_with(&format!("{file}:2:1: 3 commands in a line")), "{stderr}");
    // Lost precision is a warning.
    std::fs::write(&path, "P1=1.23456789\n").unwrap();
    let (status, stdout, stderr) = stream(&site, &[file, "--define", "100"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.starts_with(&format!("{file}:1:4: warning: ")), "{stderr}");
    assert!(stdout.starts_with("lines=1 commands=1 "), "{stdout}");
    std::fs::write(&path, "; nothing\n").unwrap();
    assert_eq!(stream(&site, &[file]).0, 2);
    site.assert_no_violations();
}

#[test]
fn a_board_that_is_not_ready_says_what_it_lacks() {
    let site = running();
    let file = program(&site, 10);
    let file = file.to_str().unwrap();
    let (status, _, stderr) = stream(&site, &[file]);
    assert_eq!(status, 1);
    assert!(stderr.starts_with("&1PR: ERR003") && stderr.contains("--define"), "{stderr}");
    site.connection().send("&1DEFINE ROT 100", PATIENCE).unwrap();
    // Across the table of the variable write.
    let (status, _, stderr) = stream(&site, &[file, "--start", "DP:$DA00", "--size", "128"]);
    assert_eq!(status, 1);
    assert!(stderr.contains("belongs to the variable_write buffer"), "{stderr}");
    let error = site.connection().rotary_state(1).unwrap_err().to_string();
    assert!(error.contains("has not been set up"), "{error}");
    assert_eq!(stream(&site, &[file]).0, 0);
    site.assert_no_violations();
}

#[test]
fn a_stream_that_was_run_says_how_to_end_the_program_and_the_next_one_what_is_in_its_way() {
    let site = running();
    let path = site.path("short.pmc");
    std::fs::write(&path, "LINEAR\nINC\nTM20\nX1\nX-1\n").unwrap();
    let file = path.to_str().unwrap();
    let (status, _, stderr) = stream(&site, &[file, "--define", "100", "--run"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("&1 still runs") && stderr.contains("pmacctl send '&1Q'"), "{stderr}");
    site.wait_until("all lines to be taken", || site.ask("&1PR") == ["0"]);
    let (status, _, stderr) = stream(&site, &[file, "--run"]);
    assert!(status == 1 && stderr.contains("ERR001") && stderr.contains("pmacctl send '&1Q'"), "{stderr}");
    // What is said helps, as soon as the motion is over.
    site.connection().send("&1Q", PATIENCE).unwrap();
    site.wait_until("a board that takes a jog", || site.pmacctl(&["send", "#1J=0"]).0 == 0);
    let (status, _, stderr) = stream(&site, &[file, "--define", "100"]);
    assert!(status == 1 && stderr.contains("pmacctl send '&1DELETE ROT'"), "{stderr}");
    site.wait_until("a board that lets it go", || site.pmacctl(&["send", "&1DELETE ROT"]).0 == 0);
    let (status, _, stderr) = stream(&site, &[file, "--define", "100", "--run", "--quiet"]);
    assert_eq!((status, stderr.as_str()), (0, ""));
    site.assert_no_violations();
}

#[test]
fn a_program_that_does_not_run_is_not_said_to_run() {
    let site = running();
    let path = site.path("moves.pmc");
    std::fs::write(&path, "LINEAR INC TM20\n".to_owned() + &"X1\nX-1\n".repeat(2000)).unwrap();
    let file = path.to_str().unwrap();
    // Killed motors refuse R.
    site.pmacctl(&["kill"]);
    let (status, _, stderr) = stream(&site, &[file, "--define", "100", "--size", "20", "--run"]);
    assert!(status == 1 && stderr.contains("&1R: ERR"), "{stderr}");
    assert!(!stderr.contains("still runs"), "{stderr}");
    // An abort ends the program in the middle of the stream.
    site.pmacctl(&["abort"]);
    let child = site
        .command(&["rotary", "stream", file, "--size", "20", "--run", "--clear"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut connection = site.connection();
    site.wait_until("a program that runs", || {
        connection.rotary_state(1).is_ok_and(|state| state.sent_lines - state.ahead_lines > 200)
    });
    assert_eq!(site.pmacctl(&["abort"]).0, 0);
    let ran = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&ran.stderr);
    assert!(stderr.contains("sent ^A") && !stderr.contains("still runs"), "{stderr}");
    site.assert_no_violations();
}

#[test]
fn a_board_that_takes_no_more_is_waited_for_and_then_told() {
    let site = running();
    let file = program(&site, 2000);
    let file = file.to_str().unwrap();
    let (status, stdout, stderr) = stream(&site, &[file, "--define", "200", "--timeout", "2"]);
    assert_eq!(status, 1, "{stderr}");
    let [lines, commands, underruns, _] = summary(&stdout);
    assert!(lines > 50.0 && lines < 1000.0 && commands == 2.0 * lines && underruns <= 1.0, "{stdout}");
    let said = stderr.lines().last().unwrap();
    assert!(said.starts_with(&format!("{file}:")) && said.contains("taken nothing for 2 s"), "{said}");
    assert!(said.contains("still in the DPRAM buffer") && said.contains("--clear"), "{said}");
    // The line at which the board stopped is that of the first one it has not taken.
    let state = site.connection().rotary_state(1).unwrap();
    let line = 2 + state.sent_lines - state.ahead_lines;
    assert!(said.starts_with(&format!("{file}:{line}: ")), "{said} {line}");
    assert_eq!(state.sent_lines as f64, lines);
    site.assert_no_violations();
}

/// Runs the stream, sends it `signal` when it is under way, and gives what it said.
fn interrupted(site: &VirtualSite, arguments: &[&str], signal: Signal) -> Output {
    let child = site
        .command(&["rotary", "stream"])
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut connection = site.connection();
    site.wait_until("a full buffer", || connection.rotary_state(1).is_ok_and(|state| state.busy));
    kill(Pid::from_raw(child.id().cast_signed()), signal).unwrap();
    child.wait_with_output().unwrap()
}

#[test]
fn an_interrupted_stream_leaves_whole_lines_and_says_what_is_left() {
    let site = running();
    let file = program(&site, 2000);
    let file = file.to_str().unwrap();
    let output = interrupted(&site, &[file, "--define", "200"], Signal::SIGINT);
    let (stdout, stderr) =
        (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let said = stderr.lines().last().unwrap();
    assert!(said.contains("interrupted; ") && said.contains("of 2000 lines were sent"), "{said}");
    let state = site.connection().rotary_state(1).unwrap();
    assert!(said.contains(&format!("{} of them are still in the DPRAM buffer", state.ahead_lines)), "{said}");
    assert_eq!(summary(&stdout)[0] as u64, state.sent_lines);
    // Nothing follows.
    site.run_for(Duration::from_millis(500));
    assert_eq!(site.connection().rotary_state(1).unwrap().sent_lines, state.sent_lines);
    site.assert_no_violations();
}

#[test]
fn a_killed_stream_stops_within_its_batches_and_the_next_one_starts_over() {
    let site = running();
    let file = program(&site, 2000);
    let file = file.to_str().unwrap();
    interrupted(&site, &[file, "--define", "200"], Signal::SIGKILL);
    site.run_for(Duration::from_secs(1));
    let state = site.connection().rotary_state(1).unwrap();
    assert!(state.sent_lines < 1000, "{state:?}");
    site.run_for(Duration::from_millis(300));
    assert_eq!(site.connection().rotary_state(1).unwrap(), state);
    let short = program(&site, 20);
    let (status, stdout, stderr) = stream(&site, &[short.to_str().unwrap(), "--clear"]);
    assert_eq!(status, 0, "{stdout} {stderr}");
    assert_eq!(site.connection().rotary_state(1).unwrap().sent_lines, 20);
    site.assert_no_violations();
}

#[test]
fn no_question_goes_into_an_open_buffer() {
    let site = running();
    let mut connection = site.connection();
    connection.send("&1DEFINE ROT 100", PATIENCE).unwrap();
    connection.send("I2=1", PATIENCE).unwrap();
    // The daemon would ask the board again after this line, and ask I2 before a panel request.
    site.wait_until("the questions after I2=1", || {
        let before = site.status()["commands"].as_u64();
        site.run_for(Duration::from_millis(500));
        site.status()["commands"].as_u64() == before
    });
    connection.send("I19=1", PATIENCE).unwrap();
    connection.send("OPEN ROT", PATIENCE).unwrap();
    let commands = site.status()["commands"].as_u64().unwrap();
    let error = connection.panel("jog+", &[1]).unwrap_err().to_string();
    assert!(error.contains("did not take the panel request in time"), "{error}");
    site.run_for(Duration::from_millis(500));
    assert_eq!(site.status()["commands"].as_u64().unwrap(), commands, "not one line was sent");
    connection.send("CLOSE", PATIENCE).unwrap();
    site.wait_until("the questions", || site.status()["commands"].as_u64().unwrap() > commands + 3);
    site.assert_no_violations();
}

/// Begins a stream into a buffer of 40 longs for coordinate system 1.
fn small_stream(site: &VirtualSite) -> Connection {
    let mut connection = site.connection();
    let place = RotaryPlace {
        buffer: 1,
        size_longs: Some(40),
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(400),
        ..RotaryPlace::default()
    };
    assert_eq!(connection.rotary_start(place).unwrap().found_lines, 0);
    connection
}

fn sixty_lines() -> Vec<RotaryLine> {
    vec![vec![(0x000E23, 0x500000), (0x000661, 0x980000)]; 60]
}

#[test]
fn a_batch_that_is_not_the_next_one_is_refused_whole() {
    let site = running();
    site.control("fault rotary_stuck on");
    let lines = sixty_lines();
    let mut feed = RotaryFeed::new(small_stream(&site), 1, &lines);
    // Nobody takes anything, and 9 lines fill the buffer.
    let state = feed.step().unwrap().expect("the time is over");
    assert_eq!((state.sent_lines, state.ahead_lines, feed.inside()), (9, 9, 9));
    site.control("fault rotary_stuck off");
    while !feed.is_done() {
        feed.step().unwrap();
    }
    site.wait_until("all of it", || feed.state().unwrap().ahead_lines == 0);
    assert_eq!(feed.state().unwrap().sent_lines, 60);
    site.assert_no_violations();
}

#[test]
fn the_motors_go_where_the_text_says() {
    let site = running();
    let path = site.path("run.pmc");
    let mut text = "LINEAR ABS TM20 TA10 TS0\n".to_owned();
    for step in 1..=100 {
        text += &format!("X{} Y-{}\n", step * 10, step * 2);
    }
    text += "DWELL 50\nX-125 Y40.5\n";
    std::fs::write(&path, text).unwrap();
    let mut board = site.connection();
    let (status, stdout, stderr) =
        stream(&site, &[path.to_str().unwrap(), "--define", "60", "--size", "20", "--run"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.starts_with("lines=103 commands=207 underruns="), "{stdout}");
    let mut position = |motor: &str| board.send(motor, PATIENCE).unwrap()[0].parse::<f64>().unwrap();
    site.wait_until("the last move", || {
        (position("#1P") + 125.0).abs() < 1.0 && (position("#2P") - 40.5).abs() < 1.0
    });
    site.assert_no_violations();
}

#[test]
fn a_buffer_that_runs_empty_is_counted() {
    let site = running();
    let lines = sixty_lines();
    let mut owner = site.connection();
    let place = RotaryPlace {
        buffer: 1,
        size_longs: Some(40),
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(60),
        run: true,
        ..RotaryPlace::default()
    };
    owner.rotary_start(place).unwrap();
    let mut feed = RotaryFeed::new(owner, 1, &lines);
    while !feed.is_done() {
        feed.step().unwrap();
    }
    // Nobody sends any more, and nobody says that there is nothing left to send.
    let before = feed.state().unwrap();
    assert!(before.ahead_lines > 0, "{before:?}");
    site.wait_until("an empty buffer", || feed.state().unwrap().ahead_lines == 0);
    assert_eq!(feed.state().unwrap().underruns, before.underruns + 1);
    assert_eq!(feed.state().unwrap().underruns, before.underruns + 1, "counted once");
    site.assert_no_violations();
}

#[test]
fn the_boards_error_is_passed_on() {
    let site = running();
    let mut owner = site.connection();
    let place = RotaryPlace {
        buffer: 2,
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(400),
        ..RotaryPlace::default()
    };
    owner.rotary_start(place).unwrap();
    // The middle one is no command.
    let lines: Vec<RotaryLine> =
        vec![vec![(0x000E23, 0x500000)], vec![(0x000800, 0)], vec![(0x000E23, 0x500000)]];
    let mut feed = RotaryFeed::new(owner, 2, &lines);
    while !feed.is_done() {
        feed.step().unwrap();
    }
    site.wait_until("the board's error", || feed.state().unwrap().error.is_some());
    assert_eq!(feed.state().unwrap().ahead_lines, 2, "it stopped at the second line");
}

/// The board counts coordinate systems from another number than pmacd writes, so that &2 gets the lines of &1.
#[test]
fn lines_that_the_board_puts_elsewhere_are_noticed_before_r() {
    let site = VirtualSite::running(&["--rotary-cs-base", "0"], &[]);
    site.wait_for_axes();
    site.ask("&2DEFINE ROT 100");
    let path = site.path("moves.pmc");
    std::fs::write(&path, "LINEAR INC TM20\n".to_owned() + &"X1\nX-1\n".repeat(10)).unwrap();
    let file = path.to_str().unwrap();
    let (status, stdout, stderr) = stream(&site, &[file, "--define", "100", "--run"]);
    assert_eq!(status, 1, "{stderr}");
    assert!(stdout.starts_with("lines=21 commands=22 "), "{stdout}");
    assert!(stderr.contains("the board counts 0 lines of the 21 that were put in (&1PR)"), "{stderr}");
    assert!(stderr.contains("coordinate_system_base") && stderr.contains("R was not sent"), "{stderr}");
    assert!(!site.log().contains("&1R\""), "{}", site.log());
    // Without R it is noticed at the end.
    let (status, _, stderr) = stream(&site, &[file]);
    assert_eq!(status, 1, "{stderr}");
    assert!(stderr.contains("the board counts 0 lines of the 21 that were put in (&1PR)"), "{stderr}");
    // What the message names helps.
    let (status, _, stderr) = stream(&site, &[file, "--set", "coordinate_system_base=0", "--run"]);
    assert_eq!(status, 0, "{stderr}");
    site.assert_no_violations();
}
