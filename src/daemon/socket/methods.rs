//! The methods of the command socket: the role that each needs, the board's function that it needs, and the meaning of
//! a call.
//!
//! All checks happen here, before anything reaches the bus thread.

use std::time::Duration;

use serde::de::DeserializeOwned;
use serde_json::json;

use super::jobs::{self, JobAt, JobCall};
use super::order::Order;
use super::policy::{Characters, Role};
use super::sequences::SequenceCall;
use crate::daemon::motion::effect::Starts;
use crate::daemon::motion::target::Target;
use crate::daemon::scripts::{Batch, GatherCall, RotaryCall};
use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::parameters::{inside, rotary_buffer};
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, Line, READ_MAX};
use crate::function::variable_read::VariableEntry;
use crate::language::settings::CutsOff;
use crate::map::{Family, HostOffset, VariableKind};
use crate::protocol::calls::NOTE_MAX;
use crate::protocol::cut_off::{self, character_cuts_off};
use crate::protocol::function::UNKNOWN_FAMILY;
use crate::protocol::{
    BOARD, BOARD_DESCRIPTION, Call, CallError, Function, Reply, SERVICE, SERVICE_DESCRIPTION, calls,
    check_line, control, parameters,
};

/// A call's request to the bus thread.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a few at a time, and soon over")]
pub enum Ask {
    /// Send a command line.
    Send {
        /// The line, of printable characters.
        line: Line,
        /// How long the board may take.
        timeout: Duration,
        /// The line is a question, which must enter no program buffer.
        question: bool,
        /// `true`: the line belongs into the buffer that the caller's process has open, or opens that buffer. `false`:
        /// the line belongs into no buffer, not even that one.
        into_buffer: Option<bool>,
        /// A jog without an end that the line begins ends with the connection.
        while_connected: bool,
        /// The caller's silence for this long ends the jog, too.
        silence: Option<Duration>,
        /// The caller has confirmed the line's effect on others, or on the machine.
        confirmed: bool,
    },
    /// Send a control character.
    Control {
        /// The character, 1 to 31.
        character: u8,
        /// A character that stops all motion leaves the waiting lines in their queue.
        keeps_lines: bool,
        /// The programs that the character starts.
        starts: Starts,
    },
    /// Read words of the DPRAM.
    Read {
        /// The first word.
        first: HostOffset,
        /// How many words, 1 to [`READ_MAX`].
        count: usize,
    },
    /// Have one of the other functions do a job.
    Job(JobCall),
    /// Carry out an order by a line of the daemon's own.
    Order(Order),
}

impl Ask {
    /// Send `line` by hand, without further options.
    pub(super) const fn line(line: Line) -> Self {
        Self::Send {
            line,
            timeout: DEFAULT_TIMEOUT,
            question: false,
            into_buffer: None,
            while_connected: false,
            silence: None,
            confirmed: false,
        }
    }

    /// How long the bus thread may take.
    pub(super) fn timeout(&self) -> Duration {
        match self {
            Self::Send { timeout, .. } => *timeout,
            Self::Control { .. } | Self::Read { .. } | Self::Order(_) => DEFAULT_TIMEOUT,
            Self::Job(call) => call.timeout,
        }
    }

    /// The programs that the request starts. For lines, the sender answers for the start.
    pub(super) fn starts(&self) -> Starts {
        match self {
            Self::Control { starts, .. } | Self::Job(JobCall { starts, .. }) => *starts,
            Self::Order(order) => order.starts(),
            Self::Send { .. } | Self::Read { .. } => Starts::default(),
        }
    }
}

/// The server's action for a call.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a few at a time, and soon over")]
pub enum Action {
    /// Answer at once.
    Reply(Reply),
    /// Tell the daemon's knowledge of the board, and the caller's role.
    Info,
    /// Ask the bus thread.
    Ask(Ask),
    /// Watch these registers for the caller, as long as it stays.
    Watch(Vec<VariableEntry>),
    /// Pass on every unsolicited text from now on.
    Stream,
    /// Stop this target by command line; the text is the request for the audit log.
    StopByLine(Target, String),
    /// Renew the caller's lease on a jog.
    Renew,
    /// Tell whether jogs go on that end with the caller, or with the caller's silence.
    RenewJogs,
    /// Hand over the trace of the bus thread's accesses; `true` ends the trace.
    Trace(bool),
    /// Keep a note of the caller.
    Note(String),
    /// Ask the board whether it was reset.
    CheckReset,
    /// Begin a sequence, or go on with the caller's sequence.
    Sequence(SequenceCall),
}

