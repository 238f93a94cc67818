//! `pmacctl rotary stream`: feeds a motion program to the board through a binary rotary buffer, until the board has all
//! lines.
//!
//! The daemon sets up the buffer, watches the program and ends the stream. This module sends the lines and shows the
//! progress.

use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;

use super::source::{Format, NOTHING_TAKEN, circle_warning, compiled_stream};
use crate::cli::args::values::number;
use crate::cli::console::{Interrupt, Progress, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::{Connection, RotaryFeed, RotaryLine, RotaryPlace};
use crate::map::status::reply_has;
use crate::map::{Family, TypedAddress};
use crate::preprocess::shown;
use crate::protocol::board::{RotaryStateReply, RotaryStopReply};
use crate::protocol::calls::LeftLines;
use crate::rotary::Program;

/// Time limit of a command line.
const LINE_PATIENCE: Duration = Duration::from_secs(5);
/// Print a hint after the board has taken no line for this long.
const PUZZLED: Duration = Duration::from_secs(3);
/// Period of the checks whether the board has taken the rest.
const ASK_STATE_EVERY: Duration = Duration::from_millis(20);

/// `rotary stream`.
#[derive(Debug, Args)]
pub struct Stream {
    /// The program's text, constants only; - is stdin
    #[arg(value_name = "FILE")]
    pub file: String,
    /// The coordinate system that executes the program
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = number)]
    pub cs: u8,
    /// PMAC, PMAC2: the buffer in the DPRAM, 1 or 2 [default: 1]. On a Turbo board each coordinate system has its own
    #[arg(long, value_name = "N", value_parser = number)]
    pub buffer: Option<u8>,
    /// The buffer's size in 32-bit words, two a command [default: all that the daemon reserves]
    #[arg(long, value_name = "LONGS")]
    pub size: Option<u32>,
    /// The buffer's start, such as DP:$DC00 [default: the place that the daemon reserves]
    #[arg(long, value_name = "ADDR")]
    pub start: Option<String>,
    /// First define a rotary buffer of this many words in the board's own memory (DEFINE ROT). Start with the highest
    /// coordinate system, and delete any gather buffer before
    #[arg(long, value_name = "LONGS")]
    pub define: Option<u32>,
    /// Start the program (R) as soon as the buffer has its first lines
    #[arg(long)]
    pub run: bool,
    /// Delete lines of an earlier program from the board's rotary buffer (CLEAR)
    #[arg(long)]
    pub clear: bool,
    /// First run lines of an earlier program in the board's rotary buffer
    #[arg(long = "continue", conflicts_with = "clear")]
    pub continue_left: bool,
    /// Give up when the board has taken no line for this time, in seconds. A dwell or a feed hold counts, too
    #[arg(long, value_name = "S", default_value = "60", value_parser = crate::cli::args::values::seconds, allow_negative_numbers = true)]
    pub timeout: Duration,
    #[command(flatten)]
    pub format: Format,
}

