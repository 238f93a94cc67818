//! The mailbox port against User Manual pp. 263-267.

use std::fs::OpenOptions;

use tempfile::TempDir;

use super::*;
use crate::sim::board::output::Port;
use crate::sim::testing::{Bench, l};
use crate::sim::world::Interrupts;

struct Rig {
    bench: Bench,
    host: Mapping,
    /// The host writes bytes, as on the bus; else 16 bits.
    bytes: bool,
    _directory: TempDir,
}

impl Rig {
    fn new(page: Option<u8>) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("mailbox");
        let mut bench = Bench::bare("1.16D");
        bench.world.fit_mailbox(Mailbox::open(&path, page).unwrap());
        bench.set(3, 2.0);
        bench.set(6, 1.0);
        let file = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let host = Mapping::new(&file, 0, LENGTH).unwrap();
        Self { bench, host, bytes: true, _directory: directory }
    }

    fn write(&self, mailbox: usize, character: u8) {
        if self.bytes {
            self.host.write8(2 * mailbox + 1, character).unwrap();
        } else {
            self.host.write16(2 * mailbox, u16::from(character) << 8).unwrap();
        }
    }

    fn read(&self, mailbox: usize) -> u8 {
        (self.host.read16(2 * mailbox).unwrap() >> 8) as u8
    }

    /// Runs until the board has raised this interrupt once more.
    fn interrupt(&mut self, line: impl Fn(&mut Interrupts) -> &mut u64) {
        for _ in 0..10 {
            self.bench.run(1);
            let count = line(&mut self.bench.world.interrupts);
            if *count > 0 {
                *count -= 1;
                return;
            }
        }
        panic!("no interrupt");
    }

    fn taken(&mut self) {
        self.interrupt(|interrupts| &mut interrupts.mailbox_taken);
    }

    fn response(&mut self) -> Vec<u8> {
        self.interrupt(|interrupts| &mut interrupts.mailbox_response);
        (0..16).map(|mailbox| self.read(mailbox)).collect()
    }

    fn group(&mut self, characters: &[u8]) {
        for (index, &character) in characters.iter().enumerate().skip(1) {
            self.write(index + 1, character);
        }
        self.write(0, characters[0]);
        self.taken();
    }

    fn send(&mut self, line: &str) {
        let bytes: Vec<u8> = line.bytes().chain([CR]).collect();
        for group in bytes.chunks(15) {
            self.group(group);
        }
    }

    fn silent(&mut self) {
        self.bench.run(20);
        assert_eq!(self.bench.world.interrupts.mailbox_response, 0);
    }
}

#[test]
fn the_manuals_example_comes_in_its_three_groups() {
    let mut rig = Rig::new(None);
    for (address, value) in [(0x1000, 0x12_3456), (0x1001, 0x78_9012), (0x1002, 0x34_5678)] {
        rig.bench.world.board.memory.write_x(address, value);
    }
    rig.send("RHX$1000,3");
    rig.silent();
    rig.write(1, 0);
    assert_eq!(rig.response(), b"123456 789012 34");
    rig.silent();
    rig.write(1, 0);
    let second = rig.response();
    assert_eq!(second[..5], *b"5678\r");
    assert_eq!(second[14..], *b"34", "stale characters stay");
    rig.write(1, 0);
    let third = rig.response();
    assert_eq!((third[0], third[4], &third[14..]), (ACK, CR, &b"34"[..]));
    rig.write(1, 0);
    rig.silent();
    assert!(rig.bench.violations().is_empty(), "{:?}", rig.bench.violations());
    rig.send("P1");
    assert_eq!(rig.response()[..2], *b"0\r", "enabled since");
}

#[test]
fn long_lines_go_in_groups_of_fifteen_and_a_lone_return_in_mailbox_0() {
    let mut rig = Rig::new(None);
    // 15 characters, then <CR> alone.
    rig.send("P1=12345 P2=678");
    rig.write(1, 0);
    assert_eq!(rig.response()[0], ACK);
    rig.send("P3=P1+P2 P3 P1..2 P3..3");
    let mut text = Vec::new();
    while text.last() != Some(&ACK) {
        rig.write(1, 0);
        let group = rig.response();
        let end = group.iter().position(|c| matches!(*c, CR | ACK)).unwrap_or(15);
        text.extend_from_slice(&group[..=end]);
    }
    assert_eq!(text, b"13023\r12345\r678\r13023\r\x06");
}

#[test]
fn the_same_character_and_the_same_line_can_be_sent_again() {
    let mut rig = Rig::new(None);
    for round in 1..=3 {
        rig.send("P1=P1+1");
        rig.write(1, 0);
        assert_eq!(rig.response()[0], ACK);
        assert_eq!(rig.bench.world.board.memory.read_l(l(0x1001)), f64::from(round));
    }
}

#[test]
fn a_host_that_writes_16_bits_is_noticed_even_with_the_character_that_is_there() {
    let mut rig = Rig::new(None);
    rig.bytes = false;
    rig.send("P0=7");
    rig.write(1, 0);
    rig.response();
    rig.send("P0");
    rig.write(1, 0);
    assert_eq!(rig.response()[..2], *b"7\r");
    rig.send("7");
    rig.write(1, 0);
    assert_eq!(rig.response()[0], ACK);
}

