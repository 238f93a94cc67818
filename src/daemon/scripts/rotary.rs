//! A rotary stream: what lies in the board's rotary buffer is known first; then the set-up, and an end that leaves no
//! half-fed program running.
//!
//! `OPEN BINARY ROTARY` lets the lines in and no text, so that others go on meanwhile (Software Reference p. 271). A board that answers
//! it with an error gets `OPEN ROT`. While that is in force every line such as `I57=1` is a program statement, and B0 an axis move, so it
//! comes last. The header of the buffer must not change under a transfer, so I57 is 0 meanwhile; Turbo boards have no I57, so that the
//! rotary buffers must be closed then. After `CLOSE` the board takes nothing from the DPRAM any more.
//!
//! ABS, INC and FRAX before the first move go as on-line lines behind B0, which the board refuses while a program runs. They are modal
//! in the coordinate system: nothing puts them back.
//!
//! Lines that an abort or an early end has left in the board's own rotary buffer would run before those of the next stream:
//! `PR` counts them (Turbo Software Reference p. 286). `CLEAR` takes them away, after `OPEN ROT` and for the coordinate system
//! addressed. What has not left the DPRAM never runs: the set-up makes that buffer empty.
//!
//! A stream that ends before its program is whole in the board, whatever the reason, ends the program too, if it runs: with `Q`,
//! after the moves already calculated (Software Reference, Q). Otherwise a machine would go on to wherever the last line that came through
//! leaves it. In a feed hold those moves wait for `R` ("much like a %0 command", Software Reference p. 172), and the program
//! with them: so the board is asked whether it has ended. What is said then is right too for a board whose `Q` ends a held
//! program.
//!
//! Whoever sends `CLOSE`, and a reset, close the rotary buffers too. `???` tells of
//! them: open for text, or for binary lines (Software Reference p. 271, Turbo Software Reference p. 290).

mod call;
mod count;
mod end;
mod phase;

use std::time::{Duration, Instant};

pub use self::call::RotaryCall;
use self::count::Count;
pub use self::count::lines_left;
use self::phase::Phase;
use super::end_retry::EndRetry;
use super::{Done, END_STEP, Ending, Resource, STEP, Sequence, SequenceCall, Step, ask, line};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Outcome;
use crate::function::rotary::RotaryState;
use crate::map::functions::{OPEN_BINARY, OPEN_TEXT, rotary_header};
use crate::map::status::reply_has;
use crate::protocol::board::RotaryStartReply;
use crate::protocol::calls::LeftLines;
use crate::protocol::{CallError, Reply};

/// How often to look for the first lines, which the program waits for to begin.
const FIRST_LINES: Duration = Duration::from_millis(20);
/// How long the owner, who has sent the last line, waits for `R` to go first.
const FINISH_WAITS: Duration = Duration::from_secs(1);
/// A report of the board is never older, where one tells which programs run.
const REPORTED: Duration = Duration::from_secs(1);
/// What a board that refuses to open the rotary buffers may have.
const STILL_OPEN: &str = "; is a program buffer open, or are the rotary buffers (CLOSE closes them)?";
/// How often to look whether the program still runs.
const LOOK: Duration = Duration::from_millis(500);
/// ^C, which asks for the status of eight coordinate systems, whatever buffer is open.
const ALL_STATUS: u8 = 3;
const ALL_SYSTEMS: usize = 8;
/// Words of a header.
const HEADER_WORDS: usize = rotary_header::START + 1;

/// The sequence.
#[derive(Debug)]
pub struct Rotary {
    call: RotaryCall,
    phase: Phase,
    /// Lines in the board's own buffer before the stream, and what became of them.
    found: u64,
    /// What the board has taken, and what it had taken before it was asked for its count.
    count: Count,
    counted: Count,
    /// The transfer was switched; the rotary buffers were opened; the DPRAM's buffer was set up.
    switched: bool,
    opened: bool,
    set_up: bool,
    /// The board takes `OPEN ROT` alone.
    opens_text: bool,
    /// The board has told that the rotary buffers are open.
    seen_open: bool,
    /// The owner has heard that lines can come.
    started: bool,
    /// `R` was sent, or the program seen to run.
    runs: bool,
    /// When `R` was sent.
    run_sent: Option<Instant>,
    finished: bool,
    stop_asked: bool,
    finish_asked: bool,
    /// The answer to that waits for `R` until then.
    answer_by: Option<Instant>,
    ending: Option<Ending>,
    /// The client who has ended its program or closed the buffers, as far as known.
    ended_by: Option<String>,
    failure: Option<CallError>,
    /// Lines in the DPRAM that the board has not taken, and in its own buffer, at the end.
    ahead: u64,
    left: Option<u64>,
    quit: bool,
    notes: Vec<String>,
    retry: EndRetry,
    rest: Option<Instant>,
}

