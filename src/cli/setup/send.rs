//! `pmacctl setup` and `pmacctl board absolute` as commands: prints the answers, and sends set-up lines on request.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::lines::{self as setup, SetupCommand, Vme};
use super::{user, window};
use crate::cli::act::lines::LineError;
use crate::cli::console::{board_of, confirm, note, sending as question};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::setup::absolute::{self, Absolute};
use crate::cli::setup::answer::Explanation;
use crate::client::command::lines::LinesOptions;
use crate::client::{Connection, SerialError, SerialLine};
use crate::language::Meaning;
use crate::map::Family;
use crate::protocol::board::BoardInfo;
use crate::protocol::program_words::ProgramWords;
use crate::setup::absolute::AbsoluteFormat;
use crate::setup::position::Word;

/// Time limit of a plain line.
const LINE_WITHIN: Duration = Duration::from_secs(5);
/// How long the board may stay silent after a reset.
const AWAY: Duration = Duration::from_secs(20);

/// `setup`.
#[derive(Debug, Args)]
pub struct Setup {
    #[command(subcommand)]
    pub part: Part,
    #[command(flatten)]
    pub sending: Sending,
}

/// What is set up: the board, the host's VME bridge, or pmacd.
#[derive(Debug, Subcommand)]
pub enum Part {
    #[command(flatten)]
    Board(SetupCommand),
    /// Print [[user]] tables for pmacd's configuration, from the M-variables that point into the DPRAM's user area
    User,
}

/// Whether and how to send the lines.
#[derive(Debug, Args)]
pub struct Sending {
    /// Send the lines to the board after asking, through the daemon or with --port over a serial line
    #[arg(long, global = true)]
    pub send: bool,
    /// Send without asking
    #[arg(long, global = true, requires = "send")]
    pub yes: bool,
    /// The serial line to send over, for a board whose DPRAM is not enabled yet
    #[arg(long, global = true, requires = "send", value_name = "PATH")]
    pub port: Option<PathBuf>,
    /// The serial line's rate: 1200 to 115200
    #[arg(long, global = true, requires = "port", value_name = "RATE", default_value_t = 9600)]
    pub baud: u32,
}

pub fn run(context: &mut Context, options: &Setup) -> Result<Verdict, Failure> {
    let sending = &options.sending;
    let Part::Board(command) = &options.part else {
        if sending.send {
            return Err(Failure::Request(
                "setup user prints tables for pmacd and sends nothing: leave --send out".to_owned(),
            ));
        }
        return user::run(context);
    };
    if let SetupCommand::Vme(vme @ Vme { window: Some(node), .. }) = command {
        if sending.send {
            return Err(Failure::Request(
                "--window sets this host's bridge and sends nothing: leave --send out".to_owned(),
            ));
        }
        return print(context, &window::set(vme, node)?);
    }
    let servo_runs = sending.send && sending.port.is_none() && servo_runs(context);
    let mut command = command.clone();
    let mut serial = match &sending.port {
        Some(port) => Some(SerialLine::open(port, sending.baud).map_err(Failure::request)?),
        None => None,
    };
    match &mut serial {
        Some(serial) => told_over(serial, &mut command)?,
        None if command.board().family.is_some() => {}
        None => command.board().family = context.board_family()?.map(|(family, _)| family),
    }
    let answer = setup::answer(&command, servo_runs).map_err(Failure::Request)?;
    if !sending.send {
        return print(context, &answer);
    }
    let commands = &answer.commands;
    if serial.is_none() {
        let mut connection = context.connection()?;
        is_for(Context::family(None, &mut connection)?, &mut command)?;
        leaves_programs_words(&connection.info()?, &command)?;
    }
    // Print the lines before asking. JSON is printed at the end, with the result.
    if !context.output.is_json() {
        context.output.text(&answer.text)?;
        context.output.flush()?;
    }
    let place = match &sending.port {
        Some(port) => port.display().to_string(),
        None => board_of(context)?,
    };
    if !confirm(&question(commands.len(), &place), sending.yes)? {
        return Ok(Verdict::No);
    }
    let sent = match &mut serial {
        Some(serial) => send_over(serial, commands),
        None => send(&mut context.connection()?, commands),
    };
    report(context, answer.document, commands, sent)
}

/// Asks the board at the serial line for its family, and refuses lines for another family. After an unknown `TYPE` the
/// user decides.
fn told_over(serial: &mut SerialLine, command: &mut SetupCommand) -> Result<(), Failure> {
    let answer = serial.send("TYPE", LINE_WITHIN).map_err(LineError::from)?.concat();
    match Family::of_type(&answer) {
        Some(board) => {
            command.board().family.get_or_insert(board);
            is_for(board, command)
        }
        None if command.board().family.is_some() => Ok(()),
        None => Err(Failure::Request(format!(
            "TYPE answers {answer:?}, which tells no family: give --family pmac, pmac2, turbo or turbo2"
        ))),
    }
}

/// Refuses lines for another generation than the board's: their variables and addresses have other meanings there.
fn is_for(board: &'static Family, command: &mut SetupCommand) -> Result<(), Failure> {
    if board.generation == command.board().known().generation {
        return Ok(());
    }
    let title = board.title;
    Err(Failure::Request(format!(
        "the board is a {title}: give --family {}, or without --send only print the lines",
        board.name
    )))
}

/// Refuses to enable functions whose words M-variables of the board use.
fn leaves_programs_words(info: &BoardInfo, command: &SetupCommand) -> Result<(), Failure> {
    let SetupCommand::Enable(enable) = command else { return Ok(()) };
    let is_held = |words: &&ProgramWords| enable.functions.contains(&words.function) && !words.used;
    match info.program_words.iter().find(is_held) {
        Some(words) => {
            Err(Failure::Refused(format!("{words}; nothing was sent: its lines would write over that")))
        }
        None => Ok(()),
    }
}

