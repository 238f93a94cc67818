//! What is said when it changes: that data come or are stale, and who the board is.

use log::{info, warn};

use super::ascii_desk::PortState;
use super::board_loop::BoardLoop;
use super::response_port::Way;
use crate::mirror::Transition;
use crate::protocol::Enabled;
use crate::segment::{Identity, RegionId, RegionState, Stamp, State};

/// What was said last, so that only changes are said.
#[derive(Default)]
pub struct Told {
    pub(super) state: Option<State>,
    pub(super) port: Option<(Way, PortState)>,
    /// Both interrupts of the mailboxes are there.
    pub(super) mailbox: bool,
    pub(super) interrupt: bool,
    pub(super) bus_error: bool,
    identity: Option<Identity>,
    /// The socket's thread was reading when the identity changed; to be told at the next beat.
    pub(super) info_pending: bool,
}

impl BoardLoop {
    pub(super) fn tell_servo(&mut self, transition: Option<Transition>) {
        match transition {
            Some(Transition::Live) => {
                info!("servo data come");
                self.desk.identifier.ask_again(self.clock.now());
            }
            Some(Transition::Stale) => {
                warn!(
                    "servo data are stale: no update for {} ms (is I48=1, I19>0, I59>0, and GATHER given?)",
                    self.servo.stale_after_ns() / 1_000_000
                );
                self.desk.doubt(self.clock.now());
                self.page_again();
                self.check_answers();
            }
            None => return,
        }
        self.tell_enabled();
    }

    pub(super) fn tell_background(&mut self, transition: Option<Transition>) {
        match transition {
            Some(Transition::Live) => info!("background data come"),
            Some(Transition::Stale) => {
                warn!(
                    "background data are stale: no report for {} ms (is I49=1 and I59>0?)",
                    self.background.stale_after_ns() / 1_000_000
                );
                self.desk.doubt(self.clock.now());
                self.page_again();
            }
            None => return,
        }
        self.tell_enabled();
    }

    pub(super) fn tell_enabled(&self) {
        let mut enabled = Enabled::empty();
        enabled.set(Enabled::SERVO, self.servo.is_live());
        enabled.set(Enabled::BACKGROUND, self.background.is_live());
        enabled.set(Enabled::ASCII, self.desk.state() == PortState::Answers);
        enabled.set(Enabled::INTERRUPT, self.has_interrupt());
        self.info.set_enabled(enabled);
    }

    /// Publishes what has become known of the board, and works by it.
    pub(super) fn take_identity(&mut self) {
        let Some(identity) = self.desk.identifier.news() else { return };
        if self.told.identity.as_ref() == Some(&identity) {
            return;
        }
        let motors = identity.reported_motors().map_or(self.default_motors, |motors| motors as usize);
        self.servo.configure(
            motors,
            identity.servo_period_ps.map(|ps| ps / 1000),
            identity.servo_report_cycles,
        );
        self.background.configure(motors);
        match self.uncertain.plan_for(identity.firmware.as_deref()) {
            Ok(plan) => self.jobs.set_plan(plan),
            Err(reason) => warn!("{reason}; the plan for boards of unknown firmware stays in force"),
        }
        let stamp = Stamp { time_ns: self.clock.ns(), servo_timer: 0, valid: true };
        self.publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
        self.publisher.set_region_state(RegionId::Board, RegionState::Live);
        if let (Some(board_type), Some(firmware)) = (&identity.board_type, &identity.firmware) {
            info!("the board is {board_type}, firmware {firmware}, reports {motors} motors");
        }
        self.told.identity = Some(identity);
        self.inform();
    }

    pub(super) fn inform(&mut self) {
        let Some(identity) = &self.told.identity else { return };
        let motors = identity.reported_motors().unwrap_or(self.default_motors as u32);
        self.told.info_pending = !self.info.try_update(|info| {
            // A text that is there already is not made again.
            for (told, known) in [
                (&mut info.firmware, identity.firmware.as_deref()),
                (&mut info.board_type, identity.board_type.as_deref()),
            ] {
                if told.as_deref() != known {
                    *told = known.map(str::to_owned);
                }
            }
            info.motors = motors;
            info.servo_period_ns = identity.servo_period_ps.map(|ps| ps / 1000);
        });
    }
}
