//! The port against a hand-driven board: every branch of the handshake, in both orders.

use super::super::testing::memory;
use super::control::FLAG_AFTER;
use super::hold::{ASK_AGAIN, ASK_LIMIT, SETTLE};
use super::late_mark::FIRST;
use super::*;
use crate::device::FileBoard;
use crate::map::{FAMILIES, Family, HostOffset};
use crate::protocol::control::{ABORT, CANCEL};

#[path = "ascii/control_tests.rs"]
mod control;
#[path = "ascii/error_tests.rs"]
mod error;
#[path = "ascii/hold_tests.rs"]
mod hold;
#[path = "ascii/part_tests.rs"]
mod part;
#[path = "ascii/stop_tests.rs"]
mod stop;

struct Rig {
    bus: FileBoard,
    port: DpramPort,
    now: Instant,
}

impl Rig {
    fn new(family: &'static Family) -> Self {
        Self::with_order(family, TextOrder::LowFirst)
    }

    fn with_order(family: &'static Family, order: TextOrder) -> Self {
        let now = Instant::now();
        Self { bus: memory(family), port: DpramPort::new(&family.ascii, order, now), now }
    }

    fn begin(&mut self, line: &str) -> bool {
        self.port.begin(&mut self.bus, line.as_bytes()).unwrap()
    }

    fn poll(&mut self) -> Option<AsciiEvent> {
        self.port.poll(&mut self.bus, self.now).unwrap()
    }

    /// PMAC takes what lies in the command buffer; returns its bytes.
    fn take(&mut self) -> Vec<u8> {
        assert_eq!(
            self.bus.read16(self.port.words.command_loaded.word).unwrap(),
            self.port.words.command_loaded.mask
        );
        let mut words = vec![0; self.port.words.command_bytes / 2];
        self.bus.read_block(self.port.words.command, &mut words).unwrap();
        self.bus.write16(self.port.words.command_loaded.word, 0).unwrap();
        words.iter().flat_map(|&word| self.port.order.unpack(word)).collect()
    }

    fn write(&mut self, offset: HostOffset, value: u16) {
        self.bus.write16(offset, value).unwrap();
    }

    fn control_word(&mut self) -> u16 {
        self.bus.read16(self.port.words.control_character).unwrap()
    }

    fn is_loaded(&mut self) -> bool {
        self.bus.read16(self.port.words.command_loaded.word).unwrap() & self.port.words.command_loaded.mask
            != 0
    }

    fn give_up(&mut self) {
        self.port.give_up(&mut self.bus, self.now).unwrap();
    }

    /// Nothing comes for `time`.
    fn be_silent(&mut self, time: Duration) {
        self.now += time;
        assert_eq!(self.poll(), None);
    }

    /// PMAC takes the question and answers it.
    fn answer_question(&mut self) {
        assert_eq!(self.poll(), None);
        assert_eq!(self.control_word(), u16::from(b'F' - 64));
        self.write(self.port.words.control_character, 0);
        assert_eq!(self.poll(), None);
        self.respond(response::LINE, "0 0 0 0 0 0 0 0");
        assert_eq!(self.poll(), Some(AsciiEvent::Stale(response::LINE)));
    }

    fn respond(&mut self, control: u16, text: &str) {
        assert_eq!(
            self.bus.read16(self.port.words.response_control).unwrap(),
            0,
            "the host must have taken the last one"
        );
        let mut bytes = text.as_bytes().to_vec();
        bytes.push(0);
        self.bus.write16(self.port.words.response_count, bytes.len() as u16).unwrap();
        for (index, pair) in bytes.chunks(2).enumerate() {
            let word = self.port.order.pack(pair[0], *pair.get(1).unwrap_or(&0xEE));
            self.bus.write16(self.port.words.response.plus_words(index), word).unwrap();
        }
        self.bus.write16(self.port.words.response_control, control).unwrap();
    }

    /// The board has put out an error, which is believed to be the line's.
    fn expect_error(&mut self, number: u16) {
        assert_eq!(self.poll(), Some(AsciiEvent::Error(number)));
        self.port.believe_error(self.now);
    }

    fn expect_line(&mut self, text: &str) {
        match self.poll() {
            Some(AsciiEvent::Line(line)) => assert_eq!(line.as_bytes(), text.as_bytes()),
            other => panic!("expected the line {text:?}, got {other:?}"),
        }
    }
}

