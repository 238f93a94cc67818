//! The accesses of public drivers of Turbo boards to the DPRAM and the mailboxes, one by one: each driver gets the
//! answers that it expects.
//!
//! The accesses follow the drivers' sources: `epics-modules/tpmac` (VxWorks) takes reports and variables byte by byte
//! and sends commands through the mailboxes; `epics-motor/motorDeltaTau` (VxWorks) and `ls-cat-org/pgpmac` (Ethernet)
//! send commands through the DPRAM.

use std::fs::OpenOptions;

use crate::device::mapping::Mapping;
use crate::sim::board::turbo;
use crate::sim::functions::mailbox::{LENGTH, Mailbox};
use crate::sim::testing::Bench;

/// Servo cycles in a tick of VxWorks: a sixtieth of a second at 2.26 kHz.
const TICK: usize = 38;

/// A Turbo PMAC2 with `settings`.
fn board(settings: &str) -> Bench {
    let mut bench = Bench::of(&turbo::TURBO2, turbo::TURBO2.firmware);
    bench.world.load("site", settings).unwrap();
    bench
}

/// tpmac's accesses: a byte each, the upper byte of a word first.
struct ByBytes<'a>(&'a Bench);

impl ByBytes<'_> {
    fn read16(&self, at: u32) -> u16 {
        let upper = self.0.read8(at + 1);
        u16::from_le_bytes([self.0.read8(at), upper])
    }

    fn write16(&self, at: u32, value: u16) {
        let [lower, upper] = value.to_le_bytes();
        self.0.write8(at + 1, upper);
        self.0.write8(at, lower);
    }

    fn read24(&self, at: u32) -> u32 {
        [at + 2, at + 1, at].iter().fold(0, |value, byte| value << 8 | u32::from(self.0.read8(*byte)))
    }

    /// A register of 48 bits, the Y half first.
    fn read48(&self, at: u32) -> i64 {
        let low = i64::from(self.read24(at));
        let high = self.read24(at + 4) << 8;
        i64::from(high.cast_signed() >> 8) << 24 | low
    }

    /// As each record of a motor asks for it.
    fn ask_for_motor(&self, motor: u32) {
        let at = 0x0070 + 2 * ((motor - 1) / 16);
        self.write16(at, self.read16(at) | 1 << ((motor - 1) % 16));
    }

    fn ask_for_system(&self, system: u16) {
        if system > self.read16(0x0674) & 0x1F {
            self.write16(0x0674, system);
        }
    }

    /// The table at $060540, which has the lower 16 bits of each address and no others.
    fn ask_for_variables(&self, entries: &[(u16, u16)]) {
        self.write16(0x1048, 0);
        self.write16(0x104A, 0xF0);
        for (&(address, kind), at) in entries.iter().zip((0x1500..).step_by(4)) {
            self.write16(at, address);
            self.write16(at + 2, kind);
        }
        self.write16(0x1048, entries.len() as u16);
        self.write16(0x1044, 0);
    }
}

