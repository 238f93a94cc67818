//! What the programs of this package have in common as processes (layer 0).

use std::io;

use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};

/// Has the kernel send SIGTERM to this process when process `parent`, which started it, ends, however it ends.
///
/// # Errors
/// What the kernel says; also when `parent` has ended already.
pub fn end_with_parent(parent: u32) -> io::Result<()> {
    set_pdeathsig(Some(Signal::SIGTERM))?;
    if getppid() == Pid::from_raw(parent.cast_signed()) {
        Ok(())
    } else {
        Err(io::Error::other(format!("process {parent}, which this one was to end with, has ended")))
    }
}
