//! Process control that all programs of this package share (layer 0).

use std::io;

use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};

/// Has the kernel send SIGTERM to this process when its parent, process `parent`, ends for whatever reason.
///
/// # Errors
/// The kernel's error, or an error when `parent` has ended already.
pub fn end_with_parent(parent: u32) -> io::Result<()> {
    set_pdeathsig(Some(Signal::SIGTERM))?;
    if getppid() == Pid::from_raw(parent.cast_signed()) {
        Ok(())
    } else {
        Err(io::Error::other(format!("process {parent}, which this one was to end with, has ended")))
    }
}
