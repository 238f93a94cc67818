//! The simulated board as a program.

use std::process::ExitCode;

use clap::Parser;
use pmac_dpram::format::Visible;
use pmac_dpram::process::{capabilities, survive_file_size_limit};
use pmac_dpram::sim::process::Simulator;
use pmac_dpram::sim::process::options::Options;
use pmac_dpram::usage::usage;

fn main() -> ExitCode {
    // Without this, a full file ends the program as before, and without a word.
    let _ = survive_file_size_limit();
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) => return usage("pmac-sim", &error),
    };
    let simulator = match Simulator::new(&options) {
        Ok(simulator) => simulator,
        Err(error) => return refuse(&error.to_string()),
    };
    // Everything is open, and one thread runs: nothing that root may do is needed any more.
    capabilities::empty_bounding();
    if let Err(error) = capabilities::give_up() {
        return refuse(&error.to_string());
    }
    match simulator.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("pmac-sim: {}", Visible(&error));
            ExitCode::FAILURE
        }
    }
}

/// The request could not be made.
fn refuse(why: &str) -> ExitCode {
    eprintln!("pmac-sim: {}", Visible(why));
    ExitCode::from(2)
}
