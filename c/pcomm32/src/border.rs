//! The border to C: pointers from a program become copies here, and no panic goes out. All `unsafe` of the package is
//! in this file.

#![allow(unsafe_code)]

use std::collections::BTreeSet;
use std::ffi::{c_char, c_void};
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{copy_nonoverlapping, null_mut, slice_from_raw_parts};
use std::sync::Mutex;
use std::sync::atomic::{AtomicPtr, Ordering};

/// Exports functions. Each answers its value of failure if its body panics.
macro_rules! exports {
    ($($(#[$about:meta])* $name:ident($($argument:ident: $type:ty),*) -> $result:ty = $failed:expr => $body:expr;)*) => {$(
        $(#[$about])*
        #[allow(unsafe_code)]
        #[unsafe(no_mangle)]
        pub extern "C" fn $name($($argument: $type),*) -> $result {
            $crate::border::guarded($failed, move || $body)
        }
    )*};
}

/// Exports functions that this library does not have: each says so once, and fails. The first argument is a device.
macro_rules! stubs {
    ($($result:ty = $value:expr => { $($name:ident(DWORD $(, $type:ty)*);)* })*) => {$($(
        #[allow(unsafe_code, missing_docs)]
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(device: u32 $(, _: $type)*) -> $result {
            $crate::border::guarded($value, move || {
                $crate::fault::lacks(Some(device), stringify!($name));
                $value
            })
        }
    )*)*};
}

/// As `stubs`, for functions without a device.
macro_rules! stubs_without_device {
    ($($result:ty = $value:expr => { $($name:ident($($type:ty),*);)* })*) => {$($(
        #[allow(unsafe_code, missing_docs)]
        #[unsafe(no_mangle)]
        pub extern "C" fn $name($(_: $type),*) -> $result {
            $crate::border::guarded($value, move || {
                $crate::fault::lacks(None, stringify!($name));
                $value
            })
        }
    )*)*};
}

pub(crate) use {exports, stubs, stubs_without_device};

/// The value of `work`, or `failed` if it panics.
pub(crate) fn guarded<T>(failed: T, work: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or(failed)
}

/// The characters of a text: 8 bits, or 16 for the functions whose names end in W.
pub(crate) trait Unit: Copy + Default + PartialEq {
    /// The character as a byte; `?` for a character that no board knows.
    fn byte(self) -> u8;
    /// The byte as a character.
    fn of(byte: u8) -> Self;
}

impl Unit for c_char {
    fn byte(self) -> u8 {
        self as u8
    }
    fn of(byte: u8) -> Self {
        byte as Self
    }
}

impl Unit for u16 {
    fn byte(self) -> u8 {
        u8::try_from(self).unwrap_or(b'?')
    }
    fn of(byte: u8) -> Self {
        byte.into()
    }
}

/// A text of the program, up to its NUL.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Text<U = c_char>(*const U);

impl<U: Unit> Text<U> {
    /// A copy of the text; `None` for NULL.
    pub(crate) fn copy(self) -> Option<Vec<u8>> {
        if self.0.is_null() {
            return None;
        }
        let mut bytes = Vec::new();
        loop {
            // SAFETY: the program gives a text that ends with a NUL, and all characters up to the NUL are its own.
            let unit = unsafe { self.0.wrapping_add(bytes.len()).read_unaligned() };
            if unit == U::default() {
                return Some(bytes);
            }
            bytes.push(unit.byte());
        }
    }
}

/// Room of the program for a text.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Room<U = c_char>(*mut U);

impl<U: Unit> Room<U> {
    /// Writes as much of `text` as `max` characters hold with the NUL, and the NUL. Returns how many characters of the
    /// text are there.
    pub(crate) fn put(self, max: usize, text: &[u8]) -> usize {
        if self.0.is_null() || max == 0 {
            return 0;
        }
        let count = text.len().min(max - 1);
        let units: Vec<U> = text[..count].iter().map(|byte| U::of(*byte)).chain([U::default()]).collect();
        // SAFETY: the program gives room for `max` characters; `count` and the NUL are no more.
        unsafe { copy_nonoverlapping(units.as_ptr().cast::<u8>(), self.0.cast(), size_of_val(&units[..])) };
        count
    }
}

/// A place of the program for one value.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Place<T>(*mut T);

impl<T: Copy> Place<T> {
    /// Writes `value`, unless the place is NULL.
    pub(crate) fn put(self, value: T) {
        if !self.0.is_null() {
            // SAFETY: the program gives a place for one value.
            unsafe { self.0.write_unaligned(value) };
        }
    }

    /// A copy of `count` values; `None` for NULL.
    pub(crate) fn copy(self, count: usize) -> Option<Vec<T>> {
        let read = |index| {
            // SAFETY: the program gives as many values.
            unsafe { self.0.wrapping_add(index).read_unaligned() }
        };
        (!self.0.is_null()).then(|| (0..count).map(read).collect())
    }
}

/// Bytes of the program: a part of the DPRAM to read or write.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub struct Memory(*mut c_void);

impl Memory {
    /// No bytes.
    pub(crate) const NULL: Self = Self(std::ptr::null_mut());

    /// Whether the program gives no place.
    pub(crate) fn is_null(self) -> bool {
        self.0.is_null()
    }

    /// Writes `bytes` there, and gives the place back.
    pub(crate) fn put(self, bytes: &[u8]) -> Self {
        if !self.0.is_null() {
            // SAFETY: the program gives room for as many bytes as it asks for.
            unsafe { copy_nonoverlapping(bytes.as_ptr(), self.0.cast(), bytes.len()) };
        }
        self
    }

    /// A copy of `count` bytes; `None` for NULL.
    pub(crate) fn copy(self, count: usize) -> Option<Vec<u8>> {
        if self.0.is_null() {
            return None;
        }
        // SAFETY: the program gives as many bytes, and changes none of them during the call.
        Some(unsafe { &*slice_from_raw_parts(self.0.cast::<u8>(), count) }.to_vec())
    }
}

/// A value that is made once and stays until the end of the process. No thread waits for another one that makes it: a
/// child that forks meanwhile would wait for ever.
pub(crate) struct Once<T>(AtomicPtr<T>);

impl<T: Send + Sync> Once<T> {
    pub(crate) const fn new() -> Self {
        Self(AtomicPtr::new(null_mut()))
    }

    /// The value. Several threads may make one at the same time; the first that is done gives its value to all.
    pub(crate) fn get_or_make(&'static self, make: impl FnOnce() -> T) -> &'static T {
        let mut found = self.0.load(Ordering::Acquire);
        if found.is_null() {
            let made = Box::into_raw(Box::new(make()));
            found = match self.0.compare_exchange(found, made, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => made,
                Err(first) => {
                    // SAFETY: the pointer comes from a box, and no other thread has seen it.
                    drop(unsafe { Box::from_raw(made) });
                    first
                }
            };
        }
        // SAFETY: the pointer comes from a box that nobody frees, and there are shared references alone.
        unsafe { &*found }
    }
}

/// Says `text` on standard error, once for each `key`.
pub(crate) fn say_once(key: &'static str, text: &str) {
    static SAID: Mutex<BTreeSet<&str>> = Mutex::new(BTreeSet::new());
    // A fork may have copied a locked lock: then the child says nothing.
    if SAID.try_lock().is_ok_and(|mut said| said.insert(key)) {
        // A program without standard error loses nothing else.
        let _ = writeln!(std::io::stderr(), "libPComm32W: {text}");
    }
}
