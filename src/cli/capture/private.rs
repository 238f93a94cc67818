//! Keeps private texts out of a trace: command lines can hold programs and passwords, replies can hold listings.
//!
//! The filter shows only questions for variables and identity, with their replies. The words of all other lines become
//! 0. The filter knows a line by the words that the daemon writes before it sets the line's flag, in either packing of
//! the text. Where the daemon dropped accesses, another line may have come between: the filter shows no text until a
//! new line begins after the gap.

use crate::format::TextOrder;
use crate::map::functions::response;
use crate::map::{AsciiPort, HostOffset};
use crate::recording::{Access, Op};

/// Questions for identity, and for the state of the whole board.
pub const IDENTITY: [&str; 8] = ["TYPE", "VERSION", "DATE", "SIZE", "???", "CPU", "CID", "VID"];
/// The most accesses that may come before the flag of a line.
const HELD: usize = 4096;

/// Whether `line` consists of questions for variables and identity only, so that it holds no text of the user.
fn is_question(line: &str) -> bool {
    let line = line.trim().to_ascii_uppercase();
    let is_of_question = |letter: char| letter.is_ascii_digit() || " ,.->IPQM".contains(letter);
    IDENTITY.contains(&line.as_str()) || (!line.is_empty() && line.chars().all(is_of_question))
}

/// `text`, which names other processes as `uid 1000 (pid 77)`, without the numbers.
pub fn without_users(text: &str) -> String {
    let mut rest = text;
    let mut shown = String::new();
    while let Some(at) = ["uid ", "pid "].iter().filter_map(|what| rest.find(what)).min() {
        let (before, behind) = rest.split_at(at + "uid ".len());
        let is_word =
            !shown.bytes().chain(rest[..at].bytes()).last().is_some_and(|byte| byte.is_ascii_alphanumeric());
        let digits = behind.bytes().take_while(u8::is_ascii_digit).count();
        shown += before;
        shown += if is_word && digits > 0 { "N" } else { &behind[..digits] };
        rest = &behind[digits..];
    }
    shown + rest
}

/// Decides which texts of a trace to show.
pub struct TextFilter {
    port: &'static AsciiPort,
    /// The accesses since the first word of a line whose flag the daemon has not set.
    held: Vec<Access>,
    /// The words of that line.
    line: Vec<u16>,
    /// The last part of a line has no end.
    continues: bool,
    /// The last line is a question.
    is_shown: bool,
    /// The response buffer holds the reply to the last line.
    is_reply: bool,
    /// Accesses may be missing.
    has_gaps: bool,
}

impl TextFilter {
    /// For a board with this port. The filter shows no text before the first line.
    pub fn new(port: &'static AsciiPort) -> Self {
        Self {
            port,
            held: Vec::new(),
            line: Vec::new(),
            continues: false,
            is_shown: false,
            is_reply: false,
            has_gaps: false,
        }
    }

    /// From now on accesses may be missing. The filter shows no text until [`Self::trust`].
    pub fn distrust(&mut self) {
        (self.has_gaps, self.is_shown) = (true, false);
    }

    /// No access is missing from now on. The next access may belong to the rest of a line.
    pub fn trust(&mut self) {
        if std::mem::take(&mut self.has_gaps) {
            self.continues = true;
        }
    }

    /// Takes in the next access; adds to `kept` the accesses whose text the filter can now judge.
    pub fn take(&mut self, access: Access, kept: &mut Vec<Access>) {
        let Access { op, offset, value, .. } = access;
        if op == Op::Write && self.is_command(offset) {
            let at = offset.words_since(self.port.command);
            self.line.resize(self.line.len().max(at + 1), 0);
            // A word has 16 bits.
            self.line[at] = value as u16;
            self.held.push(access);
            return;
        }
        if offset == self.port.response_control && op == Op::Read && value != 0 {
            self.is_reply = value == u32::from(response::LINE);
        }
        let access = if self.is_hidden(&access) { Access { value: 0, ..access } } else { access };
        if self.held.is_empty() {
            return kept.push(access);
        }
        self.held.push(access);
        if op == Op::Write && offset == self.port.command_loaded.word {
            self.judge();
            self.release(kept);
        } else if self.held.len() > HELD {
            self.is_shown = false;
            self.release(kept);
        }
    }

    /// Adds the accesses still held, at the end.
    pub fn end(&mut self, kept: &mut Vec<Access>) {
        self.is_shown = false;
        self.release(kept);
    }

    fn is_command(&self, offset: HostOffset) -> bool {
        let command = self.port.command;
        offset >= command && offset < command.plus_words(self.port.command_bytes / 2)
    }

    /// Whether to hide the text that the access reads.
    fn is_hidden(&self, access: &Access) -> bool {
        let words = usize::from(access.width / 16);
        let is_text = self.port.has_text_in(access.offset, words);
        is_text && !(self.is_shown && self.is_reply && !self.is_command(access.offset))
    }

    /// Decides whether to show the line.
    fn judge(&mut self) {
        let text =
            |order: TextOrder| -> Vec<u8> { self.line.iter().flat_map(|&word| order.unpack(word)).collect() };
        let is_question = |order| {
            let bytes = text(order);
            let line = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
            std::str::from_utf8(line).is_ok_and(is_question)
        };
        let is_known = !self.has_gaps && !self.continues;
        self.is_shown = is_known && [TextOrder::LowFirst, TextOrder::HighFirst].into_iter().any(is_question);
        self.continues = !text(TextOrder::LowFirst).contains(&0);
        self.is_reply = false;
        self.line.clear();
    }

