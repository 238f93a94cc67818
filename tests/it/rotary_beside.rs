//! What others do on a board while a rotary stream goes: `OPEN BINARY ROTARY` shuts nobody out, `OPEN ROT` does.

use std::io::Write;
use std::os::unix::net::UnixStream;

use pmac_dpram::client::{RotaryFeed, RotaryLine, RotaryPlace};
use serde_json::Value;

use crate::support::VirtualSite;

/// Moves by one and back, for longer than any test here.
fn lines() -> Vec<RotaryLine> {
    (0..4000).map(|line| vec![(0x00_0E22 + line % 2, 0x50_0000)]).collect()
}

fn place() -> RotaryPlace {
    RotaryPlace {
        buffer: 1,
        size_longs: Some(40),
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(100),
        run: true,
        modes: vec!["ABS(X)".to_owned()],
        ..RotaryPlace::default()
    }
}

fn running(family: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--family", family], &format!("family = {family:?}\n"));
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J/"]).0 == 0);
    site.ask("&1 #1->X");
    site
}

/// Begins a stream, and feeds it until its program runs.
fn streaming<'a>(site: &VirtualSite, lines: &'a [RotaryLine]) -> RotaryFeed<'a> {
    let mut owner = site.connection();
    owner.rotary_start(place()).unwrap();
    let mut feed = RotaryFeed::new(owner, 1, lines);
    site.wait_until("a program that runs", || {
        feed.step().unwrap();
        site.log().contains("sends \"&1R\"")
    });
    feed
}

#[test]
fn lines_gathers_and_jogs_of_others_go_on_while_a_binary_stream_goes() {
    for (family, flag) in [("pmac", 1 << 6), ("turbo2", 1 << 20)] {
        let site = running(family);
        let lines = lines();
        let mut feed = streaming(&site, &lines);
        assert!(site.log().contains("sends \"&1ABS(X)\""), "{}", site.log());
        let second = u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap();
        assert_eq!(second & (0b111 << 17 | flag), flag, "{family}: {second:06X}");
        // A question would be a line of the program, and an assignment, where text was let in.
        for (line, reply) in [("P5=7", &[][..]), ("P5", &["7"]), ("#2J+", &[]), ("#2J/", &[])] {
            assert_eq!(site.ask(line), reply, "{family} {line}");
        }
        let gathered = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.1", "-o", "-"]);
        assert!(
            gathered.code == Some(0) || gathered.stderr.contains("DEFINE GATHER"),
            "{family}: {gathered:?}"
        );
        // The board itself refuses a line that only a program can have.
        let refused = site.run(&["send", "X10"]);
        assert!(refused.code == Some(1) && refused.stderr.starts_with("ERR005"), "{family}: {refused:?}");
        let file = site.file("other.pmc", "OPEN PROG 9 CLEAR\nX1\nCLOSE\n");
        let download = site.run(&["download", &file]);
        assert_eq!(download.code, Some(1));
        assert!(download.stderr.contains("has had BINARY ROTARY open"), "{family}: {download:?}");
        // Nobody is told that a program buffer is open.
        let status: Value = site.run(&["status", "--json"]).json();
        assert!(status["socket"]["open_buffer"].is_null(), "{status}");
        for _ in 0..20 {
            feed.step().unwrap();
        }
        assert_eq!(feed.stop().unwrap().reason, None, "{family}: it has gone on");
        let second = u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap();
        assert_eq!(second & flag, 0, "{family}: closed");
        site.assert_no_violations();
    }
}

