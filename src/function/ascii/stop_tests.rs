//! A stop over a line that the board has only in part, or has not taken.

use super::*;
use crate::function::ascii::control::goes_over_line;
use crate::function::line_port::Stopped;
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

    /// The board forgets the half line.
    fn forget(&mut self) {
        assert_eq!(self.poll(), None);
        assert_eq!(self.take_character(), CANCEL);
        assert_eq!(self.poll(), None);
        self.rest();
    }

    /// The board has answered a line behind the stop, or ended the one before: the port sends the stop once more.
    fn stop_again(&mut self, character: u8) {
        assert!(!self.begin("P1"), "the stop goes first");
        assert_eq!(self.poll(), None);
        assert_eq!(self.take_character(), character);
        assert_eq!(self.poll(), None);
        assert!(self.begin("P1"));
    }
}

#[test]
fn a_line_that_is_half_way_is_not_finished_after_a_stop() {
    for family in FAMILIES {
        for (character, takes_half) in [(ABORT, false), (KILL, true)] {
            let mut rig = Rig::new(family);
            assert!(rig.begin(&long_line(family)));
            if takes_half {
                rig.write(family.ascii.command_loaded.word, 0);
            }
            assert_eq!(rig.stop(character), Stopped::Unsent);
            rig.now += CHARACTER_FLAG_AFTER;
            assert!(rig.port.control_pending(&mut rig.bus, rig.now).unwrap());
            assert!(!rig.is_loaded(), "an empty line would end the half one");
            assert_eq!(rig.take_character(), character);
            rig.forget();
            rig.settle();
            rig.stop_again(character);
        }
    }
}

#[test]
fn a_second_part_that_the_board_has_not_taken_is_taken_back_before_a_stop() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert!(rig.is_loaded());
        assert_eq!(rig.stop(ABORT), Stopped::Uncertain, "the board may be at it");
        assert!(!rig.is_loaded());
        assert_eq!(rig.take_character(), ABORT);
        rig.forget();
        rig.settle();
        rig.stop_again(ABORT);
    }
}

#[test]
fn a_step_goes_once() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.stop(b'S' - 64);
        assert_eq!(rig.take_character(), b'S' - 64);
        rig.forget();
        rig.settle();
        assert!(rig.begin("P1"));
    }
}

#[test]
fn a_line_that_the_board_has_is_not_touched_by_a_stop() {
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
fn a_stop_goes_once_more_behind_a_line_that_the_board_may_carry_out_after_it() {
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
fn the_strongest_stop_goes_once_more() {
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
fn a_line_that_lies_untaken_when_everything_stops_is_made_empty() {
    for family in FAMILIES {
        for order in [TextOrder::LowFirst, TextOrder::HighFirst] {
            for character in [ABORT, KILL] {
                let mut rig = Rig::with_order(family, order);
                assert!(rig.begin("#1J+"));
                assert_eq!(rig.stop(character), Stopped::Uncertain, "the board may be at it");
                assert!(rig.is_loaded(), "the flag tells when it is done with it");
                assert_eq!(rig.take_character(), character, "before the line");
                rig.be_silent(Duration::from_secs(60));
                assert_eq!(&rig.take()[..4], b"\x001J+", "the one byte that makes the line empty");
                // Which the board may acknowledge.
                rig.respond(response::ACKNOWLEDGE, "");
                assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
                assert_eq!(rig.poll(), None);
                rig.settle();
                rig.stop_again(character);
            }
        }
    }
}
