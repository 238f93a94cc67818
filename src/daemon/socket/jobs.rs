//! The calls that ask for a [`Job`]: their parameters, the role that they need, and their needs on the board.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use super::order::Order;
use crate::daemon::motion::effect::Starts;
use crate::daemon::motion::target::Target;
use crate::daemon::motion::timing::PANEL_STOP_TAKES;
use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::{Job, MaskedWord};
use crate::daemon::shared::parameters::{check_number, inside, rotary_buffer};
use crate::daemon::shared::status::Enabling;
use crate::function::panel::{FeedOverride, PanelAction, PanelRequest};
use crate::function::variable_read::VariableEntry;
use crate::function::variable_write::WriteRecord;
use crate::map::functions::VARIABLE_READ_ENTRIES;
use crate::map::{Family, Firmware, Motors, PmacAddress, Systems, VariableKind, VariableName, VariableRead};
use crate::protocol::board::{BoardInfo, VariableRecord};
use crate::protocol::{CallError, answer, calls};

/// How long the board may take to act on a panel request.
const PANEL_TIMEOUT: Duration = Duration::from_secs(1);
/// How long a job may take that the bus thread does in one pass.
const SHORT: Duration = Duration::from_secs(1);
/// How long a batch of rotary lines may wait for room when its caller does not say.
const ROTARY_TIMEOUT_MS: u64 = 60_000;
/// How long PMAC may take to write variables when the caller does not say.
const WRITE_TIMEOUT_MS: u64 = 5_000;
/// The most records of one call.
const RECORDS_MAX: usize = 1024;
/// The most words of one write, and the most commands of one batch of rotary lines.
const WRITE_MAX: usize = 64;
const COMMANDS_MAX: usize = 4096;

/// A job's need on the board: an I-variable and the value that the job needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guard {
    /// The number of the I-variable.
    variable: u16,
    /// The value.
    value: &'static str,
    /// What the value switches on.
    purpose: &'static str,
    /// Whether the variable has the value, if the daemon has asked the board since the value may have changed.
    known: fn(Enabling) -> Option<bool>,
    /// The board shows a wrong value at once: it does not take the request. If false, and the last answer is old, the
    /// daemon asks the board first: another host may have changed the value.
    shows: bool,
}

/// How long the daemon believes an answer of the board if nothing else confirms it.
const BELIEVED: Duration = Duration::from_secs(1);

/// The guard of the control panel, if an I-variable switches the panel on.
fn panel_enabled(family: &Family) -> Option<Guard> {
    family.i.panel.map(|variable| Guard {
        variable,
        value: "3",
        purpose: "the DPRAM control panel",
        known: |enabling| enabling.panel,
        shows: true,
    })
}

/// The guard of every use of background variables.
pub(super) fn variables_enabled(family: &Family) -> Guard {
    Guard {
        variable: family.i.variables_enable,
        value: "1",
        purpose: "background variable data",
        known: |enabling| enabling.variables,
        shows: false,
    }
}

/// The source of a coordinate system's time base, which decides whether an override has an effect.
#[derive(Debug, Clone, Copy)]
struct TimeBase {
    coordinate_system: usize,
    /// The number of the coordinate system's Ix93.
    variable: usize,
    /// The address that takes the panel's override: Ix93 must have this value.
    register: PmacAddress,
}

impl TimeBase {
    fn of(coordinate_system: usize, family: &Family) -> Option<Self> {
        let register = family.override_register(coordinate_system)?;
        let exists = (1..=family.coordinate_systems).contains(&coordinate_system);
        let variable = family.i.time_base(coordinate_system);
        exists.then_some(Self { coordinate_system, variable, register })
    }
}

/// The step of a call for a job.
#[derive(Debug)]
pub enum JobAt {
    /// The daemon has yet to do this job. It may check the guard on the board first.
    Wanted(Job),
    /// The bus thread does the job.
    UnderWay,
    /// The job is done, and the daemon checks on the board whether the job has an effect.
    Done,
    /// The job was not done, or not completely, for this reason; the daemon checks the guard on the board.
    Failed(CallError),
}

