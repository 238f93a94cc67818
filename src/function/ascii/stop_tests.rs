//! A stop over a line that the board has not all of, or has not taken.

use super::*;
use crate::function::ascii::control::{FLAG_BEHIND_HALF_AFTER, goes_over_line};
use crate::function::ascii::stop::Stopped;
use crate::protocol::control::{CANCEL, HOLD, KILL, QUIT};

/// A line of two parts.
fn long_line(family: &Family) -> String {
    format!("{:<1$} #2J+", "#1J+", family.ascii.command_bytes)
}

impl Rig {
    fn stop(&mut self, character: u8) -> Stopped {
        assert!(goes_over_line(character));
        let stopped = self.port.stop(&mut self.bus, character, self.now).unwrap();
        assert!(self.port.control(&mut self.bus, character, false, self.now).unwrap());
        stopped
    }

    /// The board takes the character in its word.
    fn take_character(&mut self) -> u8 {
        let character = self.control_word() as u8;
        self.write(self.port.words.control_character, 0);
        assert!(!self.port.control_pending(&mut self.bus, self.now).unwrap());
        character
    }

    /// Whether what lies under the flag has an end, and so would be carried out with what the board has.
    fn has_end(&mut self) -> bool {
        let mut words = vec![0; self.port.words.command_bytes / 2];
        self.bus.read_block(self.port.words.command, &mut words).unwrap();
        words.iter().any(|&word| self.port.order.unpack(word).contains(&0))
    }

    /// The board forgets the half line, shows that it is free, and gets the stop once more.
    fn forget_and_stop_again(&mut self, character: u8) {
        assert_eq!(self.poll(), None);
        assert_eq!(self.take_character(), CANCEL);
        assert_eq!(self.poll(), None);
        self.answer_question();
        self.stop_again(character);
    }

    /// Nothing comes any more: the board gets the stop once more.
    fn stop_again(&mut self, character: u8) {
        self.be_silent(SETTLE);
        assert_eq!(self.poll(), None);
        assert!(!self.begin("P1"), "the stop goes first");
        assert_eq!(self.take_character(), character);
        assert_eq!(self.poll(), None);
        self.be_silent(SETTLE);
        assert!(self.begin("P1"));
    }
}

#[test]
fn b2_a_line_that_is_half_way_is_not_finished_after_a_stop() {
    for family in FAMILIES {
        for character in [ABORT, KILL] {
            let mut rig = Rig::new(family);
            assert!(rig.begin(&long_line(family)));
            rig.take();
            assert_eq!(rig.poll(), None);
            assert_eq!(rig.stop(character), Stopped::Uncertain, "a board may answer, and carry out, a part");
            rig.now += FLAG_AFTER;
            assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
            assert!(!rig.is_loaded(), "an empty line would end the half one");
            // By then a board that does not answer first parts would have got the second.
            rig.be_silent(FIRST);
            assert!(!rig.is_loaded());
            assert_eq!(rig.take_character(), character);
            rig.forget_and_stop_again(character);
        }
    }
}

#[test]
fn b2_a_board_that_needs_the_flag_for_a_stop_gets_it_without_an_end_of_the_half_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.stop(ABORT);
        rig.now += FLAG_BEHIND_HALF_AFTER;
        assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
        assert!(rig.is_loaded() && !rig.has_end());
        rig.take();
        assert_eq!(rig.take_character(), ABORT);
        rig.forget_and_stop_again(ABORT);
    }
}

#[test]
fn b2_a_part_that_the_board_has_not_taken_is_taken_back_before_a_stop() {
    for family in FAMILIES {
        // What is certain, once the board is known to answer no first part.
        for (is_second, stopped) in [(false, Stopped::Unsent), (true, Stopped::Uncertain)] {
            let mut rig = Rig::new(family);
            rig.port.part_answer = Follows::No;
            assert!(rig.begin(&long_line(family)));
            if is_second {
                rig.take();
                assert_eq!(rig.poll(), None);
                assert!(rig.is_loaded());
            }
            assert_eq!(rig.stop(ABORT), stopped);
            assert!(!rig.is_loaded());
            assert_eq!(rig.take_character(), ABORT);
            rig.forget_and_stop_again(ABORT);
        }
    }
}

