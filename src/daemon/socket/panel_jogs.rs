//! Motors that clients have set in motion by the control panel and that nobody holds.
//!
//! Such a motion was asked for, so it goes on when the board does not read the panel any more (I2 is not 3). Its end can no
//! longer be given by the panel then: the log and `status` say so, and who stops it has that done by command line.

use crate::function::servo::Motion;

/// The motors; bit 0 is motor 1.
#[derive(Debug, Default)]
pub(super) struct PanelJogs {
    begun: u32,
    /// Of these, those that were seen to move since.
    moved: u32,
    /// Of these the log has said that their panel is gone.
    told: u32,
}

impl PanelJogs {
    /// The board has taken a request that sets these motors in motion, or may have.
    pub(super) fn begin(&mut self, motors: u32) {
        self.begun |= motors;
        self.moved &= !motors;
        self.told &= !motors;
    }

    /// These were stopped.
    pub(super) fn stopped(&mut self, motors: u32) {
        self.begun &= !motors;
    }

    /// The motors move and stand so. One that has moved and stands has come to its end.
    pub(super) fn see(&mut self, motion: Motion) {
        self.moved |= self.begun & motion.moving;
        self.begun &= !(self.moved & motion.standing);
    }

    /// Those that go on, as far as the reports tell.
    pub(super) fn going(&self, motion: Motion) -> u32 {
        self.begun & !motion.standing
    }

    /// Those that go on and that the log has not named yet, now that the panel is gone.
    pub(super) fn newly_alone(&mut self, motion: Motion) -> u32 {
        let going = self.going(motion) & !self.told;
        self.told |= going;
        going
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b2_6_a_motor_jogged_by_the_panel_is_told_once_until_it_stands() {
        let mut jogs = PanelJogs::default();
        let (moving, standing) = (Motion { moving: 1, standing: 0b10 }, Motion { moving: 0, standing: 0b11 });
        jogs.begin(0b11);
        jogs.see(standing);
        assert_eq!(jogs.going(standing), 0, "a report from just before it");
        jogs.see(moving);
        assert_eq!((jogs.newly_alone(moving), jogs.newly_alone(moving)), (1, 0));
        assert_eq!(jogs.going(Motion::default()), 0b11, "no report tells");
        jogs.see(standing);
        assert_eq!(jogs.going(Motion::default()), 0b10, "motor 1 has come to its end");
        jogs.stopped(0b10);
        jogs.see(Motion { moving: 0b11, standing: 0 });
        assert_eq!(jogs.going(moving), 0, "something else moves them");
    }
}
