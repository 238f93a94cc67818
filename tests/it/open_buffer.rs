//! A program buffer that somebody has open: whose lines enter it, and what everybody else is told.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::Stdio;
use std::time::Duration;

use nix::unistd::{Gid, Uid, getuid};
use pmac_dpram::client::OwnBuffer;
use pmac_dpram::client::command::SendAs;
use pmac_dpram::daemon::socket::policy::{Peer, Role};
use pmac_dpram::protocol::control;
use serde_json::{Value, json};

use crate::support::raw::{Raw, error_name};
use crate::support::rig::Ran;
use crate::support::{PATIENCE, VirtualSite};

const STRANGER: u32 = 4711;

/// A connection of another user, an engineer.
pub fn stranger(site: &VirtualSite) -> Raw {
    let (ours, theirs) = UnixStream::pair().unwrap();
    site.with_world(move |world| {
        let peer = Peer { uid: Uid::from_raw(STRANGER), gid: Gid::from_raw(STRANGER), pid: 99 };
        let now = world.now();
        world.daemon.as_mut().unwrap().server.enter(theirs, peer, Role::Engineer, now).unwrap();
    });
    Raw::over(ours)
}

pub fn call(client: &mut Raw, method: &str, parameters: Value) -> Value {
    client.call(method, parameters);
    client.receive().unwrap()
}

#[track_caller]
fn assert_refused(site: &VirtualSite, arguments: &[&str], who: &str) {
    let ran = site.run(arguments);
    assert_eq!(ran.code, Some(1), "{arguments:?}: {ran:?}");
    assert!(ran.stderr.contains(who) && ran.stderr.contains("not sent"), "{arguments:?}: {}", ran.stderr);
}

#[test]
fn no_sequence_enters_an_open_program_buffer() {
    let site = VirtualSite::running(&[], &[]);
    let file = site.file("file.pmc", "P5=1\n");
    // The end of a one-shot `send` closes nothing.
    for line in ["OPEN PROG 77 CLEAR", "X1"] {
        assert_eq!(site.run(&["send", line]).code, Some(0));
    }
    let who = format!("uid {} (pid ", getuid());
    for arguments in [
        &["download", &file][..],
        &["restore", "--yes", &file],
        &["backup", "--what", "P"],
        &["setup", "--send", "--yes", "enable", "background"],
    ] {
        assert_refused(&site, arguments, &who);
        assert_refused(&site, arguments, "has had PROG 77 open for");
    }
    // His own line by hand enters.
    assert_eq!(site.run(&["send", "Y2"]).code, Some(0));
    assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "Y2", "RET"]);
    assert_eq!(site.run(&["download", &file]).code, Some(0));
    site.assert_no_violations();
}

#[test]
fn no_other_users_line_enters_but_close_and_what_stops_pass() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("OPEN PROG 77 CLEAR");
    let mut client = stranger(&site);
    let refused = call(&mut client, "Send", json!({"line": "X1"}));
    let reason = refused["parameters"]["reason"].as_str().unwrap();
    assert!(reason.contains(&format!("uid {} (pid {})", getuid(), std::process::id())), "{reason}");
    assert_eq!(error_name(&call(&mut client, "Send", json!({"line": "I57"}))), "Refused");
    for character in ["^A", "^K"] {
        assert_eq!(call(&mut client, "SendControl", json!({"character": character})).get("error"), None);
    }
    site.ask("X2");
    assert_eq!(call(&mut client, "Send", json!({"line": "CLOSE"})).get("error"), None);
    assert_eq!(site.ask("LIST PROG 77"), ["X2", "RET"]);
    // Now it is the other user's.
    assert_eq!(call(&mut client, "Send", json!({"line": "OPEN PROG 78 CLEAR"})).get("error"), None);
    assert_refused(&site, &["send", "X3"], "uid 4711 (pid 99) has had PROG 78 open for");
    site.assert_no_violations();
}

#[test]
fn a_question_by_the_way_does_not_even_enter_ones_own_buffer() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("OPEN PROG 77 CLEAR");
    site.ask("X1");
    assert!(site.connection().question("I57", Duration::from_secs(5)).is_err());
    site.ask("CLOSE");
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "RET"]);
    site.assert_no_violations();
}