pub fn run(context: &mut Context, options: &Stream) -> Result<Verdict, Failure> {
    let mut board = context.connection()?;
    let family = Context::family(None, &mut board)?;
    let start = options.start.as_deref().map(|text| TypedAddress::parse(text, family));
    let start = start.transpose().map_err(|error| Failure::Request(format!("--start: {error}")))?;
    check_system(options.cs, family)?;
    let of_the_daemon = board.settings()?;
    let mut settings = options.format.over(&of_the_daemon.rotary_format().of(family))?;
    // Find a line that can never fit the buffer now, not in the middle of the program.
    let buffer = buffer(options, family)?;
    let kept = of_the_daemon.plan.rotary_longs(family).get(usize::from(buffer) - 1);
    let kept = kept.copied().unwrap_or_default();
    if kept == 0 && options.size.is_none() {
        return Err(Failure::Request(format!(
            "the daemon reserves no room for rotary buffer {buffer}; give --start and --size, or set rotary_longs in its \
             configuration"
        )));
    }
    settings.buffer_words = options.size.unwrap_or_else(|| kept.min(settings.buffer_words));
    settings.check().map_err(|error| Failure::Request(format!("--size: {error}")))?;
    let (program, modes) = compiled_stream(&options.file, &settings)?;
    if program.lines.is_empty() {
        return Err(Failure::Request(format!("{}: no program lines in this file", shown(&options.file))));
    }
    if let Some(warning) = circle_warning(&mut board, &shown(&options.file), &program, options.cs) {
        note(warning);
    }
    let interrupt = Interrupt::listen()?;
    let place = RotaryPlace {
        buffer,
        start: start.map(|address| address.offset),
        size_longs: options.size,
        coordinate_system: options.cs,
        coordinate_system_base: settings.coordinate_system_base,
        define_longs: options.define,
        left: match (options.clear, options.continue_left) {
            (true, _) => Some(LeftLines::Clear),
            (false, true) => Some(LeftLines::Continue),
            (false, false) => None,
        },
        run: options.run,
        may_stand: program.commands().any(|(_, command)| command.text.eq_ignore_ascii_case("STOP")),
        modes,
    };
    let mut streaming = Streaming {
        options,
        buffer,
        family,
        program: &program,
        board,
        progress: Progress::everywhere(context.output.is_quiet()),
        began: Instant::now(),
        patience: Patience::new(options.timeout),
        interrupt,
    };
    let mut owner = context.connection()?;
    let found = owner.rotary_start(place)?.found_lines;
    if found > 0 && !context.output.is_quiet() {
        let fate = if options.clear { "have been deleted" } else { "run first" };
        streaming
            .progress
            .say(&format!("{found} lines were left in &{}'s rotary buffer; they {fate}", options.cs));
    }
    let lines: Vec<RotaryLine> = program
        .lines
        .iter()
        .map(|line| line.commands.iter().map(|command| (command.word1, command.word2)).collect())
        .collect();
    let mut feed = RotaryFeed::new(owner, buffer, &lines);
    streaming.began = Instant::now();
    let fed = streaming.feed(&mut feed);
    let ended = streaming.end(&mut feed, fed);
    streaming.progress.clear();
    let (state, stopped) = ended?;
    let inside = feed.inside();
    let commands: usize = lines.iter().take(inside).map(Vec::len).sum();
    let (underruns, seconds) = (state.underruns, streaming.began.elapsed().as_secs_f64());
    if context.output.is_json() {
        context.output.json(&json!({
            "lines": inside,
            "commands": commands,
            "underruns": underruns,
            "seconds": seconds,
            "ahead_lines": state.ahead_lines,
            "finished": stopped.is_none(),
        }))?;
    } else {
        context.output.line(format_args!(
            "lines={inside} commands={commands} underruns={underruns} seconds={seconds:.3}"
        ))?;
    }
    context.output.flush()?;
    if options.run && stopped.is_none() && !context.output.is_quiet() && streaming.runs() {
        let cs = options.cs;
        streaming.progress.say(&format!(
            "&{cs} still runs its rotary program, and waits for more lines at its end; pmacctl send '&{cs}Q' ends it, \
             for a jog or the next stream"
        ));
    }
    stopped.map_or(Ok(Verdict::Yes), Err)
}

/// The number of the buffer that the stream feeds.
fn buffer(options: &Stream, family: &Family) -> Result<u8, Failure> {
    let (own, buffers) = (own_buffer(family, options.cs), family.rotary.headers.len());
    let buffer = options.buffer.unwrap_or(own);
    if usize::from(buffer) > buffers {
        return Err(Failure::Request(format!("--buffer {buffer}: the board has 1 to {buffers}")));
    }
    if family.rotary.one_a_system && buffer != own {
        return Err(Failure::Request(format!(
            "--buffer {buffer}: on a {} buffer {buffer} is that of coordinate system {buffer}; leave --buffer out",
            family.title
        )));
    }
    Ok(buffer)
}

/// Refuses a coordinate system that the board does not have.
pub(super) fn check_system(cs: u8, family: &Family) -> Result<(), Failure> {
    let count = family.coordinate_systems;
    if usize::from(cs) <= count {
        return Ok(());
    }
    Err(Failure::Request(format!("--cs {cs}: the board has 1 to {count}")))
}

