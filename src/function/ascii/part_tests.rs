//! A board that answers the first part of a long line, at whatever moment the host looks.

use super::*;
use crate::device::BusError;

/// A board that takes the first part and acknowledges it just before the host reads whether a response is there.
struct Racing<'a> {
    bus: &'a mut FileBoard,
    family: &'static Family,
    is_armed: bool,
}

impl Bus for Racing<'_> {
    fn length(&self) -> usize {
        self.bus.length()
    }
    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let ascii = &self.family.ascii;
        if offset == ascii.response_control && std::mem::take(&mut self.is_armed) {
            for (offset, value) in [
                (ascii.command_loaded.word, 0),
                (ascii.response, 0),
                (ascii.response_control, response::ACKNOWLEDGE),
            ] {
                self.bus.write16(offset, value)?;
            }
        }
        self.bus.read16(offset)
    }
    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.bus.write16(offset, value)
    }
    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        self.bus.read_block(first, words)
    }
    fn order_reads(&mut self) {}
    fn order_writes(&mut self) {}
}

/// A long line, of which the second part alone is left to take.
fn assert_second_part_ends_it(rig: &mut Rig) {
    assert!(rig.take().starts_with(b"P12\0"), "the second part");
    assert_eq!(rig.poll(), None);
    rig.respond(response::LINE, "25");
    rig.expect_line("25");
    rig.respond(response::ACKNOWLEDGE, "");
    assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
}

fn long_line(family: &Family) -> String {
    "I".repeat(family.ascii.command_bytes - 1) + "P12"
}

#[test]
fn b3_an_answer_that_comes_as_the_flag_clears_is_the_first_parts() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        let mut racing = Racing { bus: &mut rig.bus, family, is_armed: true };
        assert_eq!(
            rig.port.poll(&mut racing, rig.now).unwrap(),
            Some(AsciiEvent::Stale(response::ACKNOWLEDGE)),
            "{}",
            family.title
        );
        assert_eq!(rig.poll(), None);
        assert_second_part_ends_it(&mut rig);
    }
}

#[test]
fn b3_an_answer_before_the_flag_clears_is_the_first_parts_too() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin(&long_line(family)));
        rig.respond(response::ACKNOWLEDGE, "");
        assert_eq!(rig.poll(), Some(AsciiEvent::Stale(response::ACKNOWLEDGE)), "{}", family.title);
        rig.take();
        assert_eq!(rig.poll(), None);
        rig.now += FIRST;
        assert_eq!(rig.poll(), None);
        assert_second_part_ends_it(&mut rig);
    }
}
