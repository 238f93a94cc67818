//! A rotary stream: first finds out which lines lie in the board's rotary buffer, then sets up the stream, and ends it
//! without a half-fed program running.
//!
//! `OPEN BINARY ROTARY` lets the binary lines in and no text, so that other clients go on meanwhile (Software Reference
//! p. 271). A board that answers it with an error gets `OPEN ROT`. While `OPEN ROT` is in force every line such as
//! `I57=1` is a program statement, and B0 an axis move, so it comes last. The header of the buffer must not change
//! under a transfer, so I57 is 0 meanwhile; Turbo boards have no I57, so the rotary buffers must be closed then. After
//! `CLOSE` the board takes nothing more from the DPRAM.
//!
//! ABS, INC and FRAX before the first move go as on-line lines behind B0, which the board refuses while a program runs. They are modal
//! in the coordinate system: nothing puts them back.
//!
//! Streams into different buffers and coordinate systems go beside each other. The first stream opens the rotary buffers
//! and switches the transfer on, the last stream undoes both. A stream that begins beside others first marks its header
//! as not in use, and sets the header up when the board has answered a line. A stream that ends beside others marks its
//! header so, too, if lines are left.
//!
//! Lines that an abort or an early end has left in the board's own rotary buffer would run before those of the next
//! stream: `PR` counts them (Turbo Software Reference p. 286). `CLEAR` takes them away, after `OPEN ROT` and for the
//! coordinate system addressed. Lines that have not left the DPRAM never run: the set-up empties that buffer.
//!
//! A stream that ends before its program is whole in the board, whatever the reason, ends the program too, if it runs:
//! with `Q`, after the moves already calculated (Software Reference, Q). Otherwise a machine would go on to the
//! position of the last line that came through. In a feed hold those moves wait for `R` ("much like a %0 command",
//! Software Reference p. 172), and the program with them: so the daemon asks the board whether the program has ended.
//! The message then is also right for a board whose `Q` ends a held program.
//!
//! A `CLOSE` by any sender, and a reset, close the rotary buffers, too. `???` tells whether they are open for text, or
//! for binary lines (Software Reference p. 271, Turbo Software Reference p. 290).

mod call;
mod count;
mod end;
mod entry;

use std::time::{Duration, Instant};

pub use self::call::RotaryCall;
use self::count::Count;
pub use self::count::lines_left;
use self::entry::Enters;
pub use self::entry::Entry;
use super::script::{Io, Script};
use super::{Done, Request, Resource};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Outcome;
use crate::function::rotary::RotaryState;
use crate::map::functions::{OPEN_BINARY, OPEN_TEXT, rotary_header};
use crate::map::masks::Systems;
use crate::map::status::reply_has;
use crate::protocol::board::RotaryStartReply;
use crate::protocol::calls::LeftLines;
use crate::protocol::{CallError, Reply};

/// How often to look for the first lines, before which the program cannot begin.
const FIRST_LINES: Duration = Duration::from_millis(20);
/// How long the owner, after its last line, waits until `R` has gone.
const FINISH_WAITS: Duration = Duration::from_secs(1);
/// The greatest age of a report that tells which programs run.
const REPORTED: Duration = Duration::from_secs(1);
/// The hint for a board that refuses to open the rotary buffers.
const STILL_OPEN: &str = "; is a program buffer open, or are the rotary buffers (CLOSE closes them)?";
/// How often to check whether the program still runs.
const PROGRAM_LOOK: Duration = Duration::from_millis(500);
/// ^C, which asks for the status of eight coordinate systems, whatever buffer is open.
const ALL_STATUS: u8 = 3;
const ALL_SYSTEMS: usize = 8;
/// How often to look whether another stream has opened or closed the rotary buffers, and for how long.
const ENTRY_LOOK: Duration = Duration::from_millis(20);
const ENTRY_PATIENCE: Duration = Duration::from_secs(10);
/// Words of a header.
const HEADER_WORDS: usize = rotary_header::START + 1;

