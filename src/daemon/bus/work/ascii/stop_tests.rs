//! The text to the caller of a line that a stop has ended.

use super::*;
use crate::function::ascii::hold::HELD_CHARACTER_AGAIN;

/// A line whose first part fills the buffer.
fn long_line() -> String {
    format!("{:<160} #2J+", "#1J+")
}

#[test]
fn a_line_that_a_stop_ends_half_way_is_told_as_not_sent() {
    let mut rig = Rig::new();
    rig.send(2, &long_line(), Duration::from_secs(600));
    rig.poll();
    rig.take();
    rig.control(3, control::ABORT);
    rig.poll();
    assert!(!rig.loaded());
    assert_eq!(rig.ended(), [(2, Outcome::Dropped(Text::of(&"not sent: aborted by uid 7")))]);
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    rig.poll();
    assert_eq!(rig.ended(), [(3, Outcome::Done)]);
}

#[test]
fn a_cancel_is_handed_over_that_ends_a_line_half_way() {
    let mut rig = Rig::new();
    rig.send(1, &long_line(), Duration::from_secs(600));
    rig.poll();
    rig.take();
    rig.control(2, CANCEL);
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(CANCEL));
    assert_eq!(rig.ended(), []);
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    rig.poll();
    let ended = rig.ended();
    assert_eq!(ended[0], (2, Outcome::Done));
    assert!(matches!(ended[1], (1, Outcome::Interrupted(_))), "{ended:?}");
}

#[test]
fn a_line_that_lies_untaken_when_everything_stops_may_have_been_carried_out() {
    for stop in [control::ABORT, control::KILL] {
        let mut rig = Rig::new();
        rig.send(1, "#1J+", Duration::from_secs(600));
        rig.poll();
        rig.control(2, stop);
        rig.poll();
        let how = if stop == control::KILL { "killed" } else { "aborted" };
        assert_eq!(rig.ended(), [(1, Outcome::Interrupted(Text::of(&format_args!("{how} by uid 7"))))]);
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(stop));
        assert_eq!(rig.take(), "", "a board that looks at the character first finds no line");
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        rig.poll();
        assert_eq!(rig.ended(), [(2, Outcome::Done)]);
        // The stop goes once more when the board has answered the daemon's own line.
        rig.now += Duration::from_millis(1);
        rig.poll();
        rig.poll();
        rig.answer_check();
        rig.poll();
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(stop));
    }
}

impl Rig {
    /// A user asks for a stop, the daemon hands it over, and the board takes it.
    fn stop(&mut self, ticket: u64, character: u8) {
        self.control(ticket, character);
        self.poll();
        // Over a question the stop goes twice.
        let mut ended = Vec::new();
        while self.bus.read16(PMAC.ascii.control_character).unwrap() == u16::from(character) {
            self.bus.write16(PMAC.ascii.control_character, 0).unwrap();
            self.poll();
            ended.extend(self.ended());
        }
        assert!(ended.contains(&(ticket, Outcome::Done)), "{ticket}: {ended:?}");
    }
}

/// An `^A` behind a `^K` would close the loops again.
#[test]
fn of_two_stops_over_one_line_the_stronger_goes_once_more() {
    for (first, second, again) in [
        (control::ABORT, control::KILL, control::KILL),
        (control::KILL, control::ABORT, control::KILL),
        (control::HOLD, control::ABORT, control::ABORT),
    ] {
        let mut rig = Rig::new();
        rig.send(1, "#1J+", Duration::from_secs(600));
        rig.poll();
        rig.stop(2, first);
        rig.stop(3, second);
        // The empty line's flag tells when the board is done, however long that takes.
        rig.now += Duration::from_secs(1);
        rig.poll();
        assert_eq!(rig.take(), "");
        rig.poll();
        rig.poll();
        assert_eq!(rig.take(), "I3 I10 I3");
        rig.answer(&["2", "3713707", "2"]);
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(again));
        // A character that comes while the repeated one is in the word goes, too.
        rig.stop(4, control::KILL);
        rig.now += HELD_CHARACTER_AGAIN;
        rig.poll();
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(control::KILL));
    }
}

#[test]
fn a_stop_while_our_own_line_asks_after_one_given_up_goes_once_more() {
    let cut = format!("{:<60}#1J+", "P1=1");
    for (line, is_again) in [("#1J+", true), ("P1=1", false), (&cut, true)] {
        let mut rig = Rig::new();
        rig.send(1, line, Duration::from_secs(1));
        rig.poll();
        rig.take();
        rig.poll();
        rig.now += Duration::from_secs(1);
        rig.poll();
        assert_eq!(rig.ended(), [(1, Outcome::TimedOut)]);
        rig.rest();
        assert_eq!(rig.take(), "I3 I10 I3");
        rig.stop(2, control::ABORT);
        rig.answer(&["2", "3713707", "2"]);
        let again = if is_again { u16::from(control::ABORT) } else { 0 };
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), again, "{line}");
    }
}

#[test]
fn a_line_that_lies_untaken_behind_an_error_is_made_empty_before_a_stop() {
    let mut rig = Rig::new();
    rig.send(1, "#1J+", Duration::from_secs(600));
    rig.poll();
    // A program's error.
    rig.respond(response::ERROR | 5);
    assert!(rig.loaded());
    rig.control(2, control::ABORT);
    rig.poll();
    assert_eq!(rig.take(), "");
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(control::ABORT));
    assert!(matches!(rig.ended()[..], [(1, Outcome::Interrupted(_))]));
}

#[test]
fn what_ends_a_sequence_is_not_taken_back_by_a_stop() {
    let mut rig = Rig::new();
    let deadline = rig.now + Duration::from_secs(600);
    let line = Line::of("CLOSE");
    let origin = Origin::of(1000, &line, true);
    let command = Command::Send { ticket: Ticket(1), line, origin, deadline, writer: Writer::Stop };
    rig.queue.submit(&command, rig.now);
    rig.poll();
    rig.control(2, control::ABORT);
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(control::ABORT));
    assert_eq!(rig.take(), "CLOSE");
}
