//! The port against hand-driven mailboxes: the manual's own trace first.

use proptest::prelude::*;

use super::*;
use crate::device::Counted;
use crate::device::mapping::Mapping;

/// Characters of the longest line.
const LINE_CHARACTERS: usize = 200;

/// The mailboxes, and PMAC's half done by hand.
struct Rig {
    bus: Counted<Mapping>,
    port: MailboxPort,
    now: Instant,
    received: Vec<u8>,
}

impl Rig {
    fn new(settings: MailboxSettings) -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x200).unwrap();
        let bus = Counted::new(Mapping::new(&file, 0, 0x200).unwrap());
        let mut rig = Self {
            bus,
            port: MailboxPort::new(settings, LINE_CHARACTERS),
            now: Instant::now(),
            received: Vec::new(),
        };
        rig.port.start(&mut rig.bus, rig.now).unwrap();
        assert!(!rig.port.is_idle());
        rig.now += MAILBOX_SETTLE;
        assert_eq!(rig.poll(), None);
        assert!(rig.port.is_idle());
        rig
    }

    fn begin(&mut self, line: &str) -> bool {
        for number in 0..16 {
            self.bus.write8(mailbox(number), 0xEE).unwrap();
        }
        self.port.begin(&mut self.bus, line.as_bytes()).unwrap()
    }

    fn poll(&mut self) -> Option<AsciiEvent> {
        self.port.poll(&mut self.bus, self.now).unwrap()
    }

    /// PMAC takes the group in the mailboxes, whose length it knows.
    fn take(&mut self, length: usize) -> Option<AsciiEvent> {
        assert_eq!(self.bus.read8(mailbox(1)).unwrap(), 0xEE, "mailbox 1 is not for characters");
        for character in 0..length {
            let number = if character == 0 { 0 } else { character + 1 };
            self.received.push(self.bus.read8(mailbox(number)).unwrap());
        }
        self.port.signal(MailboxSignal::GroupTaken);
        self.poll()
    }

    fn take_all(&mut self, line: &str) {
        let mut rest = line.len() + 1;
        while rest > 0 {
            let group = rest.min(15);
            assert_eq!(self.take(group), None);
            rest -= group;
        }
    }

    /// PMAC fills the mailboxes, which it may only while mailbox 1 has been written.
    fn fill(&mut self, group: &[u8]) -> Option<AsciiEvent> {
        assert!(self.port.enabled, "PMAC is silent until mailbox 1 is written");
        for (number, &character) in group.iter().enumerate() {
            self.bus.write8(mailbox(number), character).unwrap();
        }
        self.port.signal(MailboxSignal::ReplyReady);
        let event = self.poll();
        if self.port.settings.enable_replies == EnableReplies::Always {
            assert_eq!(self.bus.read8(mailbox(1)).unwrap(), 0);
        }
        event
    }
}

fn line(text: &str) -> Option<AsciiEvent> {
    Some(AsciiEvent::Line(ResponseText::cut(text.as_bytes())))
}

#[test]
fn the_manuals_trace() {
    let mut rig = Rig::new(MailboxSettings::default());
    let before = rig.bus.accesses();
    assert!(rig.begin("RHX$1000,3"));
    assert_eq!(rig.bus.accesses() - before - 16, 11, "16 are the test's own");
    assert_eq!(rig.bus.read8(0x01).unwrap(), b'R');
    assert_eq!(rig.bus.read8(0x05).unwrap(), b'H');
    assert_eq!(rig.bus.read8(0x17).unwrap(), b'\r');
    rig.take_all("RHX$1000,3");
    assert_eq!(rig.received, b"RHX$1000,3\r");
    assert!(rig.port.was_taken());

    assert_eq!(rig.fill(b"123456 789012 34"), None);
    let before = rig.bus.accesses();
    assert_eq!(rig.fill(b"5678\r"), line("123456 789012 345678"));
    assert_eq!(rig.bus.accesses() - before - 6, 5 + 2, "5 + 1 are the test's own");
    assert_eq!(rig.bus.read8(0x0B).unwrap(), b'6', "an old character stands behind");
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
    assert!(rig.port.is_idle());
    assert_eq!(rig.poll(), None);
}

