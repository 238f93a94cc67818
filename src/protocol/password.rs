//! Passwords in command lines: they are kept out of logs and histories.

use std::borrow::Cow;

/// `line` without the password that it may set or give: blanks do not matter to PMAC, nor does case.
#[must_use]
pub fn without_password(line: &str) -> Cow<'_, str> {
    const WORD: &str = "PASSWORD";
    let has_word_at = |start: usize| {
        let letters = line[start..].char_indices().filter(|(_, letter)| *letter != ' ');
        let mut compared = letters.zip(WORD.chars());
        let same = compared.by_ref().take_while(|((_, letter), wanted)| letter.eq_ignore_ascii_case(wanted));
        same.count() == WORD.len()
    };
    match line.char_indices().find(|(start, letter)| *letter != ' ' && has_word_at(*start)) {
        Some((start, _)) => Cow::Owned(format!("{}{WORD}=***", &line[..start])),
        None => Cow::Borrowed(line),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b4_5_no_password_comes_into_the_log() {
        for line in ["PASSWORD=\"OpenSesame\"", "password = \"OpenSesame\"", "P A SSWORD\"OpenSesame\""] {
            assert_eq!(without_password(line), "PASSWORD=***");
        }
        assert_eq!(without_password("P1 PASSWORD=x"), "P1 PASSWORD=***");
        for line in ["", "P1=5", "PASSWOR", "#1J+", "\u{e9}PASS"] {
            assert_eq!(without_password(line), line);
        }
    }
}
