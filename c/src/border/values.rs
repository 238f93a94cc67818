//! Variables, gathers and rotary streams.

use std::ffi::{c_char, c_void};
use std::mem::MaybeUninit;
use std::ptr;
use std::time::Duration;

use super::{
    check_place, elements, ended, fill, freed, given, goes_on, made, milliseconds, pointer, put, read,
    some_text, texts,
};
use crate::board::Board;
use crate::failure::{Failure, Status};
use crate::replies::Reply;
use crate::sequences::{Gathered, stream};
use crate::types::{Error, GatheredInfo, RotaryOptions, Streamed};

/// The values of the variables `names` (as "P1", "Q2", "I122"), by lines that enter no program buffer. A Q-variable is
/// that of the addressed coordinate system.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_variables_read(
    board: Option<&Board>,
    names: *const *const c_char,
    count: usize,
    values: *mut f64,
    timeout_ms: u32,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let names = texts(names, count, "names")?;
        put(values, count, &given(board, "board")?.variables(&names, milliseconds(timeout_ms))?)?;
        Ok(Status::Ok)
    })
}

/// Sets the variable `name`, by a line that enters no program buffer.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_variable_write(
    board: Option<&Board>,
    name: *const c_char,
    value: f64,
    timeout_ms: u32,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let name = some_text(name, "name")?;
        given(board, "board")?.set_variable(name, value, milliseconds(timeout_ms))?;
        Ok(Status::Ok)
    })
}

/// Has the board gather the `count` sources (as "1.actual_position", "servo_timer", "Y:$C003") each `period` servo cycles
/// for `seconds`, and returns at the end. `keep_going` (or NULL) is called many times a second with `context`; when it returns
/// 0, the gather ends with PMAC_HALTED, or, if the daemon does not end it, with that error. It must not throw.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gather(
    board: Option<&Board>,
    sources: *const *const c_char,
    count: usize,
    period: u32,
    seconds: f64,
    keep_going: Option<extern "C" fn(*mut c_void) -> i32>,
    context: *mut c_void,
    gathered: Option<&mut MaybeUninit<*mut Gathered>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, gathered, || {
        let sources = texts(sources, count, "sources")?;
        let why = |_| Failure::argument(format!("{seconds} is no time in seconds"));
        let time = Duration::try_from_secs_f64(seconds).map_err(why)?;
        let board = given(board, "board")?;
        Gathered::new(board, &sources, (period, time), goes_on(keep_going, context))
    })
}

/// How many samples, values in each, and lost samples. `size` is `sizeof(pmac_gathered_info)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gathered_size(
    gathered: Option<&Gathered>,
    info: *mut GatheredInfo,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || fill(info, size, &given(gathered, "gathered")?.info()))
}

/// The title of column `index`, from 0, as long as the handle lives: the source, and its unit in brackets; NULL without
/// such a column.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gathered_title(gathered: Option<&Gathered>, index: usize) -> *const c_char {
    pointer(gathered.and_then(|gathered| gathered.title(index)))
}

/// The values, row by row, as long as the handle lives; NULL for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gathered_values(gathered: Option<&Gathered>) -> *const f64 {
    gathered.map_or(ptr::null(), |gathered| gathered.values().as_ptr())
}

/// When the board made each sample, in seconds since the first, as long as the handle lives; NULL for NULL.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gathered_times(gathered: Option<&Gathered>) -> *const f64 {
    gathered.map_or(ptr::null(), |gathered| gathered.times().as_ptr())
}

/// Frees the samples.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_gathered_free(gathered: Option<Box<Gathered>>) {
    freed(gathered);
}

/// Streams the motion program `text` of `length` bytes to a rotary buffer, and returns when the board has all of it.
/// Errors name it `name`. `options_size` is `sizeof(pmac_rotary_options)`, `streamed_size` `sizeof(pmac_streamed)`;
/// `streamed` may be NULL.
/// `*warnings` (or NULL) gets how the board's program differs from the text: free it. `keep_going`: as in pmac_gather.
/// If an error or the caller ends the stream early, the daemon ends the program, too. PMAC_STOP_FAILED: the caller ended the
/// stream, but the program may run on.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_rotary(
    board: Option<&Board>,
    name: *const c_char,
    text: *const u8,
    length: usize,
    options: *const RotaryOptions,
    options_size: usize,
    keep_going: Option<extern "C" fn(*mut c_void) -> i32>,
    context: *mut c_void,
    streamed: *mut Streamed,
    streamed_size: usize,
    warnings: Option<&mut MaybeUninit<*mut Reply>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let warnings = warnings.map(|place| place.write(ptr::null_mut()));
        let program = (some_text(name, "name")?, elements(text, length, "text")?);
        let options = read(options, options_size)?;
        if !streamed.is_null() {
            check_place(streamed, streamed_size)?;
        }
        let (sent, said) = stream(given(board, "board")?, program, &options, goes_on(keep_going, context))?;
        if let Some(place) = warnings {
            *place = Box::into_raw(Box::new(said));
        }
        if streamed.is_null() { Ok(Status::Ok) } else { fill(streamed, streamed_size, &sent) }
    })
}
