//! `pmacctl abort` and `pmacctl kill`: control characters that overtake every queued line.

use clap::Args;
use serde_json::json;

use crate::cli::act::lines::LineError;
use crate::cli::args::values::number;
use crate::cli::console::{note, warn_if_late};
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::protocol::board::NO_CONTROL_CHARACTERS;
use crate::protocol::control;

/// `abort`.
#[derive(Debug, Args)]
pub struct Abort {
    /// Only these coordinate systems, by the control panel; by command line if the panel does not act within 100 ms
    #[arg(value_name = "C.S.", value_parser = number, conflicts_with = "all")]
    pub systems: Vec<u8>,
    /// Every coordinate system and motor, by ^A (the default). ^A closes the loops of killed motors
    #[arg(long)]
    pub all: bool,
    /// Keep the lines of all users that wait in the daemon. Without this pmacd drops them
    #[arg(long, conflicts_with = "systems")]
    pub keep_queue: bool,
}

pub fn abort(context: &mut Context, options: &Abort) -> Result<Verdict, Failure> {
    warn_if_late(|| abort_these(context, options))
}

fn abort_these(context: &mut Context, options: &Abort) -> Result<Verdict, Failure> {
    if options.systems.is_empty() {
        return send(context, control::ABORT, options.keep_queue);
    }
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    let mut failed = None;
    let mut sent = Vec::new();
    // Abort the others even if one of them fails.
    for &system in &options.systems {
        let line = format!("&{system}A");
        let taken = match check_numbers(family, false, &[system]) {
            // The daemon sends the line if the panel does not act, or if it does not use the panel.
            Ok(()) => connection.panel("stop", &[system]).map_err(LineError::from),
            Err(missing) => Err(LineError::NotSent(missing)),
        };
        match taken {
            Ok(()) => sent.push(line),
            Err(error) => drop(failed.get_or_insert((line, error))),
        }
    }
    if context.output.is_json() {
        let error = failed.as_ref().map(|(_, error)| error.document());
        context.output.json(&json!({ "sent": sent, "error": error }))?;
        context.output.flush()?;
    }
    match failed {
        None => Ok(Verdict::Yes),
        Some((line, LineError::Board { text, .. })) => Err(Failure::Refused(format!("{line}: {text}"))),
        Some((line, LineError::Uncertain { failure, .. })) => Err(failure.at(line)),
        Some((_, error)) => Err(error.into()),
    }
}

pub fn kill(context: &mut Context) -> Result<Verdict, Failure> {
    warn_if_late(|| send(context, control::KILL, false))
}

fn send(context: &mut Context, character: u8, keeps_queue: bool) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    let sent =
        if keeps_queue { connection.control_keeping_queue(character) } else { connection.control(character) };
    let sent = sent.map_err(LineError::from);
    if connection.info().is_ok_and(|info| info.lines.control_characters == Some(false)) {
        note(format_args!("pmacctl: {NO_CONTROL_CHARACTERS}"));
    }
    if context.output.is_json() {
        let name = control::name(character);
        let taken = sent.iter().map(|_| &name).collect::<Vec<_>>();
        let error = sent.as_ref().err().map(LineError::document);
        context.output.json(&json!({ "sent": taken, "error": error }))?;
        context.output.flush()?;
    }
    sent?;
    Ok(Verdict::Yes)
}
