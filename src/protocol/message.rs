//! Calls and replies of Varlink, and the reading of a call's parameters.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::error::CallError;

/// A client's call.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Call {
    /// Interface and method, `io.github.pmac-dpram.Board.Send`.
    pub method: String,
    /// The parameters by name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Map<String, Value>>,
    /// The client wants no reply.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub oneway: Option<bool>,
    /// The client wants more than one reply.
    #[serde(default, skip_serializing_if = "is_unset")]
    pub more: Option<bool>,
    /// The client wants to use the connection for another protocol after this call.
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

    /// The interface and the method, or `None` when the name has no dot.
    #[must_use]
    pub fn interface_and_method(&self) -> Option<(&str, &str)> {
        self.method.rsplit_once('.')
    }
}

/// The service's reply.
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
    /// [`CallError::Protocol`] when `value` serialises otherwise.
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
        if let CallError::Protocol(what) = error {
            // Only a reply of ours that does not serialise; the caller learns at least that reason.
            return Self::of_error(&CallError::Unavailable { reason: what.clone() });
        }
        // An error serialises as a reply's fields `error` and, if it has parameters, `parameters`.
        let reply: Self = serde_json::to_value(error).and_then(serde_json::from_value).unwrap_or_default();
        Self { parameters: Some(reply.parameters.unwrap_or_default()), ..reply }
    }

    /// The error that the reply carries, or `None` when it carries none.
    #[must_use]
    pub fn error(&self) -> Option<CallError> {
        let name = self.error.as_ref()?;
        let parameters = self.parameters.clone().filter(|parameters| !parameters.is_empty());
        let reply = Self { parameters, continues: None, error: self.error.clone() };
        let error = serde_json::to_value(reply).and_then(serde_json::from_value);
        Some(error.unwrap_or_else(|_| CallError::Protocol(name.clone())))
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
    use crate::protocol::{BOARD, BOARD_DESCRIPTION, SERVICE, SERVICE_DESCRIPTION};

    #[test]
    fn a_call_is_its_shortest_json() {
        let call = Call::new("a.B".to_owned(), Map::new());
        assert_eq!(encode(&call), b"{\"method\":\"a.B\"}\0");
        assert_eq!(encode(&Reply::default()), b"{}\0");
        let more = Call { more: Some(true), ..call };
        assert_eq!(encode(&more), b"{\"method\":\"a.B\",\"more\":true}\0");
    }

    /// Every error, one after the other: the compiler asks for a new one here.
    fn following(error: Option<&CallError>) -> Option<CallError> {
        let text = || "why".to_owned();
        Some(match error {
            None => CallError::Board { code: 3, meaning: text(), lines: vec![text()] },
            Some(CallError::Board { .. }) => CallError::TimedOut { lines: vec![text(), text()] },
            Some(CallError::TimedOut { .. }) => CallError::Interrupted { reason: text() },
            Some(CallError::Interrupted { .. }) => CallError::Unavailable { reason: text() },
            Some(CallError::Unavailable { .. }) => CallError::Busy,
            Some(CallError::Busy) => CallError::NotPermitted { role_needed: text() },
            Some(CallError::NotPermitted { .. }) => CallError::InvalidLine { reason: text() },
            Some(CallError::InvalidLine { .. }) => CallError::Refused { reason: text() },
            Some(CallError::Refused { .. }) => CallError::StopFailed { reason: text() },
            Some(CallError::StopFailed { .. }) => CallError::OutOfRange,
            Some(CallError::OutOfRange) => {
                CallError::InvalidParameter { parameter: text(), expected: text() }
            }
            Some(CallError::InvalidParameter { .. }) => CallError::InterfaceNotFound { interface: text() },
            Some(CallError::InterfaceNotFound { .. }) => CallError::MethodNotFound { method: text() },
            Some(CallError::MethodNotFound { .. }) => CallError::ExpectedMore,
            Some(CallError::ExpectedMore) => CallError::Protocol(text()),
            Some(CallError::Protocol(_)) => return None,
        })
    }

    #[test]
    fn errors_survive_the_wire() {
        let every = std::iter::successors(following(None), |error| following(Some(error)));
        assert_eq!(every.clone().count(), 15);
        for error in every {
            let reply = Reply::of_error(&error);
            assert!(reply.parameters.is_some(), "{error}");
            let (interface, name) = reply.error.as_ref().unwrap().rsplit_once('.').unwrap();
            let description = match interface {
                BOARD => BOARD_DESCRIPTION,
                SERVICE => SERVICE_DESCRIPTION,
                _ => panic!("{reply:?}"),
            };
            assert!(description.contains(&format!("error {name} (")), "{name}");
            let expected = match error {
                CallError::Protocol(what) => CallError::Unavailable { reason: what },
                error => error,
            };
            assert_eq!(reply.error(), Some(expected));
        }
        assert_eq!(Reply::default().error(), None);
        let nothing_so_far = CallError::TimedOut { lines: Vec::new() };
        assert_eq!(Reply::of_error(&nothing_so_far).error(), Some(nothing_so_far));
        for foreign in ["x.Y", "io.github.pmac-dpram.Board.TimedOut"] {
            let reply = Reply { error: Some(foreign.to_owned()), ..Reply::default() };
            assert_eq!(reply.error(), Some(CallError::Protocol(foreign.to_owned())), "without parameters");
        }
    }
}
