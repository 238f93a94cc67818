//! The names of segments.
//!
//! A name is a plain file name, so that it works in `/dev/shm`, in `/run/pmacd` and as a unit's instance name alike.
//! The leading slash of POSIX shared-memory names is optional and is dropped.

use std::ffi::OsStr;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::SegmentError;

/// A valid segment name, without the leading slash.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct SegmentName(String);

impl SegmentName {
    /// Checks `name`, with or without the leading slash.
    ///
    /// # Errors
    /// [`SegmentError::Name`] if it is empty, longer than 64 characters, begins with anything but a letter or digit,
    /// contains anything but letters, digits, `.`, `_` and `-`, or ends like a lock file.
    pub fn new(name: &str) -> Result<Self, SegmentError> {
        let bare = name.strip_prefix('/').unwrap_or(name);
        let refuse = |why| Err(SegmentError::Name { name: name.to_owned(), why });
        if bare.is_empty() {
            return refuse("it is empty");
        }
        if bare.len() > 64 {
            return refuse("it is too long");
        }
        if !bare.starts_with(|first: char| first.is_ascii_alphanumeric()) {
            return refuse("it must begin with a letter or a digit");
        }
        if !bare.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte)) {
            return refuse("it holds other characters");
        }
        if bare.ends_with(".lock") {
            return refuse("names that end in .lock are those of lock files");
        }
        Ok(Self(bare.to_owned()))
    }

    /// The name without the slash, `pmac0`.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The segment itself.
    pub(super) fn object(&self, directory: &Path) -> PathBuf {
        directory.join(&self.0)
    }

    /// The segment just before it gets its name. No segment name begins with a dot, so this one collides with none.
    pub(super) fn temporary(&self, directory: &Path, random: u64) -> PathBuf {
        directory.join(format!(".{}.{random:016x}.new", self.0))
    }

    /// Whether `file_name` has the form of [`Self::temporary`].
    pub(super) fn is_temporary(&self, file_name: &OsStr) -> bool {
        let random =
            |text: &str| Some(text.strip_prefix(&format!(".{}.", self.0))?.strip_suffix(".new")?.len());
        file_name.to_str().and_then(random) == Some(16)
    }

    /// The lock on the name.
    pub(super) fn lock(&self, directory: &Path) -> PathBuf {
        directory.join(format!("{}.lock", self.0))
    }
}

impl FromStr for SegmentName {
    type Err = SegmentError;

    fn from_str(name: &str) -> Result<Self, SegmentError> {
        Self::new(name)
    }
}

impl fmt::Display for SegmentName {
    /// As POSIX spells it, `/pmac0`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "/{}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slash_may_be_given_or_not() {
        assert_eq!(SegmentName::new("pmac0").unwrap(), SegmentName::new("/pmac0").unwrap());
        assert_eq!(SegmentName::new("/pmac0").unwrap().to_string(), "/pmac0");
        let name = SegmentName::new("rig-2_a.b").unwrap();
        assert_eq!(name.object(Path::new("/x")), Path::new("/x/rig-2_a.b"));
        let temporary = name.temporary(Path::new("/x"), 0xAB);
        assert!(name.is_temporary(temporary.file_name().unwrap()), "{temporary:?}");
        assert!(!SegmentName::new("rig-2_a").unwrap().is_temporary(temporary.file_name().unwrap()));
    }

    #[test]
    fn names_that_are_paths_or_hidden_or_locks_are_refused() {
        let long = "a".repeat(65);
        for bad in
            ["", "/", "//a", "a/b", "..", ".a", "-a", "a b", "a\0", "pmac\u{e9}", "pmac0.lock", long.as_str()]
        {
            let message = SegmentName::new(bad).unwrap_err().to_string();
            assert!(message.contains("cannot be a segment's name"), "{bad:?}: {message}");
        }
        assert!(SegmentName::new(&"a".repeat(64)).is_ok());
    }
}
