//! Command lines: what goes to the board, what comes back, and in which form.

use std::io::Write;
use std::process::Stdio;

use super::site::{Site, get_response, listening, packet, wait_until};

#[test]
fn a_reply_has_the_modules_form_and_comes_in_one_piece() {
    let site = Site::new(&[]);
    let mut client = site.client();
    assert_eq!(client.line("P1=25 P2=50"), "\x06");
    assert_eq!(client.line("P1..2"), "25\r50\r\x06");
    assert_eq!(client.line("P1\r\n"), "25\r\x06");
    assert_eq!(client.line(""), "\x06");
    assert_eq!(client.line("P1 #99"), "25\r\x07ERR003\r", "an error has no ACK behind it");
    assert_eq!(client.line("VER"), "1.16D\r\x06");
    assert_eq!(site.ask("P2"), ["50"], "it is the same board");
}

#[test]
fn a_line_is_sent_first_and_its_reply_fetched_later() {
    let site = Site::new(&[]);
    let mut client = site.client();
    client.line("P1=25 P2=50");
    assert_eq!(client.request(0xC0, 0xC2, 0, 2), [0, 0], "nothing is ready");
    assert_eq!(client.get_buffer(), [0]);
    assert_eq!(client.ask(&packet(0x40, 0xB0, 0, 0, 5, b"P1 P2")), b"@");
    wait_until("the reply", || client.request(0xC0, 0xC2, 0, 2) == [1, 0]);
    assert_eq!(client.request(0xC0, 0xB1, 0, 0), b"25\r");
    assert_eq!(client.get_buffer(), b"50\r\x06");
    client.ask(&packet(0x40, 0xB0, 0, 0, 3, b"UUU"));
    assert_eq!(client.request(0x40, 0xB3, 500, 0), b"@", "FLUSH");
    assert_eq!(client.get_buffer(), [0]);
}

#[test]
fn i3_i4_and_i6_are_each_clients_own() {
    let site = Site::new(&[]);
    let before = site.ask("I3..6");
    let (mut one, mut two) = (site.client(), site.client());
    assert_eq!(one.line("i6=0 i3=0 i4=0 P1=7"), "\0");
    assert_eq!(two.line("P1 i3 i6"), "7\r2\r1\r\x06");
    assert_eq!(one.line("P1 i3 i6"), "7\r0\r0\r");
    assert_eq!(one.line("UUU"), "\x07");
    assert_eq!(two.line("i3=5"), "\x07ERR003\r");
    // Check sums, of which nobody knows how they are fetched.
    assert_eq!(two.line("i4=1"), "\x07ERR003\r");
    assert_eq!(two.line("i4"), "0\r\x06");
    let range = two.line("i0..9");
    let lines: Vec<&str> = range.trim_end_matches('\x06').split_terminator('\r').collect();
    assert_eq!((lines.len(), lines[3], lines[4], lines[6]), (10, "2", "0", "1"));
    assert_eq!(site.ask("I3..6"), before, "the board's are as they were");
}

#[test]
fn a_long_reply_comes_in_parts_that_are_fetched() {
    let site = Site::new(&[]);
    let mut client = site.client();
    client.line("P0..499=123456");
    let mut whole = client.ask(&get_response("P0..499"));
    assert_eq!(whole.len(), 1400);
    while whole.last() != Some(&6) {
        let part = client.get_buffer();
        assert!(part != [0], "{} bytes", whole.len());
        whole.extend(part);
    }
    assert_eq!(whole, ["123456\r".repeat(500).as_bytes(), b"\x06"].concat());
}

