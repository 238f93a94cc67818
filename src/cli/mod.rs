//! The command line `pmacctl` (layer 6).
//!
//! Exit status: 0 done; 1 the answer is "no", or the board reported an error; 2 the request could not be made.
//! Data go to stdout, everything else to stderr. A reader that goes away (`pmacctl … | head`) ends it quietly.

pub mod absolute;
pub mod answer;
mod args;
mod ask;
mod backup;
mod coordinates;
mod decode;
mod demo;
mod doctor;
mod doctor_machine;
mod download;
mod gather;
mod gather_board;
mod gather_file;
mod interrupt;
mod keys;
mod lines;
mod map;
mod motors;
mod output;
mod panel;
pub mod preprocess;
mod read;
mod rotary;
mod rotary_progress;
mod rotary_stream;
pub mod rotary_words;
mod screen;
mod send;
mod set_up;
pub mod setup;
mod sink;
mod status;
mod stop;
mod table;
mod terminal;
mod time;
mod variable;
pub mod variables;
mod watch;
mod write;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use crate::client::{Board, ClientError, CommandError, Connection, socket_path};
use crate::protocol::CallError;
use crate::segment::SegmentName;
use crate::usage::usage;

use args::{Args, Command};
use output::Output;

/// What can be typed, for manual pages and completions.
#[must_use]
pub fn command() -> clap::Command {
    Args::command()
}

/// How a command ended that was carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Exit status 0.
    Yes,
    /// Exit status 1.
    No,
}

impl From<bool> for Verdict {
    fn from(yes: bool) -> Self {
        if yes { Self::Yes } else { Self::No }
    }
}

/// Why a command was not carried out.
#[derive(Debug, thiserror::Error)]
enum Failure {
    /// The request could not be made: exit status 2.
    #[error("{0}")]
    Request(String),
    /// The board or the daemon said no: exit status 1. Printed without the program's name, as the board's own words.
    #[error("{0}")]
    Refused(String),
    /// The output could not be written.
    #[error("writing the output: {0}")]
    Output(#[from] io::Error),
}

impl Failure {
    fn request(error: impl std::fmt::Display) -> Self {
        Self::Request(error.to_string())
    }

    /// The same, with where it happened before it.
    fn at(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Refused(text) => Self::Refused(format!("{place}: {text}")),
            Self::Request(text) => Self::Request(format!("{place}: {text}")),
            output @ Self::Output(_) => output,
        }
    }
}

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        Self::request(error)
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        match &error {
            CommandError::Refused(
                CallError::Board { .. }
                | CallError::TimedOut { .. }
                | CallError::Unavailable { .. }
                | CallError::Busy
                | CallError::NotPermitted { .. }
                | CallError::Refused { .. }
                | CallError::OutOfRange,
            ) => Self::Refused(error.to_string()),
            _ => Self::request(error),
        }
    }
}

/// What every command works with.
struct Context {
    name: SegmentName,
    socket: std::path::PathBuf,
    output: Output,
}

impl Context {
    fn board(&self) -> Result<Board, Failure> {
        Ok(Board::attach(self.name.as_str())?.with_socket(&self.socket))
    }

    fn connection(&self) -> Result<Connection, Failure> {
        Ok(Connection::open(&self.socket)?)
    }
}

/// Mistakes in files that are told, at most.
const MISTAKES_MAX: usize = 50;

/// Says what is wrong in files of which nothing is used then, one mistake a line with its place.
fn mistaken(mistakes: Vec<preprocess::Mistake>) -> Failure {
    for mistake in mistakes.iter().take(MISTAKES_MAX) {
        // Nobody reads it: nothing to be done.
        let _ = writeln!(io::stderr(), "{mistake}");
    }
    let count = mistakes.len();
    Failure::Request(format!("{count} mistake{}; nothing was sent", if count == 1 { "" } else { "s" }))
}

/// Runs `pmacctl` with these arguments, the first of which is the program's name.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let args = match Args::try_parse_from(args) {
        Ok(args) => args,
        Err(error) => return usage("pmacctl", &error),
    };
    match execute(args) {
        Ok(Verdict::Yes) => ExitCode::SUCCESS,
        Ok(Verdict::No) => ExitCode::from(1),
        // Nobody reads any more, so nobody misses the rest.
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        // Not by `eprintln!`, which would panic when stderr is closed.
        Err(Failure::Refused(text)) => {
            let _ = writeln!(io::stderr(), "{text}");
            ExitCode::from(1)
        }
        Err(failure) => {
            let _ = writeln!(io::stderr(), "pmacctl: {failure}");
            ExitCode::from(2)
        }
    }
}

fn execute(args: Args) -> Result<Verdict, Failure> {
    let name = SegmentName::new(&args.global.name).map_err(Failure::request)?;
    let socket = args.global.socket.unwrap_or_else(|| socket_path(&name));
    let mut context = Context { name, socket, output: Output::new(args.global.json, args.global.quiet) };
    let verdict = match args.command {
        Command::Demo(options) => demo::run(&mut context, &options),
        Command::Status => status::run(&mut context),
        Command::Doctor(options) => doctor::run(&mut context, &options),
        Command::Motors => motors::run(&mut context),
        Command::Coordinates => coordinates::run(&mut context),
        Command::Watch(options) => watch::run(&mut context, &options),
        Command::Map(options) => map::run(&mut context, &options),
        Command::Read(options) => read::run(&mut context, &options),
        Command::Write(options) => write::run(&mut context, &options),
        Command::Panel(options) => panel::run(&mut context, &options),
        Command::Send(options) => send::run(&mut context, &options),
        Command::Decode(options) => decode::run(&mut context, &options),
        Command::Rotary(options) => rotary::run(&mut context, &options),
        Command::Variable(options) => variable::run(&mut context, &options),
        Command::Gather(options) => gather::run(&mut context, &options),
        Command::Abort(options) => stop::abort(&mut context, &options),
        Command::Kill => stop::kill(&mut context),
        Command::Terminal(options) => terminal::run(&mut context, &options),
        Command::Download(options) => download::run(&mut context, &options),
        Command::Backup(options) => backup::backup(&mut context, &options),
        Command::Diff(options) => backup::diff(&mut context, &options),
        Command::Restore(options) => backup::restore(&mut context, &options),
        Command::Setup(options) => set_up::run(&mut context, &options),
        Command::Absolute(options) => set_up::absolute(&mut context, &options),
    }?;
    context.output.flush()?;
    Ok(verdict)
}
