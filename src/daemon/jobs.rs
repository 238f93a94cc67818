//! The calls that ask for a [`Job`]: their parameters, the role they need, and what must be so on the board first.

use std::time::Duration;

use serde_json::Value;

use super::job::{Job, MaskedWord};
use super::policy::Role;
use crate::function::gather::GatherBuffer;
use crate::function::panel::{FeedOverride, PanelAction, PanelRequest};
use crate::function::rotary::RotaryBuffer;
use crate::function::variable_read::{VariableEntry, VariableKind, VariableReadError};
use crate::function::variable_write::{WordKind, WriteRecord};
use crate::gather::GatherMode;
use crate::map::{GatherPlace, HostOffset, PmacAddress, Space, classic};
use crate::mirror::GatherClock;
use crate::protocol::board::VariableRecord;
use crate::protocol::{CallError, Parameters};
use crate::setup::gather_source::GatherSource;

/// How long the board may take to act on a panel request.
const PANEL_TIMEOUT: Duration = Duration::from_secs(1);
/// How long a job may take that is done in one pass.
const SHORT: Duration = Duration::from_secs(1);
/// How long a batch of rotary lines may wait for room when its caller does not say, and at most.
const ROTARY_TIMEOUT_MS: u64 = 60_000;
const ROTARY_TIMEOUT_MAX_MS: u64 = 3_600_000;
/// How long PMAC may take to write variables when the caller does not say, and at most.
const WRITE_TIMEOUT_MS: u64 = 5_000;
const WRITE_TIMEOUT_MAX_MS: u64 = 600_000;
/// The most records of one call.
const RECORDS_MAX: usize = 1024;
/// The most words of one write, and the most commands of one batch of rotary lines.
const WRITE_MAX: usize = 64;
const COMMANDS_MAX: usize = 4096;

/// What must be so on the board before a job makes sense: an I-variable and the value it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Guard {
    /// The query, as `I2`.
    pub(super) variable: &'static str,
    /// The value.
    pub(super) value: &'static str,
    /// What it is for.
    pub(super) purpose: &'static str,
    /// Without the answer the job is not done: it could do harm, and does not show by itself that it did.
    pub(super) is_required: bool,
}

const PANEL_ENABLED: Guard =
    Guard { variable: "I2", value: "3", purpose: "the DPRAM control panel", is_required: false };
const VARIABLES_ENABLED: Guard =
    Guard { variable: "I55", value: "1", purpose: "background variable data", is_required: false };
// The header must not change under a transfer (DPRAM manual p. 30), and OPEN ROT, which is in force then, is just what
// keeps the board from being asked.
const ROTARY_AT_REST: Guard =
    Guard { variable: "I57", value: "0", purpose: "setting a rotary buffer up", is_required: true };

/// A job as it was called for.
#[derive(Debug)]
pub struct JobCall {
    /// What to do.
    pub job: Job,
    /// How long it may take.
    pub timeout: Duration,
    pub(super) guard: Option<Guard>,
    /// The coordinate system whose Ix93 has a say in the effect; asked together with the guard.
    pub(super) time_base: Option<usize>,
    /// Remarks for the caller, if the reply has room for some.
    pub(super) notes: Option<Vec<String>>,
    /// The motors to stop when the caller is gone or silent.
    pub(super) lease: Option<PanelRequest>,
    /// What the audit log says of it, if it can move a machine or change a register.
    pub(super) audit: Option<String>,
}

impl Guard {
    /// Why a job is not done whose guard has not been answered.
    pub(super) fn unanswered(self) -> CallError {
        let Self { variable, value, purpose, .. } = self;
        refused(format!(
            "{variable} could not be asked (a program buffer is open, where the question would be a program line, or the board \
             does not answer), and {purpose} needs {value}; send CLOSE and {variable}={value} first"
        ))
    }
}

impl JobCall {
    /// The question to ask the board first.
    pub(super) fn question(&self, guard: Guard) -> String {
        match self.time_base {
            Some(number) => format!("{} I{number}93", guard.variable),
            None => guard.variable.to_owned(),
        }
    }

