//! Sequences: one owner at a time, and an end that the daemon carries out whatever becomes of the owner.

use std::process::{Child, Stdio};
use std::time::Duration;

use pmac_dpram::client::command::lines::LinesOptions;
use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::protocol::CallError;
use pmac_dpram::protocol::board::{LineOutcome, RunLinesReply};
use serde_json::{Value, json};

use crate::support::raw::{Raw, call, error_name};
use crate::support::rig::Ran;
use crate::support::{PATIENCE, VirtualSite};

const DOWNLOAD: LinesOptions<'_> =
    LinesOptions { kind: "download", timeout: Duration::from_secs(5), keep_going: false };

fn run(connection: &mut Connection, lines: &[&str]) -> (Vec<RunLinesReply>, RunLinesReply) {
    let mut told = Vec::new();
    let over = connection.run_lines(DOWNLOAD, lines, |reply| {
        told.push(reply.clone());
        true
    });
    (told, over.unwrap())
}

/// Lines of a sequence that does not end with them, over a connection that a test holds.
fn begin(site: &VirtualSite, lines: &[&str]) -> Raw {
    let mut client = Raw::at(&site.socket());
    let mut bytes = call("RunLines", json!({ "kind": "download", "lines": lines, "last": false }));
    let place = bytes.len() - 2;
    bytes.splice(place..place, br#","more":true"#.iter().copied());
    client.send(&bytes);
    for _ in lines {
        assert_eq!(client.receive().unwrap()["continues"], true);
    }
    let rests = client.receive().unwrap();
    assert_eq!((&rests["parameters"]["over"], &rests["parameters"]["line"]), (&json!(false), &Value::Null));
    client
}

/// With a buffer open it would be no question.
#[track_caller]
fn assert_closed(site: &VirtualSite) {
    let answer = || site.connection().send("P5", PATIENCE);
    site.wait_until("the buffer to be closed", || answer().is_ok_and(|lines| lines == ["7"]));
}

#[test]
fn no_sequence_moves_a_motor_that_somebody_holds() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let mut holder = site.connection();
    holder.panel_hold("jog+", &[1]).unwrap();
    let (told, over) = run(&mut site.connection(), &["P5=1", "#1J-", "P5=2"]);
    assert_eq!(over.taken, 1, "{told:?}");
    let failure = told.last().and_then(|reply| reply.failure.as_ref()).unwrap();
    assert_eq!(failure.outcome, LineOutcome::NotSent);
    assert!(failure.message.contains("holds a jog of motor 1"), "{failure:?}");
    holder.panel("jog-stop", &[1]).unwrap();
    assert_eq!(site.ask("P5"), ["1"]);
    site.assert_no_violations();
}

#[test]
fn lines_run_in_order_and_tell_their_replies() {
    let site = VirtualSite::running(&[], &[]);
    let mut connection = site.connection();
    let lines: Vec<String> = (0..300).map(|number| format!("P{number}={number}")).collect();
    let lines: Vec<&str> = lines.iter().map(String::as_str).chain(["P299", "P5 P6"]).collect();
    let (told, over) = run(&mut connection, &lines);
    assert_eq!(told.len(), 302);
    assert!(
        told.iter().zip(0..).all(|(reply, number)| reply.line == Some(number) && reply.taken == number + 1)
    );
    assert_eq!((told[300].lines.as_slice(), told[301].lines.len()), (["299".to_owned()].as_slice(), 2));
    assert_eq!((over.taken, over.notes.len(), over.over, over.line), (302, 0, true, None));
    // The same connection can be used again.
    let (told, over) = run(&mut connection, &["P5=7", "UUU", "P5=8"]);
    let failure = told[1].failure.as_ref().unwrap();
    assert_eq!((failure.outcome, failure.code), (LineOutcome::Refused, Some(3)));
    assert_eq!((told.len(), over.taken), (2, 1));
    assert_eq!(site.ask("P5"), ["7"]);
    site.assert_no_violations();
}

