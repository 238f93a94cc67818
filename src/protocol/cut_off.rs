//! Commands that affect every client, so that the sender must confirm them: commands that end command lines through
//! the DPRAM, with the cure, and commands that end the work of others.

use super::{CallError, control};
use crate::language::Meaning;
use crate::language::settings::CutsOff;

/// Whether a control character ends command lines: `^Z` makes the serial port the active response port, and I58 0 (the
/// same page).
#[must_use]
pub const fn character_cuts_off(character: u8) -> bool {
    character == control::SERIAL
}

/// The refusal for a caller that has not confirmed `what`, which ends command lines as `cuts_off` says.
#[must_use]
pub fn refusal(what: &str, cuts_off: CutsOff) -> CallError {
    let ends = match cuts_off {
        CutsOff::May => {
            "sets an I-variable whose number the board alone can compute, and may be one that ends"
        }
        _ => "ends",
    };
    let cure = if cuts_off == CutsOff::Place { "I24=$60000" } else { "I58=1" };
    let reason = format!(
        "not sent: {what} {ends} command lines through the DPRAM for everybody, until {cure} comes by the serial port (pmacctl setup \
         enable ascii --send --port PATH) or the board is reset; --yes sends it all the same (\"confirmed\" in a call)"
    );
    CallError::Refused { reason }
}

/// The command of a line that ends what others have open and run: a reset, or `SAVE`, which takes the board seconds.
#[must_use]
pub fn ends_work(line: &Meaning) -> Option<&'static str> {
    if line.resets { Some("$$$") } else { line.saves.then_some("SAVE") }
}

/// The refusal for a caller that has not confirmed that `command` shall end the `work` of others.
#[must_use]
pub fn ends_work_refusal(command: &str, work: &str) -> CallError {
    let ends = if command == "SAVE" { "may hold up or end" } else { "ends" };
    let reason =
        format!("not sent: {command} {ends} {work}; --yes sends it all the same (\"confirmed\" in a call)");
    CallError::Refused { reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_tells_how_command_lines_come_back() {
        assert!(character_cuts_off(26) && !character_cuts_off(11));
        let told = refusal("I58=0", CutsOff::Enable).to_string();
        assert!(told.contains("not sent") && told.contains("I58=1") && told.contains("--yes"), "{told}");
        assert!(refusal("I24=$6C000", CutsOff::Place).to_string().contains("until I24=$60000 comes"));
        let told = refusal("I(P1)=0", CutsOff::May).to_string();
        assert!(told.contains("whose number the board alone can compute"), "{told}");
    }
}
