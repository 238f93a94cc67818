//! What a call means: checked against the interface and the caller's role before anything reaches the bus thread.

use std::time::Duration;

use serde_json::json;

use super::info::SharedInfo;
use super::jobs::{self, JobCall};
use super::policy::Role;
use super::queue::{DEFAULT_TIMEOUT, LINE_MAX, READ_MAX, Text};
use crate::map::HostOffset;
use crate::protocol::{
    BOARD, BOARD_DESCRIPTION, Call, CallError, Function, Parameters, Reply, SERVICE, SERVICE_DESCRIPTION,
    TIMEOUT_MAX_MS, check_line, control,
};

/// The end of the largest DPRAM of any family is far below this, in bytes; offsets above it are refused unasked.
const OFFSET_LIMIT: i64 = 1 << 20;

/// What a call asks of the bus thread.
#[derive(Debug)]
pub enum Ask {
    /// Send a command line.
    Send {
        /// The line, of printable characters.
        line: Text<LINE_MAX>,
        /// How long the board may take.
        timeout: Duration,
    },
    /// Send a control character.
    Control {
        /// The character, 1 to 31.
        character: u8,
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
}

/// What is to be done about a call.
#[derive(Debug)]
pub enum Action {
    /// Answer at once.
    Reply(Reply),
    /// Ask the bus thread.
    Ask(Ask),
    /// Pass on every unsolicited text from now on.
    Stream,
    /// Renew the caller's lease on a jog.
    Renew,
}

/// Finds out what `call` by a caller of `role` means.
///
/// # Errors
/// What to answer instead.
pub fn understand(call: &Call, role: Role, info: &SharedInfo) -> Result<Action, CallError> {
    let Some((interface, method)) = call.interface_and_method() else {
        return Err(CallError::InvalidParameter { parameter: "method".to_owned() });
    };
    if call.upgrade == Some(true) {
        return Err(CallError::InvalidParameter { parameter: "upgrade".to_owned() });
    }
    if let (BOARD, Some(function)) = (interface, function_of(method))
        && !info.settings().functions.has(function)
    {
        let name = function.name();
        let reason = format!(
            "the function `{name}` is switched off: `functions` in the daemon's configuration leaves it out"
        );
        return Err(CallError::Refused { reason });
    }
    let mut parameters = Parameters::of(call);
    match interface {
        SERVICE => service(method, parameters, call),
        BOARD => match method {
            "GetInfo" => {
                parameters.finish()?;
                Reply::with(&info.read()).map(Action::Reply)
            }
            "GetSettings" => {
                parameters.finish()?;
                Reply::with(info.settings()).map(Action::Reply)
            }
            "Send" => {
                require(role, Role::Engineer)?;
                send(parameters)
            }
            "SendControl" => {
                require(role, Role::Operate)?;
                let text = parameters.string("character")?;
                parameters.finish()?;
                let character = control::parse(&text)
                    .ok_or_else(|| CallError::InvalidParameter { parameter: "character".to_owned() })?;
                Ok(Action::Ask(Ask::Control { character }))
            }
            "Read" => read(parameters),
            "Messages" => {
                parameters.finish()?;
                if call.more == Some(true) { Ok(Action::Stream) } else { Err(CallError::ExpectedMore) }
            }
            "PanelRenew" => {
                parameters.finish()?;
                Ok(Action::Renew)
            }
            "WatchVariables" => {
                let entries = jobs::watched(parameters)?;
                if call.more == Some(true) {
                    Ok(Action::Ask(Ask::Job(JobCall::watch(entries))))
                } else {
                    Err(CallError::ExpectedMore)
                }
            }
            _ => match jobs::understand(method, parameters) {
                Some(asked) => {
                    require(role, jobs::role_for(method))?;
                    Ok(Action::Ask(Ask::Job(asked?)))
                }
                None => Err(CallError::MethodNotFound { method: call.method.clone() }),
            },
        },
        _ => Err(CallError::InterfaceNotFound { interface: interface.to_owned() }),
    }
}

/// The function of the board that a method needs, if it needs one.
fn function_of(method: &str) -> Option<Function> {
    Some(match method {
        "Send" | "SendControl" | "Messages" => Function::Ascii,
        "Panel" | "PanelHold" | "PanelRenew" | "FeedOverride" => Function::Panel,
        "WatchVariables" | "WriteVariables" => Function::Variables,
        "GatherBegin" | "GatherEnd" => Function::Gather,
        "RotaryOpen" | "RotarySend" | "RotaryFinish" | "RotaryState" => Function::Rotary,
        _ => return None,
    })
}

pub(super) fn require(role: Role, needed: Role) -> Result<(), CallError> {
    if role >= needed { Ok(()) } else { Err(CallError::NotPermitted { role_needed: needed.to_string() }) }
}

fn service(method: &str, mut parameters: Parameters, call: &Call) -> Result<Action, CallError> {
    match method {
        "GetInfo" => {
            parameters.finish()?;
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
            let interface = parameters.string("interface")?;
            parameters.finish()?;
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

fn send(mut parameters: Parameters) -> Result<Action, CallError> {
    let line = parameters.string("line")?;
    let timeout = match parameters.optional_integer("timeout_ms")?.map(u64::try_from) {
        None => DEFAULT_TIMEOUT,
        Some(Ok(ms @ 1..=TIMEOUT_MAX_MS)) => Duration::from_millis(ms),
        Some(_) => return Err(CallError::InvalidParameter { parameter: "timeout_ms".to_owned() }),
    };
    parameters.finish()?;
    check_line(&line).map_err(|reason| CallError::InvalidLine { reason })?;
    let line = Text::new(line.as_bytes())
        .ok_or_else(|| CallError::InvalidLine { reason: "the line is too long".to_owned() })?;
    Ok(Action::Ask(Ask::Send { line, timeout }))
}

fn read(mut parameters: Parameters) -> Result<Action, CallError> {
    let offset = parameters.integer("host_offset")?;
    let words = parameters.integer("words")?;
    parameters.finish()?;
    if !(0..OFFSET_LIMIT).contains(&offset) {
        return Err(CallError::OutOfRange);
    }
    let first = u32::try_from(offset)
        .ok()
        .and_then(HostOffset::checked)
        .ok_or_else(|| CallError::InvalidParameter { parameter: "host_offset".to_owned() })?;
    match usize::try_from(words) {
        Ok(count @ 1..=READ_MAX) => Ok(Action::Ask(Ask::Read { first, count })),
        _ => Err(CallError::OutOfRange),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn understand(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
        let call: Call = serde_json::from_value(json!({"method": method, "parameters": parameters})).unwrap();
        super::understand(&call, role, &SharedInfo::default())
    }

    fn board(role: Role, method: &str, parameters: Value) -> Result<Action, CallError> {
        understand(role, &format!("{BOARD}.{method}"), parameters)
    }

    #[test]
    fn each_method_needs_its_role() {
        for (method, parameters, needed) in [
            ("GetInfo", json!({}), Role::Observe),
            ("Read", json!({"host_offset": 0, "words": 1}), Role::Observe),
            ("SendControl", json!({"character": "^K"}), Role::Operate),
            ("Send", json!({"line": "#1J+"}), Role::Engineer),
        ] {
            for role in [Role::Observe, Role::Operate, Role::Engineer] {
                let found = board(role, method, parameters.clone());
                let refused = matches!(&found, Err(CallError::NotPermitted { role_needed })
                    if *role_needed == needed.to_string());
                assert_eq!(refused, role < needed, "{method} by {role}: {found:?}");
                assert_eq!(found.is_ok(), role >= needed);
            }
        }
    }

    #[test]
    fn a_method_of_a_function_that_is_switched_off_says_so() {
        let with = |functions: Value| {
            let settings = crate::protocol::BoardSettings {
                functions: serde_json::from_value(functions).unwrap(),
                ..Default::default()
            };
            SharedInfo::new(crate::protocol::BoardInfo::default(), settings)
        };
        let methods = BOARD_DESCRIPTION.lines().filter_map(|line| line.strip_prefix("method "));
        let methods: Vec<_> = methods.filter_map(|line| line.split('(').next()).collect();
        assert_eq!(methods.len(), 19, "{methods:?}");
        for method in methods {
            let call = json!({"method": format!("{BOARD}.{method}"), "parameters": {}});
            let call: Call = serde_json::from_value(call).unwrap();
            let refused = |functions: Value| match super::understand(&call, Role::Engineer, &with(functions))
            {
                Err(CallError::Refused { reason }) => reason.contains("is switched off"),
                _ => false,
            };
            let needed = function_of(method);
            assert_eq!(refused(json!([])), needed.is_some(), "{method}");
            assert_eq!(needed.is_none(), ["GetInfo", "GetSettings", "Read", "Write"].contains(&method));
            assert!(!needed.is_some_and(|function| refused(json!([function]))), "{method}");
        }
    }

    #[test]
    fn nothing_out_of_bounds_passes() {
        let engineer = |method, parameters| board(Role::Engineer, method, parameters).unwrap_err();
        let invalid = |name: &str| CallError::InvalidParameter { parameter: name.to_owned() };
        let read = |offset: i64, words: i64| engineer("Read", json!({"host_offset": offset, "words": words}));
        assert_eq!(read(1, 1), invalid("host_offset"));
        assert_eq!(read(-2, 1), CallError::OutOfRange);
        assert_eq!(read(i64::MAX, 1), CallError::OutOfRange);
        assert_eq!(read(0, 0), CallError::OutOfRange);
        assert_eq!(read(0, 65), CallError::OutOfRange);
        // Its end has no offset of 32 bits.
        let last = json!({"host_offset": u32::MAX - 1, "words": [1], "anywhere": true});
        assert_eq!(engineer("Write", last), CallError::OutOfRange);
        let after_the_end = json!({"host_offset": 0x3FFE, "words": [1, 2]});
        assert_eq!(engineer("Write", after_the_end), CallError::OutOfRange);
        assert!(board(Role::Engineer, "Write", json!({"host_offset": 0x3FFE, "words": [1]})).is_ok());
        for timeout in [0, -1, 600_001] {
            let error = engineer("Send", json!({"line": "?", "timeout_ms": timeout}));
            assert_eq!(error, invalid("timeout_ms"));
        }
        assert!(matches!(engineer("Send", json!({"line": "a\rb"})), CallError::InvalidLine { .. }));
        assert_eq!(engineer("Send", json!({"line": "?", "extra": 1})), invalid("extra"));
        assert_eq!(engineer("SendControl", json!({"character": "K"})), invalid("character"));
        assert_eq!(engineer("Messages", json!({})), CallError::ExpectedMore);
    }

    #[test]
    fn unknown_names_are_said_back() {
        let unknown = understand(Role::Engineer, "a.b.C", json!({})).unwrap_err();
        assert_eq!(unknown, CallError::InterfaceNotFound { interface: "a.b".to_owned() });
        let unknown = board(Role::Engineer, "Nothing", json!({})).unwrap_err();
        assert_eq!(unknown, CallError::MethodNotFound { method: format!("{BOARD}.Nothing") });
        assert!(understand(Role::Engineer, "NoDot", json!({})).is_err());
        let unknown = understand(
            Role::Engineer,
            "org.varlink.service.GetInterfaceDescription",
            json!({"interface": "x.y"}),
        );
        assert_eq!(unknown.unwrap_err(), CallError::InterfaceNotFound { interface: "x.y".to_owned() });
    }
}