#[test]
fn control_characters_go_their_own_way() {
    let site = Site::new(&[]);
    let mut client = site.client();
    assert_eq!(client.line("#1J+"), "\x06");
    wait_until("motion", || client.line("#1V") != "0\r\x06");
    assert_eq!(client.line("\x0b"), "\x06", "^K as a line");
    let reports = client.request(0xC0, 0xC4, 2, 0);
    assert!(reports.len() > 50 && reports.ends_with(b"\r"), "^B: {reports:?}");
    assert_eq!(client.request(0xC0, 0xC4, 1, 0), [0], "^A answers nothing");
    assert_eq!(client.request(0xC0, 0xC4, 26, 0), b"\x07ERR001\r", "^Z takes the port away from everybody");
    assert_eq!(client.request(0xC0, 0xC4, 99, 0), b"\x07ERR004\r");
    let peer = client.stream.local_addr().unwrap();
    wait_until("the last line of the log", || site.log("pmac-gateway").contains("has this number"));
    let log = site.log("pmac-gateway");
    for line in [format!("{peer}: #1J+"), format!("{peer}: ^K"), format!("{peer}: ^A")] {
        assert_eq!(log.matches(&line).count(), 1, "{line}: {log}");
    }
    assert!(!log.contains("#1V"), "{log}");
}

#[test]
fn what_starts_programs_is_logged_with_who_sent_it() {
    let site = Site::of("turbo2", &[]);
    let mut client = site.client();
    let peer = client.stream.local_addr().unwrap();
    let starts = ["ENABLE PLC 3", "ena plc 4,5", "ENABLE PLCC 1", "RESUME PLC 3", "OPEN ROT"];
    for line in ["OPEN PLC 3 CLEAR", "P1=1", "CLOSE", "DISABLE PLC 4", "&1DEFINE ROT 100"] {
        assert_eq!(client.line(line), "\x06", "{line}");
    }
    for line in starts.iter().chain(&["X1", "X2", "CLOSE"]) {
        client.line(line);
    }
    client.line("#1J/");
    wait_until("the last line of the log", || site.log("pmac-gateway").contains("#1J/"));
    let log = site.log("pmac-gateway");
    let logged: Vec<&str> =
        log.lines().filter_map(|line| line.split_once(&format!("{peer}: "))).map(|(_, told)| told).collect();
    assert_eq!(logged, starts.iter().copied().chain(["#1J/"]).collect::<Vec<_>>(), "{log}");
}

#[test]
fn a_clients_motor_is_his_own() {
    let site = Site::new(&[]);
    let (mut one, mut two) = (site.client(), site.client());
    one.line("#2");
    two.line("#1");
    assert_eq!(one.line("J+"), "\x06");
    assert_eq!(site.ask("#"), ["2"], "the board was told whom the line means");
    assert_eq!(two.line("#"), "1\r\x06", "and the other client's is as it was");
    one.line("K");
    assert_eq!(two.line("J+"), "\x06");
    assert_eq!(site.ask("#"), ["1"]);
    two.line("K");
}

#[test]
fn too_long_a_line_goes_in_parts_or_is_refused() {
    let site = Site::new(&[]);
    let mut client = site.client();
    let poll: String =
        (1..=8).map(|motor| format!("#{motor}?PVF m{motor}90 p{motor}99 p1 p2 p3 p4")).collect();
    assert!(poll.len() > 200);
    let answer = client.line(&poll);
    assert_eq!((answer.matches('\r').count(), answer.ends_with("\r\x06")), (80, true), "{answer}");
    let sets: String = (1..=60).map(|number| format!("P{number}={number} ")).collect();
    assert_eq!(client.line(&sets), "\x06");
    assert_eq!(site.ask("P1 P60"), ["1", "60"]);
    assert_eq!(client.line(&("P1=7 ".repeat(60) + "#1J/")), "\x07ERR006\r");
    assert_eq!(client.line(&format!("P7=1{}", "0".repeat(250))), "\x07ERR006\r");
    assert_eq!(site.ask("P1 P7"), ["1", "7"], "nothing of them was sent");
}

