//! What switches the automatic functions on: the I-variables and commands each of them needs, in order, and why.
//!
//! Source: DPRAM manual, the "Enabling" section of each function (pp. 12-30); its control-panel page means I2 where it
//! prints I3, and I3, I4 and I6 are better left alone after I58 has set them. PMAC(1) and PMAC2 only: on Turbo boards
//! other variables have these numbers.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use crate::map::{HostOffset, PMAC, PmacAddress, PmacRegister, classic};

/// An automatic function of the DPRAM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Function {
    // In the order in which they are best enabled: what others talk through first; rotary buffers before a gather
    // buffer, since none can be defined while that exists.
    /// Command lines and replies through the DPRAM.
    Ascii,
    /// Jog, start, stop and feed-rate requests.
    Panel,
    /// Motor data every so many servo cycles.
    Servo,
    /// Motor and coordinate-system data in the background.
    Background,
    /// Reading and writing of chosen registers in the background.
    Variables,
    /// Program lines in binary form.
    Rotary,
    /// Data gathering.
    Gather,
}

impl Function {
    /// Every function, in the order in which they are best enabled.
    pub const ALL: [Self; 7] = [
        Self::Ascii,
        Self::Panel,
        Self::Servo,
        Self::Background,
        Self::Variables,
        Self::Rotary,
        Self::Gather,
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Panel => "panel",
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Variables => "variables",
            Self::Rotary => "rotary",
            Self::Gather => "gather",
        }
    }
}

impl fmt::Display for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no function has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no function {name:?}; there are ascii, panel, servo, background, variables, rotary, gather"
)]
pub struct UnknownFunction {
    /// What was asked for.
    pub name: String,
}

impl FromStr for Function {
    type Err = UnknownFunction;

    fn from_str(name: &str) -> Result<Self, UnknownFunction> {
        Self::ALL
            .into_iter()
            .find(|function| function.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| UnknownFunction { name: name.to_owned() })
    }
}

/// How the functions are to work. The defaults fit most boards.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// The highest motor and coordinate system to report, 1 to 8 (I59).
    pub motors: u32,
    /// Servo cycles between two servo reports, and between two gathered samples (I19).
    pub period: u32,
    /// Whether a response in the DPRAM interrupts the host (I56).
    pub interrupt: bool,
    /// The coordinate system that executes the rotary program, 1 to 8.
    pub coordinate_system: u32,
    /// The size of its rotary buffer in PMAC's own memory, in 48-bit words.
    pub rotary_words: u32,
    /// The size of the gather buffer, in 32-bit DPRAM words.
    pub gather_longs: u32,
    /// Whether gathering goes on from the start of a full buffer (I45=3) or ends (I45=2).
    pub gather_wrap: bool,
    /// What to gather; nothing leaves I20 to I44 as they are.
    pub gather_sources: Vec<PmacRegister>,
    /// Whether the I-variables are to survive a reset.
    pub save: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            motors: 8,
            period: 1,
            interrupt: false,
            coordinate_system: 1,
            rotary_words: 100,
            gather_longs: 1024,
            gather_wrap: true,
            gather_sources: Vec::new(),
            save: false,
        }
    }
}

/// An option that no board can be set to.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {value} is not possible; it is {first} to {last}")]
pub struct OutOfRange {
    /// Which option.
    pub what: &'static str,
    /// What was asked for.
    pub value: u32,
    /// The smallest possible value.
    pub first: u32,
    /// The largest possible value.
    pub last: u32,
}

/// When in the sequence a line is sent, over all functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    /// Variables and registers are set.
    Set,
    /// Buffers are defined.
    Define,
    /// Reports begin.
    Start,
    /// A program buffer is opened; from then on program lines go into it.
    Open,
}

/// A line to send.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlanLine {
    /// The on-line command.
    pub line: String,
    /// What it is for, and what else it does.
    pub why: String,
    #[serde(skip)]
    phase: Phase,
}

/// What one function needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FunctionPlan {
    /// Which.
    pub function: Function,
    /// Its lines, in order.
    pub lines: Vec<PlanLine>,
    /// What else to know and to do.
    pub notes: Vec<String>,
}

/// What several functions need together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EnablePlan {
    /// All lines in the order to send them; what several functions set is set once.
    pub commands: Vec<String>,
    /// Function by function.
    pub plans: Vec<FunctionPlan>,
}

