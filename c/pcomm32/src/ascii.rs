//! Command lines and their replies.
//!
//! A reply is each of its lines with a CR behind it; the CRs count. A line without a reply gives an empty text.

use pmac_dpram::language::{Meaning, deadlines};
use pmac_dpram::protocol::control;

use crate::device::Device;
use crate::fault::{CHARACTERS, END, Fault};
use crate::process::with;
use crate::rotary;

/// The text of a reply.
pub(crate) fn text(lines: &[String]) -> Vec<u8> {
    // The client library keeps the board's bytes as Latin-1.
    let bytes = |line: &String| {
        line.chars().map(|c| u8::try_from(c).unwrap_or(b'?')).chain([b'\r']).collect::<Vec<_>>()
    };
    lines.iter().flat_map(bytes).collect()
}

/// The lines in a text of the program, which may hold several. An empty line has nothing for the board.
fn lines(text: &[u8]) -> Vec<String> {
    let parts = text.split(|byte| matches!(byte, b'\n' | b'\r')).map(|part| match part {
        [1..=31] => part,
        _ => part.trim_ascii(),
    });
    parts
        .filter(|part| !part.is_empty())
        .map(|part| part.iter().map(|byte| char::from(*byte)).collect())
        .collect()
}

/// Whether the line has only stops and addresses. Such a line starts nothing, wherever it stands.
fn only_stops(line: &str) -> bool {
    if let [character @ 1..=31] = line.as_bytes() {
        return control::stops(*character);
    }
    let letters: String =
        line.chars().filter(|c| !c.is_whitespace()).map(|c| c.to_ascii_uppercase()).collect();
    let mut rest = letters.as_str();
    while !rest.is_empty() {
        let address =
            rest.strip_prefix(['#', '&']).map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit()));
        let mut stops = ["A", "H", "K", "Q", "J/", "/", "\\"].iter();
        match address.or_else(|| stops.find_map(|stop| rest.strip_prefix(stop))) {
            Some(left) => rest = left,
            None => return false,
        }
    }
    true
}

/// Sends the lines of `text`, and returns the replies of all. Behind a line that fails, only stops go out.
fn exchange(device: &Device, text: &[u8]) -> Result<Vec<String>, Fault> {
    let lines = lines(text);
    let (mut replies, mut succeeded) = (Vec::new(), 0);
    let mut failed: Option<Fault> = None;
    // A line with an address has not reached the board: the addressed motor may be another than the program's.
    let mut address_is_lost = false;
    for line in &lines {
        let has_address = line.contains(['#', '&']);
        let goes_astray = || address_is_lost && Meaning::of(line).goes_by_address;
        if failed.is_some() && (!only_stops(line) || goes_astray()) {
            address_is_lost |= has_address;
            continue;
        }
        let sent = match line.as_bytes() {
            // Some programs send a control character as a line.
            [character @ 1..=31] => send_control(device, *character),
            _ => send_line_of(device, line),
        };
        match sent {
            Ok(lines) => {
                replies.extend(lines);
                succeeded += 1;
            }
            Err(mut fault) => {
                address_is_lost |= has_address;
                replies.append(&mut fault.lines);
                failed = Some(match failed {
                    None => fault,
                    Some(first) => first.and(line, &fault),
                });
            }
        }
    }
    match failed {
        None => Ok(replies),
        Some(fault) if lines.len() == 1 => Err(Fault { lines: replies, ..fault }),
        Some(fault) => Err(Fault { lines: replies, ..fault.after(succeeded, lines.len(), "lines") }),
    }
}

fn send_line_of(device: &Device, line: &str) -> Result<Vec<String>, Fault> {
    let meaning = Meaning::of(line);
    // A stop waits for no other thread, neither for the device nor for a rotary buffer.
    if !meaning.stops {
        drop(device.turn()?);
        if rotary::takes(device, line) {
            return Ok(Vec::new());
        }
    }
    device.send(line, meaning.deadline(deadlines::PLAIN))
}

fn send_control(device: &Device, character: u8) -> Result<Vec<String>, Fault> {
    if !control::stops(character) {
        drop(device.turn()?);
    }
    device.control(character)
}

/// The reply to `command`, or the failure.
pub(crate) fn response(number: u32, command: Option<&[u8]>) -> Result<Vec<u8>, Fault> {
    with(number, |device| {
        let command = command.ok_or_else(|| Fault::argument("the command is NULL"))?;
        Ok(text(&exchange(device, command)?))
    })
}

/// The answer to a control character.
pub(crate) fn control_response(number: u32, character: u8) -> Result<Vec<u8>, Fault> {
    with(number, |device| match character {
        1..=31 => Ok(text(&send_control(device, character)?)),
        _ => Err(Fault::argument(format!("{character} is no control character: 1 to 31"))),
    })
}

