//! The lines before a downloaded file that put the board into a known state, as PEWIN sends them.

use clap::ValueEnum;

use crate::cli::console::{board_of, confirm, note};
use crate::cli::context::{Context, Failure};
use crate::preprocess::{Place, SourceLine};

/// The lines that a prologue has on request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Clears {
    /// DISABLE PLC 0..31: PLC programs stop
    Plcs,
    /// UNDEFINE ALL: the axis definitions of all coordinate systems are lost
    Undefine,
}

impl Clears {
    const fn line(self) -> &'static str {
        match self {
            Self::Plcs => "DISABLE PLC 0..31",
            Self::Undefine => "UNDEFINE ALL",
        }
    }

    /// The effect of the line on the machine.
    const fn effect(self) -> &'static str {
        match self {
            Self::Plcs => "PLC programs 0 to 31 STOP, and stay disabled until ENABLE PLC",
            Self::Undefine => "the axis definitions of all coordinate systems are lost",
        }
    }
}

/// The lines of a prologue with `clears`. `CLOSE` comes first: in a buffer that another host left open the others would be
/// statements. Where a client of the daemon has a buffer open, the daemon begins no download.
pub fn lines(clears: &[Clears]) -> Vec<SourceLine> {
    let asked = [Clears::Plcs, Clears::Undefine].into_iter().filter(|line| clears.contains(line));
    let texts = ["CLOSE", "DELETE GATHER"].into_iter().chain(asked.map(Clears::line));
    let place = |line| Place { file: "--prologue".to_owned(), line };
    texts.zip(1..).map(|(text, line)| SourceLine { place: place(line), text: text.to_owned() }).collect()
}

/// Tells the lines of a prologue before they are sent. Asks, unless `yes`, where they stop PLC programs or undefine axes.
/// False: the user said no.
pub fn tell(context: &Context, clears: &[Clears], yes: bool) -> Result<bool, Failure> {
    let lines: Vec<String> = lines(clears).into_iter().map(|line| line.text).collect();
    let first = format!("before the file: {}", lines.join(", "));
    if clears.is_empty() || yes {
        note(first);
        return Ok(true);
    }
    let effects: Vec<&str> = clears.iter().map(|clears| clears.effect()).collect();
    let question = format!("{first}. On {}, {}. Send it?", board_of(context)?, effects.join("; "));
    confirm(&question, false)
}
