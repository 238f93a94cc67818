//! The command line `pmacctl` (layer 6).
//!
//! Exit status: 0 done; 1 the answer is "no", or the board or the daemon refused; 2 the request could not be made.
//! Data go to stdout, everything else to stderr. A closed pipe (`pmacctl … | head`) ends the program quietly.
//!
//! | room | content |
//! |---|---|
//! | `args` | the command line |
//! | `show` | commands that only read: `status`, `motors`, `coordinates`, `motor`, `system`, `watch`, `demo`, `read`, `board map`, `board decode` |
//! | `top` | the screen: everything live, and jog keys |
//! | `act` | commands that do one thing on the board: `send`, `write`, `jog`, `home`, `run`, `set-position`, `panel`, `variable`, `abort`, `kill`, `terminal` |
//! | `gather`, `log`, `plot`, `rotary` | samples to a file; every update to a file; pictures; motion programs from a file |
//! | `files` | command files and settings: `download`, `backup`, `diff`, `restore` |
//! | `setup` | lines that set a board up, `board absolute` |
//! | `tune` | moves a motor and reports its response |
//! | `capture` | `board capture`: a board in a directory of plain files |
//! | `doctor` | faults and their cures |
//! | `explain` | I-variables, errors, addresses and status bits, as text |
//! | `console` | terminal, tables, output files, signals |

mod act;
mod args;
mod capture;
mod console;
mod context;
mod doctor;
mod explain;
mod files;
mod gather;
mod layout;
mod log;
mod plot;
mod rotary;
mod setup;
mod show;
mod top;
mod tune;

use std::ffi::OsString;
use std::io;
use std::process::ExitCode;

use crate::cli::console::note;
use crate::format::Visible;
use crate::process::survive_file_size_limit;
use crate::segment::end_on_bus_error;
use crate::usage::usage;

use act::{drive, jog, panel, registers, send, set_position, stop, terminal, write};
use args::{Args, Command, Global, Rare};
use console::Output;
use context::{Context, Failure, Verdict};
use files::{backup, download};
use show::watch::{self, Part};
use show::{bits, decode, demo, map, read, status};

pub use files::settings_file;
pub use rotary::words as rotary_words;

/// The command line's definition, for manual pages and completions.
#[must_use]
pub fn command() -> clap::Command {
    args::command()
}

/// The message when mapped memory is gone.
const SEGMENT_GONE: &str = "pmacctl: SIGBUS, memory that was mapped is gone: perhaps somebody has truncated the segment in /dev/shm; see to pmacd, \
    then start this again\n";

/// Runs `pmacctl`. The first argument is the program's name.
pub fn run(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    // Without this, a full file ends the program as before, and without a word.
    let _ = survive_file_size_limit();
    let _ = end_on_bus_error(SEGMENT_GONE, 2);
    let args = match args::parse(args) {
        Ok(args) => args,
        Err(error) => match args::right_verb(&error) {
            Some(text) => {
                note(format_args!("pmacctl: {text}"));
                return ExitCode::from(2);
            }
            None => return usage("pmacctl", &error),
        },
    };
    match execute(args) {
        Ok(Verdict::Yes) => ExitCode::SUCCESS,
        Ok(Verdict::No) => ExitCode::from(1),
        // The reader closed the pipe: end quietly.
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        // `eprintln!` would panic if stderr is closed.
        Err(Failure::Refused(text)) => {
            // The message may contain the board's text: show control characters as escapes.
            for line in text.split('\n') {
                note(Visible(line));
            }
            ExitCode::from(1)
        }
        Err(failure) => {
            for (index, line) in failure.to_string().split('\n').enumerate() {
                let program = if index == 0 { "pmacctl: " } else { "" };
                note(format_args!("{program}{}", Visible(line)));
            }
            ExitCode::from(2)
        }
    }
}

fn execute(args: Args) -> Result<Verdict, Failure> {
    let Global { name, socket, json, quiet } = args.global;
    let mut context = Context::new(name.as_deref(), socket, Output::new(json, quiet))?;
    let verdict = match args.command {
        Command::Demo(options) => demo::run(&mut context, &options),
        Command::Status => status::run(&mut context),
        Command::Doctor(options) => doctor::run(&mut context, &options),
        Command::Motors => watch::once(&mut context, Part::Motors),
        Command::Coordinates => watch::once(&mut context, Part::Coordinates),
        Command::Motor(options) => bits::motor(&mut context, &options),
        Command::System(options) => bits::system(&mut context, &options),
        Command::Explain(options) => explain::run(&mut context, &options),
        Command::Watch(options) => watch::run(&mut context, &options),
        Command::Top(options) => top::run(&mut context, &options),
        Command::Read(options) => read::run(&mut context, &options),
        Command::Write(options) => write::run(&mut context, &options),
        Command::Jog(options) => jog::run(&mut context, &options),
        Command::Home(options) => drive::home(&mut context, &options),
        Command::SetPosition(options) => set_position::run(&mut context, &options),
        Command::Run(options) => drive::run(&mut context, &options),
        Command::Resume(options) => drive::resume(&mut context, &options),
        Command::Step(options) => drive::step(&mut context, &options),
        Command::Hold(options) => drive::hold(&mut context, &options),
        Command::Panel(options) => panel::run(&mut context, &options),
        Command::Send(options) => send::run(&mut context, &options),
        Command::Rotary(options) => rotary::run(&mut context, &options),
        Command::Variable(options) => registers::run(&mut context, &options),
        Command::Gather(options) => gather::run(&mut context, &options),
        Command::Log(options) => log::run(&mut context, &options),
        Command::Plot(options) => plot::run(&options),
        Command::Tune(options) => tune::run(&mut context, &options),
        Command::Abort(options) => stop::abort(&mut context, &options),
        Command::Kill => stop::kill(&mut context),
        Command::Terminal(options) => terminal::run(&mut context, &options),
        Command::Download(options) => download::run(&mut context, &options),
        Command::Backup(options) => backup::backup(&mut context, &options),
        Command::Diff(options) => backup::diff(&mut context, &options),
        Command::Restore(options) => backup::restore(&mut context, &options),
        Command::Setup(options) => setup::send::run(&mut context, &options),
        Command::Board { command } | Command::Rare(command) => match command {
            Rare::Map(options) => map::run(&mut context, &options),
            Rare::Decode(options) => decode::run(&mut context, &options),
            Rare::Capture(options) => capture::run(&mut context, &options),
            Rare::Absolute(options) => setup::send::absolute(&mut context, &options),
        },
    }?;
    context.output.flush()?;
    Ok(verdict)
}