/// A client's call for a job.
#[derive(Debug)]
pub struct JobCall {
    /// The call's step.
    pub at: JobAt,
    /// How long the job may take.
    pub timeout: Duration,
    pub(super) guard: Option<Guard>,
    /// The job only stops something: the role stop may call it, and the daemon checks the guard only after the job.
    pub(super) stops: bool,
    /// The target of the stop, if a command line can stop it where the panel does not.
    pub(super) target: Option<Target>,
    /// The time base that decides the job's effect; the daemon asks for it together with the guard.
    time_base: Option<TimeBase>,
    /// Remarks for the caller, if the reply has room for some.
    pub(super) notes: Option<Vec<String>>,
    /// The rotary buffer that the job feeds: only the owner of its stream may feed it.
    pub(super) feeds: Option<usize>,
    /// The motors to stop when the caller is gone or silent.
    pub(super) lease: Option<Motors>,
    /// The motors that the job sets in motion; no other client may hold them.
    pub(super) moves: Motors,
    /// The programs that the job starts.
    pub(super) starts: Starts,
    /// The job's entry in the audit log, if the job can move a machine or change a register.
    pub(super) audit: Option<String>,
}

impl Guard {
    /// The question to ask the board.
    pub(super) fn question(self) -> String {
        format!("I{}", self.variable)
    }

    /// Whether the daemon knows at `now` that the variable has the value.
    pub(super) fn is_known(self, enabling: Enabling, now: Instant) -> bool {
        let is_new = enabling.asked.is_some_and(|asked| now.saturating_duration_since(asked) < BELIEVED);
        (self.known)(enabling) == Some(true) && (self.shows || is_new)
    }

    /// Checks the value in the board's `answers`: whether the job may begin.
    pub(super) fn check(self, answers: Option<&[String]>) -> Result<(), CallError> {
        let Self { variable, value, purpose, .. } = self;
        match answers.and_then(|answers| answers.first()) {
            Some(found) if found != value => Err(CallError::refused(format!(
                "I{variable} is {found}, and {purpose} needs {value}; send I{variable}={value} first"
            ))),
            _ => Ok(()),
        }
    }
}

impl JobCall {
    /// Whether the daemon asks the board something besides the guard's question.
    pub(super) fn has_question(&self) -> bool {
        self.time_base.is_some()
    }

    /// The question to ask the board first.
    pub(super) fn question(&self, guard: Guard) -> String {
        match self.time_base {
            Some(TimeBase { variable, .. }) => format!("{} I{variable}", guard.question()),
            None => guard.question(),
        }
    }

    /// Takes the board's answers to [`Self::question`], `None` if the daemon could not ask.
    ///
    /// # Errors
    /// Why the daemon does not do the job.
    pub(super) fn take_answers(&mut self, answers: Option<&[String]>) -> Result<(), CallError> {
        let guard = self.guard.take();
        match (guard, answers) {
            (Some(guard), None) => self.note_unasked(guard),
            (_, answers) => self.note_time_base(answers.and_then(|answers| answers.get(1))),
        }
        guard.map_or(Ok(()), |guard| guard.check(answers))
    }

    /// As [`Self::take_answers`], for a job done before the question: returns every remark.
    pub(super) fn into_notes(mut self, answers: Option<&[String]>) -> Vec<String> {
        if let Err(reason) = self.take_answers(answers) {
            self.note(format!("this has no effect: {reason}"));
        }
        self.notes.unwrap_or_default()
    }

    /// Adds a remark if the coordinate system takes its time base from elsewhere than the override.
    fn note_time_base(&mut self, answer: Option<&String>) {
        let (Some(TimeBase { coordinate_system, variable, register }), Some(answer)) =
            (self.time_base, answer)
        else {
            return;
        };
        let register = register.number;
        if answer::integer(answer) != Some(register.into()) {
            self.note(format!(
                "the override has no effect: I{variable} is {answer}, and &{coordinate_system} takes its time base from there; \
                 I{variable}=${register:X} is where the panel's override goes"
            ));
        }
    }

    /// Adds a remark that the daemon could not ask the board.
    pub(super) fn note_unasked(&mut self, guard: Guard) {
        let (question, value) = (self.question(guard), guard.value);
        let base = self.time_base.map_or_else(String::new, |TimeBase { variable, register, .. }| {
            format!(" and I{variable}=${:X}", register.number)
        });
        self.note(format!(
            "{question} could not be asked (a program buffer is open, where the question would be a program line, or the \
             board does not answer): this has an effect only while {}={value}{base}",
            guard.question()
        ));
    }