#[test]
fn a_driver_that_reads_byte_by_byte_gets_motors_systems_and_variables() {
    // tpmac's own settings: I47=20 and I50=40; and the same on request.
    for periods in ["I47=20 I50=40", "I47=0 I50=0"] {
        let mut bench = board("I48=1 I49=1 I55=1 I56=1 I57=0\nI3100=1 I3200=1\n&16#32->X\n#31J/#32J/");
        bench.world.load("site", periods).unwrap();
        bench.world.load("site", "#31J=-1000#32J=1000").unwrap();
        bench.run(5000);
        let host = ByBytes(&bench);
        (1..=32).for_each(|motor| host.ask_for_motor(motor));
        (1..=16).for_each(|system| host.ask_for_system(system));
        // X:$000000, the servo counter; Y:$001040, the second status word of motor 32; D:$00100B, its position.
        host.ask_for_variables(&[(0x0000, 0x20), (0x1040, 0x00), (0x100B, 0x10)]);
        let (mut motors, mut systems, mut variables) = (0, 0, 0);
        for tick in 1..=60 {
            bench.run(TICK);
            let host = ByBytes(&bench);
            let status = host.read16(0x006E);
            if status & 0x8000 != 0 {
                motors += 1;
                let motor = |number: u32| 0x0074 + 0x30 * (number - 1);
                assert_eq!([31, 32].map(|number| host.read48(motor(number) + 40)), [-3_072_000, 3_072_000]);
                assert_eq!([12, 16].map(|at| host.read24(motor(32) + at)), [0x89_2000, 0xF7_8001]);
                host.write16(0x006E, status & 0x7FFF);
            }
            // Systems and variables ten times a second.
            if tick % 6 != 0 {
                continue;
            }
            if host.read16(0x067A) & 0x8000 != 0 {
                systems += 1;
                let system = 0x069C + 0x80 * 15;
                assert_eq!([20, 96].map(|at| host.read24(system + at)), [0xA8_0020, 0x02_0000]);
                host.write16(0x067A, 0);
            }
            if host.read16(0x1044) & 1 == 1 {
                variables += 1;
                assert_eq!(host.read24(0x150C) as u16, host.read16(0x1046), "the counter and the time stamp");
                assert_eq!((host.read24(0x1510), host.read48(0x1514)), (0xF7_8001, 3_072_000));
                host.write16(0x1044, 0);
            }
        }
        assert_eq!((motors, systems, variables), (60, 10, 10), "{periods}");
        assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    }
}

/// tpmac's mailboxes: 15 out, 16 in, the first character last.
struct ByMailbox {
    bench: Bench,
    mailbox: Mapping,
}

impl ByMailbox {
    fn put(&self, number: usize, character: u8) {
        self.mailbox.write8(2 * number + 1, character).unwrap();
    }

    /// Until the board has raised this interrupt.
    fn wait(&mut self, response: bool) {
        for _ in 0..10 {
            self.bench.run(1);
            let interrupts = &mut self.bench.world.interrupts;
            let count =
                if response { &mut interrupts.mailbox_response } else { &mut interrupts.mailbox_taken };
            if std::mem::take(count) > 0 {
                return;
            }
        }
        panic!("no interrupt");
    }

    fn write(&mut self, line: &str) {
        for group in [line.as_bytes(), b"\r"].concat().chunks(15) {
            for (&character, number) in group[1..].iter().zip(2..) {
                self.put(number, character);
            }
            self.put(0, group[0]);
            self.wait(false);
        }
    }

    /// The next text up to its end, and the end. The BELL of an error ends a group; its text is the next.
    fn read(&mut self) -> (String, u8) {
        let mut text = String::new();
        loop {
            self.put(1, 0);
            self.wait(true);
            for number in 0..16 {
                match self.mailbox.read8(2 * number + 1).unwrap() {
                    end @ (b'\r' | 0x06 | 0x07) => return (text, end),
                    character => text.push(char::from(character)),
                }
            }
        }
    }

    fn ask(&mut self, line: &str) -> Vec<(String, u8)> {
        self.write(line);
        let mut said = vec![self.read()];
        while said[said.len() - 1].1 == b'\r' {
            said.push(self.read());
        }
        said
    }
}

