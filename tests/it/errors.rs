//! Errors of the board: how soon they are told, and whose they are.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::time::Duration;

use pmac_dpram::client::CommandError;
use pmac_dpram::protocol::CallError;

use crate::support::{PATIENCE, VirtualSite};

/// Virtual seconds that a line takes, on the average.
fn seconds(site: &VirtualSite, line: &str) -> f64 {
    const TIMES: u32 = 20;
    let mut connection = site.connection();
    let now = || site.with_world(|world| world.now_ns());
    let begun = now();
    for _ in 0..TIMES {
        let _ = connection.send(line, PATIENCE);
    }
    (now() - begun) as f64 / 1e9 / f64::from(TIMES)
}

#[test]
fn an_error_is_told_as_soon_as_a_value_where_no_program_can_have_made_it() {
    for family in ["pmac", "turbo2"] {
        let site = VirtualSite::configured(&["--family", family], &format!("family = \"{family}\"\n"));
        site.wait_for_live_servo();
        site.wait_for_identity();
        site.run_for(Duration::from_secs(1));
        let [value, error] = ["P1", "LIST PROG 99"].map(|line| seconds(&site, line));
        println!("{family}: a value {:.2} ms, an error {:.2} ms", value * 1e3, error * 1e3);
        assert!(error < 1.5 * value + 0.001, "{family}: a value takes {value} s, an error {error} s");
        site.assert_no_violations();
    }
}

#[test]
fn beside_a_program_that_fails_every_line_has_its_own_reply_and_error() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    let mut board = site.connection();
    // ERR005, now and then.
    for line in
        ["OPEN PLC 1 CLEAR", "P100=P100+1", "IF(P100>12)", "CMD\"X10\"", "P100=0", "ENDIF", "CLOSE", "I5=2"]
    {
        board.send(line, PATIENCE).unwrap();
    }
    board.send("ENABLE PLC 1", PATIENCE).unwrap();
    let (mut refused, mut unsettled) = (0, 0);
    for round in 0..300 {
        assert_eq!(board.send(&format!("P1={round}"), PATIENCE).unwrap(), [""; 0], "{round}");
        assert_eq!(board.send("P1 P1", PATIENCE).unwrap(), [round.to_string(), round.to_string()]);
        match board.send("XYZZY", PATIENCE).unwrap_err() {
            CommandError::Refused(CallError::Board { code: 3, .. }) => refused += 1,
            // An error of a program came beside that of the line.
            CommandError::Refused(CallError::Interrupted { reason }) => {
                assert!(reason.contains("ERR00"), "{reason}");
                unsettled += 1;
            }
            error => panic!("{error:?}"),
        }
    }
    println!("{refused} refused, {unsettled} of which it is not known");
    assert!(refused > 100 && site.log().contains("error of a program of the board: ERR005"));
    site.assert_no_violations();
}

#[test]
fn a_command_of_a_program_that_the_board_refuses_is_told() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let mut terminal = site.command(&["terminal"]);
    let mut child =
        terminal.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut replies = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut told = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    // By then it listens.
    child.stdin.as_mut().unwrap().write_all(b"P1\n").unwrap();
    assert_eq!(replies.next().unwrap(), "0");
    let mut board = site.connection();
    for line in ["OPEN PROG 1 CLEAR", "CMD\"BAD!\"", "CLOSE", "&1 #1->X", "&1B1R"] {
        board.send(line, PATIENCE).unwrap();
    }
    assert_eq!(told.next().unwrap(), "-- error of a program: ERR003");
    site.wait_until("a line in the log", || {
        site.log().contains(
            "error of a program of the board: ERR003: data error or unrecognized command; a CMD in it was refused",
        )
    });
    drop(child.stdin.take());
    child.wait().unwrap();
    site.assert_no_violations();
}

#[test]
fn what_has_to_come_first_is_told_with_the_error() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    for (line, told) in [
        ("OPEN ROT", "DEFINE ROT comes before"),
        ("&1 define lookahead 100,10", "DELETE GATHER comes before"),
    ] {
        site.ask("DEFINE GATHER 100");
        let ran = site.run(&["send", line]);
        assert!(ran.code == Some(1) && ran.stderr.contains(told), "{ran:?}");
    }
    site.assert_no_violations();
}
