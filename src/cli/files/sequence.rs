//! Questions of `backup`, `diff` and `restore` to the board, in one sequence that the daemon runs.

use std::time::Duration;

use crate::cli::console::Progress;
use crate::cli::context::Failure;
use crate::client::Connection;
use crate::client::command::lines::{LineSequence, LinesOptions};
use crate::protocol::board::{LineFailure, LineOutcome};

/// The time limit of a line: one question asks for up to a hundred variables.
const LINE_WITHIN: Duration = Duration::from_secs(30);

/// Begins a sequence that the daemon calls a `kind` to other clients. A refused line ends the sequence unless
/// `keep_going`.
pub fn begin<'c>(connection: &'c mut Connection, kind: &'c str, keep_going: bool) -> LineSequence<'c> {
    connection.lines(LinesOptions { kind, timeout: LINE_WITHIN, keep_going })
}

/// The summary if the board did not take all lines: how many it took, and the daemon's notes on what stays on the
/// board.
pub fn left(taken: u64, lines: usize, notes: &[String]) -> String {
    let notes = notes.iter().map(|note| format!("; {note}")).collect::<String>();
    format!("the board took {taken} of {lines} lines{notes}")
}

/// The board's answer to each of `lines`.
///
/// # Errors
/// When the board refuses a line, or the daemon cannot ask it.
pub fn ask(sequence: &mut LineSequence<'_>, lines: &[&str]) -> Result<Vec<Vec<String>>, Failure> {
    let replies = answers(sequence, lines, |_| false)?;
    Ok(replies.into_iter().flatten().collect())
}

/// The board's answer to each of `lines`, or its refusal of the line. The sequence must go on after a refused line.
///
/// # Errors
/// When the daemon cannot ask the board.
pub fn try_ask(
    sequence: &mut LineSequence<'_>,
    lines: &[String],
) -> Result<Vec<Result<Vec<String>, LineFailure>>, Failure> {
    answers(sequence, lines, |failure| failure.outcome == LineOutcome::Refused)
}

/// The outcome of each of `lines`, up to a failure that is not `passed`.
fn answers<L: AsRef<str>>(
    sequence: &mut LineSequence<'_>,
    lines: &[L],
    passed: impl Fn(&LineFailure) -> bool,
) -> Result<Vec<Result<Vec<String>, LineFailure>>, Failure> {
    let mut replies = Vec::new();
    let mut failed = None;
    let mut progress = Progress::on_terminal();
    let run = sequence.run(lines, |reply| {
        progress.show(|_| format!("{} of {} lines", replies.len() + 1, lines.len()));
        match &reply.failure {
            Some(failure) if !passed(failure) => failed = Some(failure.message.clone()),
            Some(failure) => replies.push(Err(failure.clone())),
            None => replies.push(Ok(reply.lines.clone())),
        }
        failed.is_none()
    });
    progress.clear();
    run?;
    match lines.get(replies.len()) {
        None => Ok(replies),
        Some(line) => {
            let why = failed.unwrap_or_else(|| "not asked, the sequence was ended".to_owned());
            Err(Failure::Refused(format!("{}: {why}", line.as_ref())))
        }
    }
}