#[test]
fn long_lines_go_in_groups_of_fifteen() {
    for length in 0..=LINE_CHARACTERS {
        let text: String = (0..length).map(|index| char::from(b'A' + (index % 26) as u8)).collect();
        let mut rig = Rig::new(MailboxSettings::default());
        assert!(rig.begin(&text));
        rig.take_all(&text);
        assert_eq!(rig.received, format!("{text}\r").as_bytes());
        assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
    }
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(!rig.begin(&"A".repeat(LINE_CHARACTERS + 1)));
}

#[test]
fn errors_come_as_i6_has_them() {
    let same = MailboxSettings::default();
    let mut rig = Rig::new(same);
    assert!(rig.begin("UUU"));
    rig.take_all("UUU");
    assert_eq!(rig.fill(b"\x07ERR003\r"), Some(AsciiEvent::Error(3)));
    assert!(rig.begin("P1"), "the port goes on");

    let mut rig = Rig::new(MailboxSettings { error_report: ErrorReport::NextLine, ..same });
    assert!(rig.begin("UUU"));
    rig.take_all("UUU");
    assert_eq!(rig.fill(b"\x07\r"), None);
    assert_eq!(rig.fill(b"ERR017\r"), Some(AsciiEvent::Error(17)));

    // A group may end with the <BELL>: any characters of an older group may follow it.
    let mut rig = Rig::new(same);
    for older in [&b"RR003\r"[..], b"ERR00\r", b"\x06", b"\r", b"ERR003 P1=7\r", b""] {
        assert!(rig.begin("XYZ"));
        rig.take_all("XYZ");
        assert_eq!(rig.fill(&[b"\x07", older].concat()), None, "{older:?}");
        assert_eq!(rig.fill(b"ERR005\r"), Some(AsciiEvent::Error(5)), "{older:?}");
    }
    // The characters behind a lone <BELL> are an older error's number.
    let mut rig = Rig::new(MailboxSettings { error_report: ErrorReport::BellOnly, ..same });
    assert!(rig.begin("UUU"));
    rig.take_all("UUU");
    assert_eq!(rig.fill(b"\x07ERR003\r"), Some(AsciiEvent::Error(0)));
}

#[test]
fn what_comes_behind_a_programs_error_is_the_lines_until_another_line_is_answered() {
    for enable_replies in [EnableReplies::Always, EnableReplies::WithCommand] {
        let mut rig = Rig::new(MailboxSettings { enable_replies, ..MailboxSettings::default() });
        assert_eq!(rig.fill(b"\x07ERR003\r"), Some(AsciiEvent::ProgramError(3)), "nothing is under way");
        assert!(rig.begin("P1"));
        rig.take_all("P1");
        assert_eq!(rig.fill(b"\x07ERR005\r"), Some(AsciiEvent::Error(5)));
        if enable_replies == EnableReplies::Always {
            assert_eq!(rig.fill(b"25\r"), line("25"));
        }
        for number in 0..16 {
            rig.bus.write8(mailbox(number), 0xEE).unwrap();
        }
        assert!(rig.port.begin_open_ended(&mut rig.bus, b"I3 I10 I3").unwrap());
        rig.take_all("I3 I10 I3");
        if enable_replies == EnableReplies::WithCommand {
            assert_eq!(rig.fill(b"25\r"), line("25"));
        }
        assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
        assert_eq!(rig.fill(b"2\r"), line("2"));
        assert_eq!(rig.fill(b"3713707\r"), line("3713707"));
        assert_eq!(rig.fill(b"2\r"), line("2"));
        assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
        rig.port.finish();
        assert!(rig.begin("P2"));
    }
}

#[test]
fn a_reply_counts_as_one_even_if_the_interrupt_before_it_is_seen_later() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.begin("P1"));
    assert_eq!(rig.fill(b"25\r"), line("25"));
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
    rig.port.signal(MailboxSignal::GroupTaken);
    assert!(rig.begin("P1=1234567890123456"));
    assert_eq!(rig.poll(), None);
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), b'P', "the late one is not this group's");
}

#[test]
fn what_comes_unasked_is_a_programs_message() {
    let mut rig = Rig::new(MailboxSettings::default());
    let message = rig.fill(b"DOOR OPEN\r");
    assert_eq!(message, Some(AsciiEvent::ProgramMessage(ResponseText::cut(b"DOOR OPEN"))));
    // The host reads a message that comes while a line is half sent, before the rest of the line overwrites it.
    assert!(rig.begin("P1=1234567890123456"));
    rig.port.signal(MailboxSignal::GroupTaken);
    let message = rig.fill(b"DOOR\r");
    assert!(matches!(message, Some(AsciiEvent::ProgramMessage(_))), "{message:?}");
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), b'D');
    assert_eq!(rig.poll(), None);
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), b'3', "the second group");
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Stale(6)), "one too many");
}

