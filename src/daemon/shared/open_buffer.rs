//! Which program buffer is open on the board, and who has opened it.
//!
//! After `OPEN PROG`, `OPEN ROT` or `OPEN PLC` a line such as `I57` or `P1` is no question any more but a piece of the
//! program (Software Reference, I, J and K as circle vectors): a question asked by the way would move a machine. So
//! only the user who opened a buffer by hand, or the sequence that did, writes into it.
//!
//! The lines tell what they open, the board's status tells the rest: bits 19, 18 and 17 of the second word of `???` are a
//! motion, a rotary and a PLC buffer that is open (`Y:$0003`, which the servo report copies), whoever opened it. On Turbo boards
//! the background report copies that word (`Y:$000006`). Where no such report comes, the board is asked by [`QUESTION`]. No bit is a
//! kinematic program's: of one that a line has opened the lines and the answer tell, and of one that another host opens the answer
//! alone.
//!
//! `OPEN BINARY ROTARY` lets no text in: "no ASCII text commands can be entered into the internal rotary buffers" (Software Reference
//! p. 271). So it shuts nobody out; but as one buffer is open at a time, who would open another one or close this is told whose it is.

use std::fmt;
use std::time::{Duration, Instant};

use super::rotary_address::{AddressFirst, RotaryAddress};
pub use super::writer::{Account, Writer};
use crate::format::Text;
pub use crate::language::NAME_MAX;
use crate::language::{Effect, Meaning, is_rotary};
use crate::protocol::OpenBufferInfo;

/// The question whether a buffer is open: the free memory, "negative sign while a buffer is open" (Software Reference, `SIZE`).
/// So the board answers it at once while one is open, too, and it is no word of any program.
pub const QUESTION: &[u8] = b"SIZE";
/// How long its answer is believed.
pub const ANSWER_AGE: Duration = Duration::from_millis(200);
/// How long a board that does not know the question is not asked again: it answers the same.
const REFUSAL_AGE: Duration = Duration::from_secs(10);
/// Servo reports after a line that are not believed when they say otherwise: the board may have made them before it took the
/// line.
const OLD_REPORTS: u64 = 50;
/// A report that the host asks for counts as so many: the one under way at a line may be older than it, the next one is asked for
/// after it.
pub const ASKED_REPORT: u64 = OLD_REPORTS / 2;

/// The error of an `OPEN` while a buffer is open: buffer already in use (Software Reference p. 25).
const IN_USE: u16 = 7;

/// The buffers of which no report tells.
const UNREPORTED: [&str; 2] = ["FORWARD", "INVERSE"];

/// A buffer that a line has opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Opened {
    /// Which: `PROG 77`.
    pub name: Text<NAME_MAX>,
    /// The account that opened the buffer.
    pub by: Writer,
    /// When.
    pub at: Instant,
}

/// Why a line is not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Barred {
    /// A buffer is open that this line must not enter. Who opened it is not known when it was not done through this daemon.
    Open(Option<Opened>),
    /// A buffer is open, and this line would close it, empty it or open another one.
    Changes(Option<Opened>),
    /// A buffer is open, and this line, which does not touch it, is a sequence's.
    Sequence(Option<Opened>),
    /// Another client has addressed another coordinate system, whose rotary buffer this line would enter.
    Addressed,
    /// The buffer that its sequence had open is closed.
    Closed,
}

/// Why the board does not say whether a buffer is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unsaid {
    /// The board refuses [`QUESTION`] with this error.
    Refused(u16),
    /// The board answers [`QUESTION`] with something else.
    Otherwise,
}

/// Whether a buffer is open, as far as known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Standing {
    /// A buffer is open.
    pub is_open: bool,
    /// Which, and who has opened it, where that was done through this daemon.
    pub opened: Option<Opened>,
    /// The board does not say whether another host has opened one.
    pub is_unsaid: bool,
}

impl Standing {
    /// The text for clients; empty when no buffer is open.
    #[must_use]
    pub fn info(&self) -> Option<OpenBufferInfo> {
        let Some(Opened { name, by, .. }) = self.opened else {
            return self.is_open.then(OpenBufferInfo::default);
        };
        let (account, sequence) = match by {
            Writer::Hand(account) | Writer::IntoBuffer(account) => (Some(account), false),
            Writer::Sequence { account, .. } => (Some(account), true),
            Writer::Question | Writer::Stop | Writer::Beside => (None, false),
        };
        Some(OpenBufferInfo {
            name: Some(name.to_string()),
            uid: account.map(|account| account.uid),
            pid: account.map(|account| account.pid).filter(|pid| *pid != 0),
            sequence,
        })
    }
}