#[test]
fn a_line_beside_every_buffer_enters_not_even_ones_own_and_opens_none() {
    let site = VirtualSite::running(&[], &[]);
    let mut board = site.connection();
    let mut beside =
        |line| board.send_as(line, PATIENCE, SendAs { into_buffer: Some(false), ..SendAs::default() });
    assert!(beside("OPEN PROG 77").unwrap_err().to_string().contains("opens none either"));
    assert!(beside("P1=5").is_ok());
    site.ask("OPEN PROG 77 CLEAR");
    site.ask("X1");
    for line in ["X2", "P1", "P1=6", "I122"] {
        let told = beside(line).unwrap_err().to_string();
        assert!(told.contains("has had PROG 77 open for"), "{line}: {told}");
    }
    assert!(beside("#1P").is_ok() && beside("#1J/").is_ok() && beside("CLOSE").is_ok());
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "RET"]);
    assert_eq!(beside("P1").unwrap(), ["5"]);
    site.assert_no_violations();
}

#[test]
fn a_programs_lines_enter_its_own_buffer_and_no_other() {
    let site = VirtualSite::running(&[], &[]);
    let (mut connection, mut own) = (site.connection(), OwnBuffer::default());
    let mut send = |line| own.send(&mut connection, line, PATIENCE).map_err(|error| error.to_string());
    assert_eq!(send("P1=1"), Ok(vec![]));
    // The same user's, by hand.
    site.ask("OPEN PROG 77 CLEAR");
    site.ask("X1");
    for line in ["X2", "P1", "P1=2", "I122", "OPEN PROG 9", "P1=2 CLOSE"] {
        let told = send(line).unwrap_err();
        assert!(
            told.starts_with("not sent") && told.contains("has had PROG 77 open") || told.contains("ERR007"),
            "{line}: {told}"
        );
    }
    assert!(send("#1P").is_ok() && send("#1J/").is_ok() && send("CLOSE").is_ok());
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "RET"]);
    for line in ["OPEN PROG 7 CLEAR", "X1", "P1=3", "CLOSE", "P2=4"] {
        assert_eq!(send(line), Ok(vec![]), "{line}");
    }
    assert_eq!(site.ask("LIST PROG 7"), ["X1", "P1=3", "RET"]);
    assert_eq!(site.ask("P1 P2"), ["1", "4"]);
    // Somebody closes it.
    assert_eq!((send("OPEN PROG 7 CLEAR"), send("X5")), (Ok(vec![]), Ok(vec![])));
    site.ask("CLOSE");
    for line in ["P1=5", "X1 CLOSE", "P1"] {
        let told = send(line).unwrap_err();
        assert!(told.contains("carried out at once"), "{line}: {told}");
        assert!(
            line == "X1 CLOSE"
                || told.ends_with("CLOSE, or another OPEN, ends the lines that belong into it"),
            "{told}"
        );
    }
    assert_eq!((send("#1J/"), send("CLOSE"), send("P1")), (Ok(vec![]), Ok(vec![]), Ok(vec!["1".into()])));
    assert_eq!((send("OPEN PROG 7"), send("X6")), (Ok(vec![]), Ok(vec![])));
    site.ask("CLOSE");
    assert!(send("X7").is_err());
    assert_eq!((send("OPEN PROG 8 CLEAR"), send("X8"), send("CLOSE")), (Ok(vec![]), Ok(vec![]), Ok(vec![])));
    assert_eq!(site.ask("LIST PROG 7"), ["X5", "X6", "RET"]);
    assert_eq!(site.ask("LIST PROG 8"), ["X8", "RET"]);
    // The characters do so, too.
    assert!(own.control(&mut connection, control::OPEN_ROTARY).is_err(), "there is no rotary buffer");
    assert_eq!(own.send(&mut connection, "P1", PATIENCE).unwrap(), ["1"]);
    site.ask("&1DEFINE ROT 100");
    own.control(&mut connection, control::OPEN_ROTARY).unwrap();
    assert_eq!(own.send(&mut connection, "X9", PATIENCE).unwrap(), Vec::<String>::new());
    own.control(&mut connection, control::CLOSE_ROTARY).unwrap();
    assert_eq!(own.send(&mut connection, "P1", PATIENCE).unwrap(), ["1"]);
    assert_eq!(site.ask("&1LIST ROT"), ["X9"]);
    site.assert_no_violations();
}

#[test]
fn a_line_that_went_into_a_buffer_which_another_process_opened_is_told_to_its_sender() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let said = |arguments: &[&str]| {
        let ran = site.run(&[&["send"], arguments].concat());
        assert_eq!(ran.code, Some(0), "{arguments:?}: {ran:?}");
        ran.stderr
    };
    assert_eq!(said(&["P20=5"]), "");
    assert_eq!(said(&["OPEN PROG 3 CLEAR"]), "");
    let told = said(&["P20=77"]);
    let uid = getuid();
    assert!(told.starts_with(&format!("note: PROG 3, opened by uid {uid} (pid ")), "{told}");
    let end = "), is open: the program statements of P20=77 went into it and were not carried out; CLOSE closes it\n";
    assert!(told.ends_with(end), "{told}");
    for quiet in ["#1P", "LIST", "^K", "SIZE", "CLOSE"] {
        assert_eq!(said(&[quiet]), "", "{quiet}");
    }
    assert_eq!(
        (site.ask("P20"), site.ask("LIST PROG 3")),
        (vec!["5".into()], vec!["P20=77".into(), "RET".into()])
    );
    site.assert_no_violations();
}

