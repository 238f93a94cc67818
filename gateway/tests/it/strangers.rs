//! What strangers, and clients that know little of each other, do to the gateway and the others.

use std::io::Write;
use std::process::Stdio;

use pmac_dpram::map::Family;
use pmac_dpram::map::functions::RESPONSE_BYTES;

use super::site::{PATIENCE, Site, datagram, get_response, listening, packet, wait_until};

#[test]
fn what_was_not_sent_is_an_error_and_the_client_stays() {
    let mut site = Site::new(&[]);
    let mut client = site.client();
    assert_eq!(client.line("P1=3"), "\x06");
    site.stop_daemon();
    for _ in 0..30 {
        assert_eq!(client.line("P1"), "\x07ERR001\r");
    }
    site.start_daemon();
    assert_eq!(client.line("P1"), "3\r\x06");
    wait_until("the log", || site.log("pmac-gateway").contains("pmacd is there again"));
    let log = site.log("pmac-gateway");
    assert_eq!(log.matches("until that is mended").count(), 1, "one line a state: {log}");
}

#[test]
fn a_reset_ends_no_connection() {
    for family in ["pmac", "turbo"] {
        let site = Site::of(family, &[]);
        let mut client = site.client();
        // Whether the board lets go of the line before it resets is its own affair.
        let answer = client.line("$$$");
        assert!(answer == "\x06" || answer == "\0", "{family}: {answer:?}");
        assert_eq!(client.get_buffer(), [0], "nothing more comes of it");
        wait_until("the board", || match client.line("P1").as_str() {
            "0\r\x06" => true,
            answer => {
                assert_eq!(answer, "\x07ERR001\r", "it is busy, and says so");
                false
            }
        });
        // At factory settings the DPRAM's port of a PMAC is off.
        let answer = client.line("$$$***");
        assert!(answer == "\x06" || answer == "\0", "{family}: {answer:?}");
        let answer = client.line("P1");
        assert!(answer == "0\r\x06" || answer == "\x07ERR001\r", "{family}: {answer:?}");
    }
}

#[test]
fn of_who_only_reads_no_address_reaches_the_board() {
    let site = Site::new(&["--read-only"]);
    site.ask("#4&3");
    let mut client = site.client();
    for line in ["#2", "&2", "#2&2", " & 1 # 3 ", "P1 #2"] {
        assert!(client.line(line).ends_with("\x06"), "{line}");
        assert_eq!(site.ask("#&"), ["4", "3"], "{line}");
    }
    assert_eq!(client.line("#"), "2\r\x06");
}

#[test]
fn a_datagram_means_whom_its_sender_addressed_and_nobody_else() {
    let site = Site::new(&[]);
    let (one, two) = (site.udp(), site.udp());
    for line in ["OPEN PLC 5 CLEAR", "P1=0", "CLOSE"] {
        site.ask(line);
    }
    // These are nobody's.
    assert_eq!(datagram(&one, "LIST PLC 5"), "P1=0\rRET\r\x06");
    assert_eq!(datagram(&one, "LIST"), "\x07ERR003\r");
    // Nothing is known of him: whom he means neither.
    assert_eq!(datagram(&one, "J/"), "\x07ERR003\r");
    assert_eq!(datagram(&one, "P"), "\x07ERR003\r");
    assert_eq!(datagram(&one, "i3=0 P1"), "0\r");
    assert_eq!(datagram(&one, "#3"), "\0", "I3=0: nothing marks the end");
    assert_eq!(datagram(&two, "#2P"), "0\r\x06");
    // What it reads is none: there is no answer, and his thread is gone.
    one.send(&packet(0xC0, 0xB4, 0, 0, 0, &[])).unwrap();
    wait_until("him to be forgotten", || site.log("pmac-gateway").contains("without an answer"));
    assert_eq!(datagram(&one, "#"), "3\r", "he is remembered");
    assert_eq!(datagram(&one, "J/"), "\0");
    assert!(site.log("pmacd").contains("\"#3J/\""), "{}", site.log("pmacd"));
}

