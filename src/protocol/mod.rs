//! The command socket's messages (layer 1): Varlink, NUL-terminated JSON over a Unix stream socket.
//!
//! A call is `{"method": …, "parameters": {…}}`; a reply is `{"parameters": {…}}` or `{"error": …, "parameters": {…}}`
//! (varlink.org). Replies come in the order of their calls. The interface itself is the text in [`BOARD_DESCRIPTION`].

pub mod answer;
pub mod board;
pub mod calls;
pub mod control;
pub mod cut_off;
pub mod error;
pub mod frame;
pub mod function;
pub mod message;
pub mod mirror_selection;
pub mod parameters;
pub mod program_words;
pub mod settings;
pub mod socket_place;
pub mod transport;

pub use crate::language::LINE_MAX;
pub use crate::map::Function;
pub use board::{
    BoardInfo, CommandLinesInfo, CommandPort, CommandState, Enabled, HostPortCounts, HostPortInfo, Message,
    MessageKind, OpenBufferInfo, State,
};
pub use error::CallError;
pub use frame::Inbox;
pub use function::Functions;
pub use message::{Call, Reply};
pub use mirror_selection::{BackgroundSettings, ServoSettings};
pub use parameters::parameters;
pub use program_words::ProgramWords;
pub use settings::{BoardSettings, VariableMode, VariablesSettings};

/// The name of our interface.
pub const BOARD: &str = "io.github.pmac-dpram.Board";
/// The name of the interface that every Varlink service has.
pub const SERVICE: &str = "org.varlink.service";
/// The definition of [`BOARD`].
pub const BOARD_DESCRIPTION: &str = include_str!("io.github.pmac-dpram.Board.varlink");
/// The definition of [`SERVICE`].
pub const SERVICE_DESCRIPTION: &str = include_str!("org.varlink.service.varlink");

/// The longest message, in bytes, that either side accepts from a peer whose reply it did not ask for.
pub const CALL_MAX: usize = 64 * 1024;
/// The longest reply a client accepts, in bytes.
pub const REPLY_MAX: usize = 8 * 1024 * 1024;
/// The most lines that one call of [`BOARD`]'s `RunLines` takes: so many always fit into [`CALL_MAX`], however they
/// are escaped.
pub const RUN_LINES_MAX: usize = 128;
/// The most words [`BOARD`]'s `Read` takes.
pub const READ_MAX: usize = 64;
/// The longest time-out [`BOARD`]'s `Send` takes, in milliseconds.
pub const TIMEOUT_MAX_MS: u64 = 600_000;

/// Checks that a board can take `line`.
///
/// A line is 1 to [`LINE_MAX`] printable ASCII characters. Control characters act on the board at once, whichever line
/// holds them, so they have a method of their own.
///
/// # Errors
/// The fault in the line, and its place.
pub fn check_line(line: &str) -> Result<(), String> {
    if line.is_empty() {
        return Err("the line is empty".to_owned());
    }
    if let Some((at, found)) = line.char_indices().find(|(_, c)| !(' '..='~').contains(c)) {
        let advice = if found.is_ascii_control() { "; SendControl sends control characters" } else { "" };
        return Err(format!("character {found:?} at position {at} is not printable ASCII{advice}"));
    }
    if line.len() > LINE_MAX {
        return Err(format!("the line has {} characters; the board takes {LINE_MAX}", line.len()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_as_long_as_the_boards_that_take_the_longest_have_it() {
        let limits = crate::map::FAMILIES.iter().map(|family| family.ascii.line_limit);
        assert_eq!(limits.max(), Some(LINE_MAX));
    }

    #[test]
    fn lines_are_printable_and_bounded() {
        assert_eq!(check_line("#1J+"), Ok(()));
        assert_eq!(check_line(&"x".repeat(LINE_MAX)), Ok(()));
        assert!(check_line(&"x".repeat(LINE_MAX + 1)).unwrap_err().contains("201"));
        assert!(check_line("").is_err());
        assert!(check_line("#1J+\r").unwrap_err().contains("position 4"));
        assert!(check_line("\u{b}").unwrap_err().contains("SendControl"));
        assert!(check_line("I5 =\t2").unwrap_err().contains("position 4"));
        assert!(check_line("a\0").is_err());
        assert!(check_line("\u{7f}").is_err());
        assert!(check_line("ü").is_err());
    }
}
