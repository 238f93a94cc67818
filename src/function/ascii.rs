//! ASCII communication through the DPRAM, the host's half (DPRAM manual p. 27-29, firmware 1.15 and later; Turbo User
//! Manual p. 406). An [`AsciiPort`] gives the words' places and the longest line.
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | `command_loaded` | sets it when a line lies in the command buffer | clears it when it took the line |
//! | `control_character` | writes a control character | clears it when it took the character |
//! | `command` | writes the line and a NUL | reads it |
//! | `response_control` | writes 0 when it read the response | writes, last, what kind of response lies there |
//! | `response_count` | | writes the number of characters, the NUL included; the host does not need it |
//! | `response` | reads, up to the NUL | writes, only while `response_control` is 0 |
//!
//! The host sends a line that does not fit the command buffer in two parts. The first part fills the buffer and has no
//! NUL (the board does not take the buffer's last byte as a character, but that byte must not be NUL). The second part
//! ends with a NUL.
//!
//! PMAC programs put texts of their own into the same response buffer. The control word marks them, so the port never
//! takes them for a reply. But a late reply to an abandoned command looks like the next command's reply. So the port
//! empties an untaken line in the buffer. When the flag has fallen the caller sends a probe, a line whose reply is
//! unmistakable: PMAC answers lines in their order. The probe also settles which line or program caused an error
//! (`error`), and where a control character's reply ends: that reply has no `<ACK>`.
//!
//! A reply ends with `<ACK>` (p. 28, step 6), which comes without a text. On Turbo boards I3 does not change that
//! (Turbo Software Reference p. 37); other boards need I3=2.

pub mod control;
mod error;
pub mod hold;
mod response_buffer;
pub mod stop;

use std::time::{Duration, Instant};

use control::Lying;
use hold::Hold;

use crate::device::{Bus, BusError};
use crate::format::{Text, TextOrder};
use crate::function::line_port::{AsciiEvent, LinePort, PortError, ResponseText, Stopped};
use crate::map::AsciiPort;
use crate::map::functions::response;
use crate::protocol::control::CANCEL;

/// How long the port rests at the start, behind `^X` and behind an abandoned command: the board may still be reading
/// the line in the buffer.
pub const PORT_REST: Duration = Duration::from_millis(50);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DpramState {
    /// No command is under way.
    Idle,
    /// A part of the line is in the buffer, its flag set; `sent` characters have been handed over with it.
    Loaded { sent: usize },
    /// PMAC has the whole line.
    Replying,
    /// A control character that has a reply waits in its word.
    Control,
    /// More responses to the command may come: see [`AsciiEvent::Error`] and [`AsciiEvent::Taken`].
    Unsettled,
    /// An emptied line is in the buffer: the board clears its flag when it is done with the line.
    Emptied,
    /// The port's own control character goes first.
    Held(Hold),
    /// The port begins nothing before this time.
    Resting { until: Instant },
}

/// The host's half of the port: one command line at a time.
pub struct DpramPort {
    words: &'static AsciiPort,
    order: TextOrder,
    state: DpramState,
    /// The line under way, in its first `length` bytes.
    line: Box<[u8]>,
    length: usize,
    /// The control character that waits in its word.
    lying: Option<Lying>,
    /// The port has seen the board take a control character by its word alone.
    takes_characters: bool,
    /// The board has taken the control character under way, and a newer character is in the word.
    question_taken: bool,
    /// The board did not take the last line or control character.
    unheard: bool,
    /// The caller decides which reply is the line's.
    open_ended: bool,
    /// Another host may have left the first part of a line without the second, and the board has had no `^X` since.
    half_left: bool,
    /// The stop that the port sends once more before it begins the next line.
    stop_again: Option<u8>,
}

