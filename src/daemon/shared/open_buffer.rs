//! Which program buffer is open on the board, and who has opened it.
//!
//! After `OPEN PROG`, `OPEN ROT` or `OPEN PLC` a line such as `I57` or `P1` is no question any more but a piece of the
//! program (Software Reference, I, J and K as circle vectors): a question asked by the way would move a machine. So
//! only the user who opened a buffer by hand, or the sequence that did, writes into it.
//!
//! The lines tell what they open, the board's status tells the rest: bits 19, 18 and 17 of the second word of `???` are a
//! motion, a rotary and a PLC buffer that is open (`Y:$0003`, which the servo report copies), whoever opened it.

use std::fmt;
use std::time::Instant;

use crate::format::Text;

/// The longest name of a buffer: `PROG 32767`.
pub const NAME_MAX: usize = 16;
/// Servo reports after a line that are not believed when they say otherwise: the board may have made them before it took the
/// line.
const OLD_REPORTS: u64 = 50;

/// ^L, which closes the rotary buffers as `CLOSE` does.
const CLOSE_ROTARY: u8 = 12;
/// ^U, which opens them as `OPEN ROT` does.
const OPEN_ROTARY: u8 = 21;
const OPEN: &str = "OPEN";
const CLOSES: [&str; 2] = ["CLOSE", "CLS"];
const BUFFERS: [&str; 7] = ["PROG", "PLCC", "PLC", "ROTARY", "ROT", "FORWARD", "INVERSE"];

/// A user and a process of his.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Account {
    /// The user.
    pub uid: u32,
    /// The process; 0 when it is not known.
    pub pid: i32,
}

/// Who sends a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// Somebody who wants to know something: the daemon, or a program by the way. Such a line enters no buffer.
    Question,
    /// A user, by hand.
    Hand(Account),
    /// A sequence of the daemon's.
    Sequence {
        /// Its number.
        number: u64,
        /// For whom it runs.
        account: Account,
        /// Its lines so far have opened a buffer that it has not closed.
        inside: bool,
    },
}

/// A buffer that a line has opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Opened {
    /// Which: `PROG 77`.
    pub name: Text<NAME_MAX>,
    /// Who did it.
    pub by: Writer,
    /// When.
    pub at: Instant,
}

/// Why a line is not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Barred {
    /// A buffer is open that this line must not enter. Who opened it is not known when it was not done through this daemon.
    Open(Option<Opened>),
    /// The buffer that its sequence had open is closed.
    Closed,
}

/// What a line does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effect {
    Opens(Text<NAME_MAX>),
    Closes,
}

/// Follows the lines that a board is sent, and its reports. Takes no memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenBuffer {
    /// What the lines so far have opened.
    opened: Option<Opened>,
    /// The board's status says that one is open, whoever opened it.
    seen: bool,
    /// The number of the last report, and of the first one that is believed again.
    report: u64,
    believed: u64,
}

