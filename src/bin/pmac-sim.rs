//! The simulated board as a program.

use std::process::ExitCode;

use clap::Parser;
use pmac_dpram::format::Visible;
use pmac_dpram::process::{abort_on_panic, capabilities, survive_file_size_limit};
use pmac_dpram::sim::process::Simulator;
use pmac_dpram::sim::process::options::Options;
use pmac_dpram::usage::usage;

fn main() -> ExitCode {
    abort_on_panic();
    // Without this the kernel kills the program silently when a file outgrows its limit.
    let _ = survive_file_size_limit();
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) => return usage("pmac-sim", &error),
    };
    let simulator = match Simulator::new(&options) {
        Ok(simulator) => simulator,
        Err(error) => return refuse(&error.to_string()),
    };
    // All files are open, and only one thread runs: the program needs root's rights no more.
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

/// Reports a request that the program cannot carry out, and gives the exit status.
fn refuse(why: &str) -> ExitCode {
    eprintln!("pmac-sim: {}", Visible(why));
    ExitCode::from(2)
}
