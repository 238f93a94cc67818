//! A short text held in place, so that who copies it needs no memory from the heap.

use std::fmt;
use std::ops::Deref;

/// A text of at most `N` bytes of UTF-8.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortText<const N: usize> {
    /// Zeros behind the text, so that equal texts are equal.
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> ShortText<N> {
    /// As much of `bytes` as fits, without splitting a character; what is no UTF-8 becomes U+FFFD.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Self {
        let mut text = Self { bytes: [0; N], length: 0 };
        for chunk in bytes.utf8_chunks() {
            let is_whole = text.append(chunk.valid());
            if !is_whole || !chunk.invalid().is_empty() && !text.append("\u{FFFD}") {
                break;
            }
        }
        text
    }

    /// Appends what there is room for; false if that was not all.
    fn append(&mut self, text: &str) -> bool {
        let room = N - self.length;
        let end = (0..=room.min(text.len())).rfind(|end| text.is_char_boundary(*end)).unwrap_or(0);
        self.bytes[self.length..self.length + end].copy_from_slice(&text.as_bytes()[..end]);
        self.length += end;
        end == text.len()
    }
}

impl<const N: usize> Deref for ShortText<N> {
    type Target = str;

    fn deref(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.length]).unwrap_or_default()
    }
}

impl<const N: usize> From<&str> for ShortText<N> {
    fn from(text: &str) -> Self {
        Self::from_bytes(text.as_bytes())
    }
}

impl<const N: usize> fmt::Display for ShortText<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self)
    }
}

impl<const N: usize> fmt::Debug for ShortText<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&**self, f)
    }
}

impl<const N: usize> serde::Serialize for ShortText<N> {
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
            assert_eq!(&*ShortText::<8>::from(text), kept);
        }
        assert_eq!(&*ShortText::<8>::from_bytes(b"a\xFFb"), "a\u{FFFD}b");
        assert_eq!(&*ShortText::<3>::from_bytes(b"a\xFFb"), "a");
        assert_eq!(ShortText::<8>::from("a"), ShortText::<8>::from_bytes(b"a"));
        assert_eq!(format!("{0:>3} {0:?}", ShortText::<8>::from("x")), "  x \"x\"");
    }
}
