//! Text as files have it: editors of other systems mark and end it in their own ways, and boards end their lines by CR alone.

use std::borrow::Cow;

/// Bytes that are no text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotText {
    /// A byte-order mark of UTF-16, and characters that are none.
    #[error("the file begins as UTF-16 and goes on otherwise; save it as UTF-8")]
    Utf16,
    /// A NUL.
    #[error(
        "the file has NUL bytes, so it is no text, or UTF-16 without a byte-order mark; save it as UTF-8"
    )]
    Nul,
}

/// The text of a file of these `bytes`: UTF-8, or UTF-16 behind its byte-order mark. Its lines end by LF, whether they ended by LF,
/// CR LF or CR; a form feed is a blank; `^Z` at the end, by which DOS ends a text, is gone. A byte that is no UTF-8, as in comments
/// of other languages, is U+FFFD.
///
/// # Errors
/// [`NotText`].
pub fn read(bytes: &[u8]) -> Result<Cow<'_, str>, NotText> {
    let mut text = match bytes {
        [0xFF, 0xFE, rest @ ..] => Cow::Owned(utf16(rest, u16::from_le_bytes)?),
        [0xFE, 0xFF, rest @ ..] => Cow::Owned(utf16(rest, u16::from_be_bytes)?),
        [0xEF, 0xBB, 0xBF, rest @ ..] => String::from_utf8_lossy(rest),
        _ => String::from_utf8_lossy(bytes),
    };
    let end = text.trim_end_matches(['\x1A', '\0', '\r', '\n', ' ']).len();
    if let Some(eof) = text[end..].find(['\x1A', '\0']) {
        text = match text {
            Cow::Borrowed(text) => Cow::Borrowed(&text[..end + eof]),
            Cow::Owned(mut text) => {
                text.truncate(end + eof);
                Cow::Owned(text)
            }
        };
    }
    if text.contains('\0') {
        return Err(NotText::Nul);
    }
    if text.contains(['\r', '\x0C']) {
        text = Cow::Owned(text.replace("\r\n", "\n").replace('\r', "\n").replace('\x0C', " "));
    }
    Ok(text)
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, NotText> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let text = char::decode_utf16(pairs.iter().map(|pair| unit(*pair))).collect::<Result<String, _>>();
    text.ok().filter(|_| rest.is_empty()).ok_or(NotText::Utf16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_text_is_read_however_it_is_marked_and_ended() {
        let utf16 = |mark: &[u8], bytes: fn(u16) -> [u8; 2]| {
            [mark, &"P1=1\r\nP2=2\r\n".encode_utf16().flat_map(bytes).collect::<Vec<u8>>()].concat()
        };
        for bytes in [
            b"P1=1\nP2=2\n".to_vec(),
            b"\xEF\xBB\xBFP1=1\r\nP2=2\r\n\x1A".to_vec(),
            b"P1=1\rP2=2\r".to_vec(),
            b"P1=1\nP2=2\n\x1A\0\0\0".to_vec(),
            b"P1=1\nP2=2\n\x1A\r\n".to_vec(),
            utf16(b"\xFF\xFE", u16::to_le_bytes),
            utf16(b"\xFE\xFF", u16::to_be_bytes),
        ] {
            assert_eq!(read(&bytes).as_deref(), Ok("P1=1\nP2=2\n"), "{bytes:?}");
        }
        assert_eq!(read(b"P1=1\x0CP2=2").as_deref(), Ok("P1=1 P2=2"));
        assert_eq!(read(b"; \xB5m\nP1=1").as_deref(), Ok("; \u{FFFD}m\nP1=1"));
        assert_eq!(read(b"").as_deref(), Ok(""));
        assert!(matches!(read(b"P1=1\nP2=2\n"), Ok(Cow::Borrowed(_))), "nothing is copied");
        // In the middle it is no end.
        assert_eq!(read(b"P1=1\x1AP2=2").as_deref(), Ok("P1=1\x1AP2=2"));
    }

    #[test]
    fn what_is_no_text_is_called_by_its_name() {
        assert_eq!(read(b"P\x001\x00=\x001\x00"), Err(NotText::Nul));
        assert_eq!(read(b"\xFF\xFEP\x001"), Err(NotText::Utf16));
        assert_eq!(read(b"\xFF\xFE\x00\xD8P\0"), Err(NotText::Utf16));
    }

    proptest::proptest! {
        #[test]
        fn no_bytes_can_harm(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..40)) {
            let _ = read(&bytes);
        }
    }
}