impl OpenBuffer {
    /// Whether a buffer is open.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.opened.is_some() || self.seen
    }

    /// What the lines so far have opened, and the reports have not shown to be closed.
    #[must_use]
    pub const fn opened(&self) -> Option<&Opened> {
        self.opened.as_ref()
    }

    /// Why `writer` must not send `line` now, if that is so. By hand `CLOSE` always passes, and what only reports or stops.
    #[must_use]
    pub fn bars(&self, line: &[u8], writer: Writer) -> Option<Barred> {
        let own = match (self.opened.map(|opened| opened.by), writer) {
            (Some(Writer::Hand(opener)), Writer::Hand(writer)) => opener.uid == writer.uid,
            (Some(Writer::Sequence { number: opener, .. }), Writer::Sequence { number, .. }) => {
                opener == number
            }
            _ => false,
        };
        let passes = matches!(writer, Writer::Hand(_)) && (is_close(line) || enters_nothing(line));
        match writer {
            Writer::Sequence { inside: true, .. } if !own => Some(Barred::Closed),
            _ if own || passes || !self.is_open() => None,
            _ => Some(Barred::Open(self.opened)),
        }
    }

    /// Takes note of what report number `report` of the board says.
    pub fn see(&mut self, open: bool, report: u64) {
        self.report = report;
        if report >= self.believed {
            self.seen = open;
            if !open {
                self.opened = None;
            }
        }
    }

    /// Takes note of what the board answered just now: a buffer is open, or none is.
    pub fn learn(&mut self, open: bool) {
        self.seen = open;
        if !open {
            self.opened = None;
        }
    }

    /// No report comes any more: the lines alone tell.
    pub fn unsee(&mut self) {
        self.seen = false;
    }

    /// Takes note of a line that goes to the board. What it opens counts as open from now on, even if the board refuses the
    /// line: an error may follow what opened it. The reports tell, if it did not.
    pub fn begin(&mut self, line: &[u8], by: Writer, now: Instant) {
        if let Some(Effect::Opens(name)) = effect(line) {
            self.opened = Some(Opened { name, by, at: now });
            self.distrust();
        }
    }

    /// Takes note of a line that the board has answered.
    pub fn done(&mut self, line: &[u8]) {
        match effect(line) {
            Some(Effect::Closes) => self.close(),
            Some(Effect::Opens(_)) => self.distrust(),
            None => {}
        }
    }

    /// Takes note of a control character of the user `uid`.
    pub fn follow_control(&mut self, character: u8, uid: u32, now: Instant) {
        match character {
            OPEN_ROTARY => {
                let by = Writer::Hand(Account { uid, pid: 0 });
                self.opened = Some(Opened { name: Text::from_bytes(b"ROT"), by, at: now });
                self.distrust();
            }
            CLOSE_ROTARY => self.close(),
            _ => {}
        }
    }

    fn close(&mut self) {
        self.opened = None;
        self.seen = false;
        self.distrust();
    }

    /// The reports may be old for a while.
    fn distrust(&mut self) {
        self.believed = self.report + OLD_REPORTS;
    }
}

/// Whether `line` is `CLOSE` and nothing else.
fn is_close(line: &[u8]) -> bool {
    CLOSES.iter().any(|word| line.trim_ascii().eq_ignore_ascii_case(word.as_bytes()))
}

/// Whether `line` only addresses, reports and stops: `#1P`, `&2?`, `#1J/`, `&1A`. The board carries such letters out while a
/// buffer is open, too, and stores nothing: a letter of a program has a number behind it, these have none (Software Reference
/// p. 273 has `&1R &2R` under `OPEN ROT`; of the other letters it is what boards are known to do). On the other reading the
/// board would refuse the line.
fn enters_nothing(line: &[u8]) -> bool {
    let mut rest = line.trim_ascii();
    let mut acts = false;
    while let Some((&first, behind)) = rest.split_first() {
        rest = match first.to_ascii_uppercase() {
            b'#' | b'&' => &behind[behind.iter().take_while(|byte| byte.is_ascii_digit()).count()..],
            b'J' if behind.first() == Some(&b'/') => &behind[1..],
            b'?' | b'A' | b'F' | b'H' | b'K' | b'P' | b'V' => behind,
            b' ' => {
                rest = behind;
                continue;
            }
            _ => return false,
        };
        // Two letters together are another command, and a letter with a number or a value a piece of a program.
        acts |= first != b'#' && first != b'&';
        if first.is_ascii_alphabetic() && rest.first().is_some_and(|byte| !matches!(byte, b' ' | b'#' | b'&'))
        {
            return false;
        }
    }
    acts
}

/// What `line` does to the buffers in the end; `None` when it leaves them as they are.
fn effect(line: &[u8]) -> Option<Effect> {
    let mut effect = None;
    // What stands in quotes is text that a program sends.
    for part in line.split(|byte| *byte == b'"').step_by(2) {
        let mut rest = part;
        while let Some(start) = rest.iter().position(u8::is_ascii_alphabetic) {
            rest = &rest[start..];
            let end = rest.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(rest.len());
            let (word, behind) = rest.split_at(end);
            if CLOSES.iter().any(|close| word.eq_ignore_ascii_case(close.as_bytes())) {
                effect = Some(Effect::Closes);
            } else if let Some(name) = opened_by(word, behind) {
                effect = Some(Effect::Opens(name));
            }
            rest = behind;
        }
        // No buffer is open after a reset.
        if part.windows(3).any(|three| three == b"$$$") {
            effect = Some(Effect::Closes);
        }
    }
    effect
}

