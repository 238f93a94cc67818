//! Settings whose I-variables differ between families: where each family keeps them.

/// The I-variable that holds a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// One for the board.
    Board(usize),
    /// One for each motor, `Ixx` and this.
    Motor(usize),
    /// One for each coordinate system, `Isx` and this.
    System(usize),
}

/// Where a family keeps them.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// In how many background passes more than one a motor has to be in position.
    pub in_position_scans: Setting,
    /// Milliseconds of a segment; 0 for no segmentation.
    pub segmentation: Setting,
    /// Bits 22-21: what a fatal following error kills besides the motor.
    pub flag_mode: Setting,
    /// 1: RAPID goes at Ixx16, else at Ixx22.
    pub rapid_speed: Setting,
    /// How fast a program hold slows down.
    pub hold_slew: Setting,
    /// 1: a step is a line, not a move.
    pub step_mode: Setting,
    /// The smallest arc, in half circles.
    pub minimum_arc: Setting,
    /// 1/16 counts before backlash turns round.
    pub backlash_hysteresis: Setting,
    /// The countdown timers of each coordinate system, as numbers n of Isx`n`.
    pub timers: &'static [usize],
    /// Where in the DPRAM ^W takes a line; `None` where there is no such command.
    pub line_from_dpram: Option<usize>,
    /// The address of the DPRAM that the functions use; `None` where there is only one.
    pub dpram_base: Option<usize>,
}
