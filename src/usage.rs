//! How the programs answer a command line that they cannot parse (layer 0).

use std::io::{self, Write};
use std::process::ExitCode;

use clap::error::ErrorKind;

/// Prints clap's message: help and version to stdout with status 0, an error to stderr as one line after `program`'s
/// name, with status 2.
#[must_use]
pub fn usage(program: &str, error: &clap::Error) -> ExitCode {
    usage_with(program, error, 2)
}

/// As [`usage`], with another exit status for an error.
#[must_use]
pub fn usage_with(program: &str, error: &clap::Error, status: u8) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            // A closed output is no error here: nobody reads the help.
            let _ = error.print();
            ExitCode::SUCCESS
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            ExitCode::from(status)
        }
        _ => {
            let _ =
                writeln!(io::stderr(), "{program}: {}; see {program} --help", one_line(&error.to_string()));
            ExitCode::from(status)
        }
    }
}

/// Clap's message without its hints and its usage.
fn one_line(text: &str) -> String {
    let what = text.split("\n\n").next().unwrap_or_default();
    let what = what.split_whitespace().collect::<Vec<_>>().join(" ");
    what.strip_prefix("error: ").unwrap_or(&what).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistake_takes_one_line() {
        let text = "error: the following required arguments were not provided:\n  <ADDR>...\n\nUsage: pmacctl read\n";
        assert_eq!(one_line(text), "the following required arguments were not provided: <ADDR>...");
    }
}