#[test]
fn too_long_a_write_of_memory_arrives_whole_and_is_acknowledged_once() {
    let site = Site::of("turbo2", &[]);
    let mut client = site.client();
    // As the EPICS driver writes the points of a trajectory.
    let points: Vec<String> = (1..=17).map(|point| format!("${point:012X}")).collect();
    let line = format!("WL:$C5FC,{}", points.join(","));
    assert!((230..255).contains(&line.len()), "{}", line.len());
    assert_eq!(client.line(&line), "\x06");
    assert_eq!(client.get_buffer(), [0], "one line, one answer");
    let read = client.line("RHL:$C5FC,9 RHL:$C605,8");
    let words: Vec<u64> = read
        .trim_end_matches('\x06')
        .split_ascii_whitespace()
        .map(|word| u64::from_str_radix(word, 16).unwrap())
        .collect();
    assert_eq!(words, (1..=17).collect::<Vec<u64>>(), "{read}");
    // Its second row reaches behind the memory: an error, and the log says that the first is written.
    let line = format!("WL:$7FFF3,{}", points.join(","));
    assert_eq!(client.line(&line), "\x07ERR003\r");
    wait_until("the log to say so", || {
        let log = site.log("pmac-gateway");
        log.contains("the board refused \"WL:$80000,")
            && log.contains("what stands before it in its line is done")
    });
}

#[test]
fn a_program_buffer_is_its_openers_and_is_closed_with_him() {
    let site = Site::new(&[]);
    let (mut one, mut two) = (site.client(), site.client());
    one.line("P1=5");
    assert_eq!(one.line("OPEN PROG 7 CLEAR"), "\x06");
    assert_eq!(one.line("P1=9"), "\x06");
    assert_eq!(two.line("P1"), "\x07ERR001\r", "not into somebody's program");
    assert_eq!(two.line("OPEN PROG 8"), "\x07ERR007\r");
    assert_eq!(two.line("CLOSE"), "\x07ERR007\r");
    // Longer than pmacd waits for a client that says nothing.
    std::thread::sleep(std::time::Duration::from_secs(6));
    assert_eq!(one.line("X10"), "\x06");
    assert_eq!(one.line("UUU"), "\x07ERR003\r");
    assert_eq!(one.line("CLOSE"), "\x06");
    assert_eq!(two.line("P1"), "5\r\x06");
    assert_eq!(two.line("LIST PROG 7"), "P1=9\rX10\rRET\r\x06");
    assert_eq!(one.line("OPEN PROG 8 CLEAR"), "\x06");
    drop(one);
    wait_until("the buffer to be closed", || two.line("P1") == "5\r\x06");
    assert_eq!(two.line("OPEN PROG 9 CLEAR"), "\x06");
}

#[test]
fn no_clients_line_enters_a_buffer_that_was_opened_beside_the_gateway() {
    let site = Site::new(&[]);
    let mut reading = site.another_gateway(&["--read-only"]).stderr(Stdio::piped()).spawn().unwrap();
    let (mut reader, _log) = listening(&mut reading);
    let mut client = site.client();
    for line in ["P1=5", "OPEN PROG 9 CLEAR", "X5"] {
        site.ask(line);
    }
    for line in ["P1", "I122", "Q1 M1"] {
        assert_eq!(reader.line(line), "\x07ERR001\r", "{line}");
        assert_eq!(client.line(line), "\x07ERR001\r", "{line}");
    }
    for line in ["X6", "P1=6"] {
        assert_eq!(client.line(line), "\x07ERR001\r", "{line}");
    }
    assert_eq!(client.line("OPEN PROG 8"), "\x07ERR007\r");
    assert_eq!(reader.line("#1P"), "0\r\x06", "it stores nothing");
    assert_eq!(client.line("#1J/"), "\x06");
    site.ask("CLOSE");
    assert_eq!(site.ask("LIST PROG 9"), ["X5", "RET"]);
    assert_eq!(reader.line("P1"), "5\r\x06");
    reading.kill().unwrap();
    reading.wait().unwrap();
}

