//! How far a rotary stream is.

/// How far it is: what the board or the daemon does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    Define,
    AskLeft,
    SeeHeader,
    /// The transfer ends, or, where no I-variable ends it, the rotary buffers must be closed; then what is left is cleared, or the
    /// buffer set up.
    Disable,
    OpenToClear,
    Clear,
    CloseCleared,
    AskCleared,
    Point,
    /// The mode of this number is sent.
    Mode(usize),
    SetUp,
    Enable,
    Open,
    /// The board has answered `OPEN BINARY ROTARY` with an error.
    OpenText,
    /// Lines come; looks whether the program is to begin, and whether it still runs.
    Feeding,
    SeeFed,
    /// `PR` counts what is to run before `R` goes.
    Count,
    SeeCounted,
    Run,
    SeeRuns,
    /// The board tells whether the rotary buffers are open.
    AskOpen,
    /// The owner says that the program is whole.
    Finish,
    /// The end.
    Close,
    EndTransfer,
    DropLines,
    SeeAhead,
    AskRuns,
    Quit,
    /// Whether `Q` has ended the program; asked so often.
    AskEnded(u32),
    AskLeftAtEnd,
    Over,
}

impl Phase {
    /// Whether it belongs to the end of the stream.
    pub(super) fn is_of_end(self) -> bool {
        use Phase::{AskEnded, AskLeftAtEnd, AskRuns, Close, DropLines, EndTransfer, Over, Quit, SeeAhead};
        matches!(
            self,
            Close | EndTransfer | DropLines | SeeAhead | AskRuns | Quit | AskEnded(_) | AskLeftAtEnd | Over
        )
    }
}
