//! What ends command lines for everybody, and how to get them back.

use crate::cli::context::Failure;

/// Refuses `text`, a line or a control character as `^Z`, if it ends command lines through the DPRAM and nobody said `yes`.
///
/// # Errors
/// [`Failure::Request`] with the cure.
pub fn refuse_cut_off(text: &str, yes: bool) -> Result<(), Failure> {
    if yes || !cuts_off(text) {
        return Ok(());
    }
    Err(Failure::Request(format!(
        "not sent: {text} ends command lines through the DPRAM for everybody, until I58=1 comes by the serial port (pmacctl setup \
         enable ascii --send --port PATH) or the board is reset; --yes sends it all the same"
    )))
}

/// `^Z` makes the serial port the active response port and sets I58 to 0 (DPRAM manual p. 28); I58 with any other value than 1
/// does the same.
fn cuts_off(text: &str) -> bool {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_ascii_uppercase();
    if text == "^Z" || text == "\u{1a}" {
        return true;
    }
    text.match_indices("I58=").any(|(at, name)| {
        let is_name = !text[..at].ends_with(|c: char| c.is_ascii_alphabetic());
        let value: String =
            text[at + name.len()..].chars().take_while(|c| !c.is_ascii_alphabetic()).collect();
        is_name && value != "1"
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b2_5_what_cuts_everybody_off_is_known() {
        for text in
            ["^Z", "^z", "\u{1a}", "I58=0", "i 58 = 0", "P1=3 I58=0", "I58=$0", "I58=P1", "I58=1I58=0"]
        {
            assert!(cuts_off(text), "{text}");
            assert!(refuse_cut_off(text, true).is_ok());
        }
        for text in ["^K", "I58", "I58=1", "I58=1 P1=0", "I158=0", "MI58=0", "Z", "P58=0"] {
            assert!(!cuts_off(text), "{text}");
        }
        let told = refuse_cut_off("I58=0", false).unwrap_err().to_string();
        assert!(told.contains("not sent") && told.contains("I58=1") && told.contains("--yes"), "{told}");
    }
}