#[test]
fn lines_are_written_together_until_one_is_refused() {
    let site = Site::new(&[]);
    let mut client = site.client();
    let mut write = |lines: &str| {
        let length = u16::try_from(lines.len()).unwrap();
        client.ask(&packet(0x40, 0xC6, 0, 0, length, lines.as_bytes()))
    };
    assert_eq!(write("OPEN PROG 7 CLEAR\0X1\0Y2\0CLOSE\0P5=1\0"), [0; 4]);
    assert_eq!(write("P5=2\0UUU\0P5=3\0"), [2, 0, 3, 0x80]);
    assert_eq!(write(&"P5=4\0".repeat(250)), [0, 0, 6, 0x80]);
    assert_eq!(client.request(0xC0, 0xC7, 0, 4), [0, 0, 6, 0x80]);
    assert_eq!(client.line("P5"), "2\r\x06");
    assert_eq!(client.line("LIST PROG 7"), "X1\rY2\rRET\r\x06");
}

#[test]
fn who_only_reads_changes_nothing() {
    let site = Site::of("turbo", &["--read-only", "--version-as", "1.94"]);
    let before = site.ask("I3..6");
    let mut client = site.client();
    assert_eq!(client.line("i6=1 i3=2 ver"), "1.94\r\x06");
    for line in ["#1J+", "P1=5", "I3=P1", "OPEN PROG 1", "&1B1R", "#1K", "SAVE", "\x0b", "P1 #1J/"] {
        let code = if line == "I3=P1" { "003" } else { "002" };
        assert_eq!(client.line(line), format!("\x07ERR{code}\r"), "{line:?}");
    }
    assert!(client.line("#1?PVF P1").ends_with("\r\x06"));
    assert_eq!(client.request(0xC0, 0xC4, 11, 0), b"\x07ERR002\r", "^K");
    assert!(client.request(0xC0, 0xC4, 16, 0).ends_with(b"\r"), "^P");
    assert_eq!(client.ask(&packet(0x40, 0xC6, 0, 0, 5, b"P1=5\0")), [1, 0, 2, 0x80]);
    for (request, value, data) in [(0xB5, 0x1100, &[1, 2][..]), (0xB6, 11, &[])] {
        let length = u16::try_from(data.len()).unwrap();
        assert_eq!(
            site.client().ask(&packet(0x40, request, value, 0, length, data)),
            [0; 0],
            "{request:02X}"
        );
    }
    assert_eq!((site.ask("I3..6"), site.ask("P1")), (before, vec!["0".to_owned()]));
    assert!(!site.log("pmac-gateway").contains("J+"), "nothing has moved");
}

#[test]
fn a_refusal_that_a_client_would_not_notice_ends_its_connection_alone() {
    let site = Site::of("turbo2", &[]);
    let mut client = site.client();
    let owned = packet(0xC0, 0xB5, 0x006A, 0, 2, &[1, 2]);
    let refused = [
        (packet(0x40, 0xCB, 1, 0, 3, b"abc"), "FirmwareDownload is always refused"),
        (packet(0x40, 0xE0, 0, 0, 4, &[10, 0, 0, 1]), "IpAddress is always refused"),
        (packet(0x40, 0xBE, 0, 0, 0, &[]), "Port is always refused"),
        (packet(0xC0, 0xBE, 0, 0, 1, &[]), "Port is always refused"),
        (packet(0x40, 0xB6, 0x15, 0, 0, &[]), "a buffer is a client's own only if"),
        (owned, "0x006A (X:$06001A) belongs to the servo area"),
    ];
    for (request, why) in refused {
        let mut refused = site.client();
        let peer = refused.stream.local_addr().unwrap();
        assert_eq!(refused.ask(&request), [0; 0], "{why}");
        wait_until("the log to say why, once", || {
            let log = site.log("pmac-gateway");
            let mut told = log.lines().filter(|line| line.contains(&peer.to_string()));
            told.next().is_some_and(|line| line.contains(why)) && told.next().is_none()
        });
    }
    // `pmacctl status` says it, too; of many at once the first.
    wait_until("a note", || {
        let notes = site.connection().info().unwrap().notes;
        notes
            .first()
            .is_some_and(|note| note.contains("his connection ends: FirmwareDownload is always refused"))
    });
    assert_eq!(client.line("P0"), "0\r\x06");
    let mut other = site.client();
    other.stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    assert!(other.is_ended());
    assert_eq!(client.line("P0"), "0\r\x06");
}