#[test]
fn a_reply_of_several_lines_ends_with_its_acknowledgement() {
    for family in FAMILIES {
        for order in [TextOrder::LowFirst, TextOrder::HighFirst] {
            let mut rig = Rig::with_order(family, order);
            assert!(rig.begin("P1..3"));
            assert_eq!(rig.poll(), None);
            assert_eq!(&rig.take()[..6], b"P1..3\0");
            for text in ["25", "50", "75"] {
                rig.respond(response::LINE, text);
                rig.expect_line(text);
                assert_eq!(rig.poll(), None);
            }
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
            assert!(rig.port.is_idle());
        }
    }
}

#[test]
fn the_mark_on_the_last_line_itself_ends_a_reply_too() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("VERSION"));
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "1.16D");
        rig.expect_line("1.16D");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn text_left_beside_an_acknowledgement_is_no_second_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        for _ in 0..2 {
            assert!(rig.begin("P1"));
            rig.take();
            rig.respond(response::LINE, "25");
            rig.expect_line("25");
            rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
            // Nor is it the reply to a line that has none.
            assert!(rig.begin("P1=26"));
            rig.take();
            rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
        // Nor where an error keeps the text from being read, or the text is a program's.
        assert!(rig.begin("UUU"));
        rig.take();
        rig.respond(0x8003, "ERR003");
        rig.expect_error(3);
        rig.respond(response::MESSAGE, "DOOR OPEN");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramMessage(_))));
        assert!(rig.begin("P1=27"));
        rig.take();
        rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        // A board that marks the last line itself gives equal ones twice.
        for (first, last) in [("2", "3"), ("0", "0")] {
            assert!(rig.begin("P1..2"));
            rig.take();
            rig.respond(response::LINE, first);
            rig.expect_line(first);
            rig.respond(response::ACKNOWLEDGE, last);
            rig.expect_line(last);
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
    }
}

#[test]
fn what_an_earlier_host_or_the_power_on_left_is_no_reply() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        for word in 0..RESPONSE_BYTES / 2 {
            rig.write(family.ascii.response.plus_words(word), 0x4141);
        }
        rig.port.release(&mut rig.bus).unwrap();
        rig.port.hold(rig.now);
        rig.answer_question();
        rig.be_silent(SETTLE);
        assert!(rig.begin("P1=26"));
        rig.take();
        rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn several_lines_in_one_text_come_one_by_one() {
    for family in FAMILIES {
        for (end, ends) in [(response::LINE, false), (response::ACKNOWLEDGE, true)] {
            for text in ["1\r2\r3", "1\r\n2\r\n3\r\n", "1\r2\r3\r\x06"] {
                let mut rig = Rig::new(family);
                assert!(rig.begin("P1..3"));
                rig.take();
                rig.respond(end, text);
                for line in ["1", "2", "3"] {
                    rig.expect_line(line);
                }
                if !ends {
                    assert_eq!(rig.poll(), None);
                    rig.respond(response::ACKNOWLEDGE, "");
                }
                assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
                assert!(rig.port.is_idle());
            }
        }
    }
}

#[test]
fn an_acknowledgement_in_the_text_is_no_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1=26"));
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "\x06");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn a_control_word_that_no_manual_has_ends_the_command_and_holds_the_port() {
    for family in FAMILIES {
        for control in [0x400D, 0x0406, 0x800A, 0x0001] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("P1"));
            rig.take();
            rig.respond(control, "25");
            assert_eq!(rig.poll(), Some(AsciiEvent::Unknown(control)));
            assert!(!rig.port.is_idle());
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        }
    }
}

#[test]
fn errors_are_three_bcd_digits() {
    for family in FAMILIES {
        for (control, number) in [(0x8003, 3), (0x8017, 17), (0x8001, 1), (0x8123, 123)] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("UUU"));
            rig.take();
            rig.respond(control, "");
            rig.expect_error(number);
            assert_eq!(rig.bus.read16(family.ascii.response_control).unwrap(), 0);
        }
    }
}

