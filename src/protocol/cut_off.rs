//! What does something to everybody, so that who sends it has to confirm that he means it: what ends command lines through the DPRAM,
//! and how to get them back; and what ends the work of others.

use super::i_lines::{Numbers, Setting, settings};
use super::{CallError, control, line, tokens};

/// The I-variable that switches command lines through the DPRAM on, in every family.
const ENABLE: u32 = 58;

/// Turbo boards: where the DPRAM is that the board uses, $60000 being the one on the host's bus (FACTS-TURBO 15). PMAC boards have the
/// address of something to gather there, which is none of these.
const PLACE: u32 = 24;
const BUS: u32 = 0x6_0000;
const OTHERS: std::ops::RangeInclusive<u32> = 0x6_4000..=0x7_C000;

/// Whether `line` ends command lines: I58 with any other value than 1 does (DPRAM manual p. 28), and on a Turbo board I24 with the
/// address of another DPRAM.
#[must_use]
pub fn line_cuts_off(line: &str) -> bool {
    cure(line).is_some()
}

/// Whether `line`, carried out at once, may do so: it sets a variable whose number the board alone can compute. In a program such lines
/// are common, and few mean these.
#[must_use]
pub fn line_may_cut_off(line: &str) -> bool {
    let is_untold = |setting: Setting| setting.numbers == Numbers::Unknown && setting.value != Some(1);
    line_cuts_off(line) || settings(line.as_bytes()).any(is_untold)
}

/// The line that gives command lines back behind `line`, if that ends them.
fn cure(line: &str) -> Option<String> {
    let mut all = settings(line.as_bytes());
    all.find_map(|setting| match setting.value {
        value if setting.numbers.has(ENABLE) && value != Some(1) => Some(format!("I{ENABLE}=1")),
        Some(value)
            if setting.numbers.has(PLACE)
                && OTHERS.contains(&value)
                && value % (OTHERS.start() - BUS) == 0 =>
        {
            Some(format!("I{PLACE}=${BUS:05X}"))
        }
        _ => None,
    })
}

/// Whether a control character does: `^Z` makes the serial port the active response port, and I58 0 (the same page).
#[must_use]
pub const fn character_cuts_off(character: u8) -> bool {
    character == control::SERIAL
}

/// What a caller is told who has not confirmed that he means it.
#[must_use]
pub fn refusal(what: &str) -> CallError {
    let ends = if line_may_cut_off(what) && !line_cuts_off(what) {
        "sets an I-variable whose number the board alone can compute, and may be one that ends"
    } else {
        "ends"
    };
    let cure = cure(what).unwrap_or_else(|| format!("I{ENABLE}=1"));
    let reason = format!(
        "not sent: {what} {ends} command lines through the DPRAM for everybody, until {cure} comes by the serial port (pmacctl setup \
         enable ascii --send --port PATH) or the board is reset; --yes sends it all the same (\"confirmed\" in a call)"
    );
    CallError::Refused { reason }
}

/// The command of `line` that ends what others have open and run: a reset, or `SAVE`, which takes the board seconds.
#[must_use]
pub fn ends_work(line: &str) -> Option<&'static str> {
    if line::resets(line.as_bytes()) {
        return Some("$$$");
    }
    let mut saves = false;
    tokens::each_known(line.as_bytes(), |line, token| saves |= &line[token.span.clone()] == b"SAVE");
    saves.then_some("SAVE")
}

/// What a caller is told who has not confirmed that `command` is to end the `work` of others.
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
    fn b2_5_what_cuts_everybody_off_is_known() {
        for line in [
            "I58=0",
            "i 58 = 0",
            "P1=3 I58=0",
            "I58=$0",
            "I58=P1",
            "I58=1I58=0",
            "I58=*",
            "I50..60=0",
            "I8,6,10=0",
            "I(58)=0",
            "I(57+1)=0",
            "I(50)..60=0",
            "I8250=0",
            "I58=1-1",
            "I55=1 I50..58=2",
            "I24=$6C000",
            "I24=$64000 P1=1",
        ] {
            assert!(line_cuts_off(line), "{line}");
        }
        for line in [
            "I58",
            "I58=1",
            "I58=1 P1=0",
            "I158=0",
            "MI58=0",
            "Z",
            "P58=0",
            "I50..57=0",
            "I48,2,11=0 I58=1",
            "I0..99=1",
            "I58=1#1J+",
            "I(57)=0",
            "I(P1)=0",
            "I24=$60000",
            "I24=$80002B",
            "I24=0",
            "I124=$6C000",
        ] {
            assert!(!line_cuts_off(line), "{line}");
        }
        for line in ["I(P1)=0", "I(P1*100+20)=P2", "P1=5 I50..(P1)=0"] {
            assert!(line_may_cut_off(line) && !line_cuts_off(line), "{line}");
            assert!(refusal(line).to_string().contains("whose number the board alone can compute"), "{line}");
        }
        assert!(!line_may_cut_off("I(P1)=1") && !line_may_cut_off("I(P1)") && !line_may_cut_off("P(P1)=0"));
        assert!(character_cuts_off(26) && !character_cuts_off(11));
        let told = refusal("I58=0").to_string();
        assert!(told.contains("not sent") && told.contains("I58=1") && told.contains("--yes"), "{told}");
        assert!(refusal("I24=$6C000").to_string().contains("until I24=$60000 comes"));
    }

    #[test]
    fn what_ends_others_work_is_known() {
        for (line, command) in [
            ("$$$", "$$$"),
            ("P1=5 $$$***", "$$$"),
            ("save", "SAVE"),
            ("#1J/ SAVE", "SAVE"),
            ("SAVE#1J+", "SAVE"),
        ] {
            assert_eq!(ends_work(line), Some(command), "{line}");
        }
        for line in ["MS$$$0", "MSSAVE0", "#1$", "CMD\"$$$\"", "SAVEX", "P1"] {
            assert_eq!(ends_work(line), None, "{line}");
        }
    }
}
