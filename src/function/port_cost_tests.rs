//! The table of bus accesses in [`super`], held to by counting.

use std::time::Instant;

use super::ascii::{AsciiEvent, AsciiPort};
use super::mailbox::{MailboxPort, MailboxSettings, MailboxSignal, SETTLE};
use crate::device::board::mapping::Mapping;
use crate::device::{Access, Bus, ByteBus, Counted, FileBoard};
use crate::format::TextOrder;
use crate::map::classic::{
    ASCII_INPUT_CONTROL, ASCII_INPUT_COUNT, ASCII_OUTPUT_CONTROL, ASCII_RESPONSE, RESPONSE_ACKNOWLEDGE,
    RESPONSE_LINE,
};

/// A line of `n` characters with a reply line of `m`, through the DPRAM; nothing is looked at in vain.
pub fn dpram(n: usize, m: usize, access: Access) -> usize {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x4000).unwrap();
    let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap().with_access(access));
    let mut board = FileBoard::from_file(&file, 0x4000).unwrap();
    let now = Instant::now();
    let mut port = AsciiPort::new(TextOrder::LowFirst, now);
    assert!(port.begin(&mut bus, "P".repeat(n).as_bytes()).unwrap());
    board.write16(ASCII_OUTPUT_CONTROL, 0).unwrap();
    for word in 0..m.div_ceil(2) {
        board.write16(ASCII_RESPONSE.plus_words(word), 0x3131).unwrap();
    }
    board.write16(ASCII_INPUT_COUNT, m as u16 + 1).unwrap();
    board.write16(ASCII_INPUT_CONTROL, RESPONSE_LINE).unwrap();
    let event = port.step(&mut bus, now).unwrap();
    assert!(matches!(event, Some(AsciiEvent::Line(text)) if text.as_bytes().len() == m), "{event:?}");
    board.write16(ASCII_INPUT_COUNT, 1).unwrap();
    board.write16(ASCII_INPUT_CONTROL, RESPONSE_ACKNOWLEDGE).unwrap();
    assert_eq!(port.step(&mut bus, now).unwrap(), Some(AsciiEvent::Done(Ok(()))));
    bus.accesses() as usize
}

/// The same through the mailboxes.
pub fn mailboxes(n: usize, m: usize) -> usize {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x200).unwrap();
    let mut bus = Counted::new(Mapping::new(&file, 0, 0x200).unwrap());
    let mut board = Mapping::new(&file, 0, 0x200).unwrap();
    let now = Instant::now();
    let mut port = MailboxPort::new(MailboxSettings::default());
    port.start(&mut bus, now).unwrap();
    assert_eq!(port.step(&mut bus, now + SETTLE).unwrap(), None);
    let before = bus.accesses();
    assert!(port.begin(&mut bus, "P".repeat(n).as_bytes()).unwrap());
    for _ in 0..(n + 1).div_ceil(15) {
        port.signal(MailboxSignal::GroupTaken);
        assert_eq!(port.step(&mut bus, now).unwrap(), None);
    }
    assert!(port.was_taken());
    let reply: Vec<u8> = "1".repeat(m).bytes().chain([b'\r']).collect();
    let mut events = Vec::new();
    for group in reply.chunks(16).chain([&[0x06][..]]) {
        for (number, &character) in group.iter().enumerate() {
            ByteBus::write8(&mut board, 2 * number as u32 + 1, character).unwrap();
        }
        port.signal(MailboxSignal::ReplyLies);
        events.extend(port.step(&mut bus, now).unwrap());
    }
    assert!(matches!(events[0], AsciiEvent::Line(text) if text.as_bytes().len() == m), "{events:?}");
    assert_eq!(events[1..], [AsciiEvent::Done(Ok(()))]);
    (bus.accesses() - before) as usize
}

#[test]
fn a_line_costs_what_the_table_says() {
    for (n, m) in [(2, 2), (20, 20), (80, 80), (159, 255), (1, 0), (15, 15), (29, 16), (33, 47)] {
        assert_eq!(dpram(n, m, Access::Bits32), n / 2 + m.div_ceil(2).div_ceil(2) + 11, "{n} {m}");
        assert_eq!(dpram(n, m, Access::Bits16), n / 2 + m.div_ceil(2) + 11, "{n} {m}");
        assert_eq!(mailboxes(n, m), n + m + 5 + 2 * (m + 1).div_ceil(16), "{n} {m}");
    }
    assert_eq!([(2, 2), (20, 20), (80, 80)].map(|(n, m)| dpram(n, m, Access::Bits16)), [13, 31, 91]);
    assert_eq!([(2, 2), (20, 20), (80, 80)].map(|(n, m)| mailboxes(n, m)), [11, 49, 177]);
}