#[test]
fn behind_a_line_that_was_refused_a_stop_goes_to_no_other_motor() {
    let site = Site::new(&[]);
    let (mut one, mut two) = (site.client(), site.client());
    assert_eq!(one.line("#1"), "\x06");
    assert!(one.line("P99999999 #3").starts_with("\x07ERR"), "the board does not come to the address");
    assert_eq!(one.line("J/"), "\x07ERR003\r", "whom the board addresses is not known");
    // These mean nobody.
    assert_eq!(one.line("OPEN PLC 5 CLEAR"), "\x06");
    assert_eq!(one.line("P1=1"), "\x06");
    assert_eq!(one.line("CLOSE"), "\x06");
    assert_eq!(one.line("list plc5"), "P1=1\rRET\r\x06");
    assert_eq!(one.line("#1J/"), "\x06");
    assert_eq!(one.line("J/"), "\x06");
    // Nothing of this is sent.
    assert_eq!(two.line("OPEN PROG 7 CLEAR"), "\x06");
    assert!(one.line("#3 P5=1").starts_with("\x07ERR"));
    assert_eq!(two.line("CLOSE"), "\x06");
    assert_eq!(one.line("J/"), "\x06");
    assert_eq!(site.log("pmacd").matches("\"#1J/\"").count(), 3, "{}", site.log("pmacd"));
    // A board that has come up addresses the first.
    one.line("#3");
    one.line("$$$");
    wait_until("the board", || one.line("J/") == "\x06");
    assert!(!site.log("pmacd").contains("\"#3J/\""), "{}", site.log("pmacd"));
}

#[test]
fn a_refused_line_leaves_in_doubt_only_what_it_addressed() {
    let site = Site::new(&[]);
    let mut client = site.client();
    assert!(client.line("P99999999 #3").starts_with("\x07ERR"));
    assert_eq!(client.line("J/"), "\x07ERR003\r");
    assert_eq!(client.line("A"), "\x06", "no line of his has addressed a coordinate system");
    assert!(client.line("P99999999 &2").starts_with("\x07ERR"));
    assert_eq!(client.line("A"), "\x07ERR003\r");
    assert_eq!(client.line("#1J/"), "\x06");
    assert_eq!(client.line("&1A"), "\x06");
}

#[test]
fn who_has_lost_his_buffer_by_silence_sends_nothing_before_he_says_close() {
    let site = Site::new(&[]);
    let one = site.udp();
    assert_eq!(datagram(&one, "OPEN PROG 7 CLEAR"), "\x06");
    assert_eq!(datagram(&one, "P1=9"), "\x06");
    one.send(&packet(0xC0, 0xB4, 0, 0, 0, &[])).unwrap();
    wait_until("his buffer to be closed", || site.connection().send("P1", PATIENCE).is_ok());
    for _ in 0..2 {
        assert_eq!(datagram(&one, "P1=8"), "\x07ERR005\r", "it was meant for the program");
    }
    assert_eq!(site.ask("P1"), ["0"]);
    assert_eq!(datagram(&one, "CLOSE"), "\x06");
    assert_eq!(datagram(&one, "P1=8"), "\x06");
    assert_eq!(site.ask("P1"), ["8"]);
}