impl Action {
    /// Whether the action only stops something.
    pub(super) fn stops(&self) -> bool {
        match self {
            Self::StopByLine(..) => true,
            Self::Ask(Ask::Control { character, .. }) => control::stops(*character),
            Self::Ask(Ask::Job(call)) => call.stops,
            _ => false,
        }
    }

    /// Whether the action stops a motion or a program.
    pub(super) fn ends_motion(&self) -> bool {
        self.stops() || matches!(self, Self::Ask(Ask::Send { line, .. }) if line.meaning.stops)
    }

    /// Whether the action begins something: moves a machine, or changes the board's memory. Questions, stops and
    /// continuations begin nothing.
    pub(super) fn begins(&self) -> bool {
        match self {
            Self::Ask(Ask::Send { question, .. }) => !question,
            Self::Ask(Ask::Control { .. } | Ask::Job(_)) => !self.stops(),
            Self::Watch(_) | Self::Ask(Ask::Order(_)) => true,
            Self::Reply(_)
            | Self::Info
            | Self::Ask(Ask::Read { .. })
            | Self::Stream
            | Self::StopByLine(..)
            | Self::Renew
            | Self::RenewJogs
            | Self::Trace(_)
            | Self::Note(_)
            | Self::CheckReset
            | Self::Sequence(_) => false,
        }
    }

    /// Whether the action may set something in motion.
    pub(super) fn may_move(&self) -> bool {
        match self {
            Self::Ask(Ask::Control { character, .. }) => matches!(*character, control::RUN | control::STEP),
            Self::Watch(_) => false,
            Self::Sequence(call) => matches!(call, SequenceCall::Lines(_) | SequenceCall::Rotary(_)),
            _ => self.begins(),
        }
    }
}

/// A method of the board's interface.
struct Method {
    name: &'static str,
    role: Role,
    /// The board's function that the method needs, if it needs any.
    function: Option<Function>,
    /// Gives the action of a call.
    parse: fn(&Call, &Info) -> Result<Action, CallError>,
}

const fn method(
    name: &'static str,
    role: Role,
    function: Option<Function>,
    parse: fn(&Call, &Info) -> Result<Action, CallError>,
) -> Method {
    Method { name, role, function, parse }
}

/// The most values of variables that an observer's line may ask for: a longer reply would hold up other clients' lines.
const OBSERVER_VALUES: u32 = 50;

