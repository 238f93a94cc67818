//! Checks the table of bus accesses in [`super`] by counting.

use std::time::Instant;

use super::ascii::DpramPort;
use super::line_port::{AsciiEvent, LinePort};
use super::mailbox::{MAILBOX_SETTLE, MailboxPort, MailboxSettings, MailboxSignal};
use super::testing::two_sides;
use crate::device::mapping::Mapping;
use crate::device::{Access, Bus, ByteBus, Counted};
use crate::format::TextOrder;
use crate::map::functions::response;
use crate::map::{FAMILIES, Family};

/// A line of `n` characters with a reply line of `m`, through the DPRAM; no poll is in vain.
pub fn dpram(family: &'static Family, n: usize, m: usize, access: Access) -> usize {
    let ([host, mut board], words) = (two_sides(family), &family.ascii);
    let mut bus = Counted::new(host.with_access(access));
    let now = Instant::now();
    let mut port = DpramPort::new(words, TextOrder::LowFirst);
    assert!(port.begin(&mut bus, "P".repeat(n).as_bytes()).unwrap());
    board.write16(words.command_loaded.word, 0).unwrap();
    for word in 0..m / 2 {
        board.write16(words.response.plus_words(word), 0x3131).unwrap();
    }
    board.write16(words.response.plus_words(m / 2), if m % 2 == 1 { 0x0031 } else { 0 }).unwrap();
    board.write16(words.response_control, response::LINE).unwrap();
    let event = port.poll(&mut bus, now).unwrap();
    assert!(matches!(event, Some(AsciiEvent::Line(text)) if text.as_bytes().len() == m), "{event:?}");
    board.write16(words.response, 0).unwrap();
    board.write16(words.response_control, response::ACKNOWLEDGE).unwrap();
    assert_eq!(port.poll(&mut bus, now).unwrap(), Some(AsciiEvent::Done(Ok(()))));
    bus.accesses() as usize
}

/// The same through the mailboxes.
pub fn mailboxes(n: usize, m: usize) -> usize {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x200).unwrap();
    let mut bus = Counted::new(Mapping::new(&file, 0, 0x200).unwrap());
    let mut board = Mapping::new(&file, 0, 0x200).unwrap();
    let now = Instant::now();
    let mut port = MailboxPort::new(MailboxSettings::default(), 200);
    port.start(&mut bus, now).unwrap();
    assert_eq!(port.poll(&mut bus, now + MAILBOX_SETTLE).unwrap(), None);
    let before = bus.accesses();
    assert!(port.begin(&mut bus, "P".repeat(n).as_bytes()).unwrap());
    for _ in 0..(n + 1).div_ceil(15) {
        port.signal(MailboxSignal::GroupTaken);
        assert_eq!(port.poll(&mut bus, now).unwrap(), None);
    }
    assert!(port.was_taken());
    let reply: Vec<u8> = "1".repeat(m).bytes().chain([b'\r']).collect();
    let mut events = Vec::new();
    for group in reply.chunks(16).chain([&[0x06][..]]) {
        for (number, &character) in group.iter().enumerate() {
            ByteBus::write8(&mut board, 2 * number as u32 + 1, character).unwrap();
        }
        port.signal(MailboxSignal::ReplyReady);
        events.extend(port.poll(&mut bus, now).unwrap());
    }
    assert!(matches!(events[0], AsciiEvent::Line(text) if text.as_bytes().len() == m), "{events:?}");
    assert_eq!(events[1..], [AsciiEvent::Done(Ok(()))]);
    (bus.accesses() - before) as usize
}

#[test]
fn a_line_costs_what_the_table_says() {
    for family in FAMILIES {
        let dpram = |n, m, access| dpram(family, n, m, access);
        for (n, m) in [(2, 2), (20, 20), (80, 80), (159, 255), (1, 0), (15, 15), (29, 16), (33, 47)] {
            assert_eq!(dpram(n, m, Access::Bits32), n / 2 + m / 4 + 10, "{n} {m}");
            assert_eq!(dpram(n, m, Access::Bits16), n / 2 + m / 2 + 10, "{n} {m}");
        }
        assert_eq!([(2, 2), (20, 20), (80, 80)].map(|(n, m)| dpram(n, m, Access::Bits16)), [12, 30, 90]);
    }
    for (n, m) in [(2, 2), (20, 20), (80, 80), (159, 255), (1, 0), (15, 15), (29, 16), (33, 47)] {
        assert_eq!(mailboxes(n, m), n + m + 5 + 2 * (m + 1).div_ceil(16), "{n} {m}");
    }
    assert_eq!([(2, 2), (20, 20), (80, 80)].map(|(n, m)| mailboxes(n, m)), [11, 49, 177]);
}