#[test]
fn a_control_character_goes_alone() {
    let mut rig = Rig::new(MailboxSettings::default());
    let before = rig.bus.accesses();
    assert!(rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap());
    assert_eq!((rig.bus.accesses() - before, rig.bus.read8(mailbox(0)).unwrap()), (1, 0x01));
    assert!(!rig.begin("P1"), "it still lies there");
    assert!(!rig.port.control(&mut rig.bus, 0x0B, false, rig.now).unwrap());
    rig.port.signal(MailboxSignal::GroupTaken);
    assert_eq!(rig.poll(), None);
    assert!(rig.begin("P1"));
    assert!(!rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap(), "a group lies in the mailboxes");
    rig.take_all("P1");
    assert!(
        rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap(),
        "while a reply is awaited it may go"
    );
    assert_eq!(rig.fill(b"1\r"), line("1"));
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
}

#[test]
fn what_stops_a_machine_does_not_wait_for_an_interrupt_that_was_lost() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.begin("P1=1234567890123456"));
    assert_eq!(rig.poll(), None);
    assert!(
        !rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap(),
        "the group has only just been written"
    );
    rig.now += MAILBOX_GROUP_LIES;
    assert!(!rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap(), "that one can wait");
    assert!(rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap());
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), 0x01);
    assert!(rig.port.is_settling() && rig.port.control_pending() && !rig.begin("P2"));
    // The port does not replace the ^A, not even when the caller gives up the line or much time has passed.
    rig.port.give_up(&mut rig.bus, rig.now).unwrap();
    rig.now += 2 * MAILBOX_CANCEL_TAKEN;
    assert_eq!(rig.poll(), None);
    assert!(!rig.port.control(&mut rig.bus, 0x0B, false, rig.now).unwrap());
    assert!(rig.port.control_pending() && !rig.port.is_idle(), "not taken is not done");
    rig.port.signal(MailboxSignal::GroupTaken);
    assert_eq!(rig.poll(), None);
    assert!(!rig.port.control_pending());
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), 0xEE, "the rest of the line is not sent");
    // The board may hold the first half of the line, and must forget it.
    rig.now += MAILBOX_SETTLE;
    assert_eq!(rig.poll(), None);
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), CANCEL);
    // The <CTRL-X>'s interrupt is lost, too.
    rig.now += MAILBOX_GROUP_LIES / 2;
    assert!(!rig.port.control(&mut rig.bus, 0x0B, false, rig.now).unwrap());
    rig.now += MAILBOX_GROUP_LIES;
    assert!(rig.port.control(&mut rig.bus, 0x0B, false, rig.now).unwrap());
    for character in [0x0B, CANCEL] {
        assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), character);
        rig.port.signal(MailboxSignal::GroupTaken);
        assert_eq!(rig.poll(), None);
        rig.now += MAILBOX_SETTLE;
        assert_eq!(rig.poll(), None);
    }
    assert!(rig.port.is_idle());
    assert!(rig.begin("P2"));
    rig.take_all("P2");
    assert_eq!(rig.fill(b"2\r"), line("2"));
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
}

#[test]
fn a_control_character_with_a_reply_does_not_close_the_port_when_its_interrupt_is_lost() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
    assert_eq!(rig.fill(b"0 0\r"), line("0 0"));
    assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
    assert!(rig.port.is_idle());
    // A reporting character that stays too long does not hold up a stop either.
    assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
    assert!(!rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap());
    rig.now += MAILBOX_GROUP_LIES;
    assert!(rig.port.control(&mut rig.bus, 0x01, false, rig.now).unwrap() && rig.port.is_settling());
    // A <CTRL-X> replaces a stop that the caller takes back after all.
    rig.port.withdraw_control(&mut rig.bus, rig.now).unwrap();
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), CANCEL);
    assert!(!rig.port.control_pending());
    rig.now += MAILBOX_CANCEL_TAKEN;
    assert_eq!(rig.poll(), None);
    assert!(rig.port.is_idle());
}

