//! What the log, the segment and the clients are told of the board when it changes.

use std::time::Instant;

use log::{error, info, warn};

use crate::daemon::shared::info::InfoReport;
use crate::daemon::shared::queue::{Event, Sender};
use crate::daemon::shared::status::{BoardStatus, KnownIdentity};
use crate::map::{Family, ReportStart};
use crate::mirror::Transition;
use crate::protocol::{CommandPort, CommandState};
use crate::segment::{Identity, State};

/// What was told last, so that only changes are told.
pub struct Reporter {
    /// What to look at when servo data are stale, when background data are, and when no command line is answered.
    hints: [String; 3],
    info: InfoReport,
    state: Option<State>,
    port: Option<(CommandPort, CommandState)>,
    identity: Option<Identity>,
    known: Option<KnownIdentity>,
    bus_error: bool,
}

impl Reporter {
    /// Nothing was told yet of a board of `family`.
    #[must_use]
    pub fn new(family: &Family) -> Self {
        let i = &family.i;
        let reported = i.reported.map_or_else(String::new, |number| format!(", I{number}>0"));
        let (enable, period, background) = (i.servo_enable, i.servo_period, i.background_enable);
        Self {
            hints: [
                match (family.servo.start, i.servo_in_background) {
                    (ReportStart::Gather, _) => {
                        format!("is I{enable}=1, I{period}>0{reported}, and GATHER given?")
                    }
                    // Turbo User Manual p. 403: a period of 0 is a report whenever the last one was taken.
                    (ReportStart::Enable, None) => format!("is I{enable}=1?"),
                    (ReportStart::Enable, Some(other)) => {
                        format!("is I{enable}=1, or I{other}=1 and I{background}=1?")
                    }
                },
                format!("is I{background}=1{reported}?"),
                format!("is I{}=1?", i.ascii_enable),
            ],
            info: InfoReport::default(),
            state: None,
            port: None,
            identity: None,
            known: None,
            bus_error: false,
        }
    }

    /// Notes a change of the status that clients see. [`Self::send`] tells them.
    pub fn note(&mut self, change: impl FnOnce(&mut BoardStatus)) {
        self.info.set(change);
    }

    /// Tells the clients what has changed; counts alone only `with_counts`.
    pub fn send(&mut self, events: &Sender<Event>, with_counts: bool) {
        self.info.poll(events, with_counts);
    }

    /// The state that was told; `None` before the first.
    #[must_use]
    pub const fn state(&self) -> Option<State> {
        self.state
    }

    /// The board does something, or nothing that could be seen. `may_begin`: it has had no time yet to show anything. Gives
    /// the state when it has changed.
    pub fn board(&mut self, shows_life: bool, may_begin: bool) -> Option<State> {
        let state = match (shows_life, self.state) {
            (true, _) => State::Live,
            (false, None) if may_begin => return None,
            (false, _) => State::Stale,
        };
        if self.state.replace(state) == Some(state) {
            return None;
        }
        self.info.set(|status| status.state = state);
        if shows_life {
            info!("board: live");
        } else {
            warn!("board: stale, no servo data, no background data and no ASCII reply");
        }
        Some(state)
    }

    /// The loop ends, and with it what the clients see.
    pub fn end(&mut self, events: &Sender<Event>) {
        self.info.set(|status| status.state = State::Dead);
        self.info.poll(events, true);
    }

    /// Servo data have become live, or stale after so many nanoseconds.
    pub fn servo(&self, transition: Transition, stale_after_ns: u64) {
        match transition {
            Transition::Live => info!("servo data: live"),
            Transition::Stale => warn!(
                "servo data: stale, no update for {} ms ({})",
                stale_after_ns / 1_000_000,
                self.hints[0]
            ),
        }
    }

    /// Background data have become live, or stale after so many nanoseconds.
    pub fn background(&self, transition: Transition, stale_after_ns: u64) {
        match transition {
            Transition::Live => info!("background data: live"),
            Transition::Stale => warn!(
                "background data: stale, no report for {} ms ({})",
                stale_after_ns / 1_000_000,
                self.hints[1]
            ),
        }
    }

    /// The port that command lines go through, and what has become of the last one by `now`.
    pub fn port(&mut self, port: CommandPort, state: CommandState, now: Instant) {
        if self.port.replace((port, state)) == Some((port, state)) {
            return;
        }
        self.info.set(|status| {
            (status.command_port, status.command_state) = (port, state);
            status.silent_since = (state == CommandState::Silent).then_some(now);
        });
        match (port, state) {
            (_, CommandState::Unknown) => {}
            (CommandPort::Dpram, CommandState::Answers) => info!("DPRAM ASCII: live"),
            (CommandPort::Dpram, CommandState::Silent) => {
                warn!("DPRAM ASCII: no answer ({})", self.hints[2]);
            }
            (CommandPort::Mailbox, CommandState::Answers) => info!("VME mailboxes: live"),
            (CommandPort::Mailbox, CommandState::Silent) => {
                warn!("VME mailboxes: no answer (is I3=2? are both interrupts there?)");
            }
        }
    }

    /// Whether the board says something else of itself than before.
    #[must_use]
    pub fn is_new(&self, identity: &Identity) -> bool {
        self.identity.as_ref() != Some(identity)
    }

    /// Who the board is, and how many motors are read from it.
    pub fn identity(&mut self, identity: Identity, motors: usize) {
        let known = KnownIdentity {
            firmware: identity.firmware,
            board_type: identity.board_type,
            motors: u32::try_from(motors).unwrap_or(u32::MAX),
            servo_period_ns: identity.servo_period_ps.map(|ps| ps / 1000),
        };
        self.identity = Some(identity);
        if self.known.replace(known) == Some(known) {
            // A scale, say.
            return;
        }
        self.info.set(|status| status.identity = Some(known));
        if let (Some(board_type), Some(firmware)) = (&known.board_type, &known.firmware) {
            info!("the board is {board_type}, firmware {firmware}, reports {motors} motors");
        }
    }

    /// The bus could not be reached.
    pub fn bus_error(&mut self, error: &dyn std::fmt::Display) {
        if !std::mem::replace(&mut self.bus_error, true) {
            error!("bus: {error}; further bus errors are only counted");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC, TURBO2};

    #[test]
    fn what_to_look_at_goes_by_the_family() {
        let [servo, background, ascii] = Reporter::new(&PMAC).hints;
        assert_eq!(servo, "is I48=1, I19>0, I59>0, and GATHER given?");
        assert_eq!((background.as_str(), ascii.as_str()), ("is I49=1, I59>0?", "is I58=1?"));
        let [servo, background, _] = Reporter::new(&TURBO2).hints;
        assert_eq!(servo, "is I48=1, or I57=1 and I49=1?");
        assert_eq!(background, "is I49=1?");
    }

    #[test]
    fn a_state_is_told_when_it_changes() {
        let mut reporter = Reporter::new(&PMAC);
        assert_eq!(reporter.board(false, true), None, "it has had no time yet");
        assert_eq!(reporter.board(false, false), Some(State::Stale));
        assert_eq!(reporter.board(false, true), None, "that is known");
        assert_eq!(reporter.board(true, false), Some(State::Live));
        assert_eq!(reporter.state(), Some(State::Live));
    }
}
