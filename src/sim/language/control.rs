//! Control characters that are commands: they act at once, without a line end, and do not affect the line being entered
//! (Software Reference, "On-line commands", CONTROL-A and following).
//!
//! ^W takes a command line from the DPRAM. I47 is its start address. The line is packed as in the DPRAM ASCII port (two
//! characters per 16-bit word, the first character low, Y word before X word) and ends at a NUL or carriage return; the
//! port that sent the ^W gets the answer. ^E and ^G are binary reports of old firmware: ^E the registers that I20 to
//! I44 point to, ^G both words of the global status, each 24-bit word as three bytes, high byte first. (No manual seen
//! gives their form, or the packing for ^W.)

use crate::map::Generation;
use crate::sim::board::Board;
use crate::sim::board::number::tenths;
use crate::sim::language::reply::{LONGEST_LINE, Reply, status_text};
use crate::sim::program::Programs;
use crate::sim::program::item::PlcSwitch;
use crate::sim::program::store::Open;

/// The code of ^`letter` (upper case).
pub const fn control(letter: u8) -> u8 {
    letter & 0x1F
}

const A: u8 = control(b'A');
const B: u8 = control(b'B');
const C: u8 = control(b'C');
const D: u8 = control(b'D');
const E: u8 = control(b'E');
const F: u8 = control(b'F');
const K: u8 = control(b'K');
const L: u8 = control(b'L');
const O: u8 = control(b'O');
const P: u8 = control(b'P');
const Q: u8 = control(b'Q');
const R: u8 = control(b'R');
const S: u8 = control(b'S');
const U: u8 = control(b'U');
const V: u8 = control(b'V');
const X: u8 = control(b'X');
const Z: u8 = control(b'Z');

/// ^W.
pub const TAKE: u8 = control(b'W');

/// Whether `character` makes the board take a line; the board answers it like any line.
#[must_use]
pub const fn takes_line(character: u8) -> bool {
    character == TAKE
}

/// The line for ^W; empty when I47 points outside the DPRAM, `None` in families without ^W.
pub fn dpram_line(board: &Board) -> Option<Vec<u8>> {
    let first = board.variables.i(board.settings().line_from_dpram?) as u32;
    let words = (first..)
        .take_while(|&address| board.memory.host_offset(address).is_some())
        .flat_map(|address| [board.memory.read_y(address), board.memory.read_x(address)]);
    let characters = words.flat_map(|word| (word as u16).to_le_bytes());
    Some(characters.take_while(|c| !matches!(c, 0 | b'\r')).take(LONGEST_LINE + 1).collect())
}

/// The report of ^E and ^G, for ports that transmit any byte.
pub fn binary_report(board: &Board, character: u8) -> Option<Vec<u8>> {
    const G: u8 = control(b'G');
    if board.family().generation == Generation::Turbo && character == E {
        return None;
    }
    let words: Vec<u32> = match character {
        E => board.gather_sources().into_iter().flatten().collect(),
        G => board.global_status().to_vec(),
        _ => return None,
    };
    Some(words.iter().flat_map(|word| word.to_be_bytes().into_iter().skip(1)).collect())
}

/// Executes `character`. `None` for a character that is no command. Reports are of the 0-based `group` of motors, and
/// of the group of coordinate systems that I59 of Turbo pairs with it (Turbo Software Reference p. 65).
pub fn execute(board: &mut Board, programs: &mut Programs, group: usize, character: u8) -> Option<Reply> {
    let (family, size) = (board.family(), board.identity.tables.group);
    let report = |texts: Vec<String>| Reply { lines: vec![texts.join(" ")], error: None };
    let members = |group: usize| size * group..size * (group + 1);
    let motors = members(group);
    let mut reply = Reply::default();
    match character {
        A => programs.abort_all(board),
        B => reply = report(motors.map(|motor| status_text(&board.motor_status(motor))).collect()),
        C => {
            let systems = members(group % family.coordinate_systems.div_ceil(size));
            reply = report(systems.map(|cs| status_text(&board.coordinate_report(cs))).collect());
        }
        D => programs.switch_plcs(u32::MAX, PlcSwitch::Disable),
        // In newer firmware; in old firmware ^E reports ([`binary_report`]).
        E if family.generation == Generation::Turbo => {
            (0..board.motors.len()).for_each(|motor| board.enable_motor(motor));
        }
        F => reply = report(motors.map(|motor| tenths(board.following_error(motor))).collect()),
        K => programs.kill_all(board),
        L => programs.store.close(),
        O => board.hold_all(),
        P => {
            let form = board.identity.tables.positions;
            reply = report(motors.map(|motor| form.text(board.position(motor))).collect());
        }
        Q => programs.quit_all(board),
        R => programs.run_all(board),
        S => programs.step_all(board),
        U => reply.error = programs.store.open_buffer(Open::Rotary).err(),
        V => reply = report(motors.map(|motor| tenths(board.velocity(motor))).collect()),
        X => board.cancel_queues(),
        Z => board.serial_becomes_active(),
        _ => return None,
    }
    Some(reply)
}