#[test]
fn a_second_sequence_is_refused_with_the_owners_name() {
    let site = VirtualSite::running(&[], &[]);
    let owner = begin(&site, &["P5=7"]);
    let refused = site.connection().run_lines(DOWNLOAD, &["P5=8"], |_| true).unwrap_err();
    let CommandError::Refused(CallError::Refused { reason }) = refused else { panic!("{refused:?}") };
    let uid = nix::unistd::getuid();
    let expected = format!("uid {uid} (pid {}) has run a download for ", std::process::id());
    assert!(reason.contains(&expected) && reason.contains("nothing was sent"), "{reason}");
    assert_eq!(site.ask("P5"), ["7"]);
    drop(owner);
    site.wait_until("the place to be free", || {
        site.connection().run_lines(DOWNLOAD, &["P6=1"], |_| true).is_ok()
    });
}

#[test]
fn the_daemon_closes_what_a_dead_client_has_left_open() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("P5=7");
    drop(begin(&site, &["OPEN PROG 9 CLEAR", "X1", "X2"]));
    assert_closed(&site);
    assert_eq!(site.ask("LIST PROG 9"), ["X1", "X2", "RET"]);
    let log = site.log();
    assert!(log.contains("ends the download") && log.contains("its client is gone"), "{log}");
    site.assert_no_violations();
}

#[test]
fn the_daemon_closes_what_a_silent_client_has_left_open() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("P5=7");
    let mut client = begin(&site, &["OPEN PROG 9 CLEAR", "X1"]);
    // Whoever says that he is there keeps it.
    for _ in 0..4 {
        site.run_for(Duration::from_secs(3));
        client.call("SequenceRenew", json!({}));
        assert_eq!(client.receive().unwrap().get("error"), None);
    }
    site.hold();
    site.run_for(Duration::from_secs(6));
    site.go_on();
    assert_closed(&site);
    assert!(site.log().contains("its client is silent"), "{}", site.log());
    client.call("SequenceRenew", json!({}));
    assert_eq!(error_name(&client.receive().unwrap()), "Refused");
    site.assert_no_violations();
}

#[test]
fn the_daemon_closes_what_is_open_when_it_stops() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("P5=7");
    let _client = begin(&site, &["OPEN PROG 9 CLEAR", "X1"]);
    site.stop_daemon();
    site.start_daemon(&[]);
    site.wait_for_live_servo();
    assert_eq!(site.ask("P5"), ["7"]);
    assert_eq!(site.ask("LIST PROG 9"), ["X1", "RET"]);
    site.assert_no_violations();
}

#[test]
fn a_download_notices_a_reset_between_two_lines() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let lines: String = (0..900).map(|number| format!("P{number}={number}\n")).collect();
    let file = site.file("long.pmc", &lines);
    let child = site.command(&["download", &file]).stderr(Stdio::piped()).spawn().unwrap();
    site.wait_until("the download to run", || site.log().matches("(download) sends \"P").count() > 300);
    site.control("reset");
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let told = ran
        .stderr
        .lines()
        .find(|line| line.contains("reset between line"))
        .unwrap_or_else(|| panic!("{ran:?}"));
    let place = told.strip_prefix(&format!("{file}:")).and_then(|rest| rest.split(':').next());
    let line: u64 = place.unwrap().parse().unwrap();
    assert!((300..900).contains(&line), "{told}");
    assert!(ran.stderr.contains("the board took"), "{ran:?}");
    // One that nothing disturbs is whole.
    site.wait_until("the board to answer", || site.run(&["send", "P1"]).code == Some(0));
    assert_eq!(site.run(&["download", &file]).code, Some(0));
}

/// A restore under way: the site, the file, and `pmacctl`.
fn restore_of_900_lines() -> (VirtualSite, String, Child) {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let lines: String = (0..900).map(|number| format!("P{number}={}\n", number + 1)).collect();
    let file = site.file("long.pmc", &lines);
    let child = site.command(&["restore", &file, "--yes", "--json"]);
    let child = { child }.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    site.wait_until("the restore to run", || site.log().matches("(restore) sends \"P").count() > 300);
    (site, file, child)
}

