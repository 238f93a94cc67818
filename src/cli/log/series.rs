//! The files of a series: their names, and the files in a directory that belong to the series.

use std::ffi::OsStr;
use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

use crate::cli::context::Failure;

/// Digits of a file's number, at least.
const DIGITS: usize = 6;
/// The highest number: a file with the date in its name (`run-20261126.csv`) belongs to no series.
pub(super) const HIGHEST_NUMBER: u64 = 9_999_999;

/// The file `number` of the series `path`: `log.csv` becomes `log-000012.csv`. 0 means no series.
pub(super) fn place(path: &Path, number: u64) -> PathBuf {
    if number == 0 {
        return path.to_owned();
    }
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number:0DIGITS$}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// The user's own files of the series `path`: the number, path and bytes of each. In a directory where other users may
/// create files, their files neither count nor are removed, and take no number; the same holds for a second name of the
/// user's own file, which another user may have given it.
pub(super) fn series(path: &Path) -> io::Result<Vec<(u64, PathBuf, u64)>> {
    let directory = path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
    let number = |name: &OsStr| {
        let (stem, rest) = (path.file_stem()?.to_str()?, name.to_str()?);
        let digits = rest.strip_prefix(stem)?.strip_prefix('-')?;
        let digits = digits.strip_suffix(path.extension()?.to_str()?)?.strip_suffix('.')?;
        let number = digits.parse().ok().filter(|number| *number <= HIGHEST_NUMBER)?;
        (digits == format!("{number:0DIGITS$}")).then_some(number)
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(directory)? {
        let entry = entry?;
        if let Some(number) = number(&entry.file_name())
            && let Ok(metadata) = entry.metadata()
            && metadata.is_file()
            && metadata.uid() == geteuid().as_raw()
            && metadata.nlink() == 1
        {
            files.push((number, entry.path(), taken(&metadata)));
        }
    }
    Ok(files)
}

/// The bytes that a file takes on the disk: holes do not count.
fn taken(metadata: &Metadata) -> u64 {
    metadata.len().min(metadata.blocks().saturating_mul(512))
}

/// The highest number in the series; 0 for a series without files.
pub(super) fn newest(path: &Path) -> Result<u64, Failure> {
    let files = series(path).map_err(|error| Failure::Request(format!("{}: {error}", path.display())))?;
    Ok(files.into_iter().map(|(number, ..)| number).max().unwrap_or(0))
}
