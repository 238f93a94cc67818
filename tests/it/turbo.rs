//! A Turbo PMAC2's DPRAM in a file, with the daemon on it. What the board does is played by hand, from the sentences that
//! FACTS-TURBO collects in its sections 4 and 5.

use std::collections::VecDeque;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::process::Stdio;
use std::time::Duration;

use pmac_dpram::map::TURBO2;
use pmac_dpram::segment::{Counter, RegionId, Sample};
use serde_json::json;

use crate::support::VirtualSite;

/// What nobody wrote.
const GARBAGE: u8 = 0x5A;
/// Section 4: "host 0x006A bit 15 host busy; 0x006C timer low; 0x006E bits 0-7 timer high, bit 15 data ready; 0x0070 mask".
const SERVO_HOST: u64 = 0x006A;
const SERVO_TIMER: u64 = 0x006C;
const SERVO_READY: u64 = 0x006E;
const MASK: u64 = 0x0070;
/// Section 5: "0x0674 highest C.S. reported, 0x0676 bit 15 host busy, 0x0678/0x067A as in section 4".
const SYSTEM_COUNT: u64 = 0x0674;
const SYSTEM_HOST: u64 = 0x0676;
const SYSTEM_TIMER: u64 = 0x0678;
const SYSTEM_READY: u64 = 0x067A;
const READY: u16 = 1 << 15;
/// Section 6: "0x0E9C bit 0 command loaded, 0x0E9E control character, 0x0EA0 command, 0x0F40 response control word,
/// 0x0F42 number of characters + 1, 0x0F44 response line".
const LOADED: u64 = 0x0E9C;
const CHARACTER: u64 = 0x0E9E;
const COMMAND: u64 = 0x0EA0;
const RESPONSE: u64 = 0x0F40;
const RESPONSE_COUNT: u64 = 0x0F42;
const RESPONSE_TEXT: u64 = 0x0F44;

/// The board's half. It counts servo cycles of half a millisecond.
struct Board {
    memory: File,
    cycles: u32,
    /// The global status words of `???`, in their order.
    global: [u32; 2],
    /// The first part of a line.
    part: Vec<u8>,
    /// How many lines came in two parts.
    parts: usize,
    /// The control characters it has taken.
    characters: Vec<u8>,
    /// Responses to come: control word and text.
    responses: VecDeque<(u16, String)>,
    /// The last line of a reply is marked itself (section 6: "make the other form a switch").
    marks_last: bool,
}

impl Board {
    fn new(site: &VirtualSite) -> Self {
        let path = site.path("dpram");
        std::fs::write(&path, vec![GARBAGE; TURBO2.length as usize]).unwrap();
        let memory = File::options().read(true).write(true).open(path).unwrap();
        let board = Self {
            memory,
            cycles: 0x12_FF00,
            global: [0, 0],
            part: Vec::new(),
            parts: 0,
            characters: Vec::new(),
            responses: VecDeque::new(),
            marks_last: false,
        };
        board.put(SERVO_READY, 0);
        board.put(SYSTEM_READY, 0);
        board
    }

    fn word(&self, at: u64) -> u16 {
        let mut bytes = [0; 2];
        self.memory.read_exact_at(&mut bytes, at).unwrap();
        u16::from_le_bytes(bytes)
    }

    fn put(&self, at: u64, word: u16) {
        self.memory.write_all_at(&word.to_le_bytes(), at).unwrap();
    }

    /// A 24-bit register, sign-extended to a long.
    fn put_short(&self, at: u64, value: i32) {
        self.memory.write_all_at(&value.to_le_bytes(), at).unwrap();
    }

    /// A 48-bit register: "two such longs, low (Y) first".
    fn put_pair(&self, at: u64, value: i64) {
        self.put_short(at, (value << 40 >> 40) as i32);
        self.put_short(at + 4, (value >> 24) as i32);
    }

    fn mask(&self) -> u32 {
        u32::from(self.word(MASK)) | u32::from(self.word(MASK + 2)) << 16
    }

