//! How clients learn that the board's own programs use the words of a function.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::map::Function;

/// The beginning of the text of [`waits_for`].
pub const ASKS_FIRST: &str = "pmacd asks the board first where its M-variables point";

/// How far `pmacd` has read where the board's M-variables point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct DefinitionsRead {
    /// How many definitions the board has told.
    pub read: u32,
    /// How many definitions the board has.
    pub of: u32,
    /// How long the others take at the present rate, in seconds; `None` until the first came.
    pub seconds_left: Option<u32>,
}

/// Why the daemon does not use some functions yet, right after its start. While a program buffer is open the daemon
/// cannot ask the board: the question would become a program line.
#[must_use]
pub fn waits_for(buffer_is_open: bool, definitions: &DefinitionsRead) -> String {
    let DefinitionsRead { read, of, seconds_left } = definitions;
    let far = format!("{ASKS_FIRST} ({read} of {of} read)");
    match seconds_left {
        _ if buffer_is_open => format!(
            "{far}, and cannot while a program buffer is open: CLOSE by an engineer closes it; stops go as command lines meanwhile"
        ),
        Some(seconds @ 5..) => format!(
            "{far}; try again in about {seconds} s. Where the board's programs keep nothing in the function's words, name it in \
             shared_functions of its configuration; where they keep nothing in the DPRAM at all, write ask_m_variables = false there"
        ),
        _ => format!("{far}; try again in a few seconds"),
    }
}

/// M-variables of the board that point into the words of a function.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramWords {
    /// The function.
    pub function: Function,
    /// The first of the M-variables.
    pub variable: u32,
    /// The word that it points to, as `Y:$D012`.
    pub place: String,
    /// How many other M-variables point into the function's words.
    pub others: u32,
    /// Whether `pmacd` uses the function all the same.
    pub used: bool,
}

impl fmt::Display for ProgramWords {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { function, variable, place, others, used } = self;
        let name = function.name();
        let is_used = if *used { "is used although" } else { "is not used:" };
        write!(f, "the function `{name}` {is_used} M{variable} points to {place}")?;
        match others {
            0 => write!(f, ", one of its words")?,
            1 => write!(f, ", and another M-variable points into its words (pmacctl doctor --memory)")?,
            others => {
                write!(f, ", and {others} more M-variables point into its words (pmacctl doctor --memory)")?
            }
        }
        if *used {
            return Ok(());
        }
        write!(
            f,
            ". Move them, or write shared_functions = [\"{name}\"] in pmacd's configuration to use it all the same"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_long_is_told_the_seconds_and_the_settings_that_end_the_wait() {
        let text = |seconds_left| waits_for(false, &DefinitionsRead { read: 50, of: 8192, seconds_left });
        let long = text(Some(240));
        for told in ["50 of 8192", "240 s", "shared_functions", "ask_m_variables = false"] {
            assert!(long.contains(told), "{told}: {long}");
        }
        assert!(text(Some(3)).ends_with("try again in a few seconds"));
    }
}
