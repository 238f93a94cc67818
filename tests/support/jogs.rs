//! Jogs that `pmacctl` holds: what the board says of them, and how their holder ends.

use std::process::Child;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::Connection;

use super::{PATIENCE, status_within, wait_until};

/// The number that `line` is answered with.
pub fn ask(connection: &mut Connection, line: &str) -> f64 {
    connection.send(line, PATIENCE).unwrap()[0].parse().unwrap()
}

/// Waits until the answer to `line` is such that `holds`.
#[track_caller]
pub fn until(connection: &mut Connection, line: &str, what: &str, holds: impl Fn(f64) -> bool) {
    wait_until(&format!("{line}: {what}"), || holds(ask(connection, line)));
}

/// Sends `signal` to a process that runs.
pub fn signal(child: &Child, signal: Signal) {
    kill(Pid::from_raw(child.id().cast_signed()), signal).unwrap();
}

/// The exit status of a process that ends by itself.
#[track_caller]
pub fn status(mut child: Child) -> Option<i32> {
    status_within(&mut child, PATIENCE).code()
}
