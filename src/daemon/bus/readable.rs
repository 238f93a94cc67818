//! What the bus thread waits for, in one poll: its end, commands, interrupts.

use std::os::fd::BorrowedFd;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;

/// The interrupts of the ports for command lines, where there are some: the DPRAM's, and the two of the mailboxes.
pub type Interrupts<T> = [Option<T>; 3];

/// Which descriptors became readable.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Readable {
    /// The thread shall end.
    pub stop: bool,
    /// Commands wait.
    pub commands: bool,
    /// The DPRAM's interrupt came.
    pub interrupt: bool,
    /// One of the mailboxes' interrupts came.
    pub mailbox: bool,
}

impl Readable {
    /// Waits so long, or until there is something to read.
    #[must_use]
    pub fn wait(
        stop: BorrowedFd<'_>,
        commands: Option<BorrowedFd<'_>>,
        interrupts: Interrupts<BorrowedFd<'_>>,
        timeout: Duration,
    ) -> Self {
        let [interrupt, taken, reply] = interrupts;
        // A place without a descriptor of its own watches the first one again, which is harmless.
        let mut watched = [Some(stop), commands, interrupt, taken, reply]
            .map(|fd| PollFd::new(fd.unwrap_or(stop), PollFlags::POLLIN));
        if ppoll(&mut watched, Some(TimeSpec::from_duration(timeout)), None).is_err() {
            // A signal, or no memory: the next round looks again.
            return Self::default();
        }
        let [stop, second, third, fourth, fifth] = watched.map(|fd| fd.any().unwrap_or(false));
        Self {
            stop,
            commands: second && commands.is_some(),
            interrupt: third && interrupt.is_some(),
            mailbox: fourth && taken.is_some() || fifth && reply.is_some(),
        }
    }
}