    fn note(&mut self, note: String) {
        if let Some(notes) = &mut self.notes {
            notes.push(note);
        }
    }

    fn new(job: Job, timeout: Duration) -> Self {
        Self {
            at: JobAt::Wanted(job),
            timeout,
            guard: None,
            stops: false,
            target: None,
            time_base: None,
            notes: None,
            feeds: None,
            lease: None,
            moves: Motors::NONE,
            starts: Starts::default(),
            audit: None,
        }
    }
}

/// The action of a panel request, once its numbers are known to exist in the family.
fn panel_action(call: &calls::Panel, family: &Family) -> Result<PanelAction, CallError> {
    let calls::Panel { action, numbers, .. } = call;
    let action: PanelAction = action.parse().map_err(|why| CallError::invalid("action", why))?;
    let count = if action.is_for_motors() { family.motors } else { family.coordinate_systems };
    if numbers.is_empty() {
        return Err(CallError::invalid("numbers", format_args!("1 to {count}, at least one of them")));
    }
    numbers.iter().try_for_each(|number| check_number(*number, count, "numbers"))?;
    Ok(action)
}

/// The order for a panel request that the caller wants `by_line`, if it is one for which a line stands.
pub(super) fn order(call: &calls::Panel, family: &Family) -> Result<Option<Order>, CallError> {
    let action = panel_action(call, family)?;
    if call.by_line != Some(true) {
        return Ok(None);
    }
    let order = Order::of_panel(action, call.numbers[0], call.confirmed == Some(true));
    if order.is_some() && call.numbers.len() > 1 {
        return Err(CallError::invalid("numbers", "one at a time by line"));
    }
    Ok(order)
}

/// The target that `action` stops for these `numbers`.
fn stopped_by(action: PanelAction, numbers: &[usize]) -> Option<Target> {
    let numbers = numbers.iter().copied();
    match action {
        PanelAction::JogStop => Some(Target::Motors(numbers.collect())),
        PanelAction::Stop => Some(Target::Systems(numbers.collect(), 'A')),
        PanelAction::Hold => Some(Target::Systems(numbers.collect(), 'H')),
        _ => None,
    }
}

/// The target of a panel request and its entry in the audit log; `None` if the request stops nothing.
pub(super) fn stop_by_line(
    call: calls::Panel,
    family: &Family,
) -> Result<Option<(Target, String)>, CallError> {
    let action = panel_action(&call, family)?;
    let numbers = call.numbers;
    let audit = format!("panel {action} {numbers:?}, by command line");
    Ok(stopped_by(action, &numbers).map(|target| (target, audit)))
}

/// A control panel request; with `hold`, a lease ends the jog.
pub(super) fn panel(call: calls::Panel, hold: bool, family: &Family) -> Result<JobCall, CallError> {
    let action = panel_action(&call, family)?;
    let calls::Panel { numbers, confirmed, by_line, .. } = call;
    if hold && by_line == Some(true) {
        return Err(CallError::invalid("by_line", "null: the panel alone holds a jog"));
    }
    let Some(words) = &family.panel else {
        return Err(CallError::refused(format!("a {} has no control panel in its DPRAM", family.title)));
    };
    let request = PanelRequest::of(words, action, &numbers).map_err(CallError::refused)?;
    if hold && !matches!(action, PanelAction::JogMinus | PanelAction::JogPlus) {
        return Err(CallError::invalid("action", "jog- or jog+: nothing else can be held"));
    }
    let held = if hold { ", held" } else { "" };
    // A stop does not wait for a question behind other users' lines.
    let stops = matches!(action, PanelAction::JogStop | PanelAction::Stop | PanelAction::Hold);
    let target = stopped_by(action, &numbers);
    let motors = if action.is_for_motors() { Motors::from_bits(request.mask()) } else { Motors::NONE };
    let starts = matches!(action, PanelAction::Start | PanelAction::Step);
    let timeout = if stops { PANEL_STOP_TAKES } else { PANEL_TIMEOUT };
    Ok(JobCall {
        guard: panel_enabled(family).filter(|_| !stops),
        stops,
        target,
        lease: hold.then_some(motors),
        moves: if stops { Motors::NONE } else { motors },
        starts: Starts {
            systems: Systems::from_bits(if starts { request.mask() } else { 0 }),
            confirmed: confirmed == Some(true),
        },
        audit: Some(format!("panel {action} {numbers:?}{held}")),
        ..JobCall::new(Job::Panel(request), timeout)
    })
}

