//! Calls and replies of Varlink, and the reading of a call's parameters.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::board::CallError;

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
}