/// Every method, in the order of the interface's definition.
const METHODS: [Method; 28] = {
    use Function::{Ascii, Gather, Panel, Rotary, Variables};
    use Role::{Engineer, Observe, Operate, Stop};
    [
        method("GetInfo", Observe, None, |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            Ok(Action::Info)
        }),
        method("GetSettings", Observe, None, |call, info| {
            let calls::NoParameters {} = parameters(call)?;
            Reply::with(info.settings()).map(Action::Reply)
        }),
        method("Send", Observe, Some(Ascii), |call, _| send(parameters(call)?)),
        method("RunLines", Engineer, Some(Ascii), |call, _| {
            let batch = Batch::of(parameters(call)?)?;
            streams(call, Action::Sequence(SequenceCall::Lines(batch)))
        }),
        method("CheckReset", Engineer, Some(Ascii), |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            Ok(Action::CheckReset)
        }),
        method("SequenceRenew", Observe, None, |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            Ok(Action::Sequence(SequenceCall::Renew))
        }),
        method("JogRenew", Observe, None, |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            Ok(Action::RenewJogs)
        }),
        method("Note", Engineer, None, |call, _| {
            let calls::Note { text } = parameters(call)?;
            match text.chars().count() {
                1..=NOTE_MAX => Ok(Action::Note(text)),
                _ => Err(CallError::invalid("text", format_args!("1 to {NOTE_MAX} characters"))),
            }
        }),
        method("SendControl", Stop, Some(Ascii), |call, _| send_control(&parameters(call)?)),
        method("Read", Observe, None, |call, info| read(&parameters(call)?, info.family())),
        method("Trace", Engineer, None, |call, _| {
            parameters(call).map(|calls::Trace { end }| Action::Trace(end.unwrap_or(false)))
        }),
        method("Messages", Observe, Some(Ascii), |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            streams(call, Action::Stream)
        }),
        method("Panel", Stop, None, panel),
        method("PanelHold", Operate, Some(Panel), |call, info| {
            if call.oneway == Some(true) {
                return Err(CallError::invalid("oneway", "false: who holds a jog must hear of it"));
            }
            job(call, info, |call, family| jobs::panel(call, true, family))
        }),
        method("PanelRenew", Observe, Some(Panel), |call, _| {
            let calls::NoParameters {} = parameters(call)?;
            Ok(Action::Renew)
        }),
        method("JogTo", Operate, Some(Ascii), |call, info| {
            Order::jog_to(&parameters(call)?, info.family()).map(Ask::Order).map(Action::Ask)
        }),
        method("SetPosition", Engineer, Some(Ascii), |call, info| {
            Order::set_position(&parameters(call)?, info.family()).map(Ask::Order).map(Action::Ask)
        }),
        method("FeedOverride", Stop, Some(Panel), |call, info| job(call, info, jobs::feed_override)),
        method("Write", Engineer, None, |call, info| {
            if info.settings().functions.is_empty() {
                return Err(CallError::Refused { reason: UNKNOWN_FAMILY.to_owned() });
            }
            job(call, info, jobs::write)
        }),
        method("WatchVariables", Observe, Some(Variables), |call, info| {
            streams(call, Action::Watch(jobs::watched(parameters(call)?, info)?))
        }),
        method("WriteVariables", Engineer, Some(Variables), |call, info| {
            jobs::check_writes(info.board(), info.family())?;
            jobs::write_variables(parameters(call)?, info).map(|call| Action::Ask(Ask::Job(call)))
        }),
        method("GatherStart", Engineer, Some(Gather), |call, info| {
            needs_lines(info)?;
            answered(call, SequenceCall::Gather(GatherCall::of(parameters(call)?, info)?))
        }),
        method("GatherStop", Engineer, Some(Gather), |call, info| {
            needs_lines(info)?;
            let calls::GatherStop { uid } = parameters(call)?;
            Ok(Action::Sequence(SequenceCall::GatherStop { uid }))
        }),
        method("RotaryStart", Engineer, Some(Rotary), |call, info| {
            needs_lines(info)?;
            answered(call, SequenceCall::Rotary(RotaryCall::of(parameters(call)?, info)?))
        }),
        method("RotarySend", Engineer, Some(Rotary), |call, info| job(call, info, jobs::rotary_send)),
        method("RotaryFinish", Engineer, Some(Rotary), |call, info| {
            let calls::Rotary { buffer } = parameters(call)?;
            rotary_buffer(buffer, info.family()).map(SequenceCall::RotaryFinish).map(Action::Sequence)
        }),
        method("RotaryStop", Engineer, Some(Rotary), |call, info| {
            let calls::Rotary { buffer } = parameters(call)?;
            rotary_buffer(buffer, info.family()).map(SequenceCall::RotaryStop).map(Action::Sequence)
        }),
        method("RotaryState", Observe, Some(Rotary), |call, info| job(call, info, jobs::rotary_state)),
    ]
};

/// A request to the control panel. If the daemon does not use the panel, it carries out stops by command line.
fn panel(call: &Call, info: &Info) -> Result<Action, CallError> {
    if needs_lines(info).is_ok()
        && let Some(order) = jobs::order(&parameters(call)?, info.family())?
    {
        return Ok(Action::Ask(Ask::Order(order)));
    }
    let Err(why_not) = needs(Function::Panel, info) else {
        return job(call, info, |call, family| jobs::panel(call, false, family));
    };
    if needs_lines(info).is_err() {
        return Err(why_not);
    }
    let stop = jobs::stop_by_line(parameters(call)?, info.family())?;
    stop.map(|(target, audit)| Action::StopByLine(target, audit)).ok_or(why_not)
}