impl Rotary {
    /// Begins a stream.
    pub fn new(call: RotaryCall) -> Self {
        Self {
            phase: if call.define.is_some() { Phase::Define } else { Phase::AskLeft },
            call,
            found: 0,
            count: Count::default(),
            counted: Count::default(),
            switched: false,
            opened: false,
            set_up: false,
            opens_text: false,
            seen_open: false,
            started: false,
            runs: false,
            run_sent: None,
            finished: false,
            stop_asked: false,
            finish_asked: false,
            answer_by: None,
            ending: None,
            ended_by: None,
            failure: None,
            ahead: 0,
            left: None,
            quit: false,
            notes: Vec::new(),
            retry: EndRetry::new(end::END_PATIENCE, true),
            rest: None,
        }
    }

    /// Takes what became of the step of this phase.
    ///
    /// # Errors
    /// Why the stream ends.
    fn take(&mut self, mut done: Done, now: Instant) -> Result<(), CallError> {
        self.ended_by = done.ended_by.take();
        let (cs, unsent) = (self.call.coordinate_system, done.outcome.is_unsent());
        self.phase = match self.phase {
            Phase::Define => {
                let longs = self.call.define.unwrap_or_default();
                told(
                    done,
                    &format!("&{cs}DEFINE ROT {longs}"),
                    &format!(
                        "; is one defined already (leave --define out, or take it away: pmacctl send '&{cs}DELETE ROT'), one for a \
                     lower coordinate system, or a gather buffer (DELETE GATHER)?"
                    ),
                )?;
                Phase::AskLeft
            }
            Phase::AskLeft => {
                let has_one = "; has the coordinate system a rotary buffer (--define LONGS)?";
                self.found = lines_left(&told(done, &format!("&{cs}PR"), has_one)?)?;
                self.count.kept = self.found;
                if self.found == 0 { Phase::Disable } else { Phase::SeeHeader }
            }
            Phase::SeeHeader => {
                self.decide_on_left(&done.words)?;
                Phase::Disable
            }
            Phase::Disable => {
                self.switched |= !unsent;
                let lines = done.result?;
                if !self.has_switch() && self.is_open(&lines) == Some(true) {
                    return Err(refused(
                        "the rotary buffers are open for binary lines, by another host or by a pmacd that was killed: the board would \
                         read the buffer while it is set up; CLOSE by an engineer closes them",
                    ));
                }
                self.after_disable()
            }
            Phase::OpenToClear => {
                self.opened = !unsent;
                told(done, OPEN_TEXT, STILL_OPEN)?;
                Phase::Clear
            }
            Phase::Clear => {
                let busy =
                    format!("; does a program still run in the coordinate system (pmacctl send '&{cs}Q')?");
                told(done, &format!("&{cs}CLEAR"), &busy)?;
                Phase::CloseCleared
            }
            Phase::CloseCleared => {
                told(done, "CLOSE", "")?;
                self.opened = false;
                Phase::AskCleared
            }
            Phase::AskCleared => match lines_left(&told(done, &format!("&{cs}PR"), "")?)? {
                0 => {
                    self.count.kept = 0;
                    Phase::Point
                }
                left => {
                    return Err(refused(format!(
                        "{left} lines are left in &{cs}'s rotary buffer after CLEAR"
                    )));
                }
            },
            Phase::Point => {
                told(
                    done,
                    &format!("&{cs}B0"),
                    &format!(
                        "; does a program run in the coordinate system (one that waits for more lines ends by: pmacctl send '&{cs}Q')?"
                    ),
                )?;
                self.mode(0)
            }
            Phase::Mode(number) => {
                told(done, &self.mode_line(number), "")?;
                self.mode(number + 1)
            }
            Phase::SetUp => {
                self.set_up = !unsent;
                done.result?;
                Phase::Enable
            }
            Phase::Enable => {
                done.result?;
                Phase::Open
            }
            Phase::Open => {
                self.opened = !unsent;
                self.opens_text = matches!(done.outcome, Outcome::Error(_));
                if self.opens_text {
                    Phase::OpenText
                } else {
                    told(done, OPEN_BINARY, "")?;
                    Phase::Feeding
                }
            }
            Phase::OpenText => {
                self.opened = !unsent;
                told(done, OPEN_TEXT, STILL_OPEN)?;
                Phase::Feeding
            }
            Phase::SeeFed => {
                done.result.map_err(|error| refused(format!("{error}; was the board reset?")))?;
                self.see(done.rotary);
                match (self.call.run && !self.runs, self.count.has_lines(), done.programs_run) {
                    (true, true, _) => Phase::Count,
                    (true, false, _) => self.rest_before(Phase::Feeding, now + FIRST_LINES),
                    // A line with an address would change what others have addressed.
                    (false, _, Some(systems)) if !self.asks_all() => {
                        let runs = systems >> (cs - 1) & 1 == 1;
                        if runs || self.run_sent.is_none_or(|sent| now >= sent + REPORTED) {
                            self.see_runs(runs)?;
                        }
                        Phase::AskOpen
                    }
                    (false, ..) => Phase::SeeRuns,
                }
            }
            Phase::Count => {
                self.count.told = Some(lines_left(&told(done, &format!("&{cs}PR"), "")?)?);
                self.counted = self.count;
                Phase::SeeCounted
            }
            Phase::SeeCounted => {
                done.result?;
                self.see(done.rotary);
                if let Some(doubt) = self.count.doubt(self.counted, cs) {
                    return Err(refused(format!("{doubt}; R was not sent")));
                }
                Phase::Run
            }
            Phase::Run => {
                // What may have been carried out is ended by `Q`.
                self.runs = !unsent && !matches!(done.outcome, Outcome::Error(_));
                self.run_sent = Some(now);
                told(done, &format!("&{cs}R"), "")?;
                self.rest_before(Phase::Feeding, now + LOOK)
            }
            Phase::SeeRuns => {
                // A board that does not answer says nothing of its program.
                let index = if self.asks_all() { usize::from(cs) - 1 } else { 0 };
                if let Some(runs) = done.result.ok().and_then(|lines| self.is_running(&lines, index)) {
                    self.see_runs(runs)?;
                }
                Phase::AskOpen
            }
            Phase::AskOpen => {
                let open = done.result.ok().and_then(|lines| self.is_open(&lines));
                self.see_open(open)?;
                self.rest_before(Phase::Feeding, now + LOOK)
            }
            Phase::Finish => {
                done.result?;
                self.finished = true;
                Phase::Feeding
            }
            Phase::Feeding | Phase::Over => self.phase,
            _ => self.take_of_end(done, now),
        };
        Ok(())
    }

