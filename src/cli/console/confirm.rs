//! Asks the user before pmacctl sends anything.

use std::io::{self, BufRead, IsTerminal, Write};

use crate::cli::context::{Context, Failure};

/// Returns whether to go on: `yes` is set, or the user at the terminal agrees.
///
/// # Errors
/// [`Failure::Request`] if stdin is not a terminal.
pub fn confirm(question: &str, yes: bool) -> Result<bool, Failure> {
    if yes {
        return Ok(true);
    }
    if !io::stdin().is_terminal() {
        return Err(Failure::Request(format!(
            "{question} Nobody can answer here, so nothing was sent; give --yes to send without asking"
        )));
    }
    let mut stderr = io::stderr();
    write!(stderr, "{question} [y/N] ").and_then(|()| stderr.flush())?;
    let mut answer = String::new();
    io::stdin().lock().read_line(&mut answer)?;
    Ok(is_yes(&answer))
}

/// The question whether to send the lines shown above.
pub fn sending(lines: usize, to: &str) -> String {
    match lines {
        1 => format!("Send this line to {to}?"),
        _ => format!("Send these {lines} lines to {to}?"),
    }
}

/// The board that would get the lines, by its daemon's name for it: a socket alone does not show the board.
pub fn board_of(context: &Context) -> Result<String, Failure> {
    Ok(format!("the board of {}", context.name()?.as_str()))
}

fn is_yes(answer: &str) -> bool {
    matches!(answer.trim().to_ascii_lowercase().as_str(), "y" | "yes")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_is_not_several() {
        assert_eq!(sending(1, "the board of x"), "Send this line to the board of x?");
        assert_eq!(sending(2, "the board of x"), "Send these 2 lines to the board of x?");
    }

    #[test]
    fn only_yes_is_yes() {
        assert!(is_yes("y\n") && is_yes(" YES \n"));
        assert!(!is_yes("") && !is_yes("\n") && !is_yes("n\n") && !is_yes("yeah\n"));
    }
}
