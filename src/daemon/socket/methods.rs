//! The methods of the command socket: who may call each, which function of the board it needs, and what a call of it means.
//!
//! Everything is checked here, before anything reaches the bus thread.

use std::time::Duration;

use serde::de::DeserializeOwned;
use serde_json::json;

use super::jobs::{self, JobCall};
use super::jog_to::JogTo;
use super::leftovers::{Starts, started_by};
use super::policy::{Characters, Role};
use super::sequences::{Batch, GatherCall, RotaryCall, SequenceCall};
use super::stop_target::Target;
use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, LINE_MAX, READ_MAX, Text};
use crate::function::variable_read::VariableEntry;
use crate::map::{Family, HostOffset, VariableKind};
use crate::protocol::cut_off::{self, character_cuts_off, line_cuts_off};
use crate::protocol::function::UNKNOWN_FAMILY;
use crate::protocol::{
    BOARD, BOARD_DESCRIPTION, Call, CallError, Function, Reply, SERVICE, SERVICE_DESCRIPTION, calls,
    check_line, control, deadlines, parameters,
};

/// What a call asks of the bus thread.
#[derive(Debug)]
pub enum Ask {
    /// Send a command line.
    Send {
        /// The line, of printable characters.
        line: Text<LINE_MAX>,
        /// How long the board may take.
        timeout: Duration,
        /// It is a question, which enters no program buffer.
        question: bool,
        /// It belongs into the buffer that its user has open.
        into_buffer: bool,
        /// The caller knows what it does to others, or to the machine.
        confirmed: bool,
    },
    /// Send a control character.
    Control {
        /// The character, 1 to 31.
        character: u8,
        /// One that stops all motion leaves the lines that wait where they are.
        keeps_lines: bool,
        /// The programs that it starts.
        starts: Starts,
    },
    /// Read words of the DPRAM.
    Read {
        /// The first word.
        first: HostOffset,
        /// How many, 1 to [`READ_MAX`].
        count: usize,
    },
    /// Have one of the other functions do something.
    Job(JobCall),
}

impl Ask {
    /// How long the bus thread may take.
    pub(super) fn timeout(&self) -> Duration {
        match self {
            Self::Send { timeout, .. } => *timeout,
            Self::Control { .. } | Self::Read { .. } => DEFAULT_TIMEOUT,
            Self::Job(call) => call.timeout,
        }
    }

    /// The programs that it starts. What a line starts is with who types it.
    pub(super) fn starts(&self) -> Starts {
        match self {
            Self::Control { starts, .. } | Self::Job(JobCall { starts, .. }) => *starts,
            Self::Send { .. } | Self::Read { .. } => Starts::default(),
        }
    }
}

/// What is to be done about a call.
#[derive(Debug)]
pub enum Action {
    /// Answer at once.
    Reply(Reply),
    /// Tell what is known of the board, and the caller's role.
    Info,
    /// Ask the bus thread.
    Ask(Ask),
    /// Watch these registers for the caller, as long as it stays.
    Watch(Vec<VariableEntry>),
    /// Pass on every unsolicited text from now on.
    Stream,
    /// Jog a motor to a position.
    JogTo(JogTo),
    /// Stop this by command line; the audit log says what was asked.
    StopByLine(Target, String),
    /// Renew the caller's lease on a jog.
    Renew,
    /// Hand over what the bus thread has read and written; keep no more of it if that is to end.
    Trace(bool),
    /// Ask the board whether it was reset.
    CheckReset,
    /// Begin a sequence, or go on with the one that the caller has.
    Sequence(SequenceCall),
}

