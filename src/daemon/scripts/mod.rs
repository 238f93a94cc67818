//! Sequences: lines and jobs that belong together, run on a shared board by the daemon for one client.
//!
//! A download, a restore, a gather or a stream is a sequence. It has one owner, a connection, and holds a [`Resource`] that no
//! other sequence gets meanwhile. It ends when it is done, when its owner says so, or when the owner is gone or silent
//! ([`LEASE`]), when somebody else ends it, or when the daemon stops. Whatever ends it, the daemon carries out the steps that its end needs
//! (`CLOSE`, `ENDGATHER`, a variable put back), also when its owner has gone.
//!
//! # A new sequence
//! It is a step machine without I/O: a type that implements [`Sequence`]. The server asks it for a [`Step`], has the bus thread
//! do it, and gives what became of it to the next call of [`Sequence::next`].
//! * Begin: a method of the socket (`socket/methods.rs`) gives `Action::Sequence(SequenceCall::…)`; `socket/server/sequencing.rs` makes
//!   the machine of it. The caller waits until the machine says [`Step::Answer`] or [`Step::Over`]. [`Step::Tell`]
//!   before that streams to a caller that asked for `more`.
//! * Rest: after [`Step::Answer`] nothing happens until the owner calls again ([`Sequence::asked`]), an event of the machine's own
//!   making is due ([`Step::Wait`]), or an end comes. While it rests the lease runs: any call on the
//!   owner's connection renews it. While a call is under way it does not run: the daemon is busy for its owner then.
//! * End: [`Sequence::end`] says why. The step under way is finished first and its outcome given; from then on every step must
//!   serve the end, be bounded, and lead to [`Step::Over`].

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
pub use lines::Batch;
pub use lines::Lines;
pub use rotary::{RotaryCall, lines_left, rotary};

use crate::daemon::shared::job::Job;
use crate::daemon::shared::peer::Peer;
use crate::daemon::shared::queue::{LINE_MAX, Outcome, REASON_MAX, Text};
use crate::function::rotary::RotaryState;
use crate::map::HostOffset;
use crate::protocol::{CallError, Reply, answer, control};

/// How long an owner may be silent while nothing is done for it.
pub const LEASE: Duration = Duration::from_secs(5);
/// How long the board may take for a line, and the daemon for a job.
const STEP: Duration = Duration::from_secs(5);
/// How long each step of an end may take.
pub const END_STEP: Duration = Duration::from_secs(2);

/// What a sequence has of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resource {
    /// The board's variables and program buffers, as far as lines one after the other change or list them.
    Lines,
    /// Its gather buffer, and the variables that say what is gathered.
    Gather,
    /// The rotary buffer in the DPRAM with this index.
    Rotary(usize),
}

impl Resource {
    /// Whether a sequence with `other` cannot run beside one with this. The set-up of a stream switches the transfer of every rotary
    /// buffer off, and its end closes all of them.
    pub fn excludes(self, other: Self) -> bool {
        self == other || matches!((self, other), (Self::Rotary(_), Self::Rotary(_)))
    }
}

impl fmt::Display for Resource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lines => f.write_str("one sequence of lines runs at a time"),
            Self::Gather => f.write_str("the board has one gather at a time"),
            Self::Rotary(_) => f.write_str("the board has one rotary stream at a time"),
        }
    }
}

/// What is to be done next.
#[derive(Debug, Clone)]
pub enum Step {
    /// Send a line.
    Line {
        /// The line.
        line: Text<LINE_MAX>,
        /// How long the board may take.
        timeout: Duration,
    },
    /// Send a control character that has an answer.
    Control {
        /// The character.
        character: u8,
        /// How long the board may take.
        timeout: Duration,
    },
    /// Read words of the DPRAM.
    Read {
        /// The first one.
        first: HostOffset,
        /// How many.
        count: usize,
        /// How long the bus thread may take.
        timeout: Duration,
    },
    /// Have the bus thread do a job.
    Job {
        /// The job.
        job: Box<Job>,
        /// How long it may take.
        timeout: Duration,
    },
    /// Ask the board something. Not sent while a program buffer is open, and not logged.
    Ask {
        /// The question.
        line: Text<LINE_MAX>,
        /// How long the board may take.
        timeout: Duration,
    },
    /// Find out whether the board has been reset since a check before. Not sent while a program buffer is open.
    Check,
    /// Nothing before this moment. An end, or a call of the owner, ends the waiting.
    Wait(Instant),
    /// Nothing before the owner calls or an end comes.
    Rest,
    /// Tell the owner something, as one of several replies, and go on.
    Tell(Reply),
    /// Answer the owner's call, and rest until it calls again or an end comes.
    Answer(Result<Reply, CallError>),
    /// Answer the owner's call, and all who wait for the end: the end goes on without them.
    AnswerEnd(Result<Reply, CallError>),
    /// It is over. Answers the owner's call, if one is under way.
    Over(Result<Reply, CallError>),
}

