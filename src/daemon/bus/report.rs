//! What is said when it changes: that data come or are stale, and who the board is.

use log::{info, warn};

use crate::daemon::bus::board_loop::BoardLoop;
use crate::daemon::shared::status::KnownIdentity;
use crate::mirror::Transition;
use crate::protocol::{CommandPort, CommandState, Enabled};
use crate::segment::identity::first_motors;
use crate::segment::{Identity, RegionId, RegionState, Stamp, State};

/// What was said last, so that only changes are said.
#[derive(Default)]
pub struct Told {
    pub(in crate::daemon) state: Option<State>,
    pub(in crate::daemon) port: Option<(CommandPort, CommandState)>,
    /// Both interrupts of the mailboxes are there.
    pub(in crate::daemon) mailbox: bool,
    pub(in crate::daemon) interrupt: bool,
    pub(in crate::daemon) bus_error: bool,
    identity: Option<Identity>,
}

impl BoardLoop {
    pub(in crate::daemon) fn tell_servo(&mut self, transition: Option<Transition>) {
        match transition {
            Some(Transition::Live) => {
                info!("servo data: live");
                self.functions.ascii.desk.identifier.ask_again(self.clock.now());
            }
            Some(Transition::Stale) => {
                warn!(
                    "servo data: stale, no update for {} ms (is I48=1, I19>0, I59>0, and GATHER given?)",
                    self.functions.servo.stale_after_ns() / 1_000_000
                );
                self.functions.ascii.desk.doubt(self.clock.now());
                self.page_again();
                self.check_answers();
            }
            None => return,
        }
        self.tell_enabled();
    }

    pub(in crate::daemon) fn tell_background(&mut self, transition: Option<Transition>) {
        match transition {
            Some(Transition::Live) => info!("background data: live"),
            Some(Transition::Stale) => {
                warn!(
                    "background data: stale, no report for {} ms (is I49=1 and I59>0?)",
                    self.functions.background.stale_after_ns() / 1_000_000
                );
                self.functions.ascii.desk.doubt(self.clock.now());
                self.page_again();
            }
            None => return,
        }
        self.tell_enabled();
    }

    pub(in crate::daemon) fn tell_enabled(&mut self) {
        let mut enabled = Enabled::empty();
        enabled.set(Enabled::SERVO, self.functions.servo.is_live());
        enabled.set(Enabled::BACKGROUND, self.functions.background.is_live());
        enabled.set(Enabled::ASCII, self.functions.ascii.desk.state() == CommandState::Answers);
        enabled.set(Enabled::INTERRUPT, self.has_interrupt());
        self.info.set(|status| status.enabled = enabled);
    }

    /// Publishes what has become known of the board, and works by it.
    pub(in crate::daemon) fn take_identity(&mut self) {
        let Some(identity) = self.functions.ascii.desk.identifier.take_update() else { return };
        if self.told.identity.as_ref() == Some(&identity) {
            return;
        }
        let motors = identity.reported_motors().map_or(self.default_motors, |motors| motors as usize);
        self.functions.servo.configure(
            identity.motor_mask.unwrap_or(first_motors(motors as u32)),
            identity.servo_period_ps.map(|ps| ps / 1000),
            identity.servo_report_cycles,
        );
        self.functions.background.configure(motors);
        match self.uncertain.plan_for(identity.firmware.as_deref()) {
            Ok(plan) => self.functions.set_plan(plan),
            Err(reason) => warn!("{reason}; the plan for boards of unknown firmware stays in force"),
        }
        let stamp = Stamp { time_ns: self.clock.ns(), servo_timer: 0, valid: true };
        self.publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
        self.publisher.set_region_state(RegionId::Board, RegionState::Live);
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
        self.told.identity = Some(identity);
    }
}
