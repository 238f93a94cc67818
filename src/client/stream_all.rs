//! A motion program through a binary rotary buffer, until the board has all of it, in one call.

use std::fmt::Display;
use std::time::{Duration, Instant};

use super::{CommandError, Connection, RotaryFeed, RotaryLine, RotaryPlace, circles};
use crate::map::Family;
use crate::protocol::CallError;
use crate::protocol::board::{RotaryStateReply, RotaryStopReply};
use crate::protocol::calls::LeftLines;
use crate::rotary::{Command, Program, Report, Settings, compile_stream};

/// How often to ask whether the board has taken the rest.
const LOOK: Duration = Duration::from_millis(20);

/// How to stream.
#[derive(Debug, Clone)]
pub struct StreamOptions {
    /// The coordinate system that executes the program, from 1.
    pub coordinate_system: u8,
    /// Define the board's own rotary buffer first, with so many words.
    pub define_longs: Option<u32>,
    /// Start the program when its first lines are there.
    pub run: bool,
    /// What to do with lines that an earlier program has left.
    pub left: Option<LeftLines>,
    /// How long the board may take no lines.
    pub timeout: Duration,
}

/// A program that the board has taken whole.
#[derive(Debug, Clone)]
pub struct Streamed {
    /// Lines.
    pub lines: usize,
    /// Commands in them.
    pub commands: usize,
    /// How often the daemon found the buffer empty though more lines were to follow.
    pub underruns: u64,
    /// Lines that an earlier program had left in the board's rotary buffer.
    pub found_lines: u64,
    /// How the board's program differs from the text, one sentence each.
    pub warnings: Vec<String>,
}

/// Why a program did not go in whole.
#[derive(Debug, thiserror::Error)]
#[error("{said}")]
pub struct StreamError {
    /// The reason, with the place in the program.
    pub said: String,
    /// Its cause.
    #[source]
    pub cause: CommandError,
    /// Whether the stream had begun: the board may have taken a part of the program.
    pub began: bool,
}

impl From<CommandError> for StreamError {
    fn from(cause: CommandError) -> Self {
        Self { said: cause.to_string(), cause, began: false }
    }
}

fn refused(why: impl Display) -> StreamError {
    CommandError::from(CallError::refused(why)).into()
}

