//! How to switch the automatic functions on: the I-variables and commands that each function needs, in order, and why.
//!
//! Source: DPRAM manual, the "Enabling" section of each function (pp. 12-30); its control-panel page means I2 where it
//! prints I3, and I3, I4 and I6 are better left alone after I58 has set them. Turbo: User Manual p. 400-410, Software
//! Reference p. 37 and 170. The family gives the numbers, and the differences between the lines.

use serde::Serialize;

use crate::map::functions::{OPEN_BINARY, OPEN_TEXT, rotary_header};
use crate::map::{Family, Flag, Function, HostOffset, IVariables, PmacRegister, ReportStart};

/// How the functions shall work. The defaults fit most boards.
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
    /// The registers to gather; an empty list leaves I20 to I44 as they are.
    pub gather_sources: Vec<PmacRegister>,
    /// Whether the I-variables shall survive a reset.
    pub save: bool,
    /// Whether the servo report runs already, so that a `GATHER` would start data gathering.
    pub servo_runs: bool,
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
            servo_runs: false,
        }
    }
}

/// Why these options cannot enable a function.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EnableError {
    /// An option is not possible.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The family has no such function, or no I-variable for it.
    #[error("a {family} has no I-variable that enables {function}")]
    Missing {
        /// The function.
        function: Function,
        /// The family's name.
        family: &'static str,
    },
}

/// An option that no board can have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {value} is not possible; it is {first} to {last}")]
pub struct OutOfRange {
    /// Which option.
    pub what: &'static str,
    /// The requested value.
    pub value: u32,
    /// The smallest possible value.
    pub first: u32,
    /// The largest possible value.
    pub last: u32,
}

/// When in the sequence of all functions the user sends a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    /// Lines that set variables and registers.
    Set,
    /// Lines that define buffers.
    Define,
    /// Lines that start reports.
    Start,
    /// Lines that open a program buffer; from then on the board stores program lines in it.
    Open,
}

/// A line to send.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PlanLine {
    /// The on-line command.
    pub line: String,
    /// Its purpose and side effects.
    pub why: String,
    #[serde(skip)]
    phase: Phase,
}

/// The lines that one function needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FunctionPlan {
    /// Which.
    pub function: Function,
    /// Its lines, in order.
    pub lines: Vec<PlanLine>,
    /// Further facts and steps.
    pub notes: Vec<String>,
}

/// The lines that several functions need together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EnablePlan {
    /// All lines in the order to send them; a variable that several functions set appears once.
    pub commands: Vec<String>,
    /// Function by function.
    pub plans: Vec<FunctionPlan>,
}

