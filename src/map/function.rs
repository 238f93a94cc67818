//! The automatic functions of the DPRAM by name, as the configuration, the command line and the socket call them.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// An automatic function of the DPRAM.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Function {
    // In the best order to enable them: the ASCII port first, for the other functions' lines; rotary buffers before a
    // gather buffer, since a board with a gather buffer defines no rotary buffer.
    /// Command lines, control characters, and texts that programs send.
    Ascii,
    /// Control panel requests and feed rate overrides.
    Panel,
    /// Motor data every so many servo cycles.
    Servo,
    /// Motor and coordinate-system data in the background.
    Background,
    /// Reading and writing of the users' registers in the background.
    Variables,
    /// Program lines in binary form.
    Rotary,
    /// Data gathering.
    Gather,
}

impl Function {
    /// Every function, in the best order to enable them.
    pub const ALL: [Self; 7] = [
        Self::Ascii,
        Self::Panel,
        Self::Servo,
        Self::Background,
        Self::Variables,
        Self::Rotary,
        Self::Gather,
    ];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Panel => "panel",
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Variables => "variables",
            Self::Rotary => "rotary",
            Self::Gather => "gather",
        }
    }
}

impl fmt::Display for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An unknown function name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no function {name:?}; there are {}", Function::ALL.map(Function::name).join(", "))]
pub struct UnknownFunction {
    /// The requested name.
    pub name: String,
}

impl FromStr for Function {
    type Err = UnknownFunction;

    fn from_str(name: &str) -> Result<Self, UnknownFunction> {
        Self::ALL
            .into_iter()
            .find(|function| function.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| UnknownFunction { name: name.to_owned() })
    }
}
