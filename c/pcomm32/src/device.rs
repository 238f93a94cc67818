//! One device of this process: the way to its daemon, and all that lives between two calls of the program.
//!
//! Each call has a connection for itself, so no thread of the program waits for another one's line. The daemon keeps the
//! modal state (the addressed motor, the open program buffer) for the process, whichever connection a line takes.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use pmac_dpram::client::{Board, CommandError, Connection, OwnBuffer, socket_path};
use pmac_dpram::segment::SegmentName;

use crate::config::Daemon;
use crate::fault::{Fault, Kind};
use crate::process;
use crate::rotary::Buffers;
use crate::texts::{self, Interrupt, Texts};

/// How long a call waits for another thread's `ReleasePmac`.
const LOCK_WAIT: Duration = Duration::from_secs(5);
/// Lines of replies that wait for `PmacGetLineA`.
const WAITING_MAX: usize = 4096;

/// The replies to lines that `PmacSendLineA` has sent.
#[derive(Debug, Default)]
pub(crate) struct Waiting {
    pub(crate) lines: VecDeque<String>,
    /// The failure of the last line, to be told where its acknowledgement would be.
    pub(crate) fault: Option<Fault>,
    /// The end of the replies, which the program has not read yet.
    pub(crate) end: bool,
    /// Lines were dropped, which the program has not heard yet.
    pub(crate) has_lost: bool,
}

impl Waiting {
    /// Keeps the outcome of a line.
    fn keep(&mut self, reply: &Result<Vec<String>, Fault>) {
        let count = reply.as_ref().map_or(0, Vec::len);
        // A program that never fetches its replies shall not fill the memory. One reply of any length has room.
        if !self.lines.is_empty() && self.lines.len() + count > WAITING_MAX {
            self.lines.clear();
            self.has_lost = true;
        }
        self.lines.extend(reply.iter().flatten().cloned());
        // The call that failed has told an older failure.
        self.fault = reply.as_ref().err().cloned();
        self.end = true;
    }

    /// Tells once that lines are missing.
    pub(crate) fn check_lost(&mut self) -> Result<(), Fault> {
        if !std::mem::take(&mut self.has_lost) {
            return Ok(());
        }
        let why = format!(
            "over {WAITING_MAX} lines of replies waited, and the older ones are lost; the board has got the commands"
        );
        Err(Fault { kind: Kind::Uncertain, why, lines: Vec::new() })
    }
}

/// A device.
pub(crate) struct Device {
    number: usize,
    is_open: AtomicBool,
    /// Connections that no call uses now.
    idle: Mutex<Vec<Connection>>,
    board: Mutex<Option<Board>>,
    own_buffer: Mutex<OwnBuffer>,
    waiting: Mutex<Waiting>,
    /// The rotary buffers that the program has announced.
    pub(crate) buffers: Mutex<Buffers>,
    /// The texts that the program fetches.
    pub(crate) texts: Mutex<Option<Texts>>,
    /// The program's callback.
    pub(crate) interrupt: Mutex<Option<Interrupt>>,
    /// The downloads under way: a mark that is true ends its download.
    pub(crate) downloads: Mutex<Vec<Weak<AtomicBool>>>,
    /// The thread that has called `LockPmac`, and how often.
    holder: Mutex<Option<(usize, usize)>>,
    released: Condvar,
}

/// Locks `value`, also after a panic: no panicking call leaves a value half changed.
pub(crate) fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The number of the calling thread. Unlike `thread::current` it is there until the process has ended, also for the
/// destructors that `exit()` runs.
pub(crate) fn this_thread() -> usize {
    static NEXT: AtomicUsize = AtomicUsize::new(0);
    thread_local! {
        static NUMBER: usize = NEXT.fetch_add(1, Ordering::Relaxed);
    }
    NUMBER.with(|number| *number)
}

impl Device {
    pub(crate) fn new(number: usize, is_open: bool) -> Self {
        Self {
            number,
            is_open: AtomicBool::new(is_open),
            idle: Mutex::default(),
            board: Mutex::default(),
            own_buffer: Mutex::default(),
            waiting: Mutex::default(),
            buffers: Mutex::default(),
            texts: Mutex::default(),
            interrupt: Mutex::default(),
            downloads: Mutex::default(),
            holder: Mutex::default(),
            released: Condvar::new(),
        }
    }

    pub(crate) fn is_open(&self) -> bool {
        self.is_open.load(Ordering::Acquire)
    }

    /// Asks the daemon for its board, and opens the device.
    pub(crate) fn open(&self) -> Result<(), Fault> {
        self.ask(Connection::info)?;
        self.is_open.store(true, Ordering::Release);
        Ok(())
    }

    /// Closes the device: the daemon ends what belongs to the connections.
    pub(crate) fn close(&self) {
        self.is_open.store(false, Ordering::Release);
        lock(&self.idle).clear();
        *lock(&self.board) = None;
        *lock(&self.waiting) = Waiting::default();
        lock(&self.buffers).clear();
        texts::close(self);
    }