/// Whether the servo report of the daemon's board runs. Without an answer, assume that it is off, as after a reset.
fn servo_runs(context: &Context) -> bool {
    let info = context.connection().ok().and_then(|mut connection| connection.info().ok());
    info.is_some_and(|info| info.enabled.iter().any(|name| name == "servo"))
}

pub fn absolute(context: &mut Context, options: &Absolute) -> Result<Verdict, Failure> {
    let format = absolute::format(options).map_err(Failure::Request)?;
    let given = options.words.clone();
    let words = if given.is_empty() { words_on_board(context, &format) } else { given };
    print(context, &absolute::answer(options, &format, &words).map_err(Failure::Request)?)
}

/// The content of the registers of `format` on the board; empty unless a daemon has a board of that generation.
fn words_on_board(context: &Context, format: &AbsoluteFormat) -> Vec<Word> {
    let Some(mut connection) = context.connection().ok().filter(|_| !format.registers.is_empty()) else {
        return Vec::new();
    };
    let family = connection.info().ok().and_then(|info| Family::by_name(&info.family).ok());
    let mut words = Vec::new();
    for part in &format.registers {
        let address = part.address;
        if family.is_none_or(|family| family.generation != address.generation) {
            return Vec::new();
        }
        let line = format!("RH{}${:X}", address.space, address.number);
        let lines = match connection.question(&line, LINE_WITHIN) {
            Ok(lines) => lines,
            Err(error) => {
                note(format!("{address} was not read: {error}"));
                return Vec::new();
            }
        };
        let Some(value) = lines.first().and_then(|line| u32::from_str_radix(line.trim(), 16).ok()) else {
            note(format!("{address} was not read: {lines:?} is no word"));
            return Vec::new();
        };
        words.push(Word { space: address.space, number: address.number, value });
    }
    let read: Vec<String> = words.iter().map(Word::to_string).collect();
    note(format!("on the board: {}", read.join(" ")));
    words
}

fn print(context: &mut Context, answer: &Explanation) -> Result<Verdict, Failure> {
    context.output.show(&answer.document, || &answer.text)?;
    Ok(Verdict::Yes)
}

/// Prints how many lines the board took, and why sending stopped.
struct Sent {
    taken: usize,
    error: Option<LineError>,
}

/// Has the daemon send the lines, as one sequence.
fn send(connection: &mut Connection, commands: &[String]) -> Sent {
    let mut taken = 0;
    let mut error = None;
    let options = LinesOptions { kind: "setup", timeout: LINE_WITHIN, keep_going: false };
    let over = connection.run_lines(options, commands, |reply| {
        match &reply.failure {
            None => taken += 1,
            Some(failure) => error = Some(LineError::of(failure, &reply.lines)),
        }
        true
    });
    let ended = match over {
        Ok(over) => over.failure.map(|failure| LineError::of(&failure, &[])),
        Err(error) => Some(error.into()),
    };
    Sent { taken, error: error.or(ended) }
}

/// Sends the lines over a serial line.
fn send_over(serial: &mut SerialLine, commands: &[String]) -> Sent {
    for (taken, line) in commands.iter().enumerate() {
        if let Err(error) = send_line(serial, line) {
            return Sent { taken, error: Some(error.into()) };
        }
    }
    Sent { taken: commands.len(), error: None }
}

/// Sends one line. The board need not acknowledge a reset; the command then waits until the board answers again.
fn send_line(serial: &mut SerialLine, line: &str) -> Result<(), SerialError> {
    let meaning = Meaning::of(line);
    match serial.send(line, meaning.deadline(LINE_WITHIN)) {
        Err(SerialError::TimedOut | SerialError::NoBoard { .. }) if meaning.resets => {}
        sent => drop(sent?),
    }
    if meaning.resets { serial.answers_within(AWAY) } else { Ok(()) }
}

fn report(
    context: &mut Context,
    mut document: Value,
    commands: &[String],
    sent: Sent,
) -> Result<Verdict, Failure> {
    let (taken, rest) = commands.split_at(sent.taken);
    if context.output.is_json() {
        if let Value::Object(fields) = &mut document {
            fields.insert("sent".to_owned(), json!(taken));
            let error = sent.error.as_ref().map(|error| error.document());
            fields.insert("error".to_owned(), json!(error));
        }
        context.output.json(&document)?;
    } else {
        for line in taken {
            context.output.line(format_args!("sent {line}"))?;
        }
    }
    context.output.flush()?;
    let Some(error) = sent.error else { return Ok(Verdict::Yes) };
    note(stopped(taken, rest));
    Err(error.into())
}

/// Where sending stopped, without the reason.
fn stopped(taken: &[String], rest: &[String]) -> String {
    let (failed, unsent) = rest.split_at(rest.len().min(1));
    let list = |lines: &[String]| if lines.is_empty() { "none".to_owned() } else { lines.join(", ") };
    format!("done: {}; failed: {}; not sent: {}", list(taken), list(failed), list(unsent))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_sent_and_what_was_not_is_said() {
        let lines = |lines: &[&str]| lines.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>();
        assert_eq!(
            stopped(&lines(&["I19=1"]), &lines(&["I59=2", "SAVE", "$$$"])),
            "done: I19=1; failed: I59=2; not sent: SAVE, $$$"
        );
        assert_eq!(stopped(&[], &lines(&["I19=1"])), "done: none; failed: I19=1; not sent: none");
    }
}
