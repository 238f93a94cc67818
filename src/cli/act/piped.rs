//! Lines for the board from a pipe or a file, one by one.

use std::io::{self, BufRead};

use crate::cli::context::Failure;
use crate::format::file_text;

/// The lines of stdin, as [`file_text`] reads them, each as soon as it arrives.
pub fn lines() -> impl Iterator<Item = Result<String, Failure>> {
    let mut input = io::stdin().lock();
    let mut bytes = Vec::new();
    std::iter::from_fn(move || {
        bytes.clear();
        match input.read_until(b'\n', &mut bytes) {
            Ok(0) => None,
            Ok(_) => Some(split(&bytes)),
            Err(error) => Some(Err(Failure::Request(format!("stdin: {error}")))),
        }
    })
    .flat_map(|lines| match lines {
        Ok(lines) => lines.into_iter().map(Ok).collect::<Vec<_>>(),
        Err(failure) => vec![Err(failure)],
    })
}

/// The lines in the text up to a line feed: boards end their lines by CR alone.
fn split(bytes: &[u8]) -> Result<Vec<String>, Failure> {
    let text = file_text::read(bytes).map_err(|reason| Failure::Request(format!("stdin: {reason}")))?;
    Ok(text.lines().map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_other_systems_are_split_as_they_come() {
        let lines = |bytes: &[u8]| split(bytes).ok();
        assert_eq!(lines(b"\xEF\xBB\xBFP1\r\n"), Some(vec!["P1".to_owned()]));
        assert_eq!(lines(b"P1\rP2\r"), Some(vec!["P1".to_owned(), "P2".to_owned()]));
        assert_eq!(
            lines(b"\x1A"),
            Some(Vec::new()),
            "the end of a DOS text is not ^Z, which ends everybody's command lines"
        );
        assert_eq!(lines(b"\x0B\n"), Some(vec!["\x0B".to_owned()]), "control characters are commands");
        assert_eq!(lines(b"\xFF\xFEP\x001\x00\n"), None);
    }
}
