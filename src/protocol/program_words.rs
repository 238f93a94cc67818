//! What the board's own programs keep in the words of a function, as clients are told.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::map::Function;

/// What functions wait for that are not used yet, right after the daemon's start. While a program buffer is open the board cannot
/// be asked: the question would be a program line.
#[must_use]
pub const fn waits_for(buffer_is_open: bool) -> &'static str {
    if buffer_is_open {
        "pmacd asks the board first where its M-variables point, and cannot while a program buffer is open: CLOSE by an engineer \
         closes it; stops go as command lines meanwhile"
    } else {
        "pmacd asks the board first where its M-variables point; try again in a few seconds"
    }
}

/// M-variables of the board that point into the words of a function.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramWords {
    /// The function.
    pub function: Function,
    /// The first of the M-variables.
    pub variable: u32,
    /// The word it points to, as `Y:$D012`.
    pub place: String,
    /// How many others point into the function's words.
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
            1 => write!(f, ", and another M-variable into its words, too")?,
            others => write!(f, ", and {others} other M-variables into its words, too")?,
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
