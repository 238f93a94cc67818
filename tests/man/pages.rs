//! Writes what the package ships besides its programs into the directory named, all made from the definitions of their command
//! lines: manual pages, and completions for bash, zsh and fish. `cargo run --example man -- DIR`
//!
//! An example, so that nothing of it is in the programs.

use std::error::Error;
use std::fs;
use std::path::Path;

use clap_complete::{Generator, Shell};

use completions::SHELLS;

mod command;
mod completions;
mod roff;
mod sections;
mod site;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = std::env::args_os().nth(1).ok_or("write: man DIRECTORY")?;
    let directory = Path::new(&directory);
    fs::create_dir_all(directory)?;
    for (file, text) in site::pages() {
        fs::write(directory.join(file), text)?;
    }
    for shell in SHELLS {
        let place = directory.join("completions").join(shell.to_string());
        fs::create_dir_all(&place)?;
        for program in site::programs() {
            let name = program.get_name().to_owned();
            // bash looks for a file of the program's name.
            let file = if shell == Shell::Bash { name.clone() } else { shell.file_name(&name) };
            fs::write(place.join(file), completions::completions(shell, program))?;
        }
    }
    Ok(())
}
