//! What is asked of a program buffer before a line, and what is believed of the answer.

use super::*;

#[test]
fn b1_2_without_servo_reports_the_board_is_asked_before_a_line() {
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
            assert!(rig.queue.standing(rig.now).0.is_open);
        }
    }
}

#[test]
fn b1_2_a_board_that_does_not_know_the_question_still_gets_lines() {
    let mut rig = Rig::without_reports();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SIZE");
    rig.poll();
    rig.respond(response::ERROR | 3);
    // A program's, for all that is known.
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
fn b1_2_what_may_have_entered_a_buffer_is_not_told_as_done() {
    let mut rig = Rig::new();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "P5=7");
    // The serial port was a little sooner.
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
fn b2_1_an_acknowledgement_alone_answers_no_question_for_a_buffer() {
    let mut rig = Rig::without_reports();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SIZE");
    // That of a line before; a buffer is open.
    rig.respond(response::ACKNOWLEDGE);
    rig.now += SETTLE;
    rig.poll();
    rig.poll();
    assert_eq!(rig.take(), "SIZE SIZE", "a line whose reply can be known from every other's");
    rig.answer(&["-41301"]);
    rig.answer(&["-41301", "-41301"]);
    assert!(!rig.loaded(), "the line would enter the buffer");
    assert_eq!(rig.ended(), [(1, Outcome::Barred(Barred::Open(None)))]);
}

#[test]
fn b1_2_a_board_that_says_nothing_of_its_buffers_gets_lines_and_that_is_told() {
    let mut rig = Rig::without_reports();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SIZE");
    rig.respond(response::ACKNOWLEDGE);
    assert!(!rig.queue.standing(rig.now).0.is_unsaid);
    let mut line = String::new();
    for _ in 0..100 {
        rig.poll();
        if rig.loaded() {
            line = rig.take();
            if line == "P5=7" {
                break;
            }
            rig.poll();
            if line.starts_with("I3") {
                let values: Vec<_> =
                    line.split(' ').map(|name| if name == "I3" { "2" } else { "3713707" }).collect();
                rig.answer(&values);
            } else {
                rig.respond(response::ACKNOWLEDGE);
            }
        } else if rig.bus.read16(PMAC.ascii.control_character).unwrap() != 0 {
            rig.free_port();
        } else {
            rig.now += Duration::from_millis(250);
        }
    }
    assert_eq!(line, "P5=7");
    assert!(rig.queue.standing(rig.now).0.is_unsaid);
    rig.queue.see_buffer(Some((false, 1)));
    assert!(!rig.queue.standing(rig.now).0.is_unsaid, "a report tells");
}

#[test]
fn b2_1_what_ended_by_an_unknown_control_word_may_have_been_carried_out() {
    let mut rig = Rig::new();
    rig.send(1, "OPEN PROG 88", Duration::from_secs(60));
    rig.send(2, "P5", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "OPEN PROG 88");
    rig.respond(0x400D);
    let [(1, Outcome::Interrupted(reason))] = rig.ended()[..] else { panic!("not told") };
    assert_eq!(&*reason, "the board answered with the control word 0x400D, which no manual has");
    assert!(!rig.loaded(), "what still comes is not the next line's");
    rig.free_port();
    assert_eq!(rig.take(), "SIZE SIZE", "it may have opened the buffer");
    rig.answer(&["41301", "41301"]);
    assert_eq!(rig.take(), "I3 I10 I10 I3");
    rig.answer(&["2", "3713707", "3713707", "2"]);
    assert_eq!(rig.take(), "P5");
}
