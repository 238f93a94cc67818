//! A board's bytes on a serial line: data, and the handshake that I3, I4 and I6 put around them (Software Reference pp.
//! 22-25).
//!
//! | I3 | a data line | the end |
//! |---|---|---|
//! | 0 | text `<CR>` | nothing |
//! | 1 | `<LF>` text `<CR>` | `<LF>` |
//! | 2 | text `<CR>` | `<ACK>` |
//! | 3 | `<LF>` text `<CR>` | `<ACK>` |
//!
//! An error is a `<BELL>` in every handshake, with `ERRnnn<CR>` behind it when I6 is 1 or 3. With an odd I4 a check sum
//! byte follows each data line and the end.

use crate::protocol::answer;
use crate::protocol::control::CANCEL;

const ACK: u8 = 0x06;
const BELL: u8 = 0x07;
const LF: u8 = b'\n';
const CR: u8 = b'\r';

/// The handshake a board uses: the bits of I3, and bit 0 of I4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Handshake {
    /// `<LF>` before data lines, and at the end unless `acknowledge`.
    pub line_feeds: bool,
    /// `<ACK>` at the end.
    pub acknowledge: bool,
    /// A check sum byte behind every data line and the end.
    pub checksum: bool,
}

/// An answer, as far as the received bytes tell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SerialAnswer {
    /// More has to come.
    Unfinished,
    /// Complete if no byte follows for a while.
    PerhapsComplete(Reply),
    /// Complete.
    Complete(Reply),
}

/// A board's answer to one line.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reply {
    /// The data lines, in order.
    pub lines: Vec<String>,
    /// The error that ended the answer.
    pub error: Option<BoardError>,
}

/// An error of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoardError {
    /// The number of `ERRnnn`; `None` if the board sends no number (I6 is 0 or 2).
    pub code: Option<u16>,
}

/// The board's handshake, read from `bytes`, the whole answer to the question `I4`; `None` if `bytes` are no such
/// answer.
#[must_use]
pub fn recognise(bytes: &[u8]) -> Option<Handshake> {
    // A board with I63=1 echoes the ^X that emptied its line.
    let bytes: Vec<u8> = bytes.iter().copied().filter(|&byte| byte != CANCEL).collect();
    let line_feeds = bytes.first() == Some(&LF);
    let text = &bytes[usize::from(line_feeds)..];
    let end = text.iter().position(|&byte| byte == CR)?;
    let number = answer::integer(std::str::from_utf8(&text[..end]).ok()?);
    let checksum = number.filter(|value| (0..=3).contains(value))? & 1 != 0;
    // The check sum of a line could be any byte; that of the line "I4" is no handshake character.
    let rest = text.get(end + 1 + usize::from(checksum)..)?;
    let acknowledge = rest.first() == Some(&ACK);
    let handshake = Handshake { line_feeds, acknowledge, checksum };
    let whole = match parse(handshake, &bytes) {
        SerialAnswer::Complete(reply) | SerialAnswer::PerhapsComplete(reply) => reply,
        SerialAnswer::Unfinished => return None,
    };
    (whole.error.is_none() && whole.lines.len() == 1).then_some(handshake)
}

/// The answer in `bytes`, all that the board has sent since the line.
#[must_use]
pub fn parse(handshake: Handshake, bytes: &[u8]) -> SerialAnswer {
    let bytes: Vec<u8> = bytes.iter().copied().filter(|&byte| byte != CANCEL).collect();
    let Handshake { line_feeds, acknowledge, checksum } = handshake;
    let sum = usize::from(checksum);
    let mut reply = Reply::default();
    let mut at = 0;
    loop {
        let rest = &bytes[at..];
        match rest {
            [ACK, tail @ ..] if tail.len() < sum => return SerialAnswer::Unfinished,
            [ACK, ..] => return SerialAnswer::Complete(reply),
            [BELL, tail @ ..] => return error(reply, tail),
            // Without <ACK>, only the silence behind it shows an end.
            [LF, tail @ ..] if line_feeds && !acknowledge && tail.len() <= sum => {
                return if tail.len() == sum {
                    SerialAnswer::PerhapsComplete(reply)
                } else {
                    SerialAnswer::Unfinished
                };
            }
            [LF, ..] => at += 1,
            _ if !line_feeds && !acknowledge && rest.len() == sum => {
                return SerialAnswer::PerhapsComplete(reply);
            }
            _ => {
                let Some(end) = rest.iter().position(|&byte| byte == CR) else {
                    return SerialAnswer::Unfinished;
                };
                if rest.len() < end + 1 + sum {
                    return SerialAnswer::Unfinished;
                }
                reply.lines.push(String::from_utf8_lossy(&rest[..end]).into_owned());
                at += end + 1 + sum;
            }
        }
    }
}

