//! A running capture. One thread does all work in turn, the trace first: the daemon has little memory for the trace.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Map, Value, json};

use super::image::ImageReading;
use super::latency::Times;
use super::private::{IDENTITY, TextFilter, without_users};
use crate::cli::args::values::seconds;
use crate::cli::console::{Interrupt, rfc3339_now};
use crate::cli::context::{Context, Failure};
use crate::cli::files::saved::{Saved, What};
use crate::client::{Board, CommandError, Connection};
use crate::device::machine::facts::facts;
use crate::device::{BoardSpec, System, without_paths};
use crate::map::{AsciiPort, Family, Generation, HostOffset, IVariables};
use crate::protocol::{CallError, control};
use crate::recording::{
    About, Access, Answer, FORMAT, MOST_ACCESSES, MOST_IMAGES, Op, RecordingError, Writer,
};
use crate::segment::Counter;

/// The time from one image to the next.
const INTERVAL_NS: u64 = 1_000_000_000;
/// The trace goes on for this time after its end, for the first image and the questions, which belong into it.
const GRACE_NS: u64 = 1_000_000_000;
/// How long the board may take to answer a question.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);
/// The sleep when the capture has no work.
const IDLE_SLEEP: Duration = Duration::from_millis(2);
/// The time for the trace in one turn, and the number of accesses in a reply below which the turn ends.
const TURN: Duration = Duration::from_millis(20);
const FEW: usize = 1000;
/// Stop at this many accesses: the accesses still to come and one more reply fit below [`MOST_ACCESSES`].
const ENOUGH: u64 = MOST_ACCESSES as u64 - (1 << 16);
/// Replies that fetch the rest of the trace at the end; more than the daemon has memory for.
const LAST_REPLIES: usize = 1000;
/// Variables and definitions, but no programs: those belong to the machine builder.
const VARIABLES: [What; 5] = [What::I, What::P, What::Q, What::M, What::Axes];
/// The parts of the board that every capture leaves out.
const LEFT_OUT: [&str; 4] = [
    "motion, PLC and kinematic programs, which are the machine builder's",
    "the text of command lines and replies, but for questions for variables and identity: its words are 0 in the trace, and all \
     text is 0 in the images; so no password is in it",
    "accesses to the host port and to the mailboxes of a VME board, which are not in the DPRAM",
    "names of this host, of users and of other processes; of a board that is a file, its path",
];
const NO_VARIABLES: &str =
    "variables and definitions, but for I-variables that pmacd asks for at its start: --no-variables";
const BEING_WRITTEN: &str = "pmacctl has not finished it: it was killed, or had no room";

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        Self::request(error)
    }
}

/// The contents of the last line and of about.json.
pub struct Summary {
    pub updates: u64,
    pub accesses: u64,
    pub dropped: u64,
    pub cut_short: Option<String>,
    pub left_out: Vec<String>,
    /// The board, or the daemon, refused a question.
    pub lacks_answers: bool,
}

#[derive(Debug, Args)]
pub struct Capture {
    /// The directory to make; an existing directory must be empty
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// How long to trace the bus accesses, in seconds. A second takes tens of megabytes
    #[arg(long, value_name = "S", default_value = "2", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Duration,
    /// Leave out variables and definitions, except the I-variables that pmacd needs to read the board
    #[arg(long)]
    pub no_variables: bool,
}

/// The outcome of a capture.
pub struct Taken {
    pub summary: Summary,
    /// The reason for an early end other than a signal.
    pub failure: Option<Failure>,
    /// The directory of the capture, even if its path leads elsewhere by now.
    pub directory: File,
}

/// A running capture.
pub struct Taking<'a> {
    board: &'a mut Board,
    connection: &'a mut Connection,
    stop: Interrupt,
    options: &'a Capture,
    family: &'static Family,
    facts: Value,
    about: About,
    lacks_answers: bool,
    directory: File,
    writer: Writer,
    filter: TextFilter,
    updates_before: u64,
    /// The socket's path, which errors may contain.
    socket: String,
    questions: Times,
    reads: Times,
    wake_ups: Times,
}