    /// Takes note of where coordinate system `number` takes its time base from, if not from the override.
    pub(super) fn note_time_base(&mut self, number: usize, answer: Option<&str>) {
        let register = classic::override_register(number);
        let Some(answer) = answer else { return };
        let value = match answer.strip_prefix('$') {
            Some(digits) => u32::from_str_radix(digits, 16).ok(),
            None => answer.parse().ok(),
        };
        if value != Some(register) {
            self.note(format!(
                "the override has no effect: I{number}93 is {answer}, and &{number} takes its time base from there; \
                 I{number}93=${register:X} is where the panel's override goes"
            ));
        }
    }

    /// Takes note of what could not be asked.
    pub(super) fn note_unasked(&mut self, guard: Guard) {
        let (question, value) = (self.question(guard), guard.value);
        let base = self.time_base.map_or_else(String::new, |number| {
            format!(" and I{number}93=${:X}", classic::override_register(number))
        });
        self.note(format!(
            "{question} could not be asked (a program buffer is open, where the question would be a program line, or the \
             board does not answer): this has an effect only while {}={value}{base}",
            guard.variable
        ));
    }

    fn note(&mut self, note: String) {
        if let Some(notes) = &mut self.notes {
            notes.push(note);
        }
    }

    /// A watch, which needs I55=1 like every use of the variable buffers.
    pub(super) fn watch(entries: Vec<VariableEntry>) -> Self {
        Self { guard: Some(VARIABLES_ENABLED), ..Self::new(Job::WatchVariables(entries), SHORT) }
    }

    fn new(job: Job, timeout: Duration) -> Self {
        Self { job, timeout, guard: None, time_base: None, notes: None, lease: None, audit: None }
    }
}

/// The role a method needs.
pub(super) fn role_for(method: &str) -> Role {
    match method {
        "Panel" | "PanelHold" | "FeedOverride" => Role::Operate,
        "RotaryState" => Role::Observe,
        _ => Role::Engineer,
    }
}

/// What the call of `method` asks for; `None` when there is no such method here.
pub(super) fn understand(method: &str, parameters: Parameters) -> Option<Result<JobCall, CallError>> {
    Some(match method {
        "Panel" => panel(parameters, false),
        "PanelHold" => panel(parameters, true),
        "FeedOverride" => feed_override(parameters),
        "Write" => write(parameters),
        "WriteVariables" => write_variables(parameters),
        "GatherBegin" => gather_begin(parameters),
        "GatherEnd" => parameters.finish().map(|()| JobCall::new(Job::GatherEnd, SHORT)),
        "RotaryOpen" => rotary_open(parameters),
        "RotarySend" => rotary_send(parameters),
        "RotaryFinish" => {
            rotary_buffer(parameters).map(|buffer| JobCall::new(Job::RotaryFinish(buffer), SHORT))
        }
        "RotaryState" => {
            rotary_buffer(parameters).map(|buffer| JobCall::new(Job::RotaryState(buffer), SHORT))
        }
        _ => return None,
    })
}

fn invalid(parameter: &str) -> CallError {
    CallError::InvalidParameter { parameter: parameter.to_owned() }
}

fn refused(reason: impl std::fmt::Display) -> CallError {
    CallError::Refused { reason: reason.to_string() }
}

fn integers<T: TryFrom<i64>>(value: Value, name: &str) -> Result<Vec<T>, CallError> {
    let Value::Array(values) = value else { return Err(invalid(name)) };
    values
        .iter()
        .map(|value| value.as_i64().and_then(|number| T::try_from(number).ok()).ok_or_else(|| invalid(name)))
        .collect()
}