#[test]
fn a_driver_talks_through_the_mailboxes_once_it_has_chosen_the_page() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("mailbox");
    let mut bench = board("I3=2 I4=0 I6=1 I49=1");
    // The DPRAM at $70C000: A19 to A14 are 3.
    bench.world.fit_mailbox(Mailbox::open(&path, Some(3)).unwrap());
    bench.run(2);
    assert_eq!(bench.read(0x0674), 0xFFFF, "an empty bus");
    let file = OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let mut host = ByMailbox { bench, mailbox: Mapping::new(&file, 0, LENGTH).unwrap() };
    host.mailbox.write8(0x121, 3).unwrap();
    host.bench.run(2);
    assert_eq!(host.bench.read(0x0674), 0);
    let line = |text: &str| (text.to_owned(), b'\r');
    let end = (String::new(), 0x06);
    assert_eq!(host.ask("#1J/"), std::slice::from_ref(&end));
    // The line ends in a group of its own; so does a reply of 16 characters.
    assert_eq!(host.ask("P1=12345 P2=678"), std::slice::from_ref(&end));
    assert_eq!(host.ask("P1..2 I10"), [line("12345"), line("678"), line("3713991"), end.clone()]);
    assert_eq!(host.ask("&1??"), [line("A80020000000000000"), end.clone()]);
    assert_eq!((host.ask("J"), host.read()), (vec![(String::new(), 0x07)], line("ERR003")));
    assert_eq!(host.ask("TYPE"), [line("TURBO2, X4"), end], "an error is followed by nothing");
    assert!(host.bench.violations().is_empty(), "{:?}", host.bench.violations());
}

/// motorDeltaTau's commands through the DPRAM.
struct Flushing<'a>(&'a mut Bench);

impl Flushing<'_> {
    fn begin(&self) {
        self.0.write8(0x0E9C, 0);
        self.0.write(0x0E9E, 0);
        self.0.write(0x0F40, 0);
        let count = self.0.read8(0x0F42);
        self.0.write8(0x0F43, count);
    }

    /// Takes away whatever an earlier command left.
    fn flush(&mut self) {
        let mut end = self.0.read8(0x0F40);
        loop {
            if end != 0 {
                self.0.write(0x0F40, 0);
            }
            let was = end;
            // After a line the driver waits for the next.
            for _ in 0..if was == 0x0D { 10 } else { 1 } {
                self.0.run(TICK);
                end = self.0.read8(0x0F40);
                if end != 0 {
                    break;
                }
            }
            if was == 0 && end == 0 {
                return;
            }
        }
    }

    fn send(&mut self, line: &str) {
        self.flush();
        assert_eq!(self.0.read8(0x0E9C), 0, "{line}: the line before is taken");
        for (byte, at) in line.bytes().chain([0]).zip(0x0EA0..) {
            self.0.write8(at, byte);
        }
        self.0.write8(0x0E9C, 1);
        for wait in 0..10 {
            if self.0.read8(0x0F40) != 0 {
                return;
            }
            self.0.run(TICK * wait);
        }
        panic!("{line}: no answer");
    }

    /// The line that answers, or nothing for an error.
    fn receive(&mut self) -> Option<String> {
        for _ in 0..10 {
            let end = self.0.read(0x0F40);
            match end as u8 {
                0 => self.0.run(2 * TICK),
                0x0D => {
                    let bytes = (0x0F44..).map(|at| self.0.read8(at)).take_while(|&byte| byte != 0);
                    let text = bytes.map(char::from).collect();
                    self.0.write(0x0F40, 0);
                    return Some(text);
                }
                // The end of an earlier reply: the answer is still to come.
                0x06 => self.0.write(0x0F40, 0),
                _ => {
                    self.0.write(0x0F40, 0);
                    return None;
                }
            }
        }
        panic!("no answer");
    }

    fn ask(&mut self, line: &str) -> Option<String> {
        self.send(line);
        self.receive()
    }
}