/// A method of the board's interface.
struct Method {
    name: &'static str,
    role: Role,
    /// The function of the board that it needs, if it needs one.
    function: Option<Function>,
    /// What a call means.
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

/// Every method, in the order of the interface's definition.
const METHODS: [Method; 25] = {
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
        method("Send", Engineer, Some(Ascii), |call, _| send(parameters(call)?)),
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
            JogTo::of(&parameters(call)?, info.family()).map(Action::JogTo)
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
            jobs::check_firmware_writes(info.board(), info.family())?;
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
            jobs::rotary_buffer(buffer, info.family()).map(SequenceCall::RotaryFinish).map(Action::Sequence)
        }),
        method("RotaryStop", Engineer, Some(Rotary), |call, info| {
            let calls::Rotary { buffer } = parameters(call)?;
            jobs::rotary_buffer(buffer, info.family()).map(SequenceCall::RotaryStop).map(Action::Sequence)
        }),
        method("RotaryState", Observe, Some(Rotary), |call, info| job(call, info, jobs::rotary_state)),
    ]
};

/// A request to the control panel. What it would stop is stopped by command line where the panel is not used.
fn panel(call: &Call, info: &Info) -> Result<Action, CallError> {
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

/// A sequence that begins: its owner has to hear of it.
fn answered(call: &Call, sequence: SequenceCall) -> Result<Action, CallError> {
    match call.oneway {
        Some(true) => Err(CallError::invalid("oneway", "false: the owner must hear how it goes")),
        _ => Ok(Action::Sequence(sequence)),
    }
}

/// Whether command lines can be sent.
fn needs_lines(info: &Info) -> Result<(), CallError> {
    needs(Function::Ascii, info)
}

/// Whether `function` is used.
fn needs(function: Function, info: &Info) -> Result<(), CallError> {
    info.why_not(function).map_or(Ok(()), |reason| Err(CallError::Refused { reason }))
}

/// `action`, of a method that answers more than once.
fn streams(call: &Call, action: Action) -> Result<Action, CallError> {
    if call.more == Some(true) { Ok(action) } else { Err(CallError::ExpectedMore) }
}

/// Finds out what `call` by a caller of `role` means; operators may send `characters`.
///
/// # Errors
/// What to answer instead.
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
        // What it would take, if that can be told.
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

/// The role that an action needs by what it is about: to stop a machine takes less than to move it; the texts between an
/// engineer and the board may be passwords, and to read a register of the hardware can have an effect.
fn role_of(action: &Action, characters: Characters, family: &Family) -> Role {
    let is_for_engineers = match action {
        Action::Ask(Ask::Control { character, .. }) => return characters.role_for(*character),
        Action::Ask(Ask::Job(JobCall { job: Job::Panel(_) | Job::Override { .. }, stops, .. })) => {
            return if *stops { Role::Stop } else { Role::Operate };
        }
        Action::Ask(Ask::Read { first, count }) => family.ascii.has_text_in(*first, *count),
        Action::Watch(entries) => {
            // Where a function block lies, the board alone knows.
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
    calls::Send { line, timeout_ms, question, into_buffer, confirmed }: calls::Send,
) -> Result<Action, CallError> {
    check_line(&line).map_err(|reason| CallError::InvalidLine { reason })?;
    if line_cuts_off(&line) && confirmed != Some(true) {
        return Err(cut_off::refusal(&line));
    }
    let line = Text::new(line.as_bytes())
        .ok_or_else(|| CallError::InvalidLine { reason: "the line is too long".to_owned() })?;
    let plain = || deadlines::of_line(&line, DEFAULT_TIMEOUT);
    let timeout = timeout_ms.map_or_else(plain, Duration::from_millis);
    Ok(Action::Ask(Ask::Send {
        line,
        timeout,
        question: question == Some(true),
        into_buffer: into_buffer == Some(true),
        confirmed: confirmed == Some(true),
    }))
}

fn send_control(
    calls::SendControl { character, keep_queue, confirmed }: &calls::SendControl,
) -> Result<Action, CallError> {
    let character = control::parse(character)
        .ok_or_else(|| CallError::invalid("character", "^A to ^_, or the character itself"))?;
    if character_cuts_off(character) && *confirmed != Some(true) {
        return Err(cut_off::refusal(&control::name(character)));
    }
    Ok(Action::Ask(Ask::Control {
        character,
        keeps_lines: *keep_queue == Some(true),
        starts: Starts { systems: started_by(character), confirmed: *confirmed == Some(true) },
    }))
}

fn read(calls::Read { host_offset, words }: &calls::Read, family: &Family) -> Result<Action, CallError> {
    if !(1..=READ_MAX).contains(words) {
        return Err(CallError::invalid("words", format_args!("1 to {READ_MAX}, not {words}")));
    }
    let first = jobs::inside(*host_offset, *words, "host_offset", family)?;
    Ok(Action::Ask(Ask::Read { first, count: *words }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;
    use crate::map::functions::RESPONSE_BYTES;
    use crate::protocol::{BoardInfo, BoardSettings};
    use serde_json::Value;

    fn called(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
        let call: Call = serde_json::from_value(json!({"method": method, "parameters": parameters})).unwrap();
        parse_call(
            &call,
            role,
            Characters::default(),
            &Info::new(&PMAC, BoardInfo::default(), BoardSettings::default()),
        )
    }

    fn board(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
        called(role, &format!("{BOARD}.{method}"), parameters)
    }

    #[test]
    fn b4_1_each_method_needs_its_role() {
        for (method, parameters, needed) in [
            ("GetInfo", json!({}), Role::Observe),
            ("Read", json!({"host_offset": 0, "words": 1}), Role::Observe),
            ("SendControl", json!({"character": "^A"}), Role::Stop),
            ("SendControl", json!({"character": "^K"}), Role::Stop),
            ("SendControl", json!({"character": "^O"}), Role::Stop),
            ("SendControl", json!({"character": "^R"}), Role::Operate),
            ("SendControl", json!({"character": "^D"}), Role::Engineer),
            ("SendControl", json!({"character": "^Z", "confirmed": true}), Role::Engineer),
            ("Panel", json!({"action": "stop", "numbers": [1]}), Role::Stop),
            ("Panel", json!({"action": "hold", "numbers": [1]}), Role::Stop),
            ("Panel", json!({"action": "jog-stop", "numbers": [1]}), Role::Stop),
            ("Panel", json!({"action": "jog+", "numbers": [1]}), Role::Operate),
            ("Panel", json!({"action": "step", "numbers": [1]}), Role::Operate),
            ("PanelHold", json!({"action": "jog+", "numbers": [1]}), Role::Operate),
            ("JogTo", json!({"motor": 1, "position": -0.5}), Role::Operate),
            ("FeedOverride", json!({"coordinate_system": 1, "raw": 0}), Role::Stop),
            ("FeedOverride", json!({"coordinate_system": 1, "raw": 1}), Role::Operate),
            ("FeedOverride", json!({"coordinate_system": 1, "raw": null}), Role::Operate),
            ("Send", json!({"line": "#1J+"}), Role::Engineer),
        ] {
            for role in Role::ALL {
                let found = board(role, method, parameters.clone());
                let refused = matches!(&found, Err(CallError::NotPermitted { role_needed })
                    if *role_needed == needed.to_string());
                assert_eq!(refused, role < needed, "{method} by {role}: {found:?}");
                assert_eq!(found.is_ok(), role >= needed);
            }
        }
    }

    #[test]
    fn b4_5_the_lines_of_others_are_for_engineers() {
        let ascii = &PMAC.ascii;
        let read = |role, offset: u32, words| {
            board(role, "Read", json!({"host_offset": offset, "words": words})).map(drop)
        };
        let (command, response) = (ascii.command.bytes(), ascii.response.bytes());
        let ends = [command + ascii.command_bytes as u32, response + RESPONSE_BYTES as u32];
        for (start, end) in [command, response].into_iter().zip(ends) {
            for (offset, words) in [(start, 1), (start - 2, 2), (end - 2, 1), (start - 2, 64)] {
                let refused = read(Role::Operate, offset, words).unwrap_err();
                assert!(
                    matches!(refused, CallError::NotPermitted { role_needed } if role_needed == "engineer")
                );
                read(Role::Engineer, offset, words).unwrap();
            }
            read(Role::Observe, start - 2, 1).unwrap();
            read(Role::Observe, end, 1).unwrap();
        }
    }

    #[test]
    fn b4_4_registers_outside_memory_are_for_engineers() {
        let watch = |role, registers: &[&str]| {
            let parameters = json!({ "registers": registers });
            let call =
                json!({"method": format!("{BOARD}.WatchVariables"), "more": true, "parameters": parameters});
            let call: Call = serde_json::from_value(call).unwrap();
            parse_call(
                &call,
                role,
                Characters::default(),
                &Info::new(&PMAC, BoardInfo::default(), BoardSettings::default()),
            )
        };
        for memory in ["X:$0", "Y:$BFFF", "X:$D009", "Y:$DFFF"] {
            watch(Role::Observe, &[memory]).unwrap();
        }
        // The board's own addresses of command lines ($D18C to $D1B3) and responses ($D1B5 to $D1F4): they may be passwords.
        for memory in ["Y:$D18B", "Y:$D1F5"] {
            watch(Role::Observe, &[memory]).unwrap();
        }
        for hardware in
            ["Y:$C000", "X:$E006", "Y:$FFC2", "D:$D18C", "Y:$D18D", "X:$D1B3", "Y:$D1B5", "L:$D1F4"]
        {
            for role in [Role::Observe, Role::Operate] {
                let refused = watch(role, &["X:$0", hardware]).unwrap_err();
                assert!(matches!(refused, CallError::NotPermitted { .. }), "{hardware}");
            }
            watch(Role::Engineer, &[hardware]).unwrap();
        }
    }

    #[test]
    fn a_method_of_a_function_that_is_switched_off_says_so() {
        let with = |functions: Value| {
            let settings =
                BoardSettings { functions: serde_json::from_value(functions).unwrap(), ..Default::default() };
            Info::new(&PMAC, BoardInfo::default(), settings)
        };
        let methods = BOARD_DESCRIPTION.lines().filter_map(|line| line.strip_prefix("method "));
        let methods: Vec<_> = methods.filter_map(|line| line.split('(').next()).collect();
        assert_eq!(methods.len(), 25, "{methods:?}");
        for method in methods {
            let call = json!({"method": format!("{BOARD}.{method}"), "parameters": {}});
            let call: Call = serde_json::from_value(call).unwrap();
            let reason = |functions: Value| match parse_call(
                &call,
                Role::Engineer,
                Characters::default(),
                &with(functions),
            ) {
                Err(CallError::Refused { reason }) => reason,
                _ => String::new(),
            };
            let refused = |functions: Value| reason(functions).contains("is switched off");
            // What the panel would stop is stopped by lines, but without these it needs the panel.
            let of_panel = (method == "Panel").then_some(Function::Panel);
            let needed = of_panel.or(METHODS.iter().find(|known| known.name == method).unwrap().function);
            let other = if needed == Some(Function::Rotary) { Function::Servo } else { Function::Rotary };
            assert_eq!(refused(json!([other])), needed.is_some(), "{method}");
            // None is used: the board's family is not known.
            let writes = needed.is_some() || method == "Write";
            assert_eq!(reason(json!([])) == UNKNOWN_FAMILY, writes, "{method}");
            assert_eq!(
                needed.is_none(),
                ["GetInfo", "GetSettings", "SequenceRenew", "Read", "Trace", "Write"].contains(&method)
            );
            assert!(!needed.is_some_and(|function| refused(json!([function, Function::Ascii]))), "{method}");
        }
    }

    #[test]
    fn nothing_out_of_bounds_passes() {
        let engineer = |method, parameters| board(Role::Engineer, method, parameters).unwrap_err();
        let is_invalid = |error, name: &str| {
            assert!(
                matches!(&error, CallError::InvalidParameter { parameter, .. } if parameter == name),
                "{error:?}"
            );
        };
        let read = |offset: i64, words: i64| engineer("Read", json!({"host_offset": offset, "words": words}));
        for offset in [1, -2, 0x4000, i64::from(u32::MAX) - 1, i64::MAX] {
            is_invalid(read(offset, 1), "host_offset");
            let words = json!({"host_offset": offset, "words": [1], "anywhere": true});
            is_invalid(engineer("Write", words), "host_offset");
        }
        is_invalid(read(0, 0), "words");
        is_invalid(read(0, 65), "words");
        assert_eq!(read(0x3FFE, 2), CallError::OutOfRange);
        for (method, parameters, name) in [
            ("WatchVariables", json!({"registers": vec!["Y:$0003"; 200]}), "registers"),
            ("WatchVariables", json!({"registers": []}), "registers"),
            ("RotaryState", json!({"buffer": 9}), "buffer"),
            (
                "RotaryStart",
                json!({"buffer": 1, "coordinate_system": 99, "coordinate_system_base": 1}),
                "coordinate_system",
            ),
            (
                "RotaryStart",
                json!({"buffer": 1, "start": 0x4000, "coordinate_system": 1, "coordinate_system_base": 1}),
                "start",
            ),
            (
                "RotaryStart",
                json!({"buffer": 1, "coordinate_system": 1, "coordinate_system_base": 2}),
                "coordinate_system_base",
            ),
            ("Panel", json!({"action": "home", "numbers": [99]}), "numbers"),
            ("Panel", json!({"action": "home", "numbers": [0]}), "numbers"),
            ("Panel", json!({"action": "home", "numbers": []}), "numbers"),
            ("FeedOverride", json!({"coordinate_system": 9}), "coordinate_system"),
            ("FeedOverride", json!({"coordinate_system": 1, "raw": 32768}), "raw"),
        ] {
            is_invalid(engineer(method, parameters), name);
        }
        let after_the_end = json!({"host_offset": 0x3FFE, "words": [1, 2]});
        assert_eq!(engineer("Write", after_the_end), CallError::OutOfRange);
        assert!(board(Role::Engineer, "Write", json!({"host_offset": 0x3FFE, "words": [1]})).is_ok());
        for timeout in [0, -1, 600_001] {
            let error = engineer("Send", json!({"line": "?", "timeout_ms": timeout}));
            is_invalid(error, "timeout_ms");
        }
        assert!(matches!(engineer("Send", json!({"line": "a\rb"})), CallError::InvalidLine { .. }));
        is_invalid(engineer("Send", json!({"line": "?", "extra": 1})), "extra");
        is_invalid(engineer("SendControl", json!({"character": "K"})), "character");
        assert_eq!(engineer("Messages", json!({})), CallError::ExpectedMore);
    }

    #[test]
    fn unknown_names_are_said_back() {
        let unknown = called(Role::Engineer, "a.b.C", json!({})).unwrap_err();
        assert_eq!(unknown, CallError::InterfaceNotFound { interface: "a.b".to_owned() });
        let unknown = board(Role::Engineer, "Nothing", json!({})).unwrap_err();
        assert_eq!(unknown, CallError::MethodNotFound { method: format!("{BOARD}.Nothing") });
        assert!(called(Role::Engineer, "NoDot", json!({})).is_err());
        let unknown = called(
            Role::Engineer,
            "org.varlink.service.GetInterfaceDescription",
            json!({"interface": "x.y"}),
        );
        assert_eq!(unknown.unwrap_err(), CallError::InterfaceNotFound { interface: "x.y".to_owned() });
    }
}
