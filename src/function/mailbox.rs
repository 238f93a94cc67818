//! The VME mailbox port: command lines and replies through sixteen byte registers (PMAC User Manual p. 263-267).
//!
//! | register | host | PMAC |
//! |---|---|---|
//! | mailbox 0, 2-15 | writes a group of up to 15 characters, mailbox 0 last | takes it, then interrupts with vector v-1 |
//! | mailbox 1 | writes 0: the next group of a reply may come | - |
//! | mailbox 0-15 | reads, up to `<CR>`, `<ACK>`, `<BELL>` or all 16 | fills, then interrupts with vector v |
//! | base + 0x121 | writes bits A19-A14 of the DPRAM's address after every reset | selects the page |
//!
//! Mailbox n is the byte at base + 2n + 1. A line ends with `<CR>`, which may be a group of its own. The host writes a
//! control character alone to mailbox 0. The mailboxes behind a group's last character hold characters of older
//! groups.
//!
//! The registers do not tell how far PMAC is; the two interrupts do ([`MailboxPort::signal`]). So the host remembers
//! whether it has written mailbox 1 since the last group: if the host wrote it while a group is unread, PMAC would put
//! the next group over the unread one.
//!
//! For one driver in production, on Turbo boards, the `<BELL>` of an error ends a group (epics-modules/tpmac); for
//! another, on PMAC boards, the error's text is in the same group (Gemini pmaclib). The characters behind the `<BELL>`
//! show which: an older group never has exactly the text that I6 asks for there.
//!
//! Needs I3 = 2 (or 3): without `<ACK>` a reply has no end. The text of a program's `CMD"..."` or `SEND"..."` looks
//! like a line of a reply; the port reports a line that comes while no caller awaits a reply as a program's message.

use std::time::{Duration, Instant};

use super::line_port::{AsciiEvent, ResponseText};
use crate::device::{ByteBus, ByteBusError};
use crate::protocol::control::CANCEL;

/// How long the board must be silent after the port gave up a reply, before the port is used again.
pub const MAILBOX_SETTLE: Duration = Duration::from_millis(50);
/// How long a group of a line may stay untaken before an urgent control character replaces it: an interrupt may be
/// lost.
pub const MAILBOX_GROUP_LIES: Duration = Duration::from_millis(50);
/// How long the board may leave the `<CTRL-X>` untaken. Until the board takes it, more of the abandoned reply may
/// come.
pub const MAILBOX_CANCEL_TAKEN: Duration = Duration::from_secs(1);
/// How long after its last line a control character's reply counts as complete if no `<ACK>` ends the reply. On the
/// DPRAM port a line of the daemon's own settles the end; here the host's line and the board's reply share the
/// registers, so that line could overwrite a group of the reply (User Manual p. 263-267).
pub const MAILBOX_REPLY_SILENCE: Duration = Duration::from_millis(50);

/// The most characters of a group that the host sends: the host leaves mailbox 1 out.
const SEND_GROUP: usize = 15;
/// The most characters of a group that PMAC sends.
const RECEIVE_GROUP: usize = 16;
/// The most characters of a reply line.
const LINE_LIMIT: usize = 255;

const ACKNOWLEDGE: u8 = 0x06;
const BELL: u8 = 0x07;
const LINE_FEED: u8 = 0x0A;
const RETURN: u8 = 0x0D;

const fn mailbox(number: usize) -> u32 {
    2 * number as u32 + 1
}

/// The meaning of an interrupt of a PMAC on the VME bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MailboxSignal {
    /// Vector v-1: PMAC has taken the group the host sent.
    GroupTaken,
    /// Vector v: a group of a reply is in the mailboxes.
    ReplyReady,
}

/// How the board reports an error (I6). The port must know, because the characters behind a `<BELL>` may belong to an
/// old group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorReport {
    /// I6 = 0 or 2: `<BELL>` alone; error numbers are then 0.
    BellOnly,
    /// I6 = 1: `<BELL>ERRnnn<CR>`.
    #[default]
    SameLine,
    /// I6 = 3: `<BELL><CR>ERRnnn<CR>`.
    NextLine,
}

/// When the host lets PMAC send.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnableReplies {
    /// After every group that the host reads, also the last, so that messages of programs come at any time. The
    /// manual's way.
    #[default]
    Always,
    /// Only while the host awaits a reply, anew for each command: some boards do not keep the permission.
    WithCommand,
}