/// The state of a stream.
struct Rotary<'a> {
    io: Io,
    call: &'a RotaryCall,
    entry: &'a Entry,
    /// How the stream came in; `None` until then.
    enters: Option<Enters>,
    /// Lines in the board's own buffer before the stream.
    found: u64,
    /// The lines that the board has taken.
    count: Count,
    /// The daemon has switched the transfer, opened the rotary buffers, set up the DPRAM's buffer.
    switched: bool,
    opened: bool,
    set_up: bool,
    /// The board takes only `OPEN ROT`.
    opens_text: bool,
    /// The board has told that the rotary buffers are open.
    seen_open: bool,
    /// The owner has heard that lines can come.
    started: bool,
    /// The daemon has sent `R`, or the board has shown the program running.
    runs: bool,
    /// When the daemon sent `R`.
    run_sent: Option<Instant>,
    /// The owner has said that the program is complete, and waits for the answer until then.
    answer_by: Option<Instant>,
    finished: bool,
    failure: Option<CallError>,
    /// Lines in the DPRAM that the board has not taken, and in its own buffer, at the end.
    ahead: u64,
    left: Option<u64>,
    quit: bool,
    notes: Vec<String>,
}

/// The script of a stream, which shares `entry` with the other streams.
pub fn rotary(call: RotaryCall, entry: Entry) -> Script {
    let (resource, cs) = (Resource::Rotary(call.buffer), call.coordinate_system);
    let script = Script::new(resource, "rotary stream", move |io| async move {
        let mut stream = Rotary::new(io.clone(), &call, &entry);
        stream.failure = io.until_ended(stream.run()).await;
        stream.end().await
    });
    script.feeding(Systems::of(cs.into()))
}

impl<'a> Rotary<'a> {
    fn new(io: Io, call: &'a RotaryCall, entry: &'a Entry) -> Self {
        Self {
            io,
            call,
            entry,
            enters: None,
            found: 0,
            count: Count::default(),
            switched: false,
            opened: false,
            set_up: false,
            opens_text: false,
            seen_open: false,
            started: false,
            runs: false,
            run_sent: None,
            answer_by: None,
            finished: false,
            failure: None,
            ahead: 0,
            left: None,
            quit: false,
            notes: Vec::new(),
        }
    }

    /// Sets the stream up, and feeds it.
    ///
    /// # Errors
    /// Why the stream ends.
    async fn run(&mut self) -> Result<(), CallError> {
        self.enter().await?;
        self.see_what_is_left().await?;
        match self.is_beside() {
            true => self.join().await?,
            false => self.disable().await?,
        }
        if self.found > 0 && self.call.left == Some(LeftLines::Clear) {
            self.clear().await?;
        }
        self.set_up().await?;
        if !self.is_beside() {
            self.open().await?;
            self.entry.opened(self.opens_text);
        }
        let reply = RotaryStartReply { found_lines: self.found };
        self.io.answer(Reply::with(&reply)).await;
        self.started = true;
        self.feed().await
    }

    /// Waits until no other stream opens or closes the rotary buffers.
    async fn enter(&mut self) -> Result<(), CallError> {
        let by = self.io.now() + ENTRY_PATIENCE;
        loop {
            match self.entry.enter() {
                Enters::Later if self.io.now() < by => self.io.rest(ENTRY_LOOK).await,
                Enters::Later => {
                    return Err(CallError::refused(
                        "another rotary stream opens or closes the rotary buffers; nothing was sent, try again in a few seconds",
                    ));
                }
                Enters::Text => {
                    return Err(CallError::refused(
                        "the board takes OPEN ROT alone, and another stream has that in force: the set-up of a second stream would \
                         become program lines; nothing was sent, try again when the other stream is over",
                    ));
                }
                enters => {
                    self.enters = Some(enters);
                    if self.is_beside() {
                        // The last stream closes and switches off, even if the board refuses its set-up.
                        (self.opened, self.switched, self.seen_open) = (true, self.has_switch(), true);
                    }
                    return Ok(());
                }
            }
        }
    }

    /// Whether other streams had the rotary buffers open before this one.
    fn is_beside(&self) -> bool {
        self.enters == Some(Enters::Beside)
    }

    /// Begins beside other streams: the header is not in use until the set-up.
    async fn join(&mut self) -> Result<(), CallError> {
        let open = self.io.ask("???").await.result?;
        self.see_open(self.is_open(&open))?;
        self.io.job(Job::RotaryClose(self.call.buffer)).await.result.map(drop)
    }

