//! Command lines through the VME mailboxes: always, or while the DPRAM's port is off; the DPRAM's page after resets.

use std::time::Duration;

use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::protocol::{CallError, CommandPort};
use pmac_dpram::segment::{Counter, RegionId};

use crate::support::{PATIENCE, VirtualSite, counter, is_live};

/// What a VME board's simulator needs besides its memory.
fn mailbox_options(site: &VirtualSite, more: &[&str]) -> Vec<String> {
    let path = |name: &str| site.path(name).display().to_string();
    let mut options: Vec<String> =
        ["--mailbox", &path("mailbox"), "--mailbox-taken"].map(str::to_owned).into();
    options.push(format!("unix:{}", path("taken")));
    options.extend(["--mailbox-response".to_owned(), format!("unix:{}", path("response"))]);
    options.extend(more.iter().map(|&option| option.to_owned()));
    options
}

/// A VME board whose start-up lines are `startup`, with a daemon whose mailbox table ends with `keys`.
fn vme(startup: &str, simulator: &[&str], keys: &str) -> VirtualSite {
    vme_with("", startup, simulator, keys)
}

/// The same, with a daemon whose configuration begins with `first`.
fn vme_with(first: &str, startup: &str, simulator: &[&str], keys: &str) -> VirtualSite {
    let site = VirtualSite::new();
    let path = |name: &str| site.path(name).display().to_string();
    std::fs::write(site.path("startup"), startup).unwrap();
    let startup = ["--startup", &path("startup")];
    let options = mailbox_options(&site, &[&startup, simulator].concat());
    let config = format!(
        "{first}[mailbox]\nregisters = \"file:{}\"\ntaken = \"unix:{}\"\nreply = \"unix:{}\"\n{keys}",
        path("mailbox"),
        path("taken"),
        path("response")
    );
    let config_path = path("config");
    std::fs::write(&config_path, config).unwrap();
    site.start_simulator(&options.iter().map(String::as_str).collect::<Vec<_>>());
    site.start_daemon(&["--config", &config_path]);
    site
}

/// The shipped start-up lines (with I58=1, which sets I3 and I6 too), then `more`.
fn shipped(more: &str) -> String {
    format!("{}\n{more}\n", include_str!("../../src/sim/dpram-startup.pmc"))
}

fn port(site: &VirtualSite) -> CommandPort {
    site.connection().info().unwrap().lines.command_port
}

fn identified(site: &VirtualSite) {
    site.wait_for_identity();
}

#[test]
fn all_command_lines_go_through_the_mailboxes() {
    let site = vme(&shipped("I58=0"), &[], "use = \"always\"\n");
    site.wait_for_live_servo();
    identified(&site);
    let mut connection = site.connection();
    let long = format!("P1=1{}", "+1".repeat(98));
    for (line, reply) in [
        ("P1=25 P2=50 P3=75", &[] as &[&str]),
        ("P1..3", &["25", "50", "75"]),
        ("VERSION", &["1.16D"]),
        ("I58", &["0"]),
        ("P1=123456789012", &[]),
        ("P1", &["123456789012"]),
        (&long, &[]),
        ("P1", &["99"]),
    ] {
        assert_eq!(connection.send(line, PATIENCE).unwrap(), reply, "{line}");
    }
    match connection.send("P1 #99", PATIENCE) {
        Err(CommandError::Refused(CallError::Board { code: 3, lines, .. })) => assert_eq!(lines, ["99"]),
        other => panic!("{other:?}"),
    }
    assert_eq!(connection.control(16).unwrap().len(), 1, "^P answers with one line");
    assert_eq!(connection.control(11).unwrap(), [] as [&str; 0]);
    assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["99"]);
    assert_eq!(port(&site), CommandPort::Mailbox);
    let (status, stdout, _) = site.pmacctl(&["status"]);
    assert_eq!(status, 0);
    assert!(stdout.contains("through the VME mailboxes"), "{stdout}");
    let (_, stdout, _) = site.pmacctl(&["doctor"]);
    assert!(
        stdout.contains("ok    commands      the board takes command lines through the VME mailboxes"),
        "{stdout}"
    );
    assert!(counter(&site.attach(), Counter::Interrupts) > 0);
    site.assert_no_violations();
}