/// Settings of the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MailboxSettings {
    /// How the board reports an error.
    pub error_report: ErrorReport,
    /// When the host lets PMAC send.
    pub enable_replies: EnableReplies,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MailboxState {
    Idle,
    /// A group of the line waits in the mailboxes; the host sent `sent` characters with this group and the earlier
    /// ones. A poll first saw the group waiting at `since`.
    Sending {
        sent: usize,
        since: Option<Instant>,
    },
    /// PMAC has the whole line.
    Replying,
    /// An error came: the line's own, or a program's, as at [`AsciiEvent::Error`]. With [`EnableReplies::WithCommand`]
    /// the host does not let the next reply come, so that it does not mix with the next line.
    Refused,
    /// The host sent a control character with a reply; the last line came at `quiet_since`.
    ControlReply {
        quiet_since: Instant,
    },
    /// More of an abandoned command's reply may come; none has come since `quiet_since`.
    Settling {
        quiet_since: Instant,
        since: Instant,
    },
}

/// A character alone in mailbox 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lone {
    /// A client's control character.
    Control,
    /// The `<CTRL-X>` that ends an abandoned command.
    Cancel,
}

/// The host's half of the port: one command line at a time.
pub struct MailboxPort {
    settings: MailboxSettings,
    state: MailboxState,
    /// The line with its `<CR>`.
    line: Box<[u8]>,
    length: usize,
    /// The character that waits alone in mailbox 0.
    lone: Option<Lone>,
    /// The port must still send a `<CTRL-X>`: a control character was in its way.
    owes_cancel: bool,
    /// Vector v-1 came and no poll has acted on it yet.
    group_taken: bool,
    /// Vector v came and no poll has read the group yet.
    reply_ready: bool,
    /// The host has written mailbox 1 since the last group came.
    enabled: bool,
    text: [u8; LINE_LIMIT + RECEIVE_GROUP],
    text_length: usize,
    /// A `<BELL>` came; the next line tells the error's number.
    error: bool,
    /// The caller decides which reply is the line's.
    open_ended: bool,
}

impl MailboxPort {
    /// A port that has not been started, for lines of at most `line_limit` characters.
    #[must_use]
    pub fn new(settings: MailboxSettings, line_limit: usize) -> Self {
        Self::with_line(settings, vec![0; line_limit + 1].into())
    }

    fn with_line(settings: MailboxSettings, line: Box<[u8]>) -> Self {
        Self {
            settings,
            state: MailboxState::Idle,
            line,
            length: 0,
            lone: None,
            owes_cancel: false,
            group_taken: false,
            reply_ready: false,
            enabled: false,
            text: [0; LINE_LIMIT + RECEIVE_GROUP],
            text_length: 0,
            error: false,
            open_ended: false,
        }
    }

