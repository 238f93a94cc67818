//! A Turbo PMAC2's half of its DPRAM, which lies in a file, played after the Turbo User Manual pp. 402-410; and the daemon on it.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::process::Stdio;
use std::time::Duration;

use pmac_dpram::map::TURBO2;
use pmac_dpram::segment::Counter;

use crate::support::{VirtualSite, World};

/// What nobody wrote.
pub(super) const GARBAGE: u8 = 0x5A;
/// Bit 15 of 0x006A is Host-Busy, 0x006C the timer's low word; 0x006E has its high bits in 7-0 and Data-Ready in bit 15; 0x0070 is
/// the mask of motors (Turbo User Manual pp. 402-403).
pub(super) const SERVO_HOST: u64 = 0x006A;
pub(super) const SERVO_TIMER: u64 = 0x006C;
pub(super) const SERVO_READY: u64 = 0x006E;
pub(super) const MASK: u64 = 0x0070;
/// 0x0674 is the highest coordinate system in the report, bit 15 of 0x0676 Host-Busy; then as in the motor report (Turbo User
/// Manual p. 405).
pub(super) const SYSTEM_COUNT: u64 = 0x0674;
pub(super) const SYSTEM_HOST: u64 = 0x0676;
pub(super) const SYSTEM_TIMER: u64 = 0x0678;
pub(super) const SYSTEM_READY: u64 = 0x067A;
pub(super) const READY: u16 = 1 << 15;
/// Bit 0 of 0x0E9C says that a command lies at 0x0EA0; 0x0E9E is the control character, 0x0F40 the response's control word, 0x0F42
/// its characters and one more, 0x0F44 its line (Turbo User Manual pp. 405-407).
pub(super) const LOADED: u64 = 0x0E9C;
pub(super) const CHARACTER: u64 = 0x0E9E;
pub(super) const COMMAND: u64 = 0x0EA0;
pub(super) const RESPONSE: u64 = 0x0F40;
pub(super) const RESPONSE_COUNT: u64 = 0x0F42;
pub(super) const RESPONSE_TEXT: u64 = 0x0F44;

/// The board's half. It counts servo cycles of half a millisecond.
pub(super) struct Board {
    pub memory: File,
    pub cycles: u32,
    /// The global status words of `???`, in their order.
    pub global: [u32; 2],
    /// The first part of a line.
    part: Vec<u8>,
    /// How many lines came in two parts.
    pub parts: usize,
    /// The control characters it has taken.
    pub characters: Vec<u8>,
    /// Responses to come: control word and text.
    pub responses: VecDeque<(u16, String)>,
    /// The I-variables that were set.
    variables: HashMap<usize, u32>,
    pub gathers: bool,
    samples: u32,
    /// How many motors it has: it fills no other's block.
    pub motors: i64,
    /// What the lines begin with that it refuses.
    pub refuses: Option<&'static str>,
}

impl Board {
    fn new(site: &VirtualSite) -> Self {
        let path = site.path("dpram");
        std::fs::write(&path, vec![GARBAGE; TURBO2.length as usize]).unwrap();
        let memory = File::options().read(true).write(true).open(path).unwrap();
        let board = Self {
            memory,
            cycles: 0x12_FF00,
            // "16" of the second word says nothing that is asked for here, but tells the two words apart.
            global: [0, 1 << 16],
            part: Vec::new(),
            parts: 0,
            characters: Vec::new(),
            responses: VecDeque::new(),
            variables: HashMap::new(),
            gathers: false,
            samples: 0,
            motors: 32,
            refuses: None,
        };
        board.put(SERVO_READY, 0);
        board.put(SYSTEM_READY, 0);
        board
    }

    pub fn word(&self, at: u64) -> u16 {
        let mut bytes = [0; 2];
        self.memory.read_exact_at(&mut bytes, at).unwrap();
        u16::from_le_bytes(bytes)
    }

    pub fn put(&self, at: u64, word: u16) {
        self.memory.write_all_at(&word.to_le_bytes(), at).unwrap();
    }

