//! Finds out whose an error is: the line's, or a program's.

use super::*;
use crate::daemon::bus::identify::Identifier;

/// A line that the board has taken, beside programs that may make errors.
fn at(line: &str) -> Rig {
    let mut rig = Rig::new();
    rig.send(1, line, Duration::from_secs(60));
    rig.send(2, "P2=1", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), line);
    rig.poll();
    rig
}

#[test]
fn the_next_exchange_and_no_clock_settles_that_an_error_is_the_lines() {
    let mut rig = at("LIST PROG 9");
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.told(), [""; 0]);
    rig.answer_check();
    assert_eq!(rig.told(), ["1 Error(3)"]);
    assert_eq!(rig.take(), "P2=1", "the next line goes at once");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.told(), ["2 Done"]);
}

#[test]
fn a_line_has_its_own_reply_behind_a_programs_error() {
    for (line, reply) in [
        ("P7", &["25"][..]),
        ("I3", &["2"]),
        ("I3 I10", &["2", "3713707"]),
        ("I3 I10 I11 I12", &["2", "3713707", "3713707", "3713707"]),
        ("LIST PROG 9", &["X10", "2", "3713707", "2"]),
        ("P7=5", &[]),
    ] {
        for is_before_check in [false, true] {
            let mut rig = at(line);
            // So it goes if the board puts out the next response at once.
            rig.bus.write16(PMAC.ascii.response_control, response::ERROR | 5).unwrap();
            let event = rig.queue.ports.poll(&mut rig.bus, rig.now).unwrap().unwrap();
            let poll = Poll { events: &rig.events, publisher: &rig.publisher, now: rig.now };
            rig.queue.handle(poll, event);
            if !is_before_check {
                rig.poll();
                assert!(rig.loaded());
            }
            reply.iter().for_each(|text| rig.say(text));
            rig.respond(response::ACKNOWLEDGE);
            let lines = reply.iter().map(|text| format!("1 {text}"));
            let expected: Vec<_> = lines.chain(["Error ERR005", "1 Done"].map(str::to_owned)).collect();
            assert_eq!(rig.told(), expected, "{line} {is_before_check}");
            let next = rig.take();
            if next != "P2=1" {
                assert!(!(is_before_check && reply.is_empty()), "nothing was left to settle");
                let period = vec!["3713707"; next.split(' ').count() - 2];
                ["2"].iter().chain(&period).chain(&["2"]).for_each(|line| rig.say(line));
                rig.respond(response::ACKNOWLEDGE);
                assert_eq!(rig.take(), "P2=1", "{line} {is_before_check}");
            }
            rig.respond(response::ACKNOWLEDGE);
            assert_eq!(rig.told(), ["2 Done"], "{line} {is_before_check}");
        }
    }
}

#[test]
fn of_two_errors_nobody_knows_which_is_the_lines() {
    for (second, told) in [
        (3, "1 Error(3)".to_owned()),
        (
            5,
            "1 Interrupted(\"the board reported ERR003, of the line or of a program, and has not shown which\")".to_owned(),
        ),
    ] {
        let mut rig = at("XYZZY");
        rig.respond(response::ERROR | 3);
        rig.respond(response::ERROR | second);
        rig.answer_check();
        assert_eq!(rig.told(), [told]);
    }
}

#[test]
fn a_programs_error_before_the_end_of_our_own_reply_ends_nothing() {
    let mut rig = at("XYZZY");
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.take(), "I3 I10 I3");
    ["2", "3713707", "2"].iter().for_each(|line| rig.say(line));
    rig.respond(response::ERROR | 5);
    assert!(!rig.loaded(), "the next line would be ended by the end of our own reply");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.told(), ["Error ERR005", "1 Error(3)"]);
    assert_eq!(rig.take(), "P2=1");
}

#[test]
fn a_line_may_be_refused_behind_its_first_values_and_a_programs_error() {
    let mut rig = at("P1 P2 BAD");
    rig.respond(response::ERROR | 5);
    ["25", "50"].iter().for_each(|line| rig.say(line));
    rig.respond(response::ERROR | 3);
    let next = rig.take();
    let period = vec!["3713707"; next.split(' ').count() - 2];
    ["2"].iter().chain(&period).chain(&["2"]).for_each(|line| rig.say(line));
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.told(), ["1 25", "1 50", "Error ERR005", "1 Error(3)"]);
    assert_eq!(rig.take(), "P2=1");
}

#[test]
fn a_line_whose_error_is_not_settled_in_its_time_may_have_been_carried_out() {
    let mut rig = Rig::new();
    rig.send(1, "#1J+", Duration::from_millis(400));
    rig.poll();
    rig.take();
    rig.poll();
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.take(), "I3 I10 I3");
    rig.now += Duration::from_millis(400);
    rig.poll();
    assert!(matches!(rig.ended()[..], [(1, Outcome::Interrupted(_))]));
}

#[test]
fn our_own_line_waits_as_long_as_the_caller_of_a_slow_line_that_a_programs_error_came_to() {
    let mut rig = at("SAVE");
    rig.respond(response::ERROR | 5);
    assert!(rig.loaded());
    rig.now += Duration::from_secs(10);
    rig.poll();
    assert_eq!(rig.told(), [""; 0]);
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.told(), ["Error ERR005", "1 Done"]);
    rig.answer_check();
    assert_eq!(rig.take(), "P2=1");
}

#[test]
fn an_error_in_an_open_buffer_is_settled_by_a_question_that_enters_none() {
    let mut rig = Rig::new();
    rig.send(1, "OPEN PROG 5", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "OPEN PROG 5");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    rig.queue.see_buffer(Some((true, 10)));
    rig.send(2, "BAD", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "BAD");
    rig.poll();
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.take(), "SIZE SIZE");
    rig.poll();
    ["-31000"; 2].iter().for_each(|line| rig.say(line));
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.told(), ["1 Done", "2 Error(3)"]);
    assert!(!rig.loaded(), "nothing else is in doubt");
}

#[test]
fn where_no_program_can_report_one_an_error_is_the_lines_at_once() {
    // I5, I6, whether a motion program runs, and whether the daemon tells the error at once.
    for (i5, i6, runs, at_once) in [
        ("0", "1", Some(false), true),
        ("0", "1", Some(true), false),
        ("0", "1", None, false),
        ("2", "1", Some(false), false),
        ("2", "2", Some(true), true),
    ] {
        let mut rig = Rig::new();
        rig.queue.identifier = Identifier::new(&PMAC, Identity::default(), true, rig.now);
        rig.poll();
        while rig.loaded() {
            let line = rig.take();
            let count = line.matches('I').count();
            let lines: Vec<_> = match &*line {
                "TYPE" | "VERSION" => vec!["1"],
                line if line.ends_with("I5 I6") => [&vec!["1"; count - 2][..], &[i5, i6]].concat(),
                _ => vec!["1"; count],
            };
            lines.into_iter().for_each(|line| rig.say(line));
            rig.respond(response::ACKNOWLEDGE);
        }
        let asked = rig.queue.clock.ns_of(rig.now);
        rig.queue.see_programs(runs.map(|runs| (runs, asked)));
        rig.send(1, "LIST PROG 9", Duration::from_secs(60));
        rig.poll();
        assert_eq!(rig.take(), "LIST PROG 9");
        rig.poll();
        rig.respond(response::ERROR | 3);
        assert_eq!(!rig.ended().is_empty(), at_once, "I5={i5} I6={i6} {runs:?}");
    }
}

#[test]
fn a_programs_error_is_a_message() {
    let mut rig = Rig::new();
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.told(), ["Error ERR003"]);
}