/// Sets or releases the feed rate override of a coordinate system.
pub(super) fn feed_override(call: calls::FeedOverride, family: &Family) -> Result<JobCall, CallError> {
    let calls::FeedOverride { coordinate_system, raw } = call;
    check_number(coordinate_system, family.coordinate_systems, "coordinate_system")?;
    let value = raw.map(FeedOverride::from_raw).transpose().map_err(|why| CallError::invalid("raw", why))?;
    let audit = match raw {
        Some(raw) => format!("feed rate override of &{coordinate_system} to {raw}"),
        None => format!("feed rate override of &{coordinate_system} released"),
    };
    Ok(JobCall {
        guard: value.and_then(|_| panel_enabled(family)),
        time_base: value.and_then(|_| TimeBase::of(coordinate_system, family)),
        stops: raw == Some(0),
        notes: Some(Vec::new()),
        audit: Some(audit),
        ..JobCall::new(Job::Override { coordinate_system, value }, SHORT)
    })
}

/// Words of the DPRAM to write.
pub(super) fn write(call: calls::Write, family: &Family) -> Result<JobCall, CallError> {
    let calls::Write { host_offset, words: values, masks, anywhere } = call;
    let masks = masks.unwrap_or_else(|| vec![u16::MAX; values.len()]);
    if values.is_empty() || values.len() > WRITE_MAX {
        return Err(CallError::invalid("words", format_args!("1 to {WRITE_MAX} values")));
    }
    if masks.len() != values.len() {
        return Err(CallError::invalid("masks", "as many values as words has"));
    }
    let first = inside(host_offset, values.len(), "host_offset", family)?;
    let words: Vec<MaskedWord> =
        values.iter().zip(&masks).map(|(&value, &mask)| MaskedWord { value, mask }).collect();
    Ok(JobCall {
        audit: Some(format!("write {first} = {values:04X?} mask {masks:04X?}")),
        ..JobCall::new(Job::Write { first, words, anywhere: anywhere.unwrap_or(false) }, SHORT)
    })
}

/// The registers and function blocks a watch names.
pub(super) fn watched(call: calls::WatchVariables, info: &Info) -> Result<Vec<VariableEntry>, CallError> {
    let calls::WatchVariables { registers } = call;
    let count = registers.len();
    if !(1..=VARIABLE_READ_ENTRIES).contains(&count) {
        let expected = format_args!("1 to {VARIABLE_READ_ENTRIES} registers, not {count}");
        return Err(CallError::invalid("registers", expected));
    }
    registers
        .iter()
        .map(|text| {
            let name = VariableName::parse(text, info.family());
            let name = name.map_err(|why| CallError::invalid("registers", why))?;
            knows(name, info)?;
            let entry = VariableEntry::from(name);
            is_told(text, entry, info)?;
            Ok(entry)
        })
        .collect()
}

/// Checks that the board writes variables, as far as the daemon knows its firmware ("available starting with firmware
/// version 1.15G", DPRAM manual p. 24).
///
/// # Errors
/// The board's family does not write variables, or its firmware is older.
pub(super) fn check_writes(board: &BoardInfo, family: &Family) -> Result<(), CallError> {
    let Some(since) = family.variable_write.since else {
        return Err(CallError::refused(format!(
            "no text tells how a {} reads the records to write, and a wrong guess writes another register: send a line instead \
             (`WX$ADDRESS,VALUE`, `WY$ADDRESS,VALUE`, `WL$ADDRESS,VALUE` for 48 bits, or `M...=VALUE`)",
            family.title
        )));
    };
    let known = |text: &str| text.parse::<Firmware>().ok();
    match board.firmware.as_deref().and_then(known).zip(known(since)) {
        Some((firmware, since)) if firmware < since => Err(CallError::refused(format!(
            "the board's firmware is {firmware}, and PMAC writes variables from {since} on; send a line instead"
        ))),
        _ => Ok(()),
    }
}