/// The number of the buffer for coordinate system `cs`, unless the user chooses another.
pub(super) fn own_buffer(family: &Family, cs: u8) -> u8 {
    family.rotary.index_for(cs.into()) as u8 + 1
}

/// A running stream.
struct Streaming<'a> {
    options: &'a Stream,
    /// The number of the buffer, from 1.
    buffer: u8,
    family: &'static Family,
    program: &'a Program,
    /// The connection for questions. The feed has its own.
    board: Connection,
    progress: Progress,
    /// When the first line was sent.
    began: Instant,
    patience: Patience,
    interrupt: Interrupt,
}

impl Streaming<'_> {
    /// Whether the coordinate system runs a program. An abort, a kill or an error may have ended it.
    fn runs(&mut self) -> bool {
        let reply = self.board.send(&format!("&{}??", self.options.cs), LINE_PATIENCE).unwrap_or_default();
        let tables = self.family.status.coordinate_system;
        reply.first().is_some_and(|reply| reply_has(reply, tables, "running_program"))
    }

    /// Sends all lines until the end or an error.
    fn feed(&mut self, feed: &mut RotaryFeed<'_>) -> Result<(), Failure> {
        while !feed.is_done() {
            if self.interrupt.came() {
                return Err(Failure::Refused("interrupted".to_owned()));
            }
            let state = match feed.step()? {
                Some(state) => state,
                None if self.progress.is_due() => self.board.rotary_state(self.buffer)?,
                None => {
                    self.patience.reward();
                    continue;
                }
            };
            self.look_at(&state)?;
        }
        feed.finish()?;
        // Wait until the board has taken all lines: it takes none after the end.
        loop {
            feed.renew()?;
            let state = self.board.rotary_state(self.buffer)?;
            if state.ahead_commands == 0 {
                return Ok(());
            }
            if self.interrupt.came() {
                return Err(Failure::Refused("interrupted".to_owned()));
            }
            self.look_at(&state)?;
            std::thread::sleep(ASK_STATE_EVERY);
        }
    }

    /// Shows the progress, and reports a board that takes no more lines.
    fn look_at(&mut self, state: &RotaryStateReply) -> Result<(), Failure> {
        let (sent, total) =
            (usize::try_from(state.sent_lines).unwrap_or(usize::MAX), self.program.lines.len());
        let (ahead, seconds) = (state.ahead_lines, self.began.elapsed().as_secs_f64());
        self.progress.show(|on_terminal| match on_terminal {
            true => bar(sent, total, ahead, seconds),
            false => format!("sent={sent} of={total} ahead={ahead} seconds={seconds:.1}"),
        });
        if let Some(code) = state.error {
            let hint = self.patience.hint();
            return Err(Failure::Refused(format!(
                "the board takes no more: it reports rotary error {code}{hint}"
            )));
        }
        let cs = self.options.cs;
        match self.patience.look(state) {
            Waited::Fine => {}
            Waited::Puzzled => self.progress.say(&format!(
                "the board takes no more lines for now{}; does the program run (&{cs}R), without hold or dwell?",
                if state.busy { ": its own buffer is full" } else { "" }
            )),
            Waited::Over => {
                let seconds = self.options.timeout.as_secs_f64();
                let hint = self.patience.hint();
                return Err(Failure::Refused(format!("the board has taken nothing for {seconds} s{hint}")));
            }
        }
        Ok(())
    }

    /// Ends the stream. An error names the line, and the lines left in the buffers.
    fn end(
        &mut self,
        feed: &mut RotaryFeed<'_>,
        fed: Result<(), Failure>,
    ) -> Result<(RotaryStateReply, Option<Failure>), Failure> {
        let reason = match fed {
            Ok(()) => None,
            Err(Failure::Refused(reason) | Failure::Request(reason)) => Some(reason),
            Err(other) => return Err(other),
        };
        let (stop, state) = match (feed.stop(), reason.clone()) {
            // After a reset the state of the buffer is unknown.
            (Ok(stop), _) => (stop, self.board.rotary_state(self.buffer).unwrap_or_default()),
            (Err(error), None) => return Err(error.into()),
            (Err(error), Some(reason)) => {
                let text = format!("{reason}; what is left in the buffers is not known ({error})");
                return Err(Failure::Refused(self.placed(feed.inside(), &text)));
            }
        };
        // A daemon that has ended the stream knows the reason best.
        let stopped = stop.reason.clone().or(reason).map(|reason| {
            let ahead = usize::try_from(stop.ahead_lines).unwrap_or(usize::MAX);
            let (inside, total, left) = (feed.inside(), self.program.lines.len(), self.left(&stop));
            let text = format!("{reason}; {inside} of {total} lines were sent, {left}");
            Failure::Refused(self.placed(inside.saturating_sub(ahead), &text))
        });
        if stopped.is_none() && !stop.notes.is_empty() {
            return Err(Failure::Refused(stop.notes.join("; ")));
        }
        Ok((state, stopped))
    }

    /// The lines that the end of a stream has left in the buffers.
    fn left(&self, stop: &RotaryStopReply) -> String {
        let cs = self.options.cs;
        let mut text = match stop.ahead_lines {
            0 => "the board has taken all of them".to_owned(),
            ahead => {
                format!("{ahead} of them are still in the DPRAM buffer, and the board takes them no more")
            }
        };
        match stop.left_lines {
            Some(0) => {}
            Some(lines) => {
                text += &format!(
                    "; {lines} are left in &{cs}'s rotary buffer: give the next stream --clear or --continue"
                );
            }
            None => text += &format!("; how many are left in &{cs}'s rotary buffer is not known"),
        }
        if stop.quit {
            text += &format!("; the program has been ended (&{cs}Q)");
        }
        for note in &stop.notes {
            text += "; ";
            text += note;
        }
        text
    }

    /// `FILE:LINE: what`, for the line with this index.
    fn placed(&self, index: usize, what: &str) -> String {
        let name = shown(&self.options.file);
        match self.program.lines.get(index) {
            Some(line) => format!("{name}:{}: {what}", line.line),
            None => format!("{name}: {what}"),
        }
    }
}

