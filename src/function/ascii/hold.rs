//! The port held: after a command was given up, and at the start, until the board shows that it is free.
//!
//! A reply that comes after its command was given up cannot be told from the next command's, nor can a line that the board
//! is still at be told from one that it has not seen: the manual has it clear the command flag when it "has processed" the
//! line (p. 29), but a board may clear it as soon as it has taken the line. So nothing is begun until
//! * the board has taken and answered a control character that only reports (`QUESTION`; control characters "act
//!   immediately", FACTS 7), which it does between two lines, or beside one,
//! * the flag is clear: where it is cleared late, the line is done,
//! * and nothing has come for `SETTLE`, or for longer than the board took from one response to the next, twice, within
//!   `SLOW_REPLY`. Texts of programs count, up to `SETTLE_TEXTS`: they keep the board from putting out what is still to come.
//!
//! A line that the board has not taken, nor the question behind it, lies before a board that is deaf (I58=0) or busy. It is
//! taken back after `ASK_LIMIT`, so that nothing is carried out by surprise when the port is switched on later. The
//! question is asked again every `ASK_AGAIN`. Nobody waits for it without a bound of his own.
//!
//! Firmware before 1.15 does not know the register. A board that was never seen to take a character, but takes the empty line
//! whose flag was set for it ([`super::control`]), is believed to be free.

use std::time::{Duration, Instant};

use super::{DpramPort, EXPECTED, State};
use crate::device::{Bus, BusError};
use crate::protocol::control::CANCEL;

/// How long the response buffer must have been silent before a port that was held is used again.
pub const SETTLE: Duration = Duration::from_millis(50);
/// How many texts of programs begin the silence anew. A program that never stops sending must not block the port; and by then the
/// board has put out so many responses that those of the old command, which stood before them in its queue, are out.
const SETTLE_TEXTS: u8 = 10;
/// How long a reply whose lines come slowly is waited for. Errors of a program that come just as slowly, with I6=1, must not hold the
/// port for ever.
const SLOW_REPLY: Duration = Duration::from_secs(30);
/// `<CTRL-F>`: the following errors of all motors. It has no side effect (FACTS 7).
const QUESTION: u8 = b'F' - 64;
/// How long the board may take to take the question. It takes characters within milliseconds.
pub const ASK_LIMIT: Duration = Duration::from_millis(300);
/// How long the board may then take to answer it.
const ANSWER_LIMIT: Duration = Duration::from_secs(1);
/// How long the board may leave a control character that nobody here has put there.
const FOREIGN_LIMIT: Duration = Duration::from_secs(1);
/// How soon after it was taken back it is asked again.
pub const ASK_AGAIN: Duration = Duration::from_millis(500);

/// What the board has shown so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Hold {
    /// The port is held since then.
    since: Instant,
    /// Nothing at all came since then.
    quiet_since: Instant,
    /// Texts of programs that came.
    texts: u8,
    asking: Asking,
    /// The board did not take the question the last time.
    in_vain: bool,
}

/// What is handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    /// `^X`, as the board has the first half of a line; then the question.
    Cancel,
    /// The question.
    Question,
    /// A stop, once more ([`super::stop`]), when the question was answered.
    Stop(u8),
}

impl What {
    const fn character(self) -> u8 {
        match self {
            Self::Cancel => CANCEL,
            Self::Question => QUESTION,
            Self::Stop(character) => character,
        }
    }

    const fn first(cancels: bool) -> Self {
        if cancels { Self::Cancel } else { Self::Question }
    }
}

/// Where the question is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asking {
    /// To be handed over from then on.
    Due { from: Instant, what: What },
    /// In its word.
    Lies { since: Instant, what: What },
    /// The board has taken it.
    Taken { since: Instant },
    /// It need not be asked (any more).
    Over,
    /// It need not be asked: a control character's reply has ended, but for an `<ACK>` that may come until then.
    Mark { until: Instant },
}

