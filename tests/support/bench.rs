//! A command socket on a test's own bus thread, which answers from the queues alone.

use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, poll};
use pmac_dpram::daemon::shared::info::Info;
use pmac_dpram::daemon::shared::job::Job;
use pmac_dpram::daemon::shared::open_buffer::Writer;
use pmac_dpram::daemon::shared::queue::{
    Command, Event, Outcome, READ_MAX, Receive, Sender, Text, Ticket, Unsolicited, queue,
};
use pmac_dpram::daemon::shared::status::BoardStatus;
use pmac_dpram::daemon::socket::options::ServeOptions;
use pmac_dpram::daemon::socket::server::{Backend, Server, serve};
use pmac_dpram::map::PMAC;
use pmac_dpram::protocol::{BoardInfo, BoardSettings, CommandPort, Enabled, MessageKind, State};

use super::wait_until;

/// A running server in its own directory, with its bus thread.
pub struct Bench {
    pub socket: PathBuf,
    /// What the bus thread received, in order: a line, `^K`, or `read 0x0024 2`.
    pub seen: Arc<Mutex<Vec<String>>>,
    /// Sends events to the socket directly, not through the bus thread.
    pub events: Sender<Event>,
    server: Option<Server>,
    bus: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
    _directory: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Self {
        Self::with(|_| {})
    }

    /// With the default settings, changed by `change`.
    pub fn with(change: impl FnOnce(&mut ServeOptions)) -> Self {
        Self::of(change, |_| {})
    }

    /// With the default settings and a board called `name`, changed by `change`.
    pub fn called(name: &str, change: impl FnOnce(&mut BoardInfo)) -> Self {
        let named = |board: &mut BoardInfo| {
            (board.name, board.segment) = (name.to_owned(), format!("/{name}"));
            change(board);
        };
        Self::of(|_| {}, named)
    }

    /// With the default settings and board, both changed.
    pub fn of(change: impl FnOnce(&mut ServeOptions), change_board: impl FnOnce(&mut BoardInfo)) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let socket = directory.path().join("pmac0.sock");
        let mut options = ServeOptions::new(socket.clone());
        change(&mut options);
        let mut board = BoardInfo {
            name: "pmac0".to_owned(),
            version: "0.1.0".to_owned(),
            board: "file:/dev/shm/x".to_owned(),
            family: "pmac".to_owned(),
            firmware: Some("1.16D".to_owned()),
            board_type: Some("PMAC1".to_owned()),
            motors: 8,
            servo_period_ns: Some(442_713),
            generation: 3,
            pid: std::process::id(),
            segment: "/pmac0".to_owned(),
            ..BoardInfo::default()
        };
        change_board(&mut board);
        let info = Info::new(&PMAC, board, BoardSettings::default());
        let (commands, bus_commands) = queue(8).unwrap();
        let (events, socket_events) = queue(4096).unwrap();
        let listener = options.listen().unwrap();
        let backend =
            Backend { commands, events: socket_events, info, trace: pmac_dpram::device::Trace::new(0) };
        let server = serve(&options, listener, backend).unwrap();
        let seen = Arc::new(Mutex::new(Vec::new()));
        let stop = Arc::new(AtomicBool::new(false));
        let bus = FakeBus {
            commands: bus_commands,
            events: events.clone(),
            seen: Arc::clone(&seen),
            stop: Arc::clone(&stop),
            held: Vec::new(),
            servo_counter: 0,
        };
        let bus = Some(std::thread::spawn(move || bus.run()));
        let bench = Self { socket, seen, events, server: Some(server), bus, stop, _directory: directory };
        bench.report(Self::live());
        bench
    }

    /// The status of a board that answers.
    pub fn live() -> BoardStatus {
        BoardStatus { state: State::Live, enabled: Enabled::SERVO | Enabled::ASCII, ..BoardStatus::default() }
    }

    /// Has the bus thread report `status`, which every later call then sees.
    pub fn report(&self, status: BoardStatus) {
        assert!(self.events.try_send(Event::Info(status)).is_ok());
    }

    pub fn stop_server(&mut self) {
        let _ = self.server.take().unwrap().stop();
    }

    /// What the bus thread has received so far: lines, and functions as text.
    pub fn seen(&self) -> Vec<String> {
        self.seen.lock().unwrap().clone()
    }

    /// Waits until the bus thread has received `line`.
    pub fn wait_seen(&self, line: &str) {
        wait_until(&format!("the bus thread to see {line:?}"), || {
            self.seen().iter().any(|seen| seen == line)
        });
    }

    pub fn unsolicited(&self, text: &str) {
        let text = Text::new(text.as_bytes()).unwrap();
        let event = Event::Unsolicited(Unsolicited { time_ns: 42, kind: MessageKind::Send, text });
        let _ = self.events.try_send(event);
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        // Stop the bus thread first: the server's end asks it to stop what is held, but takes no answers any more.
        self.stop.store(true, Ordering::SeqCst);
        self.server.take();
        let bus = self.bus.take().unwrap().join();
        if !std::thread::panicking() {
            bus.unwrap();
        }
    }
}

/// A path without a socket.
pub fn no_socket() -> &'static Path {
    Path::new("/nonexistent/pmac0.sock")
}

