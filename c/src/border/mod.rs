//! The functions that C calls, and the only files with `unsafe`.
//!
//! A parameter's type says what C may pass, and each such pointer may be NULL: `Option<&T>` a handle,
//! `Option<Box<T>>` a handle that the call takes back, `Option<&mut MaybeUninit<T>>` a place for a result. The header
//! asks of the caller that every other pointer be a valid one; so do the SAFETY comments here.

#![expect(
    unsafe_code,
    reason = "C calls these functions by name, and passes texts, arrays and structs by pointers"
)]

mod board;
mod commands;
mod updates;
mod values;

use std::ffi::{CStr, CString, c_char, c_void};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;
use std::slice;
use std::time::Duration;

use crate::failure::{Failure, Status};
use crate::types::{
    Error, GatheredInfo, Identity, Message, Moment, Motor, MotorLabel, RotaryOptions, Streamed, System, Word,
};

/// The largest struct that a caller can have, with room for those of later libraries.
const MOST_BYTES: usize = 4096;

/// A place for a handle.
type Handle<'a, T> = Option<&'a mut MaybeUninit<*mut T>>;

/// Does `action`, and tells how it ended. A panic is an error, too: it never reaches C.
fn ended(error: Option<&mut MaybeUninit<Error>>, action: impl FnOnce() -> Result<Status, Failure>) -> Status {
    let outcome = catch_unwind(AssertUnwindSafe(action)).unwrap_or_else(|panic| {
        let said =
            panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        let text = format!("this library has a fault: {}", said.unwrap_or("it panicked"));
        Err(Failure::new(Status::Internal, text))
    });
    match outcome {
        Ok(status) => {
            if let Some(error) = error {
                error.write(Error { status: status as i32, ..Error::NONE });
            }
            status
        }
        Err(failure) => {
            if let Some(error) = error {
                error.write(Error::of(&failure));
            }
            failure.status
        }
    }
}

/// As [`ended`], for an action that makes a handle. Without one, C gets NULL there.
fn made<T>(
    error: Option<&mut MaybeUninit<Error>>,
    place: Handle<'_, T>,
    action: impl FnOnce() -> Result<T, Failure>,
) -> Status {
    ended(error, || {
        let place = place.ok_or_else(|| Failure::argument("the place for the new handle is NULL"))?;
        place.write(ptr::null_mut());
        place.write(Box::into_raw(Box::new(action()?)));
        Ok(Status::Ok)
    })
}

/// Takes a handle back.
fn freed<T>(handle: Option<Box<T>>) {
    // A destructor that panics leaves the rest of its handle.
    let _ = catch_unwind(AssertUnwindSafe(|| drop(handle)));
}

/// The value behind a pointer that must not be NULL.
fn given<T>(pointer: Option<T>, name: &str) -> Result<T, Failure> {
    pointer.ok_or_else(|| Failure::argument(format!("{name} is NULL")))
}

/// A text, or `None` for NULL.
fn text<'a>(pointer: *const c_char, name: &str) -> Result<Option<&'a str>, Failure> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller passes a text with a NUL at its end, and leaves it there until the call returns.
    let text = unsafe { CStr::from_ptr(pointer) };
    let text = text.to_str().map_err(|_| Failure::argument(format!("{name} is not UTF-8")))?;
    Ok(Some(text))
}

/// A text that must be there.
fn some_text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    given(text(pointer, name)?, name)
}

/// A struct of integers, floats and arrays of them: any bytes are a value of it.
///
/// # Safety
/// That is so.
unsafe trait Plain: Copy {}

macro_rules! plain {
    ($($kind:ty),*) => {
        // SAFETY: each has only integers, floats and arrays of them.
        $(unsafe impl Plain for $kind {})*
    };
}
plain!(
    u8,
    f64,
    Identity,
    MotorLabel,
    Word,
    Moment,
    Motor,
    System,
    Message,
    GatheredInfo,
    RotaryOptions,
    Streamed
);

/// Fills the caller's struct of `size` bytes: an older caller's has fewer fields, a newer one gets zeros behind ours.
fn fill<T: Plain>(place: *mut T, size: usize, value: &T) -> Result<Status, Failure> {
    check_place(place, size)?;
    let ours = size_of::<T>().min(size);
    let place = place.cast::<u8>();
    // SAFETY: the caller has a struct of `size` bytes there, of which these are at most all.
    unsafe { ptr::write_bytes(place, 0, size) };
    // SAFETY: `value` has at least `ours` bytes, the place too, and the caller's struct is not one of this library's.
    unsafe { ptr::copy_nonoverlapping(ptr::from_ref(value).cast::<u8>(), place, ours) };
    Ok(Status::Ok)
}