    /// A 24-bit register, sign-extended to a long.
    fn put_short(&self, at: u64, value: i32) {
        self.memory.write_all_at(&value.to_le_bytes(), at).unwrap();
    }

    /// A 48-bit register is two longs, the Y half first.
    fn put_pair(&self, at: u64, value: i64) {
        self.put_short(at, (value << 40 >> 40) as i32);
        self.put_short(at + 4, (value >> 24) as i32);
    }

    pub fn mask(&self) -> u32 {
        u32::from(self.word(MASK)) | u32::from(self.word(MASK + 2)) << 16
    }

    /// While Host-Busy is set, PMAC skips the report. Else it clears Data-Ready, copies the motors of the mask, stores the timer and
    /// sets Data-Ready (Turbo User Manual p. 403).
    fn servo(&mut self) {
        self.cycles = (self.cycles + 1) & 0xFF_FFFF;
        if self.word(SERVO_HOST) & READY != 0 {
            return;
        }
        self.put(SERVO_READY, 0);
        for motor in (1..=self.motors).filter(|motor| self.mask() >> (motor - 1) & 1 != 0) {
            let block = 0x0074 + 0x30 * (motor as u64 - 1);
            self.put_pair(block, -3072 * motor);
            // Bit 23 of the first word of `?`: the motor is activated; bit 0 of the second: in position.
            self.put_short(block + 12, 0x80_0000);
            self.put_short(block + 16, 1);
            // Previous DAC, position bias, filtered velocity.
            self.put_short(block + 8, 0);
            self.put_pair(block + 20, 0);
            self.put_short(block + 28, 0);
            self.put_pair(block + 40, 3072 * 1000 * motor);
        }
        self.stamp(SERVO_TIMER, SERVO_READY);
    }

    fn stamp(&self, timer: u64, ready: u64) {
        self.put(timer, self.cycles as u16);
        self.put(ready, READY | (self.cycles >> 16) as u16);
    }

    /// "I50 = 0: ready = 0": global and coordinate systems 1 to count, whenever the last report was taken.
    fn background(&self) {
        let count = u64::from(self.word(SYSTEM_COUNT) & 0xFF);
        let waits = [SYSTEM_HOST, SYSTEM_READY].iter().any(|word| self.word(*word) & READY != 0);
        // Above 16: no host has written the number yet.
        if waits || count > 16 {
            return;
        }
        let [first, second] = self.global_status();
        self.put_short(0x0688, second as i32);
        self.put_short(0x068C, first as i32);
        for system in 0..count {
            // Bit 0 of the first word of `??`: a program runs; and the program lines that remain.
            self.put_short(0x069C + 0x80 * system + 20, 1);
            self.put_short(0x069C + 0x80 * system + 100, 7 + system as i32);
        }
        self.stamp(SYSTEM_TIMER, SYSTEM_READY);
    }
}

/// DPRAM ASCII.
impl Board {
    fn ascii(&mut self) {
        let character = self.word(CHARACTER) & 0xFF;
        if character != 0 && character != u16::from(GARBAGE) {
            self.characters.push(character as u8);
            self.put(CHARACTER, 0);
        }
        if self.word(LOADED) & 1 != 0 && self.responses.is_empty() {
            let mut bytes = [0; 160];
            self.memory.read_exact_at(&mut bytes, COMMAND).unwrap();
            self.put(LOADED, 0);
            match bytes.iter().position(|byte| *byte == 0) {
                Some(end) => {
                    self.part.extend(&bytes[..end]);
                    let line = String::from_utf8(std::mem::take(&mut self.part)).unwrap();
                    self.reply(&line);
                }
                // Without a NUL the host completes the line in a second load.
                None => {
                    self.part.extend(&bytes[..159]);
                    self.parts += 1;
                }
            }
        }
        if self.word(RESPONSE) != 0 {
            return;
        }
        if let Some((control, text)) = self.responses.pop_front() {
            let text: Vec<u8> = text.bytes().chain([0]).collect();
            self.memory.write_all_at(&text, RESPONSE_TEXT).unwrap();
            self.put(RESPONSE_COUNT, text.len() as u16);
            self.put(RESPONSE, control);
        }
    }