#[test]
fn an_error_has_its_number_whether_its_bell_stands_alone_or_not() {
    let turbo = concat!(include_str!("../../src/sim/dpram-startup-turbo.pmc"), "\nI58=0\n");
    for (family, startup) in [("pmac", shipped("I58=0")), ("turbo2", turbo.to_owned())] {
        let config = format!("family = {family:?}\n");
        let site = vme_with(&config, &startup, &["--family", family], "use = \"always\"\n");
        identified(&site);
        let mut connection = site.connection();
        for (line, number) in [("UUU", 3), ("X10", 5), ("P1 UUU", 3)] {
            match connection.send(line, PATIENCE) {
                Err(CommandError::Refused(CallError::Board { code, .. })) => {
                    assert_eq!(code, number, "{family}: {line}")
                }
                other => panic!("{family}: {line}: {other:?}"),
            }
            assert_eq!(connection.send("I58", PATIENCE).unwrap(), ["0"], "{family}");
        }
        site.assert_no_violations();
    }
}

#[test]
fn a_group_that_begins_with_the_byte_left_in_mailbox_0_is_seen() {
    let site = vme(&shipped(""), &[], "use = \"always\"\n");
    identified(&site);
    let mut board = site.connection();
    let mut soon = |what: &str, action: &mut dyn FnMut(&mut Connection)| {
        let before = site.with_world(|world| world.now_ns());
        action(&mut board);
        let took = (site.with_world(|world| world.now_ns()) - before) / 1_000_000;
        assert!(took < 500, "{what}: {took} ms");
    };
    for _ in 0..3 {
        // An <ACK>, which is ^F, lies in mailbox 0 then.
        soon("P1=5", &mut |board| assert_eq!(board.send("P1=5", PATIENCE).unwrap(), [""; 0]));
        soon("^F", &mut |board| assert_eq!(board.control(b'F' - 64).unwrap().len(), 1));
        // The first character of the reply lies there: the next line begins with it.
        soon("P1", &mut |board| assert_eq!(board.send("P1", PATIENCE).unwrap(), ["5"]));
    }
    site.assert_no_violations();
}

#[test]
fn interleaved_clients_never_get_each_others_replies() {
    let site = vme(&shipped("I58=0"), &[], "use = \"always\"\n");
    identified(&site);
    let clients: Vec<_> = (1..=6)
        .map(|client| {
            let mut connection = site.connection();
            std::thread::spawn(move || {
                let mut answered = 0;
                for round in 0..25 {
                    let value = 1000 * client + round;
                    let line = format!("P{client}={value} P1{client}={value}+1 P{client} P1{client}");
                    match connection.send(&line, PATIENCE) {
                        Ok(lines) => {
                            assert_eq!(lines, [value.to_string(), (value + 1).to_string()], "{line}");
                            answered += 1;
                        }
                        // One whose time was over: what comes of it later must not be another's.
                        Err(error) => panic!("{line}: {error}"),
                    }
                    if client == 1 && round % 5 == 0 {
                        // Not answered in time, most of the time.
                        let _ = connection.send("P1..30", Duration::from_millis(1));
                    }
                    if client == 2 {
                        assert_eq!(connection.control(16).unwrap().len(), 1);
                    }
                }
                answered
            })
        })
        .collect();
    let answered: i32 = clients.into_iter().map(|client| client.join().unwrap()).sum();
    assert_eq!(answered, 150);
    site.assert_no_violations();
}

