//! Values that each process has for itself. In a forked child no thread of the parent goes on: a value that one of
//! them had locked would stay locked.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use pyo3::prelude::*;

/// A value that threads share, and a forked child does not wait for.
pub struct PerProcess<T> {
    kept: Mutex<Kept<T>>,
}

struct Kept<T> {
    process: u32,
    value: Arc<Mutex<T>>,
}

impl<T> PerProcess<T> {
    /// Begins with `value`.
    pub fn new(value: T) -> Self {
        let value = Arc::new(Mutex::new(value));
        Self { kept: Mutex::new(Kept { process: std::process::id(), value }) }
    }

    /// The value; in a forked child the parent's, or a new one by `make` if a thread of the parent was using it. Call
    /// this with Python's lock held; Python forks with that lock held, too.
    pub fn get(&self, make: impl FnOnce() -> PyResult<T>) -> PyResult<Arc<Mutex<T>>> {
        let mut kept = lock(&self.kept);
        let process = std::process::id();
        if kept.process != process {
            if matches!(kept.value.try_lock(), Err(TryLockError::WouldBlock)) {
                kept.value = Arc::new(Mutex::new(make()?));
            }
            kept.process = process;
        }
        Ok(Arc::clone(&kept.value))
    }
}

/// Locks `value`, also after a panic: no panicking call leaves the value half changed.
pub fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
