//! The VME mailbox port: command lines and replies through sixteen byte registers (PMAC User Manual p. 263-267).
//!
//! | register | host | PMAC |
//! |---|---|---|
//! | mailbox 0, 2-15 | writes a group of up to 15 characters, mailbox 0 last | takes it, then interrupts with vector v-1 |
//! | mailbox 1 | writes 0: the next group of a reply may come | - |
//! | mailbox 0-15 | reads, up to `<CR>`, `<ACK>`, `<BELL>` or all 16 | fills, then interrupts with vector v |
//! | base + 0x121 | writes bits A19-A14 of the DPRAM's address after every reset | selects the page |
//!
//! Mailbox n is the byte at base + 2n + 1. A line ends with `<CR>`, which may be a group of its own. A control
//! character goes alone to mailbox 0. Behind the last character of a group stand characters of older ones.
//!
//! The registers tell nothing about where PMAC is: the two interrupts do ([`MailboxPort::signal`]). So it is the host
//! who remembers whether mailbox 1 has been written since the last group: writing it while a group lies unread would
//! let PMAC put the next one over it.
//!
//! The `<BELL>` of an error ends a group for one driver in production, on Turbo boards (epics-modules/tpmac); for another, on PMAC
//! boards, its text is in the same group (Gemini pmaclib). What stands behind it tells: an older group never has just what I6 asks
//! for there.
//!
//! Needs I3 = 2 (or 3): without `<ACK>` a reply has no end. The text of a program's `CMD"..."` or `SEND"..."` looks
//! like a line of a reply; what comes while no reply is awaited is given as a program's message.

use std::time::{Duration, Instant};

use super::line_port::{AsciiEvent, ResponseText};
use crate::device::{ByteBus, ByteBusError};
use crate::protocol::control::CANCEL;

/// How long the port must have been silent before it is used again after it gave up on a reply.
pub const MAILBOX_SETTLE: Duration = Duration::from_millis(50);
/// How long a group of a line may stay untaken before a control character that cannot wait goes over it: an interrupt may be lost.
pub const MAILBOX_GROUP_LIES: Duration = Duration::from_millis(50);
/// How long the board may take to take the `<CTRL-X>`. Until it has, more of the reply given up may come.
pub const MAILBOX_CANCEL_TAKEN: Duration = Duration::from_secs(1);
/// How long after its last line a control character's reply counts as complete if no `<ACK>` ends it. An `<ACK>` may not
/// come. On the DPRAM port a line of the daemon's settles the end; here the host's line and the board's reply share the registers, so
/// the line could overwrite a group of the reply (User Manual p. 263-267).
pub const MAILBOX_REPLY_SILENCE: Duration = Duration::from_millis(50);

/// Characters of a group the host sends at most: mailbox 1 stays out.
const SEND_GROUP: usize = 15;
/// Characters of a group PMAC sends at most.
const RECEIVE_GROUP: usize = 16;
/// Characters of a reply line at most.
const LINE_LIMIT: usize = 255;

const ACKNOWLEDGE: u8 = 0x06;
const BELL: u8 = 0x07;
const LINE_FEED: u8 = 0x0A;
const RETURN: u8 = 0x0D;

const fn mailbox(number: usize) -> u32 {
    2 * number as u32 + 1
}

/// What an interrupt of a PMAC on the VME bus means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MailboxSignal {
    /// Vector v-1: PMAC has taken the group the host sent.
    GroupTaken,
    /// Vector v: a group of a reply is in the mailboxes.
    ReplyReady,
}

/// How the board reports an error (I6). What follows a `<BELL>` in the mailboxes may be an old group's, so it must be
/// known.
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
    /// After every group read, the last one too, so that messages of programs come at any time. The manual's way.
    #[default]
    Always,
    /// Only while a reply is awaited, anew for each command: some boards have been seen not to keep it.
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
    /// A group of the line waits in the mailboxes; `sent` characters went with it and those before it. A poll saw it there
    /// first at `since`.
    Sending {
        sent: usize,
        since: Option<Instant>,
    },
    /// PMAC has the whole line.
    Replying,
    /// An error came: the line's own, or a program's, as at [`AsciiEvent::Error`]. Where replies are let come with
    /// commands alone, the next one is not let come into the line that is sent next.
    Refused,
    /// A control character with a reply was sent; a line came last at `quiet_since`.
    ControlReply {
        quiet_since: Instant,
    },
    /// Something may still come that belongs to a command given up; nothing did since `quiet_since`.
    Settling {
        quiet_since: Instant,
        since: Instant,
    },
}

/// A character alone in mailbox 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lone {
    /// Somebody's control character.
    Control,
    /// The `<CTRL-X>` that ends a command given up.
    Cancel,
}

/// The host's half of the port: one command line at a time.
pub struct MailboxPort {
    settings: MailboxSettings,
    state: MailboxState,
    /// The line with its `<CR>`.
    line: Box<[u8]>,
    length: usize,
    /// What waits alone in mailbox 0.
    lone: Option<Lone>,
    /// A `<CTRL-X>` is still to be sent: a control character was in its way.
    owes_cancel: bool,
    /// Vector v-1 came and was not acted on yet.
    group_taken: bool,
    /// Vector v came and the group was not read yet.
    reply_ready: bool,
    /// Mailbox 1 was written since the last group came.
    enabled: bool,
    text: [u8; LINE_LIMIT + RECEIVE_GROUP],
    text_length: usize,
    /// A `<BELL>` came; the line that follows tells the error's number.
    error: bool,
    /// The caller says which reply was the line's.
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

    /// Makes the port ready, after a reset of the board or of the host: whatever reply was under way is let pass, and
    /// dropped. Poll until [`MailboxPort::is_idle`]. 1 write, 1 read.
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

