//! Boards, and their data at one moment.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;

use super::{check_flags, ended, fill, freed, given, made, milliseconds, pointer, put, some_text, text};
use crate::board::Board;
use crate::failure::{Failure, Status};
use crate::snapshot::Snapshot;
use crate::types::{Error, Identity, Moment, Motor, MotorLabel, STALE_OK, System, Word};

/// The version of this library: `0.1.0`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(text) => text,
            Err(_) => c"",
        };
    VERSION.as_ptr()
}

/// Opens the board called `name` (NULL: `pmac0`). With `socket`: the board of the daemon at that path; with both, they
/// must agree. Needs no connection unless there is a socket.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_open(
    name: *const c_char,
    socket: *const c_char,
    board: Option<&mut MaybeUninit<*mut Board>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, board, || Board::open(text(name, "name")?, text(socket, "socket")?))
}

/// Frees the board. Handles made from it stay good.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_close(board: Option<Box<Board>>) {
    freed(board);
}

/// The board's name, as long as the handle lives; NULL for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_name(board: Option<&Board>) -> *const c_char {
    pointer(board.map(Board::name))
}

/// The path of the daemon's socket, as long as the handle lives; NULL for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_socket(board: Option<&Board>) -> *const c_char {
    pointer(board.map(Board::socket))
}

/// The words for a `pmac_status`: `daemon gone`; empty for a number that is none.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_status_name(status: i32) -> *const c_char {
    Status::name_of(status).as_ptr()
}

/// The board, as it has told the daemon. `size` is `sizeof(pmac_identity)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_identity(
    board: Option<&Board>,
    identity: *mut Identity,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(identity, size, &given(board, "board")?.identity()?))
}

/// Name and unit of motor `motor` (from 1) in the daemon's configuration. `size` is `sizeof(pmac_motor_label)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_motor_label(
    board: Option<&Board>,
    motor: u32,
    label: *mut MotorLabel,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(label, size, &given(board, "board")?.motor_label(motor)?))
}

/// The site's own word number `index`, from 0; with `count` (or NULL) also how many there are. `size` is
/// `sizeof(pmac_word)`. `word` may be NULL to ask for the count alone.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_word(
    board: Option<&Board>,
    index: usize,
    word: *mut Word,
    size: usize,
    count: Option<&mut MaybeUninit<usize>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let words = given(board, "board")?.words()?;
        if let Some(count) = count {
            count.write(words.len());
            if word.is_null() {
                return Ok(Status::Ok);
            }
        }
        let why = || Failure::argument(format!("there is no word {index}; there are {}", words.len()));
        fill(word, size, words.get(index).ok_or_else(why)?)
    })
}

/// The number of the latest servo update; 0 before the first.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_sequence(
    board: Option<&Board>,
    sequence: Option<&mut MaybeUninit<u64>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let board = given(board, "board")?;
        given(sequence, "sequence")?.write(board.sequence()?);
        Ok(Status::Ok)
    })
}

/// Sleeps until there is a servo update newer than number `*after` (NULL: than the latest), at most `timeout_ms`.
/// PMAC_OK, or PMAC_TIMED_OUT without one.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_board_wait(
    board: Option<&Board>,
    after: Option<&u64>,
    timeout_ms: u32,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let came = given(board, "board")?.wait(after.copied(), milliseconds(timeout_ms))?;
        Ok(if came { Status::Ok } else { Status::TimedOut })
    })
}

/// Takes everything that the segment has now. Data that are not live are an error, unless `flags` has PMAC_STALE_OK.
/// If only the background data are not live, the snapshot leaves them out.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_take(
    board: Option<&Board>,
    flags: u32,
    snapshot: Option<&mut MaybeUninit<*mut Snapshot>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, snapshot, || {
        check_flags(flags, STALE_OK)?;
        given(board, "board")?.snapshot(flags & STALE_OK != 0)
    })
}

/// Frees the snapshot.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_free(snapshot: Option<Box<Snapshot>>) {
    freed(snapshot);
}

/// When the snapshot was, of which motors and coordinate systems, and why its data are old if they are. `size` is
/// `sizeof(pmac_moment)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_moment(
    snapshot: Option<&Snapshot>,
    moment: *mut Moment,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(moment, size, &given(snapshot, "snapshot")?.moment()))
}

/// Motor `number`, from 1. `size` is `sizeof(pmac_motor)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_motor(
    snapshot: Option<&Snapshot>,
    number: u32,
    motor: *mut Motor,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(motor, size, &given(snapshot, "snapshot")?.motor(number)?))
}

/// Coordinate system `number`, from 1. `size` is `sizeof(pmac_system)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_system(
    snapshot: Option<&Snapshot>,
    number: u32,
    system: *mut System,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(system, size, &given(snapshot, "snapshot")?.system(number)?))
}

/// Whether the flag `name` (as `in_position`) of motor `number` is set: 1 or 0, or -1 if the board does not report its
/// word. pmacctl motor tells the names.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_motor_flag(
    snapshot: Option<&Snapshot>,
    number: u32,
    name: *const c_char,
    is_set: Option<&mut MaybeUninit<i32>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let found = given(snapshot, "snapshot")?.motor_flag(number, some_text(name, "name")?)?;
        given(is_set, "is_set")?.write(found.map_or(-1, i32::from));
        Ok(Status::Ok)
    })
}

/// Whether the flag `name` (as `running_program`) of coordinate system `number` is set: 1 or 0, or -1 if the board does
/// not report its word. pmacctl system tells the names.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_system_flag(
    snapshot: Option<&Snapshot>,
    number: u32,
    name: *const c_char,
    is_set: Option<&mut MaybeUninit<i32>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let found = given(snapshot, "snapshot")?.system_flag(number, some_text(name, "name")?)?;
        given(is_set, "is_set")?.write(found.map_or(-1, i32::from));
        Ok(Status::Ok)
    })
}

/// The values of the site's own word `name`: at most `room`, and in `*count` how many there are.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_snapshot_word(
    snapshot: Option<&Snapshot>,
    name: *const c_char,
    values: *mut f64,
    room: usize,
    count: Option<&mut MaybeUninit<usize>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let found = given(snapshot, "snapshot")?.word(some_text(name, "name")?)?;
        given(count, "count")?.write(found.len());
        put(values, room, &found)?;
        Ok(Status::Ok)
    })
}