/// What a function with Ex returns for `count` characters of a reply of `length`.
pub(crate) fn status(outcome: &Result<Vec<u8>, Fault>, count: usize) -> u32 {
    let characters = u32::try_from(count).unwrap_or(CHARACTERS) & CHARACTERS;
    match outcome {
        // Without the bit of the end, there is more of the reply than the program has room for.
        Ok(reply) if reply.len() > count => characters,
        Ok(_) => END | characters,
        Err(fault) => fault.bits() | characters,
    }
}

/// Sends the lines of `text`; `PmacGetLineA` gives the replies. Returns how many characters were sent.
pub(crate) fn send_line(number: u32, line: Option<&[u8]>) -> Result<usize, Fault> {
    with(number, |device| {
        let line = line.ok_or_else(|| Fault::argument("the line is NULL"))?;
        let reply = exchange(device, line);
        device.keep_reply(&reply);
        reply.map(|_| line.len())
    })
}

/// The next line of the replies, empty at their end.
pub(crate) fn next_line(number: u32) -> Result<Vec<u8>, Fault> {
    with(number, |device| {
        drop(device.turn()?);
        let mut waiting = device.waiting();
        waiting.check_lost()?;
        if let Some(line) = waiting.lines.pop_front() {
            return Ok(text(&[line]));
        }
        waiting.end = false;
        match waiting.fault.take() {
            Some(fault) => Err(fault),
            None => Ok(Vec::new()),
        }
    })
}

/// As [`next_line`]: puts the line, and returns its status. Before the end of the replies the status has no bit.
pub(crate) fn line_status(number: u32, put: impl FnOnce(&Result<Vec<u8>, Fault>) -> usize) -> u32 {
    let outcome = next_line(number);
    let count = put(&outcome);
    match &outcome {
        Ok(line) if !line.is_empty() => u32::try_from(count).unwrap_or(CHARACTERS) & CHARACTERS,
        outcome => status(outcome, count),
    }
}

/// All lines of the replies.
pub(crate) fn all_lines(number: u32) -> Result<Vec<u8>, Fault> {
    with(number, |device| {
        drop(device.turn()?);
        let mut waiting = device.waiting();
        waiting.end = false;
        let lines: Vec<String> = waiting.lines.drain(..).collect();
        match waiting.check_lost().err().or(waiting.fault.take()) {
            Some(mut fault) => {
                fault.lines.splice(0..0, lines);
                Err(fault)
            }
            None => Ok(text(&lines)),
        }
    })
}

/// Whether a line, or the end of the replies, waits for `PmacGetLineA`.
pub(crate) fn is_ready(number: u32) -> Result<bool, Fault> {
    with(number, |device| {
        let waiting = device.waiting();
        Ok(!waiting.lines.is_empty() || waiting.end)
    })
}

/// Drops the replies that wait.
pub(crate) fn flush(number: u32) -> Result<(), Fault> {
    with(number, |device| {
        drop(device.turn()?);
        *device.waiting() = Default::default();
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strings(lines: &[&str]) -> Vec<String> {
        lines.iter().map(|line| (*line).to_owned()).collect()
    }

    #[test]
    fn one_text_may_have_several_lines_and_a_control_character_is_one() {
        assert_eq!(lines(b"open prog 1\nclear\r\n\n close \n"), ["open prog 1", "clear", "close"]);
        // `^K` and `^L` pass for blanks elsewhere.
        assert_eq!(lines(b"\x0B"), ["\x0B"]);
        assert_eq!(lines(b"\x0C\r"), ["\x0C"]);
        assert!(lines(b"").is_empty() && lines(b" \r\n").is_empty());
    }

    #[test]
    fn behind_a_line_that_fails_only_stops_go_out() {
        for line in ["&1A", "a", "#1K#2K", "# 3 j/", "&2 q", "H", "&1/", "\\", "\x01", "\x0B", "\x0F"] {
            assert!(only_stops(line), "{line:?}");
            assert!(line.len() == 1 && line < " " || Meaning::of(line).stops, "{line:?}");
        }
        for line in
            ["&1A R", "#1J+", "K HM", "A100", "Q100=5", "P1=x", "$$$", "\x12", "J", "CLOSE", "#1J/ J+"]
        {
            assert!(!only_stops(line), "{line:?}");
        }
        assert!(only_stops("#2"), "the motor of a stop that follows");
    }

    #[test]
    fn the_cr_of_each_line_is_part_of_the_reply_and_of_the_count() {
        assert_eq!(text(&strings(&["5", "-0.5"])), b"5\r-0.5\r");
        assert!(text(&[]).is_empty());
        assert_eq!(text(&strings(&["\u{b0}\u{20ac}"])), [0xB0, b'?', b'\r']);
    }

    #[test]
    fn the_status_has_the_end_unless_the_reply_was_cut() {
        let reply = Ok(b"12345\r".to_vec());
        assert_eq!(status(&reply, 6), 0x8000_0006);
        assert_eq!(status(&reply, 3), 3);
        assert_eq!(status(&Ok(Vec::new()), 0), 0x8000_0000);
        assert_eq!(status(&Err(Fault::argument("x")), 5), 0xF000_0005);
        assert_eq!(status(&Err(Fault::refused("x")), 7), 0xE000_0007);
    }
}