/// An answer that ended in an error; `tail` follows the `<BELL>`.
fn error(mut reply: Reply, tail: &[u8]) -> SerialAnswer {
    let text: Vec<u8> = tail.iter().copied().skip_while(|byte| matches!(byte, &CR | &LF)).collect();
    let end = text.iter().position(|&byte| byte == CR);
    let number =
        end.and_then(|end| std::str::from_utf8(&text[..end]).ok()?.strip_prefix("ERR")?.parse().ok());
    reply.error = Some(BoardError { code: number });
    if number.is_some() { SerialAnswer::Complete(reply) } else { SerialAnswer::PerhapsComplete(reply) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Handshake = Handshake { line_feeds: false, acknowledge: false, checksum: false };
    const FEEDS: Handshake = Handshake { line_feeds: true, ..PLAIN };
    const ACKED: Handshake = Handshake { acknowledge: true, ..PLAIN };
    const BOTH: Handshake = Handshake { line_feeds: true, acknowledge: true, checksum: false };

    fn reply(lines: &[&str]) -> Reply {
        Reply { lines: lines.iter().map(|line| (*line).to_owned()).collect(), error: None }
    }

    #[test]
    fn the_printed_forms_are_understood_and_never_before_they_are_there() {
        for (handshake, bytes, lines, certain) in [
            (PLAIN, &b"25\r50\r75\r"[..], &["25", "50", "75"][..], false),
            (PLAIN, b"", &[], false),
            (FEEDS, b"\n25\r\n50\r\n75\r\n", &["25", "50", "75"], false),
            (FEEDS, b"\n", &[], false),
            (ACKED, b"25\r50\r75\r\x06", &["25", "50", "75"], true),
            (ACKED, b"\x06", &[], true),
            (BOTH, b"\n25\r\n50\r\n75\r\x06", &["25", "50", "75"], true),
            (BOTH, b"\x06", &[], true),
        ] {
            let whole = parse(handshake, bytes);
            let expected = reply(lines);
            if certain {
                assert_eq!(whole, SerialAnswer::Complete(expected), "{bytes:?}");
            } else {
                assert_eq!(whole, SerialAnswer::PerhapsComplete(expected), "{bytes:?}");
            }
            for cut in 0..bytes.len() {
                assert!(
                    !matches!(parse(handshake, &bytes[..cut]), SerialAnswer::Complete(_)),
                    "{bytes:?} {cut}"
                );
            }
        }
    }

    #[test]
    fn errors_are_understood_with_and_without_a_number() {
        for (handshake, bytes) in [
            (PLAIN, &b"\x07ERR003\r"[..]),
            (ACKED, b"\x07\rERR003\r"),
            (FEEDS, b"\x07\nERR003\r"),
            (BOTH, b"\x07\r\nERR003\r"),
        ] {
            let expected = Reply { lines: vec![], error: Some(BoardError { code: Some(3) }) };
            assert_eq!(parse(handshake, bytes), SerialAnswer::Complete(expected), "{bytes:?}");
        }
        let bell = Reply { lines: vec!["3".to_owned()], error: Some(BoardError { code: None }) };
        assert_eq!(parse(ACKED, b"3\r\x07"), SerialAnswer::PerhapsComplete(bell));
    }

    #[test]
    fn check_sums_are_passed_over_whatever_byte_they_are() {
        let sums = |handshake| Handshake { checksum: true, ..handshake };
        assert_eq!(parse(sums(ACKED), b"0\r\x06\x06"), SerialAnswer::Unfinished);
        assert_eq!(parse(sums(ACKED), b"0\r\x06\x06}"), SerialAnswer::Complete(reply(&["0"])));
        assert_eq!(parse(sums(FEEDS), b"\n1\r1\n}"), SerialAnswer::PerhapsComplete(reply(&["1"])));
        assert_eq!(parse(sums(PLAIN), b"1\r1}"), SerialAnswer::PerhapsComplete(reply(&["1"])));
    }

    #[test]
    fn one_question_tells_the_handshake() {
        let sums = |handshake| Handshake { checksum: true, ..handshake };
        for (bytes, handshake) in [
            (&b"0\r"[..], PLAIN),
            (b"\x18\n0\r\n", FEEDS),
            (b"I4=2\r\x06", ACKED),
            (b"\n0\r\x06", BOTH),
            (b"1\r1}", sums(PLAIN)),
            (b"\n1\r1\n}", sums(FEEDS)),
            (b"1\r1\x06}", sums(ACKED)),
            (b"\n1\r1\x06}", sums(BOTH)),
        ] {
            assert_eq!(recognise(bytes), Some(handshake), "{bytes:?}");
        }
        for bytes in [&b""[..], b"\x07", b"\xF8\x80\r", b"0", b"login: \r", b"4\r\x06", b"\n\n\n"] {
            assert_eq!(recognise(bytes), None, "{bytes:?}");
        }
    }

    proptest::proptest! {
        #[test]
        fn no_bytes_can_harm(bytes: Vec<u8>, line_feeds: bool, acknowledge: bool, checksum: bool) {
            let _ = parse(Handshake { line_feeds, acknowledge, checksum }, &bytes);
            let _ = recognise(&bytes);
        }
    }
}