/// The job that `parse` makes of the call's parameters, for a board of its family.
fn job<P: DeserializeOwned>(
    call: &Call,
    info: &Info,
    parse: impl FnOnce(P, &Family) -> Result<JobCall, CallError>,
) -> Result<Action, CallError> {
    parse(parameters(call)?, info.family()).map(|call| Action::Ask(Ask::Job(call)))
}

/// The beginning of a sequence: the owner has to get the reply.
fn answered(call: &Call, sequence: SequenceCall) -> Result<Action, CallError> {
    match call.oneway {
        Some(true) => Err(CallError::invalid("oneway", "false: the owner must hear how it goes")),
        _ => Ok(Action::Sequence(sequence)),
    }
}

/// Checks that the daemon may send command lines.
fn needs_lines(info: &Info) -> Result<(), CallError> {
    needs(Function::Ascii, info)
}

/// Checks that the daemon uses `function`.
fn needs(function: Function, info: &Info) -> Result<(), CallError> {
    info.why_not(function).map_or(Ok(()), |reason| Err(CallError::Refused { reason }))
}

/// `action`, of a method that answers more than once.
fn streams(call: &Call, action: Action) -> Result<Action, CallError> {
    if call.more == Some(true) { Ok(action) } else { Err(CallError::ExpectedMore) }
}

/// The action of `call` by a caller of `role`; operators may send `characters`.
///
/// # Errors
/// The reply to the client, if the daemon refuses the call.
pub fn parse_call(call: &Call, role: Role, characters: Characters, info: &Info) -> Result<Action, CallError> {
    let Some((interface, name)) = call.interface_and_method() else {
        return Err(CallError::invalid("method", "an interface and a method, with a dot between"));
    };
    if call.upgrade == Some(true) {
        return Err(CallError::invalid("upgrade", "false: no method upgrades the connection"));
    }
    if interface == SERVICE {
        return service(name, call);
    }
    if interface != BOARD {
        return Err(CallError::InterfaceNotFound { interface: interface.to_owned() });
    }
    let Some(method) = METHODS.iter().find(|method| method.name == name) else {
        return Err(CallError::MethodNotFound { method: call.method.clone() });
    };
    method.function.map_or(Ok(()), |function| needs(function, info))?;
    if role < method.role {
        // The role that the call would need, if its action is known.
        let action = (method.parse)(call, info).ok();
        let needed = action.map(|action| role_of(&action, characters, info.family()));
        let needed = needed.map_or(method.role, |needed| needed.max(method.role));
        return Err(CallError::NotPermitted { role_needed: needed.to_string() });
    }
    let action = (method.parse)(call, info)?;
    let needed = role_of(&action, characters, info.family());
    if role < needed {
        return Err(CallError::NotPermitted { role_needed: needed.to_string() });
    }
    Ok(action)
}

/// The role that an action needs by its effect: to stop a machine takes less than to move it; the texts between an
/// engineer and the board may be passwords, and to read a register of the hardware can have an effect. An M-variable
/// may be such a register.
fn role_of(action: &Action, characters: Characters, family: &Family) -> Role {
    let is_for_engineers = match action {
        Action::Ask(Ask::Control { character, .. }) => return characters.role_for(*character),
        Action::Ask(Ask::Order(order)) => return order.role(),
        Action::Ask(Ask::Job(JobCall {
            at: JobAt::Wanted(Job::Panel(_) | Job::Override { .. }),
            stops,
            ..
        })) => return if *stops { Role::Stop } else { Role::Operate },
        Action::Ask(Ask::Send { line, .. }) => !(1..=OBSERVER_VALUES).contains(&line.meaning.asks_for_values),
        Action::Ask(Ask::Read { first, count }) => family.ascii.has_text_in(*first, *count),
        Action::Watch(entries) => {
            // Only the board knows where a function block lies.
            let is_block = |entry: &VariableEntry| entry.kind == VariableKind::Special;
            let is_open =
                |entry: &VariableEntry| family.is_memory(entry.address) && !family.holds_text(entry.address);
            entries.iter().any(|entry| is_block(entry) || !is_open(entry))
        }
        _ => false,
    };
    if is_for_engineers { Role::Engineer } else { Role::Observe }
}

