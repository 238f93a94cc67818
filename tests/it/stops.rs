//! Stops that stop, whatever has become of the control panel.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::thread::JoinHandle;
use std::time::Duration;

use nix::unistd::getuid;
use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::protocol::control;
use serde_json::json;

use crate::support::jogs::{ask, until};
use crate::support::raw::{Raw, call};
use crate::support::{PATIENCE, VirtualSite, wait_until};

fn running(config: &str) -> VirtualSite {
    running_with(&[], config)
}

fn running_with(simulator: &[&str], config: &str) -> VirtualSite {
    let site = VirtualSite::configured(simulator, config);
    site.wait_for_live_servo();
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    site
}

/// A connection that holds a jog of motor 1, which moves.
fn holder(site: &VirtualSite, board: &mut Connection) -> Connection {
    let mut holder = site.connection();
    holder.panel_hold("jog+", &[1]).unwrap();
    until(board, "#1V", "it goes", |speed| speed > 1.0);
    holder.panel_renew().unwrap();
    holder
}

/// What a holder hears who renews its jog until that is over.
fn hears_of_its_end(mut held: Connection) -> JoinHandle<CommandError> {
    std::thread::spawn(move || {
        loop {
            if let Err(error) = held.panel_renew() {
                return error;
            }
        }
    })
}

/// Whether motor 1's loop is open, as `#1?` says.
fn is_open(board: &mut Connection) -> bool {
    let status = board.send("#1?", PATIENCE).unwrap().concat();
    u32::from_str_radix(&status[..6], 16).unwrap() >> 18 & 1 == 1
}

/// Both are read in one round, and the character goes first.
#[test]
fn a_jog_that_is_asked_for_just_before_an_abort_is_held_by_nobody_and_does_not_begin() {
    let site = running("");
    site.wait_for_identity();
    let mut board = site.connection();
    for _ in 0..20 {
        site.hold();
        let mut holder = Raw::at(&site.socket());
        let mut stopper = Raw::at(&site.socket());
        holder.call("PanelHold", json!({"action": "jog+", "numbers": [1]}));
        stopper.call("SendControl", json!({"character": "^A"}));
        site.go_on();
        stopper.receive().unwrap();
        holder.receive().unwrap();
        // The holder says nothing more, and stays.
        site.run_for(Duration::from_millis(700));
        let speed: f64 = board.send("#1V", PATIENCE).unwrap()[0].parse().unwrap();
        assert!(speed.abs() < 0.01, "it moves at {speed}: {}", site.log());
    }
}

#[test]
fn a_held_jog_stops_by_command_line_where_the_panel_is_gone() {
    let site = running("");
    let mut board = site.connection();
    board.send("#3", PATIENCE).unwrap();
    let mut held = site.connection();
    held.panel_hold("jog+", &[1]).unwrap();
    site.run_for(Duration::from_millis(100));
    held.panel_renew().unwrap();
    board.send("I2=1", PATIENCE).unwrap();
    drop(held);
    // The panel has 100 ms, and the line takes a few.
    site.run_for(Duration::from_millis(150));
    assert_eq!(ask(&mut board, "#"), 3.0, "what was addressed is addressed again");
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    let log = site.log();
    assert!(log.contains("pmacd sends \"#1J/#3\"") && !log.contains("sends ^A"), "{log}");
    site.assert_no_violations();
}

#[test]
fn where_there_is_no_panel_stops_go_as_command_lines() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    let mut board = site.connection();
    for stop in [&["jog", "1", "stop"][..], &["panel", "jog-stop", "1"]] {
        board.send("#1J+", PATIENCE).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        board.send("#3", PATIENCE).unwrap();
        assert_eq!(site.pmacctl(stop), (0, String::new(), String::new()), "{stop:?}");
        assert_eq!(ask(&mut board, "#"), 3.0, "what was addressed is addressed again");
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    }
    assert!(site.log().contains("panel jog-stop [1], by command line\n"), "{}", site.log());
    board.send("&2 #1->X", PATIENCE).unwrap();
    for line in ["OPEN PROG 5 CLEAR", "LINEAR INC F5000 X1000000", "CLOSE", "&2B5R"] {
        board.send(line, PATIENCE).unwrap();
    }
    until(&mut board, "#1V", "the program moves it", |speed| speed > 0.0);
    assert_eq!(site.pmacctl(&["abort", "2"]), (0, String::new(), String::new()));
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    site.assert_no_violations();
}

