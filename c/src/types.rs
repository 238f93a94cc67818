//! The structs that C sees. Fields of 8 bytes stand on multiples of 8, so that each struct is the same on every host.
//!
//! A function that fills or reads a struct takes its size from the caller: a later library may have more fields, and
//! programs of today then go on with theirs.

use std::ffi::c_char;

use crate::failure::Failure;

/// Why a call failed. This struct never grows.
#[repr(C)]
pub struct Error {
    /// A `pmac_status`.
    pub status: i32,
    /// The number of the board's `ERRnnn`; 0: none.
    pub code: i32,
    /// What failed, and where; cut to the room that it has here.
    pub text: [c_char; 1792],
    /// What the user can do.
    pub cure: [c_char; 248],
}

impl Error {
    /// The error of a call that `failure` ended.
    pub fn of(failure: &Failure) -> Self {
        Self {
            status: failure.status as i32,
            code: failure.code.into(),
            text: chars(&failure.text),
            cure: chars(failure.status.cure()),
        }
    }

    /// No error.
    pub const NONE: Self = Self { status: 0, code: 0, text: [0; 1792], cure: [0; 248] };
}

/// The board, as it has told the daemon. A text is empty, a number 0 and a period NaN if the board has not told it.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Identity {
    /// `pmac`, `pmac2`, `turbo` or `turbo2`.
    pub family: [c_char; 16],
    /// The board's answer to `TYPE`.
    pub board_type: [c_char; 128],
    /// Firmware version, as `1.16D`.
    pub firmware: [c_char; 32],
    /// Servo period in nanoseconds.
    pub servo_period_ns: f64,
    /// Servo cycles from one update to the next.
    pub servo_report_cycles: u32,
    /// How many motors the board has.
    pub motors: u32,
    /// How many coordinate systems the board has.
    pub coordinate_systems: u32,
    /// 1: the daemon replays a recording; nothing moves.
    pub replay: u32,
}

/// A motor's name and unit in the daemon's configuration.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct MotorLabel {
    /// The name; empty without one.
    pub name: [c_char; 32],
    /// The unit's name, as `deg`; empty without one.
    pub unit: [c_char; 32],
    /// Counts in one unit, negative if the unit grows as the counts fall; 0 without a unit.
    pub counts_per_unit: f64,
}

/// A name that the daemon's configuration gives to words of the site's own programs.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Word {
    /// The name.
    pub name: [c_char; 64],
    /// The unit; empty without one.
    pub unit: [c_char; 32],
    /// How many values the name has.
    pub count: u32,
    /// 0.
    pub reserved: u32,
}

/// The moment of a snapshot or an update.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Moment {
    /// The number of the servo update, from 1; it begins anew with each daemon.
    pub sequence: u64,
    /// When the daemon read the update: nanoseconds of CLOCK_MONOTONIC.
    pub time_ns: u64,
    /// The same in nanoseconds since 1970.
    pub realtime_ns: i64,
    /// The update's age when the library took it, in nanoseconds.
    pub age_ns: u64,
    /// The board's servo counter, in servo cycles.
    pub servo_timer: u64,
    /// In an update: updates before it that the daemon did not read in time.
    pub missed: u64,
    /// In an update: updates before it that the daemon overwrote before this program took them.
    pub lost: u64,
    /// In an update: how long the board or the daemon paused before it, in nanoseconds; no count has updates of that time.
    pub pause_ns: u64,
    /// The activated motors; bit 0 is motor 1.
    pub activated_motors: u32,
    /// The reported motors; bit 0 is motor 1.
    pub motors: u32,
    /// The reported coordinate systems; bit 0 is coordinate system 1. An update has none.
    pub systems: u32,
    /// A `pmac_stale` of the servo data.
    pub stale: u32,
    /// A `pmac_stale` of the background data; 0 also without such data.
    pub background_stale: u32,
    /// 0.
    pub reserved: u32,
}

/// One motor. Positions are in counts, velocities in counts a second. A number is NaN if the board does not report it,
/// or its scale is not known.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Motor {
    /// The motor's number, from 1.
    pub number: u32,
    /// The bits `PMAC_KNOWN_...` of the words that are known.
    pub known: u32,
    /// The two words of `?`.
    pub status: [u32; 2],
    /// The number of the motor's coordinate system; 0 if the board does not report it.
    pub coordinate_system: u32,
    /// Whether the motor is activated (Ix00).
    pub activated: u32,
    /// Actual position.
    pub position: f64,
    /// Commanded position.
    pub commanded_position: f64,
    /// Following error.
    pub following_error: f64,
    /// Velocity.
    pub velocity: f64,
    /// Position of the master that the motor follows.
    pub master_position: f64,
    /// The end of the motor's present move (background report).
    pub target_position: f64,
    /// Actual position as the board holds it, in 1/(Ix08*32) count.
    pub raw_position: i64,
}

