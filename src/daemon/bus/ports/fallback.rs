//! Which way the desk's lines go: the DPRAM, or the mailboxes when the board does not look at the DPRAM.
//!
//! What the DPRAM's port leaves lying makes the desk ask for I58 through the mailboxes. Is it 0, or the DPRAM out of
//! reach, lines go through the mailboxes from then on, what lay untouched first; I58 is asked for again now and then,
//! and when it is not 0 lines go through the DPRAM again. While a program buffer is open nothing is asked: the question
//! would be a program line.

use std::time::{Duration, Instant};

use log::{info, warn};

use crate::daemon::bus::ports::command_port::{Answer, PortError};
use crate::daemon::bus::work::ascii::{AsciiDesk, Begun};
use crate::device::Bus;
use crate::protocol::{CommandPort, CommandState};

/// How long something may lie in the DPRAM's port before the board is asked. It takes commands within milliseconds.
const STUCK: Duration = Duration::from_millis(100);
/// How often the board is asked again, and how soon after a line that may have changed the answer.
const AGAIN: Duration = Duration::from_secs(2);
const SOON: Duration = Duration::from_millis(200);

impl AsciiDesk {
    /// A line may have changed which port the board looks at.
    pub(in crate::daemon) fn ask_way_soon(&mut self, now: Instant) {
        if self.port.way() == CommandPort::Mailbox {
            self.next_ask = self.next_ask.min(now + SOON);
        }
    }

    /// Acts on what the board has said of its ports, and asks it when there is reason.
    pub(in crate::daemon) fn consider_ways(
        &mut self,
        bus: &mut impl Bus,
        now: Instant,
    ) -> Result<(), PortError> {
        if !self.port.may_change() {
            return Ok(());
        }
        if let Some(answer) = self.port.take_answer() {
            self.next_ask = now + AGAIN;
            self.follow(answer, bus, now)?;
        }
        let stuck = self.port.way() == CommandPort::Dpram && self.lies_untaken(now);
        self.stuck_since = self.stuck_since.filter(|_| stuck).or(stuck.then_some(now));
        if self.buffer.is_open() || now < self.next_ask {
            return Ok(());
        }
        let wanted = match self.port.way() {
            CommandPort::Dpram => self.stuck_since.is_some_and(|since| now >= since + STUCK),
            CommandPort::Mailbox => self.nothing_under_way() && self.port.is_idle(),
        };
        if wanted && self.port.ask(now)? {
            self.next_ask = now + AGAIN;
        }
        Ok(())
    }

    fn nothing_under_way(&self) -> bool {
        self.under_way.is_none() && self.control_lies.is_none()
    }

    /// Whether a command waits that the board has not touched, as far as known.
    fn lies_untaken(&self, now: Instant) -> bool {
        match self.under_way {
            Some(under_way) => !under_way.taken && !self.port.was_taken(),
            None => {
                let asks = !self.buffer.is_open() && self.identifier.due_in(now).is_zero();
                self.control_lies.is_some() || !self.lines.is_empty() || !self.controls.is_empty() || asks
            }
        }
    }

    fn follow(&mut self, answer: Answer, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        let out_of_reach = answer != Answer::None && self.port.dpram.is_out_of_reach(bus)?;
        match (self.port.way(), answer) {
            (CommandPort::Dpram, Answer::Off | Answer::On) if answer == Answer::Off || out_of_reach => {
                if self.take_back(bus)? {
                    let why = if out_of_reach { "the DPRAM is out of reach" } else { "I58=0" };
                    warn!("command lines go through the VME mailboxes now: {why}");
                    self.change(CommandPort::Mailbox, now);
                } else {
                    // The board has it in hand after all: ask again when that is over.
                    self.next_ask = now;
                }
            }
            (CommandPort::Mailbox, Answer::On) if !out_of_reach && self.nothing_under_way() => {
                info!("command lines go through the DPRAM again: I58=1");
                self.change(CommandPort::Dpram, now);
            }
            _ => {}
        }
        Ok(())
    }

    fn change(&mut self, way: CommandPort, now: Instant) {
        self.port.change(way);
        self.state = CommandState::Unknown;
        self.stuck_since = None;
        self.look_now(now);
    }

    /// Takes back what lies in the DPRAM's port, to be sent another way; false when the board has touched it.
    fn take_back(&mut self, bus: &mut impl Bus) -> Result<bool, PortError> {
        if let Some(lying) = self.control_lies {
            if !self.port.dpram.control_lies(bus)? {
                return Ok(false);
            }
            self.port.dpram.withdraw_control(bus)?;
            self.control_lies = None;
            self.controls.push_front(lying);
        }
        let Some(under_way) = self.under_way else { return Ok(true) };
        if under_way.taken || !self.port.dpram.take_back(bus)? {
            return Ok(false);
        }
        self.under_way = None;
        match under_way.begun {
            Begun::Line(line) => self.lines.push_front(line),
            Begun::Control(control) => self.controls.push_front(control),
            Begun::Question => self.identifier.not_sent(),
        }
        Ok(true)
    }
}
