//! Values that each process has for itself. A forked child must wait for no lock that a thread of its parent held at the
//! fork, and must use no connection of the parent.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::failure::{Failure, Status};

/// How often in a row a process may fork and go on with the same handle.
const GENERATIONS: usize = 8;

/// A value of each process.
pub struct PerProcess<T> {
    places: [Place<T>; GENERATIONS],
}

struct Place<T> {
    /// The process that has this place; 0: nobody.
    process: AtomicU32,
    value: Mutex<T>,
}

impl<T: Default> Default for PerProcess<T> {
    fn default() -> Self {
        let place = |_| Place { process: AtomicU32::new(0), value: Mutex::new(T::default()) };
        Self { places: std::array::from_fn(place) }
    }
}

impl<T> PerProcess<T> {
    /// This process's value. In a forked child the value is new.
    pub fn lock(&self) -> Result<MutexGuard<'_, T>, Failure> {
        let process = std::process::id();
        let is_ours = |place: &&Place<T>| {
            let found = place.process.compare_exchange(0, process, Ordering::AcqRel, Ordering::Acquire);
            found.is_ok() || found == Err(process)
        };
        match self.places.iter().find(is_ours) {
            Some(place) => Ok(lock(&place.value)),
            None => Err(Failure::new(
                Status::OtherProcess,
                format!(
                    "this handle has come through {GENERATIONS} forks; open the board anew in this process"
                ),
            )),
        }
    }
}

/// Spare values of each process. A thread takes one for a call, so that no thread waits for another one's call.
pub struct Pool<T>(PerProcess<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(PerProcess::default())
    }
}

impl<T> Pool<T> {
    /// Spare values kept at most.
    const MOST: usize = 8;

    /// A spare value.
    pub fn take(&self) -> Result<Option<T>, Failure> {
        Ok(self.0.lock()?.pop())
    }

    /// Keeps `value` for another call.
    pub fn put(&self, value: T) -> Result<(), Failure> {
        let mut spare = self.0.lock()?;
        if spare.len() < Self::MOST {
            spare.push(value);
        }
        Ok(())
    }
}

/// A value of the process that made it; others get an error, at once.
pub struct Owned<T> {
    process: u32,
    value: Mutex<T>,
}

impl<T> Owned<T> {
    /// `value` of this process.
    pub fn new(value: T) -> Self {
        Self { process: std::process::id(), value: Mutex::new(value) }
    }

    /// The value; another thread of this process may use it until then.
    pub fn lock(&self) -> Result<MutexGuard<'_, T>, Failure> {
        if self.process != std::process::id() {
            let text =
                format!("this handle belongs to process {}, from which this one was forked", self.process);
            return Err(Failure::new(Status::OtherProcess, text));
        }
        Ok(lock(&self.value))
    }
}

/// Locks `value`, also after a panic: no panicking call leaves the value half changed.
fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}
