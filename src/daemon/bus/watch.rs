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
use nix::sys::eventfd::EventFd;

use crate::daemon::bus::readable::Interrupts;

/// What the thread learns of a descriptor: whether it is the one that ends it.
const STOP: u64 = 0;
const INTERRUPT: u64 = 1;

/// The flag, and what raises it.
pub struct Watch {
    descriptors: Arc<Epoll>,
    is_raised: Arc<AtomicBool>,
}

impl Watch {
    /// Watches `stop`. Once that is readable, the thread raises the flag and ends.
    ///
    /// # Errors
    /// The kernel gives no descriptor, or no thread.
    pub fn begin(stop: &EventFd) -> io::Result<Self> {
        let descriptors = Arc::new(Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?);
        descriptors.add(stop, EpollEvent::new(EpollFlags::EPOLLIN, STOP))?;
        let watch = Self { descriptors, is_raised: Arc::default() };
        let (descriptors, is_raised) = (Arc::clone(&watch.descriptors), Arc::clone(&watch.is_raised));
        thread::Builder::new().name("watch".to_owned()).spawn(move || raise(&descriptors, &is_raised))?;
        Ok(watch)
    }

    /// Takes the flag down, and watches these until each was readable once. One that has been closed since is watched no
    /// more by itself.
    pub fn arm(&self, interrupts: Interrupts<BorrowedFd<'_>>) {
        self.is_raised.store(false, Ordering::Release);
        for interrupt in interrupts.into_iter().flatten() {
            // Readable once is enough: until the bus thread has looked, more of it says nothing new.
            let mut event = EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLONESHOT, INTERRUPT);
            if self.descriptors.modify(interrupt, &mut event).is_err() {
                // It is new. If it cannot be watched, the polls between the sleeps see it.
                let _ = self.descriptors.add(interrupt, event);
            }
        }
    }

    /// Whether something has become readable since [`Watch::arm`].
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.is_raised.load(Ordering::Acquire)
    }
}

/// What the thread does.
fn raise(descriptors: &Epoll, is_raised: &AtomicBool) {
    let mut ready = [EpollEvent::empty()];
    loop {
        match descriptors.wait(&mut ready, EpollTimeout::NONE) {
            Ok(_) => is_raised.store(true, Ordering::Release),
            Err(Errno::EINTR) => continue,
            // It cannot fail otherwise. If it does, the polls between the sleeps see all.
            Err(_) => return,
        }
        if ready[0].data() == STOP {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::time::{Duration, Instant};

    use nix::sys::eventfd::EfdFlags;

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
        let (mut board, mut interrupt) = UnixStream::pair().unwrap();
        board.write_all(&[1]).unwrap();
        assert!(!watch.is_raised(), "it is not watched yet");
        watch.arm([Some(interrupt.as_fd()), None, None]);
        assert!(is_raised_soon(&watch), "it was readable before");
        watch.arm([Some(interrupt.as_fd()), None, None]);
        assert!(is_raised_soon(&watch), "nobody has read it");
        interrupt.read_exact(&mut [0]).unwrap();
        watch.arm([Some(interrupt.as_fd()), None, None]);
        assert!(!watch.is_raised());
        board.write_all(&[2]).unwrap();
        assert!(is_raised_soon(&watch));
        // The board's other end was closed, and connected again.
        (board, interrupt) = UnixStream::pair().unwrap();
        watch.arm([Some(interrupt.as_fd()), None, None]);
        assert!(!watch.is_raised());
        board.write_all(&[3]).unwrap();
        assert!(is_raised_soon(&watch));
        watch.arm([None; 3]);
        assert!(!watch.is_raised());
        stop.write(1).unwrap();
        assert!(is_raised_soon(&watch), "the end is always watched");
    }
}
