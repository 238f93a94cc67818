//! Tracks which program buffer is open on the board, and which client has opened it.
//!
//! After `OPEN PROG`, `OPEN ROT` or `OPEN PLC` a line such as `I57` or `P1` is no longer a question but a piece of the
//! program (Software Reference, I, J and K as circle vectors): a question sent meanwhile would move a machine. So only
//! the user who opened a buffer by hand, or the sequence that opened it, writes into it.
//!
//! The daemon's own lines tell which buffers they open. The board's status tells of all others: bits 19, 18 and 17 of
//! the second word of `???` stand for an open motion, rotary and PLC buffer (`Y:$0003`, which the servo report copies).
//! On Turbo boards the background report copies that word (`Y:$000006`). Where no such report comes, the daemon asks
//! the board by [`QUESTION`]. Kinematic programs have no bit: if one of the daemon's lines opens such a program, the
//! lines and the answer tell; if another host opens one, only the answer tells.
//!
//! `OPEN BINARY ROTARY` lets no text in: "no ASCII text commands can be entered into the internal rotary buffers"
//! (Software Reference p. 271). So it shuts no client out. But only one buffer can be open at a time, so the daemon
//! tells a client that would open another buffer, or close this one, whose buffer it is.

use std::fmt;
use std::time::{Duration, Instant};

use super::rotary_address::{AddressFirst, RotaryAddress};
pub use super::writer::{Account, Writer};
use crate::format::Text;
pub use crate::language::NAME_MAX;
use crate::language::{Effect, Meaning, is_rotary};
use crate::protocol::OpenBufferInfo;

/// The question whether a buffer is open: the free memory, "negative sign while a buffer is open" (Software Reference,
/// `SIZE`). So the board answers the question at once even while a buffer is open, and no program contains that word.
pub const QUESTION: &[u8] = b"SIZE";
/// How long the daemon believes the answer.
pub const ANSWER_AGE: Duration = Duration::from_millis(200);
/// How long until the daemon asks again a board that does not know the question: the board would answer the same.
const REFUSAL_AGE: Duration = Duration::from_secs(10);
/// How many servo reports after a line the daemon does not believe: the board may have made them before it took the
/// line.
const OLD_REPORTS: u64 = 50;
/// A report that the host asks for counts as this many servo reports. The report under way while a line goes out may be
/// older than the line; the host asks for the next report after the line.
pub const ASKED_REPORT: u64 = OLD_REPORTS / 2;

/// The error of an `OPEN` while a buffer is open: buffer already in use (Software Reference p. 25).
const IN_USE: u16 = 7;

/// The buffers that no report covers.
const UNREPORTED: [&str; 2] = ["FORWARD", "INVERSE"];

/// A buffer that a line has opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Opened {
    /// The buffer: `PROG 77`.
    pub name: Text<NAME_MAX>,
    /// The account that opened the buffer.
    pub by: Writer,
    /// When.
    pub at: Instant,
}

/// Why the daemon does not send a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Barred {
    /// A buffer is open that this line must not enter. The opener is unknown unless it opened the buffer through this
    /// daemon.
    Open(Option<Opened>),
    /// A buffer is open, and this line would close it, empty it or open another one.
    Changes(Option<Opened>),
    /// A buffer is open, and this line belongs to a sequence, though the line does not touch the buffer.
    Sequence(Option<Opened>),
    /// Another client has addressed another coordinate system, whose rotary buffer this line would enter.
    Addressed,
    /// The buffer that the line's sequence or client had open is closed.
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

/// Whether a buffer is open, as far as the daemon knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Standing {
    /// A buffer is open.
    pub is_open: bool,
    /// The buffer and its opener, if a client opened it through this daemon.
    pub opened: Option<Opened>,
    /// The board does not say whether another host has opened a buffer.
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

/// Follows the lines to a board, and the board's reports. Allocates nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenBuffer {
    /// The buffer that the daemon's lines have opened.
    opened: Option<Opened>,
    /// The buffer that was open before the last opening line.
    opened_before: Option<Opened>,
    /// The lines have opened the rotary buffers for binary lines only.
    binary: Option<Opened>,
    /// The board says that a buffer is open, by any opener.
    seen: bool,
    /// Reports come that tell of open buffers.
    has_reports: bool,
    /// Until then the daemon believes the board's last answer.
    believed_until: Option<Instant>,
    /// The board does not answer the question.
    unsaid: Option<Unsaid>,
    /// The outcome of an opening or closing line is unknown.
    in_doubt: bool,
    /// The number of the last report, and of the first report that the daemon believes again.
    report: u64,
    believed: u64,
    /// A line opened or closed a buffer while no reports came: the first new reports may be older than the line.
    changed_unseen: bool,
    /// A line that opens a buffer is on its way, and the board has not answered yet: the board's reports may still be
    /// older.
    opens_now: bool,
    /// The coordinate system whose rotary buffer the next line enters.
    address: RotaryAddress,
}

impl OpenBuffer {
    /// The state for a board after a reset, or at first contact: no buffer is known to be open. The first reports may
    /// be old ones, so the daemon asks the board.
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

