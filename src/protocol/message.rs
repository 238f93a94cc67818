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

/// A call's parameters, taken out one by one, so that what is left over is known to be too much.
#[derive(Debug)]
pub struct Parameters(Map<String, Value>);

impl Parameters {
    /// The parameters of `call`.
    #[must_use]
    pub fn of(call: &Call) -> Self {
        Self(call.parameters.clone().unwrap_or_default())
    }

    fn invalid(name: &str) -> CallError {
        CallError::InvalidParameter { parameter: name.to_owned() }
    }

    /// The string `name`.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] when it is missing or something else.
    pub fn string(&mut self, name: &str) -> Result<String, CallError> {
        match self.0.remove(name) {
            Some(Value::String(text)) => Ok(text),
            _ => Err(Self::invalid(name)),
        }
    }

    /// The integer `name`.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] when it is missing or something else.
    pub fn integer(&mut self, name: &str) -> Result<i64, CallError> {
        self.optional_integer(name)?.ok_or_else(|| Self::invalid(name))
    }

    /// The integer `name`, or `None` when it is missing or null.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] when it is something else.
    pub fn optional_integer(&mut self, name: &str) -> Result<Option<i64>, CallError> {
        match self.0.remove(name) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => value.as_i64().map(Some).ok_or_else(|| Self::invalid(name)),
        }
    }

    /// The value `name`, whatever it is.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] when it is missing or null.
    pub fn value(&mut self, name: &str) -> Result<Value, CallError> {
        self.optional_value(name).ok_or_else(|| Self::invalid(name))
    }

    /// The value `name`, or `None` when it is missing or null.
    pub fn optional_value(&mut self, name: &str) -> Option<Value> {
        self.0.remove(name).filter(|value| !value.is_null())
    }

    /// The boolean `name`, or `None` when it is missing or null.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] when it is something else.
    pub fn optional_bool(&mut self, name: &str) -> Result<Option<bool>, CallError> {
        match self.optional_value(name) {
            None => Ok(None),
            Some(Value::Bool(value)) => Ok(Some(value)),
            Some(_) => Err(Self::invalid(name)),
        }
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// [`CallError::InvalidParameter`] naming a parameter that nobody took.
    pub fn finish(self) -> Result<(), CallError> {
        match self.0.into_iter().next() {
            None => Ok(()),
            Some((name, _)) => Err(CallError::InvalidParameter { parameter: name }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parameters(value: Value) -> Parameters {
        let call: Call = serde_json::from_value(json!({"method": "a.B", "parameters": value})).unwrap();
        Parameters::of(&call)
    }

    #[test]
    fn parameters_are_named_when_they_are_wrong() {
        let invalid = |name: &str| CallError::InvalidParameter { parameter: name.to_owned() };
        assert_eq!(parameters(json!({"line": 1})).string("line"), Err(invalid("line")));
        assert_eq!(parameters(json!({})).integer("words"), Err(invalid("words")));
        assert_eq!(parameters(json!({"words": 1.5})).integer("words"), Err(invalid("words")));
        assert_eq!(parameters(json!({"words": u64::MAX})).integer("words"), Err(invalid("words")));
        assert_eq!(parameters(json!({"t": null})).optional_integer("t"), Ok(None));
        assert_eq!(parameters(json!({"t": "1"})).optional_integer("t"), Err(invalid("t")));
        assert_eq!(parameters(json!({"more": 1})).finish(), Err(invalid("more")));
        assert_eq!(parameters(json!(null)).finish(), Ok(()));
    }

    #[test]
    fn a_call_is_its_shortest_json() {
        let call = Call::new("a.B".to_owned(), Map::new());
        assert_eq!(encode(&call), b"{\"method\":\"a.B\"}\0");
        assert_eq!(encode(&Reply::default()), b"{}\0");
        let more = Call { more: Some(true), ..call };
        assert_eq!(encode(&more), b"{\"method\":\"a.B\",\"more\":true}\0");
    }
}
