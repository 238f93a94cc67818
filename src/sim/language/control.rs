//! Control characters that are commands: they act at once, without a line end, and leave the line under way alone
//! (Software Reference, "On-line commands", CONTROL-A and following).

use super::coordinate::status_text;
use super::number::tenths;
use super::{Machine, Reply};
use crate::sim::program::store::Open;

/// The code of ^`letter` (upper case).
pub(super) const fn control(letter: u8) -> u8 {
    letter & 0x1F
}

const A: u8 = control(b'A');
const B: u8 = control(b'B');
const C: u8 = control(b'C');
const D: u8 = control(b'D');
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

/// Carries out `character`. `None`: it is no command. (^E and ^G, binary reports of old firmware, and ^W, a command
/// taken from where I47 points, are not simulated.)
pub(super) fn execute(machine: &mut Machine, character: u8) -> Option<Reply> {
    let family = machine.variables.family();
    let report = |texts: Vec<String>| Reply { lines: vec![texts.join(" ")], error: None };
    let motors = 0..family.motors;
    let mut reply = Reply::default();
    match character {
        A => machine.abort_all(),
        B => reply = report(motors.map(|motor| status_text(machine.motor_status(motor))).collect()),
        C => {
            let systems = 0..family.coordinate_systems;
            reply = report(systems.map(|cs| status_text(machine.coordinate_status(cs))).collect());
        }
        D => machine.disable_plcs(),
        F => reply = report(motors.map(|motor| tenths(machine.following_error(motor))).collect()),
        K => machine.kill_all(),
        L => machine.programs.store.close(),
        O => machine.hold_all(),
        P => reply = report(motors.map(|motor| tenths(machine.position(motor))).collect()),
        Q => machine.quit_all(),
        R => machine.run_all(),
        S => machine.step_all(),
        U => reply.error = machine.programs.store.open_buffer(Open::Rotary).err(),
        V => reply = report(motors.map(|motor| tenths(machine.velocity(motor))).collect()),
        X => machine.cancel_queues(),
        Z => machine.serial_becomes_active(),
        _ => return None,
    }
    Some(reply)
}