/// Plans how to enable `functions` (their order and repetitions do not matter) on a board of `family`.
///
/// # Errors
/// [`EnableError`] when an option of one of them is not possible, or the family lacks one of them.
pub fn plan(functions: &[Function], options: &Options, family: &Family) -> Result<EnablePlan, EnableError> {
    let mut functions = functions.to_vec();
    functions.sort_unstable();
    functions.dedup();
    let together = functions.contains(&Function::Servo) && functions.contains(&Function::Gather);
    let mut plans = functions
        .iter()
        .map(|function| match function {
            Function::Ascii => Ok(ascii(options, family)),
            Function::Panel => panel(family),
            Function::Servo => Ok(servo(options, family)?),
            Function::Background => Ok(background(options, family)?),
            Function::Variables => Ok(variable(family)),
            Function::Rotary => rotary(options, family),
            Function::Gather => Ok(gather(options, family, together)?),
        })
        .collect::<Result<Vec<_>, _>>()?;
    // The first plan tells it for all.
    if let (Some(setting), Some(first)) = (family.dpram_setting(), plans.first_mut()) {
        first.notes.push(format!(
            "one DPRAM serves all functions. For this one {setting} is needed; the board sets it by itself at re-initialisation if it \
             finds this DPRAM"
        ));
    }
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
    // Each of these lines acts every time that the user sends it: two GATHERs are not one.
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
fn clear(family: &Family, offset: HostOffset) -> String {
    format!("W{}{},0", family.half(offset), family.print_number(family.pmac_number(offset)))
}

/// A word as a note names it, `0x062C (Y:$D18B)`.
fn named(family: &Family, offset: HostOffset) -> String {
    format!("{offset} ({}:{})", family.half(offset), family.print_number(family.pmac_number(offset)))
}

fn ascii(options: &Options, family: &Family) -> FunctionPlan {
    let enable = family.i.ascii_enable;
    let plan = FunctionPlan::new(Function::Ascii);
    let plan = if family.ascii.goes_by_i3 {
        plan.set("I3=2", "replies end with <ACK>, so that the host knows their last line").set(
            format!("I{enable}=1"),
            "command lines through the DPRAM; forces I3 (1 becomes 0, 3 becomes 2; always 2 before firmware 1.15), \
             I4=0 (no checksums) and I6=1 (errors as <BELL>ERRnnn) on every port",
        )
    } else {
        plan.set(format!("I{enable}=1"), "command lines through the DPRAM")
    };
    let plan = if options.interrupt {
        plan.set(
            format!("I{}=1", family.i.interrupt),
            "an interrupt for every response in the DPRAM (by a jumper of the board, or VME vector v+1)",
        )
    } else {
        plan
    };
    let [command, response] =
        [family.ascii.command_loaded.word, family.ascii.response_control].map(|word| named(family, word));
    let plan =
        plan.note(format!("before I{enable}=1 the host clears both control words, {command} and {response}"));
    if !family.ascii.goes_by_i3 {
        return plan;
    }
    plan.note("I3, I4 and I6 are best left alone from then on")
        .note(format!("<CTRL-Z> through the serial port sets I{enable}=0 and makes that port the active one"))
}

fn missing(function: Function, family: &Family) -> EnableError {
    EnableError::Missing { function, family: family.title }
}

fn panel(family: &Family) -> Result<FunctionPlan, EnableError> {
    let (Some(enable), Some(block)) = (family.i.panel, &family.panel) else {
        return Err(missing(Function::Panel, family));
    };
    let (time_base, stride) = (family.print_number(block.time_base.number), family.system_source_stride);
    Ok(FunctionPlan::new(Function::Panel)
        .set(
            clear(family, block.request_enable),
            "no requests: power-on leaves anything in this mask, and motors would jog by it",
        )
        .set(
            clear(family, block.override_enable),
            "no feed rates from the DPRAM: power-on leaves anything there, up to 225 %; ends those that are set",
        )
        .set(
            format!("I{enable}=3"),
            "requests come from the DPRAM; the switches at the JPAN connector are not read any more",
        )
        .note(format!(
            "a feed rate from the DPRAM acts only while the system's Ix93 is {time_base} + ${stride:X}*(x-1), its default"
        ))
        .note(format!(
            "PMAC clears the request mask; the mask of feed rates ({}) stays set until the host clears it",
            block.override_enable
        )))
}

/// Sets how many motors and coordinate systems the board reports, if an I-variable sets that.
fn reported(plan: FunctionPlan, options: &Options, family: &Family) -> Result<FunctionPlan, OutOfRange> {
    let motors = in_range("motor", options.motors, 1, family.motors as u32)?;
    Ok(match family.i.reported {
        Some(number) => plan.set(
            format!("I{number}={motors}"),
            "the highest motor and coordinate system in the servo and background reports",
        ),
        None => plan,
    })
}

/// Sets the servo cycles from one report or sample to the next.
fn period(
    plan: FunctionPlan,
    options: &Options,
    family: &Family,
    variable: u16,
) -> Result<FunctionPlan, OutOfRange> {
    let cycles = in_range("period", options.period, 1, 8_388_607)?;
    let IVariables { servo_period, gather_period, .. } = family.i;
    let why = match (servo_period == gather_period, variable == servo_period) {
        (true, _) => "servo cycles between two servo reports, and between two gathered samples",
        (false, true) => "servo cycles between two servo reports",
        (false, false) => "servo cycles between two gathered samples",
    };
    Ok(plan.set(format!("I{variable}={cycles}"), why))
}

fn servo(options: &Options, family: &Family) -> Result<FunctionPlan, OutOfRange> {
    let i = &family.i;
    let plan = period(FunctionPlan::new(Function::Servo), options, family, i.servo_period)?;
    let plan = reported(plan, options, family)?;
    let plan = match i.servo_in_background {
        Some(number) => plan.set(
            format!("I{number}=0"),
            format!("the report is made every so many servo cycles; 1 would switch I{} off", i.servo_enable),
        ),
        None => plan,
    };
    let enable = format!("I{}=1", i.servo_enable);
    let plan = match family.servo.start {
        ReportStart::Gather => start_by_gather(
            plan.set(enable, "the next GATHER starts the servo report, not data gathering"),
            options,
            i.servo_period,
        ),
        ReportStart::Enable => plan.set(enable, "starts the report").note("a reset ends it, unless saved"),
    };
    let plan = match family.servo.mask {
        Some(mask) => plan.note(format!(
            "which motors are reported says the mask at {}, which the host writes",
            named(family, mask)
        )),
        None => plan,
    };
    Ok(plan.note(format!(
        "a Host-Busy bit ({}) left set holds the report off; the host clears it first",
        flag(family.servo.host_busy)
    )))
}

/// Starts the servo report by a `GATHER`, unless the report runs.
fn start_by_gather(plan: FunctionPlan, options: &Options, servo_period: u16) -> FunctionPlan {
    let plan = if options.servo_runs {
        plan.note("the report runs already: GATHER is left out, it would start data gathering")
    } else {
        plan.line(Phase::Start, "GATHER", "starts the report").note(
            "a GATHER while the report runs starts data gathering; ENDGATHER ends what was started last",
        )
    };
    plan.note(format!(
        "a reset ends the report: GATHER again, and I{servo_period} again on battery-backed boards"
    ))
}

/// A flag as a note names it, `0x0024 bit 0`.
fn flag(flag: Flag) -> String {
    format!("{} bit {}", flag.word, flag.mask.trailing_zeros())
}

fn background(options: &Options, family: &Family) -> Result<FunctionPlan, OutOfRange> {
    let plan = reported(FunctionPlan::new(Function::Background), options, family)?;
    let plan = match family.i.background_period {
        Some(number) => plan.set(format!("I{number}=0"), "reports on request, not by themselves"),
        None => plan,
    };
    let plan = match family.background.count {
        Some(count) => plan.note(format!(
            "how many coordinate systems are reported says {}, which the host writes",
            named(family, count)
        )),
        None => plan.note("GATHER and ENDGATHER do not touch this report"),
    };
    Ok(plan.set(
        format!("I{}=1", family.i.background_enable),
        format!(
            "a background report whenever the host has cleared Data-Ready ({})",
            flag(family.background.ready)
        ),
    ))
}

fn variable(family: &Family) -> FunctionPlan {
    let enable = family.i.variables_enable;
    FunctionPlan::new(Function::Variables)
        .set(
            clear(family, family.variable_read.count),
            "no entries to read: power-on leaves anything in this count",
        )
        .set(
            clear(family, family.variable_write.count),
            "no records to write: PMAC would carry left-over ones out at once, and one with address 0 may trip its watchdog",
        )
        .set(format!("I{enable}=1"), "both the variable read and the variable write buffer")
        .note(format!(
            "where I{enable} is 1 already and tables are in use, this ends them; nothing needs to be sent then"
        ))
        .note(format!(
            "tables lie from {} on; keep them clear of gather and rotary buffers",
            family.print_number(family.pmac_number(family.user_area.start))
        ))
}

fn rotary(options: &Options, family: &Family) -> Result<FunctionPlan, EnableError> {
    let rotary = &family.rotary;
    let systems = family.coordinate_systems as u32;
    let system = in_range("coordinate system", options.coordinate_system, 1, systems)?;
    // Upper bound: all of PMAC's 48-bit program memory cannot be more.
    let words = in_range("rotary buffer size", options.rotary_words, 2, 0xFFFF)?;
    let own = rotary.index_for(system as usize);
    let Some(header) = rotary.headers.get(own) else { return Err(missing(Function::Rotary, family)) };
    let plan = FunctionPlan::new(Function::Rotary);
    let plan = match family.i.rotary_enable {
        Some(enable) => plan.set(format!("I{enable}=0"), "no transfer while the headers are not set up"),
        None => plan,
    };
    let others = rotary.headers.iter().enumerate().filter(|(index, _)| *index != own);
    let unused = others.map(|(_, header)| clear(family, header.plus_words(rotary_header::SIZE)));
    let plan = unused.fold(plan, |plan, line| {
        plan.set(line, "another buffer is not in use: PMAC would take whatever power-on left for commands")
    });
    let index = |word: usize| clear(family, header.plus_words(word));
    let plan = plan
        .set(index(rotary_header::HOST_INDEX), "the DPRAM buffer is empty: its host index ...")
        .set(
            index(rotary_header::PMAC_INDEX),
            "... and PMAC's index are equal, whatever power-on left in them",
        )
        .line(
            Phase::Define,
            format!("&{system} DEFINE ROT {words}"),
            "the buffer in PMAC's own memory to which the commands are copied; lost at a reset",
        )
        .line(
            Phase::Define,
            format!("&{system} B0"),
            format!("points the coordinate system at it; before {OPEN_BINARY}"),
        );
    let plan = match family.i.rotary_enable {
        Some(enable) => plan.line(
            Phase::Open,
            format!("I{enable}=1"),
            "transfers from the DPRAM; the host has filled in coordinate system, size and start before",
        ),
        None => plan,
    };
    Ok(plan
        .line(
            Phase::Open,
            OPEN_BINARY,
            format!("lets binary lines in until CLOSE; a board that answers it with an error takes {OPEN_TEXT}, which lets text in too"),
        )
        .note("with several coordinate systems define from the highest to the lowest")
        .note("no rotary buffer can be defined while a gather buffer exists: DELETE GATHER first")
        .note(format!("&{system} R starts the program; I16 and I17 say when the buffer asks for more")))
}

fn gather(options: &Options, family: &Family, with_servo: bool) -> Result<FunctionPlan, OutOfRange> {
    let i = &family.i;
    let by_gather = family.servo.start == ReportStart::Gather;
    let room = family.length.saturating_sub(family.gather.buffer.bytes()) / 4;
    let size = in_range("gather buffer size", options.gather_longs, 1, room)?;
    let count = in_range(
        "number of gather sources",
        options.gather_sources.len() as u32,
        0,
        i.most_gather_sources() as u32,
    )?;
    let mut plan = period(FunctionPlan::new(Function::Gather), options, family, i.gather_period)?;
    let mode = i.gather_mode;
    plan = if options.gather_wrap {
        plan.set(format!("I{mode}=3"), "into the DPRAM, from the start again when the buffer is full")
    } else {
        plan.set(
            format!("I{mode}=2"),
            "into the DPRAM, until the buffer is full; then DEFINE GATHER is needed again",
        )
    };
    let sample: u32 = options.gather_sources.iter().map(|source| source.longs()).sum();
    if count > 0 {
        for source in &options.gather_sources {
            in_range("address of a gather source", source.address().number, 0, family.last_address())?;
        }
        let codes: Vec<u32> = options.gather_sources.iter().map(|source| source.gather_code()).collect();
        for (number, value) in i.gather_settings(&codes) {
            let index = number.checked_sub(i.gather_sources).map(usize::from);
            let why = match index.and_then(|index| Some((index, options.gather_sources.get(index)?))) {
                Some((index, source)) => format!("source {}: {source}", index + 1),
                None => format!("which sources are gathered: bit k is I({}+k)", i.gather_sources),
            };
            plan = plan.set(format!("I{number}=${value:06X}"), why);
        }
        let used = size.div_ceil(sample) * sample;
        in_range("gather buffer size, in whole samples,", used, sample, room)?;
        plan = plan.note(format!("a sample is {sample} longs; the buffer really takes {used} longs"));
    } else {
        plan = plan.note("the sources and their masks say what is gathered and are left as they are");
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
            match (by_gather && with_servo, by_gather && options.servo_runs) {
                (_, true) => "starts gathering beside the servo report",
                (true, false) => "the second GATHER: starts gathering beside the servo report",
                (false, false) => "starts gathering",
            },
        )
        .note(gather_start(family));
    if by_gather && !with_servo && !options.servo_runs {
        plan = plan.note(format!(
            "with I{}=1 and the servo report not running, the first GATHER starts that report; send GATHER once more",
            i.servo_enable
        ));
    }
    Ok(if by_gather { plan.note("each ENDGATHER ends what was started last") } else { plan })
}

/// Where the gather buffer begins, with every firmware.
fn gather_start(family: &Family) -> String {
    let buffer = family.gather.buffer;
    let at = |offset: HostOffset| family.print_number(family.pmac_number(offset));
    let printed = format!("the buffer begins at {}", at(buffer));
    match family.gather_moved_since {
        None => printed,
        Some(since) => {
            let moved = at(buffer.plus_words(family.gather_shift as usize / 2));
            format!("{printed}, from firmware {since} on at {moved}")
        }
    }
}
