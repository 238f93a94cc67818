//! The descriptors that the bus thread waits for in one poll: its end, commands, interrupts.

use std::os::fd::BorrowedFd;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;

/// The interrupts of the ports for command lines, if they have some: the DPRAM's, and the two of the mailboxes.
pub type Interrupts<T> = [Option<T>; 3];

/// The descriptors to wait for.
pub struct Descriptors<'a> {
    /// The thread's end.
    pub stop: BorrowedFd<'a>,
    /// Commands, if the bus thread would take some.
    pub commands: Option<BorrowedFd<'a>>,
    /// Interrupts.
    pub interrupts: Interrupts<BorrowedFd<'a>>,
}

/// Which descriptors became readable.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Readable {
    /// The thread has to end.
    pub stop: bool,
    /// Commands wait.
    pub commands: bool,
    /// The DPRAM's interrupt came.
    pub interrupt: bool,
    /// An interrupt of the mailboxes came.
    pub mailbox: bool,
}

impl Descriptors<'_> {
    /// Waits for `timeout`, or until a descriptor is readable.
    #[must_use]
    pub fn wait(&self, timeout: Duration) -> Readable {
        let Self { stop, commands, interrupts: [interrupt, taken, reply] } = *self;
        // The kernel takes longer with each descriptor, so it gets only those that are there.
        let mut watched = std::array::from_fn::<_, 5, _>(|_| PollFd::new(stop, PollFlags::POLLIN));
        let mut count = 0;
        let places = [Some(stop), commands, interrupt, taken, reply].map(|fd| {
            watched[count] = PollFd::new(fd?, PollFlags::POLLIN);
            count += 1;
            Some(count - 1)
        });
        if ppoll(&mut watched[..count], Some(TimeSpec::from_duration(timeout)), None).is_err() {
            // A signal, or no memory: the next round looks again.
            return Readable::default();
        }
        let [stop, commands, interrupt, taken, reply] =
            places.map(|place| place.is_some_and(|place: usize| watched[place].any().unwrap_or(false)));
        Readable { stop, commands, interrupt, mailbox: taken || reply }
    }
}
