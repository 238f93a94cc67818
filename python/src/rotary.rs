//! A motion program through a binary rotary buffer, until the board has all of it.

use std::fmt::Display;
use std::time::{Duration, Instant};

use pmac_dpram::client::{CommandError, Connection, RotaryFeed, RotaryLine, RotaryPlace, circles};
use pmac_dpram::map::Family;
use pmac_dpram::protocol::board::{RotaryStateReply, RotaryStopReply};
use pmac_dpram::protocol::calls::LeftLines;
use pmac_dpram::rotary::{Program, Report, Settings, compile_stream};
use pyo3::prelude::*;

use crate::errors::{of_command, of_command_saying, refused};

/// How often to ask whether the board has taken the rest.
const LOOK: Duration = Duration::from_millis(20);

/// How to stream.
pub struct Wish {
    /// The coordinate system that executes the program, from 1.
    pub coordinate_system: u8,
    pub define_longs: Option<u32>,
    pub run: bool,
    pub left: Option<LeftLines>,
    /// How long the board may take no lines.
    pub timeout: Duration,
}

/// A program that the board has taken whole.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Streamed {
    /// Lines.
    #[pyo3(get)]
    lines: usize,
    /// Commands in them.
    #[pyo3(get)]
    commands: usize,
    /// How often the daemon found the buffer empty though more lines were to follow.
    #[pyo3(get)]
    underruns: u64,
    /// Lines that an earlier program had left in the board's rotary buffer.
    #[pyo3(get)]
    found_lines: u64,
    /// How the board's program differs from the text, one sentence each.
    #[pyo3(get)]
    warnings: Vec<String>,
}

#[pymethods]
impl Streamed {
    fn __repr__(&self) -> String {
        format!("<Streamed {} lines, {} underruns>", self.lines, self.underruns)
    }
}

/// Why a stream ended before its end.
enum Halt {
    /// The board or the daemon takes no more lines.
    Reason(String),
    /// An exception of Python: a signal's.
    Raised(PyErr),
}

impl From<PyErr> for Halt {
    fn from(error: PyErr) -> Self {
        Self::Raised(error)
    }
}

impl From<CommandError> for Halt {
    fn from(error: CommandError) -> Self {
        Self::Reason(error.to_string())
    }
}

/// A running stream.
struct Stream<'a> {
    name: &'a str,
    program: &'a Program,
    feed: RotaryFeed<'a>,
    /// For questions. The feed has a connection of its own.
    board: Connection,
    buffer: u8,
    timeout: Duration,
    /// How many lines the board has taken, and since when.
    taken: u64,
    since: Instant,
}

/// Streams `text`, the program called `name`. `owner` begins the stream, `board` answers questions meanwhile.
///
/// If an error or a signal ends the stream early, the daemon ends the program, too.
pub fn stream(
    py: Python<'_>,
    mut owner: Connection,
    mut board: Connection,
    name: &str,
    text: &[u8],
    wish: &Wish,
) -> PyResult<Streamed> {
    let (settings, buffer) = py.detach(|| prepare(&mut board, wish))?;
    let (program, modes, mut warnings) = compiled(name, text, &settings)?;
    let circle = |command: &pmac_dpram::rotary::Command| circles::is_circle(&command.text);
    if let Some((line, _)) = program.commands().find(|(_, command)| circle(command)) {
        warnings.extend(py.detach(|| {
            circles::warning(&mut board, format_args!("{name}:{line}"), Some(wish.coordinate_system.into()))
        }));
    }
    let lines: Vec<RotaryLine> = program
        .lines
        .iter()
        .map(|line| line.commands.iter().map(|command| (command.word1, command.word2)).collect())
        .collect();
    let place = RotaryPlace {
        buffer,
        coordinate_system: wish.coordinate_system,
        coordinate_system_base: settings.coordinate_system_base,
        define_longs: wish.define_longs,
        left: wish.left,
        run: wish.run,
        may_stand: program.commands().any(|(_, command)| command.text.eq_ignore_ascii_case("STOP")),
        modes,
        ..RotaryPlace::default()
    };
    let found_lines = py.detach(|| owner.rotary_start(place)).map_err(of_command)?.found_lines;
    let feed = RotaryFeed::new(owner, buffer, &lines);
    let (timeout, since) = (wish.timeout, Instant::now());
    let mut stream = Stream { name, program: &program, feed, board, buffer, timeout, taken: 0, since };
    let fed = stream.feed(py);
    let underruns = stream.end(py, fed)?;
    let commands = lines.iter().map(Vec::len).sum();
    Ok(Streamed { lines: lines.len(), commands, underruns, found_lines, warnings })
}

/// The format that the board's daemon works by, and the number of the buffer that feeds the coordinate system.
fn prepare(board: &mut Connection, wish: &Wish) -> PyResult<(Settings, u8)> {
    let told = board.info().map_err(of_command)?.family;
    let family = Family::by_name(&told).map_err(|error| refused(&error.to_string()))?;
    let cs = wish.coordinate_system;
    if !(1..=family.coordinate_systems).contains(&cs.into()) {
        return Err(refused(&format!("cs={cs}: the board has 1 to {}", family.coordinate_systems)));
    }
    let of_the_daemon = board.settings().map_err(of_command)?;
    let mut settings = of_the_daemon.rotary_format().of(family);
    let index = family.rotary.index_for(cs.into());
    let kept = of_the_daemon.plan.rotary_longs(family).get(index).copied().unwrap_or_default();
    let buffer = index as u8 + 1;
    if kept == 0 {
        let cure = "set rotary_longs in its configuration";
        return Err(refused(&format!("the daemon reserves no room for rotary buffer {buffer}; {cure}")));
    }
    settings.buffer_words = kept.min(settings.buffer_words);
    settings.check().map_err(|error| refused(&error.to_string()))?;
    Ok((settings, buffer))
}

