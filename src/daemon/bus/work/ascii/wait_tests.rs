//! Until when the daemon may begin a command.

use super::*;
use crate::daemon::shared::queue::GivenUp;
use crate::map::HostOffset;

#[test]
fn a_line_whose_time_is_over_is_never_begun() {
    let mut rig = Rig::new();
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.poll();
    assert!(rig.loaded());
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    for ticket in [2, 3, 4] {
        rig.send(ticket, "#1J+", Duration::from_millis(100));
    }
    // The daemon stands still for a second; meanwhile the board answers.
    rig.bus.write16(PMAC.ascii.response_control, response::ACKNOWLEDGE).unwrap();
    rig.now += Duration::from_secs(1);
    for _ in 0..6 {
        rig.poll();
        assert!(!rig.loaded(), "its caller has been told that it was not done");
    }
    // The board answers: the lines only came too late.
    let busy = |ticket| (ticket, Outcome::Busy);
    assert_eq!(rig.ended(), [(1, Outcome::Done), busy(2), busy(3), busy(4)]);
    assert_eq!(rig.queue.state(), CommandState::Answers);
}

/// A board that clears the flag some time after its reply would clear the next line's.
#[test]
fn a_flag_that_is_cleared_late_clears_only_a_line_of_our_own() {
    let mut rig = Rig::new();
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.poll();
    rig.say("5");
    rig.respond(response::ACKNOWLEDGE);
    rig.send(2, "P2=1", Duration::from_millis(100));
    rig.send(3, "P3=1", Duration::from_secs(60));
    rig.poll();
    rig.now += Duration::from_millis(100);
    rig.poll();
    assert_eq!(
        rig.ended(),
        [(1, Outcome::Done), (2, Outcome::Unavailable { port: CommandPort::Dpram, page: None })]
    );
    rig.rest();
    assert_eq!(rig.take(), "I3 I10 I3");
}

#[test]
fn a_line_that_waited_is_not_begun_just_before_its_deadline() {
    let mut rig = Rig::new();
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.send(2, "P2=1", Duration::from_secs(1));
    rig.send(3, "P3=1", Duration::from_secs(60));
    rig.poll();
    rig.take();
    // The daemon would have to give the line up 5 ms later. That would hold the port for all clients, and call the
    // board silent.
    rig.now += Duration::from_millis(995);
    rig.respond(response::ACKNOWLEDGE);
    rig.now += PORT_REST;
    rig.poll();
    assert_eq!(rig.take(), "P3=1");
    assert_eq!(rig.ended(), [(1, Outcome::Done), (2, Outcome::Busy)]);
    assert_eq!(rig.queue.state(), CommandState::Answers);
}

#[test]
fn who_waits_behind_one_that_waits_longer_is_refused_at_his_own_deadline() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(60));
    rig.send(2, "P2=1", Duration::from_secs(30));
    rig.send(3, "P3=1", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    let begun = rig.now;
    rig.now += Duration::from_secs(1);
    rig.poll();
    let by = Origin { uid: 1000, shown: Text::of(&"SLOW"), stays: false, may_move: true };
    let holds = GivenUp { by, since: begun };
    assert_eq!(rig.ended(), [(3, Outcome::Refused(holds.reason(rig.now)))]);
    assert_eq!(rig.status().holds_port, Some(holds), "so those are told who wait before the socket");
    rig.respond(response::ACKNOWLEDGE);
    rig.poll();
    assert_eq!(rig.take(), "P2=1");
    assert_eq!(rig.status().holds_port, None, "not of every quick line");
}

#[test]
fn a_line_that_lay_before_the_board_may_have_been_carried_out() {
    for state in [CommandState::Answers, CommandState::Unknown, CommandState::Silent] {
        let mut rig = Rig::new();
        rig.queue.state = state;
        rig.send(1, "SAVE", Duration::from_millis(1));
        rig.poll();
        assert!(rig.loaded());
        rig.now += Duration::from_millis(1);
        rig.poll();
        assert_eq!(rig.ended(), [(1, Outcome::TimedOut)], "{state:?}");
    }
}

#[test]
fn a_question_of_our_own_waits_as_long_as_lines_of_its_reply_come() {
    let mut rig = Rig::new();
    rig.queue.identifier = Identifier::new(&PMAC, Identity::default(), true, rig.now);
    rig.poll();
    assert_eq!(rig.take(), "TYPE");
    for _ in 0..3 {
        rig.now += Duration::from_millis(400);
        rig.say("PMAC1");
    }
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.queue.state(), CommandState::Answers);
    rig.poll();
    assert_eq!(rig.take(), "VERSION");
    // The daemon does not wait for ever.
    for _ in 0..11 {
        rig.say("1.16D");
        rig.now += Duration::from_millis(490);
        rig.poll();
    }
    assert_eq!(rig.queue.state(), CommandState::Silent);
}

#[test]
fn a_character_that_only_waited_for_a_line_says_nothing_of_the_board() {
    let mut rig = Rig::new();
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.poll();
    rig.control(2, b'F' - 64);
    rig.now += Duration::from_secs(5);
    rig.poll();
    let told = rig.ended();
    assert!(matches!(told[..], [(2, Outcome::Refused(_))]), "{told:?}");
    assert_eq!(rig.queue.state(), CommandState::Unknown);
}

/// A window without a board behind it reads all ones.
#[test]
fn a_board_that_is_gone_is_not_tried_without_a_pause() {
    let mut rig = Rig::new();
    rig.queue.ports.doubt();
    (0..0x4000).step_by(2).for_each(|at| rig.bus.write16(HostOffset::new(at), u16::MAX).unwrap());
    rig.now += Duration::from_secs(1);
    for _ in 0..10 {
        rig.poll();
        assert!(!rig.queue.is_under_way());
        assert!(rig.queue.due() > rig.now, "the bus thread sleeps between two tries");
        rig.now = rig.queue.due();
    }
}
