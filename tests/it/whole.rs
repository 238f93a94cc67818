//! The main job, whole: board → daemon → segment → client, with clients of every kind.

use std::time::Duration;

use pmac_dpram::client::CommandError;
use pmac_dpram::map::HostOffset;
use pmac_dpram::protocol::CallError;
use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber};

use crate::support::{PATIENCE, VirtualSite, counter, is_live};

#[test]
fn a_client_sees_the_motors_move() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let (status, _, error) = site.pmacctl(&["send", "#1J=3000 #2J=-1500.5"]);
    assert_eq!((status, error.as_str()), (0, ""));
    let positions = || {
        // On a machine that stands still for a tenth of a second the data are stale, and say so.
        let (status, json, _) = site.pmacctl(&["motors", "--json"]);
        let document: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(document["servo"]["fresh"], status == 0);
        assert_eq!(document["motors"].as_array().unwrap().len(), 8);
        [0, 1].map(|motor| document["motors"][motor]["actual_position"]["value"].as_f64().unwrap_or(f64::NAN))
    };
    site.wait_until("both motors in their places", || {
        let [first, second] = positions();
        (first - 3000.0).abs() < 0.6 && (second + 1500.5).abs() < 0.6
    });
    let (status, json, _) = site.pmacctl(&["coordinates", "--json"]);
    assert_eq!(status, 0, "{json}");
    site.assert_no_violations();
    site.stop_daemon();
    assert!(Subscriber::attach(&site.segment()).is_err(), "a clean stop takes the segment away");
}

/// The board asks nothing while a program buffer is open: until then a position by the old scale would be wrong by a factor.
#[test]
fn a_position_whose_scale_was_changed_is_not_shown_by_the_old_one() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let position = || {
        let document: serde_json::Value =
            serde_json::from_str(&site.pmacctl(&["motors", "--json"]).1).unwrap();
        document["motors"][0]["actual_position"]["value"].as_f64()
    };
    let mut connection = site.connection();
    connection.send("#1J=3000", PATIENCE).unwrap();
    site.wait_until("motor 1 in its place", || {
        position().is_some_and(|counts| (counts - 3000.0).abs() < 0.6)
    });
    for line in ["I108=48", "OPEN PROG 50 CLEAR"] {
        connection.send(line, PATIENCE).unwrap();
    }
    for _ in 0..10 {
        assert_eq!(position(), None, "I108 is in doubt");
        site.run_for(Duration::from_millis(300));
    }
    connection.send("CLOSE", PATIENCE).unwrap();
    site.wait_until("the new scale", || position().is_some());
    let told = connection.send("#1P", PATIENCE).unwrap()[0].parse::<f64>().unwrap();
    assert!((position().unwrap() - told).abs() < 0.6, "{told}");
    site.assert_no_violations();
}

/// Updates of the run below; a minute at the default rate: `PMAC_STEPS=135528`.
fn steps() -> u64 {
    std::env::var("PMAC_STEPS").ok().and_then(|text| text.parse().ok()).unwrap_or(3000)
}

/// Steps the board, and has every update read: none is missed, none is lost.
fn every_update_is_read(site: &VirtualSite, steps: u64) {
    site.wait_for_live_servo();
    let subscriber = site.attach();
    site.hold();
    // The daemon knows by then when the board makes its updates.
    site.run_for(Duration::from_secs(1));
    let missed = counter(&subscriber, Counter::Missed);
    let mut cursor =
        subscriber.cursor(RegionId::Servo, subscriber.published(RegionId::Servo).unwrap() + 1).unwrap();
    let mut sample = Sample::new();
    let (mut last_timer, mut updates) = (None, 0);
    for step in 0..=steps {
        site.step(1);
        while subscriber.next(&mut cursor, &mut sample).unwrap() {
            let timer = sample.stamp().servo_timer;
            assert!(last_timer.is_none_or(|last| timer == last + 1), "step {step}");
            (last_timer, updates) = (Some(timer), updates + 1);
        }
        // The last one may be read in the next step.
        assert!(updates >= step, "step {step}");
    }
    assert_eq!(cursor.lost(), 0);
    assert_eq!(counter(&subscriber, Counter::Missed), missed);
    assert_eq!(counter(&subscriber, Counter::Skipped), 0);
    assert_eq!(site.status()["skipped"], 0);
    site.assert_no_violations();
}