/// The control character that has the lines called `HOLD` answered.
pub const RELEASE: u8 = 7;

struct FakeBus {
    commands: Receive<Command>,
    events: Sender<Event>,
    seen: Arc<Mutex<Vec<String>>>,
    stop: Arc<AtomicBool>,
    /// Lines to answer when [`RELEASE`] comes, the last one first.
    held: Vec<(Ticket, String)>,
    servo_counter: u32,
}

impl FakeBus {
    fn run(mut self) {
        while !self.stop.load(Ordering::Relaxed) {
            poll(&mut [PollFd::new(self.commands.descriptor().as_fd(), PollFlags::POLLIN)], 20u16).unwrap();
            self.commands.clear();
            while let Some(command) = self.commands.try_receive() {
                self.answer(command);
            }
        }
    }

    fn say(&self, event: Event) {
        let taken = self.events.try_send(event).is_ok() || self.stop.load(Ordering::SeqCst);
        assert!(taken, "the socket's thread does not empty its queue");
    }

    /// Like the real bus thread: a line wakes nobody, and a full queue is tried again.
    fn line(&self, ticket: Ticket, text: &str) {
        let mut left = Some(Event::Line(ticket, Text::new(text.as_bytes()).unwrap()));
        wait_until("room in the queue", || {
            left = left.take().and_then(|event| self.events.try_put(event).err());
            left.is_none()
        });
    }

    fn done(&self, ticket: Ticket, outcome: Outcome) {
        self.say(Event::Done(ticket, outcome));
    }

    fn answer(&mut self, command: Command) {
        match command {
            Command::Job { ticket, job, .. } => {
                self.seen.lock().unwrap().push(format!("{job:?}"));
                match *job {
                    Job::WatchVariables(_) => self.say(Event::Watching(ticket, 1)),
                    _ => self.done(ticket, Outcome::Done),
                }
            }
            // A sequence's own question, whether the board was reset, is no business of the tests.
            Command::Send { ticket, line, writer: Writer::Question | Writer::Sequence { .. }, .. }
                if line.as_bytes() == b"RX$0" =>
            {
                self.servo_counter += 1;
                self.line(ticket, &self.servo_counter.to_string());
                self.done(ticket, Outcome::Done);
            }
            Command::Send { ticket, line, .. } | Command::First { ticket, line, .. } => {
                let line = String::from_utf8(line.as_bytes().to_vec()).unwrap();
                self.seen.lock().unwrap().push(line.clone());
                match line.as_str() {
                    "SILENT" => {}
                    "HALF" => self.line(ticket, "half"),
                    "I2" => {
                        self.line(
                            ticket,
                            if self.seen.lock().unwrap().contains(&"I2=3".to_owned()) { "3" } else { "1" },
                        );
                        self.done(ticket, Outcome::Done);
                    }
                    // After the line SLOW, the address is told when RELEASE comes.
                    "#" if self.seen.lock().unwrap().contains(&"SLOW".to_owned()) => {
                        self.held.push((ticket, "5".to_owned()));
                    }
                    "#2HM#5" => self.done(ticket, Outcome::Error(3)),
                    "J+" => self.done(ticket, Outcome::Done),
                    "BAD" => {
                        self.line(ticket, "before");
                        self.done(ticket, Outcome::Error(3));
                    }
                    "LATE" | "P404=1" => self.done(ticket, Outcome::TimedOut),
                    "PART" => {
                        self.line(ticket, "a part of it");
                        self.done(ticket, Outcome::TimedOut);
                    }
                    "P1 P404 P500" => {
                        (0..3).for_each(|_| self.line(ticket, "0"));
                        self.done(ticket, Outcome::Done);
                    }
                    "OFF" => self.done(ticket, Outcome::Unavailable { port: CommandPort::Dpram, page: None }),
                    "LONG" => {
                        for _ in 0..2000 {
                            self.line(ticket, &"x".repeat(200));
                        }
                        self.done(ticket, Outcome::Done);
                    }
                    held if held.starts_with("HOLD") => {
                        self.line(ticket, "first of two");
                        self.held.push((ticket, line));
                    }
                    _ => {
                        for part in line.split(',') {
                            self.line(ticket, part);
                        }
                        self.done(ticket, Outcome::Done);
                    }
                }
            }
            Command::Control { ticket, character, .. } => {
                let name = pmac_dpram::protocol::control::name(character);
                self.seen.lock().unwrap().push(name);
                if character == RELEASE {
                    for (ticket, line) in std::mem::take(&mut self.held).into_iter().rev() {
                        self.line(ticket, &line);
                        self.done(ticket, Outcome::Done);
                    }
                }
                self.done(ticket, Outcome::Done);
            }
            Command::ReadWords { ticket, first, count } => {
                self.seen.lock().unwrap().push(format!("read {first} {count}"));
                if first.bytes() as usize + 2 * count > 0x4000 {
                    return self.done(ticket, Outcome::OutOfRange);
                }
                let mut words = [0; READ_MAX];
                for (index, word) in words[..count].iter_mut().enumerate() {
                    *word = u16::try_from(first.word() + index).unwrap();
                }
                self.say(Event::Words { ticket, time_ns: 7, words, count });
            }
        }
    }
}