#[test]
fn every_length_of_line_arrives_whole() {
    for family in FAMILIES {
        for length in 0..=family.ascii.line_limit {
            let line: String = (0..length).map(|index| char::from(b'A' + (index % 26) as u8)).collect();
            let mut rig = Rig::new(family);
            // Garbage from an earlier line must not be able to complete this one.
            for word in 0..family.ascii.command_bytes / 2 {
                rig.bus.write16(family.ascii.command.plus_words(word), 0x7A7A).unwrap();
            }
            assert!(rig.begin(&line));
            let mut received = rig.take();
            rig.poll();
            if length >= family.ascii.command_bytes {
                assert!(!received.contains(&0), "a first part has no NUL, its last byte included");
                received.truncate(family.ascii.command_bytes - 1);
                // The board gives the first part no answer.
                rig.now += FIRST;
                rig.poll();
                received.extend(rig.take());
                rig.poll();
            } else if length + 1 == family.ascii.command_bytes {
                assert_eq!(received[length], 0, "the longest line in one part has its NUL in the last byte");
            }
            let end = received.iter().position(|&byte| byte == 0).unwrap();
            assert_eq!(String::from_utf8_lossy(&received[..end]), line);
            assert_eq!(rig.port.state, State::Replying { quiet_since: Some(rig.now) });
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
    }
}

#[test]
fn texts_of_programs_are_never_taken_for_a_reply() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.respond(response::MESSAGE, "DOOR OPEN");
        assert!(!rig.begin("#1P"), "first the message has to be taken");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramMessage(_))));
        assert!(rig.begin("#1P"));
        rig.respond(response::TO_PROGRAM, "1995");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramResponse(text)) if text.as_bytes() == b"1995"));
        rig.take();
        rig.respond(response::MESSAGE, "BETWEEN");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramMessage(_))));
        rig.respond(response::LINE, "12");
        rig.expect_line("12");
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn a_stale_acknowledgement_is_drained() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.respond(response::ACKNOWLEDGE, "");
        assert!(!rig.begin("P1"));
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        assert!(rig.begin("P1"));
    }
}

#[test]
fn a_stale_acknowledgement_that_comes_before_the_board_took_the_line_does_not_end_it() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        rig.take();
        rig.respond(response::LINE, "25");
        rig.expect_line("25");
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn a_board_that_answers_before_it_clears_the_flag_is_believed() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("VERSION"));
        rig.respond(response::LINE, "1.14");
        rig.expect_line("1.14");
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        assert!(rig.begin("#1J+"));
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))), "also when there is no text");
        rig.take();
        // And long after any trouble nobody doubts an acknowledgement, whoever clears what when.
        let mut rig = Rig::new(family);
        rig.now += DOUBT;
        assert!(rig.begin("#1J+"));
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn the_first_half_of_a_line_given_up_is_cancelled_before_anything_else() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&"A".repeat(family.ascii.command_bytes + 20)));
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.give_up();
        rig.poll();
        assert_eq!(rig.control_word(), u16::from(CANCEL), "the board would put it before the next line");
        rig.write(family.ascii.command_loaded.word, 0);
        rig.write(family.ascii.control_character, 0);
        rig.poll();
        assert!(!rig.port.is_idle());
        rig.answer_question();
        rig.be_silent(SETTLE);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn b2_1_a_late_reply_is_nobodys_whether_the_flag_is_cleared_when_the_line_is_taken_or_done() {
    for family in FAMILIES {
        for (cleared_when_taken, answers_meanwhile) in
            [(true, false), (true, true), (false, false), (false, true)]
        {
            let mut rig = Rig::new(family);
            assert!(rig.begin("SLOW"));
            if cleared_when_taken {
                rig.take();
            }
            rig.poll();
            rig.give_up();
            if answers_meanwhile {
                rig.answer_question();
            }
            // Seven seconds. A board that looks at nothing while it is at a line does not take the question either.
            for _ in 0..700 {
                rig.be_silent(Duration::from_millis(10));
                assert!(
                    !rig.begin("P5=7") || answers_meanwhile && cleared_when_taken,
                    "{cleared_when_taken} {answers_meanwhile}"
                );
                if answers_meanwhile && cleared_when_taken {
                    break;
                }
            }
            if answers_meanwhile && cleared_when_taken {
                // Nothing tells such a board from one that has lost the line; a line of our own goes first.
                continue;
            }
            rig.write(family.ascii.command_loaded.word, 0);
            for control in [response::LINE, response::ACKNOWLEDGE] {
                rig.respond(control, if control == response::LINE { "late" } else { "" });
                assert_eq!(rig.poll(), Some(AsciiEvent::Stale(control)));
                assert!(!rig.begin("P5=7"));
            }
            if !answers_meanwhile {
                rig.be_silent(ASK_AGAIN);
                rig.answer_question();
            }
            rig.be_silent(SETTLE);
            assert!(rig.begin("P5=7"), "{cleared_when_taken} {answers_meanwhile}");
        }
    }
}

