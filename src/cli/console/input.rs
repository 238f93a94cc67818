//! Input files. `-` is stdin.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// At most the first `most` bytes of a file.
///
/// # Errors
/// The system's error.
pub fn read_some(path: impl AsRef<Path>, most: u64) -> io::Result<Vec<u8>> {
    let (path, mut bytes) = (path.as_ref(), Vec::new());
    let mut source: Box<dyn Read> =
        if path == Path::new("-") { Box::new(io::stdin().lock()) } else { Box::new(File::open(path)?) };
    source.by_ref().take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The bytes of a file that has at most `most`.
///
/// # Errors
/// The reason without the file's name.
pub fn read(path: impl AsRef<Path>, most: u64) -> Result<Vec<u8>, String> {
    let bytes = read_some(path, most + 1).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > most { Err(format!("longer than {} MiB", most >> 20)) } else { Ok(bytes) }
}