/// The program in `text`, the modes that go before it, and the compiler's warnings.
fn compiled(name: &str, text: &[u8], settings: &Settings) -> PyResult<(Program, Vec<String>, Vec<String>)> {
    let (compiled, modes) =
        compile_stream(text, settings).map_err(|found| refused(&listing(name, &found.errors).join("\n")))?;
    if compiled.program.lines.is_empty() {
        return Err(refused(&format!("{name}: no program lines")));
    }
    Ok((compiled.program, modes, listing(name, &compiled.warnings)))
}

/// Each finding with its place.
fn listing<T: Display>(name: &str, report: &Report<T>) -> Vec<String> {
    let placed = report.listed.iter();
    let mut lines: Vec<String> =
        placed.map(|found| format!("{name}:{}:{}: {}", found.line, found.column, found.what)).collect();
    if report.more > 0 {
        lines.push(format!("{name}: and {} more", report.more));
    }
    lines
}

impl Stream<'_> {
    /// Sends all lines, and waits until the board has taken them.
    fn feed(&mut self, py: Python<'_>) -> Result<(), Halt> {
        while !self.feed.is_done() {
            match py.detach(|| self.feed.step())? {
                Some(state) => self.look_at(&state)?,
                None => self.since = Instant::now(),
            }
            py.check_signals()?;
        }
        py.detach(|| self.feed.finish())?;
        loop {
            let look = || -> Result<_, CommandError> {
                self.feed.renew()?;
                self.board.rotary_state(self.buffer)
            };
            let state = py.detach(look)?;
            if state.ahead_commands == 0 {
                return Ok(());
            }
            self.look_at(&state)?;
            py.check_signals()?;
            py.detach(|| std::thread::sleep(LOOK));
        }
    }

    /// A board that takes no more lines is an error.
    fn look_at(&mut self, state: &RotaryStateReply) -> Result<(), Halt> {
        if let Some(code) = state.error {
            return Err(Halt::Reason(format!("the board takes no more: it reports rotary error {code}")));
        }
        let taken = state.sent_lines.saturating_sub(state.ahead_lines);
        if taken != self.taken {
            (self.taken, self.since) = (taken, Instant::now());
        }
        if self.since.elapsed() < self.timeout {
            return Ok(());
        }
        let seconds = self.timeout.as_secs_f64();
        let hint = "does the program run, without hold or dwell?";
        Err(Halt::Reason(format!("the board has taken nothing for {seconds} s; {hint}")))
    }

    /// Ends the stream, and returns its underruns. The error of an early end also tells the lines left in the buffers.
    fn end(&mut self, py: Python<'_>, fed: Result<(), Halt>) -> PyResult<u64> {
        let stopped = py.detach(|| self.feed.stop());
        let reason = match fed {
            Ok(()) => None,
            Err(Halt::Reason(reason)) => Some(reason),
            Err(Halt::Raised(error)) => return Err(error),
        };
        let stop = match (stopped, reason.clone()) {
            (Ok(stop), _) => stop,
            (Err(error), None) => return Err(of_command(error)),
            (Err(error), Some(reason)) => {
                let what = format!("{reason}; what is left in the buffers is not known ({error})");
                return Err(of_command_saying(error, &self.placed(self.feed.inside(), &what)));
            }
        };
        // If the daemon has ended the stream, it knows best why.
        if let Some(reason) = stop.reason.clone().or(reason) {
            let ahead = usize::try_from(stop.ahead_lines).unwrap_or(usize::MAX);
            let (inside, total) = (self.feed.inside(), self.program.lines.len());
            let what = format!("{reason}; {inside} of {total} lines were sent; {}", left(&stop));
            return Err(refused(&self.placed(inside.saturating_sub(ahead), &what)));
        }
        if !stop.notes.is_empty() {
            return Err(refused(&stop.notes.join("; ")));
        }
        Ok(py.detach(|| self.board.rotary_state(self.buffer)).unwrap_or_default().underruns)
    }

    /// `NAME:LINE: what`, for the line with this index.
    fn placed(&self, index: usize, what: &str) -> String {
        match self.program.lines.get(index) {
            Some(line) => format!("{}:{}: {what}", self.name, line.line),
            None => format!("{}: {what}", self.name),
        }
    }
}

/// The lines that a stream's end has left in the buffers, in words.
fn left(stop: &RotaryStopReply) -> String {
    let mut parts = vec![format!(
        "{} of them are still in the DPRAM buffer, and the board takes them no more",
        stop.ahead_lines
    )];
    parts.push(match stop.left_lines {
        Some(lines) => {
            format!("{lines} are left in the board's rotary buffer: the next stream needs clear or continue_")
        }
        None => "how many are left in the board's rotary buffer is not known".to_owned(),
    });
    if stop.quit {
        parts.push("the program has been ended".to_owned());
    }
    parts.extend(stop.notes.iter().cloned());
    parts.join("; ")
}