/// Why a stream ended before its end.
enum Halt {
    /// The board or the daemon takes no more lines.
    Reason(String),
    /// The caller wants no more.
    Caller,
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

/// Streams `text`, the program called `name`. `owner` begins the stream, `board` answers questions meanwhile. `goes_on`
/// is asked several times a second; when it says no, the stream ends and the result is `None`.
///
/// If an error or the caller ends the stream early, the daemon ends the program, too.
///
/// # Errors
/// [`StreamError`]; its cause is [`CallError::StopFailed`] if the caller ended the stream and the program may run on.
pub fn stream_all(
    (mut owner, mut board): (Connection, Connection),
    (name, text): (&str, &[u8]),
    options: &StreamOptions,
    goes_on: impl FnMut() -> bool,
) -> Result<Option<Streamed>, StreamError> {
    let (settings, buffer) = prepare(&mut board, options)?;
    let (program, modes, mut warnings) = compiled(name, text, &settings)?;
    let circle = |command: &Command| circles::is_circle(&command.text);
    if let Some((line, _)) = program.commands().find(|(_, command)| circle(command)) {
        let place = format_args!("{name}:{line}");
        warnings.extend(circles::warning(&mut board, place, Some(options.coordinate_system.into())));
    }
    let lines: Vec<RotaryLine> = program
        .lines
        .iter()
        .map(|line| line.commands.iter().map(|command| (command.word1, command.word2)).collect())
        .collect();
    let place = RotaryPlace {
        buffer,
        coordinate_system: options.coordinate_system,
        coordinate_system_base: settings.coordinate_system_base,
        define_longs: options.define_longs,
        left: options.left,
        run: options.run,
        may_stand: program.commands().any(|(_, command)| command.text.eq_ignore_ascii_case("STOP")),
        modes,
        ..RotaryPlace::default()
    };
    let found_lines = owner.rotary_start(place)?.found_lines;
    let feed = RotaryFeed::new(owner, buffer, &lines);
    let (timeout, since) = (options.timeout, Instant::now());
    let mut stream = Stream { name, program: &program, feed, board, buffer, timeout, taken: 0, since };
    let fed = stream.feed(goes_on);
    let ended = stream.end(fed).map_err(|error| StreamError { began: true, ..error });
    let Some(underruns) = ended? else { return Ok(None) };
    let commands = lines.iter().map(Vec::len).sum();
    Ok(Some(Streamed { lines: lines.len(), commands, underruns, found_lines, warnings }))
}

/// The format that the board's daemon works by, and the number of the buffer that feeds the coordinate system.
fn prepare(board: &mut Connection, options: &StreamOptions) -> Result<(Settings, u8), StreamError> {
    let told = board.info()?.family;
    let family = Family::by_name(&told).map_err(refused)?;
    let cs = options.coordinate_system;
    if !(1..=family.coordinate_systems).contains(&cs.into()) {
        return Err(refused(format_args!("cs={cs}: the board has 1 to {}", family.coordinate_systems)));
    }
    let of_the_daemon = board.settings()?;
    let mut settings = of_the_daemon.rotary_format().of(family);
    let index = family.rotary.index_for(cs.into());
    let kept = of_the_daemon.plan.rotary_longs(family).get(index).copied().unwrap_or_default();
    let buffer = index as u8 + 1;
    if kept == 0 {
        let cure = "set rotary_longs in its configuration";
        return Err(refused(format_args!("the daemon reserves no room for rotary buffer {buffer}; {cure}")));
    }
    settings.buffer_words = kept.min(settings.buffer_words);
    settings.check().map_err(refused)?;
    Ok((settings, buffer))
}

/// The program in `text`, the modes that go before it, and the compiler's warnings.
fn compiled(
    name: &str,
    text: &[u8],
    settings: &Settings,
) -> Result<(Program, Vec<String>, Vec<String>), StreamError> {
    let (compiled, modes) =
        compile_stream(text, settings).map_err(|found| refused(listing(name, &found.errors).join("\n")))?;
    if compiled.program.lines.is_empty() {
        return Err(refused(format_args!("{name}: no program lines")));
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
    fn feed(&mut self, mut goes_on: impl FnMut() -> bool) -> Result<(), Halt> {
        let mut ask = || if goes_on() { Ok(()) } else { Err(Halt::Caller) };
        while !self.feed.is_done() {
            match self.feed.step()? {
                Some(state) => self.look_at(&state)?,
                None => self.since = Instant::now(),
            }
            ask()?;
        }
        self.feed.finish()?;
        loop {
            self.feed.renew()?;
            let state = self.board.rotary_state(self.buffer)?;
            if state.ahead_commands == 0 {
                return Ok(());
            }
            self.look_at(&state)?;
            ask()?;
            std::thread::sleep(LOOK);
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

    /// Ends the stream, and returns its underruns; `None` if the caller wanted no more. The error of an early end also
    /// tells the lines left in the buffers.
    fn end(&mut self, fed: Result<(), Halt>) -> Result<Option<u64>, StreamError> {
        let stopped = self.feed.stop();
        let reason = match fed {
            Ok(()) => None,
            Err(Halt::Reason(reason)) => Some(reason),
            Err(Halt::Caller) => return self.halted(stopped).map(|()| None),
        };
        let stop = match (stopped, reason.clone()) {
            (Ok(stop), _) => stop,
            (Err(error), None) => return Err(error.into()),
            (Err(error), Some(reason)) => {
                let what = format!("{reason}; what is left in the buffers is not known ({error})");
                return Err(StreamError { said: self.placed(self.feed.inside(), &what), ..error.into() });
            }
        };
        // If the daemon has ended the stream, it knows best why.
        if let Some(reason) = stop.reason.clone().or(reason) {
            let ahead = usize::try_from(stop.ahead_lines).unwrap_or(usize::MAX);
            let (inside, total) = (self.feed.inside(), self.program.lines.len());
            let what = format!("{reason}; {inside} of {total} lines were sent; {}", left(&stop));
            return Err(refused(self.placed(inside.saturating_sub(ahead), &what)));
        }
        if !stop.notes.is_empty() {
            return Err(refused(stop.notes.join("; ")));
        }
        Ok(Some(self.board.rotary_state(self.buffer).unwrap_or_default().underruns))
    }

    /// The caller wanted no more. An error if the program may run on.
    fn halted(&self, stopped: Result<RotaryStopReply, CommandError>) -> Result<(), StreamError> {
        let why = match stopped {
            Ok(stop) if stop.notes.is_empty() => return Ok(()),
            Ok(stop) => stop.notes.join("; "),
            Err(error) => error.to_string(),
        };
        let what = format!("the caller ended the stream, but the program may run on: {why}");
        let reason = self.placed(self.feed.inside(), &what);
        Err(CommandError::from(CallError::StopFailed { reason }).into())
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
            format!("{lines} are left in the board's rotary buffer: the next stream needs clear or continue")
        }
        None => "how many are left in the board's rotary buffer is not known".to_owned(),
    });
    if stop.quit {
        parts.push("the program has been ended".to_owned());
    }
    parts.extend(stop.notes.iter().cloned());
    parts.join("; ")
}