fn panel(mut parameters: Parameters, hold: bool) -> Result<JobCall, CallError> {
    let action = parameters.string("action")?;
    let numbers: Vec<usize> = integers(parameters.value("numbers")?, "numbers")?;
    parameters.finish()?;
    let action: PanelAction = action.parse().map_err(refused)?;
    if numbers.is_empty() {
        return Err(refused("no motor or coordinate system is named; give numbers from 1 to 8"));
    }
    let request = PanelRequest::of(action, &numbers).map_err(refused)?;
    let lease = if hold {
        if !matches!(action, PanelAction::JogMinus | PanelAction::JogPlus) {
            return Err(refused("only jog- and jog+ can be held"));
        }
        Some(PanelRequest::of(PanelAction::JogStop, &numbers).map_err(refused)?)
    } else {
        None
    };
    let held = if hold { ", held" } else { "" };
    Ok(JobCall {
        guard: Some(PANEL_ENABLED),
        lease,
        audit: Some(format!("panel {action} {numbers:?}{held}")),
        ..JobCall::new(Job::Panel(request), PANEL_TIMEOUT)
    })
}

fn feed_override(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let number = parameters.integer("coordinate_system")?;
    let raw = parameters.optional_integer("raw")?;
    parameters.finish()?;
    let coordinate_system = usize::try_from(number).map_err(|_| invalid("coordinate_system"))?;
    let value = raw
        .map(|raw| u32::try_from(raw).map_err(|_| invalid("raw")))
        .transpose()?
        .map(|raw| FeedOverride::from_raw(raw).map_err(refused))
        .transpose()?;
    let audit = match raw {
        Some(raw) => format!("feed rate override of &{coordinate_system} to {raw}"),
        None => format!("feed rate override of &{coordinate_system} released"),
    };
    Ok(JobCall {
        guard: value.map(|_| PANEL_ENABLED),
        time_base: value.map(|_| coordinate_system).filter(|number| (1..=classic::MOTORS).contains(number)),
        notes: Some(Vec::new()),
        audit: Some(audit),
        ..JobCall::new(Job::Override { coordinate_system, value }, SHORT)
    })
}

fn write(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let offset = parameters.integer("host_offset")?;
    let values: Vec<u16> = integers(parameters.value("words")?, "words")?;
    let masks: Option<Vec<u16>> =
        parameters.optional_value("masks").map(|value| integers(value, "masks")).transpose()?;
    let anywhere = parameters.optional_bool("anywhere")?.unwrap_or(false);
    parameters.finish()?;
    let first =
        u32::try_from(offset).ok().and_then(HostOffset::checked).ok_or_else(|| invalid("host_offset"))?;
    let masks = masks.unwrap_or_else(|| vec![u16::MAX; values.len()]);
    if values.is_empty() || values.len() > WRITE_MAX || masks.len() != values.len() {
        return Err(invalid("words"));
    }
    // Not by the offset of the end, which there may be none of in 32 bits.
    if first.bytes() > classic::LENGTH - 2 * values.len() as u32 {
        return Err(CallError::OutOfRange);
    }
    let words: Vec<MaskedWord> =
        values.iter().zip(&masks).map(|(&value, &mask)| MaskedWord { value, mask }).collect();
    Ok(JobCall {
        audit: Some(format!("write {first} = {values:04X?} mask {masks:04X?}")),
        ..JobCall::new(Job::Write { first, words, anywhere }, SHORT)
    })
}

/// The registers a watch names.
pub(super) fn watched(mut parameters: Parameters) -> Result<Vec<VariableEntry>, CallError> {
    let Value::Array(registers) = parameters.value("registers")? else { return Err(invalid("registers")) };
    parameters.finish()?;
    if registers.len() > classic::VARIABLE_READ_ENTRIES {
        return Err(refused(VariableReadError::TooMany(registers.len())));
    }
    let entries = registers.iter().map(|register| {
        let text = register.as_str().ok_or_else(|| invalid("registers"))?;
        let source: GatherSource = text.parse().map_err(|_| {
            refused(format!("{text:?} is no register; write Y:$0003, X:$0028, D:$002B or L:$1005"))
        })?;
        let PmacAddress { space, number } = source.address();
        let kind = match space {
            Space::Y => VariableKind::Y,
            Space::X => VariableKind::X,
            _ => VariableKind::Long,
        };
        let address = u16::try_from(number).map_err(|_| invalid("registers"))?;
        Ok(VariableEntry { address, kind })
    });
    let entries: Vec<VariableEntry> = entries.collect::<Result<_, CallError>>()?;
    if entries.is_empty() { Err(refused("no register is named")) } else { Ok(entries) }
}

