//! Calls and replies of Varlink, and the reading of a call's parameters.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::error::CallError;
use super::{BOARD, SERVICE};

/// What a client asks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Call {
    /// Interface and method, `io.github.pmac-dpram.Board.Send`.
    pub method: String,
    /// The parameters by name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Map<String, Value>>,
    /// No reply is wanted.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub oneway: Option<bool>,
    /// More than one reply is wanted.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub more: Option<bool>,
    /// The connection is to become something else after this call.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub upgrade: Option<bool>,
}

fn is_unset(flag: &Option<bool>) -> bool {
    !flag.unwrap_or(false)
}

impl Call {
    /// A call of `method` with `parameters`.
    #[must_use]
    pub fn new(method: String, parameters: Map<String, Value>) -> Self {
        let parameters = (!parameters.is_empty()).then_some(parameters);
        Self { method, parameters, oneway: None, more: None, upgrade: None }
    }

    /// Interface and method apart, or `None` when there is no dot.
    #[must_use]
    pub fn interface_and_method(&self) -> Option<(&str, &str)> {
        self.method.rsplit_once('.')
    }
}

/// What the service answers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Reply {
    /// The reply's parameters, or the error's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Map<String, Value>>,
    /// Another reply to the same call follows.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub continues: Option<bool>,
    /// The error's full name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl Reply {
    /// The reply of a method that returns nothing.
    #[must_use]
    pub fn done() -> Self {
        Self { parameters: Some(Map::new()), ..Self::default() }
    }

    /// A reply that carries `value`, which must serialise as an object.
    ///
    /// # Errors
    /// [`CallError::Protocol`] when it does not.
    pub fn with<T: Serialize>(value: &T) -> Result<Self, CallError> {
        match serde_json::to_value(value) {
            Ok(Value::Object(parameters)) => Ok(Self { parameters: Some(parameters), ..Self::default() }),
            Ok(other) => Err(CallError::Protocol(format!("a reply must be an object, not {other}"))),
            Err(error) => Err(CallError::Protocol(error.to_string())),
        }
    }

    /// The reply of a call that ended in `error`.
    #[must_use]
    pub fn of_error(error: &CallError) -> Self {
        let (interface, name, parameters) = match error {
            CallError::Board { code, meaning, lines } => {
                (BOARD, "BoardError", json!({"code": code, "meaning": meaning, "lines": lines}))
            }
            CallError::TimedOut { lines } => (BOARD, "TimedOut", json!({"lines": lines})),
            CallError::Unavailable { reason } => (BOARD, "Unavailable", json!({"reason": reason})),
            CallError::Busy => (BOARD, "Busy", Value::Null),
            CallError::NotPermitted { role_needed } => {
                (BOARD, "NotPermitted", json!({"role_needed": role_needed}))
            }
            CallError::InvalidLine { reason } => (BOARD, "InvalidLine", json!({"reason": reason})),
            CallError::Refused { reason } => (BOARD, "Refused", json!({"reason": reason})),
            CallError::OutOfRange => (BOARD, "OutOfRange", Value::Null),
            CallError::InvalidParameter { parameter, expected } => {
                (SERVICE, "InvalidParameter", json!({"parameter": parameter, "expected": expected}))
            }
            CallError::InterfaceNotFound { interface } => {
                (SERVICE, "InterfaceNotFound", json!({"interface": interface}))
            }
            CallError::MethodNotFound { method } => (SERVICE, "MethodNotFound", json!({"method": method})),
            CallError::ExpectedMore => (SERVICE, "ExpectedMore", Value::Null),
            // Only a reply of our own that does not serialise; the caller learns at least that.
            CallError::Protocol(what) => (BOARD, "Unavailable", json!({"reason": what})),
        };
        let parameters = match parameters {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        Self { parameters: Some(parameters), continues: None, error: Some(format!("{interface}.{name}")) }
    }

    /// The error that the reply carries, or `None` when it carries none.
    #[must_use]
    pub fn error(&self) -> Option<CallError> {
        let full_name = self.error.as_deref()?;
        let fields = self.parameters.clone().unwrap_or_default();
        let text = |name: &str| fields.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        let lines = || {
            let lines = fields.get("lines").and_then(|lines| serde_json::from_value(lines.clone()).ok());
            lines.unwrap_or_default()
        };
        let (interface, name) = full_name.rsplit_once('.').unwrap_or(("", full_name));
        Some(match (interface, name) {
            (BOARD, "BoardError") => CallError::Board {
                code: fields
                    .get("code")
                    .and_then(Value::as_u64)
                    .and_then(|c| u16::try_from(c).ok())
                    .unwrap_or(0),
                meaning: text("meaning"),
                lines: lines(),
            },
            (BOARD, "TimedOut") => CallError::TimedOut { lines: lines() },
            (BOARD, "Unavailable") => CallError::Unavailable { reason: text("reason") },
            (BOARD, "Busy") => CallError::Busy,
            (BOARD, "NotPermitted") => CallError::NotPermitted { role_needed: text("role_needed") },
            (BOARD, "InvalidLine") => CallError::InvalidLine { reason: text("reason") },
            (BOARD, "Refused") => CallError::Refused { reason: text("reason") },
            (BOARD, "OutOfRange") => CallError::OutOfRange,
            (SERVICE, "InvalidParameter") => {
                CallError::InvalidParameter { parameter: text("parameter"), expected: text("expected") }
            }
            (SERVICE, "InterfaceNotFound") => CallError::InterfaceNotFound { interface: text("interface") },
            (SERVICE, "MethodNotFound") => CallError::MethodNotFound { method: text("method") },
            (SERVICE, "ExpectedMore") => CallError::ExpectedMore,
            _ => CallError::Protocol(full_name.to_owned()),
        })
    }
}

/// `message` as JSON with its NUL.
#[must_use]
pub fn encode<T: Serialize>(message: &T) -> Vec<u8> {
    // Our messages are structs of strings, numbers and maps with string keys, which always serialise.
    let mut bytes = serde_json::to_vec(message).unwrap_or_default();
    bytes.push(0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_is_its_shortest_json() {
        let call = Call::new("a.B".to_owned(), Map::new());
        assert_eq!(encode(&call), b"{\"method\":\"a.B\"}\0");
        assert_eq!(encode(&Reply::default()), b"{}\0");
        let more = Call { more: Some(true), ..call };
        assert_eq!(encode(&more), b"{\"method\":\"a.B\",\"more\":true}\0");
    }

    #[test]
    fn errors_survive_the_wire() {
        let text = || "why".to_owned();
        for error in [
            CallError::Board { code: 3, meaning: text(), lines: vec![text()] },
            CallError::TimedOut { lines: vec![text(), text()] },
            CallError::TimedOut { lines: Vec::new() },
            CallError::Unavailable { reason: text() },
            CallError::Busy,
            CallError::NotPermitted { role_needed: text() },
            CallError::InvalidLine { reason: text() },
            CallError::OutOfRange,
            CallError::InvalidParameter { parameter: text(), expected: text() },
            CallError::InterfaceNotFound { interface: text() },
            CallError::MethodNotFound { method: text() },
            CallError::ExpectedMore,
        ] {
            assert_eq!(Reply::of_error(&error).error(), Some(error));
        }
        assert_eq!(Reply::default().error(), None);
        let foreign = Reply { error: Some("x.Y".to_owned()), ..Reply::default() };
        assert_eq!(foreign.error(), Some(CallError::Protocol("x.Y".to_owned())));
    }
}