/// Follows the lines that a board is sent, and its reports. Takes no memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenBuffer {
    /// The buffer that the lines so far have opened.
    opened: Option<Opened>,
    /// The buffer that was open before the last opening line.
    opened_before: Option<Opened>,
    /// They have opened the rotary buffers for binary lines, and for no text.
    binary: Option<Opened>,
    /// The board says that one is open, whoever opened it.
    seen: bool,
    /// Reports come, and tell.
    has_reports: bool,
    /// Until then what the board has answered last is believed.
    believed_until: Option<Instant>,
    /// The board does not answer the question.
    unsaid: Option<Unsaid>,
    /// The outcome of an opening or closing line is unknown.
    in_doubt: bool,
    /// The number of the last report, and of the first one that is believed again.
    report: u64,
    believed: u64,
    /// A buffer was opened or closed while no report came: the first ones that come may be older.
    changed_unseen: bool,
    /// A line that opens one goes to the board, which has not answered it: its reports may still be older.
    opens_now: bool,
    /// Which coordinate system's rotary buffer the next line enters.
    address: RotaryAddress,
}

impl OpenBuffer {
    /// Of a board that was just reset, or is met for the first time: none is known to be open. Its first reports may lie there from
    /// before, so the board is asked.
    #[must_use]
    pub fn after_reset() -> Self {
        let mut buffer = Self::default();
        buffer.distrust();
        buffer
    }

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

    /// The text for other clients.
    #[must_use]
    pub const fn standing(&self) -> Standing {
        let is_unsaid = self.unsaid.is_some() && !self.has_reports;
        Standing { is_open: self.is_open(), opened: self.opened, is_unsaid }
    }

    /// Whether that is the board's own word, and not too old.
    #[must_use]
    pub fn is_known(&self, now: Instant) -> bool {
        let is_fresh = self.believed_until.is_some_and(|until| now < until);
        self.has_reports && !self.in_doubt || is_fresh
    }

    /// Whether the board has to be asked before `writer` may send `line`. Who opened the buffer needs not know, and what stores
    /// nothing does not wait.
    #[must_use]
    pub fn must_ask(&self, line: &Meaning, writer: Writer, now: Instant) -> bool {
        // A reset closes the buffer without a line. The board would then carry out at once a line meant for it.
        let goes_by_lines = self.is_own(writer) && !matches!(writer, Writer::IntoBuffer(_));
        let is_sure = self.is_known(now) || goes_by_lines && !self.in_doubt;
        let closes =
            matches!(writer, Writer::Hand(_) | Writer::IntoBuffer(_) | Writer::Beside) && line.is_close;
        let passes = !matches!(writer, Writer::Sequence { .. }) && line.while_open.passes();
        !is_sure && !closes && !passes
    }

    /// Whether the lines so far have opened the rotary buffers for binary lines and have not closed them.
    #[must_use]
    pub const fn has_binary(&self) -> bool {
        self.binary.is_some()
    }

    /// Whether `writer` has opened what is open.
    fn is_own(&self, writer: Writer) -> bool {
        match (self.opened.or(self.binary).map(|opened| opened.by), writer) {
            (Some(Writer::Hand(opener) | Writer::IntoBuffer(opener)), Writer::Hand(writer)) => {
                opener.uid == writer.uid
            }
            (Some(Writer::Hand(opener) | Writer::IntoBuffer(opener)), Writer::IntoBuffer(writer)) => {
                opener == writer
            }
            (Some(Writer::Sequence { number: opener, .. }), Writer::Sequence { number, .. }) => {
                opener == number
            }
            _ => false,
        }
    }