    /// "$0D more lines follow, $06 last line; bit 15 error, then bits 11-0 = error number as 3 BCD digits and no text".
    fn reply(&mut self, line: &str) {
        let Some(lines) = self.answer(line) else { return self.responses.push_back((0x8003, String::new())) };
        self.responses.extend(lines.into_iter().map(|text| (0x000D, text)));
        self.responses.push_back((0x0006, String::new()));
    }
}

impl Board {
    /// What the board answers to `line`; `None`: ERR003.
    fn answer(&mut self, line: &str) -> Option<Vec<String>> {
        if self.refuses.is_some_and(|start| line.starts_with(start)) {
            return None;
        }
        if let Some(longs) = line.strip_prefix("DEFINE GATHER ") {
            self.define_gather(longs.parse().ok()?);
            return Some(Vec::new());
        }
        if let Some((number, value)) = line.strip_prefix('I').and_then(|rest| rest.split_once('=')) {
            let value = value.strip_prefix('$').map_or(value.parse(), |hex| u32::from_str_radix(hex, 16));
            self.variables.insert(number.parse().ok()?, value.ok()?);
            return Some(Vec::new());
        }
        Some(match line {
            "TYPE" => vec!["TURBO2, X4".to_owned()],
            "VERSION" => vec!["1.947".to_owned()],
            "P1" => vec!["1.5".to_owned()],
            "P1=1.5" => Vec::new(),
            "GATHER" | "ENDGATHER" => {
                self.gathers = line == "GATHER";
                Vec::new()
            }
            "???" => {
                let [first, second] = self.global_status();
                vec![format!("{first:06X}{second:06X}")]
            }
            // It is negative while a buffer is open.
            _ if line.starts_with("SIZE") => {
                let size = if self.global[1] & 0b1111 << 17 == 0 { "41301" } else { "-41301" };
                line.split(' ').map(|_| size.to_owned()).collect()
            }
            _ if line.starts_with('Q') => vec![line.len().to_string()],
            _ => {
                let numbers = line.strip_prefix('I')?.split('I').map(|number| number.trim().parse().ok());
                let numbers: Vec<usize> = numbers.collect::<Option<_>>()?;
                numbers.into_iter().map(|number| self.variable(number).to_string()).collect()
            }
        })
    }

    /// The words of `???`. Bit 19 of the first one: the board gathers.
    fn global_status(&self) -> [u32; 2] {
        [self.global[0] | u32::from(self.gathers) << 19, self.global[1]]
    }

    fn variable(&self, number: usize) -> u32 {
        let set = self.variables.get(&number).copied();
        set.unwrap_or(match number {
            3 => 2,
            // Half a millisecond.
            10 => 4_194_304,
            47..=49 | 55 => 1,
            // Ixx07, Ixx08 and Ixx09 are 96.
            100..=3299 if number % 100 != 60 => 96,
            _ => 0,
        })
    }
}

/// Gathering (the vendor's accessory page, docs/evidence.md): `DEFINE GATHER n` puts the size in longs to 0x113C; 0x113E is the
/// offset of the next long; the buffer starts at 0x1140. Sources come in the order of their numbers, the low word of 48 bits first.
impl Board {
    fn define_gather(&mut self, longs: u32) {
        self.put(0x113C, longs as u16);
        self.put(0x113E, 0);
    }

