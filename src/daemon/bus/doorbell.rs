//! A thread that waits for interrupts, and for the daemon's end, while the bus thread sleeps.

use std::io;
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};

/// A descriptor's message to the thread: to end, or to ring.
const END: u64 = 0;
const RING: u64 = 1;
/// The thread needs next to no stack.
const STACK: usize = 64 * 1024;

/// A bell that the thread rings. The thread ends on drop.
pub struct Doorbell {
    wires: Arc<Wires>,
    thread: Option<JoinHandle<()>>,
}

/// The part that the thread shares with its owner. It lives until both are done: a closed descriptor wakes nobody.
struct Wires {
    descriptors: Epoll,
    end: EventFd,
    has_rung: AtomicBool,
}

impl Doorbell {
    /// Listens to `stop` from now on.
    ///
    /// # Errors
    /// The kernel gives no descriptor, or no thread.
    pub fn new(stop: &EventFd) -> io::Result<Self> {
        let wires = Arc::new(Wires {
            descriptors: Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?,
            end: EventFd::from_value_and_flags(0, EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC)?,
            has_rung: AtomicBool::new(false),
        });
        wires.descriptors.add(&wires.end, EpollEvent::new(EpollFlags::EPOLLIN, END))?;
        wires.descriptors.add(stop, once())?;
        let its = Arc::clone(&wires);
        let thread = thread::Builder::new().name("doorbell".to_owned()).stack_size(STACK);
        let thread = Some(thread.spawn(move || its.ring())?);
        Ok(Self { wires, thread })
    }

    /// Forgets earlier rings. Call this before a poll of the descriptors: after the poll, it would forget a ring that
    /// came in between.
    pub fn silence(&self) {
        self.wires.has_rung.swap(false, Ordering::SeqCst);
    }

    /// Rings once when `interrupt` is readable. If it is readable now, the bell rings now.
    ///
    /// # Errors
    /// The kernel cannot watch `interrupt`.
    pub fn listen(&self, interrupt: BorrowedFd<'_>) -> nix::Result<()> {
        let descriptors = &self.wires.descriptors;
        match descriptors.modify(interrupt, &mut once()) {
            Err(Errno::ENOENT) => descriptors.add(interrupt, once()),
            result => result,
        }
    }

    /// Whether a descriptor has become readable since [`Doorbell::silence`].
    #[must_use]
    pub fn has_rung(&self) -> bool {
        self.wires.has_rung.load(Ordering::SeqCst)
    }
}

impl Drop for Doorbell {
    fn drop(&mut self) {
        // Cannot fail: only the owner writes this event.
        let _ = self.wires.end.write(1);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

impl Wires {
    /// The thread's work.
    fn ring(&self) {
        let mut ready = [EpollEvent::empty()];
        loop {
            match self.descriptors.wait(&mut ready, EpollTimeout::NONE) {
                Ok(0) | Err(Errno::EINTR) => {}
                Ok(_) if ready[0].data() == RING => self.has_rung.store(true, Ordering::SeqCst),
                // Only a signal makes the wait fail.
                Ok(_) | Err(_) => return,
            }
        }
    }
}

/// The kernel reports a readable descriptor once: until the bus thread has looked, more reports say nothing new.
fn once() -> EpollEvent {
    EpollEvent::new(EpollFlags::EPOLLIN | EpollFlags::EPOLLONESHOT, RING)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::time::{Duration, Instant};

    use super::*;

    fn doorbell() -> (Doorbell, EventFd) {
        let stop = EventFd::from_value_and_flags(0, EfdFlags::EFD_CLOEXEC).unwrap();
        (Doorbell::new(&stop).unwrap(), stop)
    }

    fn rings(bell: &Doorbell) -> bool {
        let until = Instant::now() + Duration::from_secs(10);
        while !bell.has_rung() && Instant::now() < until {
            thread::yield_now();
        }
        bell.has_rung()
    }

    fn stays_silent(bell: &Doorbell) -> bool {
        thread::sleep(Duration::from_millis(20));
        !bell.has_rung()
    }

    #[test]
    fn it_rings_once_for_each_time_it_is_told_to_listen() {
        let (bell, stop) = doorbell();
        let listen = |interrupt: &UnixStream| {
            bell.silence();
            bell.listen(interrupt.as_fd()).unwrap();
        };
        let (mut board, mut interrupt) = UnixStream::pair().unwrap();
        board.write_all(&[1]).unwrap();
        assert!(stays_silent(&bell), "nobody listens yet");
        listen(&interrupt);
        assert!(rings(&bell), "it was readable before");
        bell.silence();
        board.write_all(&[1]).unwrap();
        assert!(stays_silent(&bell), "it has rung for that");
        listen(&interrupt);
        assert!(rings(&bell), "nobody has read it");
        interrupt.read_exact(&mut [0; 2]).unwrap();
        listen(&interrupt);
        assert!(stays_silent(&bell));
        board.write_all(&[2]).unwrap();
        assert!(rings(&bell));
        // The board closes its end, and connects again.
        (board, interrupt) = UnixStream::pair().unwrap();
        listen(&interrupt);
        assert!(stays_silent(&bell));
        board.write_all(&[3]).unwrap();
        assert!(rings(&bell));
        bell.silence();
        stop.write(1).unwrap();
        assert!(rings(&bell), "it always listens to the end");
    }

    #[test]
    fn its_thread_has_ended_when_it_is_dropped() {
        for _ in 0..100 {
            let (bell, _stop) = doorbell();
            let wires = Arc::downgrade(&bell.wires);
            drop(bell);
            assert!(wires.upgrade().is_none());
        }
    }
}
