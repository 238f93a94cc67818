//! Commands that are on-line only, while somebody has a program buffer open: the board carries them out at once (User Manual p. 29).

use pmac_dpram::client::Connection;
use serde_json::json;

use crate::open_buffer::{call, stranger};
use crate::support::raw::{self, Raw};
use crate::support::{PATIENCE, VirtualSite};

/// What the board says of motor 1, 2 …: how fast it goes.
fn speed(board: &mut Connection, motor: u32) -> f64 {
    board.send(&format!("#{motor}V"), PATIENCE).unwrap().concat().trim().parse().unwrap()
}

#[track_caller]
fn sent(client: &mut Raw, line: &str) {
    let reply = call(client, "Send", json!({ "line": line }));
    assert_eq!(reply.get("error"), None, "{line}: {reply}");
}

#[test]
fn a_command_that_the_board_carries_out_is_not_told_as_a_program_line() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let said = |line: &str| {
        let ran = site.run(&["send", line]);
        assert_eq!(ran.code, Some(0), "{line}: {ran:?}");
        ran.stderr
    };
    let mut board = site.connection();
    said("OPEN PROG 41 CLEAR");
    assert_eq!(said("#1J+"), "");
    site.wait_until("motor 1 to go", || speed(&mut board, 1) > 1.0);
    assert_eq!(said("#1J/"), "");
    for line in ["#3HM", "&2%50"] {
        let told = said(line);
        assert!(
            told.contains("PROG 41, opened by uid")
                && told.contains(&format!("{line} is no program statement")),
            "{told}"
        );
        assert!(told.contains("MAY have been carried out at once") && !told.contains("were not"), "{told}");
    }
    let told = said("X100 #2J+");
    assert!(
        told.contains("the program statements of X100 #2J+ went into it and were not carried out"),
        "{told}"
    );
    assert!(told.contains("its on-line commands were carried out at once"), "{told}");
    site.wait_until("motor 2 to go", || speed(&mut board, 2) > 1.0);
    let told = said("P1=5");
    assert!(
        told.ends_with(
            "the program statements of P1=5 went into it and were not carried out; CLOSE closes it\n"
        ),
        "{told}"
    );
    said("CLOSE");
    assert_eq!(site.ask("LIST PROG 41"), ["X100", "P1=5", "RET"]);
    site.assert_no_violations();
}

#[test]
fn what_is_on_line_only_passes_while_somebody_else_has_a_buffer_open() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let mut other = stranger(&site);
    for line in ["OPEN PROG 77 CLEAR", "X1"] {
        sent(&mut other, line);
    }
    for arguments in
        [&["send", "#2J+"][..], &["send", "???"], &["send", "#1P"], &["jog", "2", "=100"], &["send", "#1HM"]]
    {
        let ran = site.run(arguments);
        assert_eq!(ran.code, Some(0), "{arguments:?}: {ran:?}");
    }
    let mut board = site.connection();
    assert_eq!(board.question("#2P", PATIENCE).unwrap().len(), 1);
    site.wait_until("motor 2 in its place", || {
        let place: f64 = board.send("#2P", PATIENCE).unwrap().concat().trim().parse().unwrap();
        (place - 100.0).abs() < 1.0
    });
    for (line, why) in [
        ("X2", "would have become a program line"),
        ("I122", "would have become a program line"),
        ("X2 #1J+", "would have become a program line"),
        ("CLEAR", "would change what is open"),
        ("OPEN PROG 78 CLEAR", "would change what is open"),
    ] {
        let ran = site.run(&["send", line]);
        assert!(
            ran.code == Some(1) && ran.stderr.contains(why) && ran.stderr.contains("uid 4711"),
            "{line}: {ran:?}"
        );
    }
    sent(&mut other, "CLOSE");
    assert_eq!(site.ask("LIST PROG 77"), ["X1", "RET"]);
    site.assert_no_violations();
}