/// Starts a jog of motor 1 and waits until it goes.
fn jogs(board: &mut Connection) {
    board.send("#1J+", PATIENCE).unwrap();
    until(board, "#1V", "it goes", |speed| speed > 1.0);
}

#[test]
fn a_stop_by_line_goes_whoever_has_which_buffer_open() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    let mut board = site.connection();
    board.send("&1 #1->X I5113=0", PATIENCE).unwrap();
    board.send("&1DEFINE ROT 100", PATIENCE).unwrap();
    board.send("#3", PATIENCE).unwrap();
    for open in ["OPEN PROG 7 CLEAR", "OPEN PLC 3 CLEAR", "OPEN ROT", "OPEN BINARY ROTARY"] {
        board.send("#1J+", PATIENCE).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        board.send(&format!("#3 {open}"), PATIENCE).unwrap();
        if open.contains("CLEAR") {
            board.send("P1=5", PATIENCE).unwrap();
        }
        for stop in
            [&["jog", "1", "stop"][..], &["panel", "jog-stop", "1"], &["panel", "hold", "1"], &["abort", "1"]]
        {
            assert_eq!(site.pmacctl(stop), (0, String::new(), String::new()), "{open}: {stop:?}");
            assert_eq!(ask(&mut board, "#"), 3.0, "{open}: what was addressed is addressed again");
        }
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
        board.send("CLOSE", PATIENCE).unwrap();
    }
    for list in ["LIST PROG 7", "LIST PLC 3"] {
        let listed = board.send(list, PATIENCE).unwrap().concat();
        assert!(!listed.contains(['J', 'A', 'H']), "{list}: {listed}");
    }
    assert_eq!(ask(&mut board, "&1PR"), 0.0, "nothing entered the rotary buffer");
    site.assert_no_violations();
}

#[test]
fn a_daemon_that_starts_while_a_buffer_is_open_stops_a_jog() {
    let site = running("");
    let mut board = site.connection();
    jogs(&mut board);
    for line in ["OPEN PROG 7 CLEAR", "X1"] {
        board.send(line, PATIENCE).unwrap();
    }
    drop(board);
    site.stop_daemon();
    let asks = site.file("asks.toml", "ask_m_variables = true\n");
    site.start_daemon(&["--config", &asks]);
    let used = |site: &VirtualSite| {
        site.run(&["status", "--json"]).json()["socket"]["waiting"] == serde_json::json!([])
    };
    site.run_for(Duration::from_secs(5));
    assert!(!used(&site), "the board cannot be asked where its M-variables point");
    let (status, _, told) = site.pmacctl(&["panel", "jog+", "1"]);
    assert_eq!(status, 1, "{told}");
    assert!(
        told.contains("while a program buffer is open: CLOSE by an engineer") && !told.contains("try again"),
        "{told}"
    );
    let shown = site.pmacctl(&["status"]).1;
    assert!(shown.contains("stops go as command lines meanwhile"), "{shown}");
    for stop in [
        &["jog", "1", "stop"][..],
        &["panel", "jog-stop", "1"],
        &["panel", "stop", "1"],
        &["panel", "hold", "1"],
        &["abort", "1"],
    ] {
        assert_eq!(site.pmacctl(stop), (0, String::new(), String::new()), "{stop:?}");
    }
    let mut board = site.connection();
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    board.send("CLOSE", PATIENCE).unwrap();
    let listed = board.send("LIST PROG 7", PATIENCE).unwrap().concat();
    assert!(!listed.contains(['J', 'A', 'H']), "{listed}");
    site.wait_until("every function to be used", || used(&site));
    site.assert_no_violations();
}

