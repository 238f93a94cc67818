//! Settings whose I-variables differ between families, and each family's I-variable for them.

/// The I-variable that holds a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// One variable for the board.
    Board(usize),
    /// One variable for each motor: `Ixx` and this number.
    Motor(usize),
    /// One variable for each coordinate system: `Isx` and this number.
    System(usize),
}

/// A family's I-variables for the settings.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// The background passes, beyond the first, in which a motor has to be in position.
    pub in_position_scans: Setting,
    /// Milliseconds of a segment; 0 for no segmentation.
    pub segmentation: Setting,
    /// Bit 0: a PMAC2-style gate array has the flags. Bit 17: limit switches do not stop the motor. Bits 22-21: the
    /// motors that a fatal following error kills besides the motor.
    pub flag_mode: Setting,
    /// The bit by which the warning following error is the trigger of a move.
    pub error_trigger: (Setting, u32),
    /// Whether I7mn2 and I7mn3 say which flag is the trigger; else the index pulse is.
    pub has_channels: bool,
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
    /// The DPRAM address from which ^W takes a line; `None` in families without ^W.
    pub line_from_dpram: Option<usize>,
    /// The address of the DPRAM that the functions use; `None` in families with one DPRAM only.
    pub dpram_base: Option<usize>,
}
