//! `pmacctl rotary encode` and `rotary decode`: motion programs to binary rotary commands and back. Neither needs a
//! board or a daemon. `rotary stream` feeds a board; `rotary check` has the board list the commands that it got.

mod check;
mod source;
mod stream;
pub mod words;

use clap::{Args, Subcommand};

use self::check::Check;
use self::source::{Format, compiled, read, warn};
use self::stream::Stream;
use self::words::{pairs, words};
use crate::cli::args::values::family;
use crate::cli::context::{Context, Failure, Verdict};
use crate::map::Family;
use crate::preprocess::shown;
use crate::rotary::{Settings, decompile};

#[derive(Debug, Args)]
pub struct Rotary {
    #[command(subcommand)]
    pub command: RotaryCommand,
}

#[derive(Debug, Subcommand)]
pub enum RotaryCommand {
    /// Compile a motion program to the words of a binary rotary buffer, and report errors with their places
    Encode(Encode),
    /// Decode the words of a binary rotary buffer to text
    Decode(Decode),
    /// Check that the board reads binary commands as they are meant: send some, and compare what it lists. Nothing runs
    Check(Check),
    /// Compile a motion program and feed it to the board through a binary rotary buffer
    Stream(Stream),
}

#[derive(Debug, Args)]
pub struct Encode {
    /// The program's text, constants only; - is stdin
    #[arg(value_name = "FILE")]
    pub file: String,
    #[command(flatten)]
    pub format: OfFamily,
}

#[derive(Debug, Args)]
pub struct Decode {
    /// A file of words as encode prints them, plain or JSON (- is stdin), or two or more words
    #[arg(value_name = "FILE|WORD", required = true)]
    pub input: Vec<String>,
    #[command(flatten)]
    pub format: OfFamily,
}

/// The format on a board that is not asked.
#[derive(Debug, Args)]
pub struct OfFamily {
    /// The board's family: it says which motors HOME can name
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    #[command(flatten)]
    pub format: Format,
}

impl OfFamily {
    fn settings(&self) -> Result<Settings, Failure> {
        self.format.over(&Settings::default().of(self.family))
    }
}

pub fn run(context: &mut Context, options: &Rotary) -> Result<Verdict, Failure> {
    match &options.command {
        RotaryCommand::Encode(options) => encode(context, options),
        RotaryCommand::Decode(options) => decode(context, options),
        RotaryCommand::Check(options) => check::run(context, options),
        RotaryCommand::Stream(options) => stream::run(context, options),
    }
}

fn encode(context: &mut Context, options: &Encode) -> Result<Verdict, Failure> {
    let program = compiled(&options.file, &options.format.settings()?)?;
    let commands = program.documents();
    if context.output.is_json() {
        context.output.json(&commands.collect::<Vec<_>>())?;
    } else {
        for command in commands {
            let (place, words) = ((command.line, command.column), (command.word1, command.word2));
            context
                .output
                .line(format_args!("{} {}  ; {}:{} {}", words.0, words.1, place.0, place.1, command.text))?;
        }
    }
    Ok(Verdict::Yes)
}

fn decode(context: &mut Context, options: &Decode) -> Result<Verdict, Failure> {
    let settings = options.format.settings()?;
    let (name, words) = match &options.input[..] {
        [file] => {
            let name = shown(file);
            let words = words(&read(file)?).map_err(|error| Failure::Request(format!("{name}: {error}")))?;
            (name, words)
        }
        several => {
            let words = pairs(several.iter().map(String::as_str)).map_err(Failure::Request)?;
            ("words".to_owned(), words)
        }
    };
    let decompiled =
        decompile(&words, &settings).map_err(|error| Failure::Refused(format!("{name}: {error}")))?;
    warn("text", &decompiled.notes);
    if context.output.is_json() {
        context.output.json(&decompiled.program.documents().collect::<Vec<_>>())?;
    } else {
        for line in &decompiled.program.lines {
            context.output.line(line.text())?;
        }
    }
    Ok(Verdict::Yes)
}
