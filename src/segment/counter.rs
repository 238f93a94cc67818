//! The daemon's counters, in the order of the segment's counter table.

/// The counters, in table order. Each counts from the creation of the segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Counter {
    /// Servo updates published.
    Updates = 0,
    /// Samples read from the board but not published. Always 0: publishing cannot fail.
    Lost = 1,
    /// Copies discarded and repeated because the board wrote during the copy.
    Retries = 2,
    /// Servo updates of the board that were not read in time.
    Missed = 3,
    /// Servo updates that the board held off because Host-Busy was set.
    Skipped = 4,
    /// Bus cycles on the board.
    BusAccesses = 5,
    /// Bus cycles that failed.
    BusErrors = 6,
    /// Background updates published.
    BackgroundUpdates = 7,
    /// Control-panel samples published.
    PanelUpdates = 8,
    /// Command lines and control characters sent to the ASCII interface.
    AsciiCommands = 9,
    /// Reply lines received.
    AsciiReplies = 10,
    /// Error replies received.
    AsciiErrors = 11,
    /// Timeouts of the ASCII interface.
    AsciiTimeouts = 12,
    /// Reply lines that belong to no command.
    AsciiUnsolicited = 13,
    /// Interrupts taken.
    Interrupts = 14,
    /// Board resets detected.
    Resets = 15,
    /// Sleeping readers woken.
    Wakes = 16,
    /// Bus cycles for servo data, polls and retries included.
    ServoAccesses = 17,
    /// Bus cycles for background data.
    BackgroundAccesses = 18,
    /// Bus cycles for ASCII.
    AsciiAccesses = 19,
}

impl Counter {
    /// All counters, in table order.
    pub const ALL: [Self; 20] = [
        Self::Updates,
        Self::Lost,
        Self::Retries,
        Self::Missed,
        Self::Skipped,
        Self::BusAccesses,
        Self::BusErrors,
        Self::BackgroundUpdates,
        Self::PanelUpdates,
        Self::AsciiCommands,
        Self::AsciiReplies,
        Self::AsciiErrors,
        Self::AsciiTimeouts,
        Self::AsciiUnsolicited,
        Self::Interrupts,
        Self::Resets,
        Self::Wakes,
        Self::ServoAccesses,
        Self::BackgroundAccesses,
        Self::AsciiAccesses,
    ];

    /// The counter's name in JSON output.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Updates => "updates",
            Self::Lost => "lost",
            Self::Retries => "retries",
            Self::Missed => "missed",
            Self::Skipped => "skipped",
            Self::BusAccesses => "bus_accesses",
            Self::BusErrors => "bus_errors",
            Self::BackgroundUpdates => "background_updates",
            Self::PanelUpdates => "panel_updates",
            Self::AsciiCommands => "ascii_commands",
            Self::AsciiReplies => "ascii_replies",
            Self::AsciiErrors => "ascii_errors",
            Self::AsciiTimeouts => "ascii_timeouts",
            Self::AsciiUnsolicited => "ascii_unsolicited",
            Self::Interrupts => "interrupts",
            Self::Resets => "resets",
            Self::Wakes => "wakes",
            Self::ServoAccesses => "servo_accesses",
            Self::BackgroundAccesses => "background_accesses",
            Self::AsciiAccesses => "ascii_accesses",
        }
    }
}