#[test]
fn a_held_jog_ends_when_somebody_switches_the_panel_off() {
    for by_serial in [false, true] {
        let site = running("");
        let mut board = site.connection();
        let mut held = holder(&site, &mut board);
        if by_serial {
            UnixStream::connect(site.path("serial")).unwrap().write_all(b"I2=0\r").unwrap();
            // The daemon asks again when a scale may have changed, and every half minute.
            board.send("I809=96", PATIENCE).unwrap();
        } else {
            board.send("I2=0", PATIENCE).unwrap();
        }
        let mut told = None;
        for _ in 0..100 {
            site.run_for(Duration::from_millis(50));
            told = held.panel_renew().err();
            if told.is_some() {
                break;
            }
        }
        let told = told.expect("the hold ends").to_string();
        let why = if by_serial {
            "the control panel is off (I2 is not 3 any more), by the serial port".to_owned()
        } else {
            format!("uid {} (pid {}) has switched the control panel off", getuid(), std::process::id())
        };
        assert!(told.contains("the held jog is over") && told.contains(&why), "{told}");
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
        assert!(site.log().contains("pmacd sends \"#1J/#"), "{}", site.log());
        assert!(!site.log().contains("sends ^A"), "{}", site.log());
    }
}

#[test]
fn a_killed_motor_gets_no_line_either() {
    let site = running("");
    let mut board = site.connection();
    let held = holder(&site, &mut board);
    board.send("I2=1", PATIENCE).unwrap();
    board.send("#1K", PATIENCE).unwrap();
    site.run_for(Duration::from_millis(20));
    drop(held);
    site.run_for(Duration::from_secs(3));
    assert!(is_open(&mut board), "{}", site.log());
    assert!(!site.log().contains("#1J/"), "{}", site.log());
}

#[test]
fn a_stop_by_line_leaves_a_killed_motor_killed() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    let mut board = site.connection();
    for reports in ["", "I48=0"] {
        // Without servo data the board's own answer is all there is.
        board.send(&format!("#1K {reports}"), PATIENCE).unwrap();
        site.run_for(Duration::from_millis(if reports.is_empty() { 20 } else { 500 }));
        board.send("#2J+", PATIENCE).unwrap();
        until(&mut board, "#2V", "it goes", |speed| speed > 1.0);
        board.send("#3", PATIENCE).unwrap();
        assert_eq!(site.pmacctl(&["panel", "jog-stop", "1", "2"]), (0, String::new(), String::new()));
        assert_eq!(ask(&mut board, "#"), 3.0, "what was addressed is addressed again");
        until(&mut board, "#2V", "it stands", |speed| speed.abs() < 0.1);
        assert!(is_open(&mut board), "{}", site.log());
        board.send("#3", PATIENCE).unwrap();
        assert_eq!(site.pmacctl(&["jog", "1", "stop"]), (0, String::new(), String::new()));
        assert!(is_open(&mut board), "{}", site.log());
        assert_eq!(site.log().matches("motor 1 gets no stop: its loop is open").count(), 2, "{}", site.log());
        if reports.is_empty() {
            // An abort is the board's own: it closes the loops of its coordinate system, and the log says so.
            assert_eq!(site.pmacctl(&["abort", "2"]).0, 0);
            assert!(site.log().contains("closes the loop of motor 1, which is open"), "{}", site.log());
            board.send("#1K", PATIENCE).unwrap();
        }
        site.stop_daemon();
        site.start_daemon(&["--config", &site.file("again.toml", "family = \"turbo2\"\n")]);
        site.wait_until("a board that answers", || site.pmacctl(&["send", "I48"]).0 == 0);
        board = site.connection();
    }
    site.assert_no_violations();
}