#[test]
fn b2_a_cancel_ends_a_line_that_is_half_way() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.stop(CANCEL);
        rig.be_silent(FIRST);
        assert!(!rig.is_loaded(), "the second part would be a line of its own");
    }
}

#[test]
fn b2_a_step_goes_once() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.stop(b'S' - 64);
        assert_eq!(rig.take_character(), b'S' - 64);
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.take_character(), CANCEL);
        assert_eq!(rig.poll(), None);
        rig.answer_question();
        rig.be_silent(SETTLE);
        assert!(rig.begin("P1"));
    }
}

#[test]
fn b2_a_line_that_the_board_has_is_not_touched_by_a_stop() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.stop(ABORT), Stopped::Nothing);
        assert_eq!(rig.take_character(), ABORT);
        rig.respond(response::LINE, "25");
        rig.expect_line("25");
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.begin("P2"), "and the stop goes once");
    }
}

#[test]
fn b2_a_stop_goes_once_more_behind_a_line_that_the_board_may_carry_out_after_it() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J=90000"));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.stop(ABORT), Stopped::Nothing);
        rig.port.stop_again_behind(ABORT, true);
        assert_eq!(rig.take_character(), ABORT);
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.stop_again(ABORT);
        // P1 is under way by now.
        rig.port.stop_again_behind(b'S' - 64, true);
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.begin("P3"), "a step comes once");
    }
}

#[test]
fn b2_the_strongest_stop_goes_once_more() {
    for (first, second, again) in [(KILL, ABORT, KILL), (ABORT, HOLD, ABORT), (QUIT, ABORT, ABORT)] {
        let mut rig = Rig::new(FAMILIES[0]);
        assert!(rig.begin("#1J/"));
        rig.take();
        assert_eq!(rig.poll(), None);
        for character in [first, second] {
            rig.stop(character);
            rig.port.stop_again_behind(character, true);
            assert_eq!(rig.take_character(), character);
            assert_eq!(rig.poll(), None);
        }
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.stop_again(again);
    }
}

#[test]
fn b2_a_line_that_lies_untaken_when_everything_stops_is_made_empty() {
    for family in FAMILIES {
        for order in [TextOrder::LowFirst, TextOrder::HighFirst] {
            for character in [ABORT, KILL] {
                let mut rig = Rig::with_order(family, order);
                assert!(rig.begin("#1J+"));
                assert_eq!(rig.stop(character), Stopped::Uncertain, "the board may be at it");
                assert!(rig.is_loaded(), "the flag tells when it is done with it");
                assert_eq!(rig.take_character(), character, "before the line");
                assert_eq!(&rig.take()[..4], b"\x001J+", "the one byte that makes the line empty");
                // Which the board may acknowledge.
                rig.respond(response::ACKNOWLEDGE, "");
                assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
                rig.answer_question();
                rig.stop_again(character);
            }
        }
    }
}

#[test]
fn b2_a_line_that_the_board_was_at_when_everything_stopped_is_waited_for() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        rig.stop(ABORT);
        assert_eq!(rig.take_character(), ABORT);
        assert_eq!(rig.poll(), None);
        // A board that clears the flag late answers the question beside the line.
        rig.answer_question();
        rig.be_silent(10 * SETTLE);
        assert_eq!(rig.control_word(), 0, "the stop goes once more behind the line");
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        rig.stop_again(ABORT);
    }
}

#[test]
fn b2_a_line_that_was_given_up_and_lies_untaken_is_made_empty_too() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        rig.give_up();
        rig.stop(ABORT);
        assert_eq!(rig.take_character(), ABORT);
        assert_eq!(&rig.take()[..4], b"\x001J+");
        rig.answer_question();
        rig.stop_again(ABORT);
        // What another host has left half done gets no end.
        let mut rig = Rig::new(family);
        rig.write(family.ascii.command.plus_words(family.ascii.command_bytes / 2 - 1), 0x2020);
        rig.port.look_for_half_a_line(&mut rig.bus).unwrap();
        rig.port.hold(rig.now);
        rig.write(family.ascii.command_loaded.word, family.ascii.command_loaded.mask);
        rig.write(family.ascii.command, 0x2020);
        rig.stop(ABORT);
        assert!(!rig.is_loaded());
    }
}