#[test]
fn no_update_is_missed_and_no_sample_lost() {
    every_update_is_read(&VirtualSite::running(&[], &[]), steps());
}

#[test]
fn the_documented_handshake_delivers_the_same() {
    every_update_is_read(&VirtualSite::configured(&[], "servo_reading = \"handshake\"\n"), 500);
}

#[test]
fn commands_replies_and_errors_pass_through() {
    let site = VirtualSite::running(&[], &[]);
    let mut connection = site.connection();
    let long = format!("P1=1{}", "+1".repeat(98));
    assert_eq!(long.len(), 200);
    for (line, reply) in [
        ("P1=25 P2=50 P3=75", &[] as &[&str]),
        ("P1..3", &["25", "50", "75"]),
        ("VERSION", &["1.16D"]),
        (&long[..158], &[]),
        (&long[..160], &[]),
        (&long, &[]),
        ("P1", &["99"]),
    ] {
        assert_eq!(connection.send(line, PATIENCE).unwrap(), reply, "{line}");
    }
    // A line of exactly 159 characters is the longest that goes in one part.
    let line = format!("P2={}", "1+".repeat(77) + "15");
    assert_eq!(line.len(), 159);
    assert_eq!(connection.send(&line, PATIENCE).unwrap(), [] as [&str; 0]);
    assert_eq!(connection.send("P2", PATIENCE).unwrap(), ["92"]);
    match connection.send("P1 #99", PATIENCE) {
        Err(CommandError::Refused(CallError::Board { code: 3, lines, .. })) => assert_eq!(lines, ["99"]),
        other => panic!("{other:?}"),
    }
    let (_, words) = connection.read(HostOffset::new(0x0024), 2).unwrap();
    assert_eq!(words[0], 0, "Host-Busy is not left set");
    assert_eq!(connection.control(16).unwrap().len(), 1, "^P answers with one line");
    assert_eq!(connection.control(11).unwrap(), [] as [&str; 0]);
    assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["99"]);
    let (status, stdout, stderr) = site.pmacctl(&["send", "P1 #99"]);
    assert_eq!((status, stdout.as_str()), (1, "99\n"));
    assert!(stderr.starts_with("ERR003: "), "{stderr}");
    assert_eq!(site.pmacctl(&["send", "^K"]).0, 0);
    let log = site.log();
    assert!(log.contains("#99") && log.contains(&format!("pid {}", std::process::id())), "{log}");
    site.assert_no_violations();
}

#[test]
fn texts_of_programs_reach_who_listens_and_never_a_reply() {
    let site = VirtualSite::running(&[], &[]);
    let mut messages = site.connection().messages().unwrap();
    let mut connection = site.connection();
    assert_eq!(connection.send("P1=5", PATIENCE).unwrap(), [] as [&str; 0]);
    for round in 0..20 {
        site.control(&format!("send DOOR {round}"));
        assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["5"]);
        site.control("cmd P1");
        assert_eq!(connection.send("P1", PATIENCE).unwrap(), ["5"]);
    }
    let mut texts = Vec::new();
    while texts.len() < 40 {
        let message = messages.next_within(PATIENCE).unwrap().expect("a message in time");
        texts.push(message.text);
    }
    assert_eq!(texts.iter().filter(|text| text.starts_with("DOOR ")).count(), 20);
    assert_eq!(texts.iter().filter(|text| *text == "5").count(), 20);
    site.assert_no_violations();
}

#[test]
fn replies_come_without_interrupts_and_in_spite_of_false_ones() {
    let site = VirtualSite::running(&[], &[]);
    let mut connection = site.connection();
    site.control("fault lost_interrupt on");
    for _ in 0..3 {
        assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    }
    site.control("fault lost_interrupt off");
    site.control("fault spurious_interrupt 5");
    for _ in 0..10 {
        assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    }
    let subscriber = site.attach();
    site.wait_until("interrupts", || counter(&subscriber, Counter::Interrupts) > 0);
    site.assert_no_violations();
}