    /// Why `writer` must not send `line` now, if that is so. What is on-line only passes, but of a sequence: that has lines behind it
    /// which enter. By hand `CLOSE` passes, too.
    #[must_use]
    pub fn bars(&self, line: &Meaning, writer: Writer) -> Option<Barred> {
        let own = self.is_own(writer);
        let while_open = line.while_open;
        let passes = match writer {
            Writer::Hand(_) | Writer::IntoBuffer(_) | Writer::Beside => line.is_close || while_open.passes(),
            Writer::Stop | Writer::Question => while_open.passes(),
            Writer::Sequence { .. } => false,
        };
        match writer {
            Writer::Sequence { inside: true, .. } if !own => Some(Barred::Closed),
            Writer::IntoBuffer(_) if !self.is_open() && !passes && !line.opens() => Some(Barred::Closed),
            _ if own || passes => None,
            _ if !self.is_open() => {
                self.binary.filter(|_| while_open.changes).map(|by| Barred::Changes(Some(by)))
            }
            _ if while_open.enters => Some(Barred::Open(self.opened)),
            _ if while_open.changes => Some(Barred::Changes(self.opened)),
            _ => Some(Barred::Sequence(self.opened)),
        }
    }

    /// The account that opened the rotary buffers for text through this daemon.
    fn rotary_opener(&self) -> Option<Writer> {
        self.opened.filter(|opened| is_rotary(&opened.name)).map(|opened| opened.by)
    }

    /// What has to be done about the address before `writer` sends `line`, which is not barred.
    #[must_use]
    pub fn address_first(&self, line: &Meaning, writer: Writer) -> Option<AddressFirst> {
        let opener = self.rotary_opener()?;
        let enters = self.is_own(writer) && !line.is_close && !line.while_open.passes();
        self.address.before(line, writer, opener, enters)
    }

    /// The board has told what is addressed, or has not.
    pub fn told_address(&mut self, system: Option<u32>) {
        self.address.told(system);
    }

    /// The board addresses again what who opened the rotary buffers had addressed.
    pub fn address_is_back(&mut self) {
        self.address.is_back();
    }

    /// What has become of `line`, which `writer` was free to send, if somebody has opened or closed a buffer meanwhile.
    #[must_use]
    pub fn surprise(&self, line: &Meaning, writer: Writer) -> Option<Barred> {
        self.bars(line, writer).filter(|_| line.buffer.is_none())
    }

    /// Takes note of what report number `report` of the board says.
    pub fn see(&mut self, open: bool, report: u64) {
        (self.has_reports, self.report) = (true, report);
        if std::mem::take(&mut self.changed_unseen) {
            self.distrust();
            // Nor is it known what others have opened meanwhile.
            self.in_doubt = true;
        }
        let is_told = open || !self.opened.is_some_and(|opened| UNREPORTED.contains(&&*opened.name));
        if report >= self.believed && !self.opens_now && is_told {
            self.settle(open);
        }
    }

    /// Takes note of what the board has answered to [`QUESTION`]: the free memory, 0 of which has no sign; or nothing of use. Then
    /// the lines alone tell.
    pub fn learn(&mut self, size: Option<i64>, now: Instant) {
        self.believed_until = Some(now + ANSWER_AGE);
        self.unsaid = self.unsaid.filter(|_| size.is_none());
        match size {
            // One buffer is open at a time, and no manual says whether that for binary lines makes the sign.
            Some(size) if size != 0 => self.settle(size < 0 && self.binary.is_none()),
            _ => (self.seen, self.in_doubt) = (false, false),
        }
    }

    /// The board does not answer [`QUESTION`]. The lines alone tell. Whether that is news.
    pub fn is_not_said(&mut self, why: Unsaid, now: Instant) -> bool {
        self.learn(None, now);
        self.believed_until = Some(now + REFUSAL_AGE);
        self.unsaid.replace(why) != Some(why)
    }

    fn settle(&mut self, open: bool) {
        (self.seen, self.in_doubt) = (open, false);
        if open {
            self.binary = None;
        } else {
            self.opened = None;
        }
    }

    /// The board has acknowledged a question without an answer, as it does where that is a line of a program that another host has just
    /// opened: what it said before is not believed.
    pub fn disbelieve(&mut self) {
        (self.in_doubt, self.believed_until) = (true, None);
        self.distrust();
    }

    /// No report comes any more: the board has to be asked.
    pub fn unsee(&mut self) {
        if std::mem::take(&mut self.has_reports) {
            self.believed_until = None;
        }
    }

    /// Takes note of a line that goes to the board. What it opens counts as open from now on, even if the board refuses the
    /// line: an error may follow what opened it.
    pub fn begin(&mut self, line: &Meaning, by: Writer, now: Instant) {
        if let Some(opener) = self.rotary_opener() {
            self.address.goes(line, by, opener);
        }
        match line.buffer {
            Some(Effect::Opens(name)) => {
                self.address = RotaryAddress::default();
                self.opened_before = self.opened.replace(Opened { name, by, at: now });
                self.opens_now = true;
                self.distrust();
            }
            Some(Effect::OpensBinary) => {
                self.binary = Some(Opened { name: Text::from_bytes(b"BINARY ROTARY"), by, at: now });
            }
            _ => {}
        }
    }

