//! The servo interrupt's watch on a motor: triggers, limits, following error.
//!
//! Software Reference pp. 72-81, 190-194, 241; User Manual pp. 127-135.

use crate::sim::board::motor::flags::{MINUS, PLUS};
use crate::sim::board::motor::{Loop, Motor, Purpose, ramp};
use crate::sim::board::profile::Profile;
use crate::sim::board::variables::Variables;

impl Motor {
    /// Looks for the trigger of a homing search or a jog until trigger, on the way from shaft position `before` to the
    /// present one. True when the trigger has homed the motor.
    pub fn poll_trigger(&mut self, x: usize, variables: &Variables, before: f64) -> bool {
        let searching = self.searching();
        // A pulse is gone when no move waits for a trigger.
        let pulse = std::mem::take(&mut self.inputs.trigger);
        let Some(purpose) = self.motion.as_ref().filter(|_| searching).map(|motion| motion.purpose) else {
            return false;
        };
        let is_warning = self.capture.is_warning;
        let captured = match self.captured(before).filter(|_| !is_warning) {
            _ if pulse || is_warning && self.warning => self.shaft,
            Some(captured) => captured,
            None => return false,
        };
        let ramp = ramp(x, variables);
        let position = captured - self.reference;
        self.trigger_move = false;
        let (target, speed, homed) = match purpose {
            Purpose::Trigger(after) => (position + after, variables.i(x + 22), false),
            _ => {
                self.captured = captured - self.encoder_zero;
                self.re_reference(position + variables.i(x + 26) / 16.0);
                self.home_complete = true;
                (0.0, variables.i(x + 23), true)
            }
        };
        let profile = Profile::to_target(self.commanded, self.desired_velocity, target, speed, &ramp);
        self.plan(profile, Purpose::Jog);
        homed
    }

    /// Stops the motor at Ix15 when it runs into a limit; true when it did.
    pub fn watch_limits(&mut self, x: usize, variables: &Variables) -> bool {
        let is_open = |end| self.capture.limits && self.inputs.is_on(end, self.shaft);
        let homing = self.motion.as_ref().is_some_and(|motion| motion.purpose == Purpose::Search);
        let (upper, lower) = (variables.i(x + 13), variables.i(x + 14));
        self.limits = [
            is_open(PLUS) || !homing && upper != 0.0 && self.commanded > upper,
            is_open(MINUS) || !homing && lower != 0.0 && self.commanded < lower,
        ];
        let into =
            self.limits[0] && self.desired_velocity > 0.0 || self.limits[1] && self.desired_velocity < 0.0;
        let into = into && !self.aborting() && self.servo == Loop::Closed;
        if into {
            self.abort(variables.i(x + 15));
            self.on_limit = true;
        }
        into
    }

    /// Kills the motor when its following error is fatal; true when it did.
    pub fn watch_following_error(&mut self, x: usize, variables: &Variables) -> bool {
        let error = (self.commanded - self.corrected()).abs() * 16.0;
        let (fatal, warning) = (variables.i(x + 11), variables.i(x + 12));
        self.warning = warning > 0.0 && error > warning && self.servo == Loop::Closed || self.fatal;
        let killed = self.servo == Loop::Closed && fatal > 0.0 && error > fatal;
        if killed {
            self.open(Loop::Killed);
            self.fatal = true;
            self.warning = true;
        }
        killed
    }
}
