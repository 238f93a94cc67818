//! The daemon's question about a program buffer before a line, and its trust in the answer.

use super::*;

#[test]
fn without_servo_reports_the_board_is_asked_before_a_line() {
    for (size, expected) in [("-41301", None), ("41301", Some("P5=7")), ("0", Some("P5=7"))] {
        let mut rig = Rig::without_reports();
        rig.send(1, "P5=7", Duration::from_secs(60));
        rig.poll();
        assert_eq!(rig.take(), "SIZE");
        rig.answer(&[size]);
        assert_eq!(rig.loaded(), expected.is_some(), "{size}");
        if let Some(line) = expected {
            assert_eq!(rig.take(), line);
            rig.respond(response::ACKNOWLEDGE);
            assert_eq!(rig.ended(), [(1, Outcome::Done)]);
        } else {
            assert_eq!(rig.ended(), [(1, Outcome::Barred(Barred::Open(None)))]);
            assert!(rig.status().buffer.is_open);
        }
    }
}

#[test]
fn a_board_that_does_not_know_the_question_still_gets_lines() {
    let mut rig = Rig::without_reports();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SIZE");
    rig.poll();
    rig.respond(response::ERROR | 3);
    // A program's error, as far as the daemon knows.
    assert_eq!(rig.take(), "SIZE SIZE");
    rig.poll();
    rig.respond(response::ERROR | 3);
    assert_eq!(rig.take(), "I3 I10 I10 I3");
    for line in ["2", "3713707", "3713707", "2"] {
        rig.say(line);
    }
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.take(), "P5=7");
}

#[test]
fn what_may_have_entered_a_buffer_is_not_told_as_done() {
    let mut rig = Rig::new();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "P5=7");
    // A host on the serial port was a little sooner.
    rig.queue.see_buffer(Some((true, 2)));
    rig.respond(response::ACKNOWLEDGE);
    let reason = Text::of(&Barred::Open(None).too_late());
    assert_eq!(rig.ended(), [(1, Outcome::Interrupted(reason))]);
    rig.send(2, "#1P", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "#1P");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(2, Outcome::Done)], "it stores nothing");
}

#[test]
fn a_board_that_says_nothing_of_its_buffers_gets_lines_and_that_is_told() {
    let mut rig = Rig::without_reports();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SIZE");
    rig.respond(response::ACKNOWLEDGE);
    rig.poll();
    assert_eq!(rig.take(), "P5=7");
    assert!(rig.status().buffer.is_unsaid);
    rig.queue.see_buffer(Some((false, 1)));
    assert!(!rig.status().buffer.is_unsaid, "a report tells");
}

#[test]
fn a_question_that_is_only_acknowledged_may_have_entered_a_program() {
    let mut rig = Rig::new();
    rig.send(1, "P5", Duration::from_secs(60));
    rig.send(2, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "P5");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    let reason = Text::of(&Barred::Open(None).too_late());
    assert_eq!(rig.ended(), [(1, Outcome::Interrupted(reason))]);
    assert_eq!(rig.take(), "SIZE", "what the reports said is not believed");
}
