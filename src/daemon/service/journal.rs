//! The prefix of a log line: its level as a word, or for the journal its syslog number.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;

use log::{Level, Record};

use crate::format::Visible;

/// Whether `stream` goes to the journal. `$JOURNAL_STREAM` names the journal's device and inode, so a redirected stream
/// does not match.
#[must_use]
pub fn is_journal(stream: &impl AsFd) -> bool {
    std::env::var("JOURNAL_STREAM").is_ok_and(|named| leads_to(&named, stream))
}

fn leads_to(named: &str, stream: &impl AsFd) -> bool {
    let found = stream.as_fd().try_clone_to_owned().and_then(|stream| File::from(stream).metadata());
    found.is_ok_and(|found| named == format!("{}:{}", found.dev(), found.ino()))
}

/// The journal's prefix for a level (sd-daemon(3)).
#[must_use]
pub fn prefix(level: Level) -> &'static str {
    match level {
        Level::Error => "<3>",
        Level::Warn => "<4>",
        Level::Info => "<6>",
        Level::Debug | Level::Trace => "<7>",
    }
}

/// Writes a log record for the journal.
///
/// # Errors
/// The writer failed.
pub fn write(target: &mut impl Write, record: &Record<'_>) -> io::Result<()> {
    writeln!(target, "{}{}", prefix(record.level()), Visible(record.args()))
}

/// Writes a log record for a terminal or file.
///
/// # Errors
/// The writer failed.
pub fn write_words(target: &mut impl Write, record: &Record<'_>) -> io::Result<()> {
    writeln!(target, "[{:<5}] {}", record.level(), Visible(record.args()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::MetadataExt;

    #[test]
    fn only_the_stream_that_is_named_is_the_journal() {
        let file = tempfile::tempfile().unwrap();
        let metadata = file.metadata().unwrap();
        assert!(leads_to(&format!("{}:{}", metadata.dev(), metadata.ino()), &file));
        for other in ["", "8:", "0:0", &format!("{}:{}", metadata.dev(), metadata.ino() + 1)] {
            assert!(!leads_to(other, &file), "{other}");
        }
    }

    #[test]
    fn a_record_begins_with_its_level() {
        let mut line = Vec::new();
        let record = Record::builder().level(Level::Warn).args(format_args!("servo data: stale")).build();
        write(&mut line, &record).unwrap();
        assert_eq!(line, b"<4>servo data: stale\n");
        line.clear();
        let record = Record::builder().level(Level::Info).args(format_args!("board \x1b[2J\n<3>x")).build();
        write_words(&mut line, &record).unwrap();
        assert_eq!(line, b"[INFO ] board \\x1b[2J\\x0a<3>x\n");
    }
}