#[test]
fn errors_bell_and_text_in_one_group() {
    let mut rig = Rig::new(None);
    rig.write(1, 0);
    rig.send("UUU");
    assert_eq!(rig.response()[..8], *b"\x07ERR003\r");
    rig.bench.set(6, 0.0);
    rig.write(1, 0);
    rig.send("UUU");
    assert_eq!(rig.response()[..5], *b"\x07\xFFUU\r", "a BELL, and what the host had written behind it");
    rig.write(1, 0);
    rig.silent();
}

#[test]
fn control_characters_act_from_mailbox_0_alone() {
    let mut rig = Rig::new(None);
    rig.bench.set(100, 1.0);
    rig.bench.set(120, 10.0);
    rig.send("#1J+");
    rig.bench.run(100);
    assert!(rig.bench.world.board.motors[0].moving());
    rig.write(2, b'J');
    rig.group(&[0x0B]);
    assert!(!rig.bench.world.board.motors[0].moving());
    rig.write(1, 0);
    assert_eq!(rig.response()[0], ACK, "of J+; ^K says nothing");
    rig.write(1, 0);
    rig.silent();
    rig.send("P1");
    rig.group(&[0x18]);
    rig.write(1, 0);
    rig.bench.run(10);
    // The enable before took the number; <ACK> and the rest were cancelled.
    rig.bench.world.interrupts.mailbox_response = 0;
    rig.write(1, 0);
    rig.silent();
}

#[test]
fn messages_of_programs_go_to_the_mailboxes_that_commands_came_from() {
    let mut rig = Rig::new(None);
    rig.send("P1=1");
    rig.write(1, 0);
    rig.response();
    assert_eq!(rig.bench.world.board.response_port(), Port::Mailbox);
    crate::sim::control::execute(&mut rig.bench.world, "send hello", true);
    rig.write(1, 0);
    assert_eq!(rig.response()[..6], *b"hello\r");
    rig.group(&[0x1A]);
    assert_eq!(rig.bench.world.board.response_port(), Port::Serial);
}

#[test]
fn the_dpram_is_out_of_reach_until_the_page_is_written_after_every_reset() {
    let mut rig = Rig::new(Some(0x3F));
    rig.bench.set(49, 1.0);
    rig.bench.set(59, 1.0);
    rig.bench.world.execute(b"SAVE");
    rig.bench.run(5);
    assert_eq!((rig.bench.read(0x0228), rig.bench.read(0x3FFE)), (0xFFFF, 0xFFFF));
    rig.host.write8(0x121, 0x3E).unwrap();
    rig.bench.run(5);
    assert_eq!(rig.bench.read(0x0228), 0xFFFF, "another page");
    rig.host.write8(0x121, 0x3F).unwrap();
    rig.bench.run(3);
    assert_eq!((rig.bench.read(0x0228), rig.bench.read(0x3FFE)), (1, 0));
    assert_eq!(rig.bench.world.selected_page(), Some(0x3F));
    rig.send("$$$");
    rig.bench.run(3);
    assert_eq!((rig.bench.read(0x0228), rig.bench.world.selected_page()), (0xFFFF, None));
    rig.write(1, 0);
    rig.send("P1");
    assert_eq!(rig.response()[..2], *b"0\r", "the mailboxes answer meanwhile");
    rig.host.write16(0x120, 0x3F00).unwrap();
    rig.bench.run(3);
    assert_eq!(rig.bench.read(0x0228), 1);
    assert!(rig.bench.violations().is_empty(), "{:?}", rig.bench.violations());
}

#[test]
fn a_host_against_the_rules_is_recorded() {
    let mut rig = Rig::new(None);
    rig.write(1, b'X');
    rig.bench.run(2);
    assert_eq!(rig.bench.violations().len(), 1, "{:?}", rig.bench.violations());
    rig.write(2, CR);
    rig.write(0, b'P');
    rig.bench.run(1);
    rig.write(0, b'Q');
    rig.bench.run(1);
    assert_eq!(rig.bench.violations().len(), 2, "{:?}", rig.bench.violations());
}

#[test]
fn faults_hold_delay_and_tear() {
    let mut rig = Rig::new(None);
    rig.bench.world.board.faults.mailbox.stuck = true;
    rig.write(2, CR);
    rig.write(0, b'V');
    rig.write(1, 0);
    rig.bench.run(30);
    assert_eq!(
        (rig.bench.world.interrupts.mailbox_taken, rig.bench.world.interrupts.mailbox_response),
        (0, 0)
    );
    rig.bench.world.board.faults.mailbox.stuck = false;
    rig.bench.world.board.faults.mailbox.late = 4;
    rig.bench.world.board.faults.mailbox.torn = true;
    rig.bench.run(4);
    assert_eq!(rig.bench.world.interrupts.mailbox_taken, 0);
    rig.bench.run(1);
    assert_eq!(
        (rig.bench.world.interrupts.mailbox_taken, rig.bench.world.interrupts.mailbox_response),
        (1, 0)
    );
    rig.bench.run(4);
    assert_eq!((rig.bench.world.interrupts.mailbox_response, rig.read(0), rig.read(1)), (1, b'0', 0xFF));
    rig.bench.run(1);
    assert_eq!((rig.read(0), rig.read(1)), (b'0', CR));
}
