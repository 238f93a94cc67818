//! The automatic functions of the DPRAM that the daemon uses. The configuration can switch off functions that a site
//! does not need.

use serde::{Deserialize, Serialize};

use crate::map::{Family, Function};

/// The name that clients see for an unknown family.
pub const NO_FAMILY: &str = "unknown";

/// Why the daemon uses no function on a board of an unknown family.
pub const UNKNOWN_FAMILY: &str = "the board's family is not known, so pmacd writes nothing to it; write family = \"pmac\", \"pmac2\", \"turbo\" \
     or \"turbo2\" in its configuration, or switch the servo report on by another way, and start pmacd again";

/// The functions that the daemon uses; by default all of them. A function that it does not use makes no bus access at
/// all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Functions(Vec<Function>);

impl Default for Functions {
    fn default() -> Self {
        Self(Function::ALL.to_vec())
    }
}

impl Functions {
    /// Every function that `pmacd` can use on a board of `family`.
    #[must_use]
    pub fn all(family: &Family) -> Self {
        Self(family.functions.to_vec())
    }

    /// No function: the daemon does not know the board's family, and leaves the board alone.
    #[must_use]
    pub const fn none() -> Self {
        Self(Vec::new())
    }

    /// These functions without `function`.
    #[must_use]
    pub fn without(mut self, function: Function) -> Self {
        self.0.retain(|own| *own != function);
        self
    }

    /// Whether the daemon uses none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The first of them that `pmacd` does not use on a board of `family`, and its place in the list.
    #[must_use]
    pub fn impossible(&self, family: &Family) -> Option<(usize, Function)> {
        let mut functions = self.0.iter().copied().enumerate();
        functions.find(|(_, function)| !family.functions.contains(function))
    }

    /// Why the daemon does not use `function` on a board of `family`.
    #[must_use]
    pub fn why_not(&self, function: Function, family: &Family) -> String {
        if self.is_empty() {
            return UNKNOWN_FAMILY.to_owned();
        }
        let name = function.name();
        if family.functions.contains(&function) {
            return format!(
                "the function `{name}` is switched off: `functions` in the daemon's configuration leaves it out"
            );
        }
        let instead = if function == Function::Panel {
            "; jog-stop, stop and hold go as command lines, and command lines do what the panel's other keys do: #1J+, #1J-, \
             #1J=, #1HM, &1R, &1S, &1%50"
        } else {
            ""
        };
        format!(
            "pmacd does not use the function `{name}` on a {}: no text tells of a firmware that acts on its words{instead}",
            family.title
        )
    }

    /// Whether the daemon uses `function`.
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