#[test]
fn a_board_without_binary_entry_is_streamed_to_by_open_rot_which_shuts_others_out() {
    let site = running("pmac");
    site.control("fault no_binary_rotary on");
    let lines = lines();
    let mut feed = streaming(&site, &lines);
    let log = site.log();
    let [binary, text] =
        ["OPEN BINARY ROTARY", "OPEN ROT"].map(|line| log.find(&format!("sends {line:?}")).unwrap());
    assert!(binary < text, "{log}");
    let refused = site.run(&["send", "P5=7"]);
    assert!(refused.code == Some(1) && refused.stderr.contains("has had ROT open"), "{refused:?}");
    assert_eq!(site.ask("#1P").len(), 1, "what is on-line only goes");
    assert_eq!(feed.stop().unwrap().reason, None);
    assert_eq!(site.ask("I57"), ["0"]);
    site.assert_no_violations();
}

#[test]
fn a_second_stream_does_not_switch_the_first_ones_transfer_off() {
    let site = running("pmac");
    let lines = lines();
    let mut feed = streaming(&site, &lines);
    let other = RotaryPlace { buffer: 2, coordinate_system: 2, define_longs: None, ..place() };
    let error = site.connection().rotary_start(other).unwrap_err().to_string();
    assert!(error.contains("the board has one rotary stream at a time: uid"), "{error}");
    for _ in 0..20 {
        feed.step().unwrap();
    }
    assert_eq!(feed.stop().unwrap().reason, None);
}

#[test]
fn a_turbo_board_whose_binary_entry_somebody_left_open_is_not_set_up() {
    let site = running("turbo2");
    site.ask("&1DEFINE ROT 100");
    UnixStream::connect(site.path("serial")).unwrap().write_all(b"OPEN BINARY ROTARY\r").unwrap();
    site.wait_until("binary entry", || {
        u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap() >> 20 & 1 == 1
    });
    let start = || site.connection().rotary_start(RotaryPlace { define_longs: None, ..place() });
    let error = start().unwrap_err().to_string();
    assert!(
        error.contains("by another host or by a pmacd that was killed") && error.contains("CLOSE"),
        "{error}"
    );
    site.ask("CLOSE");
    start().unwrap();
}

/// The modes that a client gives are nothing else.
#[test]
fn no_other_line_goes_before_a_stream() {
    let site = running("pmac");
    for modes in [vec!["X10"], vec!["ABS &2INC"], vec!["#1J+"], vec!["ABS INC"], vec![""], vec!["ABS"; 17]] {
        let modes = modes.into_iter().map(str::to_owned).collect();
        let error = site.connection().rotary_start(RotaryPlace { modes, ..place() }).unwrap_err().to_string();
        assert!(error.contains("ABS, INC or FRAX each, 16 at most"), "{error}");
    }
    assert!(!site.log().contains("DEFINE"), "nothing was sent");
}

/// Between two looks of the stream there is time for both.
#[test]
fn a_close_and_an_open_of_somebody_else_leave_no_stream_that_feeds_on() {
    for family in ["pmac", "turbo2"] {
        let site = running(family);
        let lines = lines();
        let mut feed = streaming(&site, &lines);
        for line in ["CLOSE", "OPEN ROT"] {
            assert_eq!(site.run(&["send", line]).code, Some(0), "{family} {line}");
        }
        site.wait_until("the stream's end", || site.log().contains("ends the rotary stream"));
        let reason = feed.stop().unwrap().reason.unwrap_or_default();
        assert!(reason.contains("closed the rotary buffers"), "{family}: {reason}");
        assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
        // Where the buffer was open before the daemon could end the program, the end comes behind this CLOSE.
        site.wait_until("the program's end", || site.log().contains("(rotary stream) sends \"&1Q\""));
    }
}

/// On a Turbo board a line with an address would be one for everybody.
#[test]
fn a_stream_leaves_alone_what_others_have_addressed() {
    let site = running("turbo2");
    let lines = lines();
    let mut feed = streaming(&site, &lines);
    site.ask("&2");
    for _ in 0..20 {
        feed.step().unwrap();
        site.run_for(std::time::Duration::from_millis(100));
    }
    assert_eq!(site.ask("&"), ["2"]);
    assert_eq!(feed.stop().unwrap().reason, None);
}