/// One coordinate system, of the background report.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct System {
    /// Its number, from 1.
    pub number: u32,
    /// The bits `PMAC_KNOWN_...` of the words that are known.
    pub known: u32,
    /// The words of `??`: status, program status, and on Turbo boards the third word.
    pub status: [u32; 3],
    /// Program lines that the board has still to execute, as `PR`.
    pub lines_remaining: i32,
    /// The targets of the axes A, B, C, U, V, W, X, Y, Z, in user units; NaN if the board does not report one.
    pub axis_targets: [f64; 9],
}

/// A text that a program of the board has sent.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Message {
    /// When the daemon read the text: nanoseconds of CLOCK_MONOTONIC.
    pub time_ns: u64,
    /// Texts that the daemon dropped before this one, because this program read too slowly.
    pub lost: u64,
    /// 1: the response to a `CMD"..."`; 2: a `SEND"..."`; 3: a `CMD"..."` that the board refused, the text is the error.
    pub kind: u32,
    /// 0.
    pub reserved: u32,
    /// The text.
    pub text: [c_char; 512],
}

/// The size of a gather.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct GatheredInfo {
    /// Samples.
    pub rows: u64,
    /// Values in each.
    pub columns: u64,
    /// Samples that the board or the daemon overwrote before this program read them. Exact.
    pub lost: u64,
}

/// How to stream a program. Set the whole struct to 0 first.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct RotaryOptions {
    /// The coordinate system that executes the program, from 1.
    pub coordinate_system: u32,
    /// Not 0: define the board's own rotary buffer first, with so many words.
    pub define_longs: u32,
    /// The bits `PMAC_ROTARY_...`.
    pub flags: u32,
    /// How long the board may take no lines, in milliseconds; 0: 60 s.
    pub timeout_ms: u32,
}

/// Start the program when its first lines are there.
pub const ROTARY_RUN: u32 = 1;
/// Clear lines that an earlier program has left in the board's rotary buffer.
pub const ROTARY_CLEAR: u32 = 2;
/// Run such lines first.
pub const ROTARY_CONTINUE: u32 = 4;

/// A program that the board has taken whole.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Streamed {
    /// Lines.
    pub lines: u64,
    /// Commands in them.
    pub commands: u64,
    /// How often the daemon found the buffer empty though more lines were to follow.
    pub underruns: u64,
    /// Lines that an earlier program had left in the board's rotary buffer.
    pub found_lines: u64,
}

/// The data of a snapshot may be old; its moment tells why.
pub const STALE_OK: u32 = 1;
/// Also sends a line or control character that ends command lines for everybody, or others' work (`^Z`, `$$$`, `SAVE`).
pub const CONFIRMED: u32 = 1;

/// The first status word is known.
pub const KNOWN_STATUS_1: u32 = 1;
/// The second status word is known.
pub const KNOWN_STATUS_2: u32 = 2;
/// The third status word is known.
pub const KNOWN_STATUS_3: u32 = 4;
/// `raw_position` is known.
pub const KNOWN_RAW_POSITION: u32 = 8;
/// `lines_remaining` is known.
pub const KNOWN_LINES_REMAINING: u32 = 16;

/// Why data are not live.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stale {
    /// The data are live.
    Live = 0,
    /// The daemon has stopped or was killed.
    DaemonGone = 1,
    /// The daemon's heartbeat has stopped.
    DaemonStopped = 2,
    /// The daemon's times are of another clock than this program's.
    OtherClock = 3,
    /// The daemon is identifying the board.
    Starting = 4,
    /// The board does not answer.
    BoardSilent = 5,
    /// The daemon does not mirror these data.
    Off = 6,
    /// The board has stopped updating these data.
    NoUpdates = 7,
    /// The sample is not whole.
    NotWhole = 8,
}

/// As much of `text` as fits with a NUL behind it, without splitting a character. A NUL in the text becomes a space.
pub fn chars<const N: usize>(text: &str) -> [c_char; N] {
    let mut room = [0; N];
    let end = (0..N.min(text.len() + 1)).rfind(|end| text.is_char_boundary(*end)).unwrap_or(0);
    for (place, byte) in room.iter_mut().zip(text.bytes().take(end)) {
        *place = (if byte == 0 { b' ' } else { byte }).cast_signed() as c_char;
    }
    room
}
