//! What `backup`, `diff` and `restore` ask the board, in one sequence that the daemon runs.

use std::time::Duration;

use crate::cli::context::Failure;
use crate::client::Connection;
use crate::client::command::lines::{LineSequence, LinesOptions};

/// How long a line may take: one question asks for as many as a hundred variables.
const PATIENCE: Duration = Duration::from_secs(30);

/// Begins a sequence that others are told is a `kind`. A refused line ends it unless it is to `keep_going`.
pub fn begin<'c>(connection: &'c mut Connection, kind: &'c str, keep_going: bool) -> LineSequence<'c> {
    connection.lines(LinesOptions { kind, timeout: PATIENCE, keep_going })
}

/// What the board answers to each of `lines`.
///
/// # Errors
/// When it refuses one, or cannot be asked.
pub fn ask(sequence: &mut LineSequence<'_>, lines: &[&str]) -> Result<Vec<Vec<String>>, Failure> {
    let mut replies = Vec::new();
    let mut failed = None;
    sequence.run(lines, |reply| {
        match &reply.failure {
            Some(failure) => failed = Some(failure.message.clone()),
            None => replies.push(reply.lines.clone()),
        }
        failed.is_none()
    })?;
    match lines.get(replies.len()) {
        None => Ok(replies),
        Some(line) => {
            let why = failed.unwrap_or_else(|| "not asked, the sequence was ended".to_owned());
            Err(Failure::Refused(format!("{line}: {why}")))
        }
    }
}