/// Checks the caller's struct before a call takes or does what it could not give back.
fn check_place<T: Plain>(place: *const T, size: usize) -> Result<(), Failure> {
    if place.is_null() {
        return Err(Failure::argument("the struct is NULL"));
    }
    if (8..=MOST_BYTES).contains(&size) {
        return Ok(());
    }
    Err(Failure::argument(format!("{size} bytes are no size of this struct; pass its sizeof")))
}

/// Reads the caller's struct of `size` bytes: fields that an older caller does not have are 0.
fn read<T: Plain + Default>(place: *const T, size: usize) -> Result<T, Failure> {
    check_place(place, size)?;
    let mut value = T::default();
    let ours = size_of::<T>().min(size);
    // SAFETY: the caller has a struct of `size` bytes there, `value` at least `ours`, and any bytes are a value.
    unsafe { ptr::copy_nonoverlapping(place.cast::<u8>(), ptr::from_mut(&mut value).cast::<u8>(), ours) };
    Ok(value)
}

/// The most elements of an array that a caller passes.
const MOST_ELEMENTS: usize = 1 << 24;

fn check_array<T>(first: *const T, count: usize, name: &str) -> Result<(), Failure> {
    if first.is_null() && count > 0 {
        return Err(Failure::argument(format!("{name} is NULL")));
    }
    if count > MOST_ELEMENTS {
        return Err(Failure::argument(format!("{count} elements are too many for {name}")));
    }
    Ok(())
}

/// The caller's array.
fn elements<'a, T: Copy>(first: *const T, count: usize, name: &str) -> Result<&'a [T], Failure> {
    check_array(first, count, name)?;
    if count == 0 {
        return Ok(&[]);
    }
    // SAFETY: the caller has `count` elements there, and leaves them there until the call returns.
    Ok(unsafe { slice::from_raw_parts(first, count) })
}

/// The caller's array of texts.
fn texts<'a>(first: *const *const c_char, count: usize, name: &str) -> Result<Vec<&'a str>, Failure> {
    elements(first, count, name)?.iter().map(|pointer| some_text(*pointer, name)).collect()
}

/// Copies `values` to the caller's array of `room` elements.
fn put(first: *mut f64, room: usize, values: &[f64]) -> Result<(), Failure> {
    check_array(first, room, "values")?;
    if values.len() > room {
        return Err(Failure::argument(format!(
            "there is room for {room} values, and there are {}",
            values.len()
        )));
    }
    if !values.is_empty() {
        // SAFETY: the caller has room for `room` elements there, and the array is not one of this library's.
        unsafe { ptr::copy_nonoverlapping(values.as_ptr(), first, values.len()) };
    }
    Ok(())
}

/// The text as C has it; NULL without one.
fn pointer(text: Option<&CString>) -> *const c_char {
    text.map_or(ptr::null(), |text| text.as_ptr())
}

/// Asks the caller's function whether the work shall go on; without one it goes on.
fn goes_on(
    keep_going: Option<extern "C" fn(*mut c_void) -> i32>,
    context: *mut c_void,
) -> impl FnMut() -> bool {
    move || keep_going.is_none_or(|keep_going| keep_going(context) != 0)
}

/// The duration of a time-out.
fn milliseconds(timeout_ms: u32) -> Duration {
    Duration::from_millis(timeout_ms.into())
}

/// A flag that this library does not know would ask for something that it does not do.
fn check_flags(flags: u32, known: u32) -> Result<(), Failure> {
    if flags & !known == 0 {
        return Ok(());
    }
    Err(Failure::argument(format!("flags {flags:#x}: this library knows {known:#x} here")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_of_the_call() {
        let mut error = MaybeUninit::uninit();
        let status = ended(Some(&mut error), || panic!("index {} is out of bounds", 7));
        assert_eq!(status, Status::Internal);
        // SAFETY: `ended` has written it.
        let error = unsafe { error.assume_init() };
        // SAFETY: the text has a NUL at its end.
        let text = unsafe { CStr::from_ptr(error.text.as_ptr()) };
        assert_eq!(text.to_str().unwrap(), "this library has a fault: index 7 is out of bounds");
        assert_eq!(ended(None, || Ok(Status::TimedOut)), Status::TimedOut);
    }
}