#[test]
fn a_restore_notices_a_reset_between_two_lines() {
    let (site, file, child) = restore_of_900_lines();
    site.control("reset");
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let told = ran.stderr.lines().find(|line| line.contains("reset between line"));
    let told = told.unwrap_or_else(|| panic!("{ran:?}"));
    let place = told.strip_prefix(&format!("{file}:")).and_then(|rest| rest.split(':').next());
    let line: u64 = place.unwrap().parse().unwrap();
    assert!((280..900).contains(&line), "{told}");
    assert!(ran.stderr.contains("the board took ") && ran.stderr.contains(" of 900 lines"), "{ran:?}");
    let errors = ran.json()["errors"].clone();
    let is_told =
        |error: &Value| error["message"].as_str().is_some_and(|what| what.contains("reset between"));
    assert!(errors.as_array().unwrap().iter().any(is_told), "{errors}");
}

#[test]
fn a_restore_that_the_end_of_pmacd_cuts_short_fails() {
    let (site, file, child) = restore_of_900_lines();
    site.stop_daemon();
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert_ne!(ran.code, Some(0), "{ran:?}");
    assert!(ran.stderr.contains(&format!("{file}:")) && ran.stderr.contains(" of 900 lines"), "{ran:?}");
    assert_eq!(ran.json()["errors"].as_array().map(Vec::len), Some(1), "{ran:?}");
}

#[test]
fn a_download_into_a_program_says_that_a_reset_took_it() {
    // Without servo data, only the board's refusal (ERR005) shows that its buffer is not open any more.
    for before in [None, Some("ENDGATHER")] {
        let site = VirtualSite::running(&[], &[]);
        site.wait_for_identity();
        if let Some(line) = before {
            site.ask(line);
        }
        let file = site.file("long.pmc", &format!("OPEN PROG 55 CLEAR\n{}CLOSE\n", "X1\n".repeat(2000)));
        let child = site.command(&["download", &file]).stderr(Stdio::piped()).spawn().unwrap();
        site.wait_until("the download to run", || site.log().matches("(download) sends \"X1").count() > 300);
        site.control("reset");
        let ran = Ran::from(child.wait_with_output().unwrap());
        assert_eq!(ran.code, Some(1), "{before:?}: {ran:?}");
        assert!(ran.stderr.contains("reset between line"), "{before:?}: {ran:?}");
        assert!(
            ran.stderr.contains("PROG 55, which it opened, is closed: the reset took"),
            "{before:?}: {ran:?}"
        );
        assert!(!ran.stderr.contains("somebody else"), "{before:?}: {ran:?}");
    }
}

#[test]
fn an_abort_ends_a_sequence_that_goes_on_with_further_lines() {
    let site = VirtualSite::running(&[], &[]);
    let mut client = begin(&site, &["P5=7"]);
    let mut board = site.connection();
    board.control(1).unwrap();
    let mut bytes = call("RunLines", json!({ "kind": "download", "lines": ["P5=8", "#1J+"] }));
    let place = bytes.len() - 2;
    bytes.splice(place..place, br#","more":true"#.iter().copied());
    client.send(&bytes);
    let told = client.receive().unwrap();
    let failure = &told["parameters"]["failure"];
    assert_eq!(failure["outcome"], "not_sent", "{told}");
    assert!(failure["message"].as_str().unwrap().contains("aborted by uid"), "{told}");
    assert_eq!(client.receive().unwrap()["parameters"]["over"], true);
    assert_eq!(site.ask("P5"), ["7"]);
    // In the middle of the lines: none follows.
    let lines: String = (0..900).map(|number| format!("P{number}={number}\n")).collect();
    let file = site.file("long.pmc", &lines);
    let child = site.command(&["download", &file]).stderr(Stdio::piped()).spawn().unwrap();
    site.wait_until("the download to run", || site.log().matches("(download) sends \"P").count() > 100);
    board.control(1).unwrap();
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert!(ran.code == Some(1) && ran.stderr.contains("aborted by uid"), "{ran:?}");
    assert_eq!(site.ask("P899"), ["0"]);
}