    /// Takes how far the board is. After a reset the last look counts.
    fn see(&mut self, state: Option<RotaryState>) {
        if let Some(state) = state {
            self.ahead = state.ahead_lines;
            self.count.see(state);
        }
    }

    fn after_disable(&self) -> Phase {
        let clears = self.found > 0 && self.call.left == Some(LeftLines::Clear);
        if clears { Phase::OpenToClear } else { Phase::Point }
    }

    /// The phase that sends the mode of this `number`, if there is one.
    fn mode(&self, number: usize) -> Phase {
        if number < self.call.modes.len() { Phase::Mode(number) } else { Phase::SetUp }
    }

    fn mode_line(&self, number: usize) -> String {
        format!("&{}{}", self.call.coordinate_system, self.call.modes[number])
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

    /// Takes what the board tells of its program.
    ///
    /// # Errors
    /// It does not run any more.
    fn see_runs(&mut self, runs: bool) -> Result<(), CallError> {
        if self.runs && !runs && !self.call.may_stand {
            self.runs = false;
            let by = self.ended_by.as_deref().unwrap_or(
                "an error, the serial port, another host or a program of the board ended it; no client of pmacd did",
            );
            let cs = self.call.coordinate_system;
            return Err(refused(format!("&{cs} does not run its rotary program any more: {by}")));
        }
        self.runs |= runs;
        Ok(())
    }

    /// Takes what the board tells of its rotary buffers, if it does.
    ///
    /// # Errors
    /// The rotary buffers are not open any more: the board takes no more lines.
    fn see_open(&mut self, open: Option<bool>) -> Result<(), CallError> {
        self.seen_open |= open == Some(true);
        if self.seen_open && open == Some(false) {
            let by = self.ended_by.as_deref().unwrap_or(
                "somebody sent CLOSE, on the serial port or from another host, or the board was reset; no client of pmacd did",
            );
            return Err(refused(format!(
                "the rotary buffers are closed, so the board takes no more lines: {by}"
            )));
        }
        Ok(())
    }

    /// What becomes of the lines that were found.
    fn decide_on_left(&self, header: &[u16]) -> Result<(), CallError> {
        let (cs, found) = (self.call.coordinate_system, self.found);
        let word = |index: usize| header.get(index).copied().unwrap_or_default();
        let (host, pmac, size) =
            (word(rotary_header::HOST_INDEX), word(rotary_header::PMAC_INDEX), word(rotary_header::SIZE));
        // At the ring's end PMAC's index may be the size.
        let is_ring = host < size && pmac <= size;
        // Two longs a command.
        let waiting = if is_ring {
            (u32::from(host) + u32::from(size) - u32::from(pmac)) % u32::from(size) / 2
        } else {
            0
        };
        match (self.call.left, waiting) {
            (Some(LeftLines::Continue), 0) if !self.call.modes.is_empty() => Err(refused(format!(
                "{found} lines are left in &{cs}'s rotary buffer and are to run first, but {} would be in force for them already: no \
                 board takes it behind them before rotary_code2 is told (docs/evidence.md); --clear takes them away; nothing was sent",
                self.call.modes.join(", ")
            ))),
            (Some(LeftLines::Clear), _) | (Some(LeftLines::Continue), 0) => Ok(()),
            (Some(LeftLines::Continue), _) => Err(refused(format!(
                "{found} lines are left in &{cs}'s rotary buffer, and the {waiting} commands that came after them are still in the \
                 DPRAM and cannot be kept: there would be a gap; --clear takes all of them away; nothing was sent"
            ))),
            (None, _) => Err(refused(format!(
                "{found} lines of an earlier program are left in &{cs}'s rotary buffer, and would run first: rotary stream --clear takes \
                 them away, --continue runs them before this program (if it still runs: pmacctl send '&{cs}Q' ends it); nothing was sent"
            ))),
        }
    }

    fn rest_before(&mut self, phase: Phase, until: Instant) -> Phase {
        self.rest = Some(until);
        phase
    }

    /// Whether the status of the coordinate system at `index` of a reply says that it runs a program.
    fn is_running(&self, reply: &[String], index: usize) -> Option<bool> {
        let status = reply.iter().flat_map(|line| line.split_ascii_whitespace()).nth(index)?;
        Some(reply_has(status, self.call.family.status.coordinate_system, "running_program"))
    }

    /// Whether ^C has the coordinate system's status: on a board with more than it tells of, a line asks for it.
    fn asks_all(&self) -> bool {
        self.call.family.coordinate_systems <= ALL_SYSTEMS
    }

    /// The program is whole in the board: it runs to its end, and waits there.
    fn is_whole(&self) -> bool {
        self.finished && self.ahead == 0 && self.ending.is_none() && self.failure.is_none()
    }

    /// Whether the owner, who has sent all lines, hears of that only when `R` has gone: he may end the stream then.
    fn waits_for_run(&self, now: Instant) -> bool {
        self.call.run && !self.runs && self.answer_by.is_some_and(|by| now < by)
    }

    /// Whether the phase is to be left out.
    fn skips(&self) -> Option<Phase> {
        let has_switch = self.has_switch();
        match self.phase {
            Phase::Enable if !has_switch => Some(Phase::Open),
            Phase::Close if !self.opened => Some(Phase::EndTransfer),
            Phase::EndTransfer if !self.switched || !has_switch => Some(Phase::DropLines),
            Phase::DropLines if !self.set_up => Some(Phase::Over),
            Phase::AskRuns if self.runs == self.is_whole() => Some(Phase::AskLeftAtEnd),
            _ => None,
        }
    }

    /// The step of this phase.
    fn step(&mut self, now: Instant) -> Step {
        let (cs, buffer) = (self.call.coordinate_system, self.call.buffer);
        let timeout = if self.phase.is_of_end() { END_STEP } else { STEP };
        let job = |job| Step::Job { job: Box::new(job), timeout };
        let switch = |value: u8| {
            let variable = self.call.family.i.rotary_enable.unwrap_or_default();
            line(format_args!("I{variable}={value}"), timeout)
        };
        match self.phase {
            Phase::Define => {
                line(format_args!("&{cs}DEFINE ROT {}", self.call.define.unwrap_or_default()), timeout)
            }
            Phase::AskLeft | Phase::AskCleared | Phase::Count | Phase::AskLeftAtEnd => {
                line(format_args!("&{cs}PR"), timeout)
            }
            Phase::SeeHeader => Step::Read { first: self.call.header, count: HEADER_WORDS, timeout },
            Phase::Disable if !self.has_switch() => ask("???", timeout),
            Phase::Disable | Phase::EndTransfer => switch(0),
            Phase::Enable => switch(1),
            Phase::OpenToClear | Phase::OpenText => line(OPEN_TEXT, timeout),
            Phase::Open => line(OPEN_BINARY, timeout),
            Phase::Mode(number) => line(self.mode_line(number), timeout),
            Phase::Clear => line(format_args!("&{cs}CLEAR"), timeout),
            Phase::CloseCleared | Phase::Close => line("CLOSE", timeout),
            Phase::Point => line(format_args!("&{cs}B0"), timeout),
            Phase::SetUp => job(self.call.setup.clone()),
            Phase::Feeding if !self.started => {
                self.started = true;
                Step::Answer(Reply::with(&RotaryStartReply { found_lines: self.found }))
            }
            Phase::Feeding if self.finish_asked && self.finished && !self.waits_for_run(now) => {
                self.finish_asked = false;
                Step::Answer(Ok(Reply::done()))
            }
            Phase::Feeding if self.finish_asked && !self.finished => {
                self.phase = Phase::Finish;
                job(Job::RotaryFinish(buffer))
            }
            Phase::Feeding => {
                self.phase = Phase::SeeFed;
                job(Job::RotaryState(buffer))
            }
            Phase::SeeFed | Phase::SeeCounted | Phase::SeeAhead => job(Job::RotaryState(buffer)),
            Phase::Run => line(format_args!("&{cs}R"), timeout),
            Phase::SeeRuns if self.asks_all() => Step::Control { character: ALL_STATUS, timeout },
            Phase::AskOpen => ask("???", timeout),
            Phase::Finish | Phase::DropLines => job(Job::RotaryFinish(buffer)),
            Phase::SeeRuns | Phase::AskRuns | Phase::AskEnded(_) => line(format_args!("&{cs}??"), timeout),
            Phase::Quit => line(format_args!("&{cs}Q"), timeout),
            Phase::Over => Step::Over(self.result()),
        }
    }
}

impl Sequence for Rotary {
    fn resource(&self) -> Resource {
        Resource::Rotary(self.call.buffer)
    }

