//! The bounded queues of plain values between the command socket's thread and the bus thread.
//!
//! Both sides only ever try: a full queue is an answer ("busy"), never a wait, so no client can hold up the bus. The
//! values own their bytes inline; passing one allocates nothing.

use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

use nix::sys::eventfd::{EfdFlags, EventFd};

use super::job::Job;
use super::open_buffer::{Barred, Writer};
pub use super::origin::{GivenUp, Origin, REASON_MAX};
use super::status::BoardStatus;
pub use crate::format::Text;
use crate::function::line_port::ResponseText;
use crate::function::rotary::RotaryState;
use crate::language::deadlines;
pub use crate::language::{LINE_MAX, Line};
use crate::map::HostOffset;
pub use crate::protocol::READ_MAX;
use crate::protocol::{CommandPort, MessageKind, control};

/// The most commands of each kind that the bus thread holds at a time. The socket's thread hands over no more
/// (`socket::fair_queue`), and the bus thread's queues have exactly this room.
pub mod at_once {
    /// Lines for the board: the one under way, and the one that follows it. Each further line would delay a user who
    /// has just come.
    pub const LINES: usize = 2;
    /// Control characters without an answer, as those that stop a machine.
    pub const CONTROLS: usize = 8;
    /// Control characters with an answer, which wait for the line under way.
    pub const QUERIES: usize = 8;
    /// Control panel requests of clients.
    pub const PANEL: usize = 16;
    /// Panel requests of the daemon's own stops; as many lines and as many control characters.
    pub const STOPS: usize = 4;
    /// Writes of variables.
    pub const WRITES: usize = 8;
    /// Batches of rotary lines: one for each stream that a board can have.
    pub const ROTARY: usize = 16;
    /// Commands that the bus thread finishes as soon as it takes them.
    pub const SHORT: usize = 8;
    /// All of them, and a change of the table of watched registers.
    pub const ALL: usize = LINES + CONTROLS + QUERIES + PANEL + 3 * STOPS + WRITES + ROTARY + SHORT + 1;
}

/// Names one command from its acceptance to its last event. The socket's thread chooses it and never reuses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Ticket(pub u64);

/// A command of the socket's thread to the bus thread.
#[derive(Debug)]
pub enum Command {
    /// Send an ASCII command line and collect its reply. The bus thread answers by [`Event::Line`]s and one
    /// [`Event::Done`].
    Send {
        /// Whose command this is.
        ticket: Ticket,
        /// The line without terminator, 1 to [`LINE_MAX`] bytes, no control characters.
        line: Line,
        /// The line's origin.
        origin: Origin,
        /// When to give up, wherever the line is by then.
        deadline: Instant,
        /// The sender, which decides whether the line may enter an open program buffer. The bus thread answers
        /// [`Outcome::Barred`] if it may not.
        writer: Writer,
    },
    /// Send a line that stops something, before every line that waits and whatever program buffer is open: the line
    /// stores nothing. Answered as [`Command::Send`].
    First {
        /// Whose command this is.
        ticket: Ticket,
        /// The line.
        line: Line,
        /// Whose line it is.
        origin: Origin,
        /// When to give up.
        deadline: Instant,
    },
    /// Send a control character (1 to 31) at once, before every queued line. The bus thread answers by [`Event::Done`].
    Control {
        /// Whose command this is.
        ticket: Ticket,
        /// The user who sends it.
        uid: u32,
        /// The bus thread drops the lines that wait, of every client. It answers each with [`Outcome::Dropped`].
        drops_lines: bool,
        /// The character, `letter - 64`.
        character: u8,
        /// When to give up.
        deadline: Instant,
    },
    /// Have one of the other functions do a job. The bus thread answers by [`Event::Done`], or by the event that the
    /// job names.
    Job {
        /// Whose command this is.
        ticket: Ticket,
        /// The job. The socket's thread boxes it; the bus thread only takes it apart.
        job: Box<Job>,
        /// When to give up.
        deadline: Instant,
    },
    /// Read words of the DPRAM between two updates. The bus thread answers by [`Event::Words`] or [`Event::Done`].
    ReadWords {
        /// Whose command this is.
        ticket: Ticket,
        /// The first word.
        first: HostOffset,
        /// How many, 1 to [`READ_MAX`].
        count: usize,
    },
}

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The board acknowledged the command.
    Done,
    /// The board refused the command with this error number (`ERRnnn`).
    Error(u16),
    /// The deadline passed before the board had answered. The board may or may not have carried out the command.
    TimedOut,
    /// The command ended for this reason while the board may have been at work on it. The board may or may not have
    /// carried it out.
    Interrupted(Text<REASON_MAX>),
    /// The port is off (the DPRAM's: I58=0), or the board is gone. The daemon has sent nothing.
    Unavailable {
        /// The port that would have carried the command.
        port: CommandPort,
        /// The DPRAM's page, if it has a page that the daemon writes again.
        page: Option<u8>,
    },
    /// The command's turn did not come: too many commands were before it. The daemon has sent nothing.
    Busy,
    /// The words lie outside the board's window.
    OutOfRange,
    /// The daemon did not send the line because of a program buffer.
    Barred(Barred),
    /// The daemon did not send the line: a client has stopped all motion meanwhile. [`dropped_by`] names the client.
    Dropped(Text<REASON_MAX>),
    /// The daemon refuses for this reason, and has written nothing.
    Refused(Text<REASON_MAX>),
}

