//! The port against a hand-driven board: every branch of the handshake, in both orders.

use super::super::testing::memory;
use super::control::CHARACTER_FLAG_AFTER;
use super::hold::HELD_CHARACTER_TAKEN;
use super::*;
use crate::device::FileBoard;
use crate::map::{FAMILIES, Family, HostOffset};
use crate::protocol::control::{ABORT, CANCEL};

#[path = "ascii/control_tests.rs"]
mod control;
#[path = "ascii/error_tests.rs"]
mod error;
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
        Self { bus: memory(family), port: DpramPort::new(&family.ascii, order), now }
    }

    fn begin(&mut self, line: &str) -> bool {
        self.port.begin(&mut self.bus, line.as_bytes()).unwrap()
    }

    fn poll(&mut self) -> Option<AsciiEvent> {
        self.port.poll(&mut self.bus, self.now).unwrap()
    }

    /// PMAC takes the line in the command buffer; returns its bytes.
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

    /// The board sends no response for `time`.
    fn be_silent(&mut self, time: Duration) {
        self.now += time;
        assert_eq!(self.poll(), None);
    }

    /// The port rests, and is idle then.
    fn rest(&mut self) {
        assert!(!self.begin("P1"), "it rests");
        self.be_silent(PORT_REST);
        assert!(self.port.is_idle());
    }

    /// The board answers the caller's probe, so it has done the earlier lines.
    fn settle(&mut self) {
        assert!(self.port.begin_open_ended(&mut self.bus, b"I3 I10 I3").unwrap());
        self.take();
        self.respond(response::ACKNOWLEDGE, "");
        assert_eq!(self.poll(), Some(AsciiEvent::Done(Ok(()))));
        self.port.finish(self.now);
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

    /// The board has put out an error, and the caller takes it for the line's.
    fn expect_error(&mut self, number: u16) {
        assert_eq!(self.poll(), Some(AsciiEvent::Error(number)));
        self.port.settled(self.now);
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
fn no_text_under_an_acknowledgement_is_a_line() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        for _ in 0..2 {
            assert!(rig.begin("P1"));
            rig.take();
            rig.respond(response::LINE, "25");
            rig.expect_line("25");
            rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
            // Nor does the port take the text for the reply to a line that has none.
            assert!(rig.begin("P1=26"));
            rig.take();
            rig.write(family.ascii.response_control, response::ACKNOWLEDGE);
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
        let text = rig.bus.read16(family.ascii.response).unwrap();
        assert_eq!(text.to_le_bytes(), *b"25", "the host writes nothing into the text");
    }
}

#[test]
fn a_control_word_that_no_manual_has_is_an_error_without_a_number() {
    for family in FAMILIES {
        for control in [0x400D, 0x0406, 0x800A, 0x0001] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("P1"));
            rig.take();
            rig.respond(control, "25");
            rig.expect_error(0);
        }
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
        assert!(!rig.is_loaded(), "the second half");
        assert_eq!(rig.poll(), None);
        assert_eq!(rig.control_word(), u16::from(CANCEL), "the board would put it before the next line");
        // A board that does not take the `^X` gets no other line.
        rig.be_silent(HELD_CHARACTER_TAKEN);
        assert!(rig.control_word() == 0 && rig.port.is_unheard() && !rig.begin("P2"));
        rig.be_silent(hold::HELD_CHARACTER_AGAIN);
        assert_eq!(rig.control_word(), u16::from(CANCEL));
        rig.write(family.ascii.control_character, 0);
        assert_eq!(rig.poll(), None);
        rig.rest();
        assert!(!rig.port.is_unheard());
    }
}

#[test]
fn a_line_that_is_given_up_is_made_empty_and_a_late_reply_is_nobodys() {
    for family in FAMILIES {
        for is_taken in [true, false] {
            let mut rig = Rig::new(family);
            assert!(rig.begin("#1J+"));
            if is_taken {
                rig.take();
            }
            assert_eq!(rig.poll(), None);
            rig.give_up();
            assert_eq!((rig.is_loaded(), rig.port.is_unheard()), (!is_taken, !is_taken));
            for control in [response::LINE, response::ACKNOWLEDGE, 0x8003] {
                rig.respond(control, "late");
                assert_eq!(rig.poll(), Some(AsciiEvent::Stale(control)));
            }
            if is_taken {
                rig.rest();
                continue;
            }
            rig.be_silent(Duration::from_secs(60));
            assert!(!rig.begin("P1"));
            assert_eq!(rig.take()[0], 0, "it must not jog when the port is switched on later");
            assert_eq!(rig.poll(), None);
            assert!(rig.begin("P1"));
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
            // Garbage from an earlier line must not complete this one.
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
            assert_eq!(rig.port.state, DpramState::Replying);
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
