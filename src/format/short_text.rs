//! A short text of fixed capacity, copied without the heap.

use std::fmt;
use std::ops::Deref;

/// A text of at most `N` bytes (`N` up to 65535). Boards answer in ASCII; other bytes are kept unchanged.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text<const N: usize> {
    /// Zeros behind the text, so that equal texts compare equal.
    bytes: [u8; N],
    length: u16,
}

impl<const N: usize> Text<N> {
    /// Copies `bytes`; `None` when there are more than `N`.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        (bytes.len() <= N).then(|| Self::cut(bytes))
    }

    /// The first `N` of `bytes`.
    #[must_use]
    pub fn cut(bytes: &[u8]) -> Self {
        let mut text = Self::default();
        let length = bytes.len().min(N);
        text.bytes[..length].copy_from_slice(&bytes[..length]);
        text.length = length as u16;
        text
    }

    /// As much of `bytes` as fits, without splitting a character. Invalid UTF-8 becomes U+FFFD.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut text = Self::default();
        for chunk in bytes.utf8_chunks() {
            let is_whole = text.append(chunk.valid());
            if !is_whole || !chunk.invalid().is_empty() && !text.append("\u{FFFD}") {
                break;
            }
        }
        text
    }

    /// As much of `text` as fits.
    #[must_use]
    pub fn of(text: &dyn fmt::Display) -> Self {
        let mut start = Self::default();
        // `write!` reports a truncated text as an error; truncation is what we want.
        let _ = fmt::write(&mut start, format_args!("{text}"));
        start
    }

    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..usize::from(self.length)]
    }

    /// The text with each byte as the character of that code, so that bytes beyond ASCII survive.
    #[must_use]
    pub fn to_latin1(&self) -> String {
        self.as_bytes().iter().copied().map(char::from).collect()
    }

    /// Appends as much as fits; returns whether that was all.
    fn append(&mut self, text: &str) -> bool {
        let length = usize::from(self.length);
        let room = N - length;
        let end = (0..=room.min(text.len())).rfind(|end| text.is_char_boundary(*end)).unwrap_or(0);
        self.bytes[length..length + end].copy_from_slice(&text.as_bytes()[..end]);
        self.length += end as u16;
        end == text.len()
    }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        const { assert!(N <= u16::MAX as usize, "the length is kept in 16 bits") };
        Self { bytes: [0; N], length: 0 }
    }
}

impl<const N: usize> fmt::Write for Text<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if self.append(text) { Ok(()) } else { Err(fmt::Error) }
    }
}

impl<const N: usize> Deref for Text<N> {
    type Target = str;

    /// The text; empty when it is not UTF-8.
    fn deref(&self) -> &str {
        std::str::from_utf8(self.as_bytes()).unwrap_or_default()
    }
}

impl<const N: usize> From<&str> for Text<N> {
    fn from(text: &str) -> Self {
        Self::from_bytes(text.as_bytes())
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self)
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&String::from_utf8_lossy(self.as_bytes()), f)
    }
}

impl<const N: usize> serde::Serialize for Text<N> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_kept_as_far_as_it_fits() {
        for (text, kept) in [("", ""), ("1.16D", "1.16D"), ("12345678", "12345678"), ("1234567é", "1234567")]
        {
            assert_eq!(&*Text::<8>::from(text), kept);
            assert_eq!(&*Text::<8>::of(&text), kept);
        }
        assert_eq!(&*Text::<8>::from_bytes(b"a\xFFb"), "a\u{FFFD}b");
        assert_eq!(&*Text::<3>::from_bytes(b"a\xFFb"), "a");
        assert_eq!(Text::<8>::from("a"), Text::<8>::from_bytes(b"a"));
        assert_eq!(format!("{0:>3} {0:?}", Text::<8>::from("x")), "  x \"x\"");
    }

    #[test]
    fn bytes_are_kept_as_they_are() {
        assert!(Text::<200>::new(&[b'x'; 200]).is_some() && Text::<200>::new(&[b'x'; 201]).is_none());
        assert_eq!(Text::<255>::cut(&[0xE9; 300]).as_bytes(), [0xE9; 255]);
        assert_eq!(Text::<4>::cut(b"a\xE9").to_latin1(), "aé");
    }
}