    /// Finds out which lines the board's own rotary buffer holds; defines the buffer first if the call asks for that.
    async fn see_what_is_left(&mut self) -> Result<(), CallError> {
        let cs = self.call.coordinate_system;
        if let Some(longs) = self.call.define {
            let hint = format!(
                "; is one defined already (leave --define out, or take it away: pmacctl send '&{cs}DELETE ROT'), one for a \
                 lower coordinate system, or a gather buffer (DELETE GATHER)?"
            );
            self.send(&format!("&{cs}DEFINE ROT {longs}"), &hint).await?;
        }
        let has_one = "; has the coordinate system a rotary buffer (--define LONGS)?";
        self.found = self.lines_left(has_one).await?;
        self.count.kept = self.found;
        if self.found > 0 {
            let header =
                self.io.request(Request::Read { first: self.call.header, count: HEADER_WORDS }).await;
            self.decide_on_left(&header.words)?;
        }
        Ok(())
    }

    /// Ends the transfer; if no I-variable ends it, checks that the rotary buffers are closed.
    async fn disable(&mut self) -> Result<(), CallError> {
        if self.has_switch() {
            let sent = self.io.line(&self.switch(0)).await;
            self.switched = !sent.outcome.is_unsent();
            return sent.result.map(drop);
        }
        if self.is_open(&self.io.ask("???").await.result?) == Some(true) {
            return Err(CallError::refused(
                "the rotary buffers are open for binary lines, by another host or by a pmacd that was killed: the board would \
                 read the buffer while it is set up; CLOSE by an engineer closes them",
            ));
        }
        Ok(())
    }

    /// Clears the lines left in the board's own rotary buffer.
    async fn clear(&mut self) -> Result<(), CallError> {
        let cs = self.call.coordinate_system;
        if self.is_beside() {
            return Err(CallError::refused(format!(
                "{} lines are left in &{cs}'s rotary buffer, and the CLOSE behind CLEAR would end the other rotary streams; try \
                 again when they are over",
                self.found
            )));
        }
        self.send_open(OPEN_TEXT).await?;
        let busy = format!("; does a program still run in the coordinate system (pmacctl send '&{cs}Q')?");
        self.send(&format!("&{cs}CLEAR"), &busy).await?;
        self.send("CLOSE", "").await?;
        self.opened = false;
        match self.lines_left("").await? {
            0 => {
                self.count.kept = 0;
                Ok(())
            }
            left => {
                Err(CallError::refused(format!("{left} lines are left in &{cs}'s rotary buffer after CLEAR")))
            }
        }
    }

    /// Points to the rotary program, sends the modes, and empties the DPRAM's buffer.
    async fn set_up(&mut self) -> Result<(), CallError> {
        let cs = self.call.coordinate_system;
        let runs = format!(
            "; does a program run in the coordinate system (one that waits for more lines ends by: pmacctl send '&{cs}Q')?"
        );
        self.send(&format!("&{cs}B0"), &runs).await?;
        for mode in &self.call.modes {
            self.send(&format!("&{cs}{mode}"), "").await?;
        }
        let set_up = self.io.job(self.call.setup.clone()).await;
        self.set_up = !set_up.outcome.is_unsent();
        set_up.result?;
        if self.has_switch() && !self.is_beside() {
            self.io.line(&self.switch(1)).await.result?;
        }
        Ok(())
    }

    /// Opens the rotary buffers for binary lines; for text if the board answers that with an error.
    async fn open(&mut self) -> Result<(), CallError> {
        let opened = self.io.line(OPEN_BINARY).await;
        self.opened = !opened.outcome.is_unsent();
        self.opens_text = matches!(opened.outcome, Outcome::Error(_));
        match self.opens_text {
            true => self.send_open(OPEN_TEXT).await,
            false => told(opened, OPEN_BINARY, "").map(drop),
        }
    }

    async fn send_open(&mut self, text: &str) -> Result<(), CallError> {
        let opened = self.io.line(text).await;
        self.opened = !opened.outcome.is_unsent();
        told(opened, text, STILL_OPEN).map(drop)
    }

    /// Follows the board while lines come, and ends the owner's wait after its last line.
    async fn feed(&mut self) -> Result<(), CallError> {
        loop {
            if self.io.take_asked() {
                self.answer_by = Some(self.io.now() + FINISH_WAITS);
            }
            if self.answer_by.is_some() && !self.finished {
                self.io.job(Job::RotaryFinish(self.call.buffer)).await.result?;
                self.finished = true;
            }
            if self.answer_by.is_some() && !self.waits_for_run() {
                self.io.answer(Ok(Reply::done())).await;
                self.answer_by = None;
                continue;
            }
            let pause = self.look().await?;
            if self.answer_by.is_none() || self.waits_for_run() {
                self.io.rest(pause).await;
            }
        }
    }