fn service(method: &str, call: &Call) -> Result<Action, CallError> {
    match method {
        "GetInfo" => {
            let calls::NoParameters {} = parameters(call)?;
            Reply::with(&json!({
                "vendor": "pmac-dpram",
                "product": "pmacd",
                "version": env!("CARGO_PKG_VERSION"),
                "url": env!("CARGO_PKG_REPOSITORY"),
                "interfaces": [SERVICE, BOARD],
            }))
            .map(Action::Reply)
        }
        "GetInterfaceDescription" => {
            let calls::GetInterfaceDescription { interface } = parameters(call)?;
            let description = match interface.as_str() {
                SERVICE => SERVICE_DESCRIPTION,
                BOARD => BOARD_DESCRIPTION,
                _ => return Err(CallError::InterfaceNotFound { interface }),
            };
            Reply::with(&json!({ "description": description })).map(Action::Reply)
        }
        _ => Err(CallError::MethodNotFound { method: call.method.clone() }),
    }
}

fn send(
    calls::Send { line, timeout_ms, question, into_buffer, while_connected, silence_ms, confirmed }: calls::Send,
) -> Result<Action, CallError> {
    check_line(&line).map_err(|reason| CallError::InvalidLine { reason })?;
    let line = Line::of(line);
    let cuts_off = line.meaning.settings.cuts_off;
    if cuts_off.is_certain() && confirmed != Some(true) {
        return Err(cut_off::refusal(&line, cuts_off));
    }
    let while_connected = while_connected == Some(true);
    if silence_ms.is_some() && !while_connected {
        return Err(CallError::invalid("silence_ms", "null where while_connected is not true"));
    }
    if while_connected && line.meaning.possible_jogs().unnamed {
        let reason = "the jog does not say which motor it means (#1J+), and would have no end".to_owned();
        return Err(CallError::InvalidLine { reason });
    }
    if into_buffer == Some(false) && line.meaning.opens() {
        let reason = "a line that enters no program buffer opens none either".to_owned();
        return Err(CallError::InvalidLine { reason });
    }
    let plain = || line.meaning.deadline(DEFAULT_TIMEOUT);
    let timeout = timeout_ms.map_or_else(plain, Duration::from_millis);
    Ok(Action::Ask(Ask::Send {
        line,
        timeout,
        question: question == Some(true),
        into_buffer,
        while_connected,
        silence: silence_ms.map(Duration::from_millis),
        confirmed: confirmed == Some(true),
    }))
}

fn send_control(
    calls::SendControl { character, keep_queue, confirmed }: &calls::SendControl,
) -> Result<Action, CallError> {
    let character = control::parse(character)
        .ok_or_else(|| CallError::invalid("character", "^A to ^_, or the character itself"))?;
    if character_cuts_off(character) && *confirmed != Some(true) {
        return Err(cut_off::refusal(&control::name(character), CutsOff::Enable));
    }
    Ok(Action::Ask(Ask::Control {
        character,
        keeps_lines: *keep_queue == Some(true),
        starts: Starts::of_character(character, *confirmed == Some(true)),
    }))
}

fn read(calls::Read { host_offset, words }: &calls::Read, family: &Family) -> Result<Action, CallError> {
    if !(1..=READ_MAX).contains(words) {
        return Err(CallError::invalid("words", format_args!("1 to {READ_MAX}, not {words}")));
    }
    let first = inside(*host_offset, *words, "host_offset", family)?;
    Ok(Action::Ask(Ask::Read { first, count: *words }))
}

#[cfg(test)]
#[path = "methods_tests.rs"]
mod tests;
