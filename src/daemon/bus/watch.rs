//! A thread that waits for interrupts, and for the end, while the bus thread sleeps.
//!
//! A poll of descriptors costs the bus thread more than a sleep, and seldom one is readable. So while the board is asked
//! nothing, the bus thread only sleeps, and looks at a flag after each sleep. This thread raises it.

use std::io;
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};

use crate::daemon::bus::readable::Interrupts;

/// What a descriptor tells the thread: to end, or to raise the flag.
const END: u64 = 0;
const RAISE: u64 = 1;
/// The thread needs next to no memory, and all of it is locked.
const STACK: usize = 64 * 1024;

/// The flag, and the thread that raises it. The thread ends on drop.
pub struct Watch {
    descriptors: Arc<Epoll>,
    is_raised: Arc<AtomicBool>,
    end: EventFd,
}

impl Watch {
    /// Watches `stop` from now on.
    ///
    /// # Errors
    /// The kernel gives no descriptor, or no thread.
    pub fn begin(stop: &EventFd) -> io::Result<Self> {
        let end = EventFd::from_value_and_flags(0, EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC)?;
        let descriptors = Arc::new(Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?);
        descriptors.add(&end, EpollEvent::new(EpollFlags::EPOLLIN, END))?;
        descriptors.add(stop, once())?;
        let watch = Self { descriptors, is_raised: Arc::default(), end };
        let (descriptors, is_raised) = (Arc::clone(&watch.descriptors), Arc::clone(&watch.is_raised));
        let thread = thread::Builder::new().name("watch".to_owned()).stack_size(STACK);
        thread.spawn(move || raise(&descriptors, &is_raised))?;
        Ok(watch)
    }

    /// Takes the flag down: before the descriptors are polled, so that nothing that comes behind the poll is lost.
    pub fn lower(&self) {
        self.is_raised.store(false, Ordering::Release);
    }

    /// Watches these until each was readable once; one that is readable already raises the flag. One that is closed
    /// meanwhile raises it once at most.
    pub fn arm(&self, interrupts: Interrupts<BorrowedFd<'_>>) {
        for interrupt in interrupts.into_iter().flatten() {
            if self.descriptors.modify(interrupt, &mut once()).is_err() {
                // It is new. If it cannot be watched, the polls between the sleeps see it.
                let _ = self.descriptors.add(interrupt, once());
            }
        }
    }

    /// Whether something has become readable since [`Watch::lower`].
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.is_raised.load(Ordering::Acquire)
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        // Cannot fail: nobody else writes it.
        let _ = self.end.write(1);
    }
}

/// Readable once is enough: until the bus thread has looked, more of it says nothing new.
fn once() -> EpollEvent {
    EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLONESHOT, RAISE)
}

/// What the thread does.
fn raise(descriptors: &Epoll, is_raised: &AtomicBool) {
    let mut ready = [EpollEvent::empty()];
    loop {
        match descriptors.wait(&mut ready, EpollTimeout::NONE) {
            Ok(0) | Err(Errno::EINTR) => {}
            Ok(_) if ready[0].data() == RAISE => is_raised.store(true, Ordering::Release),
            // It cannot fail. If it does, the polls between the sleeps see all.
            Ok(_) | Err(_) => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::time::{Duration, Instant};

    use super::*;

    fn is_raised_soon(watch: &Watch) -> bool {
        let until = Instant::now() + Duration::from_secs(10);
        while !watch.is_raised() && Instant::now() < until {
            thread::yield_now();
        }
        watch.is_raised()
    }

    #[test]
    fn an_interrupt_raises_the_flag_once_each_time_it_is_armed() {
        let stop = EventFd::from_value_and_flags(0, EfdFlags::EFD_CLOEXEC).unwrap();
        let watch = Watch::begin(&stop).unwrap();
        let arm = |interrupt: &UnixStream| {
            watch.lower();
            watch.arm([Some(interrupt.as_fd()), None, None]);
        };
        let (mut board, mut interrupt) = UnixStream::pair().unwrap();
        board.write_all(&[1]).unwrap();
        assert!(!watch.is_raised(), "it is not watched yet");
        arm(&interrupt);
        assert!(is_raised_soon(&watch), "it was readable before");
        watch.lower();
        board.write_all(&[1]).unwrap();
        thread::sleep(Duration::from_millis(20));
        assert!(!watch.is_raised(), "it is not armed again");
        arm(&interrupt);
        assert!(is_raised_soon(&watch), "nobody has read it");
        interrupt.read_exact(&mut [0; 2]).unwrap();
        arm(&interrupt);
        assert!(!watch.is_raised());
        board.write_all(&[2]).unwrap();
        assert!(is_raised_soon(&watch));
        // The other end was closed, and connected again.
        (board, interrupt) = UnixStream::pair().unwrap();
        arm(&interrupt);
        assert!(!watch.is_raised());
        board.write_all(&[3]).unwrap();
        assert!(is_raised_soon(&watch));
        watch.lower();
        stop.write(1).unwrap();
        assert!(is_raised_soon(&watch), "the end is always watched");
        watch.arm([None; 3]);
        assert!(watch.is_raised(), "what came behind the poll is not forgotten");
        let descriptors = Arc::downgrade(&watch.descriptors);
        drop(watch);
        let until = Instant::now() + Duration::from_secs(10);
        while descriptors.upgrade().is_some() && Instant::now() < until {
            thread::yield_now();
        }
        assert!(descriptors.upgrade().is_none(), "the thread ends");
    }
}
