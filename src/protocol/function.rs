//! The automatic functions of the DPRAM that the daemon uses. What nobody needs can be switched off in the configuration.

use serde::{Deserialize, Serialize};

/// An automatic function of the DPRAM, as the daemon uses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Function {
    /// Servo fixed data into the segment.
    Servo,
    /// Background fixed data into the segment.
    Background,
    /// Command lines, control characters, and texts that programs send.
    Ascii,
    /// Background variables, read and written.
    Variables,
    /// Gathered samples into the segment.
    Gather,
    /// Control panel requests and feed rate overrides.
    Panel,
    /// Binary rotary buffers.
    Rotary,
}

impl Function {
    /// Every one.
    pub const ALL: [Self; 7] = [
        Self::Servo,
        Self::Background,
        Self::Ascii,
        Self::Variables,
        Self::Gather,
        Self::Panel,
        Self::Rotary,
    ];

    /// Its name in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Ascii => "ascii",
            Self::Variables => "variables",
            Self::Gather => "gather",
            Self::Panel => "panel",
            Self::Rotary => "rotary",
        }
    }
}

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
    fn a_function_has_one_name_in_configuration_and_set_up() {
        let mut configured = Function::ALL.map(Function::name);
        let mut set_up = crate::setup::enable::Function::ALL.map(crate::setup::enable::Function::name);
        configured.sort_unstable();
        set_up.sort_unstable();
        assert_eq!(configured, set_up);
    }

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