impl Outcome {
    /// Whether the daemon has certainly sent and written nothing of the command.
    #[must_use]
    pub const fn is_unsent(&self) -> bool {
        match self {
            Self::Done | Self::Error(_) | Self::TimedOut | Self::Interrupted(_) => false,
            Self::Unavailable { .. }
            | Self::Busy
            | Self::OutOfRange
            | Self::Barred(_)
            | Self::Dropped(_)
            | Self::Refused(_) => true,
        }
    }
}

/// Why lines are [`Outcome::Dropped`] when the user `uid` stops all motion by `character`.
#[must_use]
pub fn dropped_by(uid: u32, character: u8) -> Text<REASON_MAX> {
    Text::of(&format_args!("not sent: {}", stopped_by(uid, character)))
}

/// Why a line is [`Outcome::Interrupted`] when the user `uid` sends `character` over it.
#[must_use]
pub fn stopped_by(uid: u32, character: u8) -> Text<REASON_MAX> {
    match character {
        control::ABORT => Text::of(&format_args!("aborted by uid {uid}")),
        control::KILL => Text::of(&format_args!("killed by uid {uid}")),
        other => Text::of(&format_args!("cancelled by ^{} of uid {uid}", control::letter(other))),
    }
}

/// An event of the bus thread for the socket's thread.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "inline, so that the bus thread need not allocate")]
pub enum Event {
    /// One line of a reply.
    Line(Ticket, ResponseText),
    /// The end of a command.
    Done(Ticket, Outcome),
    /// The words that the command asked for, `count` of them valid, with the CLOCK_MONOTONIC time of the first read.
    Words {
        /// Whose command this was.
        ticket: Ticket,
        /// CLOCK_MONOTONIC, nanoseconds.
        time_ns: u64,
        /// The words, ascending.
        words: [u16; READ_MAX],
        /// How many are valid.
        count: usize,
    },
    /// The state of a rotary buffer.
    Rotary(Ticket, RotaryState),
    /// The board has the requested table of watched registers from now on, under this number.
    Watching(Ticket, u32),
    /// The daemon's knowledge of the board has changed.
    Info(BoardStatus),
    /// A text that a program of the board sent by itself.
    Unsolicited(Unsolicited),
}

/// A text without a request: from `SEND"…"`, or the response to a program's `CMD"…"`.
#[derive(Debug, Clone, Copy)]
pub struct Unsolicited {
    /// CLOCK_MONOTONIC when the daemon read the text, nanoseconds.
    pub time_ns: u64,
    /// The kind of statement that caused the text.
    pub kind: MessageKind,
    /// The text.
    pub text: ResponseText,
}

/// The end of a queue that puts values in.
pub struct Sender<T> {
    channel: SyncSender<T>,
    wake: Arc<EventFd>,
    queued: Arc<AtomicUsize>,
}

impl<T> Clone for Sender<T> {
    fn clone(&self) -> Self {
        Self { channel: self.channel.clone(), wake: Arc::clone(&self.wake), queued: Arc::clone(&self.queued) }
    }
}