    /// Whether the last command was given up, and something may still come of it.
    #[must_use]
    pub fn is_settling(&self) -> bool {
        matches!(self.state, MailboxState::Settling { .. })
    }

    /// Whether somebody's control character waits in mailbox 0 for the board to take it, as far as polls have seen.
    #[must_use]
    pub fn control_pending(&self) -> bool {
        self.lone == Some(Lone::Control)
    }

    /// Notes an interrupt. It is acted on by the next step.
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
    /// later. 1 write a character and 1 for the `<CR>`, in groups; nothing waits in between.
    ///
    /// # Errors
    /// When the registers cannot be reached. The line must have passed [`crate::protocol::check_line`]; one that is too
    /// long is not sent.
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

    /// As [`MailboxPort::begin`], of a line whose reply the caller knows when he sees it: replies come, late ones of other lines
    /// first, until [`MailboxPort::finish`].
    ///
    /// # Errors
    /// As [`MailboxPort::begin`].
    pub fn begin_open_ended(&mut self, bus: &mut impl ByteBus, line: &[u8]) -> Result<bool, ByteBusError> {
        let begun = self.begin(bus, line)?;
        self.open_ended = begun;
        Ok(begun)
    }

    /// The error was the line's, or a program's: the line is over.
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
    /// mailboxes, or the character's reply would mix with another; try later. With `has_reply` its lines come as
    /// [`AsciiEvent::Line`] and end with `<ACK>` or a silence. 1 write.
    ///
    /// One without a reply may be what stops a machine: a group that has lain for [`MAILBOX_GROUP_LIES`] is written over and its
    /// command given up ([`MailboxPort::is_settling`]); whether the board has taken it nobody knows. A `<CTRL-X>` follows.
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

    /// Gives up on the command under way: has the board empty its queues, lets pass what still comes, and drops it.
    /// 2 writes, 1 read; without a control character
    /// that has to be taken first.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn give_up(&mut self, bus: &mut impl ByteBus, now: Instant) -> Result<(), ByteBusError> {
        let has_reply = matches!(self.state, MailboxState::ControlReply { .. });
        if self.lone == Some(Lone::Control) && !has_reply {
            // It may be what stops the machine, and is not written over.
            self.owes_cancel = true;
            self.state = MailboxState::Settling { quiet_since: now, since: now };
        } else if !self.is_idle() || self.state == MailboxState::Refused {
            self.cancel(bus, now)?;
        }
        Ok(())
    }

    /// Takes back a control character that the board has not taken, as far as that can be: a `<CTRL-X>` goes over it. 2
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
        // A board that lost an interrupt would wait for this for ever; what it overwrites is dropped anyway.
        self.reply_ready = false;
        self.enable(bus)?;
        self.state = MailboxState::Settling { quiet_since: now, since: now };
        Ok(())
    }

    /// Acts on what was signalled and tells what was found; `None` when there is nothing (more) to find. Costs
    /// nothing unless something was signalled; then a group: at most 16 reads, or 15 writes, and 1 write and 1 read.
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
        // PMAC could not have filled the mailboxes before it took what lay in them, whichever interrupt is seen first.
        if sent_all && (taken || self.reply_ready) {
            self.state = MailboxState::Replying;
        }
        if std::mem::take(&mut self.reply_ready) {
            // The rest of the line waits until the group has been read: it would be written over it.
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

    /// Writes the next group of the line: characters 2 and later to the mailboxes of their numbers, the first last.
    fn send_group(&mut self, bus: &mut impl ByteBus, from: usize) -> Result<(), ByteBusError> {
        // No group is out: an interrupt not acted on yet was another's.
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
        // A bridge may hold the write back until something is read.
        bus.read8(mailbox(1))?;
        Ok(())
    }

    /// Reads the group that lies in the mailboxes, and lets PMAC send the next.
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
                // The bell stands alone: this is an older group's.
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

    /// Whether `character` is what I6 has behind a `<BELL>`, after what was read of it: `ERRnnn<CR>`, or with I6=3 a `<CR>`.
    fn follows_bell(&self, character: u8) -> bool {
        match (self.settings.error_report, self.text_length) {
            (_, 0) if character == LINE_FEED => true,
            (ErrorReport::NextLine, _) | (_, 6) => character == RETURN,
            (_, 0) => character == b'E',
            (_, 1 | 2) => character == b'R',
            _ => character.is_ascii_digit(),
        }
    }

    /// What a group that ended with `end` (`None`: 16 characters of a line that goes on) completes.
    fn judge(&mut self, end: Option<u8>) -> Option<AsciiEvent> {
        let settling = matches!(self.state, MailboxState::Settling { .. });
        let awaited = self.open_ended
            || matches!(
                self.state,
                MailboxState::Replying | MailboxState::Refused | MailboxState::ControlReply { .. }
            );
        let stale = |end: u8| Some(AsciiEvent::Stale(end.into()));
        let number_follows = self.settings.error_report == ErrorReport::NextLine;
        // A PMAC sends no longer line; of one that is, a character at the seam is lost.
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
            // The board has no whole line, nor a control character to answer.
            // No manual has a board refuse a control character.
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
            // It was taken, whether its interrupt was seen or not.
            self.lone = None;
        }
        if !self.open_ended {
            self.state = MailboxState::Idle;
        }
        Some(AsciiEvent::Done(result))
    }
}

/// The number in `ERRnnn`, 0 when the text is another.
fn error_number(text: &[u8]) -> u16 {
    let digits = text.strip_prefix(b"ERR").and_then(|digits| std::str::from_utf8(digits).ok());
    digits.and_then(|digits| digits.trim().parse().ok()).unwrap_or(0)
}

#[cfg(test)]
#[path = "mailbox_tests.rs"]
mod tests;