/// What became of a step that the bus thread has done.
#[derive(Debug)]
pub struct Done {
    /// How it ended.
    pub outcome: Outcome,
    /// The lines of the board's reply, or what a caller would be told of the failure.
    pub result: Result<Vec<String>, CallError>,
    /// How many resets of the board the checks have found.
    pub resets: u64,
    /// How often something was seen that a reset may have caused: reason for a check.
    pub doubts: u64,
    /// How far the rotary buffer is, after a job that asks for it.
    pub rotary: Option<RotaryState>,
    /// The words of a [`Step::Read`].
    pub words: Vec<u16>,
    /// Whether the board gathers at that moment; `None` where no report tells.
    pub gathers: Option<bool>,
    /// The coordinate systems that run a motion program at that moment, bit 0 being number 1; `None` where no report tells.
    pub programs_run: Option<u32>,
    /// Who has ended what the sequence does, if a client did since it began: `uid 0 (pid 7) sent ENDGATHER`.
    pub ended_by: Option<String>,
}

/// What the bus thread found for a step, besides the lines of a reply.
#[derive(Debug, Default)]
pub struct Found {
    /// How far a rotary buffer is.
    pub rotary: Option<RotaryState>,
    /// Words of the DPRAM.
    pub words: Vec<u16>,
}

/// Why a sequence ends before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// Its owner's connection is gone.
    OwnerGone,
    /// Its owner has been silent for longer than [`LEASE`].
    OwnerSilent,
    /// The daemon stops.
    Stopping,
    /// Somebody else has ended it.
    EndedBy(Peer),
    /// Somebody has sent the control character that stops every motor.
    AllStopped(Peer, u8),
    /// Somebody has aborted the coordinate system that it feeds.
    Aborted(Peer),
    /// Somebody has sent `CLOSE`, or has reset the board.
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

/// What a client asks of a sequence, or begins one with.
#[derive(Debug)]
pub enum SequenceCall {
    /// Be told that its owner is still there.
    Renew,
    /// Send these lines.
    Lines(Batch),
    /// Gather.
    Gather(GatherCall),
    /// End the gather of the caller, or of the user with this number.
    GatherStop {
        /// The user.
        uid: Option<u32>,
    },
    /// Stream into a rotary buffer.
    Rotary(RotaryCall),
    /// No line follows in the rotary buffer with this index.
    RotaryFinish(usize),
    /// End the stream into the rotary buffer with this index.
    RotaryStop(usize),
}

/// A step machine; the module tells how it is driven.
pub trait Sequence: fmt::Debug + Send {
    /// What it has of the board.
    fn resource(&self) -> Resource;

    /// What people call it: `download`, `gather`.
    fn name(&self) -> &str;

    /// Whether its lines so far have opened a program buffer that they have not closed. Its next line is refused if somebody else
    /// has closed it: the board would carry it out at once.
    fn is_inside(&self) -> bool {
        false
    }

    /// The coordinate systems whose programs it feeds, bit 0 being number 1. An abort of one of them ends it.
    fn feeds(&self) -> u32 {
        0
    }

    /// How many lines its end leaves that nobody expects, in the rotary buffers of the coordinate systems that it feeds; `None` where
    /// it has changed nothing there. Told when it is over.
    fn leaves(&self) -> Option<u64> {
        None
    }

    /// What its end still has to do on the board, if it waits for somebody else with that.
    fn unfinished(&self) -> Option<String> {
        None
    }

    /// The next step. `done` is what became of the line or job before; `None` at the beginning, and after every other step.
    fn next(&mut self, done: Option<Done>, now: Instant) -> Step;

    /// Whether it has steps of its own while its owner says nothing: [`Self::next`] is called again after a [`Step::Answer`].
    fn watches(&self) -> bool {
        false
    }

    /// Its owner calls: the steps that follow are for this call.
    ///
    /// # Errors
    /// What to answer instead; nothing changes then.
    fn asked(&mut self, call: SequenceCall, now: Instant) -> Result<(), CallError>;

    /// Somebody has stopped all motion, and the lines that wait are not sent any more, for this reason: nor are those that
    /// would follow here.
    fn drop_lines(&mut self, _reason: Text<REASON_MAX>) {}

    /// It ends, for this reason. Told once.
    fn end(&mut self, why: Ending);
}

/// The step that sends `text`.
fn line(text: impl fmt::Display, timeout: Duration) -> Step {
    Step::Line { line: Text::of(&text), timeout }
}

/// The step that asks `text`.
fn ask(text: impl fmt::Display, timeout: Duration) -> Step {
    Step::Ask { line: Text::of(&text), timeout }
}

/// The first line of a reply.
fn first(lines: &[String]) -> &str {
    lines.first().map_or("", |line| answer::text(line))
}
