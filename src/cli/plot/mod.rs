//! `pmacctl plot`, and the pictures of `gather`, `log` and `tune`.

mod figure;
mod letters;
mod of_table;
mod scale;
mod scene;
mod svg;
mod trace;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;

pub use self::figure::{Figure, Panel, Trace};
use crate::cli::console::is_stdout;
use crate::cli::console::sink::put;
use crate::cli::context::{Failure, Verdict};
use crate::table::Table;

/// The largest file to draw: the program holds all of it in memory, several times over.
const MOST_BYTES: u64 = 1 << 30;

/// `plot`.
#[derive(Debug, Args)]
pub struct Plot {
    /// A file that gather or log wrote: .csv or .npy
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The picture, ending in .svg; - is stdout
    #[arg(long, short, value_name = "FILE")]
    output: PicturePath,
    /// Only these columns, named as in the file, and differences of two: 1.commanded_position-1.actual_position
    /// [default: all but times and status words]
    #[arg(long, value_name = "NAME,NAME", value_delimiter = ',')]
    columns: Vec<String>,
}

pub fn run(options: &Plot) -> Result<Verdict, Failure> {
    draw_file(&options.file, &options.columns, &options.output)?;
    Ok(Verdict::Yes)
}

/// The destination of a picture.
#[derive(Debug, Clone)]
pub struct PicturePath(PathBuf);

impl std::str::FromStr for PicturePath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        if !is_stdout(&path) && path.extension().is_none_or(|extension| extension != "svg") {
            return Err("the name must end in .svg; - is stdout".to_owned());
        }
        let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty());
        match directory.map(fs::metadata) {
            Some(Err(error)) => Err(format!("its directory: {error}")),
            Some(Ok(found)) if !found.is_dir() => Err("it would be in what is no directory".to_owned()),
            _ => Ok(Self(path)),
        }
    }
}

/// Draws the table in the file `from`: the named columns, or without names the program's choice.
///
/// # Errors
/// [`Failure`], which names the file.
pub fn draw_file(from: &Path, columns: &[String], to: &PicturePath) -> Result<(), Failure> {
    let name = from.display();
    let failed = |error: io::Error| Failure::Request(format!("{name}: {error}"));
    check_drawable(from)?;
    if fs::metadata(from).map_err(failed)?.len() > MOST_BYTES {
        return Err(Failure::Request(format!("{name}: too large to draw; a picture takes 1 GiB at most")));
    }
    let table = Table::parse(&fs::read(from).map_err(failed)?)
        .map_err(|error| Failure::Request(format!("{name}: {error}")))?;
    let title = from.file_name().unwrap_or(from.as_os_str()).to_string_lossy().into_owned();
    draw(&of_table::figure(&table, columns, title)?, to)
}

/// Refuses to draw a pipe or stdout, which no reader can read from the beginning. A file that does not exist yet is
/// allowed.
///
/// # Errors
/// [`Failure::Request`], which names the path.
pub fn check_drawable(path: &Path) -> Result<(), Failure> {
    if is_stdout(path) || fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(Failure::Request(format!("{}: only a file can be drawn", path.display())));
    }
    Ok(())
}

/// Draws `figure`.
///
/// # Errors
/// [`Failure`], which names the file.
pub fn draw(figure: &Figure, PicturePath(path): &PicturePath) -> Result<(), Failure> {
    let svg = svg::svg(&figure::scene(figure));
    if is_stdout(path) {
        return Ok(io::stdout().write_all(svg.as_bytes())?);
    }
    put(path, svg.as_bytes())
}