    fn name(&self) -> &str {
        "rotary stream"
    }

    fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
        if let Some(done) = done
            && let Err(error) = self.take(done, now)
        {
            self.failure.get_or_insert(error);
        }
        let ends = self.failure.is_some() || self.ending.is_some() || self.stop_asked;
        if ends && std::mem::take(&mut self.finish_asked) {
            // How it ended is for the owner's next call, `RotaryStop`.
            return Step::Answer(Ok(Reply::done()));
        }
        if ends && !self.phase.is_of_end() {
            (self.phase, self.rest) = (Phase::Close, None);
        }
        while let Some(next) = self.skips() {
            self.phase = next;
        }
        if self.retry.tells_now() {
            return Step::AnswerEnd(self.result());
        }
        match self.rest.take_if(|rest| *rest > now) {
            Some(rest) if !self.finish_asked || self.finished && self.waits_for_run(now) => {
                self.rest = Some(rest);
                Step::Wait(rest)
            }
            _ => self.step(now),
        }
    }

    fn feeds(&self) -> u32 {
        1 << (self.call.coordinate_system - 1)
    }

    fn leaves(&self) -> Option<u64> {
        let left = if self.is_whole() { 0 } else { self.left.unwrap_or_default() };
        self.started.then_some(left)
    }

    fn watches(&self) -> bool {
        true
    }

