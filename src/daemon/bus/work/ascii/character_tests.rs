//! Where a control character's reply ends, and whether the board takes control characters.

use super::*;

const POSITIONS: u8 = b'P' - 64;

impl Rig {
    fn character(&mut self) -> u16 {
        self.bus.read16(PMAC.ascii.control_character).unwrap()
    }

    fn take_character(&mut self) -> u16 {
        let character = self.character();
        self.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        character
    }
}

#[test]
fn a_characters_reply_ends_where_our_own_line_is_answered() {
    for reply in [
        &["0 0 0 0 0 0 0 0"][..],
        &[],
        &["2"],
        &["2", "3713707"],
        &["2", "2", "3713707"],
        &["I3 I10 I3", "7"],
    ] {
        for has_mark in [false, true] {
            let mut rig = Rig::new();
            rig.control(1, POSITIONS);
            rig.send(2, "P2=1", Duration::from_secs(60));
            rig.poll();
            assert_eq!(rig.take_character(), u16::from(POSITIONS));
            rig.poll();
            // The probe goes at once: the daemon does not wait for a silence.
            assert!(rig.loaded(), "{reply:?}");
            reply.iter().for_each(|line| rig.say(line));
            rig.respond(response::ERROR | 5);
            if has_mark {
                rig.respond(response::ACKNOWLEDGE);
            }
            rig.answer_check();
            let lines = reply.iter().map(|line| format!("1 {line}"));
            let expected: Vec<_> = lines.chain(["1 Done".to_owned()]).collect();
            let mut told = rig.told();
            let before = told.len();
            told.retain(|told| told != "Error ERR005");
            assert_eq!((told.len() + 1, told), (before, expected), "{has_mark}");
            assert_eq!(rig.take(), "P2=1");
        }
    }
}

#[test]
fn a_stop_goes_over_a_report_that_the_board_has_not_taken() {
    let mut rig = Rig::new();
    rig.control(1, POSITIONS);
    rig.poll();
    assert_eq!(rig.character(), u16::from(POSITIONS));
    rig.control(2, control::KILL);
    rig.poll();
    assert_eq!(rig.take_character(), u16::from(control::KILL), "the board may have been at the report");
    rig.poll();
    assert_eq!(rig.take_character(), u16::from(control::KILL));
    rig.poll();
    let killed = Outcome::Interrupted(Text::of(&"killed by uid 7"));
    assert_eq!(rig.ended(), [(1, killed), (2, Outcome::Done)]);
    // The board's report may still come.
    rig.say("0 0 0 0 0 0 0 0");
    rig.rest();
    assert_eq!(rig.take(), "I3 I10 I3");
}

#[test]
fn a_character_behind_a_report_that_the_board_has_just_taken_is_not_lost() {
    for character in [control::HOLD, control::QUIT, control::STEP, control::ABORT] {
        let mut rig = Rig::new();
        rig.control(1, POSITIONS);
        rig.poll();
        assert_eq!(rig.take_character(), u16::from(POSITIONS));
        rig.control(2, character);
        rig.poll();
        assert_eq!(rig.take_character(), u16::from(character));
        rig.say("0 0 0 0 0 0 0 0");
        rig.answer_check();
        assert_eq!(rig.told(), ["2 Done", "1 0 0 0 0 0 0 0 0", "1 Done"]);
    }
}

#[test]
fn the_board_is_asked_whether_it_takes_control_characters_and_one_that_does_not_is_named() {
    let mut rig = Rig::new();
    rig.queue.ports.dpram.forget_characters();
    rig.now += Duration::from_millis(1);
    rig.poll();
    assert_eq!((rig.character(), rig.queue.takes_characters()), (0, None), "it has answered nothing yet");
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "P1=1");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.character(), u16::from(b'F' - 64));
    rig.now += Duration::from_millis(300);
    rig.poll();
    assert_eq!((rig.character(), rig.queue.takes_characters()), (0, Some(false)));
    assert_eq!(rig.queue.state(), CommandState::Answers, "it takes lines");
    rig.rest();
    rig.answer_check();
    // The board may only have been slow.
    rig.now += Duration::from_secs(5);
    rig.poll();
    assert_eq!(rig.take_character(), u16::from(b'F' - 64));
    rig.poll();
    assert_eq!(rig.queue.takes_characters(), Some(true));
    rig.say("0 0 0 0 0 0 0 0");
    rig.answer_check();
    rig.now += Duration::from_secs(60);
    rig.poll();
    assert_eq!(rig.character(), 0);
}
