//! `pmacctl send`: sends a command line or a control character, and prints the board's reply.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;

use crate::cli::act::lines::entered_note;
use crate::cli::args::values::line_timeout;
use crate::cli::console::{note, warn_if_late};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::programs::what_runs;
use crate::client::CommandError;
use crate::client::command::SendAs;
use crate::language::{Meaning, deadlines};
use crate::map::errors;
use crate::protocol::board::SendReply;
use crate::protocol::{CallError, check_line, control};

#[derive(Debug, Args)]
pub struct Send {
    /// The line in quotes, as '#1P', or one control character as '^K'
    #[arg(value_name = "LINE", allow_hyphen_values = true)]
    pub line: Option<String>,
    /// Taken so that the message can say how to quote them
    #[arg(hide = true)]
    pub more: Vec<String>,
    /// Time limit for the reply, in seconds [default: 5, more for slow lines such as SAVE]
    #[arg(long, value_name = "S", value_parser = line_timeout, allow_negative_numbers = true)]
    pub timeout: Option<Duration>,
    /// Print control characters in the reply unchanged, not as \x1b
    #[arg(long)]
    pub raw: bool,
    /// Also send lines that pmacd refuses otherwise: ^Z and I58=0, which end command lines for everybody; $$$ and SAVE
    /// while other users' work runs; starts (&1R, ^R) of lines that a rotary stream left
    #[arg(long)]
    pub yes: bool,
}

pub fn run(context: &mut Context, options: &Send) -> Result<Verdict, Failure> {
    let line = one_line(options)?;
    let control = control::parse(line).filter(|_| line.len() == 2);
    if control.is_none() {
        check_line(line).map_err(|reason| Failure::Request(format!("invalid line: {reason}")))?;
    }
    let timeout = options.timeout.unwrap_or_else(|| Meaning::of(line).deadline(deadlines::PLAIN));
    let send = || -> Result<_, Failure> {
        let mut connection = context.connection()?.confirming(options.yes);
        let begun = Instant::now();
        Ok(match control {
            Some(character) => connection.control(character).map(|lines| SendReply { lines, entered: None }),
            None => match connection.send_and_see(line, timeout, SendAs::default()) {
                Err(CommandError::Refused(CallError::TimedOut { lines }))
                    if lines.is_empty() && Meaning::of(line).resets && begun.elapsed() < timeout =>
                {
                    // The call ended before its time-out: the board has taken the line.
                    let why =
                        "sent; no board has to acknowledge a reset. pmacctl status shows when it is back";
                    note(why);
                    Ok(SendReply { lines: Vec::new(), entered: None })
                }
                reply => reply,
            },
        })
    };
    let stops =
        control.is_some_and(|character| [control::ABORT, control::KILL, control::HOLD].contains(&character));
    let reply = if stops { warn_if_late(send) } else { send() }?;
    let json = context.output.is_json();
    match reply {
        Ok(SendReply { lines, entered }) => {
            if let Some(open) = entered {
                note(entered_note(line, &open));
            }
            if json {
                context.output.json(&json!({ "lines": lines, "error": null }))?;
            } else {
                print(context, &lines, options.raw)?;
            }
        }
        Err(error) => {
            // Lines before the error belong to the reply, so print them first.
            let (code, meaning, lines) = parts(&error);
            if json {
                let error = json!({ "code": code, "meaning": meaning });
                context.output.json(&json!({ "lines": lines, "error": error }))?;
            } else {
                print(context, lines, options.raw)?;
            }
            context.output.flush()?;
            if let Some(what_runs) = board_runs(context, code) {
                note(what_runs);
            }
            if let Some(first) = comes_first(code, line) {
                note(first);
            }
            return Err(error.into());
        }
    }
    Ok(Verdict::Yes)
}

/// The line to send: one argument, no more and no less.
fn one_line(options: &Send) -> Result<&str, Failure> {
    let quote = |line: &str| format!("quote it: pmacctl send '{line}'");
    match (&options.line, &options.more[..]) {
        (Some(line), []) if !line.trim().is_empty() => Ok(line),
        (None, _) | (Some(_), []) => Err(Failure::Request(format!(
            "send needs a line, and the shell takes what stands behind a # or an & for itself: {}",
            quote("#1P")
        ))),
        (Some(line), more) => {
            let all = format!("{line} {}", more.join(" "));
            Err(Failure::Request(format!(
                "send takes one line, and got {} arguments; nothing was sent; {}",
                more.len() + 1,
                quote(&all)
            )))
        }
    }
}

/// The running programs, if the board refused the line because of one.
fn board_runs(context: &Context, code: Option<u16>) -> Option<String> {
    (code == Some(errors::PROGRAM_RUNS)).then(|| what_runs(&mut context.board().ok()?)).flatten()
}

/// The command that must come first, for commands that a board refuses without this hint (Software Reference pp. 215,
/// 273).
fn comes_first(code: Option<u16>, line: &str) -> Option<&'static str> {
    const FIRST: &[(&str, &str)] = &[
        ("OPENROT", "no rotary buffer is defined: DEFINE ROT comes before OPEN ROT"),
        ("LOOKAHEAD", "a gather buffer bars a lookahead buffer: DELETE GATHER comes before DEFINE LOOKAHEAD"),
    ];
    let plain: String = line.split_ascii_whitespace().collect::<String>().to_ascii_uppercase();
    let known = FIRST.iter().filter(|_| code == Some(errors::UNRECOGNIZED));
    known.into_iter().find(|(command, _)| plain.contains(command)).map(|(_, first)| *first)
}

/// The board's error number, if the board refused the line; the message; the reply lines that arrived.
fn parts(error: &CommandError) -> (Option<u16>, String, &[String]) {
    match error {
        CommandError::Refused(CallError::Board { code, meaning, lines }) => {
            (Some(*code), meaning.clone(), lines)
        }
        CommandError::Refused(CallError::TimedOut { lines }) => (None, error.to_string(), lines),
        _ => (None, error.to_string(), &[]),
    }
}

fn print(context: &mut Context, lines: &[String], raw: bool) -> Result<(), Failure> {
    for line in lines {
        context.output.reply(line, raw)?;
    }
    Ok(())
}
