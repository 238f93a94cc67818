//! A published segment with known contents, and programs run on it.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use pmac_dpram::format::{fixed48, float48, int24, split32};
use pmac_dpram::map::Selection;
use pmac_dpram::segment::{
    BlockPlace, CreateOptions, Identity, Publisher, RegionId, RegionSpec, RegionState, SegmentName, Stamp,
    State, monotonic_ns,
};

/// No data become stale in a test unless it says so.
const LONG_NS: u64 = 3_600_000_000_000;
/// Nobody calls `beat` here; a test that needs a stopped heartbeat calls it with time 0.
const HEARTBEAT_NS: u64 = 60_000_000_000;
const SERVO_START: usize = 0x24;
const SERVO_WORDS: usize = (0x228 - 0x24) / 2;
const BACKGROUND_START: usize = 0x228;
const BACKGROUND_WORDS: usize = (0x62C - 0x228) / 2;

/// A segment in /dev/shm under its own name.
pub struct Rig {
    pub name: String,
    pub publisher: Publisher,
    pub servo: Vec<u16>,
    pub background: Vec<u16>,
}

fn put(words: &mut [u16], start: usize, offset: usize, value: u32) {
    words[(offset - start) / 2..][..2].copy_from_slice(&split32(value));
}

fn put_fixed(words: &mut [u16], start: usize, offset: usize, value: i64) {
    let [y, x] = fixed48::encode(value);
    put(words, start, offset, y);
    put(words, start, offset + 4, x);
}

impl Rig {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self::named(&format!("pmac-test-cli-{}-{number}", std::process::id()))
    }

    pub fn named(name: &str) -> Self {
        Self::at(Path::new(pmac_dpram::segment::DIRECTORY), name)
    }

    pub fn at(directory: &Path, name: &str) -> Self {
        Self::selecting(directory, name, Vec::new())
    }

    /// As [`Rig::at`], for a daemon that reads only part of a region.
    pub fn selecting(directory: &Path, name: &str, selections: Vec<(RegionId, Selection)>) -> Self {
        let region = |id, slots, payload_bytes: usize, first_host_offset: usize, stride| RegionSpec {
            id,
            slots,
            payload_bytes: payload_bytes as u32,
            first_host_offset: first_host_offset as u32,
            blocks: BlockPlace { start: 36, stride, count: if stride == 0 { 0 } else { 8 } },
            period_hint_ns: 442_713,
            stale_after_ns: LONG_NS,
        };
        let mut options = CreateOptions::new(
            SegmentName::new(name).unwrap(),
            vec![
                region(RegionId::Servo, 64, 2 * SERVO_WORDS, SERVO_START, 60),
                region(RegionId::Background, 4, 2 * BACKGROUND_WORDS, BACKGROUND_START, 124),
                region(RegionId::Board, 4, pmac_dpram::segment::identity::BYTES, 0, 0),
            ],
        );
        options.heartbeat_limit_ns = HEARTBEAT_NS;
        options.selections = selections;
        directory.clone_into(&mut options.directory);
        let mut publisher = Publisher::create(&options).unwrap();
        let mut identity = Identity {
            family: Some(1),
            motors: Some(8),
            i10: Some(3_713_707),
            motor_mask: Some(0b111),
            firmware: Some("1.16D".into()),
            board_type: Some("PMAC1".into()),
            servo_period_ps: Some(442_708_000),
            ..Identity::default()
        };
        identity.ix08[..2].fill(Some(96));
        identity.ix09[..2].fill(Some(96));
        identity.ix60[..2].fill(Some(0));
        let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 0, valid: true };
        publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
        let mut rig = Self {
            name: name.to_owned(),
            publisher,
            servo: vec![0; SERVO_WORDS],
            background: vec![0; BACKGROUND_WORDS],
        };
        rig.fill();
        rig
    }

    /// Three motors: one in position, one that moves, one without scales whose loop is open.
    fn fill(&mut self) {
        let servo = &mut self.servo;
        servo[1] = 0x1234;
        for (motor, commanded, actual, velocity, status) in [
            (0, 3072 * 1000, 3072 * 1000 - 768, 0_i32, 0x81_2000),
            (1, -3072 * 25, -3072 * 24, -1536, 0x80_0000),
            (2, 77, -77, 5, 0x84_0000),
        ] {
            let block = 0x48 + 0x3C * motor;
            put_fixed(servo, SERVO_START, block, commanded);
            put_fixed(servo, SERVO_START, block + 8, actual);
            put(servo, SERVO_START, block + 0x24, int24::extend(status));
            put(servo, SERVO_START, block + 0x28, int24::extend(velocity as u32 & int24::MASK));
        }
        let background = &mut self.background;
        background[0] = 1;
        put(background, BACKGROUND_START, 0x24C + 0x10, int24::extend(0x80_4401));
        // Coordinate system 1 runs a program: X12.5, a circle, 3 lines left.
        put(background, BACKGROUND_START, 0x24C + 0x18, 1);
        put(background, BACKGROUND_START, 0x24C + 0x64, int24::extend(0x02_0001));
        put(background, BACKGROUND_START, 0x24C + 0x68, 3);
        let [y, x] = float48::encode(12.5);
        let target = 0x24C + 0x1C + 8 * 6;
        put(background, BACKGROUND_START, target, y);
        put(background, BACKGROUND_START, target + 4, x);
    }

    /// Publishes everything, and sets the state to live.
    pub fn live(mut self) -> Self {
        self.publish();
        self.publisher.set_region_state(RegionId::Servo, RegionState::Live);
        self.publisher.set_region_state(RegionId::Background, RegionState::Live);
        self.publisher.set_state(State::Live);
        self
    }

    pub fn publish(&mut self) {
        let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 0x11234, valid: true };
        self.publisher.publish(RegionId::Servo, stamp, &self.servo);
        self.publisher.publish(RegionId::Background, stamp, &self.background);
    }

    /// A DPRAM image with the same contents.
    pub fn image(&self) -> Vec<u8> {
        let mut words = vec![0_u16; 0x2000];
        words[SERVO_START / 2..][..SERVO_WORDS].copy_from_slice(&self.servo);
        words[BACKGROUND_START / 2..][..BACKGROUND_WORDS].copy_from_slice(&self.background);
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    pub fn run(&self, line: &str) -> Ran {
        pmacctl(&format!("--name {} {line}", self.name))
    }
}

/// A program's output.
#[derive(Debug, PartialEq, Eq)]
pub struct Ran {
    pub stdout: String,
    pub stderr: String,
    pub code: Option<i32>,
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        Self {
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
            code: output.status.code(),
        }
    }
}

impl Ran {
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }
}

/// Runs `pmacctl` with the words of `line` as arguments.
pub fn pmacctl(line: &str) -> Ran {
    pmacctl_with(line.split_whitespace())
}

pub fn pmacctl_with<'a>(args: impl IntoIterator<Item = &'a str>) -> Ran {
    command().args(args).output().unwrap().into()
}

pub fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pmacctl"));
    command.stdin(Stdio::null());
    command
}

/// A terminal's two ends. They close on exec, so that no process of another test keeps them open.
pub fn pty(size: Option<&nix::pty::Winsize>) -> nix::pty::OpenptyResult {
    use nix::fcntl::{FcntlArg, FdFlag, fcntl};
    let pty = nix::pty::openpty(size, None).unwrap();
    for end in [&pty.master, &pty.slave] {
        fcntl(end, FcntlArg::F_SETFD(FdFlag::FD_CLOEXEC)).unwrap();
    }
    pty
}