    /// Takes note of a line that the board has acknowledged.
    pub fn done(&mut self, line: &Meaning) {
        self.opens_now = false;
        match line.buffer {
            Some(Effect::Closes) => self.close(),
            Some(Effect::Opens(_)) => self.distrust(),
            Some(Effect::OpensBinary) | None => {}
        }
    }

    /// Takes note of a line that the board has refused with this error. One was open before, if that says so, and is still.
    pub fn refused(&mut self, line: &Meaning, error: u16) {
        self.doubt(line);
        if line.buffer == Some(Effect::OpensBinary) {
            self.binary = None;
        }
        if error == IN_USE && line.opens() {
            self.opened = self.opened_before;
            self.settle(true);
        }
    }

    /// Takes note of a line that may have been carried out or not: what it opens or closes may be open or not.
    pub fn doubt(&mut self, line: &Meaning) {
        self.opens_now = false;
        if line.buffer.is_some() {
            (self.in_doubt, self.believed_until) = (true, None);
            self.distrust();
        }
    }

    /// On Turbo boards `CLOSE` may close what this port has opened and nothing else; no manual says so: of somebody else's buffer the
    /// board has to say whether it is closed.
    fn close(&mut self) {
        if self.seen && self.opened.is_none() {
            (self.in_doubt, self.believed_until) = (true, None);
        }
        (self.opened, self.binary) = (None, None);
        self.seen = false;
        self.distrust();
    }

    /// The reports may be old for a while.
    fn distrust(&mut self) {
        self.believed = self.report + OLD_REPORTS;
        self.changed_unseen = !self.has_reports;
    }
}

impl fmt::Display for Unsaid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Refused(error) => write!(f, "refuses SIZE (ERR{error:03})"),
            Self::Otherwise => f.write_str("answers SIZE with something else"),
        }
    }
}

impl Barred {
    /// What the user is told at `now`: what is open, by whom and since when, and what to do.
    #[must_use]
    pub fn reason(&self, now: Instant) -> String {
        let (harm, opened) = match self {
            Self::Open(opened) => ("it would have become a program line", opened),
            Self::Changes(opened) => ("it would change what is open", opened),
            Self::Sequence(opened) => ("it belongs to a sequence, which begins when nothing is open", opened),
            Self::Addressed => {
                return "not sent, it would enter another rotary buffer: somebody else has addressed another coordinate system; begin \
                        the line with the address (&1X10)"
                    .to_owned();
            }
            Self::Closed => {
                return "not sent, it would have been carried out at once: somebody closed the program buffer that it belongs \
                        into, or the board was reset"
                    .to_owned();
            }
        };
        let Some(Opened { name, by, at }) = opened else {
            return format!(
                "not sent, {harm}: the board says that a program buffer is open, opened by somebody else (the serial port, another \
                 host, or before pmacd started); CLOSE by an engineer closes it, on a Turbo board maybe only CLOSE ALL"
            );
        };
        let name = if name.is_empty() { "a program buffer" } else { name };
        let who = match by {
            Writer::Sequence { account, .. } => format!("a sequence of {account}"),
            Writer::Hand(account) | Writer::IntoBuffer(account) => account.to_string(),
            Writer::Question | Writer::Stop | Writer::Beside => "somebody".to_owned(),
        };
        let seconds = now.saturating_duration_since(*at).as_secs();
        format!("not sent, {harm}: {who} has had {name} open for {seconds} s; CLOSE by an engineer closes it")
    }
}

impl Barred {
    /// What the user is told of a line that was sent before this was known.
    #[must_use]
    pub const fn too_late(&self) -> &'static str {
        match self {
            Self::Open(_) | Self::Changes(_) | Self::Sequence(_) | Self::Addressed => {
                "the line may have entered the program buffer that somebody else opened at this moment (the serial port, or another \
                 host), and not have been carried out; LIST shows it"
            }
            Self::Closed => {
                "the line may have been carried out at once: somebody closed the program buffer at this moment that it belongs into"
            }
        }
    }
}

#[cfg(test)]
#[path = "open_buffer_tests.rs"]
mod tests;
