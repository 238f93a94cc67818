//! The port against a hand-driven board: every branch of the handshake, in both orders.

use super::super::testing::memory;
use super::*;
use crate::device::FileBoard;
use crate::map::family::testing::TESTED;
use crate::map::{Family, HostOffset};

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

    fn expect_line(&mut self, text: &str) {
        match self.poll() {
            Some(AsciiEvent::Line(line)) => assert_eq!(line.as_bytes(), text.as_bytes()),
            other => panic!("expected the line {text:?}, got {other:?}"),
        }
    }
}

#[test]
fn a_reply_of_several_lines_ends_with_its_acknowledgement() {
    for family in TESTED {
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
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("VERSION"));
        rig.take();
        rig.respond(response::ACKNOWLEDGE, "1.16D");
        rig.expect_line("1.16D");
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
    }
}

#[test]
fn errors_are_three_bcd_digits() {
    for family in TESTED {
        for (control, number) in [(0x8003, 3), (0x8017, 17), (0x8001, 1), (0x8123, 123)] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("UUU"));
            rig.take();
            rig.respond(control, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Err(number))));
            assert_eq!(rig.bus.read16(family.ascii.response_control).unwrap(), 0);
        }
    }
}

#[test]
fn every_length_of_line_arrives_whole() {
    for family in TESTED {
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
                received.extend(rig.take());
                rig.poll();
            } else if length + 1 == family.ascii.command_bytes {
                assert_eq!(received[length], 0, "the longest line in one part has its NUL in the last byte");
            }
            let end = received.iter().position(|&byte| byte == 0).unwrap();
            assert_eq!(String::from_utf8_lossy(&received[..end]), line);
            assert_eq!(rig.port.state, State::Replying);
            rig.respond(response::ACKNOWLEDGE, "");
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
    }
}

#[test]
fn texts_of_programs_are_never_taken_for_a_reply() {
    for family in TESTED {
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
    for family in TESTED {
        let mut rig = Rig::new(family);
        rig.respond(response::ACKNOWLEDGE, "");
        assert!(!rig.begin("P1"));
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        assert!(rig.begin("P1"));
    }
}

#[test]
fn a_stale_acknowledgement_that_comes_before_the_board_took_the_line_does_not_end_it() {
    for family in TESTED {
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
    for family in TESTED {
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
fn a_line_given_up_half_way_is_not_put_before_the_next() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&"A".repeat(family.ascii.command_bytes + 20)));
        rig.take();
        assert_eq!(rig.poll(), None);
        assert!(!rig.port.give_up(&mut rig.bus, rig.now).unwrap(), "half of it is no command");
        assert_eq!(
            rig.bus.read16(family.ascii.command_loaded.word).unwrap(),
            0,
            "the second part is withdrawn"
        );
        assert_eq!(
            rig.bus.read16(family.ascii.control_character).unwrap(),
            CANCEL,
            "the first is to be forgotten"
        );
        rig.now += SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(!rig.begin("P2"), "not before the board has done so");
    }
}

#[test]
fn a_line_taken_just_before_it_is_given_up_is_cancelled() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        assert!(rig.port.give_up(&mut rig.bus, rig.now).unwrap(), "the board has it");
        assert_eq!(rig.bus.read16(family.ascii.control_character).unwrap(), CANCEL);
    }
}

#[test]
fn what_comes_after_giving_up_belongs_to_nobody() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        assert!(rig.port.give_up(&mut rig.bus, rig.now).unwrap());
        assert_eq!(
            rig.bus.read16(family.ascii.control_character).unwrap(),
            CANCEL,
            "the board is to empty its queues"
        );
        rig.now += SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(!rig.begin("P2"), "not before the board has done so");
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
        rig.now += SETTLE / 2;
        rig.respond(response::LINE, "late");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)));
        rig.now += SETTLE / 2;
        assert_eq!(rig.poll(), None);
        assert!(!rig.begin("P2"), "the silence starts anew with every late response");
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)));
        rig.now += SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn a_programs_text_does_not_stand_for_silence() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        assert!(rig.port.give_up(&mut rig.bus, rig.now).unwrap());
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
        // The daemon stands still for a second. Meanwhile a program's text keeps the late reply from coming out.
        rig.now += Duration::from_secs(1);
        rig.respond(response::MESSAGE, "from a program");
        assert!(matches!(rig.poll(), Some(AsciiEvent::ProgramMessage(_))));
        assert_eq!(rig.poll(), None);
        assert!(!rig.begin("P2"), "the reply to P1 would be told as that to P2");
        rig.respond(response::LINE, "late");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)));
        rig.now += SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn a_program_that_never_stops_sending_does_not_block_the_port() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        rig.port.give_up(&mut rig.bus, rig.now).unwrap();
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
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
fn firmware_without_the_control_register_does_not_block_the_port() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        rig.take();
        rig.poll();
        rig.port.give_up(&mut rig.bus, rig.now).unwrap();
        rig.now += CANCEL_LIMIT;
        rig.poll();
        assert_eq!(rig.bus.read16(family.ascii.control_character).unwrap(), 0);
        assert!(rig.begin("P2"));
    }
}

#[test]
fn a_line_the_board_never_took_is_withdrawn() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("#1J+"));
        assert!(!rig.port.give_up(&mut rig.bus, rig.now).unwrap());
        assert_eq!(rig.bus.read16(family.ascii.command_loaded.word).unwrap(), 0);
        assert_eq!(rig.bus.read16(family.ascii.control_character).unwrap(), 0, "nothing is to be forgotten");
    }
}

#[test]
fn a_line_another_host_left_is_not_overwritten() {
    for family in TESTED {
        let mut rig = Rig::new(family);
        rig.bus.write16(family.ascii.command_loaded.word, family.ascii.command_loaded.mask).unwrap();
        assert!(!rig.begin("P1"));
        rig.port.release(&mut rig.bus).unwrap();
        assert!(rig.begin("P1"));
    }
}

#[test]
fn a_control_character_passes_a_line_under_way() {
    for family in TESTED {
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
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
        rig.now += 10 * CONTROL_REPLY_END;
        assert_eq!(rig.poll(), None, "the board has not taken it");
        rig.bus.write16(family.ascii.control_character, 0).unwrap();
        assert_eq!(rig.poll(), None);
        rig.respond(response::LINE, "0 0 0 0 0 0 0 0");
        rig.expect_line("0 0 0 0 0 0 0 0");
        rig.now += CONTROL_REPLY_END;
        assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        rig.respond(response::LINE, "a late line of it");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::LINE)), "not the next command's");
        rig.now += SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(rig.begin("P1"));
    }
}

#[test]
fn b3_1_the_nul_ends_a_reply_whatever_its_count_says() {
    for family in TESTED {
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
    for family in TESTED {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1"));
        for offset in (0..family.length).step_by(2) {
            rig.bus.write16(HostOffset::new(offset), u16::MAX).unwrap();
        }
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(u16::MAX)));
    }
}