fn write_variables(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let Value::Array(records) = parameters.value("records")? else { return Err(invalid("records")) };
    let timeout_ms = match parameters.optional_integer("timeout_ms")?.map(u64::try_from) {
        None => WRITE_TIMEOUT_MS,
        Some(Ok(ms @ 1..=WRITE_TIMEOUT_MAX_MS)) => ms,
        Some(_) => return Err(invalid("timeout_ms")),
    };
    parameters.finish()?;
    if records.is_empty() || records.len() > RECORDS_MAX {
        return Err(invalid("records"));
    }
    let mut audit = String::from("variable write");
    let records: Vec<WriteRecord> =
        records.into_iter().map(|record| write_record(record, &mut audit)).collect::<Result<_, _>>()?;
    Ok(JobCall {
        guard: Some(VARIABLES_ENABLED),
        audit: Some(audit),
        ..JobCall::new(Job::WriteVariables(records), Duration::from_millis(timeout_ms))
    })
}

fn write_record(record: Value, audit: &mut String) -> Result<WriteRecord, CallError> {
    use std::fmt::Write as _;
    let record: VariableRecord = serde_json::from_value(record).map_err(|_| invalid("records"))?;
    let text = &record.register;
    let source: GatherSource = text.parse().map_err(|_| {
        refused(format!("{text:?} is no register; write Y:$0700, X:$0701, D:$0728 or L:$1005"))
    })?;
    let PmacAddress { space, number } = source.address();
    let address = u16::try_from(number).map_err(|_| invalid("records"))?;
    let whole = || {
        let value = record.value;
        if value.fract() == 0.0 && value.abs() < 2f64.powi(53) {
            Ok(value as i64)
        } else {
            Err(refused(format!("{text} takes a whole number, not {value}")))
        }
    };
    let in_part = record.width.is_some() || record.offset.is_some();
    let record_or_reason = match space {
        Space::D | Space::L if in_part => {
            return Err(refused(format!("{text} is written as a whole; leave width and offset out")));
        }
        Space::D => WriteRecord::fixed48(address, whole()?),
        Space::L => WriteRecord::float48(address, record.value),
        _ => {
            let kind = if space == Space::Y { WordKind::Y } else { WordKind::X };
            WriteRecord::word(kind, address, record.width.unwrap_or(24), record.offset.unwrap_or(0), whole()?)
        }
    };
    let _ = write!(audit, " {text}={}", record.value);
    record_or_reason.map_err(|reason| refused(format!("{text}: {reason}")))
}

fn gather_begin(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let mut number = |name: &str| -> Result<u32, CallError> {
        u32::try_from(parameters.integer(name)?).map_err(|_| invalid(name))
    };
    let offset = |bytes: u32, name: &str| {
        HostOffset::checked(bytes)
            .filter(|offset| offset.bytes() < classic::LENGTH)
            .ok_or_else(|| invalid(name))
    };
    let place = GatherPlace {
        buffer: offset(number("buffer")?, "buffer")?,
        size: offset(number("size_word")?, "size_word")?,
        index: offset(number("index_word")?, "index_word")?,
    };
    let (size_longs, sample_longs) = (number("size_longs")?, number("sample_longs")?);
    let period = number("period")?;
    let wrap = parameters.optional_bool("wrap")?.unwrap_or(true);
    let servo_period_ns = parameters.optional_integer("servo_period_ns")?;
    parameters.finish()?;
    let clock = match servo_period_ns {
        None => GatherClock::Report,
        Some(ns) => GatherClock::host(u64::try_from(ns).map_err(|_| invalid("servo_period_ns"))?)
            .ok_or_else(|| invalid("servo_period_ns"))?,
    };
    let buffer = GatherBuffer {
        place,
        room_longs: (classic::LENGTH - place.buffer.bytes()) / 4,
        size_longs,
        sample_longs,
        mode: if wrap { GatherMode::Wrap } else { GatherMode::Stop },
        period,
    };
    Ok(JobCall {
        audit: Some(format!(
            "gather, {size_longs} longs from {} on, samples of {sample_longs}",
            place.buffer
        )),
        ..JobCall::new(Job::GatherBegin { buffer, clock }, SHORT)
    })
}

