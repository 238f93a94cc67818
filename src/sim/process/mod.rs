//! The process: options, start, the loop around the board, its end.
//!
//! One thread runs the servo. Between cycles, about once a millisecond, it polls the sockets and never waits for them.

mod clock;
mod from_recording;
mod interrupt;
mod leftovers;
pub mod options;
mod serial;
mod socket;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::format::file_text;
use crate::process::end_with_parent;
use crate::recording::Recording;
use crate::sim::board::Board;
use crate::sim::board::dpram::{Dpram, DpramError};
use crate::sim::board::memory::Memory;
use crate::sim::board::random::Random;
use crate::sim::control::{self, ControlAnswer};
use crate::sim::functions::host_port::HostPort;
use crate::sim::functions::mailbox::Mailbox;
use crate::sim::process::clock::Clock;
use crate::sim::process::interrupt::InterruptLine;
use crate::sim::process::options::{Garbage, NoSuchBoard, Options, UnixPath};
use crate::sim::process::serial::Serial;
use crate::sim::process::socket::{Client, Listener};
use crate::sim::world::{Interrupts, RefusedLine, World};

/// How often sockets are polled.
const SOCKETS_EVERY: Duration = Duration::from_millis(1);
/// Longest command line on the control socket.
const LONGEST_LINE: usize = 4096;
/// Cycles of a `step` between two looks at the signal flag.
const STEP_CHUNK: u64 = 1024;

