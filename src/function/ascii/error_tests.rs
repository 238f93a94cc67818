//! An error while a line is under way: the line's own, or that of a program's `CMD`.

use super::*;
use crate::protocol::control::CANCEL;

#[test]
fn an_error_that_is_believed_ends_its_line_at_once() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        for _ in 0..2 {
            assert!(rig.begin("XYZZY"));
            rig.take();
            rig.respond(0x8003, "");
            rig.expect_error(3);
            assert!(rig.port.is_idle(), "no <ACK> follows it");
        }
        assert!(rig.begin("P777"));
        rig.take();
        rig.respond(response::LINE, "7");
        rig.expect_line("7");
    }
}

#[test]
fn what_comes_behind_a_programs_error_is_the_lines_until_another_line_is_answered() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P777"));
        rig.take();
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
        // The line's answer is there before the caller begins the next line.
        rig.respond(response::LINE, "7");
        assert!(
            !rig.port.begin_open_ended(&mut rig.bus, b"I3 I10 I3").unwrap(),
            "first the response has to be taken"
        );
        rig.expect_line("7");
        assert!(rig.port.begin_open_ended(&mut rig.bus, b"I3 I10 I3").unwrap());
        // So the port goes on while the probe lies there, also soon after the start.
        rig.respond(0x8006, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(6))));
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.take();
        for text in ["2", "3713707", "2"] {
            rig.respond(response::LINE, text);
            rig.expect_line(text);
        }
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.port.finish(rig.now);
        assert!(rig.begin("P20"));
    }
}

#[test]
fn an_error_while_no_line_is_under_way_is_a_programs() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.respond(0x8003, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::ProgramError(3)));
        assert!(rig.begin("P777"));
    }
}

#[test]
fn a_line_is_made_empty_that_lies_untaken_behind_an_error() {
    for family in FAMILIES {
        for stops in [false, true] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("#1J+"));
            rig.respond(0x8005, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Error(5)));
            if stops {
                let stopped = rig.port.stop(&mut rig.bus, ABORT, rig.now).unwrap();
                assert_eq!(stopped, Stopped::Uncertain);
            } else {
                rig.give_up();
            }
            assert_eq!(rig.take()[0], 0);
            assert_eq!(rig.poll(), None);
            assert!(rig.begin("P1"));
        }
    }
}

#[test]
fn an_error_before_the_board_has_a_first_part_ends_the_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&format!("{:<1$} #2J+", "#1J+", family.ascii.command_bytes)));
        rig.respond(0x8005, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(5))));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert!(!rig.is_loaded(), "the second part");
        assert_eq!(rig.control_word(), u16::from(CANCEL));
    }
}