fn buffer(parameters: &mut Parameters) -> Result<RotaryBuffer, CallError> {
    match parameters.integer("buffer")? {
        1 => Ok(RotaryBuffer::First),
        2 => Ok(RotaryBuffer::Second),
        _ => Err(invalid("buffer")),
    }
}

fn rotary_buffer(mut parameters: Parameters) -> Result<RotaryBuffer, CallError> {
    let buffer = buffer(&mut parameters)?;
    parameters.finish()?;
    Ok(buffer)
}

fn rotary_open(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let buffer = buffer(&mut parameters)?;
    let mut optional = |name: &str| -> Result<Option<u32>, CallError> {
        let value = parameters.optional_integer(name)?;
        value.map(|value| u32::try_from(value).map_err(|_| invalid(name))).transpose()
    };
    let (start, size_longs) = (optional("start")?, optional("size_longs")?);
    let start = start.map(|start| HostOffset::checked(start).ok_or_else(|| invalid("start"))).transpose()?;
    let mut number = |name: &str| -> Result<u8, CallError> {
        u8::try_from(parameters.integer(name)?).map_err(|_| invalid(name))
    };
    let coordinate_system = number("coordinate_system")?;
    let coordinate_system_base = number("coordinate_system_base")?;
    parameters.finish()?;
    let job = Job::RotaryOpen { buffer, start, size_longs, coordinate_system, coordinate_system_base };
    Ok(JobCall {
        guard: Some(ROTARY_AT_REST),
        audit: Some(format!("rotary buffer {} for &{coordinate_system}", buffer as usize + 1)),
        ..JobCall::new(job, SHORT)
    })
}

fn rotary_send(mut parameters: Parameters) -> Result<JobCall, CallError> {
    let buffer = buffer(&mut parameters)?;
    let lines = parameters.value("lines")?;
    let first = parameters.optional_integer("first")?;
    let first = first.map(|first| u64::try_from(first).map_err(|_| invalid("first"))).transpose()?;
    let timeout_ms = match parameters.optional_integer("timeout_ms")?.map(u64::try_from) {
        None => ROTARY_TIMEOUT_MS,
        Some(Ok(ms @ 1..=ROTARY_TIMEOUT_MAX_MS)) => ms,
        Some(_) => return Err(invalid("timeout_ms")),
    };
    parameters.finish()?;
    let Value::Array(lines) = lines else { return Err(invalid("lines")) };
    let mut commands = 0;
    let lines = lines
        .into_iter()
        .map(|line| {
            let Value::Object(mut line) = line else { return Err(invalid("lines")) };
            let words: Vec<u32> = integers(line.remove("words").unwrap_or_default(), "lines")?;
            commands += words.len() / 2;
            if !words.len().is_multiple_of(2) || commands > COMMANDS_MAX {
                return Err(invalid("lines"));
            }
            Ok(words.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect())
        })
        .collect::<Result<Vec<Vec<(u32, u32)>>, CallError>>()?;
    Ok(JobCall {
        // One line a program: the batches that follow say that they do.
        audit: first.is_none_or(|first| first == 0).then(|| "sends a rotary program".to_owned()),
        ..JobCall::new(Job::RotarySend { buffer, first, lines }, Duration::from_millis(timeout_ms))
    })
}