/// Why the simulator could not start, or ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The memory file cannot be used.
    #[error(transparent)]
    Dpram(#[from] DpramError),
    /// A socket cannot be made.
    #[error("cannot listen at {path}: {source}")]
    Socket {
        /// Where.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The options describe no board.
    #[error(transparent)]
    Board(#[from] NoSuchBoard),
    /// The start-up file cannot be read.
    #[error("cannot read the start-up file {path}: {source}")]
    Startup {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The board refused a line of the start-up file.
    #[error(transparent)]
    StartupLine(#[from] RefusedLine),
    /// Signals or the clock.
    #[error("cannot run: {0}")]
    System(#[from] io::Error),
}

/// Powers up the board that `options` describe and carries out its start-up lines. Opens no socket and starts no clock.
///
/// # Errors
/// [`SimError`]; only the memory file is left behind.
pub fn power_up(options: &Options) -> Result<World, SimError> {
    let startup = match &options.startup {
        Some(path) => {
            let unread = |source| SimError::Startup { path: path.clone(), source };
            let bytes = std::fs::read(path).map_err(unread)?;
            let text = file_text::read(&bytes).map_err(io::Error::other).map_err(unread)?;
            Some((path.display().to_string(), text.into_owned()))
        }
        None => options
            .dpram_startup
            .then(|| ("the shipped start-up file".to_owned(), options.family.startup.to_owned())),
    };
    let identity = options.identity()?;
    let mut dpram = Dpram::open(&options.memory, identity.tables.family.length)?;
    if let Garbage::From(seed) = options.garbage {
        // The DPRAM has no battery, and no manual seen says that PMAC clears it.
        let mut random = Random::new(seed);
        dpram.words().for_each(|offset| dpram.write16(offset, random.word()));
    }
    let memory = Memory::new(dpram, identity.tables);
    let mut board = Board::new(memory, identity, options.fixed_i10(), options.seed);
    if options.saved_enables {
        let i = &board.family().i;
        let panel = i.panel.map(|number| (number, 3.0));
        let others =
            [Some(i.variables_enable), i.rotary_enable].map(|number| number.map(|number| (number, 1.0)));
        for (number, value) in others.into_iter().chain([panel]).flatten() {
            board.variables.set_i(number.into(), value);
        }
        board.save();
    }
    board.rotary_cs_base = options.rotary_cs_base;
    let mut world = World::new(board);
    if let Some(path) = &options.mailbox {
        world.fit_mailbox(Mailbox::open(path, options.dpram_page)?);
    }
    if let Some(path) = &options.host_port {
        world.fit_host_port(HostPort::open(path, options.family.controller)?);
    }
    if let Some((name, text)) = startup {
        world.load(&name, &text)?;
    }
    if let Some(directory) = &options.from {
        let recording = Recording::read(directory).map_err(NoSuchBoard::from)?;
        match &recording.variables {
            Some(text) => from_recording::set(&mut world, text, &recording.accesses),
            None => world.load("the shipped start-up file", world.board.identity.tables.startup)?,
        }
    }
    // The board has been powered up for long: the time of its start-up lines is over.
    world.board.slow = options.slow;
    Ok(world)
}

/// A line-wise client of the control socket.
struct ControlClient {
    client: Client,
    line: Vec<u8>,
}

/// The running simulator.
pub struct Simulator {
    world: World,
    interrupt: Option<InterruptLine>,
    mailbox_taken: Option<InterruptLine>,
    mailbox_response: Option<InterruptLine>,
    serial: Option<Serial>,
    control: Option<Listener>,
    control_clients: Vec<ControlClient>,
    virtual_time: bool,
    /// How many of the board's notes have been told.
    told: usize,
    stop: Arc<AtomicBool>,
    // Last, so that the sockets are gone from the directory.
    _leave: Option<LeaveNothing>,
}

/// Exits with the parent process, and removes the memory and the directory that this process has made for it.
struct LeaveNothing {
    memory: PathBuf,
}

impl LeaveNothing {
    /// Makes the directory. This process arranges its own end first, so that a parent's death leaves no directory.
    fn with(parent: u32, memory: &Path) -> Result<Self, SimError> {
        end_with_parent(parent)?;
        if let Some(directory) = memory.parent() {
            leftovers::make(directory)?;
        }
        Ok(Self { memory: memory.to_owned() })
    }
}

impl Drop for LeaveNothing {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.memory);
        if let Some(directory) = self.memory.parent() {
            let _ = std::fs::remove_dir(directory);
        }
    }
}

impl Simulator {
    /// Powers the board up as `options` say and runs the start-up lines. A signal from then on ends [`Simulator::run`].
    ///
    /// # Errors
    /// [`SimError`]; only the memory file is left behind.
    pub fn new(options: &Options) -> Result<Self, SimError> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        Self::with(options, stop)
    }

    /// As [`Simulator::new`], for a caller with its own clock that calls [`Simulator::step`] and [`Simulator::poll`].
    /// It takes no signals.
    ///
    /// # Errors
    /// [`SimError`]; only the memory file is left behind.
    pub fn stepped(options: &Options) -> Result<Self, SimError> {
        Self::with(options, Arc::default())
    }

    /// The simulated board, for a caller that steps it and reads its state.
    pub const fn board(&mut self) -> &mut World {
        &mut self.world
    }

    fn with(options: &Options, stop: Arc<AtomicBool>) -> Result<Self, SimError> {
        let leave = options.with_parent.map(|pid| LeaveNothing::with(pid, &options.memory)).transpose()?;
        let world = power_up(options)?;
        Ok(Self {
            world,
            interrupt: listen(options.interrupt.as_ref())?.map(InterruptLine::new),
            mailbox_taken: listen(options.mailbox_taken.as_ref())?.map(InterruptLine::new),
            mailbox_response: listen(options.mailbox_response.as_ref())?.map(InterruptLine::new),
            serial: listen(options.serial.as_ref())?.map(Serial::new),
            control: listen(options.control.as_ref())?,
            control_clients: Vec::new(),
            virtual_time: options.virtual_time,
            told: 0,
            stop,
            _leave: leave,
        })
    }

    /// Runs until a signal or `exit`.
    ///
    /// # Errors
    /// When the system has no clock to run by.
    pub fn run(mut self) -> Result<(), SimError> {
        let mut clock = Clock::start().map_err(io::Error::from)?;
        let mut since_sockets = Duration::ZERO;
        while !self.stop.load(Ordering::Relaxed) {
            let period = if self.virtual_time { SOCKETS_EVERY } else { self.period() };
            let late = clock.wait(period).map_err(io::Error::from)?;
            if !self.virtual_time {
                self.world.board.stats.late += late;
                self.step();
            }
            since_sockets += period;
            if since_sockets >= SOCKETS_EVERY {
                since_sockets = Duration::ZERO;
                self.poll();
            }
        }
        Ok(())
    }

    /// How long a servo cycle takes.
    #[must_use]
    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(self.world.board.cycle_ms() / 1000.0)
    }

    /// One servo cycle; sends its interrupts to the hosts.
    pub fn step(&mut self) {
        self.world.step();
        let Interrupts { response, mailbox_taken, mailbox_response } = self.world.take_interrupts();
        raise(response, &mut self.interrupt);
        raise(mailbox_taken, &mut self.mailbox_taken);
        raise(mailbox_response, &mut self.mailbox_response);
    }

    /// Serves the requests that wait on the sockets. Does not wait.
    pub fn poll(&mut self) {
        let lines = [&mut self.interrupt, &mut self.mailbox_taken, &mut self.mailbox_response];
        for line in lines.into_iter().flatten() {
            line.serve();
        }
        if let Some(serial) = &mut self.serial {
            serial.serve(&mut self.world);
        }
        self.transmit();
        self.tell_notes();
        let Some(listener) = &self.control else { return };
        let mut fresh = Vec::new();
        listener.accept(&mut fresh);
        let mut clients = std::mem::take(&mut self.control_clients);
        clients.extend(fresh.into_iter().map(|client| ControlClient { client, line: Vec::new() }));
        for client in &mut clients {
            self.serve_control(client);
        }
        clients.retain(|client| !client.client.gone());
        self.control_clients = clients;
    }

    /// Tells the board's new notes.
    fn tell_notes(&mut self) {
        let notes = &self.world.board.notes;
        for note in &notes[self.told.min(notes.len())..] {
            eprintln!("pmac-sim: {note}");
        }
        self.told = notes.len();
    }

    /// Sends the text that the board has for its serial port.
    fn transmit(&mut self) {
        let output = self.world.take_serial_messages();
        if let Some(serial) = &mut self.serial {
            serial.transmit(&output);
        }
    }

    fn serve_control(&mut self, from: &mut ControlClient) {
        from.client.flush();
        let mut buffer = [0; LONGEST_LINE];
        let bytes = from.client.receive(&mut buffer);
        for &byte in bytes {
            if byte != b'\n' {
                if from.line.len() < LONGEST_LINE {
                    from.line.push(byte);
                }
                continue;
            }
            let line = std::mem::take(&mut from.line);
            let mut answer = self.control_line(&String::from_utf8_lossy(&line));
            answer.push('\n');
            from.client.send(answer.as_bytes());
        }
    }

    /// The answer to a line of the control socket, see [`control`].
    pub fn control_line(&mut self, line: &str) -> String {
        match control::execute(&mut self.world, line, self.virtual_time) {
            ControlAnswer::Line(line) => line,
            ControlAnswer::Step(count) => {
                for done in 0..count {
                    if done % STEP_CHUNK == 0 && self.stop.load(Ordering::Relaxed) {
                        return format!("error: stopped after {done} cycles");
                    }
                    self.step();
                }
                "ok".into()
            }
            ControlAnswer::Exit => {
                self.stop.store(true, Ordering::Relaxed);
                "ok".into()
            }
        }
    }
}

fn raise(raised: u64, line: &mut Option<InterruptLine>) {
    if let Some(line) = line.as_mut().filter(|_| raised > 0) {
        line.raise(raised);
    }
}

fn listen(at: Option<&UnixPath>) -> Result<Option<Listener>, SimError> {
    at.map(UnixPath::path)
        .map(|path: &Path| {
            Listener::bind(path).map_err(|source| SimError::Socket { path: path.to_owned(), source })
        })
        .transpose()
}