/// Plans how to enable `functions` (their order and repetitions do not matter).
///
/// # Errors
/// [`OutOfRange`] when an option that one of them uses is not possible.
pub fn plan(functions: &[Function], options: &Options) -> Result<EnablePlan, OutOfRange> {
    let mut functions = functions.to_vec();
    functions.sort_unstable();
    functions.dedup();
    let together = functions.contains(&Function::Servo) && functions.contains(&Function::Gather);
    let plans = functions
        .iter()
        .map(|function| match function {
            Function::Ascii => Ok(ascii(options)),
            Function::Panel => Ok(panel()),
            Function::Servo => servo(options),
            Function::Background => background(options),
            Function::Variables => Ok(variable()),
            Function::Rotary => rotary(options),
            Function::Gather => gather(options, together),
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(EnablePlan { commands: commands(&plans, options.save), plans })
}

fn commands(plans: &[FunctionPlan], save: bool) -> Vec<String> {
    let mut lines: Vec<&PlanLine> = plans.iter().flat_map(|plan| &plan.lines).collect();
    lines.sort_by_key(|line| line.phase);
    let mut commands: Vec<String> = Vec::new();
    let settings = lines.iter().filter(|line| line.phase == Phase::Set).map(|line| &line.line);
    for line in settings {
        if !commands.contains(line) {
            commands.push(line.clone());
        }
    }
    if save {
        commands.push("SAVE".to_owned());
    }
    // Each of these does something every time it is sent: two GATHERs are not one.
    commands.extend(lines.iter().filter(|line| line.phase != Phase::Set).map(|line| line.line.clone()));
    commands
}

impl FunctionPlan {
    const fn new(function: Function) -> Self {
        Self { function, lines: Vec::new(), notes: Vec::new() }
    }

    fn line(mut self, phase: Phase, line: impl Into<String>, why: impl Into<String>) -> Self {
        self.lines.push(PlanLine { line: line.into(), why: why.into(), phase });
        self
    }

    fn set(self, line: impl Into<String>, why: impl Into<String>) -> Self {
        self.line(Phase::Set, line, why)
    }

    fn note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }
}

fn in_range(what: &'static str, value: u32, first: u32, last: u32) -> Result<u32, OutOfRange> {
    if (first..=last).contains(&value) { Ok(value) } else { Err(OutOfRange { what, value, first, last }) }
}

/// The on-line command that makes PMAC itself write 0 into a DPRAM word.
fn clear(offset: HostOffset) -> String {
    let PmacAddress { space, number } = PmacAddress::new(PMAC.half(offset), PMAC.pmac_number(offset));
    format!("W{space}{},0", PMAC.print_number(number))
}

fn ascii(options: &Options) -> FunctionPlan {
    let plan = FunctionPlan::new(Function::Ascii)
        .set("I3=2", "replies end with <ACK>, so that the host knows their last line")
        .set(
            "I58=1",
            "command lines through the DPRAM; forces I3 (1 becomes 0, 3 becomes 2; always 2 before firmware 1.15), \
             I4=0 (no checksums) and I6=1 (errors as <BELL>ERRnnn) on every port",
        );
    let plan = if options.interrupt {
        plan.set(
            "I56=1",
            "an interrupt for every response in the DPRAM (IR7 through jumper E55, or VME vector v+1)",
        )
    } else {
        plan
    };
    plan.note("before I58=1 the host clears both control words, 0x062C (Y:$D18B) and 0x06D0 (Y:$D1B4)")
        .note("I3, I4 and I6 are best left alone from then on")
        .note("<CTRL-Z> through the serial port sets I58=0 and makes that port the active one")
}

fn panel() -> FunctionPlan {
    FunctionPlan::new(Function::Panel)
        .set("I2=3", "requests come from the DPRAM; the switches at the JPAN connector are not read any more")
        .note("a feed rate from the DPRAM acts only while the system's Ix93 is $0806 + $C0*(x-1), its default")
        .note("PMAC clears the request mask; the mask of feed rates (0x0002) stays set until the host clears it")
}

fn reported(options: &Options) -> Result<String, OutOfRange> {
    Ok(format!("I59={}", in_range("motor", options.motors, 1, PMAC.motors as u32)?))
}

fn period(options: &Options) -> Result<String, OutOfRange> {
    Ok(format!("I19={}", in_range("period", options.period, 1, 8_388_607)?))
}

const I19_WHY: &str = "servo cycles between two servo reports, and between two gathered samples";
const I59_WHY: &str = "the highest motor and coordinate system in the servo and background reports";

fn servo(options: &Options) -> Result<FunctionPlan, OutOfRange> {
    Ok(FunctionPlan::new(Function::Servo)
        .set(period(options)?, I19_WHY)
        .set(reported(options)?, I59_WHY)
        .set("I48=1", "the next GATHER starts the servo report, not data gathering")
        .line(Phase::Start, "GATHER", "starts the report")
        .note("a GATHER while the report runs starts data gathering; ENDGATHER ends what was started last")
        .note("a reset ends the report: GATHER again, and I19 again on battery-backed boards")
        .note("a Host-Busy bit (0x0024 bit 0) left set holds the report off; the host clears it first"))
}

fn background(options: &Options) -> Result<FunctionPlan, OutOfRange> {
    Ok(FunctionPlan::new(Function::Background)
        .set(reported(options)?, I59_WHY)
        .set("I49=1", "a background report whenever the host has cleared Data-Ready (0x0228 bit 0)")
        .note("GATHER and ENDGATHER do not touch this report"))
}

fn variable() -> FunctionPlan {
    FunctionPlan::new(Function::Variables)
        .set(clear(classic::VARIABLE_READ_COUNT), "no entries to read: power-on leaves anything in this count")
        .set(
            clear(classic::VARIABLE_WRITE_COUNT),
            "no records to write: PMAC would carry left-over ones out at once, and one with address 0 trips its \
             watchdog",
        )
        .set("I55=1", "both the variable read and the variable write buffer")
        .note("where I55 is 1 already and tables are in use, this ends them; nothing needs to be sent then")
        .note("tables lie from $D200 on; keep them clear of gather and rotary buffers")
}

fn rotary(options: &Options) -> Result<FunctionPlan, OutOfRange> {
    let system = in_range("coordinate system", options.coordinate_system, 1, PMAC.coordinate_systems as u32)?;
    // Upper bound: all of PMAC's 48-bit program memory cannot be more.
    let words = in_range("rotary buffer size", options.rotary_words, 2, 0xFFFF)?;
    // The second location of the header: host index in Y, PMAC index in X.
    let host_index = classic::ROTARY_1.plus_words(2);
    Ok(FunctionPlan::new(Function::Rotary)
        .set("I57=0", "no transfer while the header is not set up")
        .set(clear(host_index), "the DPRAM buffer is empty: its host index ...")
        .set(
            clear(host_index.plus_words(1)),
            "... and PMAC's index are equal, whatever power-on left in them",
        )
        .line(
            Phase::Define,
            format!("&{system} DEFINE ROT {words}"),
            "the buffer in PMAC's own memory to which the commands are copied; lost at a reset",
        )
        .line(Phase::Define, format!("&{system} B0"), "points the coordinate system at it; before OPEN ROT")
        .line(
            Phase::Open,
            "I57=1",
            "transfers from the DPRAM; the host has filled in coordinate system, size and start before",
        )
        .line(
            Phase::Open,
            "OPEN ROT",
            "lets program lines in until CLOSE, text ones through any port as well: I57=1 would be one by now",
        )
        .note("with several coordinate systems define from the highest to the lowest")
        .note("no rotary buffer can be defined while a gather buffer exists: DELETE GATHER first")
        .note(format!("&{system} R starts the program; I16 and I17 say when the buffer asks for more")))
}

fn gather(options: &Options, with_servo: bool) -> Result<FunctionPlan, OutOfRange> {
    let room = (PMAC.length - classic::GATHER_BUFFER.bytes()) / 4;
    let size = in_range("gather buffer size", options.gather_longs, 1, room)?;
    let count = in_range("number of gather sources", options.gather_sources.len() as u32, 0, 24)?;
    let mut plan = FunctionPlan::new(Function::Gather).set(period(options)?, I19_WHY);
    plan = if options.gather_wrap {
        plan.set("I45=3", "into the DPRAM, from the start again when the buffer is full")
    } else {
        plan.set("I45=2", "into the DPRAM, until the buffer is full; then DEFINE GATHER is needed again")
    };
    let sample: u32 = options.gather_sources.iter().map(|source| source.longs()).sum();
    if count > 0 {
        plan = plan.set(
            format!("I20=${:06X}", (1_u32 << count) - 1),
            "which sources are gathered: bit k is I(21+k)",
        );
        for (n, source) in options.gather_sources.iter().enumerate() {
            in_range("address of a gather source", source.address().number, 0, PMAC.last_address())?;
            plan = plan.set(
                format!("I{}=${:06X}", 21 + n, source.gather_code()),
                format!("source {}: {source}", n + 1),
            );
        }
        let used = size.div_ceil(sample) * sample;
        in_range("gather buffer size, in whole samples,", used, sample, room)?;
        plan = plan.note(format!("a sample is {sample} longs; the buffer really takes {used} longs"));
    } else {
        plan = plan.note("I20 to I44 say what is gathered and are left as they are");
    }
    plan = plan
        .line(
            Phase::Define,
            format!("DEFINE GATHER {size}"),
            "the buffer's size in 32-bit words; refused while gathering runs",
        )
        .line(
            Phase::Start,
            "GATHER",
            if with_servo {
                "the second GATHER: starts gathering beside the servo report"
            } else {
                "starts gathering"
            },
        )
        .note("the buffer begins at $D200, with firmware 1.16C, 1.16D, 1.16G and 1.17C at $D240");
    if !with_servo {
        plan = plan.note(
            "with I48=1 and the servo report not running, the first GATHER starts that report; send GATHER once more",
        );
    }
    Ok(plan.note("each ENDGATHER ends what was started last"))
}