impl<T> Sender<T> {
    /// Puts `value` in and wakes the other side; gives `value` back when the queue is full or has no reader any more.
    ///
    /// # Errors
    /// The value itself.
    pub fn try_send(&self, value: T) -> Result<(), T> {
        self.try_put(value).inspect(|()| self.wake())
    }

    /// Queues `value` without waking the reader; the next [`Sender::try_send`] does, or a queue that is full.
    ///
    /// # Errors
    /// The value itself.
    pub fn try_put(&self, value: T) -> Result<(), T> {
        // Counts before the reader can take the value, so that the count never falls below 0.
        self.queued.fetch_add(1, Ordering::Relaxed);
        self.channel.try_send(value).map_err(|error| {
            self.queued.fetch_sub(1, Ordering::Relaxed);
            self.wake();
            match error {
                TrySendError::Full(value) | TrySendError::Disconnected(value) => value,
            }
        })
    }

    fn wake(&self) {
        // Cannot fail in a way that matters: a saturated counter is already readable.
        let _ = self.wake.write(1);
    }
}

/// The end of a queue that takes values out.
pub struct Receive<T> {
    channel: Receiver<T>,
    wake: Arc<EventFd>,
    queued: Arc<AtomicUsize>,
}

impl<T> Receive<T> {
    /// Readable while something may be in the queue.
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }

    /// Whether values wait, without asking the kernel. A value that the sender is just putting in may count already.
    #[must_use]
    pub fn has_values(&self) -> bool {
        self.queued.load(Ordering::Relaxed) > 0
    }

    /// Makes [`Receive::descriptor`] unreadable again. Call before draining with [`Receive::try_receive`].
    pub fn clear(&self) {
        let _ = self.wake.read();
    }

    /// Makes [`Receive::descriptor`] readable: values may be left in the queue.
    pub fn keep_awake(&self) {
        let _ = self.wake.write(1);
    }

    /// The next value, or `None` when the queue is empty.
    pub fn try_receive(&self) -> Option<T> {
        self.channel.try_recv().ok().inspect(|_| {
            self.queued.fetch_sub(1, Ordering::Relaxed);
        })
    }
}

/// A queue of at most `capacity` values.
///
/// # Errors
/// When the kernel gives no event descriptor.
pub fn queue<T>(capacity: usize) -> nix::Result<(Sender<T>, Receive<T>)> {
    let wake = Arc::new(EventFd::from_value_and_flags(0, EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC)?);
    let (sender, receiver) = sync_channel(capacity);
    let queued = Arc::default();
    let sender = Sender { channel: sender, wake: Arc::clone(&wake), queued: Arc::clone(&queued) };
    Ok((sender, Receive { channel: receiver, wake, queued }))
}

/// How long a command may take when its caller does not say.
pub const DEFAULT_TIMEOUT: Duration = deadlines::PLAIN;

#[cfg(test)]
mod tests {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

    use super::*;

    #[test]
    fn a_full_queue_gives_the_value_back() {
        let (sender, receiver) = queue::<u8>(2).unwrap();
        assert_eq!(sender.try_send(1), Ok(()));
        assert_eq!(sender.try_send(2), Ok(()));
        assert_eq!(sender.try_send(3), Err(3));
        assert!(receiver.has_values());
        receiver.clear();
        assert_eq!(receiver.try_receive(), Some(1));
        assert_eq!(receiver.try_receive(), Some(2));
        assert_eq!(receiver.try_receive(), None);
        assert!(!receiver.has_values(), "what had no room does not count");
        drop(receiver);
        assert_eq!(sender.try_send(4), Err(4));
    }

    #[test]
    fn what_is_only_put_in_wakes_nobody_unless_there_is_no_room() {
        let (sender, receiver) = queue::<u8>(2).unwrap();
        let woken = || {
            let mut watched = [PollFd::new(receiver.descriptor(), PollFlags::POLLIN)];
            poll(&mut watched, PollTimeout::ZERO).is_ok_and(|readable| readable > 0)
        };
        assert_eq!((sender.try_put(1), woken()), (Ok(()), false));
        assert_eq!((sender.try_put(2), woken()), (Ok(()), false));
        assert_eq!((sender.try_put(3), woken()), (Err(3), true));
        receiver.clear();
        assert_eq!((receiver.try_receive(), receiver.try_receive()), (Some(1), Some(2)));
        assert_eq!((sender.try_send(4), woken()), (Ok(()), true));
    }
}
