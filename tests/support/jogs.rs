//! Jogs that `pmacctl` holds: the board's view of them, and how their holder ends.

use std::process::Child;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::Connection;

use super::{PATIENCE, status_within, wait_until};

/// The number that the board answers to `line`.
pub fn ask(connection: &mut Connection, line: &str) -> f64 {
    connection.send(line, PATIENCE).unwrap()[0].parse().unwrap()
}

/// Waits until `holds` is true of the answer to `line`.
#[track_caller]
pub fn until(connection: &mut Connection, line: &str, what: &str, holds: impl Fn(f64) -> bool) {
    wait_until(&format!("{line}: {what}"), || holds(ask(connection, line)));
}

/// Sends `signal` to a running process.
pub fn signal(child: &Child, signal: Signal) {
    kill(Pid::from_raw(child.id().cast_signed()), signal).unwrap();
}

/// The exit status of a process that ends by itself.
#[track_caller]
pub fn status(mut child: Child) -> Option<i32> {
    status_within(&mut child, PATIENCE).code()
}
