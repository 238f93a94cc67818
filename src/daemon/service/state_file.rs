//! The file in which the next start finds the blocks of M-variables that it asks for first.
//!
//! The file is in the service manager's `StateDirectory`; without that directory there is no file. If the daemon cannot
//! read or write the file, the next start only asks in the usual order.

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::thread;

use log::{debug, warn};

use crate::daemon::shared::definition_blocks::BLOCK;

/// The variable in which the service manager names the directory; the daemon takes the first of a list
/// (systemd.exec(5), `StateDirectory=`).
const DIRECTORY: &str = "STATE_DIRECTORY";
/// More than the longest file.
const LONGEST_STATE_FILE: u64 = 4096;

/// The file, if the service manager names a directory.
#[derive(Debug, Clone)]
pub struct StateFile {
    path: Option<PathBuf>,
}

impl StateFile {
    /// The file of the board called `name`.
    #[must_use]
    pub fn of(name: &str) -> Self {
        let directories = std::env::var_os(DIRECTORY).unwrap_or_default();
        let first = std::env::split_paths(&directories).find(|directory| directory.is_absolute());
        Self { path: first.map(|directory| directory.join(format!("{name}.m_variables"))) }
    }

    /// The blocks; none if the file is missing or broken.
    #[must_use]
    pub fn blocks(&self) -> u64 {
        let Some(path) = &self.path else { return 0 };
        match read(path) {
            Ok(text) => parse(&text).unwrap_or_else(|| {
                warn!("{} is broken and not used; the next one replaces it", path.display());
                0
            }),
            Err(error) => {
                debug!("{}: {error}", path.display());
                0
            }
        }
    }

    /// Writes the blocks. A disk may take long: a separate thread waits for it.
    pub fn keep(&self, blocks: u64) {
        let Some(path) = self.path.clone() else { return };
        let write = move || {
            if let Err(error) = write(&path, blocks) {
                warn!("{}: {error}; the next start asks for M-variables in the usual order", path.display());
            }
        };
        if let Err(error) = thread::Builder::new().name("state".to_owned()).spawn(write) {
            warn!("no thread writes which M-variables to ask for first: {error}");
        }
    }
}

fn read(path: &Path) -> io::Result<String> {
    use std::fs::OpenOptions;
    use std::io::Read;
    use std::os::unix::fs::OpenOptionsExt;

    // A FIFO under the name must not hold up the start.
    let flags = nix::fcntl::OFlag::O_NONBLOCK.bits();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    let mut text = String::new();
    file.take(LONGEST_STATE_FILE).read_to_string(&mut text)?;
    Ok(text)
}

/// The blocks that `text` lists by their first M-variables; `None` if `text` lists anything else.
fn parse(text: &str) -> Option<u64> {
    let words = text.lines().filter(|line| !line.starts_with('#')).flat_map(str::split_ascii_whitespace);
    words.into_iter().try_fold(0, |blocks, word| {
        let first: u16 = word.strip_prefix('M')?.parse().ok()?;
        let block = first / BLOCK;
        (first.is_multiple_of(BLOCK) && u32::from(block) < u64::BITS).then(|| blocks | 1 << block)
    })
}

/// Puts a whole file in the place of the old one.
fn write(path: &Path, blocks: u64) -> io::Result<()> {
    let mut text = format!(
        "# pmacd found M-variables that point into the DPRAM in these blocks of {BLOCK}, and asks for them first at its next start.\n"
    );
    for block in (0..64_u16).filter(|block| blocks >> block & 1 != 0) {
        let _ = writeln!(text, "M{}", block * BLOCK);
    }
    let next = path.with_extension("m_variables.new");
    std::fs::write(&next, text)?;
    std::fs::rename(&next, path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blocks_are_found_again_and_a_broken_file_lists_none() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.m_variables");
        let file = StateFile { path: Some(path.clone()) };
        assert_eq!(file.blocks(), 0, "missing");
        for blocks in [0, 1, 1 << 63 | 1 << 16, u64::MAX] {
            write(&path, blocks).unwrap();
            assert_eq!(file.blocks(), blocks);
        }
        for broken in [&b"M1\n"[..], b"M8192", b"M65535", b"128", b"\xFF", b"M", b"#\nM128 x", b"M-128"] {
            std::fs::write(&path, broken).unwrap();
            assert_eq!(file.blocks(), 0, "{broken:?}");
        }
        std::fs::remove_file(&path).unwrap();
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
        assert_eq!(file.blocks(), 0, "a FIFO");
        assert!(write(&directory.path().join("none/pmac0.m_variables"), 1).is_err());
        assert_eq!(StateFile { path: None }.blocks(), 0);
    }
}
