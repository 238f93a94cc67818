//! Gives up the calling thread's capabilities for good. For a process with one thread: each thread has its own.

use caps::{CapSet, Capability};
use nix::sys::prctl;

/// The sets that give a right, in the order in which they can be emptied.
pub const SETS: [CapSet; 4] = [CapSet::Ambient, CapSet::Effective, CapSet::Permitted, CapSet::Inheritable];

/// The kernel or the process kept a right.
#[derive(Debug, thiserror::Error)]
#[error("giving up privileges: {what}: {reason}")]
pub struct CapabilityError {
    what: &'static str,
    reason: String,
}

fn refused<E: ToString>(what: &'static str) -> impl FnOnce(E) -> CapabilityError {
    move |error| CapabilityError { what, reason: error.to_string() }
}

/// Empties the bounding set, the rights that programs run by this process could get, if the process may.
pub fn empty_bounding() {
    if caps::has_cap(None, CapSet::Effective, Capability::CAP_SETPCAP).unwrap_or(false) {
        let _ = caps::clear(None, CapSet::Bounding);
    }
}

/// Gives up every capability, and every way to get one by running a program. Reads the result back from the kernel.
///
/// # Errors
/// [`CapabilityError`] if the kernel refuses, or if a right is left.
pub fn give_up() -> Result<(), CapabilityError> {
    for set in SETS {
        // A unit without capabilities also forbids the system call that would drop them.
        if !is_empty(set)? {
            caps::clear(None, set).map_err(refused("dropping capabilities"))?;
        }
    }
    prctl::set_no_new_privs().map_err(refused("no new privileges"))?;
    for set in SETS {
        if !is_empty(set)? {
            return Err(refused("reading capabilities")(format!("some are left in the {set:?} set")));
        }
    }
    Ok(())
}

fn is_empty(set: CapSet) -> Result<bool, CapabilityError> {
    caps::read(None, set).map(|caps| caps.is_empty()).map_err(refused("reading capabilities"))
}