impl Hold {
    /// Only a silence is waited for.
    pub(super) const fn silence(now: Instant) -> Self {
        Self { since: now, quiet_since: now, texts: 0, asking: Asking::Over, in_vain: false }
    }

    /// A stop goes once more.
    pub(super) const fn stopping(now: Instant, character: u8) -> Self {
        let asking = Asking::Due { from: now, what: What::Stop(character) };
        Self { since: now, quiet_since: now, texts: 0, asking, in_vain: false }
    }

    /// The board is asked; with `cancels`, to forget the first half of a line before.
    pub(super) const fn asking(now: Instant, cancels: bool) -> Self {
        let asking = Asking::Due { from: now, what: What::first(cancels) };
        Self { since: now, quiet_since: now, texts: 0, asking, in_vain: false }
    }

    /// Until then an `<ACK>` may come.
    pub(super) const fn mark(now: Instant, until: Instant) -> Self {
        Self { since: now, quiet_since: now, texts: 0, asking: Asking::Mark { until }, in_vain: false }
    }

    /// The stop that is to go once more, or lies in its word to do so.
    pub(super) const fn stop_mut(&mut self) -> Option<&mut u8> {
        match &mut self.asking {
            Asking::Due { what: What::Stop(character), .. }
            | Asking::Lies { what: What::Stop(character), .. } => Some(character),
            _ => None,
        }
    }

    /// No stop goes once more, unless it lies in its word.
    pub(super) const fn forget_stop(&mut self) {
        if let Asking::Due { what: What::Stop(_), .. } = self.asking {
            self.asking = Asking::Over;
        }
    }

    /// Whether it is an `<ACK>` that may come.
    pub(super) const fn is_for_mark(&self) -> bool {
        matches!(self.asking, Asking::Mark { .. })
    }

    /// A response came that is nobody's.
    pub(super) const fn response_came(&mut self, now: Instant) {
        self.quiet_since = now;
        if let Asking::Taken { .. } = self.asking {
            self.asking = Asking::Over;
        }
    }

    /// A program's text came.
    pub(super) const fn text_came(&mut self, now: Instant) {
        if self.texts < SETTLE_TEXTS {
            self.texts += 1;
            self.quiet_since = now;
        }
    }
}

impl DpramPort {
    /// Whether the board takes neither lines nor control characters, as far as it was asked.
    #[must_use]
    pub const fn is_unheard(&self) -> bool {
        matches!(self.state, State::Held(Hold { in_vain: true, .. }))
    }

    /// Whether the board has the first half of a line, before which it would put the next one: an empty one would end it.
    pub(super) const fn has_half_a_line(&self) -> bool {
        matches!(
            self.state,
            State::Held(Hold {
                asking: Asking::Due { what: What::Cancel, .. } | Asking::Lies { what: What::Cancel, .. },
                ..
            })
        )
    }