#[test]
fn a_jog_whose_panel_goes_is_told_and_stops_by_line() {
    for by_serial in [false, true] {
        let site = running("");
        let mut board = site.connection();
        assert_eq!(site.pmacctl(&["panel", "jog+", "1"]).0, 0);
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        let told = |site: &VirtualSite| site.pmacctl(&["status"]).1;
        assert!(!told(&site).contains("set in motion"), "its panel is on");
        if by_serial {
            UnixStream::connect(site.path("serial")).unwrap().write_all(b"I2=0\r").unwrap();
            // The daemon asks again when a scale may have changed, and every half minute.
            board.send("I809=96", PATIENCE).unwrap();
        } else {
            board.send("I2=0", PATIENCE).unwrap();
        }
        let what =
            "motor 1 was set in motion by the control panel, which is off (I2 is not 3), and may go on";
        site.wait_until("a status that says so", || told(&site).contains(what));
        assert_eq!(site.log().matches(what).count(), 1, "{}", site.log());
        let stop: &[&str] = if by_serial { &["panel", "jog-stop", "1"] } else { &["jog", "1", "stop"] };
        assert_eq!(site.pmacctl(stop), (0, String::new(), String::new()), "{stop:?}");
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
        assert!(site.log().contains("pmacd sends \"#1J/#"), "{}", site.log());
        assert!(!told(&site).contains("set in motion"), "{}", told(&site));
        site.assert_no_violations();
    }
}

/// A board whose panel is off, and that refuses `#nJ/`.
fn refuses(site: &VirtualSite, board: &mut Connection) {
    board.send("I2=1", PATIENCE).unwrap();
    site.control("fault jog_stop_refused on");
}

#[test]
fn a_held_jog_whose_stop_the_board_refuses_ends_by_an_abort_of_everything() {
    let site = running("");
    let mut board = site.connection();
    let held = holder(&site, &mut board);
    refuses(&site, &mut board);
    drop(held);
    site.run_for(Duration::from_millis(900));
    assert!(!site.log().contains("sends ^A"), "too early: {}", site.log());
    site.run_for(Duration::from_millis(600));
    assert!(site.log().contains("motor 1 may still move after its held jog is over: pmacd sends ^A"));
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    site.assert_no_violations();
}

#[test]
fn a_held_jog_stops_by_line_while_a_buffer_is_open() {
    let site = running("");
    let mut board = site.connection();
    let held = holder(&site, &mut board);
    for line in ["I2=1", "OPEN PROG 7 CLEAR", "X1"] {
        board.send(line, PATIENCE).unwrap();
    }
    drop(held);
    site.run_for(Duration::from_millis(1500));
    assert!(!site.log().contains("sends ^A"), "{}", site.log());
    board.send("CLOSE", PATIENCE).unwrap();
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    let listed = board.send("LIST PROG 7", PATIENCE).unwrap().concat();
    assert!(!listed.contains('J'), "{listed}");
}

#[test]
fn with_0_nothing_is_aborted_and_the_stop_is_asked_for_again() {
    let site = running("stop_all_after_ms = 0\n");
    let mut board = site.connection();
    let held = holder(&site, &mut board);
    refuses(&site, &mut board);
    drop(held);
    site.run_for(Duration::from_secs(3));
    let log = site.log();
    assert!(!log.contains("sends ^A") && log.contains("motor 1 MAY STILL MOVE"), "{log}");
    site.control("fault jog_stop_refused off");
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
}

#[test]
fn a_board_that_takes_nothing_not_even_an_abort_is_asked_again() {
    let site = running("");
    let mut board = site.connection();
    let held = holder(&site, &mut board);
    site.board_stands_still(true);
    drop(held);
    site.run_for(Duration::from_secs(4));
    assert!(site.log().contains("motor 1 MAY STILL MOVE"), "{}", site.log());
    site.board_stands_still(false);
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
}

#[test]
fn a_held_jog_is_stopped_before_the_daemon_ends_however_long_the_board_is_busy() {
    for command in ["SAVE", "$$$"] {
        let site = running_with(&["--slow", "1"], "");
        let mut board = site.connection();
        let told = hears_of_its_end(holder(&site, &mut board));
        // Typed on the serial port, so that no line of the daemon's own holds its port up.
        UnixStream::connect(site.path("serial"))
            .unwrap()
            .write_all(format!("{command}\r").as_bytes())
            .unwrap();
        site.run_for(Duration::from_millis(20));
        drop(board);
        assert_eq!(site.stop_daemon(), 0, "{command}: {}", site.log());
        assert!(!site.log().contains("MAY STILL MOVE: pmacd ends"), "{command}: {}", site.log());
        let told = told.join().unwrap().to_string();
        // Two seconds are longer than anybody should wait for that.
        assert!(told.contains("motor 1 MAY STILL MOVE"), "{command}: {told}");
        site.run_for(Duration::from_secs(2));
        site.start_daemon(&[]);
        site.wait_until("a board that answers", || site.pmacctl(&["send", "#1V"]).0 == 0);
        until(&mut site.connection(), "#1V", "it stands", |speed| speed.abs() < 0.1);
    }
}

