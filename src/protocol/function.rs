//! The automatic functions of the DPRAM that the daemon uses. What nobody needs can be switched off in the configuration.

use serde::{Deserialize, Serialize};

use crate::map::Function;

/// The functions that are used, every one unless told otherwise. One that is not makes no bus access at all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Functions(Vec<Function>);

impl Default for Functions {
    fn default() -> Self {
        Self(Function::ALL.to_vec())
    }
}

impl Functions {
    /// Whether `function` is used.
    #[must_use]
    pub fn has(&self, function: Function) -> bool {
        self.0.contains(&function)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_go_by_their_names() {
        #[derive(Deserialize)]
        struct File {
            #[serde(default)]
            functions: Functions,
        }
        let parse = |text: &str| toml::from_str::<File>(text).map(|file| file.functions);
        assert!(Function::ALL.into_iter().all(|function| parse("").unwrap().has(function)));
        let two = parse("functions = ['servo', 'gather']").unwrap();
        assert!(two.has(Function::Gather) && !two.has(Function::Ascii));
        assert!(
            parse("functions = ['mailbox']").unwrap_err().to_string().contains("unknown variant `mailbox`")
        );
        for function in Function::ALL {
            assert_eq!(serde_json::to_value(function).unwrap(), function.name());
        }
    }
}