/// The width of the bar.
const BAR_CELLS: usize = 30;

fn bar(sent: usize, total: usize, ahead: u64, seconds: f64) -> String {
    let full = (sent * BAR_CELLS).checked_div(total).unwrap_or(BAR_CELLS).min(BAR_CELLS);
    let (done, left) = ("#".repeat(full), "-".repeat(BAR_CELLS - full));
    format!("[{done}{left}] {sent} of {total} lines, {ahead} ahead, {seconds:.1} s")
}

/// Measures the time since the board last took a line.
struct Patience {
    limit: Duration,
    since: Instant,
    taken: u64,
    said: bool,
}

#[derive(Debug, PartialEq, Eq)]
enum Waited {
    Fine,
    /// The board takes longer than usual; reported once.
    Puzzled,
    Over,
}

impl Patience {
    fn new(limit: Duration) -> Self {
        Self { limit, since: Instant::now(), taken: 0, said: false }
    }

    /// A hint for a board that has never taken a line.
    fn hint(&self) -> &'static str {
        if self.taken > 0 {
            return "";
        }
        NOTHING_TAKEN
    }

    /// Restarts the time: the board takes lines.
    fn reward(&mut self) {
        self.since = Instant::now();
        self.said = false;
    }

    fn look(&mut self, state: &RotaryStateReply) -> Waited {
        let taken = state.sent_lines.saturating_sub(state.ahead_lines);
        if taken != self.taken {
            self.taken = taken;
            self.reward();
            return Waited::Fine;
        }
        let waited = self.since.elapsed();
        if waited >= self.limit {
            Waited::Over
        } else if waited >= PUZZLED && !std::mem::replace(&mut self.said, true) {
            Waited::Puzzled
        } else {
            Waited::Fine
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_fills() {
        assert_eq!(bar(0, 10, 0, 0.0), format!("[{}] 0 of 10 lines, 0 ahead, 0.0 s", "-".repeat(30)));
        assert!(
            bar(5, 10, 3, 1.25).starts_with("[###############---------------] 5 of 10 lines, 3 ahead, 1.2")
        );
        assert!(bar(10, 10, 0, 2.0).starts_with(&format!("[{}]", "#".repeat(30))));
        assert!(bar(0, 0, 0, 0.0).starts_with("[##"));
    }
}