/// The buffer that `word` opens, or `word` together with what stands `behind` it; `None` when it opens none.
fn opened_by(word: &[u8], behind: &[u8]) -> Option<Text<NAME_MAX>> {
    let has_open = word.len() >= OPEN.len() && word[..OPEN.len()].eq_ignore_ascii_case(OPEN.as_bytes());
    let kind = if has_open { &word[OPEN.len()..] } else { return None };
    let known =
        |kind: &[u8]| BUFFERS.iter().find(|known| kind.eq_ignore_ascii_case(known.as_bytes())).copied();
    let spaces = |text: &[u8]| text.iter().take_while(|byte| **byte == b' ').count();
    let (name, number) = if kind.is_empty() {
        let behind = &behind[spaces(behind)..];
        let end = behind.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(behind.len());
        (known(&behind[..end]).unwrap_or(""), &behind[end..])
    } else {
        (known(kind)?, behind)
    };
    let number = &number[spaces(number)..];
    let digits = number.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut text = [b' '; NAME_MAX];
    let letters = name.len().min(NAME_MAX);
    text[..letters].copy_from_slice(&name.as_bytes()[..letters]);
    let room = digits.min(NAME_MAX - letters - 1);
    text[letters + 1..letters + 1 + room].copy_from_slice(&number[..room]);
    Some(Text::from_bytes(text.trim_ascii()))
}