#[test]
fn a_reset_or_save_that_ends_the_work_of_others_has_to_be_confirmed() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let file = site.file("reset.pmc", "P1=5\n$$$\n");
    let refused = |arguments: &[&str], whose: &str| {
        let ran = site.run(arguments);
        assert_eq!(ran.code, Some(1), "{arguments:?}: {ran:?}");
        assert!(
            ran.stderr.contains("not sent: ") && ran.stderr.contains("--yes"),
            "{arguments:?}: {}",
            ran.stderr
        );
        assert!(ran.stderr.contains(whose), "{arguments:?}: {}", ran.stderr);
    };
    let mut other = stranger(&site);
    sent(&mut other, "OPEN PROG 77 CLEAR");
    for line in ["$$$", "$$$***", "SAVE"] {
        refused(&["send", line], "PROG 77, opened by uid 4711 (pid 99)");
    }
    refused(&["download", &file], "PROG 77, opened by uid 4711 (pid 99)");
    assert_eq!(site.run(&["send", "--yes", "SAVE"]).code, Some(0));
    // One's own buffer is one's own affair.
    sent(&mut other, "SAVE");
    sent(&mut other, "CLOSE");
    assert_eq!(site.run(&["send", "SAVE"]).code, Some(0));
    // A sequence of lines.
    let mut bytes = raw::call("RunLines", json!({"kind": "download", "lines": ["P1=1"], "last": false}));
    let place = bytes.len() - 2;
    bytes.splice(place..place, br#","more":true"#.iter().copied());
    other.send(&bytes);
    while other.receive().unwrap()["continues"] == true {}
    refused(&["send", "$$$"], "the download of uid 4711 (pid 99)");
    assert_eq!(site.run(&["send", "--yes", "$$$"]).code, Some(0));
    site.assert_no_violations();
}

#[test]
fn what_somebody_else_addresses_takes_no_line_to_another_rotary_buffer() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    for line in ["&2DEFINE ROT 100", "&1DEFINE ROT 100", "&1", "OPEN ROT", "X1"] {
        site.ask(line);
    }
    let mut other = stranger(&site);
    for line in ["&2%50", "&2?", "&2%100"] {
        sent(&mut other, line);
        site.ask("X2");
    }
    // What he addressed he says with his line.
    assert_eq!(call(&mut other, "Send", json!({ "line": "&2%" }))["parameters"]["lines"], json!(["100"]));
    site.ask("X3");
    // A stop does not wait for what is addressed: where nobody knows that, no line is taken elsewhere.
    site.ask("&1");
    sent(&mut other, "&2A");
    let ran = site.run(&["send", "X4"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("begin the line with the address"), "{ran:?}");
    for line in ["&1X4", "X5", "CLOSE"] {
        site.ask(line);
    }
    assert_eq!(site.ask("&1LIST ROT"), ["X1", "X2", "X2", "X2", "X3", "X4", "X5"]);
    assert!(site.ask("&2LIST ROT").is_empty());
    site.assert_no_violations();
}

#[test]
fn a_computed_number_of_an_i_variable_ends_no_command_lines_unless_confirmed() {
    let site = VirtualSite::running(&[], &[]);
    for line in ["I(57+1)=0", "I(50)..60=0", "I(29*2)=P1"] {
        let ran = site.run(&["send", line]);
        assert!(ran.code == Some(1) && ran.stderr.contains("ends command lines"), "{line}: {ran:?}");
    }
    site.ask("P1=58");
    let ran = site.run(&["send", "I(P1)=0"]);
    assert!(
        ran.code == Some(1) && ran.stderr.contains("whose number the board alone can compute"),
        "{ran:?}"
    );
    site.ask("P1=1122");
    assert_eq!(site.run(&["send", "--yes", "I(P1-1000)=33"]).code, Some(0));
    // A program has such lines, and sets nothing at once.
    let file = site.file("program.pmc", "OPEN PROG 7 CLEAR\nI(P1)=0\nCLOSE\n");
    assert_eq!(site.run(&["download", &file]).code, Some(0));
    assert_eq!(
        (site.ask("LIST PROG 7"), site.ask("I122")),
        (vec!["I(P1)=0".into(), "RET".into()], vec!["33".into()])
    );
    site.assert_no_violations();
}