    fn unfinished(&self) -> Option<String> {
        let cs = self.call.coordinate_system;
        let keeps = self.retry.is_kept_back() && self.phase != Phase::Over;
        keeps.then(|| {
            let program = if self.runs { format!("&{cs} may still run it (abort {cs} ends that); ") } else { String::new() };
            format!(
                "the end of the rotary stream into &{cs} is not carried out; {program}pmacd goes on when the open program buffer is \
                 closed"
            )
        })
    }

    fn asked(&mut self, call: SequenceCall, now: Instant) -> Result<(), CallError> {
        match call {
            SequenceCall::RotaryFinish(_) => {
                (self.finish_asked, self.answer_by) = (true, Some(now + FINISH_WAITS));
            }
            SequenceCall::RotaryStop(_) => self.stop_asked = true,
            _ => return Err(refused("this connection streams already; RotaryStop ends that")),
        }
        Ok(())
    }

    fn end(&mut self, why: Ending) {
        self.ending = Some(why);
    }
}

/// The reply to `line`; what the board said to it, with `hint`, if it refused it.
fn told(done: Done, line: &str, hint: &str) -> Result<Vec<String>, CallError> {
    done.result.map_err(|error| match error {
        CallError::Board { .. } => refused(format!("{line}: {error}{hint}")),
        error => error,
    })
}

fn refused(reason: impl Into<String>) -> CallError {
    CallError::Refused { reason: reason.into() }
}