    /// "if host busy = 1 skip this time; else ready := 0, copy masked motors, store 24-bit timer, ready := 1".
    fn servo(&mut self) {
        self.cycles = (self.cycles + 1) & 0xFF_FFFF;
        if self.word(SERVO_HOST) & READY != 0 {
            return;
        }
        self.put(SERVO_READY, 0);
        for motor in (1..=32).filter(|motor| self.mask() >> (motor - 1) & 1 != 0) {
            let block = 0x0074 + 0x30 * (motor as u64 - 1);
            self.put_pair(block, -3072 * motor);
            // "motor activated", bit 23 of the first word of `?`, and "in position", bit 0 of the second.
            self.put_short(block + 12, 0x80_0000);
            self.put_short(block + 16, 1);
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
        // "highest C.S. reported (host writes, 0-16)": nobody has written it yet.
        if waits || count > 16 {
            return;
        }
        self.put_short(0x0688, self.global[1] as i32);
        self.put_short(0x068C, self.global[0] as i32);
        for system in 0..count {
            // The first word of `??`: "0 running program"; the program lines that remain.
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
                // "a line may be completed in a second load if no NUL was in the first".
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
        let Some(lines) = answer(line) else { return self.responses.push_back((0x8003, String::new())) };
        self.responses.extend(lines.into_iter().map(|text| (0x000D, text)));
        match self.responses.back_mut().filter(|_| self.marks_last) {
            Some((control, _)) => *control = 0x0006,
            None => self.responses.push_back((0x0006, String::new())),
        }
    }
}

/// What the board answers to `line`; `None`: ERR003.
fn answer(line: &str) -> Option<Vec<String>> {
    let variable = |number: &str| match number.trim().parse::<usize>().ok()? {
        // I3, I10 (half a millisecond), the enables; Ixx07, Ixx08 and Ixx09 are 96, Ixx60 is 0.
        3 => Some(2),
        10 => Some(4_194_304),
        47..=49 => Some(1),
        number @ 100.. => Some(if number % 100 == 60 { 0 } else { 96 }),
        _ => Some(0),
    };
    Some(match line {
        "TYPE" => vec!["TURBO2, X4".to_owned()],
        "VERSION" => vec!["1.947".to_owned()],
        "P1" => vec!["1.5".to_owned()],
        "P1=1.5" => Vec::new(),
        _ if line.starts_with("SIZE") => line.split(' ').map(|_| "41301".to_owned()).collect(),
        _ if line.starts_with("Q") => vec![line.len().to_string()],
        _ => {
            let values: Option<Vec<_>> = line.strip_prefix('I')?.split('I').map(variable).collect();
            values?.iter().map(ToString::to_string).collect()
        }
    })
}

/// A daemon on a board; time passes in [`Site::cycles`] alone.
struct Site {
    site: VirtualSite,
    board: Option<Board>,
}

impl Site {
    fn new(config: &str) -> Self {
        Self::with_board(&format!("ask_board = false\ni10 = 4194304\ni19 = 1\n{config}"), |_| ())
    }

    fn with_board(config: &str, change: impl FnOnce(&mut Board)) -> Self {
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

    fn board(&mut self) -> &mut Board {
        self.board.as_mut().unwrap()
    }

    /// So many servo cycles, a background cycle every 8 of them.
    fn cycles(&mut self, cycles: u32) {
        let mut board = self.board.take().unwrap();
        self.board = Some(self.site.with_world(move |world| {
            for _ in 0..cycles {
                board.servo();
                board.ascii();
                if board.cycles.is_multiple_of(8) {
                    board.background();
                }
                world.step();
            }
            board
        }));
    }

    /// What `pmacctl` says while time passes.
    fn running(&mut self, command: &[&str]) -> (i32, String, String) {
        let mut child =
            self.site.command(command).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        while child.try_wait().unwrap().is_none() {
            self.cycles(20);
            std::thread::sleep(Duration::from_millis(1));
        }
        let output = child.wait_with_output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    fn json(&self, command: &[&str]) -> serde_json::Value {
        self.site.run(&[command, &["--json"]].concat()).json()
    }

    fn count(&self, counter: Counter) -> u64 {
        self.site.attach().counter(counter)
    }
}

fn list(motors: impl IntoIterator<Item = usize>) -> String {
    format!("{:?}", motors.into_iter().collect::<Vec<_>>())
}

#[test]
fn c1_the_motors_of_a_turbo_board_reach_pmacctl() {
    let choices = [vec![1], vec![2, 17, 32], (1..=8).collect(), (1..=32).collect::<Vec<_>>()];
    for motors in choices {
        for reading in ["optimistic", "handshake"] {
            let chosen = list(motors.iter().copied());
            let mut site = Site::new(&format!(
                "functions = [\"servo\"]\nservo_reading = \"{reading}\"\n[servo]\nmotors = {chosen}\n"
            ));
            site.cycles(400);
            let mask = motors.iter().fold(0, |mask, motor| mask | 1_u32 << (motor - 1));
            assert_eq!(site.board().mask(), mask, "the host chooses: {chosen}");
            let shown = site.json(&["motors"]);
            assert_eq!(shown["servo"]["fresh"], true, "{shown}");
            let rows = shown["motors"].as_array().unwrap();
            assert_eq!(rows.len(), motors.len(), "{shown}");
            for (row, motor) in rows.iter().zip(&motors) {
                let raw = |name: &str| row[name]["raw"].as_i64();
                assert_eq!(row["motor"], json!(motor));
                assert_eq!(raw("actual_position"), Some(3_072_000 * *motor as i64), "{row}");
                assert_eq!(raw("following_error"), Some(-3072 * *motor as i64), "{row}");
                assert_eq!(row.get("commanded_position"), None, "section 2: Turbo has none");
            }
            let status = site.json(&["status"]);
            assert_eq!(status["board"]["family"], "turbo2");
            assert_eq!(status["condition"], "live", "{status}");
            assert_eq!(status["board"]["reported_motors"], json!(motors.iter().max()));
            assert_eq!(status["socket"]["functions"], json!(["servo"]));
            assert_eq!((site.count(Counter::Missed), site.count(Counter::Lost)), (0, 0), "{reading}");
        }
    }
}

#[test]
fn c1_words_of_motors_outside_the_mask_are_neither_read_nor_written() {
    let mut site = Site::new("functions = [\"servo\"]\n[servo]\nmotors = [3]\n");
    site.cycles(400);
    let segment = site.site.attach();
    let mut sample = Sample::new();
    segment.latest(RegionId::Servo, &mut sample).unwrap().unwrap();
    // The image begins at 0x0068 and ends with motor 3. Unread words are 0 there, and the board's are garbage.
    let words = sample.words();
    let first = (0x0074 - 0x0068) / 2;
    assert_eq!(words.len(), first + 3 * 24);
    assert!(words[first..first + 2 * 24].iter().all(|word| *word == 0), "{words:?}");
    assert!(words[first + 2 * 24..].iter().any(|word| *word != 0));
    drop(segment);
    site.site.stop_daemon();
    let bytes = std::fs::read(site.site.path("dpram")).unwrap();
    let changed = (0..bytes.len()).step_by(2).filter(|at| bytes[*at..at + 2] != [GARBAGE; 2]);
    let changed: Vec<_> = changed.filter(|at| !(0x00D4..0x0104).contains(at)).collect();
    // Host busy, timer, ready, mask. The test itself has cleared the background report's flag.
    assert_eq!(changed, [0x006A, 0x006C, 0x006E, 0x0070, 0x0072, 0x067A]);
    assert_eq!(site.board().word(SERVO_HOST), 0, "it is left as a board needs it");
}

#[test]
fn c5_a_turbo_update_costs_the_words_of_the_masked_motors() {
    for count in [1, 8, 32] {
        for (reading, polls) in [("optimistic", 6), ("handshake", 10)] {
            let chosen = list(1..=count);
            let mut site = Site::new(&format!(
                "functions = [\"servo\"]\nservo_reading = \"{reading}\"\n[servo]\nmotors = {chosen}\n"
            ));
            site.cycles(1000);
            let counts =
                |site: &Site| [Counter::Updates, Counter::ServoAccesses].map(|what| site.count(what));
            let before = counts(&site);
            site.cycles(4000);
            let after = counts(&site);
            let [updates, accesses] = [0, 1].map(|index| after[index] - before[index]);
            assert_eq!(updates, 4000, "none is missed: {count} motors, {reading}");
            // 24 words a motor, and what hands them over: flag and timer before and after, the flag cleared, one idle poll.
            let needed = updates * (24 * count as u64 + polls);
            assert!(accesses * 100 <= needed * 105, "{count} motors, {reading}: {accesses} of {needed}");
            assert!(accesses >= updates * 24 * count as u64);
        }
    }
}

#[test]
fn c1_the_coordinate_systems_of_a_turbo_board_reach_pmacctl() {
    let mut site = Site::new("functions = [\"servo\", \"background\"]\n[background]\nmotors = [1, 9, 16]\n");
    site.cycles(1000);
    assert_eq!(site.board().word(SYSTEM_COUNT), 16, "the highest that is read");
    let shown = site.json(&["coordinates"]);
    let rows = shown["coordinate_systems"].as_array().unwrap_or_else(|| panic!("{shown}"));
    let numbers: Vec<_> = rows.iter().map(|row| row["coordinate_system"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 9, 16], "{shown}");
    for (row, number) in rows.iter().zip(numbers) {
        assert_eq!(row["lines_remaining"], json!(6 + number), "{row}");
    }
    // `???`: bit 19 of the first word, data are gathered; bit 19 of the second one, a motion buffer is open.
    let enabled = |site: &Site| site.json(&["status"])["socket"]["enabled"].clone();
    assert_eq!(enabled(&site), json!(["servo", "background"]));
    site.board().global = [1 << 19, 0];
    site.cycles(400);
    assert_eq!(enabled(&site), json!(["servo", "background", "gather"]));
}

#[test]
fn c1_a_function_that_is_not_there_yet_is_refused_by_name() {
    let mut site = Site::new("");
    site.cycles(400);
    let status = site.json(&["status"]);
    assert_eq!(status["socket"]["functions"], json!(["ascii", "servo", "background"]));
    let (code, stdout, _) = site.site.pmacctl(&["status"]);
    assert!(code != 2 && stdout.contains("functions       ascii servo background\n"), "{stdout}");
    for (command, name) in
        [(&["panel", "jog+", "1"][..], "panel"), (&["variable", "watch", "X:$78000"], "variables")]
    {
        let (code, _, stderr) = site.site.pmacctl(command);
        let text = format!(
            "pmacd cannot use the function `{name}` on a Turbo PMAC2 yet; it can use ascii, servo, background"
        );
        assert!(code != 0 && stderr.contains(&text), "{command:?}: {stderr}");
    }
    let (_, stdout, _) = site.site.pmacctl(&["doctor"]);
    assert!(
        stdout.contains("pmacd cannot use panel, variables, rotary, gather on a Turbo PMAC2 yet"),
        "{stdout}"
    );
}

#[test]
fn c1_command_lines_go_through_a_turbo_boards_dpram() {
    for marks_last in [false, true] {
        let mut site = Site::with_board("", |board| board.marks_last = marks_last);
        site.cycles(8000);
        assert_eq!(site.board().parts, 0, "questions of our own fit one part");
        let status = site.json(&["status"]);
        assert_eq!(status["board"]["type"], "TURBO2, X4", "{status}");
        assert_eq!(status["board"]["firmware"], "1.947");
        // Scales of all 32 motors: position = raw / (Ixx08*32).
        let shown = site.json(&["motors"]);
        assert_eq!(shown["motors"][31]["actual_position"]["value"], json!(32000.0), "{shown}");
        assert_eq!(site.running(&["send", "P1"]), (0, "1.5\n".to_owned(), String::new()), "{marks_last}");
        assert_eq!(site.running(&["send", "P1=1.5"]), (0, String::new(), String::new()));
        let (code, _, stderr) = site.running(&["send", "HELLO"]);
        assert!(code == 1 && stderr.starts_with("ERR003: "), "{code} {stderr}");
        // Section 6: what does not fit 159 characters is completed in a second load.
        let long = format!("Q{}", "1".repeat(199));
        assert_eq!(site.running(&["send", &long]).1, "200\n");
        assert_eq!(site.board().parts, 1);
        let (code, ..) = site.running(&["kill"]);
        assert_eq!((code, site.board().characters.last()), (0, Some(&0x0B)));
    }
}

#[test]
fn c1_a_program_buffer_that_the_background_report_shows_open_takes_no_line_of_others() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    // Section 12.7: "20 binary rotary open, 19 motion buffer open, 18 ASCII rotary open, 17 PLC buffer open".
    for bit in 17..=20 {
        site.board().global[1] = 1 << bit;
        site.cycles(400);
        let (code, _, stderr) = site.running(&["send", "P1"]);
        assert!(code != 0 && stderr.contains("opened by somebody else"), "bit {bit}: {code} {stderr}");
        // Bits 16 and 21 say other things.
        site.board().global[1] = 1 << 16 | 1 << 21;
        site.cycles(400);
        assert_eq!(site.running(&["send", "P1"]).1, "1.5\n", "bit {bit}");
    }
}

#[test]
fn c1_a_message_of_a_program_is_told_without_its_mark() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    let mut messages = site.site.connection().messages().unwrap();
    site.cycles(100);
    // Section 3: I64=1 puts STX before it; section 6: bits 9-8 = 2 is a program's SEND.
    site.board().responses.push_back((0x020D, "\u{2}HELLO".to_owned()));
    site.cycles(400);
    let message = messages.next_within(Duration::from_secs(10)).unwrap().expect("a message");
    assert_eq!(message.text, "HELLO");
}