impl<'a> Taking<'a> {
    /// Makes the directory.
    pub fn begin(
        board: &'a mut Board,
        connection: &'a mut Connection,
        socket: &Path,
        stop: Interrupt,
        options: &'a Capture,
    ) -> Result<Self, Failure> {
        let family = Context::family(None, connection)?;
        let (info, settings) = (connection.info()?, connection.settings()?);
        if info.replay.is_some() {
            return Err(Failure::Refused(
                "this is a replay of a recording, no board; copy the recording".to_owned(),
            ));
        }
        // Checked before the directory is made.
        if info.role.as_deref().is_some_and(|role| role != "engineer") {
            return Err(
                CommandError::from(CallError::NotPermitted { role_needed: "engineer".to_owned() }).into()
            );
        }
        let dpram_bytes = info.dpram_bytes.unwrap_or(family.length);
        let began_ns = board.subscriber().now_ns();
        let spec: Option<BoardSpec> = info.board.parse().ok();
        let facts = json!(facts(&System::here(), spec.as_ref()));
        let about = About {
            format: FORMAT,
            program: format!("pmacctl {}", env!("CARGO_PKG_VERSION")),
            pmacd: info.version.clone(),
            taken: rfc3339_now(),
            began_ns,
            board: without_paths(&info.board),
            name: info.name,
            family: info.family,
            board_type: info.board_type,
            firmware: info.firmware,
            dpram_bytes,
            servo_period_ns: info.servo_period_ns,
            settings,
            updates: 0,
            accesses: 0,
            dropped: 0,
            cut_short: Some(BEING_WRITTEN.to_owned()),
            left_out: LEFT_OUT.map(str::to_owned).to_vec(),
        };
        let writer = Writer::create(&options.directory, &about)?;
        Ok(Self {
            filter: TextFilter::new(&family.ascii),
            // Before the trace begins there are no accesses.
            updates_before: u64::MAX,
            socket: socket.display().to_string(),
            board,
            connection,
            stop,
            options,
            family,
            facts,
            about,
            lacks_answers: false,
            directory: writer.directory()?,
            writer,
            questions: Times::default(),
            reads: Times::default(),
            wake_ups: Times::default(),
        })
    }