    /// Looks whether another host may have died in a line of two parts: the first has no NUL (DPRAM manual p. 28) and leaves the last
    /// byte of the buffer set. The board may keep that part, and would put our first line behind it. So it is told to forget it.
    /// A long line that was finished leaves the same byte, and so does memory that was never written: then the `^X` cancels
    /// nothing. It is one try: a board that does not take it (firmware before 1.15) is asked on as if nothing were there. 2 reads.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn look_for_half_a_line(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        let last_word = bus.read16(self.words.command.plus_words(self.words.command_bytes / 2 - 1))?;
        self.half_left = self.order.unpack(last_word)[1] != 0 && !self.is_out_of_reach(bus)?;
        if let State::Held(Hold { asking: Asking::Due { what, .. }, .. }) = &mut self.state
            && self.half_left
        {
            *what = What::Cancel;
        }
        Ok(())
    }

    /// Whether the question lies in its word.
    pub(super) const fn hold_asks(&self) -> bool {
        matches!(self.state, State::Held(Hold { asking: Asking::Lies { .. }, .. }))
    }

    /// A control character goes over the question, which is asked again later.
    pub(super) fn ask_later(&mut self, now: Instant) {
        if let State::Held(hold) = &mut self.state
            && let Asking::Lies { what, .. } = hold.asking
        {
            hold.asking = Asking::Due { from: now + ASK_AGAIN, what };
        }
    }

    /// The command under way is over.
    pub(super) fn rest(&mut self, now: Instant) {
        let settles = std::mem::take(&mut self.settles);
        if let Some(character) = self.stop_again.take() {
            self.state = State::Held(Hold::stopping(now, character));
            return;
        }
        self.state = if settles { State::Held(Hold::silence(now)) } else { State::Idle };
    }

    /// Takes back whatever lies before the board and is ours, now.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.withdraw_control(bus)?;
        self.withdraw_line(bus)?;
        self.stop_again = None;
        if let State::Held(hold) = &mut self.state
            && let Asking::Lies { what, .. } = hold.asking
        {
            hold.asking = Asking::Due { from: now, what };
        }
        Ok(())
    }

    /// How long nothing must have come. What comes later than the board's answers do is no answer, nor one more line of a reply.
    fn silence_needed(&self, hold: &Hold, now: Instant) -> Duration {
        if now < hold.since + SLOW_REPLY { SETTLE.max((2 * self.answer_time).min(EXPECTED)) } else { SETTLE }
    }

    /// The response buffer is empty: goes on with finding out whether the board is free.
    pub(super) fn go_on_holding(
        &mut self,
        bus: &mut impl Bus,
        mut hold: Hold,
        now: Instant,
    ) -> Result<(), BusError> {
        match hold.asking {
            Asking::Due { from, what } if now >= from && self.lying.is_none() => {
                match bus.read16(self.words.control_character)? {
                    0 => {
                        self.put_control(bus, what.character(), false, now)?;
                        hold.asking = Asking::Lies { since: now, what };
                    }
                    // Nobody looks after it: it is another host's, or one of ours that memory out of reach seemed to have lost.
                    foreign if now >= from + FOREIGN_LIMIT && foreign != u16::MAX => {
                        self.withdraw_control(bus)?;
                    }
                    _ => {}
                }
            }
            Asking::Due { .. } => {}
            Asking::Lies { since, what } => {
                if !self.control_pending(bus, now)? {
                    hold.in_vain = false;
                    self.half_left = false;
                    hold.asking = match what {
                        What::Cancel => Asking::Due { from: now, what: What::Question },
                        What::Question => Asking::Taken { since: now },
                        What::Stop(_) => Asking::Over,
                    };
                } else if now >= since + ASK_LIMIT {
                    let looks_at_flag = !self.is_loaded(bus)?;
                    self.withdraw_control(bus)?;
                    self.withdraw_line(bus)?;
                    hold.in_vain = true;
                    hold.asking = if looks_at_flag && !self.takes_characters && what != What::Cancel {
                        Asking::Over
                    } else {
                        let gives_up = what == What::Cancel && std::mem::take(&mut self.half_left);
                        let what = if gives_up { What::Question } else { what };
                        Asking::Due { from: now + ASK_AGAIN, what }
                    };
                }
            }
            // Some board may not answer it here. It has shown that it looks at its words.
            Asking::Taken { since } if now >= since + ANSWER_LIMIT => hold.asking = Asking::Over,
            Asking::Taken { .. } => {}
            Asking::Over if self.is_loaded(bus)? => hold.quiet_since = now,
            Asking::Over if now >= hold.quiet_since + self.silence_needed(&hold, now) => {
                self.settles = false;
                self.rest(now);
                return Ok(());
            }
            Asking::Over => {}
            Asking::Mark { until } if now >= until && now >= hold.quiet_since + SETTLE => {
                self.no_mark_came(now);
                return Ok(());
            }
            Asking::Mark { .. } => {}
        }
        self.state = State::Held(hold);
        Ok(())
    }
}
