//! `pmacctl board capture`: a board in a directory of plain files ([`crate::recording`]). Only reads.

mod image;
mod latency;
mod private;
mod take;

use serde_json::json;

pub use self::private::without_users;
pub use self::take::{Capture, Taken};
use self::take::{Summary, Taking};
use crate::cli::console::{Interrupt, note};
use crate::cli::context::{Context, Failure, Verdict};

/// `capture`.
pub fn run(context: &mut Context, options: &Capture) -> Result<Verdict, Failure> {
    let taken = take(context, options)?;
    let Summary { updates, accesses, dropped, .. } = taken.summary;
    if context.output.is_json() {
        let document = json!({ "updates": updates, "accesses": accesses, "dropped": dropped,
            "cut_short": taken.summary.cut_short, "left_out": taken.summary.left_out });
        context.output.json(&document)?;
    } else {
        for sentence in &taken.summary.left_out {
            context.output.line(format_args!("left out: {sentence}"))?;
        }
        context.output.line(format_args!("updates={updates} accesses={accesses} dropped={dropped}"))?;
    }
    context.output.flush()?;
    if let Some(why) = &taken.summary.cut_short {
        note(format_args!("{}: cut short: {why}", options.directory.display()));
    }
    let is_whole = taken.summary.cut_short.is_none() && !taken.summary.lacks_answers;
    taken.failure.map_or(Ok(is_whole.into()), Err)
}

/// Makes a capture. Fails only before anything is written.
pub fn take(context: &Context, options: &Capture) -> Result<Taken, Failure> {
    let stop = Interrupt::listen()?;
    let mut board = context.board()?;
    let mut connection = context.connection()?;
    let mut taking = Taking::begin(&mut board, &mut connection, &context.socket(), stop, options)?;
    let failure = taking.record().err();
    taking.finish(failure)
}