#[test]
fn a_daemon_that_ends_says_which_motor_may_still_move() {
    let site = running("");
    let mut board = site.connection();
    let told = hears_of_its_end(holder(&site, &mut board));
    site.board_stands_still(true);
    assert_eq!(site.stop_daemon(), 1);
    let log = site.log();
    assert!(log.contains("motor 1 MAY STILL MOVE: pmacd ends"), "{log}");
    let told = told.join().unwrap().to_string();
    assert!(told.contains("motor 1 MAY STILL MOVE"), "it is not told that its jog was stopped: {told}");
}

#[test]
fn the_holder_is_told_that_the_motor_moves() {
    let site = running("stop_all_after_ms = 0\n");
    let mut board = site.connection();
    let mut held = holder(&site, &mut board);
    refuses(&site, &mut board);
    let told = held.panel("jog-stop", &[1]).unwrap_err().to_string();
    assert!(told.contains("motor 1 MAY STILL MOVE") && told.contains("pmacctl abort"), "{told}");
    assert!(told.contains("the board refused the command line (ERR003); pmacctl abort"), "{told}");
    // With ^A the answer says what that did.
    let site = running("");
    let mut board = site.connection();
    let mut held = holder(&site, &mut board);
    refuses(&site, &mut board);
    let told = held.panel("jog-stop", &[1]).unwrap_err().to_string();
    assert!(told.contains("so pmacd sent ^A") && told.contains("I2=3"), "{told}");
}

#[test]
fn abort_of_a_coordinate_system_falls_back_the_same_way() {
    let site = running("");
    let mut board = site.connection();
    board.send("&2 #2->X I293=$8C6", PATIENCE).unwrap();
    for (panel, line) in [("I2=3", "abort through the panel"), ("I2=1", "abort by line")] {
        for line in ["OPEN PROG 7 CLEAR", "LINEAR INC TM50 TA20 TS0", "WHILE (P1=0)", "X20", "ENDWHILE"] {
            board.send(line, PATIENCE).unwrap();
        }
        for line in ["CLOSE", "&2 B7 R", panel, "&1"] {
            board.send(line, PATIENCE).unwrap();
        }
        until(&mut board, "#2V", "it runs", |speed| speed > 0.1);
        let (status, _, stderr) = site.pmacctl(&["abort", "2"]);
        assert_eq!((status, stderr.as_str()), (0, ""), "{line}");
        until(&mut board, "#2V", "it is aborted", |speed| speed.abs() < 0.01);
        assert_eq!(ask(&mut board, "&"), 1.0, "{line}: &1 is addressed as before");
    }
    site.assert_no_violations();
}

#[test]
fn a_late_clearing_of_the_mask_is_not_taken_for_a_stop() {
    use pmac_dpram::daemon::bus::work::panel::PanelQueue;
    use pmac_dpram::daemon::shared::queue::{Event, Outcome, Ticket};
    use pmac_dpram::device::{Bus, FileBoard};
    use pmac_dpram::function::panel::{PanelAction, PanelRequest};
    use pmac_dpram::map::{Motors, PMAC, pmac};
    let words = &pmac::PANEL_BLOCK;
    let file = tempfile::tempfile().unwrap();
    file.set_len(PMAC.length.into()).unwrap();
    let mut bus = FileBoard::from_file(&file, PMAC.length as usize).unwrap();
    let begun = std::time::Instant::now();
    let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
    let late = begun + Duration::from_millis(10);
    let jog = PanelRequest::of(words, PanelAction::JogPlus, &[1]).unwrap();
    queue.submit(Ticket(1), jog, late, begun);
    assert!(queue.poll(&mut bus, begun).unwrap().is_none());
    let Some(Event::Done(Ticket(1), Outcome::Interrupted(told))) = queue.poll(&mut bus, late).unwrap() else {
        panic!("it was not withdrawn");
    };
    assert!(told.contains("It has been withdrawn"), "{told}");
    // The board had begun with the jog: it clears the mask, in which lies a stop by now.
    queue.end_hold(Ticket(2), Motors::of(1), late + Duration::from_millis(100), late);
    assert!(queue.poll(&mut bus, late).unwrap().is_none());
    assert_eq!(bus.read16(words.request_enable).unwrap(), 1, "the stop does not rest");
    bus.write16(words.request_enable, 0).unwrap();
    assert!(queue.poll(&mut bus, late).unwrap().is_none(), "that was not the stop");
    assert_eq!(bus.read16(words.request_enable).unwrap(), 1, "it is asked for again");
    bus.write16(words.request_enable, 0).unwrap();
    assert!(matches!(queue.poll(&mut bus, late).unwrap(), Some(Event::Done(Ticket(2), Outcome::Done))));
}