    /// Whether the owner, having sent all lines, gets its answer only after `R` has gone: the owner may end the stream
    /// then.
    fn waits_for_run(&self) -> bool {
        self.call.run && !self.runs && self.answer_by.is_some_and(|by| self.io.now() < by)
    }

    /// Checks once whether to begin the program, and whether it still runs. Returns how long to rest before the next
    /// check.
    async fn look(&mut self) -> Result<Duration, CallError> {
        let fed = self.io.job(Job::RotaryState(self.call.buffer)).await;
        fed.result.map_err(|error| CallError::refused(format!("{error}; was the board reset?")))?;
        self.see(fed.rotary);
        match fed.programs_run {
            _ if self.call.run && !self.runs => {
                if !self.count.has_lines() {
                    return Ok(FIRST_LINES);
                }
                self.begin_program().await?;
                return Ok(PROGRAM_LOOK);
            }
            // A line with an address would change the address of other senders.
            Some(systems) if !self.asks_all() => {
                let runs = systems.contains(self.call.coordinate_system.into());
                if runs || self.run_sent.is_none_or(|sent| self.io.now() >= sent + REPORTED) {
                    self.see_runs(runs)?;
                }
            }
            _ => {
                // A board that does not answer says nothing of its program.
                if let Some(runs) = self.ask_runs().await {
                    self.see_runs(runs)?;
                }
            }
        }
        let open = self.io.ask("???").await.result;
        self.see_open(open.ok().and_then(|lines| self.is_open(&lines)))?;
        Ok(PROGRAM_LOOK)
    }

    /// Counts the lines that will run, and sends `R`.
    async fn begin_program(&mut self) -> Result<(), CallError> {
        let cs = self.call.coordinate_system;
        self.count.told = Some(self.lines_left("").await?);
        let counted = self.count;
        let fed = self.io.job(Job::RotaryState(self.call.buffer)).await;
        fed.result?;
        self.see(fed.rotary);
        if let Some(doubt) = self.count.doubt(counted, cs) {
            return Err(CallError::refused(format!("{doubt}; R was not sent")));
        }
        let text = format!("&{cs}R");
        let sent = self.io.line(&text).await;
        // If the board may have carried out `R`, the end sends `Q`.
        self.runs = !sent.outcome.is_unsent() && !matches!(sent.outcome, Outcome::Error(_));
        self.run_sent = Some(self.io.now());
        told(sent, &text, "").map(drop)
    }

    /// Whether the coordinate system runs a program, as far as the board tells.
    async fn ask_runs(&self) -> Option<bool> {
        let cs = self.call.coordinate_system;
        let (done, index) = match self.asks_all() {
            true => (self.io.request(Request::Control(ALL_STATUS)).await, usize::from(cs) - 1),
            false => (self.io.line(&format!("&{cs}??")).await, 0),
        };
        self.is_running(&done.result.ok()?, index)
    }

    /// Sends a line, and returns the board's reply; the board's error, with `hint`, if the board refused the line.
    async fn send(&self, text: &str, hint: &str) -> Result<Vec<String>, CallError> {
        told(self.io.line(text).await, text, hint)
    }

    /// How many lines the board's own rotary buffer holds.
    async fn lines_left(&self, hint: &str) -> Result<u64, CallError> {
        lines_left(&self.send(&format!("&{}PR", self.call.coordinate_system), hint).await?)
    }

    fn switch(&self, value: u8) -> String {
        format!("I{}={value}", self.call.family.i.rotary_enable.unwrap_or_default())
    }

    /// Takes in the board's progress. After a reset the last progress counts.
    fn see(&mut self, state: Option<RotaryState>) {
        if let Some(state) = state {
            self.ahead = state.ahead_lines;
            self.count.see(state);
        }
    }

    /// Whether an I-variable switches the transfer.
    fn has_switch(&self) -> bool {
        self.call.family.i.rotary_enable.is_some()
    }

    /// Whether the rotary buffers are open, as the board's reply to `???` says.
    fn is_open(&self, reply: &[String]) -> Option<bool> {
        let flag = if self.opens_text { "rotary_buffer_open" } else { "binary_rotary_buffer_open" };
        reply.first().map(|status| reply_has(status, self.call.family.status.global, flag))
    }