impl DpramPort {
    /// A port in `words`, whose texts are packed in `order`.
    #[must_use]
    pub fn new(words: &'static AsciiPort, order: TextOrder) -> Self {
        Self {
            words,
            order,
            state: DpramState::Idle,
            line: vec![0; words.line_limit].into(),
            length: 0,
            lying: None,
            takes_characters: false,
            question_taken: false,
            unheard: false,
            open_ended: false,
            half_left: false,
            stop_again: None,
        }
    }

    /// Clears the leftovers of this host or a dead one: the command flag, the control character (a deaf board must not
    /// act on it later), and the response, which no caller waits for.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&mut self, bus: &mut dyn Bus) -> Result<(), BusError> {
        self.lying = None;
        bus.write16(self.words.command_loaded.word, 0)?;
        bus.write16(self.words.control_character, 0)?;
        bus.write16(self.words.response_control, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// A command has ended, so the board is done with all earlier lines.
    fn end_command(&mut self, now: Instant) {
        self.state = self
            .stop_again
            .take()
            .map_or(DpramState::Idle, |character| DpramState::Held(Hold::new(character, now)));
    }

    /// Characters of a line that go in its first part.
    const fn first_part(&self) -> usize {
        self.words.command_bytes - 1
    }

    /// Whether the board has not yet cleared a line's flag. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn is_loaded(&self, bus: &mut dyn Bus) -> Result<bool, BusError> {
        Ok(self.words.command_loaded.is_set(bus.read16(self.words.command_loaded.word)?))
    }

    /// Writes the part of the line that starts at `from`, then raises the flag.
    fn load(&mut self, bus: &mut dyn Bus, from: usize) -> Result<(), BusError> {
        let rest = &self.line[from..self.length];
        let first_of_two = rest.len() > self.first_part();
        let part = &rest[..rest.len().min(self.first_part())];
        // NUL ends the line, so the byte behind a first part must not be NUL.
        let (end, fill) = if first_of_two { (self.first_part(), b' ') } else { (part.len(), 0) };
        let byte = |index: usize| part.get(index).copied().unwrap_or(if index <= end { fill } else { 0 });
        for word in 0..=end / 2 {
            let offset = self.words.command.plus_words(word);
            bus.write16(offset, self.order.pack(byte(2 * word), byte(2 * word + 1)))?;
        }
        bus.order_writes();
        bus.write16(self.words.command_loaded.word, self.words.command_loaded.mask)?;
        self.state = DpramState::Loaded { sent: from + part.len() };
        Ok(())
    }

