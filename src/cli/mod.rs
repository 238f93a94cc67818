//! The command line (layer 6).

use std::process::ExitCode;

/// Prints what clap has to say: help and version on stdout with status 0, a mistake in one line with status 2.
#[must_use]
pub fn usage(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        let text = error.to_string();
        let line = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
        eprintln!("{line}; --help tells more");
        ExitCode::from(2)
    } else {
        print!("{error}");
        ExitCode::SUCCESS
    }
}
