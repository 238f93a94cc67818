//! An error while a line is under way: its own, or one that a program's `CMD` has made.

use super::*;
use crate::protocol::control::CANCEL;

/// A board that is known to send no `<ACK>` behind an error, at a line that it has taken.
fn at_a_line(family: &'static Family) -> Rig {
    let mut rig = Rig::new(family);
    assert!(rig.begin("XYZZY"));
    rig.take();
    rig.respond(0x8003, "");
    rig.expect_error(3);
    assert!(rig.begin("P777"));
    rig
}

#[test]
fn b2_an_error_that_an_answer_follows_may_be_a_programs() {
    for family in FAMILIES {
        for answer in [response::LINE, response::ACKNOWLEDGE] {
            let mut rig = at_a_line(family);
            rig.take();
            rig.respond(0x8005, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
            rig.be_silent(SETTLE - Duration::from_millis(1));
            rig.respond(answer, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Doubtful(5)));
            // The rest of the answer is nobody's, nor is the next line begun before.
            assert!(!rig.begin("P20"));
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
            rig.answer_question();
            rig.be_silent(SETTLE);
            assert!(rig.begin("P20"));
        }
    }
}

#[test]
fn b2_an_error_is_waited_behind_as_long_as_the_board_takes_to_answer() {
    const LATE: Duration = Duration::from_millis(80);
    for family in FAMILIES {
        let mut rig = at_a_line(family);
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.be_silent(LATE);
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.begin("P778"));
        rig.take();
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
        rig.be_silent(LATE);
        assert!(!rig.begin("P20"));
        rig.respond(response::LINE, "0");
        assert_eq!(rig.poll(), Some(AsciiEvent::Doubtful(5)));
    }
}

#[test]
fn b2_an_error_before_the_board_has_taken_the_line_does_not_end_it() {
    for family in FAMILIES {
        let mut rig = at_a_line(family);
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
        rig.be_silent(10 * SETTLE);
        rig.take();
        rig.be_silent(Duration::ZERO);
        rig.respond(response::LINE, "0");
        assert_eq!(rig.poll(), Some(AsciiEvent::Doubtful(5)));
        // Where a board answers before it clears the flag, it is the line's.
        let mut rig = at_a_line(family);
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
        rig.be_silent(SETTLE);
        rig.take();
        rig.now += SETTLE;
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(5))));
    }
}

#[test]
fn b2_an_error_that_its_acknowledgement_follows_is_the_lines_at_once() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        for _ in 0..2 {
            assert!(rig.begin("XYZZY"));
            rig.take();
            rig.respond(0x8003, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Error(3)));
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(3))));
        }
    }
}

#[test]
fn b2_a_line_that_is_given_up_behind_an_error_holds_the_port() {
    for family in FAMILIES {
        let mut rig = at_a_line(family);
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
        rig.give_up();
        rig.answer_question();
        rig.be_silent(10 * SETTLE);
        assert!(!rig.begin("P20"), "it lies there yet");
    }
}

#[test]
fn b2_an_error_before_the_board_has_a_first_part_ends_the_line() {
    for family in FAMILIES {
        let mut rig = at_a_line(family);
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.begin(&format!("{:<1$} #2J+", "#1J+", family.ascii.command_bytes)));
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(5))));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert!(!rig.is_loaded(), "the second part");
        assert_eq!(rig.control_word(), u16::from(CANCEL));
    }
}
