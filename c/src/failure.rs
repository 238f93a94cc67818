//! How a call ended, and why.

use std::ffi::CStr;

use driver::client::{ClientError, CommandError, Staleness};
use driver::protocol::CallError;
use driver::segment::SegmentError;

/// How a call ended. A number keeps its meaning; new ones may follow.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The library did what the call asks.
    Ok = 0,
    /// Nothing came within the time-out. This is no fault: wait again.
    TimedOut = 1,
    /// The call is wrong: NULL, a bad size, or a name, number or line that the board does not have.
    Argument = 2,
    /// The data are not live; the text says why.
    Stale = 3,
    /// There is no daemon: nothing was carried out.
    Gone = 4,
    /// This process cannot read the board's data.
    Unreadable = 5,
    /// The daemon refuses the call and has done nothing.
    Refused = 6,
    /// The board refuses the line; the code is the number of its `ERRnnn`. Commands before the refused one have acted.
    Board = 7,
    /// The caller lacks a role; the daemon has done nothing.
    NotPermitted = 8,
    /// Other commands took the board's time; the daemon has sent nothing.
    Busy = 9,
    /// The board may or may not have carried the command out.
    Uncertain = 10,
    /// A stop did not go as asked: a motor may still move.
    StopFailed = 11,
    /// The handle belongs to the process from which this one was forked.
    OtherProcess = 12,
    /// The caller's function ended the work.
    Halted = 13,
    /// A gather or a stream ended early; the text tells how far it came.
    Ended = 14,
    /// A fault of this library.
    Internal = 15,
}

impl Status {
    const ALL: [Self; 16] = [
        Self::Ok,
        Self::TimedOut,
        Self::Argument,
        Self::Stale,
        Self::Gone,
        Self::Unreadable,
        Self::Refused,
        Self::Board,
        Self::NotPermitted,
        Self::Busy,
        Self::Uncertain,
        Self::StopFailed,
        Self::OtherProcess,
        Self::Halted,
        Self::Ended,
        Self::Internal,
    ];

    /// The words for the status of this number, as C has them; empty for another number.
    pub fn name_of(number: i32) -> &'static CStr {
        Self::ALL.iter().find(|status| **status as i32 == number).map_or(c"", |status| status.name())
    }

    /// The words for it.
    const fn name(self) -> &'static CStr {
        match self {
            Self::Ok => c"ok",
            Self::TimedOut => c"timed out",
            Self::Argument => c"wrong argument",
            Self::Stale => c"stale data",
            Self::Gone => c"daemon gone",
            Self::Unreadable => c"unreadable data",
            Self::Refused => c"refused by pmacd",
            Self::Board => c"refused by the board",
            Self::NotPermitted => c"not permitted",
            Self::Busy => c"board busy",
            Self::Uncertain => c"uncertain",
            Self::StopFailed => c"stop failed",
            Self::OtherProcess => c"handle of another process",
            Self::Halted => c"halted by the caller",
            Self::Ended => c"ended early",
            Self::Internal => c"fault of the library",
        }
    }

    /// What the user can do.
    pub const fn cure(self) -> &'static str {
        match self {
            Self::Ok | Self::Halted => "",
            Self::TimedOut => "wait again, or longer",
            Self::Argument => "correct the call; pmac_dpram.h tells what it takes",
            Self::Stale => "see pmacctl status and pmacctl doctor; use no old value as a live one",
            Self::Gone => "start pmacd, or name its board or socket; see pmacctl status",
            Self::Unreadable => "see pmacctl doctor: is the segment pmacd's, and of this release?",
            Self::Refused => "the text says why; pmacctl status shows what pmacd does now",
            Self::Board => "pmacctl explain ERRnnn tells what the number means",
            Self::NotPermitted => "ask the administrator for the group of the role",
            Self::Busy => "try again",
            Self::Uncertain => "look at the board before you send the command again",
            Self::StopFailed => "use the emergency stop, or pmac_control with ^K or ^A",
            Self::OtherProcess => "open a handle of this process's own, after the fork",
            Self::Ended => "the text says why, and what is left on the board",
            Self::Internal => "report the text; close the handle and open another one",
        }
    }
}

/// Why a call failed.
#[derive(Debug, Clone)]
pub struct Failure {
    pub status: Status,
    /// The number of the board's `ERRnnn`.
    pub code: u16,
    pub text: String,
    /// The lines of the board's answer before the error.
    pub lines: Vec<String>,
}

impl Failure {
    pub fn new(status: Status, text: impl Into<String>) -> Self {
        Self { status, code: 0, text: text.into(), lines: Vec::new() }
    }

    /// The call is wrong.
    pub fn argument(text: impl Into<String>) -> Self {
        Self::new(Status::Argument, text)
    }

    /// The same with another text.
    pub fn saying(self, text: String) -> Self {
        Self { text, ..self }
    }
}

impl From<Staleness> for Failure {
    fn from(why: Staleness) -> Self {
        let status = if why == Staleness::DaemonGone { Status::Gone } else { Status::Stale };
        Self::new(status, why.to_string())
    }
}

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Socket(error) => error.into(),
            ClientError::Segment(SegmentError::NotFound { .. }) => Self::new(Status::Gone, error.to_string()),
            ClientError::Segment(SegmentError::Name { .. }) => Self::argument(error.to_string()),
            ClientError::Gather(text) => Self::new(Status::Ended, text),
            error => Self::new(Status::Unreadable, error.to_string()),
        }
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        let text = error.to_string();
        let status = match &error {
            error if error.is_uncertain() => Status::Uncertain,
            CommandError::Connect { .. }
            | CommandError::NotTaken { .. }
            | CommandError::StreamEnded { .. } => Status::Gone,
            CommandError::OtherProcess { .. } => Status::OtherProcess,
            CommandError::Refused(CallError::Board { .. }) => Status::Board,
            CommandError::Refused(CallError::Busy) => Status::Busy,
            CommandError::Refused(CallError::NotPermitted { .. }) => Status::NotPermitted,
            CommandError::Refused(CallError::StopFailed { .. }) => Status::StopFailed,
            CommandError::Refused(
                CallError::InvalidLine { .. } | CallError::InvalidParameter { .. } | CallError::OutOfRange,
            ) => Status::Argument,
            _ => Status::Refused,
        };
        let (code, lines) = match error {
            CommandError::Refused(CallError::Board { code, lines, .. }) => (code, lines),
            CommandError::Refused(CallError::TimedOut { lines }) => (0, lines),
            _ => (0, Vec::new()),
        };
        Self { status, code, text, lines }
    }
}
