//! Writes the manual pages that the programs' own help makes into the directory named: `cargo run --example man -- DIR`.
//!
//! An example, so that nothing of it is in the programs.

use std::error::Error;
use std::fs::File;
use std::path::Path;

use clap::CommandFactory;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = std::env::args_os().nth(1).ok_or("write: man DIRECTORY")?;
    let directory = Path::new(&directory);
    std::fs::create_dir_all(directory)?;
    let pmacd = pmac_dpram::daemon::options::Options::command();
    clap_mangen::Man::new(pmacd).section("8").render(&mut File::create(directory.join("pmacd.8"))?)?;
    let pmac_sim = pmac_dpram::sim::process::options::Options::command();
    clap_mangen::Man::new(pmac_sim).render(&mut File::create(directory.join("pmac-sim.1"))?)?;
    clap_mangen::generate_to(pmac_dpram::cli::command(), directory)?;
    Ok(())
}