#[test]
fn a_control_characters_reply_ends_with_ack_or_a_silence() {
    for ends_with_ack in [true, false] {
        let mut rig = Rig::new(MailboxSettings::default());
        assert!(rig.port.control(&mut rig.bus, 0x10, true, rig.now).unwrap());
        rig.now += 10 * MAILBOX_REPLY_SILENCE;
        assert_eq!(rig.poll(), None, "the board has not taken it");
        rig.port.signal(MailboxSignal::GroupTaken);
        rig.port.signal(MailboxSignal::ReplyReady);
        rig.port.enabled = true;
        assert_eq!(rig.fill(b"0 0 0 0\r"), line("0 0 0 0"));
        assert_eq!(rig.poll(), None);
        if ends_with_ack {
            assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
        } else {
            rig.now += MAILBOX_REPLY_SILENCE;
            assert_eq!(rig.poll(), Some(AsciiEvent::Done(Ok(()))));
        }
        assert!(rig.port.is_idle());
    }
}

#[test]
fn what_comes_after_giving_up_belongs_to_nobody() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.begin("P1"));
    rig.take_all("P1");
    rig.port.give_up(&mut rig.bus, rig.now).unwrap();
    assert_eq!(rig.bus.read8(mailbox(0)).unwrap(), CANCEL);
    assert!(!rig.begin("P2"));
    rig.now += MAILBOX_SETTLE / 2;
    assert_eq!(rig.fill(b"late and longer t"[..16].try_into().unwrap()), None);
    assert_eq!(rig.fill(b"han\r"), Some(AsciiEvent::Stale(13)));
    rig.now += MAILBOX_SETTLE / 2;
    assert_eq!(rig.poll(), None);
    assert!(!rig.begin("P2"), "the silence starts anew");
    rig.now += MAILBOX_SETTLE;
    assert_eq!(rig.poll(), None);
    assert!(!rig.begin("P2"), "PMAC has not taken the <CTRL-X>: there may be more");
    rig.port.signal(MailboxSignal::GroupTaken);
    assert_eq!(rig.poll(), None);
    rig.now += MAILBOX_SETTLE;
    assert_eq!(rig.poll(), None);
    assert!(rig.begin("P2"));
    rig.take_all("P2");
    assert_eq!(rig.fill(b"2\r"), line("2"));
}

#[test]
fn a_cancel_that_is_never_taken_does_not_close_the_port_for_ever() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.begin("P1"));
    rig.port.give_up(&mut rig.bus, rig.now).unwrap();
    rig.now += MAILBOX_CANCEL_TAKEN - MAILBOX_SETTLE;
    assert_eq!(rig.poll(), None);
    assert!(!rig.port.is_idle());
    rig.now += MAILBOX_SETTLE;
    assert_eq!(rig.poll(), None);
    assert!(rig.begin("P2"));
}

#[test]
fn replies_can_be_let_in_with_each_command_only() {
    let settings =
        MailboxSettings { enable_replies: EnableReplies::WithCommand, ..MailboxSettings::default() };
    let mut rig = Rig::new(settings);
    for _ in 0..2 {
        assert!(rig.begin("P1"));
        rig.take_all("P1");
        assert_eq!(rig.fill(b"1\r"), line("1"));
        rig.bus.write8(mailbox(1), 0x55).unwrap();
        assert_eq!(rig.fill(b"\x06"), Some(AsciiEvent::Done(Ok(()))));
        assert_eq!((rig.port.enabled, rig.bus.read8(mailbox(1)).unwrap()), (false, 0x55));
    }
}

#[test]
fn an_endless_line_cannot_leave_its_buffer() {
    let mut rig = Rig::new(MailboxSettings::default());
    assert!(rig.begin("P1"));
    rig.take_all("P1");
    let mut lines = 0;
    for _ in 0..100 {
        if let Some(event) = rig.fill(&[b'A'; 16]) {
            assert!(matches!(event, AsciiEvent::Line(text) if text.as_bytes().len() == 255));
            lines += 1;
        }
    }
    assert_eq!(lines, 6);
}

proptest! {
    #[test]
    fn no_group_panics(groups in proptest::collection::vec(any::<[u8; 16]>(), 0..60), report in 0usize..3) {
        let error_report = [ErrorReport::BellOnly, ErrorReport::SameLine, ErrorReport::NextLine][report];
        let mut rig = Rig::new(MailboxSettings { error_report, ..MailboxSettings::default() });
        prop_assert!(rig.begin("P1"));
        rig.take_all("P1");
        for group in groups {
            rig.fill(&group);
        }
    }
}