#[test]
fn who_has_lost_his_buffer_to_another_hears_it_and_stays() {
    let site = Site::new(&[]);
    let mut client = site.client();
    assert_eq!(client.line("OPEN PROG 7 CLEAR"), "\x06");
    assert_eq!(client.line("P1=9"), "\x06");
    site.ask("CLOSE");
    for line in ["P1=8", "X10", "P1"] {
        assert_eq!(client.line(line), "\x07ERR005\r");
    }
    assert_eq!(client.line("\x0b"), "\x06", "a stop is none of it");
    for nothing in ["", " ", "\t", "\x10"] {
        assert!(client.line(nothing).ends_with('\x06'));
        assert_eq!(client.line("P1=8"), "\x07ERR005\r", "nor is {nothing:?}");
    }
    assert_eq!(client.line("CLOSE"), "\x06");
    assert_eq!(client.line("P1"), "0\r\x06");
    assert_eq!(client.line("LIST PROG 7"), "P1=9\rRET\r\x06");
    assert_eq!(client.line("OPEN PROG 7 CLEAR"), "\x06");
    site.ask("CLOSE");
    std::thread::sleep(std::time::Duration::from_millis(2500));
    assert_eq!(client.line("P1=8"), "\x07ERR005\r");
    assert_eq!(client.line("OPEN PROG 7 CLEAR"), "\x06", "another one");
    assert_eq!(client.line("P1=7"), "\x06");
    site.ask("CLOSE");
    // What closes the buffer is the end of it, whoever was first; that its end was another's is told.
    assert_eq!(client.line("CLOSE"), "\x07ERR005\r");
    assert_eq!(client.line("P1"), "0\r\x06");
}

#[test]
fn nobody_fills_the_log() {
    let site = Site::new(&[]);
    for _ in 0..500 {
        let mut client = site.client();
        client.stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        assert!(client.is_ended());
        let mut client = site.client();
        assert_eq!(client.line("I3=9"), "\x07ERR003\r");
    }
    let udp = site.udp();
    for _ in 0..500 {
        udp.send(b"nonsense").unwrap();
    }
    // A request beside so many may get lost, as datagrams do.
    udp.set_read_timeout(Some(std::time::Duration::from_millis(500))).unwrap();
    wait_until("an answer", || {
        udp.send(&get_response("P1")).unwrap();
        let mut answer = [0; 64];
        udp.recv(&mut answer).is_ok_and(|count| answer[..count] == *b"0\r\x06")
    });
    let log = site.log("pmac-gateway");
    assert!(log.lines().count() < 60, "{log}");
}

#[test]
fn an_unread_log_holds_nobody_up() {
    let site = Site::new(&[]);
    let mut gateway = site.another_gateway(&[]).stderr(Stdio::piped()).spawn().unwrap();
    // Nobody reads the log on. These fill the pipe three times over.
    let (mut client, _log) = listening(&mut gateway);
    let stops = "#1J/#2J/#3J/#4J/".repeat(12);
    for _ in 0..900 {
        assert_eq!(client.line(&stops), "\x06");
    }
    let pid = nix::unistd::Pid::from_raw(gateway.id().cast_signed());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGTERM).unwrap();
    wait_until("the gateway's end", || gateway.try_wait().unwrap().is_some());
}

#[test]
fn nobody_reads_others_lines_out_of_the_dpram() {
    for options in [&[][..], &["--read-only"]] {
        let site = Site::new(options);
        site.ask("P77=4711");
        let ascii = &Family::by_name("pmac").unwrap().ascii;
        let texts = [(ascii.command, ascii.command_bytes), (ascii.response, RESPONSE_BYTES)];
        for (start, end) in texts.map(|(start, bytes)| (start.bytes(), start.bytes() as usize + bytes)) {
            let (start, end) = (u16::try_from(start).unwrap(), u16::try_from(end).unwrap());
            for (first, count) in [(start - 1, 2), (start, 1), (end - 1, 2), (end - 1, 1), (start - 20, 400)]
            {
                let read = site.client().request(0xC0, 0xB4, first, count);
                assert_eq!(read.len(), usize::from(count));
                let own = (first..).zip(read).filter(|(offset, _)| (start..end).contains(offset));
                assert!(own.clone().all(|(_, byte)| byte == 0), "{count} bytes from {first}: {own:?}");
            }
            let mut client = site.client();
            assert_eq!(client.request(0xC0, 0xB4, start - 2, 2).len(), 2);
            assert_eq!(client.request(0xC0, 0xB4, end, 2).len(), 2);
        }
    }
}