impl Barred {
    /// What the user is told at `now`: what is open, by whom and since when, and what to do.
    #[must_use]
    pub fn reason(&self, now: Instant) -> String {
        match self {
            Self::Open(Some(Opened { name, by, at })) => {
                let name = if name.is_empty() { "a program buffer" } else { name };
                let who = match by {
                    Writer::Sequence { account, .. } => format!("a sequence of {account}"),
                    Writer::Hand(account) => account.to_string(),
                    Writer::Question => "somebody".to_owned(),
                };
                let seconds = now.saturating_duration_since(*at).as_secs();
                format!(
                    "not sent, it would have become a program line: {who} has had {name} open for {seconds} s; CLOSE by an \
                     engineer closes it"
                )
            }
            Self::Open(None) => "not sent, it would have become a program line: the board's status says that a program buffer is \
                                 open, opened by somebody else (the serial port, another host, or before pmacd started); \
                                 CLOSE by an engineer closes it"
                .to_owned(),
            Self::Closed => "not sent, it would have been carried out at once: somebody closed the program buffer that this \
                             sequence had open"
                .to_owned(),
        }
    }
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.pid {
            0 => write!(f, "uid {}", self.uid),
            pid => write!(f, "uid {} (pid {pid})", self.uid),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANNE: Writer = Writer::Hand(Account { uid: 1000, pid: 1 });
    const BOB: Writer = Writer::Hand(Account { uid: 1001, pid: 2 });

    fn sequence(number: u64, inside: bool) -> Writer {
        Writer::Sequence { number, account: Account { uid: 1000, pid: 1 }, inside }
    }

    /// Both ends of a line that the board takes.
    fn sent(buffer: &mut OpenBuffer, line: &str, by: Writer) {
        buffer.begin(line.as_bytes(), by, Instant::now());
        buffer.done(line.as_bytes());
    }

    #[test]
    fn b1_2_what_only_reports_or_stops_enters_no_buffer() {
        for line in ["#1P", "#3 P V F", "&2?", "???", "#1J/", "&1A", "#1k", " #1 #2 p "] {
            assert!(enters_nothing(line.as_bytes()), "{line}");
        }
        for line in [
            "P1", "#1P1", "P=1", "A10", "#1J+", "#1J=5", "F100", "K5", "I57", "PR1", "&1R", "&1 B1", "#1",
            "", "H(P1)", "P,5",
        ] {
            assert!(!enters_nothing(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn b1_2_only_who_opened_a_buffer_writes_into_it() {
        let mut buffer = OpenBuffer::default();
        let everybody = [ANNE, BOB, sequence(1, false), Writer::Question];
        assert!(everybody.iter().all(|writer| buffer.bars(b"X1", *writer).is_none()));
        sent(&mut buffer, "OPEN PROG 77 CLEAR", ANNE);
        let other_process = Writer::Hand(Account { uid: 1000, pid: 9 });
        assert_eq!((buffer.bars(b"X1", ANNE), buffer.bars(b"X1", other_process)), (None, None));
        for writer in [BOB, sequence(1, false), Writer::Question] {
            let Some(Barred::Open(Some(opened))) = buffer.bars(b"X1", writer) else { panic!("{writer:?}") };
            assert_eq!((&*opened.name, opened.by), ("PROG 77", ANNE));
        }
        assert_eq!(buffer.bars(b" close ", BOB), None);
        assert!(
            buffer.bars(b"CLOSE", sequence(1, false)).is_some() && buffer.bars(b"CLOSE X1", BOB).is_some()
        );
        sent(&mut buffer, "CLOSE", BOB);
        sent(&mut buffer, "OPEN PLC 3", sequence(1, false));
        assert_eq!(buffer.bars(b"X1", sequence(1, true)), None);
        assert!(buffer.bars(b"X1", sequence(2, false)).is_some() && buffer.bars(b"X1", ANNE).is_some());
        sent(&mut buffer, "CLOSE", ANNE);
        assert_eq!(
            buffer.bars(b"X1", sequence(1, true)),
            Some(Barred::Closed),
            "it would be carried out at once"
        );
    }

    #[test]
    fn b1_2_the_boards_reports_tell_what_others_open_and_close() {
        let mut buffer = OpenBuffer::default();
        buffer.see(true, 1);
        assert_eq!(buffer.bars(b"X1", ANNE), Some(Barred::Open(None)));
        sent(&mut buffer, "CLOSE", ANNE);
        buffer.see(true, 2);
        assert!(!buffer.is_open(), "a report from before");
        buffer.see(true, 2 + OLD_REPORTS);
        assert!(buffer.is_open(), "not closed after all");
        buffer.see(false, 60);
        sent(&mut buffer, "OPEN PROG 1", ANNE);
        buffer.see(false, 61);
        assert!(buffer.is_open(), "a report from before");
        buffer.see(false, 61 + OLD_REPORTS);
        assert!(!buffer.is_open(), "the board has refused the line, or somebody else has closed it");
        sent(&mut buffer, "OPEN PROG 1", ANNE);
        buffer.unsee();
        assert!(buffer.is_open(), "no report comes");
        buffer.learn(true);
        assert_eq!(buffer.bars(b"X1", ANNE), None);
        buffer.learn(false);
        assert!(!buffer.is_open());
    }

    #[test]
    fn lines_open_and_close() {
        let mut buffer = OpenBuffer::default();
        for (line, open) in [
            ("CLOSE", None),
            ("SEND\"OPEN PROG 1\"", None),
            ("OPEN PROG 1", Some("PROG 1")),
            ("X10 Y20", Some("PROG 1")),
            ("CMD\"CLOSE\"", Some("PROG 1")),
            ("close", None),
            ("&1open rot", Some("ROT")),
            ("$$$", None),
            ("CLOSE OPEN PLC 3 CLEAR", Some("PLC 3")),
            ("OPENPROG77CLEAR", Some("PROG 77")),
            ("OPEN", Some("")),
            ("OPENPROG 123456789012345678", Some("PROG 12345678901")),
            ("OPENED CLS", None),
        ] {
            sent(&mut buffer, line, ANNE);
            assert_eq!(buffer.opened.as_ref().map(|opened| &*opened.name), open, "{line}");
        }
        buffer.follow_control(21, 1001, Instant::now());
        assert!(buffer.bars(b"X1", BOB).is_none() && buffer.bars(b"X1", ANNE).is_some());
        buffer.follow_control(1, 1001, Instant::now());
        assert!(buffer.is_open());
        buffer.follow_control(12, 1001, Instant::now());
        assert!(!buffer.is_open());
    }
}
