//! What each process has for itself. In a forked child no thread of the parent goes on: what one of them had locked would stay locked.

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

    /// The value; in a forked child the parent's, or another one by `make` where a thread of the parent was using it. To be called
    /// with Python's lock, with which Python forks.
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

/// Locks `value`. A call that panicked has left nothing half done in it.
pub fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
