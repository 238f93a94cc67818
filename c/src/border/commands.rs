//! Command lines, control characters, the control panel and jogs.

use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::ptr;

use super::{check_flags, elements, ended, freed, given, made, milliseconds, pointer, some_text};
use crate::board::Board;
use crate::failure::{Failure, Status};
use crate::replies::Reply;
use crate::streams::Jog;
use crate::types::{CONFIRMED, Error};

/// A place for the reply; NULL: the caller does not want the reply.
type Place<'a> = Option<&'a mut MaybeUninit<*mut Reply>>;

/// Does `action`, and puts the reply's lines into `place`, also those of the answer before an error.
fn replied(
    error: Option<&mut MaybeUninit<Error>>,
    mut place: Place<'_>,
    action: impl FnOnce() -> Result<Vec<String>, Failure>,
) -> Status {
    if let Some(place) = &mut place {
        place.write(ptr::null_mut());
    }
    ended(error, || {
        let found = action();
        let lines = found.as_ref().unwrap_or_else(|failure| &failure.lines);
        if let Some(place) = place {
            place.write(Box::into_raw(Box::new(Reply::new(lines))));
        }
        found.map(|_| Status::Ok)
    })
}

/// Sends a command line and waits for the board's answer, at most `timeout_ms`. The line enters no program buffer but one
/// that this process's lines have opened. `*reply` (or NULL) gets the lines of the answer, after an error those that had
/// come: free it in either case. `flags`: PMAC_CONFIRMED or 0.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_command(
    board: Option<&Board>,
    line: *const c_char,
    timeout_ms: u32,
    flags: u32,
    reply: Option<&mut MaybeUninit<*mut Reply>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    replied(error, reply, || {
        check_flags(flags, CONFIRMED)?;
        given(board, "board")?.command(some_text(line, "line")?, milliseconds(timeout_ms), flags == CONFIRMED)
    })
}

/// As pmac_command, for a mere question: the daemon refuses a line that would enter an open program buffer.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_question(
    board: Option<&Board>,
    line: *const c_char,
    timeout_ms: u32,
    reply: Option<&mut MaybeUninit<*mut Reply>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    replied(error, reply, || {
        given(board, "board")?.question(some_text(line, "line")?, milliseconds(timeout_ms))
    })
}

/// Sends a control character, as "^K", before all waiting lines. It waits for no command of another thread. `flags`:
/// PMAC_CONFIRMED or 0.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_control(
    board: Option<&Board>,
    character: *const c_char,
    flags: u32,
    reply: Option<&mut MaybeUninit<*mut Reply>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    replied(error, reply, || {
        check_flags(flags, CONFIRMED)?;
        given(board, "board")?.control(some_text(character, "character")?, flags == CONFIRMED)
    })
}

/// How many lines the reply has; 0 for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_reply_count(reply: Option<&Reply>) -> usize {
    reply.map_or(0, Reply::count)
}

/// Line `index` of the reply, from 0, as long as the reply lives; NULL without such a line.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_reply_line(reply: Option<&Reply>, index: usize) -> *const c_char {
    pointer(reply.and_then(|reply| reply.line(index)))
}

/// All lines, a newline between two, as long as the reply lives; NULL for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_reply_text(reply: Option<&Reply>) -> *const c_char {
    pointer(reply.map(Reply::text))
}

/// Frees the reply.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_reply_free(reply: Option<Box<Reply>>) {
    freed(reply);
}

/// A request to the control panel for the motors or coordinate systems `numbers`: "jog+", "jog-", "jog-stop", "pre-jog",
/// "home" for motors, "start", "step", "stop", "hold" for coordinate systems. Returns when the board has taken it.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_panel(
    board: Option<&Board>,
    action: *const c_char,
    numbers: *const u8,
    count: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let (action, numbers) = (some_text(action, "action")?, elements(numbers, count, "numbers")?);
        given(board, "board")?.panel(action, numbers)?;
        Ok(Status::Ok)
    })
}

/// Moves motor `motor` to `position`, in counts. Returns when the board has taken the command; the motor moves then.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_jog_to(
    board: Option<&Board>,
    motor: u8,
    position: f64,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        given(board, "board")?.jog_to(motor, position)?;
        Ok(Status::Ok)
    })
}

/// Jogs motor `motor` until pmac_jog_stop; `direction` is positive or negative. A thread of the library renews the jog:
/// the daemon stops the motor if this process dies or hangs. A forked child has no part in it.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_jog_begin(
    board: Option<&Board>,
    motor: u8,
    direction: i32,
    jog: Option<&mut MaybeUninit<*mut Jog>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, jog, || Jog::new(given(board, "board")?, motor, direction))
}

/// 1 while the motor is held; 0 after pmac_jog_stop, however that ended, and when the daemon has stopped the motor. During
/// pmac_jog_stop of another thread it waits.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_jog_is_held(
    jog: Option<&Jog>,
    is_held: Option<&mut MaybeUninit<i32>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let held = given(jog, "jog")?.is_held()?;
        given(is_held, "is_held")?.write(held.into());
        Ok(Status::Ok)
    })
}

/// Stops the motor, and returns when the board has taken the stop. PMAC_STOP_FAILED: the motor may be moving. Every
/// further call by the handle, also of a thread that waited meanwhile, returns the same, and stops nothing.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_jog_stop(jog: Option<&Jog>, error: Option<&mut MaybeUninit<Error>>) -> Status {
    ended(error, || {
        given(jog, "jog")?.stop()?;
        Ok(Status::Ok)
    })
}

/// Frees the jog, and stops the motor if it is held; pmac_jog_stop also tells how that went.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_jog_free(jog: Option<Box<Jog>>) {
    freed(jog);
}
