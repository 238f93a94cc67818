//! The board's password: it locks listing and opening of programs from 1000 on and of PLCs (Software Reference,
//! `PASSWORD`).

/// A password, and whether a client has given it since the last reset.
#[derive(Debug, Clone, Default)]
pub struct Password {
    text: Vec<u8>,
    given: bool,
}

impl Password {
    /// Whether the protected programs are accessible: no password is set, or a client has given it.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.given || self.text.is_empty()
    }

    /// Sets a new password when the board is open; otherwise gives one. Returns whether the board is open then.
    pub fn set_or_give(&mut self, text: &[u8]) -> bool {
        if self.is_open() {
            *self = Self { text: text.to_vec(), given: true };
        } else {
            self.given = self.text == text;
        }
        self.given
    }

    /// The password; `None` while the board is closed.
    #[must_use]
    pub fn text(&self) -> Option<&[u8]> {
        self.is_open().then_some(&self.text)
    }

    /// A reset closes the board: a client must give the password anew.
    pub fn close(&mut self) {
        self.given = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_opens_to_the_right_word_only() {
        let mut password = Password::default();
        assert!(password.set_or_give(b"Bush"));
        password.close();
        assert_eq!(password.text(), None);
        assert!(!password.set_or_give(b"bush"), "case matters");
        assert!(password.set_or_give(b"Bush"));
        assert!(password.set_or_give(b""), "an open world takes a new one");
        password.close();
        assert!(password.is_open());
    }
}