    /// Whether the port reads as all ones: the board has no power, or its page is not selected. No host writes that
    /// value into the control character's word, which has 8 bits. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn is_out_of_reach(&self, bus: &mut dyn Bus) -> Result<bool, BusError> {
        Ok(bus.read16(self.words.control_character)? == u16::MAX)
    }

    /// The first N characters of the last line that any host sent: the board leaves the line in the command buffer.
    /// The first byte of an emptied line is 0. N/2 reads.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn last_line<const N: usize>(&self, bus: &mut dyn Bus) -> Result<Text<N>, BusError> {
        let mut bytes = [0; N];
        for (index, pair) in bytes.chunks_exact_mut(2).enumerate() {
            let word = bus.read16(self.words.command.plus_words(index))?;
            pair.copy_from_slice(&self.order.unpack(word));
        }
        let length = bytes.iter().skip(1).position(|byte| *byte == 0).map_or(N, |end| end + 1);
        Ok(Text::cut(&bytes[..length]))
    }

    /// Whether a response is in its buffer. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn has_response(&self, bus: &mut dyn Bus) -> Result<bool, BusError> {
        Ok(bus.read16(self.words.response_control)? != 0)
    }

    /// Takes back the command under way if the board has taken no part of it. The port is idle then, and the caller
    /// may send the command through another port. `Ok(false)`: the board has taken a part of the command, or no
    /// command is under way.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_back(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<bool, BusError> {
        let word = match self.state {
            DpramState::Loaded { sent } if sent <= self.first_part() => self.words.command_loaded.word,
            DpramState::Control => self.words.control_character,
            _ => return Ok(false),
        };
        let lying = bus.read16(word)?;
        if lying == 0 || lying == u16::MAX {
            return Ok(false);
        }
        match self.state {
            DpramState::Loaded { .. } => self.withdraw_line(bus)?,
            _ => self.withdraw_control(bus)?,
        }
        self.end_command(now);
        Ok(true)
    }

    /// Clears the flag of a line.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    fn withdraw_line(&self, bus: &mut dyn Bus) -> Result<(), BusError> {
        bus.write16(self.words.command_loaded.word, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Takes back another host's line, and rests.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn clear_flag(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), BusError> {
        self.withdraw_line(bus)?;
        self.rest(now);
        Ok(())
    }

    /// Begins no line for a while. A dead host may have left the board reading a line; and `^X` makes the board clear
    /// the control words (DPRAM manual p. 27; the manual does not say when).
    pub fn rest(&mut self, now: Instant) {
        match self.state {
            DpramState::Idle if self.half_left => self.state = DpramState::Held(Hold::new(CANCEL, now)),
            DpramState::Idle | DpramState::Resting { .. } => {
                self.state = DpramState::Resting { until: now + PORT_REST }
            }
            _ => {}
        }
    }

    /// Ends a line that the port has not seen the board take. A NUL over the first byte empties a line of one part.
    /// The port changes one byte, so the board finds the whole line or none, and still clears the flag when it is
    /// done. A part without an end loses its flag.
    fn end_line(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), BusError> {
        if self.length > self.first_part() {
            self.withdraw_line(bus)?;
            self.abandon(true, now);
            return Ok(());
        }
        let second = if self.length > 1 { self.line[1] } else { 0 };
        bus.write16(self.words.command, self.order.pack(0, second))?;
        bus.order_writes();
        self.open_ended = false;
        self.state = DpramState::Emptied;
        Ok(())
    }

    /// Drops every response that still comes. With `has_half` the board may hold the first half of a line and would
    /// join the next line to that half.
    fn abandon(&mut self, has_half: bool, now: Instant) {
        self.open_ended = false;
        self.state = if has_half {
            DpramState::Held(Hold::new(CANCEL, now))
        } else {
            DpramState::Resting { until: now + PORT_REST }
        };
    }

    /// Decides which line or program a response belongs to.
    fn classify(&mut self, control: u16, text: ResponseText, now: Instant) -> AsciiEvent {
        match control {
            response::TO_PROGRAM => return AsciiEvent::ProgramResponse(text),
            response::MESSAGE => return AsciiEvent::ProgramMessage(text),
            // The board is absent.
            u16::MAX => return AsciiEvent::Stale(control),
            response::LINE | response::ACKNOWLEDGE => {}
            _ => return self.classify_error(control, now),
        }
        match (self.state, control) {
            (
                DpramState::Idle | DpramState::Emptied | DpramState::Held(_) | DpramState::Resting { .. },
                _,
            ) => AsciiEvent::Stale(control),
            (_, response::LINE) => AsciiEvent::Line(text),
            (DpramState::Control, _) => AsciiEvent::Stale(control),
            // The board has only a part of the line, so this `<ACK>` does not end its reply.
            (DpramState::Loaded { sent }, _) if sent < self.length => AsciiEvent::Stale(control),
            (state, _) => {
                if !self.open_ended && state != DpramState::Unsettled {
                    self.end_command(now);
                }
                AsciiEvent::Done(Ok(()))
            }
        }
    }
}

impl LinePort for DpramPort {
    fn is_idle(&self) -> bool {
        matches!(self.state, DpramState::Idle | DpramState::Unsettled)
    }

    fn was_taken(&self) -> bool {
        matches!(self.state, DpramState::Replying | DpramState::Unsettled)
    }

    fn line_lies(&self) -> bool {
        matches!(self.state, DpramState::Loaded { .. })
    }

    fn is_unheard(&self) -> bool {
        self.unheard
    }