#[test]
fn a_programs_text_does_not_stand_for_silence() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        rig.give_up();
        rig.answer_question();
        // The daemon stands still for a second. Meanwhile a program's text keeps the late reply from coming out.
        rig.now += Duration::from_secs(1);
        rig.respond(response::MESSAGE, "from a program");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramMessage(_))));
        assert_eq!(rig.poll(), None);
        assert!(!rig.begin("P2"), "the reply to P1 would be told as that to P2");
        rig.respond(response::LINE, "late");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)));
        rig.be_silent(SETTLE);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn a_program_that_never_stops_sending_does_not_block_the_port() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        rig.give_up();
        rig.answer_question();
        let began = rig.now;
        while !rig.port.is_idle() {
            rig.respond(response::TO_PROGRAM, "again");
            rig.now += SETTLE / 2;
            assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramResponse(_))));
            rig.poll();
            assert!(rig.now - began < Duration::from_secs(1));
        }
        assert!(rig.now - began > SETTLE);
    }
}

#[test]
fn a_line_that_a_deaf_board_never_took_is_taken_back() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        rig.give_up();
        rig.be_silent(Duration::ZERO);
        rig.be_silent(ASK_LIMIT);
        assert!(!rig.is_loaded(), "it must not jog when the port is switched on later");
        assert_eq!(rig.control_word(), 0);
        rig.be_silent(SETTLE);
        assert!(!rig.port.is_idle(), "the board may be at it");
        rig.be_silent(ASK_AGAIN);
        rig.answer_question();
        rig.be_silent(SETTLE);
        assert!(rig.port.is_idle());
    }
}

#[test]
fn b3_3_a_reply_without_an_end_mark_ends_by_a_silence() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.port.set_reply_end(ReplyEnd::Silence);
        assert!(rig.begin("P1..2"));
        rig.take();
        assert_eq!(rig.poll(), None);
        for text in ["25", "50"] {
            rig.now += REPLY_END / 2;
            rig.respond(response::LINE, text);
            rig.expect_line(text);
            assert_eq!(rig.poll(), None);
        }
        rig.now += REPLY_END;
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        // An error has its mark.
        assert!(rig.begin("UUU"));
        rig.take();
        rig.respond(0x8003, "");
        rig.expect_error(3);
    }
}

#[test]
fn b3_3_a_silence_ends_each_reply_to_an_open_ended_line_once_and_none_that_has_not_begun() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.port.set_reply_end(ReplyEnd::Silence);
        assert!(rig.port.begin_open_ended(&mut rig.bus, b"I3").unwrap());
        rig.take();
        for text in ["0", "1"] {
            for _ in 0..20 {
                rig.now += REPLY_END;
                assert_eq!(rig.poll(), None, "nothing has come");
            }
            rig.respond(response::LINE, text);
            rig.expect_line(text);
            rig.now += REPLY_END;
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
    }
}

#[test]
fn a_line_another_host_left_is_not_overwritten() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        rig.bus.write16(family.ascii.command_loaded.word, family.ascii.command_loaded.mask).unwrap();
        assert!(!rig.begin("P1"));
        rig.port.release(&mut rig.bus).unwrap();
        assert!(rig.begin("P1"));
    }
}

#[test]
fn b3_1_the_nul_ends_a_reply_whatever_its_count_says() {
    for family in FAMILIES {
        // The characters, the characters and their NUL, and what cannot be.
        for count in [2, 3, 0, 257, 1000, u16::MAX] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("P1"));
            rig.take();
            rig.respond(0, "25");
            rig.bus.write16(family.ascii.response_count, count).unwrap();
            rig.bus.write16(family.ascii.response_control, response::LINE).unwrap();
            rig.expect_line("25");
        }
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        for word in 0..RESPONSE_BYTES / 2 {
            rig.bus.write16(family.ascii.response.plus_words(word), 0x4141).unwrap();
        }
        rig.bus.write16(family.ascii.response_count, 0).unwrap();
        rig.bus.write16(family.ascii.response_control, response::LINE).unwrap();
        rig.expect_line(&"A".repeat(255));
    }
}

#[test]
fn a_board_that_is_gone_gives_no_reply() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        for offset in (0..family.length).step_by(2) {
            rig.bus.write16(HostOffset::new(offset), u16::MAX).unwrap();
        }
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(u16::MAX)));
    }
}
