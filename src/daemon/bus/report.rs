//! What the log, the segment and the clients are told of the board when it changes.

use log::{error, info, warn};

use crate::daemon::shared::info::InfoReport;
use crate::daemon::shared::queue::{Event, Sender};
use crate::daemon::shared::status::{BoardStatus, KnownIdentity};
use crate::mirror::Transition;
use crate::protocol::{CommandPort, CommandState};
use crate::segment::{Identity, State};

/// What was told last, so that only changes are told.
#[derive(Default)]
pub struct Reporter {
    info: InfoReport,
    state: Option<State>,
    port: Option<(CommandPort, CommandState)>,
    identity: Option<Identity>,
    bus_error: bool,
}

impl Reporter {
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
    pub fn servo(transition: Transition, stale_after_ns: u64) {
        match transition {
            Transition::Live => info!("servo data: live"),
            Transition::Stale => warn!(
                "servo data: stale, no update for {} ms (is I48=1, I19>0, I59>0, and GATHER given?)",
                stale_after_ns / 1_000_000
            ),
        }
    }

    /// Background data have become live, or stale after so many nanoseconds.
    pub fn background(transition: Transition, stale_after_ns: u64) {
        match transition {
            Transition::Live => info!("background data: live"),
            Transition::Stale => warn!(
                "background data: stale, no report for {} ms (is I49=1 and I59>0?)",
                stale_after_ns / 1_000_000
            ),
        }
    }

    /// The port that command lines go through, and what became of the last one.
    pub fn port(&mut self, port: CommandPort, state: CommandState) {
        if self.port.replace((port, state)) == Some((port, state)) {
            return;
        }
        self.info.set(|status| (status.command_port, status.command_state) = (port, state));
        match (port, state) {
            (_, CommandState::Unknown) => {}
            (CommandPort::Dpram, CommandState::Answers) => info!("DPRAM ASCII: live"),
            (CommandPort::Dpram, CommandState::Silent) => warn!("DPRAM ASCII: no answer (is I58=1?)"),
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
        if let (Some(board_type), Some(firmware)) = (&identity.board_type, &identity.firmware) {
            info!("the board is {board_type}, firmware {firmware}, reports {motors} motors");
        }
        let known = KnownIdentity {
            firmware: identity.firmware,
            board_type: identity.board_type,
            motors: u32::try_from(motors).unwrap_or(u32::MAX),
            servo_period_ns: identity.servo_period_ps.map(|ps| ps / 1000),
        };
        self.info.set(|status| status.identity = Some(known));
        self.identity = Some(identity);
    }

    /// The bus could not be reached.
    pub fn bus_error(&mut self, error: &dyn std::fmt::Display) {
        if !std::mem::replace(&mut self.bus_error, true) {
            error!("bus: {error}; further bus errors are only counted");
        }
    }
}
