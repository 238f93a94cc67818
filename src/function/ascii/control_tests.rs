//! Control characters: what is waited for before and after them.

use super::*;
use crate::protocol::control::{HOLD, KILL};

#[test]
fn b3_2_a_board_that_needs_the_flag_gets_it_with_an_empty_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap() && !rig.is_loaded());
        rig.now += FLAG_AFTER;
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert!(!rig.begin("P1"), "the flag would be the character's");
        assert_eq!(rig.take()[0], 0, "what a slow board finds there is no line");
        rig.write(family.ascii.control_character, 0);
        assert!(!rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        // Which it acknowledges.
        assert_eq!(rig.poll(), None);
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        rig.be_silent(SETTLE);
        assert!(rig.begin("P1"));
    }
}

#[test]
fn b3_2_no_flag_is_set_while_a_line_lies_untaken() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        rig.now += 10 * FLAG_AFTER;
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert_eq!(&rig.take()[..3], b"P1\0");
    }
}

#[test]
fn a_stop_that_goes_over_a_question_is_not_lost() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.port.hold(rig.now);
        rig.poll();
        assert_ne!(rig.control_word(), 0);
        assert!(!rig.port.control(&mut rig.bus, b'R' - 64, false, rig.now).unwrap(), "a run is no stop");
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        assert_eq!(rig.control_word(), u16::from(ABORT));
        // The board was at the question, and clears the word for that.
        rig.write(family.ascii.control_character, 0);
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert_eq!(rig.control_word(), u16::from(ABORT));
        rig.write(family.ascii.control_character, 0);
        assert!(!rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
    }
}

#[test]
fn a_control_character_passes_a_line_under_way() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        assert!(rig.port.control(&mut rig.bus, 0x0B, false, rig.now).unwrap());
        assert_eq!(rig.bus.read16(family.ascii.control_character).unwrap(), 0x0B);
        assert!(
            !rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap(),
            "the last one is not taken yet"
        );
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
        assert!(rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap());
        assert!(
            !rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap(),
            "its reply would mix with P1's"
        );
    }
}

#[test]
fn a_control_characters_reply_ends_with_a_silence() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
        rig.now += 10 * CONTROL_REPLY_END;
        assert_eq!(rig.poll(), None, "the board has not taken it");
        assert_eq!(rig.take()[0], 0, "the empty line whose flag was set for it");
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
        assert_eq!(rig.poll(), None);
        rig.respond(response::LINE, "0 0 0 0 0 0 0 0");
        rig.expect_line("0 0 0 0 0 0 0 0");
        rig.now += CONTROL_REPLY_END;
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.respond(response::LINE, "a late line of it");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)), "not the next command's");
        rig.be_silent(late_mark::FIRST);
        assert!(rig.begin("P1"));
    }
}

#[test]
fn firmware_without_the_control_register_does_not_block_the_port() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        rig.give_up();
        rig.be_silent(Duration::ZERO);
        // It finds the empty line that the flag was set for.
        rig.be_silent(FLAG_AFTER);
        assert_eq!(rig.take()[0], 0);
        rig.be_silent(ASK_LIMIT);
        assert_eq!(rig.control_word(), 0, "withdrawn");
        rig.be_silent(SETTLE);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn an_error_before_the_board_has_taken_a_character_does_not_end_its_reply() {
    for family in FAMILIES {
        for (control, event) in [
            (response::ERROR | 3, AsciiEvent::ProgramError(3)),
            (response::ACKNOWLEDGE, AsciiEvent::Stale(response::ACKNOWLEDGE)),
        ] {
            let mut rig = Rig::new(family);
            assert!(rig.port.control(&mut rig.bus, 0x03, true, rig.now).unwrap());
            rig.respond(control, "");
            assert_eq!(rig.poll(), Some(event));
            // A board that wants the flag gets it all the same.
            rig.now += FLAG_AFTER;
            assert_eq!(rig.poll(), None);
            assert_eq!(rig.take()[0], 0);
            rig.write(family.ascii.control_character, 0);
            assert_eq!(rig.poll(), None);
            rig.respond(response::LINE, "A8002A020010");
            assert!(matches!(rig.poll(), Some(AsciiEvent::Line(_))));
            assert!(
                rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap(),
                "and a stop goes at once"
            );
        }
    }
}

#[test]
fn an_error_beside_a_characters_reply_is_a_programs_and_the_reply_goes_on() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.port.control(&mut rig.bus, 0x03, true, rig.now).unwrap());
        rig.write(family.ascii.control_character, 0);
        assert_eq!(rig.poll(), None);
        rig.respond(response::ERROR | 3, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::ProgramError(3)));
        rig.respond(response::LINE, "A8002A020010");
        assert!(matches!(rig.poll(), Some(AsciiEvent::Line(_))));
    }
}

/// Another host may have left it, at a board that takes none without the flag.
#[test]
fn a_foreign_character_that_lies_there_for_ever_holds_up_neither_a_stop_nor_the_port() {
    for family in FAMILIES {
        let foreign = 0x04;
        let mut rig = Rig::new(family);
        rig.write(family.ascii.control_character, foreign);
        rig.port.hold(rig.now);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), foreign, "the board may be about to take it");
        rig.now += Duration::from_secs(1);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), 0);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), u16::from(b'F' - 64), "the question");

        let mut rig = Rig::new(family);
        rig.write(family.ascii.control_character, foreign);
        assert!(!rig.port.control(&mut rig.bus, b'R' - 64, false, rig.now).unwrap());
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        // The board may have cleared the word for the other one.
        for lies in [true, false] {
            assert_eq!(rig.control_word(), u16::from(ABORT));
            rig.write(family.ascii.control_character, 0);
            assert_eq!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap(), lies);
        }
    }
}

#[test]
fn a_weaker_stop_goes_over_no_stronger_one_of_another_host() {
    for (character, found, goes) in [
        (ABORT, ABORT, true),
        (KILL, ABORT, true),
        (ABORT, KILL, false),
        (HOLD, ABORT, false),
        (HOLD, 0x04, true),
        (CANCEL, 0x04, true),
        (CANCEL, KILL, false),
        (b'R' - 64, 0x04, false),
    ] {
        let mut rig = Rig::new(FAMILIES[0]);
        rig.write(FAMILIES[0].ascii.control_character, found.into());
        assert_eq!(
            rig.port.control(&mut rig.bus, character, false, rig.now).unwrap(),
            goes,
            "{character} {found}"
        );
    }
}
