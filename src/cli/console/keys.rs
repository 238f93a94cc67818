//! Single key presses on a terminal.

use std::io::Read as _;
use std::os::fd::AsFd as _;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};

/// ^D.
const END_OF_INPUT: u8 = 4;

/// The keyboard without line buffering and echo, until this value is dropped.
pub struct Keys {
    restore: Option<Termios>,
}

impl Keys {
    /// Listens to the keyboard, if the output and the input are terminals.
    pub fn listen(interactive: bool) -> Self {
        let stdin = std::io::stdin();
        let restore = if interactive { tcgetattr(&stdin).ok() } else { None };
        if let Some(before) = &restore {
            let mut raw = before.clone();
            raw.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
            let _ = tcsetattr(&stdin, OptionalActions::Now, &raw);
        }
        Self { restore }
    }

    /// Whether the program listens to the keys.
    pub fn are_heard(&self) -> bool {
        self.restore.is_some()
    }

    /// Waits at most `time`, less if the user presses q.
    pub fn quit_within(&self, time: Duration) -> bool {
        if self.restore.is_none() {
            std::thread::sleep(time);
            return false;
        }
        let stdin = std::io::stdin();
        let end = Instant::now().checked_add(time);
        loop {
            let left = end.map_or(Duration::MAX, |end| end.saturating_duration_since(Instant::now()));
            let timeout = PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX);
            let mut watched = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
            match poll(&mut watched, timeout) {
                Ok(1..) => {
                    let mut key = [0];
                    match stdin.lock().read(&mut key) {
                        Ok(1) if matches!(key[0], b'q' | b'Q' | END_OF_INPUT) => return true,
                        Ok(0) | Err(_) => return true,
                        Ok(_) => {}
                    }
                }
                // A signal ends the wait. The caller checks which.
                Ok(_) | Err(_) => return false,
            }
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        if let Some(before) = &self.restore {
            let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, before);
        }
    }
}