    /// Takes in whether the board runs the program.
    ///
    /// # Errors
    /// The program no longer runs.
    fn see_runs(&mut self, runs: bool) -> Result<(), CallError> {
        if self.runs && !runs && !self.call.may_stand {
            self.runs = false;
            let by = self.io.ended_by();
            let by = by.as_deref().unwrap_or(
                "an error, the serial port, another host or a program of the board ended it; no client of pmacd did",
            );
            let cs = self.call.coordinate_system;
            return Err(CallError::refused(format!("&{cs} does not run its rotary program any more: {by}")));
        }
        self.runs |= runs;
        Ok(())
    }

    /// Takes in whether the board's rotary buffers are open, if the board tells.
    ///
    /// # Errors
    /// The rotary buffers are no longer open: the board takes no more lines.
    fn see_open(&mut self, open: Option<bool>) -> Result<(), CallError> {
        self.seen_open |= open == Some(true);
        if self.seen_open && open == Some(false) {
            let by = self.io.ended_by();
            let by = by.as_deref().unwrap_or(
                "somebody sent CLOSE, on the serial port or from another host, or the board was reset; no client of pmacd did",
            );
            return Err(CallError::refused(format!(
                "the rotary buffers are closed, so the board takes no more lines: {by}"
            )));
        }
        Ok(())
    }

    /// Decides on the lines found in the buffers.
    fn decide_on_left(&self, header: &[u16]) -> Result<(), CallError> {
        let (cs, found) = (self.call.coordinate_system, self.found);
        let word = |index: usize| header.get(index).copied().unwrap_or_default();
        let (host, pmac, size) =
            (word(rotary_header::HOST_INDEX), word(rotary_header::PMAC_INDEX), word(rotary_header::SIZE));
        // At the ring's end PMAC's index may be the size.
        let is_ring = host < size && pmac <= size;
        // No set-up has written the header that power-on left, or the buffer's last lines were another system's.
        let is_system = [cs - 1, cs].map(u16::from).contains(&word(rotary_header::COORDINATE_SYSTEM));
        // The end of a stream leaves the indexes, and the size 0.
        let waits = is_system
            && (is_ring && u32::from(host) != u32::from(pmac) % u32::from(size) || size == 0 && host != pmac);
        let clear = match self.is_beside() {
            true => "--clear (when the other rotary streams are over)",
            false => "--clear",
        };
        match (self.call.left, waits) {
            (Some(LeftLines::Continue), false) if !self.call.modes.is_empty() => {
                Err(CallError::refused(format!(
                    "{found} lines are left in &{cs}'s rotary buffer and are to run first, but {} would be in force for them already: no \
                 board takes it behind them before rotary_code2 is told (docs/evidence.md); --clear takes them away; nothing was sent",
                    self.call.modes.join(", ")
                )))
            }
            (Some(LeftLines::Clear), _) | (Some(LeftLines::Continue), false) => Ok(()),
            (Some(LeftLines::Continue), true) => Err(CallError::refused(format!(
                "{found} lines are left in &{cs}'s rotary buffer, and commands that came after them are still in the \
                 DPRAM and cannot be kept: there would be a gap; {clear} takes all of them away; nothing was sent"
            ))),
            (None, _) => Err(CallError::refused(format!(
                "{found} lines of an earlier program are left in &{cs}'s rotary buffer, and would run first: rotary stream {clear} takes \
                 them away, --continue runs them before this program (if it still runs: pmacctl send '&{cs}Q' ends it); nothing was sent"
            ))),
        }
    }

    /// Whether the status of the coordinate system at `index` of a reply says that it runs a program.
    fn is_running(&self, reply: &[String], index: usize) -> Option<bool> {
        let status = reply.iter().flat_map(|line| line.split_ascii_whitespace()).nth(index)?;
        Some(reply_has(status, self.call.family.status.coordinate_system, "running_program"))
    }

    /// Whether the answer to ^C covers the coordinate system. On a board with more coordinate systems than that answer
    /// covers, a line asks for the status.
    fn asks_all(&self) -> bool {
        self.call.family.coordinate_systems <= ALL_SYSTEMS
    }

    /// Whether the board has the complete program, which then runs to its end, and waits there.
    fn is_whole(&self) -> bool {
        self.finished && self.ahead == 0 && self.io.ending().is_none() && self.failure.is_none()
    }
}

/// The reply to `line`; the board's error, with `hint`, if the board refused the line.
fn told(done: Done, line: &str, hint: &str) -> Result<Vec<String>, CallError> {
    done.result.map_err(|error| match error {
        CallError::Board { .. } => CallError::refused(format!("{line}: {error}{hint}")),
        error => error,
    })
}