/// Refuses a register whose high address bits no manual places: a wrong guess would read another register without a
/// sign.
fn is_told(text: &str, entry: VariableEntry, info: &Info) -> Result<(), CallError> {
    if entry.address < VariableRead::ADDRESSES {
        return Ok(());
    }
    let family = info.family();
    let number = family.print_number(entry.address);
    let letter = match entry.kind {
        VariableKind::X => 'X',
        VariableKind::Y => 'Y',
        VariableKind::Long | VariableKind::Special => 'L',
    };
    Err(CallError::refused(format!(
        "{text}: no text tells how a {} takes the address of a register to watch from {} on; send `R{letter}{number}` instead",
        family.title,
        family.print_number(VariableRead::ADDRESSES)
    )))
}

/// Refuses a function block unless the daemon knows that the board's firmware has function blocks: an older firmware
/// would take the block's number for an address.
fn knows(name: VariableName, info: &Info) -> Result<(), CallError> {
    let VariableName::Block { .. } = name else { return Ok(()) };
    let family = info.family();
    let Some(since) = family.function_blocks_since else {
        return Err(CallError::refused(format!(
            "{name}: no manual tells of function blocks on a {}",
            family.title
        )));
    };
    let firmware = info.board().firmware.as_deref();
    match firmware.and_then(|firmware| firmware.parse::<Firmware>().ok()) {
        Some(known) if known >= since => Ok(()),
        Some(known) => Err(CallError::refused(format!(
            "{name}: function blocks need firmware {since}; the board has {known}"
        ))),
        None => Err(CallError::refused(format!(
            "{name}: function blocks need firmware {since}, and the board has not told its own; write firmware = \"{since}\" into \
             pmacd's configuration if it has it"
        ))),
    }
}

/// Registers for PMAC to write.
pub(super) fn write_variables(call: calls::WriteVariables, info: &Info) -> Result<JobCall, CallError> {
    let calls::WriteVariables { records, timeout_ms } = call;
    if records.is_empty() || records.len() > RECORDS_MAX {
        return Err(CallError::invalid("records", format_args!("1 to {RECORDS_MAX} records")));
    }
    let mut audit = String::from("variable write");
    for VariableRecord { register, value, .. } in &records {
        if let Ok(name) = register.parse() {
            knows(name, info)?;
        }
        let _ = write!(audit, " {register}={value}");
    }
    let records = records.iter().map(|record| WriteRecord::of(record, info.family()));
    let records: Vec<WriteRecord> =
        records.collect::<Result<_, _>>().map_err(|why| CallError::invalid("records", why))?;
    Ok(JobCall {
        guard: Some(variables_enabled(info.family())),
        audit: Some(audit),
        ..JobCall::new(
            Job::WriteVariables(records),
            Duration::from_millis(timeout_ms.unwrap_or(WRITE_TIMEOUT_MS)),
        )
    })
}

/// Asks for the state of a rotary buffer.
pub(super) fn rotary_state(call: calls::Rotary, family: &Family) -> Result<JobCall, CallError> {
    rotary_buffer(call.buffer, family).map(|buffer| JobCall::new(Job::RotaryState(buffer), SHORT))
}

/// Lines for a rotary buffer.
pub(super) fn rotary_send(call: calls::RotarySend, family: &Family) -> Result<JobCall, CallError> {
    let calls::RotarySend { buffer, lines, first, timeout_ms } = call;
    let buffer = rotary_buffer(buffer, family)?;
    let words = lines.iter().map(|line| line.words.len());
    if words.clone().sum::<usize>() > 2 * COMMANDS_MAX || words.clone().any(|count| !count.is_multiple_of(2))
    {
        return Err(CallError::invalid(
            "lines",
            format_args!("two words a command, {COMMANDS_MAX} commands at most"),
        ));
    }
    let commands = |words: &[u32]| words.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    let lines = lines.iter().map(|line| commands(&line.words)).collect();
    let timeout = Duration::from_millis(timeout_ms.unwrap_or(ROTARY_TIMEOUT_MS));
    Ok(JobCall {
        // One entry a program: later batches carry a `first` above 0.
        feeds: Some(buffer),
        audit: first.is_none_or(|first| first == 0).then(|| "sends a rotary program".to_owned()),
        ..JobCall::new(Job::RotarySend { buffer, first, lines }, timeout)
    })
}
