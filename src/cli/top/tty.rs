//! The terminal of `top`: raw, on a screen of its own, and always left as it was.

use std::collections::VecDeque;
use std::io::{self, Stdout, Write as _};
use std::os::fd::AsFd as _;
use std::time::Duration;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::unistd::read;
use ratatui::backend::TermionBackend;
use ratatui::layout::Rect;
use ratatui::termion::event::{Event, Key, parse_event};
use ratatui::{Frame, Terminal};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use signal_hook::consts::SIGTSTP;

/// Enters the other screen, cleared, without a cursor, with arrow keys as CSI sequences; and leaves it.
const ENTER: &str = "\x1b[?1049h\x1b[2J\x1b[?25l\x1b[?1l";
const LEAVE: &str = "\x1b[0m\x1b[?25h\x1b[?1049l";
/// The rest of a key's sequence follows its first byte within this time.
const SEQUENCE: Duration = Duration::from_millis(25);

pub struct Tty {
    terminal: Terminal<TermionBackend<Stdout>>,
    before: Termios,
    bytes: VecDeque<u8>,
}

/// Input from the keyboard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    Key(Key),
    Nothing,
    /// The terminal is gone.
    End,
}

impl Tty {
    /// Takes the terminal.
    pub fn open() -> io::Result<Self> {
        let before = tcgetattr(io::stdin())?;
        let terminal = Terminal::new(TermionBackend::new(io::stdout()))?;
        let tty = Self { terminal, before, bytes: VecDeque::new() };
        let (before, hook) = (tty.before.clone(), std::panic::take_hook());
        std::panic::set_hook(Box::new(move |panic| {
            leave(&before);
            hook(panic);
        }));
        tty.enter()?;
        Ok(tty)
    }

    fn enter(&self) -> io::Result<()> {
        let mut raw = self.before.clone();
        raw.make_raw();
        tcsetattr(io::stdin(), OptionalActions::Now, &raw)?;
        let mut stdout = io::stdout();
        stdout.write_all(ENTER.as_bytes())?;
        stdout.flush()
    }

    /// Gives the terminal back until this process is continued (`SIGCONT`).
    pub fn suspend(&mut self) -> io::Result<()> {
        leave(&self.before);
        signal_hook::low_level::emulate_default_handler(SIGTSTP)?;
        self.resume()
    }

    /// Takes the terminal again, as after a stop by `SIGSTOP`.
    pub fn resume(&mut self) -> io::Result<()> {
        self.enter()?;
        // Not `clear`, which asks the terminal for its cursor and may take the user's keys for the answer.
        let size = self.terminal.size()?;
        self.terminal.resize(Rect::new(0, 0, size.width, size.height))
    }

    pub fn draw(&mut self, picture: impl FnOnce(&mut Frame<'_>)) -> io::Result<()> {
        self.terminal.draw(picture).map(drop)
    }

    /// The next key, within `time`.
    pub fn key_within(&mut self, time: Duration) -> Input {
        if self.bytes.is_empty() && !self.read_within(time) {
            return Input::End;
        }
        let Some(first) = self.bytes.pop_front() else { return Input::Nothing };
        if first == b'\x1b' && self.bytes.is_empty() {
            if !self.read_within(SEQUENCE) {
                return Input::End;
            }
            if self.bytes.is_empty() {
                return Input::Key(Key::Esc);
            }
        }
        let mut rest = std::iter::from_fn(|| self.bytes.pop_front().map(Ok));
        match parse_event(first, &mut rest) {
            Ok(Event::Key(key)) => Input::Key(key),
            Ok(_) | Err(_) => Input::Key(Key::Null),
        }
    }

    /// Waits for bytes. False if no more can come.
    fn read_within(&mut self, time: Duration) -> bool {
        let stdin = io::stdin();
        let left = PollTimeout::try_from(time);
        let mut watched = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
        match poll(&mut watched, left.unwrap_or(PollTimeout::MAX)) {
            Ok(1..) => {
                let mut chunk = [0; 64];
                // Not through a buffer, into which `poll` does not see.
                match read(&stdin, &mut chunk) {
                    Ok(0) => false,
                    Ok(count) => {
                        self.bytes.extend(&chunk[..count]);
                        true
                    }
                    Err(errno) => errno == Errno::EINTR,
                }
            }
            // A signal ends the wait. The caller checks which.
            Ok(_) | Err(_) => true,
        }
    }
}

impl Drop for Tty {
    fn drop(&mut self) {
        leave(&self.before);
    }
}

/// Restores the terminal. If that fails, the program can do no more.
fn leave(before: &Termios) {
    let mut stdout = io::stdout();
    let _ = stdout.write_all(LEAVE.as_bytes()).and_then(|()| stdout.flush());
    let _ = tcsetattr(io::stdin(), OptionalActions::Now, before);
}
