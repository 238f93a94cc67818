//! The simulated board as a program.

use std::process::ExitCode;

use clap::Parser;
use clap::error::ErrorKind;
use pmac_dpram::sim::options::Options;
use pmac_dpram::sim::process::Simulator;

fn main() -> ExitCode {
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            print!("{error}");
            return ExitCode::SUCCESS;
        }
        Err(error) => return refuse(&one_line(&error.to_string())),
    };
    let simulator = match Simulator::new(&options) {
        Ok(simulator) => simulator,
        Err(error) => return refuse(&error.to_string()),
    };
    match simulator.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("pmac-sim: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The request could not be made.
fn refuse(why: &str) -> ExitCode {
    eprintln!("pmac-sim: {why}");
    ExitCode::from(2)
}

/// The sentence of a usage error, without the usage that follows it.
fn one_line(error: &str) -> String {
    let sentence =
        error.split("\n\nUsage").next().unwrap_or(error).split("\n\nFor more").next().unwrap_or(error);
    let words: Vec<&str> = sentence.trim_start_matches("error: ").split_whitespace().collect();
    format!("{}; see --help", words.join(" "))
}