#[test]
fn what_only_looks_runs_no_program() {
    let site = Site::new(&["--read-only"]);
    let mut client = site.client();
    for line in ["&1RP1", "&1RF100", "&1RH1", "&1RHP1", "&1RDP1", "&1RD0", "R", "&1R P1"] {
        assert_eq!(client.line(line), "\x07ERR002\r", "{line}");
    }
    for line in ["RX$770", "RHY$770", "RL:$10", "RY$28,2", "RL$10"] {
        assert!(client.line(line).ends_with("\r\x06"), "{line}");
    }
}

#[test]
fn a_buffer_is_opened_by_a_line_and_by_no_character() {
    let site = Site::new(&[]);
    let (mut one, mut two) = (site.client(), site.client());
    for character in [0x15, 0x0C] {
        assert_eq!(one.request(0xC0, 0xC4, character, 0), b"\x07ERR001\r");
        assert_eq!(
            site.client().request(0x40, 0xB6, character, 0),
            [0; 0],
            "its answer has no room for an error"
        );
    }
    assert_eq!(two.line("P1=4 P1=P1+1"), "\x06");
    assert_eq!(site.ask("P1"), ["5"]);
}

#[test]
fn what_is_not_understood_goes_to_whom_the_client_addresses() {
    let site = Site::new(&[]);
    let (mut one, mut two) = (site.client(), site.client());
    one.line("&2");
    two.line("&1?");
    assert_eq!(one.line("#3->100X"), "\x06");
    assert_eq!(site.ask("&2#3->"), ["100X"]);
    one.line("#1");
    one.line("DISABLE PLC 5 #2");
    two.line("#4P");
    assert_eq!(one.line("J="), "\x06");
    assert!(site.log("pmacd").contains("#2J="), "{}", site.log("pmacd"));
}

#[test]
fn of_a_line_that_is_refused_for_its_own_values_nothing_is_carried_out() {
    let site = Site::new(&[]);
    let mut client = site.client();
    client.line("P1=5");
    assert_eq!(client.line("P1=P1+1 I3=9"), "\x07ERR003\r");
    assert_eq!(client.line("P1"), "5\r\x06");
}

#[test]
fn a_client_who_fetches_nothing_is_sent_away() {
    let site = Site::new(&[]);
    let mut client = site.client();
    client.line("P0..1023=1234567");
    let line = packet(0x40, 0xB0, 0, 0, 8, b"P0..1023");
    let sent = (0..200).take_while(|_| client.ask(&line) == b"@").count();
    assert!(sent < 100, "{sent}");
    assert_eq!(site.client().line("P1"), "1234567\r\x06", "and nobody else is");
}

#[test]
fn lines_that_are_written_together_stay_apart() {
    let site = Site::new(&[]);
    let mut client = site.client();
    client.line("P1=0 P2=0 P12=0");
    let text = b"P1=1\r\n\0P2=5\r";
    let length = u16::try_from(text.len()).unwrap();
    assert_eq!(client.ask(&packet(0x40, 0xC6, 0, 0, length, text)), [0; 4]);
    client.ask(&packet(0x40, 0xC6, 0, 0, 6, b"P1\r2=5"));
    assert_eq!(site.ask("P1 P2 P12"), ["1", "5", "0"]);
}
