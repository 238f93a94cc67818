//! What the caller of a line is told that a stop has ended.

use super::*;

/// Its first part fills the buffer.
fn long_line() -> String {
    format!("{:<160} #2J+", "#1J+")
}

#[test]
fn b2_a_line_that_a_stop_ends_half_way_is_told_as_not_sent_only_where_that_is_certain() {
    const BY_7: &str = "aborted by uid 7";
    for is_known in [false, true] {
        let mut rig = Rig::new();
        if is_known {
            rig.send(1, &long_line(), Duration::from_secs(600));
            rig.poll();
            rig.take();
            rig.poll();
            rig.now += Duration::from_millis(300);
            rig.poll();
            assert_eq!(rig.take().trim(), "#2J+", "no answer to the first part came");
            rig.poll();
            rig.respond(response::ACKNOWLEDGE);
            assert_eq!(rig.ended(), [(1, Outcome::Done)]);
        }
        rig.send(2, &long_line(), Duration::from_secs(600));
        rig.poll();
        rig.take();
        rig.control(3, control::ABORT);
        rig.poll();
        assert!(!rig.loaded());
        let outcome = if is_known {
            Outcome::Dropped(Text::from_bytes(format!("not sent: {BY_7}").as_bytes()))
        } else {
            Outcome::Interrupted(Text::from_bytes(BY_7.as_bytes()))
        };
        assert_eq!(rig.ended(), [(2, outcome)]);
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        rig.poll();
        assert_eq!(rig.ended(), [(3, Outcome::Done)]);
    }
}

#[test]
fn b2_a_cancel_is_handed_over_that_ends_a_line_half_way() {
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
fn b2_a_line_that_lies_untaken_when_everything_stops_may_have_been_carried_out() {
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
        // It goes once more before the next line, which is our own.
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        rig.poll();
        rig.free_port();
        assert_eq!(rig.ended(), [(2, Outcome::Done)]);
        rig.poll();
        assert!(!rig.loaded());
        assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(stop));
    }
}

#[test]
fn b1_6_what_ends_a_sequence_is_not_taken_back_by_a_stop() {
    let mut rig = Rig::new();
    let deadline = rig.now + Duration::from_secs(600);
    let line = Text::new(b"CLOSE").unwrap();
    let origin = Origin { uid: 1000, shown: Text::from_bytes(b"CLOSE"), stays: true };
    let command = Command::Send { ticket: Ticket(1), line, origin, deadline, writer: Writer::Stop };
    rig.queue.submit(&command, rig.now);
    rig.poll();
    rig.control(2, control::ABORT);
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(control::ABORT));
    assert_eq!(rig.take(), "CLOSE");
}