    fn release(&mut self, kept: &mut Vec<Access>) {
        for access in std::mem::take(&mut self.held) {
            let is_hidden = access.op == Op::Write && self.is_command(access.offset) && !self.is_shown;
            kept.push(if is_hidden { Access { value: 0, ..access } } else { access });
        }
        self.line.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn users_and_processes_are_named_without_their_numbers() {
        for (text, shown) in [
            ("PROG 5 is open: opened by uid 1000 (pid 9400)", "PROG 5 is open: opened by uid N (pid N)"),
            ("uid 0 pid 7 sent uid ", "uid N pid N sent uid "),
            ("the fluid 3 and stupid x", "the fluid 3 and stupid x"),
            ("", ""),
        ] {
            assert_eq!(without_users(text), shown);
        }
    }

    const PORT: &AsciiPort = &PMAC.ascii;

    fn access(op: Op, offset: HostOffset, value: u16) -> Access {
        Access { t_ns: 0, op, offset, width: 16, value: value.into() }
    }

    /// A line, its flag, the control word of a response, and its text.
    fn exchange(order: TextOrder, line: &str, control: u16, reply: &str) -> Vec<Access> {
        let words = |text: &str| {
            let bytes: Vec<u8> = text.bytes().chain([0, 0]).collect();
            bytes.as_chunks().0.iter().map(|&[first, second]| order.pack(first, second)).collect::<Vec<u16>>()
        };
        let texts = |op, start: HostOffset, text: &str| {
            let words = words(text).into_iter().enumerate();
            words.map(move |(at, word)| access(op, start.plus_words(at), word)).collect::<Vec<_>>()
        };
        let mut all = texts(Op::Write, PORT.command, line);
        all.push(access(Op::Write, PORT.command_loaded.word, PORT.command_loaded.mask));
        all.push(access(Op::Read, PORT.response_control, control));
        all.extend(texts(Op::Read, PORT.response, reply));
        all
    }

    fn shown(accesses: &[Access]) -> Vec<Access> {
        let mut filter = TextFilter::new(&PMAC.ascii);
        let mut kept = Vec::new();
        accesses.iter().for_each(|access| filter.take(*access, &mut kept));
        filter.end(&mut kept);
        kept
    }

    fn without_text(accesses: &[Access]) -> Vec<Access> {
        let hidden = |access: &Access| Access {
            value: if PORT.has_text_in(access.offset, 1) { 0 } else { access.value },
            ..*access
        };
        accesses.iter().map(hidden).collect()
    }

    #[test]
    fn questions_are_shown_and_nothing_else() {
        for order in [TextOrder::LowFirst, TextOrder::HighFirst] {
            for line in ["I122 P1..5", "type", "M3-> M5", "???"] {
                let question = exchange(order, line, response::LINE, "32");
                assert_eq!(shown(&question), question, "{line}");
            }
            for line in ["PASSWORD=SECRET", "LIST PROG 1", "P1=5", "OPEN PROG 7", "X5", "&1"] {
                let other = exchange(order, line, response::LINE, "X10Y20");
                assert_eq!(shown(&other), without_text(&other), "{line}");
            }
            // A program's own text is no reply to the line.
            let message = exchange(order, "I122", response::MESSAGE, "hello");
            let kept = shown(&message);
            assert!(
                kept.iter().filter(|access| access.offset >= PORT.response).all(|access| access.value == 0)
            );
        }
    }

    #[test]
    fn what_belongs_to_no_question_is_not_shown() {
        let question = exchange(TextOrder::LowFirst, "I122", response::LINE, "32");
        // A reply without its line, and a line without its flag.
        assert_eq!(shown(&question[4..]), without_text(&question[4..]));
        assert_eq!(shown(&question[..3]), without_text(&question[..3]));
        // The second part of a line: the first may have been a password.
        let mut long = exchange(TextOrder::LowFirst, &"P".repeat(PORT.command_bytes), response::LINE, "1");
        long.retain(|access| access.value != 0);
        let second = exchange(TextOrder::LowFirst, "12345", response::LINE, "32");
        let both = [long.clone(), second.clone()].concat();
        assert_eq!(shown(&both)[long.len()..], without_text(&second));
    }

    #[test]
    fn where_accesses_are_missing_no_text_is_shown() {
        let question = exchange(TextOrder::LowFirst, "I122", response::LINE, "32");
        let mut filter = TextFilter::new(&PMAC.ascii);
        let mut show = |step: fn(&mut TextFilter), accesses: &[Access]| {
            let mut kept = Vec::new();
            step(&mut filter);
            accesses.iter().for_each(|access| filter.take(*access, &mut kept));
            kept
        };
        assert_eq!(show(|_| (), &question), question);
        // The line before the gap is a question; a reply after the gap may be a listing.
        let reply = &question[question.len() - 3..];
        assert_eq!(show(TextFilter::distrust, reply), without_text(reply));
        assert_eq!(show(|_| (), &question), without_text(&question));
        // The first line after the gap may be the rest of a line.
        assert_eq!(show(TextFilter::trust, &question), without_text(&question));
        assert_eq!(show(|_| (), &question), question);
        assert_eq!(show(TextFilter::trust, &question), question, "there was no gap");
    }
}
