//! The exceptions, which `pmac_dpram.errors` defines.

use pmac_dpram::client::{ClientError, CommandError, Staleness};
use pmac_dpram::protocol::CallError;
use pmac_dpram::segment::SegmentError;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

const PLAIN: &str = "PmacError";
const STALE: &str = "StaleData";
const GONE: &str = "DaemonGone";

fn raise(class: &str, message: &str, code: u16, lines: &[String]) -> PyErr {
    Python::attach(|py| {
        let made = py.import("pmac_dpram.errors").and_then(|errors| {
            let error = errors.getattr(class)?.call1((message, code, lines.to_vec()))?;
            Ok(PyErr::from_value(error))
        });
        made.unwrap_or_else(|_| PyRuntimeError::new_err(message.to_owned()))
    })
}

/// A mistake in the call.
pub fn refused(message: &str) -> PyErr {
    raise(PLAIN, message, 0, &[])
}

/// The exception for data that are not live.
pub fn stale(why: Staleness) -> PyErr {
    let class = if why == Staleness::DaemonGone { GONE } else { STALE };
    raise(class, &why.to_string(), 0, &[])
}

/// The exception for a failed read.
pub fn of_client(error: ClientError) -> PyErr {
    match error {
        ClientError::Socket(error) => of_command(error),
        ClientError::Segment(error @ SegmentError::NotFound { .. }) => {
            raise(GONE, &error.to_string(), 0, &[])
        }
        error => raise(PLAIN, &error.to_string(), 0, &[]),
    }
}

/// The exception for a failed call over the socket.
pub fn of_command(error: CommandError) -> PyErr {
    let message = error.to_string();
    of_command_saying(error, &message)
}

/// As [`of_command`], with the text `message`.
pub fn of_command_saying(error: CommandError, message: &str) -> PyErr {
    match error {
        CommandError::Refused(CallError::Board { code, lines, .. }) => raise(PLAIN, message, code, &lines),
        CommandError::Refused(CallError::TimedOut { lines }) => raise(PLAIN, message, 0, &lines),
        CommandError::Connect { .. }
        | CommandError::NotTaken { .. }
        | CommandError::Broken { .. }
        | CommandError::StreamEnded { .. } => raise(GONE, message, 0, &[]),
        _ => raise(PLAIN, message, 0, &[]),
    }
}