#[test]
fn an_interrupt_that_is_connected_and_does_not_come_is_not_relied_on() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let subscriber = site.attach();
    let is_told = || site.pmacctl(&["doctor"]).1.contains("connected, and announces the board's replies");
    assert!(is_told());
    // As with I56=0. Before, each text lay for up to a second.
    site.control("fault lost_interrupt on");
    site.run_for(Duration::from_millis(200));
    assert_eq!(site.ask("P1"), ["0"]);
    site.hold();
    site.step(500);
    let before = counter(&subscriber, Counter::AsciiUnsolicited);
    for texts in 1..=10 {
        site.control("send DOOR");
        // The daemon still asks for definitions, and a text comes behind a reply.
        site.step(300);
        assert_eq!(counter(&subscriber, Counter::AsciiUnsolicited) - before, texts);
    }
    site.go_on();
    assert!(!is_told());
    site.control("fault lost_interrupt off");
    assert_eq!(site.ask("P1"), ["0"]);
    assert!(is_told());
    site.assert_no_violations();
}

#[test]
fn the_period_that_is_told_is_the_boards() {
    let site = VirtualSite::running(&["--servo-hz", "2000"], &[]);
    site.wait_for_live_servo();
    site.run_for(Duration::from_secs(2));
    let period = site.attach().region(RegionId::Servo).unwrap().period_ns;
    assert!((498_500..501_500).contains(&period), "{period}");
}

#[test]
fn a_late_acknowledgement_never_answers_the_next_command() {
    let site = VirtualSite::running(&[], &[]);
    let mut connection = site.connection();
    site.wait_for_identity();
    site.control("fault ascii_late_ack 600ms");
    for _ in 0..3 {
        let timed_out = connection.send("I10", Duration::from_millis(200));
        assert!(matches!(timed_out, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{timed_out:?}");
        assert_eq!(connection.send("I19", PATIENCE).unwrap(), ["1"]);
    }
    site.control("fault ascii_late_ack off");
    assert_eq!(connection.send("I59", PATIENCE).unwrap(), ["8"]);
    site.assert_no_violations();
}

#[test]
fn a_board_that_stops_in_any_way_turns_stale_and_comes_back_by_itself() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    for fault in ["servo_busy_stuck", "servo_silent", "all_ones"] {
        site.control(&format!("fault {fault} on"));
        site.wait_until(&format!("stale data after {fault}"), || !is_live(&subscriber, RegionId::Servo));
        let (status, json, _) = site.pmacctl(&["motors", "--json"]);
        let document: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!((status, &document["servo"]["fresh"]), (1, &serde_json::json!(false)), "{fault}");
        site.control(&format!("fault {fault} off"));
        site.wait_until(&format!("live data after {fault}"), || is_live(&subscriber, RegionId::Servo));
    }
    assert_eq!(site.log().matches("servo data: stale").count(), 3, "each is said once:\n{}", site.log());
    site.control("fault background_stuck on");
    site.wait_until("stale background", || !is_live(&subscriber, RegionId::Background));
    site.control("fault background_stuck off");
    site.wait_until("live background", || is_live(&subscriber, RegionId::Background));
}

#[test]
fn a_deaf_or_dumb_board_costs_a_command_its_time_and_no_more() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let mut connection = site.connection();
    let answers = |connection: &mut pmac_dpram::client::Connection| {
        assert_eq!(connection.send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    };
    site.wait_for_identity();
    answers(&mut connection);
    site.control("fault ascii_deaf on");
    // It may be at the line. Nothing more is sent until it shows that it is not.
    let deaf = connection.send("VERSION", Duration::from_millis(500));
    assert!(matches!(deaf, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{deaf:?}");
    let deaf = connection.send("VERSION", Duration::from_millis(500));
    assert!(matches!(deaf, Err(CommandError::Refused(CallError::Refused { .. }))), "{deaf:?}");
    site.control("fault ascii_deaf off");
    answers(&mut connection);
    site.control("fault ascii_no_reply on");
    let dumb = connection.send("VERSION", Duration::from_millis(500));
    assert!(matches!(dumb, Err(CommandError::Refused(CallError::TimedOut { .. }))), "{dumb:?}");
    site.control("fault ascii_no_reply off");
    answers(&mut connection);
    assert!(is_live(&site.attach(), RegionId::Servo), "the servo data do not suffer");
}

#[test]
fn a_reset_in_between_is_survived() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    site.control("reset");
    site.wait_until("stale data: the reset ended the servo report", || {
        !is_live(&subscriber, RegionId::Servo)
    });
    let mut connection = site.connection();
    // The saved I58=1 is back; the report needs its GATHER.
    connection.send("GATHER", PATIENCE).unwrap();
    site.wait_until("live data", || is_live(&subscriber, RegionId::Servo));
    site.assert_no_violations();
}
