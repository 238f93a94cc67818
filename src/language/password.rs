//! Passwords in command lines: the daemon and its clients keep them out of logs and histories.

use std::borrow::Cow;

const WORD: &str = "PASSWORD";

/// Where the word that sets or gives a password begins. A board ignores case and blanks; this function also ignores
/// blanks in the word.
pub(super) fn password_at(line: &[u8]) -> Option<usize> {
    let has_word_at = |start: &usize| {
        let letters = line[*start..].iter().filter(|letter| **letter != b' ');
        letters.take(WORD.len()).map(u8::to_ascii_uppercase).eq(WORD.bytes())
    };
    (0..line.len()).filter(|start| line[*start] != b' ').find(has_word_at)
}

/// `line` without the password that it may set or give.
#[must_use]
pub fn without_password(line: &str) -> Cow<'_, str> {
    match password_at(line.as_bytes()) {
        Some(start) => Cow::Owned(format!("{}{WORD}=***", &line[..start])),
        None => Cow::Borrowed(line),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_password_comes_into_the_log() {
        for line in ["PASSWORD=\"OpenSesame\"", "password = \"OpenSesame\"", "P A SSWORD\"OpenSesame\""] {
            assert_eq!(without_password(line), "PASSWORD=***");
        }
        assert_eq!(without_password("P1 PASSWORD=x"), "P1 PASSWORD=***");
        for line in ["", "P1=5", "PASSWOR", "#1J+", "\u{e9}PASS"] {
            assert_eq!(without_password(line), line);
        }
    }
}