    /// Everything, up to the end or a signal.
    pub fn record(&mut self) -> Result<(), Failure> {
        self.writer.system(&self.system())?;
        self.variables()?;
        self.updates_before = self.board.subscriber().counter(Counter::Updates);
        // The first call begins the trace, so that the first image shows the memory at the begin of the trace.
        self.trace(false)?;
        let (port, bytes): (&'static AsciiPort, u32) = (&self.family.ascii, self.about.dpram_bytes);
        let began_ns = self.board.subscriber().now_ns();
        let time_ns = u64::try_from(self.options.seconds.as_nanos()).unwrap_or(u64::MAX);
        let end_ns = began_ns.saturating_add(time_ns);
        let mut image = Some(ImageReading::new(port, bytes));
        let mut next_image_ns = began_ns + INTERVAL_NS;
        let mut questions = questions(self.family).into_iter();
        let mut is_traced = true;
        while !self.stop.came() {
            let now_ns = self.board.subscriber().now_ns();
            // On a busy machine the trace ends first, and the remaining questions come after it.
            if is_traced && now_ns >= end_ns.saturating_add(GRACE_NS) {
                self.rest_of_trace()?;
                is_traced = false;
            }
            let turn = Instant::now();
            while is_traced && self.trace(false)? >= FEW && turn.elapsed() < TURN {}
            if self.board.refresh()?.is_over() {
                return Err(Failure::Refused("pmacd is gone".to_owned()));
            }
            // The capture gives up a later image that is not whole when the time is over.
            let is_wanted = now_ns < end_ns || self.writer.images() == 0;
            if let Some(reading) = image.as_mut().filter(|_| is_wanted) {
                let began = Instant::now();
                let whole = reading.step(self.connection)?;
                self.reads.note(began.elapsed());
                if let Some((t_ns, words)) = whole {
                    self.writer.image(t_ns, &words)?;
                    image = None;
                }
            } else if let Some(line) = questions.next() {
                self.ask(&line)?;
            } else if now_ns >= end_ns {
                break;
            } else if now_ns >= next_image_ns && self.writer.images() < MOST_IMAGES as u64 {
                next_image_ns = now_ns + INTERVAL_NS;
                image = Some(ImageReading::new(port, bytes));
            } else {
                let began = Instant::now();
                std::thread::sleep(IDLE_SLEEP);
                self.wake_ups.note(began.elapsed().saturating_sub(IDLE_SLEEP));
            }
        }
        if is_traced {
            self.rest_of_trace()?;
        }
        Ok(())
    }

    /// Ends the trace, and writes the rest of it.
    fn rest_of_trace(&mut self) -> Result<(), Failure> {
        for _ in 0..LAST_REPLIES {
            if self.trace(true)? == 0 {
                break;
            }
        }
        let mut kept = Vec::new();
        self.filter.end(&mut kept);
        kept.iter().try_for_each(|access| self.writer.access(access))?;
        Ok(())
    }

    /// Writes the rest of the capture, and its outcome.
    pub fn finish(mut self, failure: Option<Failure>) -> Result<Taken, Failure> {
        let cut_short = match &failure {
            // The socket's path may name a user.
            Some(failure) => {
                let text = failure.to_string().replace(&self.socket, "SOCKET");
                let inside = text.strip_prefix(&self.options.directory.display().to_string());
                Some(without_users(&inside.map_or(text.clone(), |inside| format!("DIR{inside}"))))
            }
            None => self.stop.came().then(|| "ended by a signal".to_owned()),
        };
        let updates = self.board.subscriber().counter(Counter::Updates);
        self.about.updates = updates.saturating_sub(self.updates_before);
        self.about.cut_short = cut_short;
        // A disk without room for this has no room for the next file either, and that error is reported.
        let _ = self.writer.system(&self.system());
        let (updates, dropped, left_out) =
            (self.about.updates, self.about.dropped, self.about.left_out.clone());
        let mut cut_short = self.about.cut_short.clone();
        let finished = self.writer.finish(self.about);
        let accesses = *finished.as_ref().unwrap_or(&0);
        let failure = failure.or(finished.err().map(Failure::from));
        cut_short = cut_short.or(failure.as_ref().map(ToString::to_string));
        let lacks_answers = self.lacks_answers;
        let summary = Summary { updates, accesses, dropped, cut_short, left_out, lacks_answers };
        Ok(Taken { summary, failure, directory: self.directory })
    }

    /// Fetches the accesses since the last call; returns how many came.
    fn trace(&mut self, end: bool) -> Result<usize, Failure> {
        let reply = self.connection.trace(end)?;
        let is_gap = std::mem::replace(&mut self.about.dropped, reply.dropped) != reply.dropped;
        if is_gap {
            self.filter.distrust();
        }
        let mut kept = Vec::new();
        let mut t_ns = 0;
        for numbers in reply.accesses.chunks(4) {
            let access = access(numbers, t_ns).ok_or_else(|| {
                CommandError::from(CallError::Protocol(format!("{numbers:?} is no access")))
            })?;
            t_ns = access.t_ns;
            self.filter.take(access, &mut kept);
        }
        kept.iter().try_for_each(|access| self.writer.access(access))?;
        let count = reply.accesses.len() / 4;
        if !is_gap && count < FEW {
            // The daemon has no older accesses left: the gap is over.
            self.filter.trust();
        }
        if self.writer.accesses() >= ENOUGH {
            return Err(Failure::Refused(format!("more than {ENOUGH} accesses; give --seconds less")));
        }
        Ok(count)
    }

    /// Writes the variables, or the reason for their absence.
    fn variables(&mut self) -> Result<(), Failure> {
        if self.options.no_variables {
            self.about.left_out.push(NO_VARIABLES.to_owned());
            let mut lines = driver_questions(self.family).into_iter();
            return lines.try_for_each(|line| if self.stop.came() { Ok(()) } else { self.ask(&line) });
        }
        match Saved::ask(self.connection, "capture", &VARIABLES, (1, 1), Some(&self.stop)) {
            Ok(saved) => self.writer.variables(&saved.text())?,
            // A capture is useful even if the board does not answer.
            Err(Failure::Refused(why)) => self.lacks("variables and definitions", &why),
            Err(failure) => return Err(failure),
        }
        Ok(())
    }

    /// Notes a part that the board or the daemon did not give, and the reason.
    fn lacks(&mut self, what: &str, why: &str) {
        self.lacks_answers = true;
        self.about.left_out.push(format!("{what}: {}", without_users(why)));
    }

    /// Asks the board; a refusal by the board is an answer. A question enters no program buffer.
    fn ask(&mut self, line: &str) -> Result<(), Failure> {
        let began = Instant::now();
        let reply = match control::parse(line) {
            Some(character) => self.connection.control(character),
            None => self.connection.question(line, ANSWER_WITHIN),
        };
        let is_the_boards = matches!(reply, Err(CommandError::Refused(CallError::Board { .. })));
        let (reply, refused) = match reply {
            Ok(reply) => (reply, None),
            Err(CommandError::Refused(
                error @ (CallError::Board { .. }
                | CallError::Refused { .. }
                | CallError::TimedOut { .. }
                | CallError::Unavailable { .. }
                | CallError::Busy),
            )) => (Vec::new(), Some(without_users(&error.to_string()))),
            Err(error) => return Err(error.into()),
        };
        self.questions.note(began.elapsed());
        if let Some(why) = refused.as_ref().filter(|_| !is_the_boards) {
            self.lacks(&format!("the answer to {line}"), why);
        }
        self.writer.answer(&Answer { line: line.to_owned(), reply, refused })?;
        Ok(())
    }

    /// Facts of the machine, and the times of the capture's steps.
    fn system(&self) -> Value {
        let subscriber = self.board.subscriber();
        let counters: Map<String, Value> =
            subscriber.counters().map(|(counter, value)| (counter.name().to_owned(), json!(value))).collect();
        json!({
            "machine": self.facts,
            "latencies": { "question": self.questions.document(), "read_of_words": self.reads.document(),
                "wake_up": self.wake_ups.document() },
            "counters": counters,
        })
    }
}

/// The questions during the trace. The last three show the board's response to a control character, an error, and a
/// line in two parts.
fn questions(family: &Family) -> Vec<String> {
    // Only Turbo boards know the questions for the processor and the board's number.
    let is_of_turbo = |line: &str| matches!(line, "CPU" | "CID" | "VID");
    let is_turbo = family.generation == Generation::Turbo;
    let asked = IDENTITY.into_iter().filter(|line| is_turbo || !is_of_turbo(line)).chain(["^F", "XYZZY"]);
    asked.map(str::to_owned).chain([["I122"; 40].join(" ")]).collect()
}

/// The daemon's questions at its start besides identity: the end of a reply, the reports, the programs that may report
/// errors, and the motors' scales.
fn driver_questions(family: &Family) -> Vec<String> {
    let i = &family.i;
    let reports = [Some(3), Some(10), Some(i.servo_period), Some(i.servo_enable), i.servo_in_background];
    let others = [Some(i.background_enable), i.reported, i.panel, Some(i.variables_enable), Some(5), Some(6)];
    let reports = reports.into_iter().chain(others).flatten().map(|number| format!("I{number}")).collect();
    let scales = (1..=family.motors).map(|motor| {
        let numbers = IVariables::SCALES.map(|which| IVariables::motor(motor, which));
        numbers.map(|number| format!("I{number}")).concat()
    });
    [reports].into_iter().chain(scales).collect()
}

/// The access as four numbers of the trace; the access before was at `t_ns`.
fn access(numbers: &[u64], t_ns: u64) -> Option<Access> {
    let &[after_ns, kind, offset, value] = numbers else { return None };
    let (op, width) = match kind {
        0 => (Op::Read, 16),
        1 => (Op::Write, 16),
        2 => (Op::Read, 32),
        _ => return None,
    };
    let offset = HostOffset::checked(u32::try_from(offset).ok()?)?;
    Some(Access { t_ns: t_ns.checked_add(after_ns)?, op, offset, width, value: u32::try_from(value).ok()? })
}
