//! Sequences: lines and jobs that belong together, run on a shared board by the daemon for one client.
//!
//! A download, a restore, a gather or a stream is a sequence. A sequence has one owner, a connection, and holds a
//! [`Resource`] that no other sequence gets meanwhile. It ends when it is done, when its owner ends it, when the owner
//! is gone or silent (`shared/leases.rs`), when another client ends it, or when the daemon stops. In every case the
//! daemon carries out the steps of the end (`CLOSE`, `ENDGATHER`, a variable put back), even after the owner has gone.
//!
//! # A new sequence
//! It is a [`Script`]: an `async` function without I/O of its own. The server asks the script for a [`Step`], has the
//! bus thread do the step, and gives the outcome to the next call of [`Script::next`], which goes on with the function.
//! * Begin: a method of the socket (`socket/methods.rs`) gives `Action::Sequence(SequenceCall::…)`;
//!   `socket/server/sequencing.rs` makes the script from that. The caller waits until the script says [`Step::Answer`]
//!   or [`Step::Over`]. [`Step::Tell`] before that streams to a caller that asked for `more`.
//! * Rest: after [`Step::Answer`] the script goes on by itself. While it rests ([`Step::Rest`], [`Step::Wait`]) a call
//!   of the owner ([`Script::ask`]) or an end wakes it. While no call of the owner is under way the lease runs: any
//!   call on the owner's connection renews it. During a call of the owner the lease stands still: the daemon is busy
//!   for the owner then.
//! * End: [`Script::end`] says why. The bus thread first finishes the step under way, and the script gets its outcome.
//!   From then on every step must serve the end, be bounded, and lead to [`Step::Over`].

mod end_retry;
#[cfg(test)]
mod end_tests;
mod gather;
mod lines;
mod put_back;
mod report_watch;
mod rotary;
mod script;

use std::fmt;
use std::time::{Duration, Instant};

pub use gather::{GatherCall, gather, stop_gather};
pub use lines::{Batch, lines};
pub use rotary::{Entry, RotaryCall, lines_left, rotary};
pub use script::Script;

use crate::daemon::shared::job::Job;
use crate::daemon::shared::peer::Peer;
use crate::daemon::shared::queue::{Line, Outcome};
use crate::function::rotary::RotaryState;
use crate::map::{HostOffset, Systems};
use crate::protocol::{CallError, Reply, answer, control};

/// How long the board may take for a line, and the bus thread for a job.
const STEP: Duration = Duration::from_secs(5);
/// How long the board may take for a check.
const CHECK: Duration = Duration::from_secs(2);
/// How long each step of an end may take.
pub const END_STEP: Duration = Duration::from_secs(2);

/// The part of the board that a sequence holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resource {
    /// The board's variables and program buffers, which successive lines change or list.
    Lines,
    /// The board's gather buffer, and the variables that select the gathered data.
    Gather,
    /// The rotary buffer in the DPRAM with this index.
    Rotary(usize),
}

impl fmt::Display for Resource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lines => f.write_str("one sequence of lines runs at a time"),
            Self::Gather => f.write_str("the board has one gather at a time"),
            Self::Rotary(index) => {
                write!(f, "rotary buffer {} and its coordinate system have one stream at a time", index + 1)
            }
        }
    }
}

/// A request to the bus thread.
#[derive(Debug, Clone)]
pub enum Request {
    /// Send a line.
    Line(Line),
    /// Ask the board something. The daemon does not send the line while a program buffer is open, and does not log it.
    Ask(Line),
    /// Find out whether the board was reset since the last check. The daemon does not send the question while a program
    /// buffer is open.
    Check,
    /// Send a control character that has an answer.
    Control(u8),
    /// Read words of the DPRAM.
    Read {
        /// The first word.
        first: HostOffset,
        /// How many.
        count: usize,
    },
    /// Do a job.
    Job(Box<Job>),
}