#[test]
fn a_terminal_enters_no_buffer_that_another_process_of_its_user_has_open() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let piped = |text: &str| {
        let mut child = site.command(&["terminal"]);
        let child = child.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        Ran::from(child.wait_with_output().unwrap())
    };
    let ran = piped("OPEN PROG 4 CLEAR\nX1\n#1P\nCLOSE\nP20=6\n");
    assert_eq!((ran.code, &*ran.stderr), (Some(0), ""), "{ran:?}");
    site.ask("OPEN PROG 5 CLEAR");
    site.ask("X5");
    let ran = piped("X1\nP20=8\n#1J/\n#3HM\n");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let refused = "not sent, it would have become a program line: uid";
    assert_eq!(ran.stderr.matches(refused).count(), 2, "{}", ran.stderr);
    assert!(
        ran.stderr.contains("#3HM is no program statement, and MAY have been carried out"),
        "{}",
        ran.stderr
    );
    // `send` has no session: its line goes into the user's own buffer.
    site.ask("X6");
    let ran = piped("CLOSE\nP20=7\n");
    assert_eq!((ran.code, &*ran.stderr), (Some(0), ""), "{ran:?}");
    assert_eq!(
        (site.ask("P20"), site.ask("LIST PROG 5")),
        (vec!["7".into()], vec!["X5".into(), "X6".into(), "RET".into()])
    );
    site.assert_no_violations();
}

#[test]
fn a_buffer_that_the_serial_port_opened_counts() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    // A question of the daemon's that is on its way at this moment would enter.
    site.wait_for_identity();
    let mut serial = UnixStream::connect(site.path("serial")).unwrap();
    serial.write_all(b"OPEN PROG 88 CLEAR\rX1\r").unwrap();
    let file = site.file("file.pmc", "P5=1\n");
    site.run_for(Duration::from_millis(500));
    for arguments in [&["download", &file][..], &["send", "X9"]] {
        assert_refused(&site, arguments, "opened by somebody else (the serial port");
    }
    assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
    assert_eq!(site.ask("LIST PROG 88"), ["X1", "RET"]);
    site.assert_no_violations();
}

#[test]
fn a_close_that_closes_nothing_lets_no_line_enter() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.control("fault close_ignored on");
    let mut serial = UnixStream::connect(site.path("serial")).unwrap();
    serial.write_all(b"OPEN PROG 88 CLEAR\rX1\r").unwrap();
    site.run_for(Duration::from_millis(500));
    let mut board = site.connection();
    board.send("CLOSE", PATIENCE).unwrap();
    let refused = board.send("P5=7", PATIENCE).unwrap_err().to_string();
    assert!(refused.contains("opened by somebody else (the serial port"), "{refused}");
    board.send("CLOSE ALL", PATIENCE).unwrap();
    assert_eq!(board.send("P5", PATIENCE).unwrap(), ["0"]);
    assert_eq!(site.ask("LIST PROG 88"), ["X1", "RET"]);
    site.assert_no_violations();
}

#[test]
fn without_servo_data_the_board_is_asked_for_open_buffers() {
    let site = VirtualSite::new();
    let startup = site.file("startup.pmc", "I58=1\n");
    site.start_simulator(&["--startup", &startup]);
    let mut serial = UnixStream::connect(site.path("serial")).unwrap();
    serial.write_all(b"OPEN PROG 88 CLEAR\rX1\r").unwrap();
    site.run_for(Duration::from_millis(100));
    // Its own questions, at the start and later, enter the buffer as little as others' lines.
    site.start_daemon(&[]);
    site.run_for(Duration::from_secs(3));
    let file = site.file("file.pmc", "P5=1\n");
    for arguments in [&["download", &file][..], &["send", "X9"], &["send", "I57"]] {
        assert_refused(&site, arguments, "opened by somebody else (the serial port");
    }
    assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
    site.wait_for_identity();
    assert_eq!(site.ask("LIST PROG 88"), ["X1", "RET"]);
    // Nobody has told the daemon of this one, and no report does.
    serial.write_all(b"OPEN PROG 89 CLEAR\rX1\r").unwrap();
    site.run_for(Duration::from_secs(1));
    assert_refused(&site, &["send", "X9"], "opened by somebody else");
    serial.write_all(b"X2\rCLOSE\r").unwrap();
    site.run_for(Duration::from_secs(1));
    assert_eq!(site.ask("LIST PROG 89"), ["X1", "X2", "RET"]);
    // A refused OPEN opens nothing.
    assert_eq!(site.run(&["send", "OPEN PROG 99999"]).code, Some(1));
    assert_eq!(call(&mut stranger(&site), "Send", json!({"line": "P5=1"})).get("error"), None);
    assert_eq!(site.ask("P5"), ["1"]);
    site.assert_no_violations();
}

