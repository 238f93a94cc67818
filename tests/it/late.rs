//! Slow lines, late replies, and who is told what of them.

use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use pmac_dpram::client::CommandError;
use pmac_dpram::map::{Family, PMAC, TURBO2};
use pmac_dpram::protocol::{BOARD, CallError};
use pmac_dpram::sim::board::error::CommandError as BoardError;
use serde_json::{Value, json};

use crate::support::raw::{Raw, error_name};
use crate::support::{PATIENCE, VirtualSite};

/// A board that is known.
fn board() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site
}

/// A client that waits for the reply to `line`.
fn waiting(site: &VirtualSite, line: &str) -> Raw {
    let mut client = Raw::at(&site.socket());
    client.call("Send", json!({ "line": line, "timeout_ms": 25_000 }));
    client
}

fn reason(reply: &Value) -> &str {
    reply["parameters"]["reason"].as_str().unwrap_or_else(|| panic!("{reply}"))
}

fn seconds(site: &VirtualSite, action: impl FnOnce()) -> f64 {
    let before = site.with_world(|world| world.now_ns());
    action();
    (site.with_world(|world| world.now_ns()) - before) as f64 / 1e9
}

#[test]
fn a_board_that_opens_a_buffer_slowly_keeps_its_owner() {
    let site = board();
    site.control("fault ascii_slow 100ms");
    for line in ["OPEN PROG 7 CLEAR", "X1", "CLOSE"] {
        assert_eq!(site.run(&["send", line]).code, Some(0), "{line}");
    }
    let file = site.file("file.pmc", "OPEN PROG 8 CLEAR\nX1\nX2\nCLOSE\n");
    let ran = site.run(&["download", &file]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert_eq!(site.ask("LIST PROG 7"), ["X1", "RET"]);
    assert_eq!(site.ask("LIST PROG 8"), ["X1", "X2", "RET"]);
    site.assert_no_violations();
}

#[test]
fn a_slow_commands_reply_is_nobody_elses() {
    let site = board();
    let mut connection = site.connection();
    site.control("fault ascii_slow 7000ms");
    let slow = connection.send("P5=3 P5", Duration::from_secs(1));
    assert!(matches!(slow, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{slow:?}");
    let took = seconds(&site, || {
        let early = site.connection().send("P5=7", Duration::from_secs(2)).unwrap_err().to_string();
        assert!(
            early.contains("the board still works on \"P5=3 P5\" of uid ") && early.contains("^X"),
            "{early}"
        );
        assert!(early.contains("nothing was sent"), "{early}");
    });
    assert!(took < 2.2, "{took} s");
    // Seven seconds are over.
    site.control("fault ascii_slow off");
    assert_eq!(connection.send("P5=7", PATIENCE).unwrap(), [""; 0]);
    assert_eq!(connection.send("P5", PATIENCE).unwrap(), ["7"]);
    site.assert_no_violations();
}

#[test]
fn who_did_not_get_his_turn_is_told_whose_line_holds_the_port() {
    let site = board();
    site.control("fault ascii_slow 60000ms");
    assert!(site.connection().send("P5=3", Duration::from_secs(1)).is_err());
    // More than the bus thread has at a time.
    let mut waiting: Vec<Raw> = (0..20)
        .map(|_| {
            let mut client = Raw::at(&site.socket());
            client.call("Send", json!({ "line": "P6=1", "timeout_ms": 3000 }));
            client
        })
        .collect();
    for client in &mut waiting {
        let reply = client.receive().unwrap();
        assert_eq!(error_name(&reply), "Refused", "{reply}");
        assert!(reason(&reply).contains("the board still works on \"P5=3\" of uid "), "{reply}");
    }
}

#[test]
fn who_waits_behind_one_that_waits_longer_is_refused_at_his_own_deadline() {
    let site = board();
    site.control("fault ascii_slow 20000ms");
    // The first is with the board and the second with the bus thread, or on its way to it. The third waits in the socket's thread.
    let _slow = waiting(&site, "P5=3");
    site.run_for(Duration::from_millis(100));
    let _patient = [waiting(&site, "P6=1"), waiting(&site, "P7=1")];
    site.run_for(Duration::from_millis(100));
    let took = seconds(&site, || {
        let refused = site.connection().send("P8=1", Duration::from_secs(1)).unwrap_err().to_string();
        assert!(refused.contains("the board still works on \"P5=3\" of uid "), "{refused}");
        assert!(refused.contains("nothing was sent"), "{refused}");
    });
    assert!(took < 1.2, "{took} s");
}

#[test]
fn what_is_done_is_not_told_as_not_done_because_nothing_could_be_asked_behind_it() {
    let site = board();
    site.control("fault ascii_slow 20000ms");
    let _slow: Vec<Raw> = ["P5=3", "P6=1", "P7=1"].map(|line| waiting(&site, line)).into();
    site.run_for(Duration::from_millis(100));
    // It stops the programs of a coordinate system, so it is done before the board is asked whether it has an effect.
    let mut client = Raw::at(&site.socket());
    client.call("FeedOverride", json!({ "coordinate_system": 1, "raw": 0 }));
    let reply = client.receive().unwrap();
    let notes = reply["parameters"]["notes"].to_string();
    assert!(notes.contains("could not be asked"), "{reply}");
}

#[test]
fn a_new_daemon_does_not_take_what_the_old_one_has_left() {
    let site = board();
    site.control("fault ascii_slow 3000ms");
    let _asker = waiting(&site, "P5=3 P5");
    site.run_for(Duration::from_millis(100));
    site.stop_daemon();
    site.start_daemon(&[]);
    site.run_for(Duration::from_secs(1));
    site.control("fault ascii_slow off");
    assert_eq!(site.ask("P6=8 P6"), ["8"]);
    site.wait_for_identity();
    assert!(site.log().contains("firmware 1.16D"), "{}", site.log());
}

#[test]
fn a_board_with_a_slow_servo_cycle_is_believed_at_once() {
    let site = VirtualSite::running(&["--servo-hz", "500"], &[]);
    let took = seconds(&site, || assert_eq!(site.ask("P5=7 P5"), ["7"]));
    assert!(took < 1.0, "{took} s");
    site.wait_for_identity();
}

#[test]
fn after_a_reset_the_port_is_free() {
    let site = board();
    site.control("fault ascii_slow 60000ms");
    assert!(site.connection().send("P5=3", Duration::from_secs(1)).is_err());
    site.control("reset");
    site.control("fault ascii_slow off");
    assert_eq!(site.ask("P6=8 P6"), ["8"]);
}

#[test]
fn a_cancel_ends_the_line_under_way_at_once() {
    let site = board();
    site.control("fault ascii_no_reply on");
    let mut client = waiting(&site, "P5=3 P5");
    site.run_for(Duration::from_millis(100));
    let took = seconds(&site, || {
        assert_eq!(site.pmacctl(&["send", "^X"]).0, 0);
        let reply = client.receive().unwrap();
        assert_eq!(error_name(&reply), "Interrupted");
        assert_eq!(reason(&reply), format!("cancelled by ^X of uid {}", nix::unistd::getuid()));
        site.control("fault ascii_no_reply off");
        assert_eq!(site.ask("P5"), ["3"]);
    });
    assert!(took < 3.0, "{took} s");
}

#[test]
fn abort_is_answered_in_time() {
    let site = board();
    site.ask("#1J+");
    let took = seconds(&site, || {
        let mut client = Raw::at(&site.socket());
        client.call("SendControl", json!({ "character": "^A" }));
        let reply = client.receive().unwrap();
        assert_eq!(reply.get("error"), None, "{reply}");
    });
    assert!(took < 0.2, "{took} s");
    site.run_for(Duration::from_secs(1));
    let place = site.ask("#1P");
    site.run_for(Duration::from_secs(1));
    assert_eq!(site.ask("#1P"), place, "it moves");
    assert_eq!(site.connection().control(b'P' - 64).unwrap().len(), 1);
    site.assert_no_violations();
}

#[test]
fn abort_drops_the_lines_that_wait_whosever_they_are() {
    for keeps in [false, true] {
        let site = board();
        site.control("fault ascii_no_reply on");
        let mut first = waiting(&site, "P1=1");
        site.run_for(Duration::from_millis(100));
        // More than the bus thread has at a time.
        let mut others: Vec<Raw> = (0..12).map(|number| waiting(&site, &format!("P2{number}=1"))).collect();
        site.run_for(Duration::from_millis(100));
        let abort: &[&str] = if keeps { &["abort", "--keep-queue"] } else { &["abort"] };
        assert_eq!(site.pmacctl(abort).0, 0);
        site.control("fault ascii_no_reply off");
        assert_eq!(site.pmacctl(&["send", "^X"]).0, 0);
        assert_eq!(error_name(&first.receive().unwrap()), "Interrupted");
        for client in &mut others {
            let reply = client.receive().unwrap();
            if keeps {
                assert_eq!(reply.get("error"), None, "{reply}");
            } else {
                assert_eq!(error_name(&reply), "Refused");
                assert_eq!(reason(&reply), format!("not sent: aborted by uid {}", nix::unistd::getuid()));
            }
        }
        assert_eq!(site.ask("P20 P211"), [if keeps { "1" } else { "0" }; 2]);
        site.assert_no_violations();
    }
}

#[test]
fn nothing_starts_behind_an_abort_that_came_while_the_board_was_asked_about_the_start() {
    let site = board();
    for line in ["I2=3", "&1#1->X", "OPEN PROG 5 CLEAR", "LINEAR INC TM60000 X9000000", "CLOSE", "&1B5"] {
        site.ask(line);
    }
    let mut stopping = Raw::at(&site.socket());
    let mut refused = 0;
    for moment in 1..=20 {
        assert_eq!(site.pmacctl(&["abort"]).0, 0);
        site.ask("#1J/");
        site.control("fault ascii_slow 300ms");
        let mut client = Raw::at(&site.socket());
        client.call("Panel", json!({"action": "start", "numbers": [1]}));
        site.run_for(Duration::from_millis(50 * moment));
        stopping.call("SendControl", json!({"character": "^A"}));
        assert_eq!(stopping.receive().unwrap().get("error"), None);
        site.control("fault ascii_slow off");
        let reply = client.receive().unwrap();
        refused += usize::from(reply.get("error").is_some());
        site.run_for(Duration::from_secs(1));
        let speed: f64 = site.ask("#1V")[0].parse().unwrap();
        assert!(speed.abs() < 0.1, "abort after {} ms: {reply}, {speed}", 50 * moment);
    }
    assert!(refused > 3, "{refused}");
    site.assert_no_violations();
}

/// One connection has one call under way; the others lie unread.
#[test]
fn what_was_sent_before_an_abort_is_not_begun_after_it() {
    const CALLS: usize = 50;
    for goes in [false, true] {
        let site = board();
        site.control("fault ascii_no_reply on");
        let line = json!({"line": "P30=P30+1", "timeout_ms": 600_000});
        let mut client = waiting(&site, "P31=1");
        for _ in 0..CALLS {
            if goes {
                let call = json!({"method": format!("{BOARD}.Send"), "parameters": line, "oneway": true});
                client.send(format!("{call}\0").as_bytes());
            } else {
                client.call("Send", line.clone());
            }
        }
        client.call("GetInfo", json!({}));
        site.run_for(Duration::from_millis(100));
        let client = (!goes).then_some(client);
        assert_eq!(site.pmacctl(&["abort"]).0, 0);
        site.control("fault ascii_no_reply off");
        assert_eq!(site.pmacctl(&["send", "^X"]).0, 0);
        if let Some(mut client) = client {
            assert_eq!(error_name(&client.receive().unwrap()), "Interrupted");
            for _ in 0..CALLS {
                let reply = client.receive().unwrap();
                assert_eq!(error_name(&reply), "Refused");
                assert!(reason(&reply).starts_with("not sent: aborted by uid "), "{reply}");
            }
            assert_eq!(client.receive().unwrap().get("error"), None, "what only asks is answered");
            client.call("Send", line.clone());
            assert_eq!(client.receive().unwrap().get("error"), None, "this was sent after it");
        }
        site.run_for(Duration::from_secs(2));
        assert_eq!(site.ask("P30"), [if goes { "0" } else { "1" }]);
        site.assert_no_violations();
    }
}

#[test]
fn a_stop_tells_only_what_was_not_sent_as_not_sent() {
    let site = board();
    site.control("fault ascii_no_reply on");
    let mut sent = waiting(&site, "P5=3");
    site.run_for(Duration::from_millis(100));
    let mut others: Vec<Raw> = (0..12).map(|number| waiting(&site, &format!("P2{number}=1"))).collect();
    site.run_for(Duration::from_millis(100));
    site.stop_daemon();
    let reply = sent.receive().unwrap();
    assert_eq!(
        (error_name(&reply), reason(&reply)),
        ("Interrupted", "pmacd stopped before the board had answered")
    );
    let unsent =
        others.iter_mut().filter_map(Raw::receive).filter(|reply| error_name(reply) == "Unavailable");
    assert!(unsent.count() >= 4, "those that the bus thread has not got");
    site.control("fault ascii_no_reply off");
    site.start_daemon(&[]);
    assert_eq!(site.ask("P5"), ["3"]);
}

#[test]
fn a_board_that_clears_its_words_some_time_after_a_cancel_loses_no_line() {
    for late in ["10ms", "30ms", "45ms"] {
        let site = board();
        site.control(&format!("fault ascii_late_cancel {late}"));
        let mut connection = site.connection();
        for _ in 0..3 {
            assert_eq!(site.pmacctl(&["send", "^X"]).0, 0);
            let took = seconds(&site, || {
                assert_eq!(connection.send("P5=7 P5", PATIENCE).unwrap(), ["7"], "{late}");
            });
            assert!(took < 0.5, "{late}: {took} s");
        }
        site.assert_no_violations();
    }
}

#[test]
fn a_board_that_refuses_the_question_for_a_buffer_takes_lines() {
    for late in ["0ms", "250ms"] {
        let site = VirtualSite::running(&[], &[]);
        site.wait_for_identity();
        site.stop_daemon();
        site.control("fault servo_silent on");
        site.control("fault ascii_no_size on");
        site.control(&format!("fault ascii_late_ack {late}"));
        site.start_daemon(&[]);
        site.wait_until("a line by hand", || site.pmacctl(&["send", "P5=7"]).0 == 0);
        assert_eq!(site.ask("P5 P5"), ["7", "7"], "{late}");
        let warned = "the board refuses SIZE (ERR003): whether another host has opened a program buffer is not known, and a \
                      line that is sent may enter it; turn the servo report on, which tells (pmacctl setup enable)";
        assert_eq!(site.log().matches(warned).count(), 1, "{late}: {}", site.log());
        let status = site.run(&["status"]).stdout;
        let told = "open buffer     not known: no report tells, and the board refuses SIZE\n";
        assert!(status.contains(told), "{late}: {status}");
        site.control("fault servo_silent off");
        site.wait_until("a report that tells", || !site.run(&["status"]).stdout.contains("open buffer"));
    }
}

#[test]
fn a_line_that_a_dead_host_left_half_done_is_forgotten() {
    for (family, begins_second) in [(&PMAC, false), (&PMAC, true), (&TURBO2, false)] {
        let site = VirtualSite::new();
        site.start_simulator(&["--family", family.name, "--dpram-startup"]);
        site.run_for(Duration::from_millis(100));
        // The first part of a line, without a NUL; the board takes it and waits for the second.
        let ascii = &family.ascii;
        let memory = OpenOptions::new().write(true).open(site.path("dpram")).unwrap();
        let first = format!("{:<1$}", "P7=5 P8=6", ascii.command_bytes);
        memory.write_all_at(first.as_bytes(), ascii.command.bytes().into()).unwrap();
        let (flag, mask) = (ascii.command_loaded.word, ascii.command_loaded.mask);
        memory.write_all_at(&mask.to_le_bytes(), flag.bytes().into()).unwrap();
        site.run_for(Duration::from_millis(100));
        if begins_second {
            memory.write_all_at(b"P9\0\0", ascii.command.bytes().into()).unwrap();
        }
        let config = site.file("pmacd.toml", &format!("family = \"{}\"\n", family.name));
        site.start_daemon(&["--config", &config]);
        site.wait_for_identity();
        assert_eq!(site.ask("P7 P8"), ["0", "0"], "{}: half a line was carried out", family.name);
        site.assert_no_violations();
    }
}

/// Lets time pass cycle by cycle until `condition` is true.
fn step_until(site: &VirtualSite, what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !condition() {
        assert!(Instant::now() < deadline, "waited in vain for {what}");
        site.step(1);
    }
}

/// A line of whose two parts the board has taken the first.
fn half_way(site: &VirtualSite) -> Raw {
    let settings: Vec<String> = (100..125).map(|number| format!("P{number}=1")).collect();
    let client = waiting(site, &format!("#1J+ #2J+ {}", settings.join(" ")));
    step_until(site, "the first part to be taken", || site.with_board(|sim| sim.ascii.has_first_part()));
    client
}

/// Sends `stop` while time stands, and lets it pass again. How long the answer took.
fn stop_at_once(site: &VirtualSite, stopping: &mut Raw, stop: &str) -> f64 {
    seconds(site, || {
        stopping.call("SendControl", json!({ "character": stop }));
        while !site.log().contains(&format!("sends {stop}")) {
            std::thread::yield_now();
        }
        site.go_on();
        let reply = stopping.receive().unwrap();
        assert_eq!(error_name(&reply), "", "{stop}: {reply}");
    })
}

#[test]
fn a_line_that_is_half_way_when_everything_stops_is_not_finished() {
    for family in [&PMAC, &TURBO2] {
        for stop in ["^A", "^K"] {
            let site = VirtualSite::configured(
                &["--family", family.name],
                &format!("family = \"{}\"\n", family.name),
            );
            site.wait_for_live_servo();
            site.wait_for_identity();
            let what = format!("{} {stop}", family.name);
            let mut stopping = Raw::at(&site.socket());
            site.hold();
            let mut client = half_way(&site);
            let taken = stop_at_once(&site, &mut stopping, stop);
            assert!(taken < 0.2, "{what}: {taken} s");
            let reply = client.receive().unwrap();
            assert!(["Refused", "Interrupted"].contains(&error_name(&reply)), "{what}: {reply}");
            assert_eq!(site.ask("P100 P124 #1V #2V"), ["0"; 4], "{what}: {reply}");
            site.assert_no_violations();
        }
    }
}

/// Stops everything while a line lies untaken, and looks that it does not move the motor after it. False where the board had taken
/// the line before the stop was there, as it may where another thread is held up.
fn stops_before_the_line(family: &Family, stop: &str) -> bool {
    let site =
        VirtualSite::configured(&["--family", family.name], &format!("family = \"{}\"\n", family.name));
    site.wait_for_live_servo();
    site.wait_for_identity();
    let mut stopping = Raw::at(&site.socket());
    site.hold();
    let mut client = waiting(&site, "#1J+ P5=1");
    let flag = family.ascii.command_loaded;
    step_until(&site, "the line to lie there", || {
        site.with_board(move |sim| sim.board.memory.dpram.is_set(flag))
    });
    // The simulator looks at the character first.
    let taken = stop_at_once(&site, &mut stopping, stop);
    let what = format!("{} {stop}", family.name);
    assert!(taken < 0.2, "{what}: {taken} s");
    let reply = client.receive().unwrap();
    let is_first = error_name(&reply) == "Interrupted";
    site.wait_until("the port to be free", || site.ask("P1") == ["0"]);
    assert!(is_first || error_name(&reply).is_empty() && site.ask("P5") == ["1"], "{what}: {reply}");
    assert_eq!(site.ask("#1V"), ["0"], "{what}");
    site.assert_no_violations();
    is_first
}

#[test]
fn a_line_that_lies_untaken_when_everything_stops_moves_nothing_after_it() {
    for family in [&PMAC, &TURBO2] {
        for stop in ["^A", "^K"] {
            let met = (0..10).any(|_| stops_before_the_line(family, stop));
            assert!(met, "{} {stop}: the line was always taken first", family.name);
        }
    }
}

#[test]
fn a_line_at_work_has_its_own_reply_behind_a_programs_error_and_so_have_those_after_it() {
    for family in [&PMAC, &TURBO2] {
        let site =
            VirtualSite::configured(&["--family", family.name], &format!("family = \"{}\"\n", family.name));
        site.wait_for_live_servo();
        site.wait_for_identity();
        // PLC programs may run.
        assert_eq!(site.ask("I5=2"), [""; 0]);
        site.control("fault ascii_slow 80ms");
        assert_eq!(site.ask("P20=20 P21=21 P22=22"), [""; 0]);
        site.hold();
        let mut client = waiting(&site, "P777=1");
        let ascii = &family.ascii;
        step_until(&site, "the line to be taken", || {
            site.with_board(move |sim| {
                let dpram = &sim.board.memory.dpram;
                dpram.read16(ascii.command).to_le_bytes() == *b"P7" && !dpram.is_set(ascii.command_loaded)
            })
        });
        // As I6=1 has an error of a program's CMD reported.
        site.with_board(|sim| sim.board.output.respond_error(BoardError(5)));
        site.go_on();
        let reply = client.receive().unwrap();
        assert_eq!(reply, json!({ "parameters": { "lines": [] } }), "{}", family.name);
        for number in [20, 21, 22] {
            assert_eq!(site.ask(&format!("P{number}")), [number.to_string()], "{}", family.name);
        }
        assert_eq!(site.ask("P777"), ["1"], "it was carried out");
        site.assert_no_violations();
    }
}