    fn daemon(&self) -> Result<&'static Daemon, Fault> {
        let daemon = process::config()?.devices[self.number].as_ref();
        let missing =
            || Fault::argument(format!("device {} is not in PMAC_DEVICES or its file", self.number));
        daemon.ok_or_else(missing)
    }

    /// A new connection to the daemon.
    pub(crate) fn connect(&self) -> Result<Connection, Fault> {
        Ok(match self.daemon()? {
            Daemon::Name(name) => {
                let name = SegmentName::new(name).map_err(|error| Fault::argument(error.to_string()))?;
                Connection::open(&socket_path(&name))?.of_board(&name)?
            }
            Daemon::Socket(path) => Connection::open(path)?,
        })
    }

    /// Calls the daemon. A call that a restarted daemon has not taken is repeated once.
    pub(crate) fn ask<T>(
        &self,
        call: impl FnMut(&mut Connection) -> Result<T, CommandError>,
    ) -> Result<T, Fault> {
        self.ask_while(|| true, call)
    }

    /// As [`Self::ask`], for several calls at once: repeats them only while `may_repeat`.
    pub(crate) fn ask_while<T>(
        &self,
        may_repeat: impl Fn() -> bool,
        mut call: impl FnMut(&mut Connection) -> Result<T, CommandError>,
    ) -> Result<T, Fault> {
        let idle = lock(&self.idle).pop();
        let is_old = idle.is_some();
        let mut connection = match idle {
            Some(connection) => connection,
            None => self.connect()?,
        };
        let mut answer = call(&mut connection);
        if is_old && may_repeat() && matches!(answer, Err(CommandError::NotTaken { .. })) {
            connection = self.connect()?;
            answer = call(&mut connection);
        }
        // A broken connection is dropped: the next call checks the board again.
        if matches!(answer, Ok(_) | Err(CommandError::Refused(_))) {
            lock(&self.idle).push(connection);
        }
        Ok(answer?)
    }

    /// Sends a line, which enters a program buffer only if this process has opened that buffer.
    pub(crate) fn send(&self, line: &str, timeout: Duration) -> Result<Vec<String>, Fault> {
        let before = *lock(&self.own_buffer);
        let mut own = before;
        let sent = self.ask(|connection| own.send(connection, line, timeout));
        if own.is_open() != before.is_open() {
            *lock(&self.own_buffer) = own;
        }
        sent
    }

    /// Sends a control character.
    pub(crate) fn control(&self, character: u8) -> Result<Vec<String>, Fault> {
        let before = *lock(&self.own_buffer);
        let mut own = before;
        let sent = self.ask(|connection| own.control(connection, character));
        if own.is_open() != before.is_open() {
            *lock(&self.own_buffer) = own;
        }
        sent
    }

    /// Whether this process has a program buffer open.
    pub(crate) fn has_open_buffer(&self) -> bool {
        lock(&self.own_buffer).is_open()
    }

    /// Reads the board's data from the segment.
    pub(crate) fn read<T>(&self, work: impl FnOnce(&mut Board) -> Result<T, Fault>) -> Result<T, Fault> {
        let mut board = lock(&self.board);
        let board = match &mut *board {
            Some(board) => board,
            none => none.insert(match self.daemon()? {
                Daemon::Name(name) => Board::attach(name)?,
                Daemon::Socket(path) => Board::at_socket(path)?,
            }),
        };
        work(board)
    }

    /// The replies that wait for `PmacGetLineA`.
    pub(crate) fn waiting(&self) -> MutexGuard<'_, Waiting> {
        lock(&self.waiting)
    }

    /// Keeps the outcome of a line for `PmacGetLineA`.
    pub(crate) fn keep_reply(&self, reply: &Result<Vec<String>, Fault>) {
        self.waiting().keep(reply);
    }

    /// `LockPmac`: the calls of other threads wait until this thread releases the device.
    pub(crate) fn hold(&self) -> Result<(), Fault> {
        let mut holder = self.turn()?;
        let count = holder.map_or(0, |(_, count)| count);
        *holder = Some((this_thread(), count + 1));
        Ok(())
    }

    /// `ReleasePmac`.
    pub(crate) fn release(&self) -> Result<(), Fault> {
        let mut holder = lock(&self.holder);
        match *holder {
            Some((thread, count)) if thread == this_thread() => {
                *holder = (count > 1).then_some((thread, count - 1));
                self.released.notify_all();
                Ok(())
            }
            _ => Err(Fault::argument("ReleasePmac: this thread has not locked the device")),
        }
    }

    /// Waits until no other thread holds the device.
    pub(crate) fn turn(&self) -> Result<MutexGuard<'_, Option<(usize, usize)>>, Fault> {
        let me = this_thread();
        let deadline = Instant::now() + LOCK_WAIT;
        let mut holder = lock(&self.holder);
        while holder.is_some_and(|(thread, _)| thread != me) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(Fault::refused(
                    "another thread has locked the device (LockPmac) for 5 s; nothing was done",
                ));
            }
            holder = self.released.wait_timeout(holder, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        Ok(holder)
    }
}

/// How many devices the configuration names.
pub(crate) fn configured() -> i32 {
    process::config()
        .map_or(0, |config| config.devices.iter().map(|device| i32::from(device.is_some())).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_success_does_not_carry_the_failure_of_the_line_before() {
        let mut waiting = Waiting::default();
        waiting.keep(&Err(Fault::refused("ERR003")));
        assert!(waiting.fault.is_some());
        waiting.keep(&Ok(Vec::new()));
        assert_eq!(waiting.fault, None);
        assert!(waiting.end && waiting.check_lost().is_ok());
    }

    #[test]
    fn lines_that_nobody_fetches_are_lost_with_an_error_and_one_long_reply_is_whole() {
        let mut waiting = Waiting::default();
        let long = vec![String::new(); WAITING_MAX * 2];
        waiting.keep(&Ok(long.clone()));
        assert_eq!((waiting.lines.len(), waiting.has_lost), (long.len(), false));
        waiting.keep(&Ok(vec!["5".to_owned()]));
        assert_eq!(waiting.lines, ["5"]);
        assert_eq!(waiting.check_lost().map_err(|fault| fault.kind), Err(Kind::Uncertain));
        assert!(waiting.check_lost().is_ok());
    }
}
