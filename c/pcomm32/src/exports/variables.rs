//! Variables, and what a board is.

use std::ffi::c_char;

use super::{BOOL, DWORD, FALSE, TRUE, int, truth};
use crate::border::{Room, Unit, exports};
use crate::fault::Fault;
use crate::{fault, process, variables};

/// Room that programs give `PmacGetVariableStrA`, which tells no size: the longest number has fewer characters.
const NUMBER_ROOM: usize = 32;

fn value(number: DWORD, letter: c_char, index: DWORD, default: f64) -> f64 {
    variables::value(number, letter.byte(), index).unwrap_or(default)
}

/// A value as an integer; the default if it is none of so many bits.
fn integer<T: TryFrom<i64>>(number: DWORD, letter: c_char, index: DWORD, default: T) -> T {
    let value = variables::value(number, letter.byte(), index);
    let value =
        value.ok().filter(|value| value.abs() < 1e15).and_then(|value| T::try_from(value as i64).ok());
    value.unwrap_or(default)
}

fn set(number: DWORD, letter: c_char, index: DWORD, value: f64) {
    // `PmacGetError` tells.
    let _ = variables::set(number, letter.byte(), index, value);
}

/// Writes the text, empty after a failure, and gives the room back.
fn told(text: Result<String, Fault>, room: Room, max: int) -> Room {
    room.put(usize::try_from(max).unwrap_or(0), text.unwrap_or_default().as_bytes());
    room
}

const I: c_char = b'I' as c_char;

exports! {
    /// A variable's value, or the default exactly.
    PmacGetVariableDouble(number: DWORD, letter: c_char, index: DWORD, default: f64) -> f64 = default =>
        value(number, letter, index, default);
    /// As `PmacGetVariableDouble`, as an integer of 32 bits.
    PmacGetVariableLong(number: DWORD, letter: c_char, index: DWORD, default: int) -> int = default =>
        integer(number, letter, index, default);
    /// As `PmacGetVariableDouble`, as an integer of 16 bits.
    PmacGetVariable(number: DWORD, letter: c_char, index: DWORD, default: i16) -> i16 = default =>
        integer(number, letter, index, default);
    /// An I-variable's value, or the default exactly.
    PmacGetIVariableDouble(number: DWORD, index: DWORD, default: f64) -> f64 = default =>
        value(number, I, index, default);
    /// As `PmacGetIVariableDouble`, as an integer of 32 bits.
    PmacGetIVariableLong(number: DWORD, index: DWORD, default: int) -> int = default =>
        integer(number, I, index, default);
    /// A variable's value as the board writes it, at most 31 characters.
    PmacGetVariableStrA(number: DWORD, letter: c_char, room: Room, index: DWORD) -> BOOL = FALSE => {
        let text = variables::text(number, letter.byte(), index).unwrap_or_default();
        BOOL::from(room.put(NUMBER_ROOM, text.as_bytes()) > 0)
    };
    /// Sets a variable.
    PmacSetVariableDouble(number: DWORD, letter: c_char, index: DWORD, value: f64) -> () = () =>
        set(number, letter, index, value);
    /// Sets a variable.
    PmacSetVariableLong(number: DWORD, letter: c_char, index: DWORD, value: int) -> () = () =>
        set(number, letter, index, value.into());
    /// Sets a variable.
    PmacSetVariable(number: DWORD, letter: c_char, index: DWORD, value: i16) -> () = () =>
        set(number, letter, index, value.into());
    /// Sets an I-variable.
    PmacSetIVariableDouble(number: DWORD, index: DWORD, value: f64) -> () = () => set(number, I, index, value);
    /// Sets an I-variable.
    PmacSetIVariableLong(number: DWORD, index: DWORD, value: int) -> () = () => set(number, I, index, value.into());
    /// The board's firmware. Returns the room.
    PmacGetRomVersionA(number: DWORD, room: Room, max: int) -> Room = room =>
        told(variables::version(number), room, max);
    /// The date of the board's firmware. Returns the room.
    PmacGetRomDateA(number: DWORD, room: Room, max: int) -> Room = room => told(variables::date(number), room, max);
    /// The vendor's number of the board's kind.
    PmacGetPmacType(number: DWORD) -> int = 0 => variables::kind(number).unwrap_or(0);
    /// Whether the board is a Turbo PMAC.
    bPMACIsTurbo(number: DWORD) -> BOOL = FALSE => BOOL::from(variables::kind(number).is_ok_and(|kind| kind > 3));
    /// Whether the board has a DPRAM: `pmacd` serves no other boards.
    PmacGetDpramAvailable(number: DWORD) -> BOOL = FALSE => truth(process::with(number, variables::info));
    /// As `PmacGetDpramAvailable`.
    PmacDPRAvailable(number: DWORD) -> BOOL = FALSE => truth(process::with(number, variables::info));
    /// FALSE: a board that is waiting for its firmware has no daemon.
    PmacInBootStrapMode(number: DWORD) -> BOOL = FALSE => {
        fault::keep(number, process::with(number, |_| Ok(())).err().as_ref());
        FALSE
    };
    /// The daemon has set what it needs.
    PmacSetCriticalIVars(number: DWORD) -> BOOL = FALSE => match process::with(number, variables::info) {
        Ok(_) => TRUE,
        Err(_) => FALSE,
    };
}
