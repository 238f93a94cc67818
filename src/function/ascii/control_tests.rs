//! Control characters: the port's waiting before and after them.

use super::*;
use crate::protocol::control::{CANCEL, HOLD, KILL};

/// `^F`.
const QUESTION: u8 = b'F' - 64;

#[test]
fn a_stop_gets_the_flag_of_an_empty_line_until_the_board_has_taken_a_character_without() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        for (character, has_flag) in [(ABORT, true), (b'S' - 64, false), (KILL, true)] {
            assert!(rig.port.control(&mut rig.bus, character, false, rig.now).unwrap());
            assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap() && !rig.is_loaded());
            rig.now += CHARACTER_FLAG_AFTER;
            assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
            assert_eq!(rig.port.flag_is_characters(), has_flag);
            if has_flag {
                assert!(!rig.begin("P1"), "the flag would be the character's");
                assert_eq!(rig.take()[0], 0, "what a slow board finds there is no line");
            }
            assert!(!rig.port.takes_characters());
            if !has_flag {
                rig.port.withdraw_control(&mut rig.bus).unwrap();
                continue;
            }
            rig.write(family.ascii.control_character, 0);
            assert!(!rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        }
        // The board takes a reporting character by the word alone.
        assert!(rig.port.control(&mut rig.bus, QUESTION, true, rig.now).unwrap());
        rig.now += CHARACTER_FLAG_AFTER;
        assert_eq!(rig.poll(), None);
        rig.write(family.ascii.control_character, 0);
        assert_eq!(rig.poll(), Some(AsciiEvent::Taken));
        assert!(rig.port.takes_characters());
        rig.port.settled(rig.now);
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        rig.now += 10 * CHARACTER_FLAG_AFTER;
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap() && !rig.is_loaded());
    }
}

#[test]
fn no_flag_is_set_while_a_line_lies_untaken() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        rig.now += 10 * CHARACTER_FLAG_AFTER;
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert_eq!(&rig.take()[..3], b"P1\0");
    }
}

#[test]
fn a_stop_that_goes_over_a_question_is_not_lost() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.port.control(&mut rig.bus, QUESTION, true, rig.now).unwrap());
        assert!(!rig.port.control(&mut rig.bus, b'R' - 64, false, rig.now).unwrap(), "a run is no stop");
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        assert_eq!(rig.control_word(), u16::from(ABORT));
        // The board was taking the question, and clears the word for that one.
        rig.write(family.ascii.control_character, 0);
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert_eq!(rig.control_word(), u16::from(ABORT));
        rig.write(family.ascii.control_character, 0);
        assert!(!rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        // No caller waits for the question's answer.
        rig.respond(response::LINE, "0 0 0 0 0 0 0 0");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)));
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
fn what_comes_behind_a_control_character_is_its_reply_until_another_line_is_answered() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
        // No manual says that a board refuses a control character.
        rig.respond(response::ERROR | 3, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::ProgramError(3)));
        assert_eq!(rig.poll(), None, "the board has not taken it");
        rig.write(family.ascii.control_character, 0);
        assert_eq!(rig.poll(), Some(AsciiEvent::Taken));
        rig.respond(response::LINE, "0 0 0 0 0 0 0 0");
        rig.expect_line("0 0 0 0 0 0 0 0");
        assert!(rig.port.begin_open_ended(&mut rig.bus, b"I3 I10 I3").unwrap());
        rig.respond(response::LINE, "one more");
        rig.expect_line("one more");
        rig.port.finish(rig.now);
        rig.take();
        assert!(rig.begin("P1"));
    }
}

/// Another host may have left the character, at a board that takes none without the flag.
#[test]
fn a_foreign_character_that_lies_there_for_ever_holds_up_neither_a_stop_nor_the_port() {
    for family in FAMILIES {
        let foreign = 0x04;
        let mut rig = Rig::new(family);
        rig.write(family.ascii.control_character, foreign);
        rig.write(family.ascii.command.plus_words(family.ascii.command_bytes / 2 - 1), 0x2020);
        rig.port.look_for_half_a_line(&mut rig.bus).unwrap();
        rig.port.rest(rig.now);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), foreign, "the board may be about to take it");
        rig.now += Duration::from_secs(1);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), u16::from(CANCEL), "the board may have half a line");

        let mut rig = Rig::new(family);
        rig.write(family.ascii.control_character, foreign);
        assert!(!rig.port.control(&mut rig.bus, b'R' - 64, false, rig.now).unwrap());
        assert!(rig.port.control(&mut rig.bus, ABORT, false, rig.now).unwrap());
        // The board may have cleared the word for the other character.
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