    fn begin(&mut self, bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError> {
        if !self.is_idle() || self.lying.is_some() || line.len() > self.words.line_limit {
            return Ok(false);
        }
        // No caller waits for a response that is in the buffer now. A poll takes it first.
        if self.has_response(bus)? || self.is_loaded(bus)? {
            return Ok(false);
        }
        self.line[..line.len()].copy_from_slice(line);
        self.length = line.len();
        self.open_ended = false;
        self.load(bus, 0)?;
        Ok(true)
    }

    fn begin_open_ended(&mut self, bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError> {
        let begun = self.begin(bus, line)?;
        self.open_ended = begun;
        Ok(begun)
    }

    fn finish(&mut self, now: Instant) {
        if std::mem::take(&mut self.open_ended) {
            self.end_command(now);
        }
    }

    fn settled(&mut self, now: Instant) {
        if self.state == DpramState::Unsettled {
            self.end_command(now);
        }
    }

    fn control(
        &mut self,
        bus: &mut dyn Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, PortError> {
        Ok(Self::control(self, bus, character, has_reply, now)?)
    }

    fn control_pending(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<bool, PortError> {
        Ok(Self::control_pending(self, bus, now)?)
    }

    fn flag_is_characters(&self) -> bool {
        Self::flag_is_characters(self)
    }

    fn withdraw_control(&mut self, bus: &mut dyn Bus, _now: Instant) -> Result<(), PortError> {
        Ok(Self::withdraw_control(self, bus)?)
    }

    fn stop(&mut self, bus: &mut dyn Bus, character: u8, now: Instant) -> Result<Stopped, PortError> {
        Ok(Self::stop(self, bus, character, now)?)
    }

    fn withdraw(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), PortError> {
        Ok(Self::withdraw(self, bus, now)?)
    }

    fn give_up(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), PortError> {
        match self.state {
            DpramState::Idle | DpramState::Emptied | DpramState::Held(_) | DpramState::Resting { .. } => {
                return Ok(());
            }
            DpramState::Loaded { .. } => {
                self.unheard = self.is_loaded(bus)?;
                return Ok(self.end_line(bus, now)?);
            }
            // A newer control character may be in the word by now.
            DpramState::Control if std::mem::take(&mut self.question_taken) => {}
            DpramState::Control => self.withdraw_control(bus)?,
            DpramState::Unsettled if self.is_loaded(bus)? => return Ok(self.end_line(bus, now)?),
            DpramState::Replying | DpramState::Unsettled => {}
        }
        self.abandon(false, now);
        Ok(())
    }

    fn poll(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<Option<AsciiEvent>, PortError> {
        if self.state == DpramState::Control
            && (std::mem::take(&mut self.question_taken) || !self.control_pending(bus, now)?)
        {
            // No line began meanwhile, so no flag pointed the board to the character.
            self.takes_characters = true;
            self.state = DpramState::Unsettled;
            return Ok(Some(AsciiEvent::Taken));
        }
        let mut second_part = None;
        if let DpramState::Loaded { sent } = self.state
            && !self.is_loaded(bus)?
        {
            self.unheard = false;
            if sent < self.length {
                second_part = Some(sent);
            } else {
                self.state = DpramState::Replying;
            }
        }
        let control = bus.read16(self.words.response_control)?;
        if control == 0 {
            match self.state {
                DpramState::Held(hold) => self.go_on_holding(bus, hold, now)?,
                DpramState::Resting { until } if now >= until => self.state = DpramState::Idle,
                DpramState::Emptied if !self.is_loaded(bus)? => {
                    self.unheard = false;
                    self.state = DpramState::Idle;
                }
                _ => {}
            }
            if let Some(sent) = second_part {
                self.load(bus, sent)?;
            }
            return Ok(None);
        }
        bus.order_reads();
        let text = self.read_response(bus, control)?;
        bus.order_reads();
        self.take_response(bus)?;
        Ok(Some(self.classify(control, text, now)))
    }
}

#[cfg(test)]
#[path = "ascii_tests.rs"]
mod tests;
