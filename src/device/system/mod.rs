//! The kernel's side of this process: the files in /dev, /sys and /proc, the descriptors that the service manager
//! hands over, and how the processor is scheduled and sleeps.
//!
//! All code reads the kernel's files through a [`System`]. Its root is `/` on a machine; a test gives a directory of
//! made-up files.

pub mod cpu_latency;
pub mod descriptors;
pub mod inherited;
pub mod kernel;
pub mod scheduling;

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The machine's files, below a root.
#[derive(Debug, Clone)]
pub struct System {
    root: PathBuf,
}

impl System {
    /// This machine.
    #[must_use]
    pub fn here() -> Self {
        Self::below("/")
    }

    /// A machine whose files lie below `root`.
    #[must_use]
    pub fn below(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Where the machine's file `absolute` is.
    #[must_use]
    pub fn path(&self, absolute: impl AsRef<Path>) -> PathBuf {
        let absolute = absolute.as_ref();
        self.root.join(absolute.strip_prefix("/").unwrap_or(absolute))
    }

    /// The text of a file, without the white space at its ends.
    ///
    /// # Errors
    /// The kernel's error.
    pub fn text(&self, absolute: impl AsRef<Path>) -> io::Result<String> {
        Ok(fs::read_to_string(self.path(absolute))?.trim().to_owned())
    }

    /// The name in a file, made fit for a message of one line.
    ///
    /// # Errors
    /// The kernel's error.
    pub fn name(&self, absolute: impl AsRef<Path>) -> io::Result<String> {
        Ok(plain(&self.text(absolute)?))
    }

    /// The number in a file: hexadecimal after `0x`, else decimal.
    ///
    /// # Errors
    /// The kernel's error, or `InvalidData`.
    pub fn number(&self, absolute: impl AsRef<Path>) -> io::Result<u64> {
        let text = self.text(absolute)?;
        number(&text)
            .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, format!("`{text}` is no number")))
    }

    /// The names in a directory, sorted; none when it cannot be read.
    #[must_use]
    pub fn names(&self, absolute: impl AsRef<Path>) -> Vec<String> {
        let entries = fs::read_dir(self.path(absolute)).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort_by_key(|name| (name.len(), name.clone()));
        names
    }

    /// The last part of a symbolic link's target, as sysfs names a device's driver.
    #[must_use]
    pub fn link_name(&self, absolute: impl AsRef<Path>) -> Option<String> {
        let target = fs::read_link(self.path(absolute)).ok()?;
        Some(plain(target.file_name()?.to_str()?))
    }

    /// Whether the file is there.
    #[must_use]
    pub fn has(&self, absolute: impl AsRef<Path>) -> bool {
        self.path(absolute).exists()
    }

    /// A number that distinguishes this file from a later one of the same name.
    #[must_use]
    pub fn identity(&self, absolute: impl AsRef<Path>) -> Option<(u64, u64)> {
        fs::metadata(self.path(absolute)).ok().map(|metadata| (metadata.dev(), metadata.ino()))
    }
}

/// The first line of `text`, with `?` for control characters that would act on a terminal: drivers choose their names
/// freely.
pub(in crate::device) fn plain(text: &str) -> String {
    let line = text.lines().next().unwrap_or_default();
    line.chars().map(|character| if character.is_control() { '?' } else { character }).collect()
}

/// A number in sysfs notation: hexadecimal after `0x`, else decimal.
#[must_use]
pub fn number(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) if digits.bytes().all(|digit| digit.is_ascii_hexdigit()) => {
            u64::from_str_radix(digits, 16).ok()
        }
        Some(_) => None,
        None if text.bytes().all(|digit| digit.is_ascii_digit()) => text.parse().ok(),
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_hexadecimal_only_when_marked() {
        for (text, value) in
            [("0xD4000", Some(0xD4000)), ("16384", Some(16384)), ("0", Some(0)), ("0X1f", Some(31))]
        {
            assert_eq!(number(text), value, "{text}");
        }
        for text in ["", "0x", "D4000", "-1", "+1", "0x-1", "0x10000000000000000", "1 "] {
            assert_eq!(number(text), None, "{text}");
        }
    }

    #[test]
    fn a_name_is_one_line_without_control_characters() {
        for (text, name) in
            [("pmac-dpram", "pmac-dpram"), ("a\nb", "a"), ("\x1b[2Jx\ty\r\nz", "?[2Jx?y"), ("", "")]
        {
            assert_eq!(plain(text), name);
        }
    }

    #[test]
    fn files_are_looked_for_below_the_root() {
        let root = tempfile::tempdir().unwrap();
        let system = System::below(root.path());
        fs::create_dir_all(root.path().join("sys/a/uio10")).unwrap();
        fs::create_dir_all(root.path().join("sys/a/uio9")).unwrap();
        fs::write(root.path().join("sys/a/uio9/size"), "0x4000\n").unwrap();
        std::os::unix::fs::symlink("../../drivers/uio_pci_generic", root.path().join("sys/a/driver"))
            .unwrap();
        assert_eq!(system.number("/sys/a/uio9/size").unwrap(), 0x4000);
        assert_eq!(system.names("/sys/a"), ["uio9", "uio10", "driver"]);
        assert_eq!(system.link_name("/sys/a/driver").as_deref(), Some("uio_pci_generic"));
        assert!(system.has("/sys/a/uio9") && !system.has("/sys/b") && system.names("/sys/b").is_empty());
        assert!(system.text("/sys/b").is_err());
        assert_ne!(system.identity("/sys/a/uio9"), system.identity("/sys/a/uio10"));
    }
}