    /// Makes the port ready after a reset of the board or of the host: the port drops the reply that was under way.
    /// Poll until [`MailboxPort::is_idle`]. 1 write, 1 read.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn start(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<(), ByteBusError> {
        *self = Self::with_line(self.settings, std::mem::take(&mut self.line));
        self.state = MailboxState::Settling { quiet_since: now, since: now };
        self.enable(bus)
    }

    /// Whether [`MailboxPort::begin`] may be called.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        matches!(self.state, MailboxState::Idle | MailboxState::Refused) && self.lone.is_none()
    }

    /// Whether the board has taken the whole command under way, as far as polls have seen.
    #[must_use]
    pub fn was_taken(&self) -> bool {
        match self.state {
            MailboxState::Replying => true,
            MailboxState::ControlReply { .. } => self.lone.is_none(),
            _ => false,
        }
    }

    /// Whether the port gave up the last command, and more of its reply may come.
    #[must_use]
    pub fn is_settling(&self) -> bool {
        matches!(self.state, MailboxState::Settling { .. })
    }

    /// Whether a client's control character waits in mailbox 0 for the board to take it, as far as polls have seen.
    #[must_use]
    pub fn control_pending(&self) -> bool {
        self.lone == Some(Lone::Control)
    }

    /// Notes an interrupt. The next poll acts on it.
    pub fn signal(&mut self, signal: MailboxSignal) {
        match signal {
            MailboxSignal::GroupTaken => self.group_taken = true,
            MailboxSignal::ReplyReady => {
                self.reply_ready = true;
                self.enabled = false;
            }
        }
    }

    /// Starts sending `line`, without its `<CR>`. `Ok(false)`: the port is not idle, or a group lies unread; try
    /// later. 1 write a character and 1 for the `<CR>`, in groups; the port does not wait between them.
    ///
    /// # Errors
    /// When the registers cannot be reached. The line must have passed [`crate::protocol::check_line`]; the port does
    /// not send a line that is too long.
    pub fn begin(&mut self, bus: &mut impl ByteBus, line: &[u8]) -> Result<bool, ByteBusError> {
        let has_half_a_line = self.state == MailboxState::Refused && self.text_length > 0;
        if !self.is_idle() || self.reply_ready || has_half_a_line || line.len() >= self.line.len() {
            return Ok(false);
        }
        self.line[..line.len()].copy_from_slice(line);
        self.line[line.len()] = RETURN;
        self.length = line.len() + 1;
        self.text_length = 0;
        self.error = false;
        self.open_ended = false;
        self.send_group(bus, 0)?;
        Ok(true)
    }

    /// As [`MailboxPort::begin`], for a line whose reply the caller recognises: the port reports all replies, late
    /// ones of other lines first, until [`MailboxPort::finish`].
    ///
    /// # Errors
    /// As [`MailboxPort::begin`].
    pub fn begin_open_ended(&mut self, bus: &mut impl ByteBus, line: &[u8]) -> Result<bool, ByteBusError> {
        let begun = self.begin(bus, line)?;
        self.open_ended = begun;
        Ok(begun)
    }

    /// The caller has settled whether the error was the line's or a program's: the line is over.
    pub fn settled(&mut self) {
        if self.state == MailboxState::Refused {
            self.state = MailboxState::Idle;
        }
    }

    /// The reply to an open-ended line has come.
    pub fn finish(&mut self) {
        if std::mem::take(&mut self.open_ended) {
            self.state = MailboxState::Idle;
        }
    }

    /// Sends a control character. `Ok(false)`: a group of a line, or an earlier control character, still waits in the
    /// mailboxes, or the character's reply would mix with another; try later. With `has_reply` the port reports the
    /// reply's lines as [`AsciiEvent::Line`]; the reply ends with `<ACK>` or a silence. 1 write.
    ///
    /// A character without a reply may be the machine's stop, so it replaces a group that has waited for
    /// [`MAILBOX_GROUP_LIES`]. The port then gives up that group's command ([`MailboxPort::is_settling`]), which the
    /// board may or may not have taken, and sends a `<CTRL-X>`.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn control(
        &mut self,
        bus: &mut impl ByteBus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, ByteBusError> {
        let lies_since = match (self.state, self.lone) {
            (MailboxState::Sending { since, .. }, _) => Some(since.unwrap_or(now)),
            (MailboxState::Settling { since, .. }, Some(Lone::Cancel)) => Some(since),
            (MailboxState::ControlReply { quiet_since }, Some(_)) => Some(quiet_since),
            (_, Some(_)) => Some(now),
            (_, None) => None,
        };
        let in_the_way = lies_since.is_some_and(|since| has_reply || now < since + MAILBOX_GROUP_LIES);
        if in_the_way || self.reply_ready || has_reply && !self.is_idle() {
            return Ok(false);
        }
        self.send_alone(bus, Lone::Control, character)?;
        if has_reply {
            self.text_length = 0;
            self.error = false;
            self.state = MailboxState::ControlReply { quiet_since: now };
        } else if lies_since.is_some() {
            // The board may have the first half of the line.
            self.owes_cancel = true;
            self.state = MailboxState::Settling { quiet_since: now, since: now };
        }
        Ok(true)
    }

    /// Gives up the command under way: makes the board empty its queues, and drops every reply that still comes. 2
    /// writes, 1 read, if the board need not take a control character first.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn give_up(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<(), ByteBusError> {
        let has_reply = matches!(self.state, MailboxState::ControlReply { .. });
        if self.lone == Some(Lone::Control) && !has_reply {
            // The character may be the machine's stop, so the port does not replace it.
            self.owes_cancel = true;
            self.state = MailboxState::Settling { quiet_since: now, since: now };
        } else if !self.is_idle() || self.state == MailboxState::Refused {
            self.cancel(bus, now)?;
        }
        Ok(())
    }

    /// Takes back a control character that the board has not taken, as far as possible: a `<CTRL-X>` replaces it. 2
    /// writes, 1 read.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn withdraw_control(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<(), ByteBusError> {
        if self.control_pending() { self.cancel(bus, now) } else { Ok(()) }
    }

    fn cancel(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<(), ByteBusError> {
        self.open_ended = false;
        self.owes_cancel = false;
        self.send_alone(bus, Lone::Cancel, CANCEL)?;
        // If an interrupt was lost, the board would wait for this for ever. The port drops the group that the board
        // then overwrites anyway.
        self.reply_ready = false;
        self.enable(bus)?;
        self.state = MailboxState::Settling { quiet_since: now, since: now };
        Ok(())
    }

    /// Acts on the signalled interrupts and returns the next event; `None`: no (further) event. Costs nothing without
    /// an interrupt; with one, a group: at most 16 reads, or 15 writes, and 1 write and 1 read.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn poll(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<Option<AsciiEvent>, ByteBusError> {
        let taken = std::mem::take(&mut self.group_taken);
        if taken {
            self.lone = None;
            if let MailboxState::Settling { quiet_since, .. } = &mut self.state {
                *quiet_since = now;
            }
        }
        let sent_all = matches!(self.state, MailboxState::Sending { sent, .. } if sent == self.length);
        // PMAC cannot fill the mailboxes before it has taken the host's group, whichever interrupt the host sees
        // first.
        if sent_all && (taken || self.reply_ready) {
            self.state = MailboxState::Replying;
        }
        if std::mem::take(&mut self.reply_ready) {
            // The rest of the line waits until the port has read the group: the line would overwrite it.
            self.group_taken = taken && matches!(self.state, MailboxState::Sending { .. });
            return self.take_group(bus, now);
        }
        match self.state {
            MailboxState::Sending { sent, .. } if taken => self.send_group(bus, sent)?,
            MailboxState::Sending { sent, since: None } => {
                self.state = MailboxState::Sending { sent, since: Some(now) }
            }
            MailboxState::Replying | MailboxState::ControlReply { .. } if taken && !self.enabled => {
                self.enable(bus)?
            }
            MailboxState::ControlReply { quiet_since }
                if self.lone.is_none() && now >= quiet_since + MAILBOX_REPLY_SILENCE =>
            {
                self.state = MailboxState::Idle;
                return Ok(Some(AsciiEvent::Done(Ok(()))));
            }
            MailboxState::Settling { quiet_since, .. } if now < quiet_since + MAILBOX_SETTLE => {}
            MailboxState::Settling { .. } if self.owes_cancel && self.lone.is_none() => {
                self.cancel(bus, now)?
            }
            MailboxState::Settling { since, .. }
                if self.lone.is_none()
                    || self.lone == Some(Lone::Cancel) && now >= since + MAILBOX_CANCEL_TAKEN =>
            {
                self.lone = None;
                self.text_length = 0;
                self.error = false;
                self.state = MailboxState::Idle;
            }
            _ => {}
        }
        Ok(None)
    }

    /// Writes the next group of the line: the later characters first, from mailbox 2 on, and the first character last.
    fn send_group(&mut self, bus: &mut impl ByteBus, from: usize) -> Result<(), ByteBusError> {
        // The board has no group to take: a pending interrupt belongs to an earlier one.
        self.group_taken = false;
        let group = &self.line[from..self.length.min(from + SEND_GROUP)];
        for (index, &character) in group.iter().enumerate().skip(1) {
            bus.write8(mailbox(index + 1), character)?;
        }
        bus.order_accesses();
        bus.write8(mailbox(0), group[0])?;
        bus.order_accesses();
        self.state = MailboxState::Sending { sent: from + group.len(), since: None };
        Ok(())
    }

    fn send_alone(&mut self, bus: &mut impl ByteBus, what: Lone, character: u8) -> Result<(), ByteBusError> {
        bus.write8(mailbox(0), character)?;
        bus.order_accesses();
        self.group_taken = false;
        self.lone = Some(what);
        Ok(())
    }

    /// Lets PMAC send the next group.
    fn enable(&mut self, bus: &mut impl ByteBus) -> Result<(), ByteBusError> {
        self.enabled = true;
        bus.write8(mailbox(1), 0)?;
        bus.order_accesses();
        // A bridge may hold the write back until the host reads.
        bus.read8(mailbox(1))?;
        Ok(())
    }

    /// Reads the group from the mailboxes, and lets PMAC send the next.
    fn take_group(
        &mut self,
        bus: &mut impl ByteBus,
        now: Instant,
    ) -> Result<Option<AsciiEvent>, ByteBusError> {
        if let MailboxState::ControlReply { quiet_since } | MailboxState::Settling { quiet_since, .. } =
            &mut self.state
        {
            *quiet_since = now;
        }
        let mut end = None;
        let mut behind_bell = false;
        for number in 0..RECEIVE_GROUP {
            let character = bus.read8(mailbox(number))?;
            if behind_bell && !self.follows_bell(character) {
                // The bell stands alone: this character belongs to an older group.
                self.text_length = 0;
                break;
            }
            match character {
                BELL if self.settings.error_report == ErrorReport::BellOnly => {
                    end = Some(BELL);
                    break;
                }
                BELL => {
                    self.error = true;
                    self.text_length = 0;
                    behind_bell = true;
                }
                ACKNOWLEDGE | RETURN => {
                    end = Some(character);
                    break;
                }
                LINE_FEED => {}
                _ => {
                    self.text[self.text_length] = character;
                    self.text_length += 1;
                }
            }
        }
        let event = self.judge(end);
        if self.settings.enable_replies == EnableReplies::Always
            || !matches!(self.state, MailboxState::Idle | MailboxState::Refused)
        {
            self.enable(bus)?;
        }
        Ok(event)
    }

    /// Whether `character` continues the text that I6 puts behind a `<BELL>`: `ERRnnn<CR>`, or with I6=3 a `<CR>`.
    fn follows_bell(&self, character: u8) -> bool {
        match (self.settings.error_report, self.text_length) {
            (_, 0) if character == LINE_FEED => true,
            (ErrorReport::NextLine, _) | (_, 6) => character == RETURN,
            (_, 0) => character == b'E',
            (_, 1 | 2) => character == b'R',
            _ => character.is_ascii_digit(),
        }
    }

    /// The event that a group completes which ended with `end` (`None`: 16 characters of a line that goes on).
    fn judge(&mut self, end: Option<u8>) -> Option<AsciiEvent> {
        let settling = matches!(self.state, MailboxState::Settling { .. });
        let awaited = self.open_ended
            || matches!(
                self.state,
                MailboxState::Replying | MailboxState::Refused | MailboxState::ControlReply { .. }
            );
        let stale = |end: u8| Some(AsciiEvent::Stale(end.into()));
        let number_follows = self.settings.error_report == ErrorReport::NextLine;
        // A PMAC sends no longer line; a longer one would lose a character at the seam.
        let text = ResponseText::cut(&self.text[..self.text_length]);
        match end {
            None if self.text_length < LINE_LIMIT => return None,
            Some(RETURN) if self.error && self.text_length == 0 && number_follows => return None,
            _ => self.text_length = 0,
        }
        if settling {
            self.error = false;
            return end.and_then(stale);
        }
        match end {
            Some(RETURN) if self.error => {
                self.error = false;
                self.end_reply(awaited, Err(error_number(text.as_bytes())), RETURN)
            }
            Some(BELL) => self.end_reply(awaited, Err(0), BELL),
            Some(ACKNOWLEDGE) => self.end_reply(awaited, Ok(()), ACKNOWLEDGE),
            _ if awaited => Some(AsciiEvent::Line(text)),
            _ => Some(AsciiEvent::ProgramMessage(text)),
        }
    }

    fn end_reply(&mut self, awaited: bool, result: Result<(), u16>, end: u8) -> Option<AsciiEvent> {
        match (self.state, result) {
            // The board has no whole line, nor a control character to answer. No manual says that a board refuses a
            // control character.
            (MailboxState::ControlReply { .. }, Err(number)) => {
                return Some(AsciiEvent::ProgramError(number));
            }
            (_, Err(number)) if !awaited => return Some(AsciiEvent::ProgramError(number)),
            (_, Ok(())) if !awaited => return Some(AsciiEvent::Stale(end.into())),
            (MailboxState::Replying, Err(number)) if !self.open_ended => {
                self.state = MailboxState::Refused;
                return Some(AsciiEvent::Error(number));
            }
            (MailboxState::Refused, _) => return Some(AsciiEvent::Done(result)),
            _ => {}
        }
        if matches!(self.state, MailboxState::ControlReply { .. }) {
            // The board has taken the character, whether the host saw its interrupt or not.
            self.lone = None;
        }
        if !self.open_ended {
            self.state = MailboxState::Idle;
        }
        Some(AsciiEvent::Done(result))
    }
}

/// The number in `ERRnnn`; 0 for any other text.
fn error_number(text: &[u8]) -> u16 {
    let digits = text.strip_prefix(b"ERR").and_then(|digits| std::str::from_utf8(digits).ok());
    digits.and_then(|digits| digits.trim().parse().ok()).unwrap_or(0)
}

#[cfg(test)]
#[path = "mailbox_tests.rs"]
mod tests;