/// The next step of a script.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "a few at a time, and soon over")]
pub enum Step {
    /// Have the bus thread do this, within this time.
    Board(Request, Duration),
    /// Wait until this moment. An end, or a call of the owner, ends the wait.
    Wait(Instant),
    /// Wait until the owner calls or an end comes.
    Rest,
    /// Tell the owner something, as one of several replies, and go on.
    Tell(Reply),
    /// Answer the owner's call, and rest until the owner calls again or an end comes.
    Answer(Result<Reply, CallError>),
    /// Answer the owner's call, and every client that waits for the end: the end goes on without them.
    AnswerEnd(Result<Reply, CallError>),
    /// The sequence is over. Answers the owner's call, if one is under way.
    Over(Result<Reply, CallError>),
}

/// The outcome of a step of the bus thread.
#[derive(Debug)]
pub struct Done {
    /// How the step ended.
    pub outcome: Outcome,
    /// The lines of the board's reply, or the error that a caller would get.
    pub result: Result<Vec<String>, CallError>,
    /// How many resets of the board the checks have found.
    pub resets: u64,
    /// How often the bus thread has seen signs that a reset may have caused: a reason for a check.
    pub doubts: u64,
    /// The state of the rotary buffer, after a job that asks for it.
    pub rotary: Option<RotaryState>,
    /// The words of a [`Request::Read`].
    pub words: Vec<u16>,
    /// Whether the board gathers at that moment; `None` if no report tells.
    pub gathers: Option<bool>,
    /// The coordinate systems that run a motion program at that moment; `None` if no report tells.
    pub programs_run: Option<Systems>,
    /// The client that has ended the sequence's work since the sequence began, if any: `uid 0 (pid 7) sent ENDGATHER`.
    pub ended_by: Option<String>,
}

/// The bus thread's findings for a step, besides the lines of a reply.
#[derive(Debug, Default)]
pub struct Found {
    /// The state of a rotary buffer.
    pub rotary: Option<RotaryState>,
    /// Words of the DPRAM.
    pub words: Vec<u16>,
}

/// Why a sequence ends before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The owner's connection is gone.
    OwnerGone,
    /// The owner has been silent for longer than its lease.
    OwnerSilent,
    /// The daemon stops.
    Stopping,
    /// Another client has ended the sequence.
    EndedBy(Peer),
    /// A client has sent the control character that stops every motor.
    AllStopped(Peer, u8),
    /// A client has aborted the coordinate system that the sequence feeds.
    Aborted(Peer),
    /// A client has sent `CLOSE`, or has reset the board.
    Closed(Peer),
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OwnerGone => f.write_str("its client is gone"),
            Self::OwnerSilent => f.write_str("its client is silent"),
            Self::Stopping => f.write_str("pmacd is stopping"),
            Self::EndedBy(Peer { uid, pid, .. }) => write!(f, "uid {uid} (pid {pid}) ended it"),
            Self::AllStopped(Peer { uid, pid, .. }, character) => {
                write!(f, "uid {uid} (pid {pid}) sent {}", control::name(*character))
            }
            Self::Aborted(Peer { uid, pid, .. }) => {
                write!(f, "uid {uid} (pid {pid}) aborted its coordinate system")
            }
            Self::Closed(Peer { uid, pid, .. }) => {
                write!(f, "uid {uid} (pid {pid}) closed the rotary buffers")
            }
        }
    }
}

/// A request of the owner to the script.
#[derive(Debug)]
pub enum Asked {
    /// Send these lines.
    Lines(Batch),
    /// No more lines follow in the rotary buffer.
    Finish,
    /// End the sequence.
    Stop,
}

/// `error`, with the notes of an end appended to its reason, if it has one.
fn with_notes(error: CallError, notes: &[String]) -> CallError {
    match error {
        CallError::Refused { reason } if !notes.is_empty() => {
            CallError::refused(format!("{reason}; {}", notes.join("; ")))
        }
        error => error,
    }
}

/// The first line of a reply.
fn first(lines: &[String]) -> &str {
    lines.first().map_or("", |line| answer::text(line))
}