    fn gather(&mut self) {
        let period = self.variable(5049);
        if !self.gathers || period == 0 || !self.cycles.is_multiple_of(period) {
            return;
        }
        self.samples += 1;
        let masks = u64::from(self.variable(5050)) | u64::from(self.variable(5051)) << 24;
        for source in (0..48).filter(|source| masks >> source & 1 != 0) {
            let code = self.variable(5001 + source);
            let index = u64::from(self.word(0x113E));
            let size = u64::from(self.word(0x113C));
            let long = |index: u64| 0x1140 + 4 * (index % size);
            // A register of 48 bits counts down in counts, one of 24 bits counts up.
            let longs = if code >> 20 == 8 {
                let value = -3072 * i64::from(self.samples);
                self.put_short(long(index), (value << 40 >> 40) as i32);
                self.put_short(long(index + 1), (value >> 24) as i32);
                2
            } else {
                self.put_short(long(index), self.samples as i32);
                1
            };
            self.put(0x113E, ((index + longs) % size) as u16);
        }
    }
}

/// Background variable read (Turbo User Manual pp. 407-410): bit 0 of 0x1044 is ready, 0x1046 the timer, 0x1048 the number of
/// entries, 1 to 128, 0x104A the table's start from $060450. An entry's Y word has address bits 15-0, its X word the kind in bits
/// 5-4 (0 Y, 1 L or D, 2 X) and address bits 18-16. The data follow the table.
impl Board {
    fn read_variables(&mut self) {
        let count = u64::from(self.word(0x1048));
        if !(1..=128).contains(&count) || self.word(0x1044) & 1 != 0 || self.variable(55) != 1 {
            return;
        }
        let table = 0x1140 + 4 * u64::from(self.word(0x104A));
        let mut data = table + 4 * count;
        for entry in 0..count {
            let [address, kind] = [0, 2].map(|half| self.word(table + 4 * entry + half));
            self.put_short(data, i32::from(address) + 0x1_0000 * i32::from(kind));
            data += 4;
            if kind >> 4 & 0b11 == 1 {
                self.put_short(data, 0);
                data += 4;
            }
        }
        self.put(0x1046, self.cycles as u16);
        self.put(0x1044, self.word(0x1044) | 1);
    }
}

/// A daemon on a board; time passes in [`Site::cycles`] alone.
pub(super) struct Site {
    pub site: VirtualSite,
    board: Option<Board>,
}

impl Site {
    pub fn new(config: &str) -> Self {
        Self::with_board(&format!("ask_board = false\ni10 = 4194304\ni19 = 1\n{config}"), |_| ())
    }

    pub fn with_board(config: &str, change: impl FnOnce(&mut Board)) -> Self {
        let site = VirtualSite::new();
        site.hold();
        let mut board = Board::new(&site);
        change(&mut board);
        let config = format!("family = \"turbo2\"\n{config}");
        let config = site.file("pmacd.toml", &config);
        let memory = format!("file:{}", site.path("dpram").display());
        site.start_daemon_on(&memory, &["--config", &config]);
        Self { site, board: Some(board) }
    }

    pub fn board(&mut self) -> &mut Board {
        self.board.as_mut().unwrap()
    }

    /// So many servo cycles, a background cycle every 8 of them.
    pub fn cycles(&mut self, cycles: u32) {
        self.step(cycles, |_| false);
    }

    fn step(&mut self, cycles: u32, waits: impl Fn(&World) -> bool + Send + 'static) {
        let mut board = self.board.take().unwrap();
        self.board = Some(self.site.with_world(move |world| {
            for _ in 0..cycles {
                if waits(world) {
                    break;
                }
                board.servo();
                board.gather();
                board.ascii();
                if board.cycles.is_multiple_of(8) {
                    board.background();
                    board.read_variables();
                }
                world.step();
            }
            board
        }));
    }

    /// What `pmacctl` says while time passes.
    pub fn running(&mut self, command: &[&str]) -> (i32, String, String) {
        let mut child =
            self.site.command(command).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        while child.try_wait().unwrap().is_none() {
            // Time waits for a client that has to say that it is still there.
            self.step(20, World::is_lease_over);
            std::thread::sleep(Duration::from_millis(1));
        }
        let output = child.wait_with_output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    pub fn json(&self, command: &[&str]) -> serde_json::Value {
        self.site.run(&[command, &["--json"]].concat()).json()
    }

    pub fn count(&self, counter: Counter) -> u64 {
        self.site.attach().counter(counter)
    }
}