#[test]
fn a_driver_that_flushes_first_talks_through_the_dpram() {
    let mut bench = board("I3=2 I6=1 I58=1\nM161->D:$88\nM162->D:$8B\nI200=1\n#1J/#2J/");
    let mut host = Flushing(&mut bench);
    host.begin();
    let said = |text: &str| Some(text.to_owned());
    assert_eq!(host.ask("TYPE"), said("TURBO2, X4"));
    assert_eq!(host.ask("VERSION"), said("1.947"));
    for (line, answer) in [("I100", "1"), ("I200", "1"), ("I300", "0")] {
        assert_eq!(host.ask(line), said(answer), "{line}");
    }
    host.send("I0120=1");
    host.send("I0121=0");
    assert_eq!(host.ask("I0108"), said("96"));
    host.send("#1J=100");
    host.0.run(3000);
    assert_eq!(host.ask("#1?"), said("892000000001"));
    assert_eq!([host.ask("M161"), host.ask("M162")], [said("307200"), said("307200")]);
    assert_eq!(host.ask("UUU"), None);
    assert_eq!(host.ask("I122"), said("32"), "the answer of this line");
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

/// pgpmac's commands through the DPRAM: it clears both words, then loads the line, and clears the response by four bytes.
struct Clearing<'a>(&'a mut Bench);

impl Clearing<'_> {
    fn set_memory(&self, at: u32, bytes: &[u8]) {
        bytes.iter().zip(at..).for_each(|(&byte, at)| self.0.write8(at, byte));
    }

    fn ask(&mut self, line: &str) -> (Vec<String>, u16) {
        self.set_memory(0x0F40, &[0; 4]);
        self.set_memory(0x0E9C, &[0; 4]);
        self.set_memory(0x0EA0, &[line.as_bytes(), &[0]].concat());
        // A bit is set by an OR of four bytes.
        let was = self.0.read32(0x0E9C);
        self.set_memory(0x0E9C, &(was | 1).to_le_bytes());
        let mut lines = Vec::new();
        for _ in 0..200 {
            // A packet over the network takes a while.
            self.0.run(5);
            let control = self.0.read(0x0F40);
            if control == 0 {
                continue;
            }
            let text = (0x0F44..).map(|at| self.0.read8(at)).take_while(|&byte| byte != 0);
            if control & 0x8000 == 0 && self.0.read(0x0F42) > 1 {
                lines.push(text.map(char::from).collect());
            }
            self.set_memory(0x0F40, &[0; 4]);
            if control & 0xFF != 0x0D {
                self.0.run(5);
                return (lines, control);
            }
        }
        panic!("{line}: no answer");
    }
}

#[test]
fn a_driver_over_ethernet_talks_through_the_dpram_and_reads_what_its_site_keeps_there() {
    // The site's status words take the place of the motor report.
    let mut bench = board("I58=1 I63=1 I64=1\nM5075->*\nM321->DP:$60121\nM301->DP:$60101");
    let mut host = Clearing(&mut bench);
    for character in [0, 0x18] {
        host.set_memory(0x0E9E, &[character, 0, 0, 0]);
    }
    for line in ["I5=0", "I36=1", "I5=3", "M5075=0"] {
        assert_eq!(host.ask(line), (vec![], 0x0006), "{line}");
    }
    let lines = |texts: &[&str]| texts.iter().map(|&text| text.to_owned()).collect::<Vec<_>>();
    assert_eq!(host.ask("I122 I10"), (lines(&["32", "3713991"]), 0x0006));
    assert_eq!(host.ask("UUU").1, 0x8003);
    host.0.run(10);
    assert_eq!(host.ask("M321=-77 M301=$892000 M5075"), (lines(&["0"]), 0x0006));
    assert_eq!([0x0484, 0x0404].map(|at| host.0.read32(at)), [(-77_i32).cast_unsigned(), 0x89_2000]);
    // ^A by two bytes; the board has taken it when the word is 0.
    host.set_memory(0x0E9E, &[0x01, 0]);
    host.0.run(3);
    assert_eq!((host.0.read(0x0E9E), host.0.read(0x0F40)), (0, 0), "^A says nothing");
    // The driver clears the count, too, which is PMAC's word: that could wipe out the count of the next response.
    let found = bench.violations();
    assert!(!found.is_empty() && found.iter().all(|found| found.contains("to 0x0F42")), "{found:?}");
}