#[test]
fn a_reply_that_comes_too_late_is_nobody_elses() {
    let site = vme(&shipped("I58=0"), &[], "use = \"always\"\n");
    identified(&site);
    let mut connection = site.connection();
    for round in 0..4 {
        // Each group, of either side, takes so many passes that the reply does not end in time, and so few that a board on a busy
        // machine takes the cancel in time.
        site.control("fault mailbox_late 40");
        let late = connection.send("P1..9", Duration::from_millis(150));
        // The next line finds the board as slow, or not.
        if round % 2 == 0 {
            site.control("fault mailbox_late off");
        }
        assert!(
            matches!(
                late,
                Err(CommandError::Refused(CallError::TimedOut { .. } | CallError::Unavailable { .. }))
            ),
            "{late:?}"
        );
        assert_eq!(connection.send("I19", PATIENCE).unwrap(), ["1"]);
    }
    site.control("fault mailbox_stuck on");
    let stuck = connection.send("I19", Duration::from_millis(300));
    assert!(matches!(stuck, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{stuck:?}");
    site.control("fault mailbox_stuck off");
    assert_eq!(connection.send("I59", PATIENCE).unwrap(), ["8"]);
}

#[test]
fn texts_of_programs_reach_who_listens_and_never_a_reply() {
    let site = vme(&shipped("I58=0"), &[], "use = \"always\"\n");
    let mut messages = site.connection().messages().unwrap();
    let mut connection = site.connection();
    assert_eq!(connection.send("P1=5", PATIENCE).unwrap(), [] as [&str; 0]);
    identified(&site);
    for round in 0..10 {
        site.control(&format!("send DOOR {round}"));
        let message = messages.next_within(PATIENCE).unwrap().expect("a message in time");
        assert_eq!(message.text, format!("DOOR {round}"));
        assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["5"]);
    }
    site.assert_no_violations();
}

#[test]
fn the_mailboxes_take_over_while_i58_is_off_and_give_back() {
    let site = vme(&shipped(""), &[], "");
    identified(&site);
    let mut connection = site.connection();
    assert_eq!(port(&site), CommandPort::Dpram);
    for round in 0..3 {
        assert_eq!(connection.send("P1=0", PATIENCE).unwrap(), [] as [&str; 0]);
        assert_eq!(site.connection().confirming(true).send("I58=0", PATIENCE).unwrap(), [] as [&str; 0]);
        // The first line finds out, and is carried out once all the same.
        assert_eq!(connection.send("P1=P1+1", PATIENCE).unwrap(), [] as [&str; 0]);
        assert_eq!(connection.send("P1 I58", PATIENCE).unwrap(), ["1", "0"], "round {round}");
        site.wait_until("the mailboxes to be told of", || port(&site) == CommandPort::Mailbox);
        assert_eq!(connection.send("I58=1", PATIENCE).unwrap(), [] as [&str; 0]);
        site.wait_until("the DPRAM to be told of", || port(&site) == CommandPort::Dpram);
        assert_eq!(connection.send("I58", PATIENCE).unwrap(), ["1"]);
    }
    let log = site.log();
    assert_eq!(log.matches("command lines: VME mailboxes, I58=0").count(), 3, "{log}");
    assert_eq!(log.matches("command lines: DPRAM, I58=1").count(), 3, "{log}");
    site.assert_no_violations();
}

#[test]
fn what_stops_the_machine_takes_the_other_way_too() {
    let site = vme(&shipped(""), &[], "");
    identified(&site);
    let mut connection = site.connection();
    connection.send("#1J+", PATIENCE).unwrap();
    site.connection().confirming(true).send("I58=0", PATIENCE).unwrap();
    assert_eq!(connection.control(11).unwrap(), [] as [&str; 0], "^K");
    let (_, json, _) = site.pmacctl(&["status", "--json"]);
    let status: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(status["socket"]["command_port"], "mailbox");
    let still = || {
        let at = |connection: &mut pmac_dpram::client::Connection| connection.send("#1P", PATIENCE).unwrap();
        let mut connection = site.connection();
        let first = at(&mut connection);
        first == at(&mut connection)
    };
    site.wait_until("the motor to stand", still);
    site.assert_no_violations();
}

#[test]
fn what_stops_the_machine_does_not_wait_behind_a_line_that_is_not_taken() {
    let site = vme(&shipped("I58=0"), &[], "use = \"always\"\n");
    identified(&site);
    let mut connection = site.connection();
    connection.send("#1J+", PATIENCE).unwrap();
    site.control("fault mailbox_stuck on");
    std::thread::scope(|scope| {
        let mut other = site.connection();
        let line = scope.spawn(move || other.send("P1=1", 10 * PATIENCE));
        let kill = scope.spawn(|| {
            site.wait_until("^K to be taken", || {
                // The line is to be under way by then, and again when something else was.
                site.run_for(Duration::from_secs(2));
                site.connection().control(11).is_ok()
            })
        });
        // The line ends long before its own time is over, because ^K has gone over it.
        let line = line.join().unwrap();
        assert!(matches!(line, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{line:?}");
        site.control("fault mailbox_stuck off");
        kill.join().unwrap();
    });
    let position = || site.connection().send("#1P", PATIENCE).unwrap();
    site.wait_until("the motor to stand", || position() == position());
    assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["0"], "the board never took the line");
}

#[test]
fn a_board_that_starts_with_i58_off_is_identified_through_the_mailboxes() {
    let site = vme("I3=2\nI6=1\n", &[], "");
    identified(&site);
    assert_eq!(port(&site), CommandPort::Mailbox);
    assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    site.assert_no_violations();
}

#[test]
fn the_page_is_written_at_the_start_and_after_every_reset() {
    let resets = |site: &VirtualSite| site.log().matches("the board was reset").count();
    // Noticed by the servo data, or, where the board reports none, by words that read as all ones.
    for (startup, keys) in [
        (shipped("SAVE"), "use = \"never\"\npage = 0x3F\n"),
        (shipped("SAVE"), "page = 0x3F\n"),
        (shipped("I48=0\nSAVE\nENDGATHER"), "page = 0x3F\n"),
        (shipped("I48=0\nSAVE\nENDGATHER"), "use = \"always\"\npage = 0x3F\n"),
    ] {
        let site = vme(&startup, &["--dpram-page", "0x3F"], keys);
        identified(&site);
        let subscriber = site.attach();
        for _ in 0..2 {
            let (before, noticed) = (counter(&subscriber, Counter::BackgroundUpdates), resets(&site));
            site.control("reset");
            site.wait_until("the reset to be noticed", || resets(&site) > noticed);
            site.wait_until("background data", || {
                counter(&subscriber, Counter::BackgroundUpdates) > before
                    && is_live(&subscriber, RegionId::Background)
            });
            let mut connection = site.connection();
            assert_eq!(connection.send("I58", PATIENCE).unwrap(), ["1"], "{keys}");
            connection.send("I48=1 GATHER", PATIENCE).unwrap();
            site.wait_until("servo data", || is_live(&subscriber, RegionId::Servo));
            connection.send("ENDGATHER", PATIENCE).unwrap();
        }
        site.assert_no_violations();
    }
}

#[test]
fn a_page_that_a_reset_took_is_written_again_where_no_report_runs() {
    // Only lines: nothing else of the board tells of a reset.
    let keys = "use = \"never\"\npage = 0x3F\n";
    let site = vme_with("functions = [\"ascii\"]\n", &shipped("SAVE"), &["--dpram-page", "0x3F"], keys);
    identified(&site);
    let page = || std::fs::read(site.path("mailbox")).unwrap()[0x121];
    let mut connection = site.connection();
    assert_eq!(connection.send("I58", PATIENCE).unwrap(), ["1"]);
    site.control("fault other_page on");
    site.control("reset");
    let begun = site.with_world(|world| world.now());
    let lost = connection.send("I58", Duration::from_millis(500));
    assert!(lost.is_err(), "another page shows: {lost:?}");
    site.wait_until("the page to be written", || page() == 0x3F);
    site.wait_until("a board that answers", || connection.send("I58", PATIENCE).is_ok());
    let took = site.with_world(|world| world.now()) - begun;
    assert!(took < Duration::from_secs(5), "{took:?}");
    assert_eq!(site.log().matches("writes the DPRAM's page 0x3F again").count(), 1, "{}", site.log());
    site.assert_no_violations();
}

#[test]
fn a_page_that_is_not_configured_is_not_written() {
    let site = vme(&shipped(""), &["--dpram-page", "0x3F"], "use = \"always\"\n");
    identified(&site);
    let page = std::fs::read(site.path("mailbox")).unwrap()[0x121];
    assert_eq!(page, 0xFF, "as the reset left it");
    assert!(!is_live(&site.attach(), RegionId::Servo), "out of reach");
    // The mailboxes answer all the same.
    assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
}

/// A VME board of `family` whose DPRAM shows nothing, and the configuration of its mailboxes.
fn silent_vme(family: &str, written: &str) -> (VirtualSite, String) {
    let site = VirtualSite::new();
    let path = |name: &str| site.path(name).display().to_string();
    let startup = site.file("startup", "I3=2\nI6=1\n");
    let board = ["--family", family, "--dpram", "8k", "--startup", &startup];
    let options = mailbox_options(&site, &board);
    site.start_simulator(&options.iter().map(String::as_str).collect::<Vec<_>>());
    let config = format!(
        "family = \"{written}\"\n[mailbox]\nregisters = \"file:{}\"\ntaken = \"unix:{}\"\nreply = \"unix:{}\"\n",
        path("mailbox"),
        path("taken"),
        path("response")
    );
    let config = site.file("pmacd.toml", &config);
    (site, config)
}

#[test]
fn a_board_that_shows_nothing_is_asked_through_its_mailboxes() {
    for family in ["pmac", "pmac2", "turbo", "turbo2"] {
        let (site, config) = silent_vme(family, "auto");
        site.start_daemon(&["--config", &config]);
        site.wait_until("its own family", || {
            let status = site.hurried(|| site.pmacctl(&["status", "--json"]).1);
            serde_json::from_str::<serde_json::Value>(&status).unwrap()["family"] == family
        });
        assert_eq!(site.connection().send("TYPE", PATIENCE).unwrap().len(), 1, "{family}");
        site.assert_no_violations();
    }
}

#[test]
fn a_family_that_the_mailboxes_contradict_is_refused() {
    for (family, written, right) in [("turbo2", "pmac", "turbo"), ("pmac", "turbo", "pmac")] {
        let (site, config) = silent_vme(family, written);
        let before = std::fs::read(site.path("dpram")).unwrap();
        let error = site.refusal(&config);
        assert!(error.contains(&format!("write family = \"{right}\"")), "{error}");
        assert_eq!(std::fs::read(site.path("dpram")).unwrap(), before, "{family}");
    }
}