#[test]
fn status_doctor_and_terminal_name_the_open_buffer() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    assert_eq!(site.run(&["status", "--json"]).json()["socket"]["open_buffer"], Value::Null);
    site.ask("OPEN PROG 77 CLEAR");
    let who = format!("PROG 77, opened by uid {} (pid ", getuid());
    assert_eq!(site.run(&["status", "--json"]).json()["socket"]["open_buffer"]["name"], "PROG 77");
    for arguments in [&["status"][..], &["doctor"]] {
        let ran = site.run(arguments);
        assert!(ran.stdout.contains(&who), "{arguments:?}: {}", ran.stdout);
    }
    let terminal = |lines: &[u8]| {
        let mut child = site.command(&["terminal"]);
        child.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = child.spawn().unwrap();
        child.stdin.take().unwrap().write_all(lines).unwrap();
        Ran::from(child.wait_with_output().unwrap())
    };
    let left = terminal(b"#1P\n").stderr;
    assert!(left.contains("PROG 77 is still open") && left.contains("CLOSE"), "{left}");
    assert_eq!(terminal(b"CLOSE\n").stderr, "");
    let mut serial = UnixStream::connect(site.path("serial")).unwrap();
    serial.write_all(b"OPEN PROG 88\r").unwrap();
    site.run_for(Duration::from_millis(100));
    let status = site.run(&["status"]).stdout;
    assert!(status.contains("a program buffer, opened by somebody else (the serial port"), "{status}");
    assert_eq!(terminal(b"#1P\n").stderr, "", "it is not this user's");
    site.assert_no_violations();
}

#[test]
fn a_sequence_whose_buffer_somebody_closed_carries_nothing_out() {
    let site = VirtualSite::running(&[], &[]);
    let file = site.file("long.pmc", &format!("OPEN PROG 9 CLEAR\n{}P5=1\nCLOSE\n", "X1\n".repeat(2000)));
    site.ask("P5=7");
    let mut child = site.command(&["download", &file]);
    let child = child.stderr(Stdio::piped()).spawn().unwrap();
    site.wait_until("the download to run", || site.log().matches("(download) sends \"X1\"").count() > 100);
    assert_refused(&site, &["send", "X5"], "a sequence of uid");
    assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stderr.contains("somebody closed the program buffer"), "{}", ran.stderr);
    assert_eq!(site.ask("P5"), ["7"], "what would have entered the program was not carried out");
    site.assert_no_violations();
}

#[test]
fn the_characters_that_open_and_close_the_rotary_buffers_follow_the_rules_of_lines() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.ask("&1DEFINE ROT 100");
    let mut other = stranger(&site);
    let character = |client: &mut Raw, name: &str| call(client, "SendControl", json!({ "character": name }));
    // Somebody else's program is not disturbed.
    site.ask("OPEN PROG 77 CLEAR");
    let told = character(&mut other, "^U");
    assert!(told["parameters"]["reason"].as_str().unwrap().contains("has had PROG 77 open"), "{told}");
    let told = character(&mut other, "^L");
    let reason = told["parameters"]["reason"].as_str().unwrap();
    assert!(reason.contains("what is open is PROG 77") && reason.contains("nothing was sent"), "{told}");
    site.ask("X1");
    site.ask("CLOSE");
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "RET"]);
    // Who opens the rotary buffers is their owner.
    site.connection().control(control::OPEN_ROTARY).unwrap();
    let open = site.connection().info().unwrap().open_buffer.unwrap();
    assert_eq!((open.name.as_deref(), open.uid), (Some("ROT"), Some(getuid().as_raw())));
    let pid = i32::try_from(std::process::id()).unwrap();
    assert_eq!(open.pid, Some(pid));
    let told = call(&mut other, "Send", json!({ "line": "X5" }));
    assert!(
        told["parameters"]["reason"].as_str().unwrap().contains("would have become a program line"),
        "{told}"
    );
    site.ask("X2");
    site.connection().control(control::CLOSE_ROTARY).unwrap();
    site.wait_until("the buffers to be closed", || site.connection().info().unwrap().open_buffer.is_none());
    assert_eq!(site.ask("&1PR"), ["1"]);
    site.assert_no_violations();
}