#[test]
fn another_ones_stop_ends_a_hold_and_no_other_jog_begins() {
    let site = running("");
    let mut board = site.connection();
    let mut held = holder(&site, &mut board);
    let mut other = site.connection();
    let who = format!("uid {} (pid {}) holds a jog of motor 1", nix::unistd::getuid(), std::process::id());
    for action in ["jog-", "jog+", "home", "pre-jog"] {
        let refused = other.panel(action, &[1, 2]).unwrap_err().to_string();
        assert!(refused.contains(&who) && refused.contains("nothing was sent"), "{action}: {refused}");
        held.panel_renew().unwrap();
    }
    assert!(other.panel_hold("jog-", &[1]).unwrap_err().to_string().contains(&who));
    held.panel_renew().unwrap();
    // A stop never is refused.
    other.panel("jog-stop", &[1]).unwrap();
    let told = held.panel_renew().unwrap_err().to_string();
    assert!(told.contains("the held jog is over") && told.contains("stopped motor 1"), "{told}");
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    other.panel_hold("jog+", &[1]).unwrap();
    drop(other);
    site.assert_no_violations();
}

#[test]
fn a_held_jog_notices_a_stop_that_came_by_another_way() {
    let site = running("");
    let mut board = site.connection();
    let mut held = holder(&site, &mut board);
    board.send("#1J/", PATIENCE).unwrap();
    let mut told = None;
    for _ in 0..20 {
        site.run_for(Duration::from_millis(50));
        told = held.panel_renew().err();
        if told.is_some() {
            break;
        }
    }
    let told = told.expect("the hold ends").to_string();
    assert!(told.contains("motor 1 stands; somebody stopped it"), "{told}");
    site.assert_no_violations();
}

#[test]
fn characters_that_only_report_fill_no_log() {
    let site = running("");
    let mut board = site.connection();
    for character in *b"\x02\x03\x06\x07\x10\x16" {
        board.control(character).unwrap();
    }
    for character in [control::ABORT, 0x04, control::KILL, control::HOLD, control::QUIT, control::RUN] {
        board.control(character).unwrap();
    }
    let log = site.log();
    let by = format!("uid {} pid {} sends ^", getuid(), std::process::id());
    let told: String = log.lines().filter_map(|line| line.split_once(&by)?.1.chars().next()).collect();
    assert_eq!(told, "ADKOQR", "{log}");
}

/// A script that is killed, or ends, as soon as it has sent its abort.
#[test]
fn a_stop_is_carried_out_though_its_sender_has_gone_before_it_is_answered() {
    let site = running("");
    let mut board = site.connection();
    for _ in 0..20 {
        board.send("#1J+", PATIENCE).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        let mut gone = UnixStream::connect(site.socket()).unwrap();
        gone.write_all(&call("SendControl", json!({ "character": "^A" }))).unwrap();
        drop(gone);
        // The abort may drop a question.
        let mut speed =
            || board.send("#1V", PATIENCE).ok().and_then(|lines| lines.first()?.parse::<f64>().ok());
        wait_until("a motor that stands", || speed().is_some_and(|speed| speed < 0.1));
    }
}