    /// The buffer that the lines have opened and that no report has shown closed.
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

    /// Whether the board itself has told the state recently enough.
    #[must_use]
    pub fn is_known(&self, now: Instant) -> bool {
        let is_fresh = self.believed_until.is_some_and(|until| now < until);
        self.has_reports && !self.in_doubt || is_fresh
    }

    /// Whether the daemon has to ask the board before `writer` may send `line`. False for the buffer's opener and for
    /// lines that store nothing.
    #[must_use]
    pub fn must_ask(&self, line: &Meaning, writer: Writer, now: Instant) -> bool {
        // A reset closes the buffer without a line. The board would then carry out at once a line meant for the buffer.
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

    /// Whether `writer` has opened the open buffer.
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

    /// Why `writer` must not send `line` now; `None` if it may. On-line commands pass, except from a sequence, whose
    /// later lines would enter the buffer. `CLOSE` by hand passes, too.
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

    /// The step that the address needs before `writer` sends `line`, which is not barred.
    #[must_use]
    pub fn address_first(&self, line: &Meaning, writer: Writer) -> Option<AddressFirst> {
        let opener = self.rotary_opener()?;
        let enters = self.is_own(writer) && !line.is_close && !line.while_open.passes();
        self.address.before(line, writer, opener, enters)
    }

    /// The board has told which coordinate system is addressed, or has not.
    pub fn told_address(&mut self, system: Option<u32>) {
        self.address.told(system);
    }

    /// The board again addresses the coordinate system that the opener of the rotary buffers had addressed.
    pub fn address_is_back(&mut self) {
        self.address.is_back();
    }

    /// The fate of `line`, which `writer` was free to send, if another sender has opened or closed a buffer meanwhile.
    #[must_use]
    pub fn surprise(&self, line: &Meaning, writer: Writer) -> Option<Barred> {
        self.bars(line, writer).filter(|_| line.buffer.is_none())
    }

    /// Takes in the board's report number `report`.
    pub fn see(&mut self, open: bool, report: u64) {
        (self.has_reports, self.report) = (true, report);
        if std::mem::take(&mut self.changed_unseen) {
            self.distrust();
            // The daemon does not know either which buffers others have opened meanwhile.
            self.in_doubt = true;
        }
        let is_told = open || !self.opened.is_some_and(|opened| UNREPORTED.contains(&&*opened.name));
        if report >= self.believed && !self.opens_now && is_told {
            self.settle(open);
        }
    }

    /// Takes in the board's answer to [`QUESTION`]: the free memory. A size of 0 has no sign, and `None` is no useful
    /// answer: in both cases only the lines tell.
    pub fn learn(&mut self, size: Option<i64>, now: Instant) {
        self.believed_until = Some(now + ANSWER_AGE);
        self.unsaid = self.unsaid.filter(|_| size.is_none());
        match size {
            // One buffer is open at a time, and no manual says whether the buffer for binary lines causes the sign.
            Some(size) if size != 0 => self.settle(size < 0 && self.binary.is_none()),
            _ => (self.seen, self.in_doubt) = (false, false),
        }
    }

    /// The board does not answer [`QUESTION`], so only the lines tell. Returns whether that is news.
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

    /// The board has acknowledged a question without an answer, as if another host had just opened a program and the
    /// question had become a line of it: the daemon no longer believes the board's earlier reports.
    pub fn disbelieve(&mut self) {
        (self.in_doubt, self.believed_until) = (true, None);
        self.distrust();
    }

    /// Reports have stopped: the daemon has to ask the board.
    pub fn unsee(&mut self) {
        if std::mem::take(&mut self.has_reports) {
            self.believed_until = None;
        }
    }

    /// Takes note of a line that goes to the board. The buffer that the line opens counts as open from now on, even if
    /// the board refuses the line: the error may come from a later command of the line.
    pub fn begin(&mut self, line: &Meaning, by: Writer, now: Instant) {
        if let Some(opener) = self.rotary_opener() {
            self.address.goes(line, by, opener);
        }
        let is_stream = matches!(by, Writer::Sequence { .. }) && self.is_own(by);
        if let Some(binary) = self.binary.as_mut().filter(|_| is_stream) {
            // The stream that opened the rotary buffers may be over: a stream that goes on has them open.
            binary.by = by;
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

    /// Takes note of a line that the board has refused with this error. If the error says so, a buffer was open before
    /// and still is.
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

    /// Takes note of a line that the board may or may not have carried out: the buffer that the line opens or closes
    /// may be open or not.
    pub fn doubt(&mut self, line: &Meaning) {
        self.opens_now = false;
        if line.buffer.is_some() {
            (self.in_doubt, self.believed_until) = (true, None);
            self.distrust();
        }
    }

    /// On Turbo boards `CLOSE` may close only buffers that this port has opened; no manual says so. So the board has to
    /// tell whether another sender's buffer is closed.
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
    /// The message for the user at `now`: the open buffer, its opener, since when, and the cure.
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
    /// The message for the user about a line that the daemon sent before it knew.
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
