//! Words of the command language that a rotary program cannot have, and why.
//!
//! Branches and loops are for stored programs only (DPRAM manual p. 30, rule 6); some program commands have no binary
//! code; other words are no program commands.

use super::reason::Reason;

/// Why the compiler refuses a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// Branches, loops and their parts.
    Branch,
    /// Text sent from within a program.
    Text,
    /// On-line only.
    OnLine,
    /// The command has no binary code.
    NoCode,
    /// WAIT.
    Wait,
    /// N and O.
    Label,
    /// A function, as in expressions.
    Function,
}

/// A word and why the compiler refuses it.
#[derive(Debug, PartialEq, Eq)]
pub struct RefusedWord {
    /// The word in capitals.
    pub name: &'static str,
    /// Why.
    pub why: Why,
    /// The full words, for a short form or a word that may also be written as two.
    pub means: Option<&'static str>,
    /// Whether a list of motors or PLCs follows.
    pub takes_list: bool,
}

impl RefusedWord {
    /// The reason to report.
    pub fn reason(&self) -> Reason {
        match self.why {
            Why::Branch => Reason::Branch(self.name),
            Why::Text => Reason::Text(self.name),
            Why::OnLine => Reason::OnLine(self.name.to_owned()),
            Why::NoCode => Reason::NoCode(self.name),
            Why::Wait => Reason::Wait,
            Why::Label => Reason::Label(self.name),
            Why::Function => Reason::Expression,
        }
    }
}

const fn word(name: &'static str, why: Why) -> RefusedWord {
    RefusedWord { name, why, means: None, takes_list: false }
}

const fn form(name: &'static str, means: &'static str, why: Why) -> RefusedWord {
    RefusedWord { name, why, means: Some(means), takes_list: false }
}

const fn listed(name: &'static str) -> RefusedWord {
    RefusedWord { name, why: Why::NoCode, means: None, takes_list: true }
}

/// All refused words.
pub static REFUSED: &[RefusedWord] = &[
    word("IF", Why::Branch),
    word("ELSE", Why::Branch),
    form("ENDIF", "END IF", Why::Branch),
    form("ENDI", "END IF", Why::Branch),
    word("WHILE", Why::Branch),
    form("ENDWHILE", "END WHILE", Why::Branch),
    form("ENDW", "END WHILE", Why::Branch),
    word("AND", Why::Branch),
    word("OR", Why::Branch),
    word("GOTO", Why::Branch),
    word("GOSUB", Why::Branch),
    form("GOS", "GOSUB", Why::Branch),
    word("RETURN", Why::Branch),
    form("RET", "RETURN", Why::Branch),
    word("READ", Why::Branch),
    word("COMMAND", Why::Text),
    form("CMD", "COMMAND", Why::Text),
    word("SEND", Why::Text),
    word("SENDS", Why::Text),
    word("SENDP", Why::Text),
    // Not its short form DISP: DISPLC means DIS PLC.
    form("DISPLAY", "DISP", Why::Text),
    word("ADDRESS", Why::NoCode),
    form("ADR", "ADDRESS", Why::NoCode),
    listed("SETPHASE"),
    word("LOCK", Why::NoCode),
    word("UNLOCK", Why::NoCode),
    word("PRELUDE", Why::NoCode),
    word("NOFRAX", Why::NoCode),
    word("FRAX2", Why::NoCode),
    word("NX", Why::NoCode),
    word("NY", Why::NoCode),
    word("NZ", Why::NoCode),
    word("TX", Why::NoCode),
    word("TY", Why::NoCode),
    word("TZ", Why::NoCode),
    word("TR", Why::NoCode),
    listed("PLCC"),
    word("PAUSE", Why::NoCode),
    word("RESUME", Why::NoCode),
    word("WAIT", Why::Wait),
    word("N", Why::Label),
    word("O", Why::Label),
    word("SIN", Why::Function),
    word("COS", Why::Function),
    word("TAN", Why::Function),
    word("ASIN", Why::Function),
    word("ACOS", Why::Function),
    word("ATAN", Why::Function),
    word("ATAN2", Why::Function),
    word("LN", Why::Function),
    word("EXP", Why::Function),
    word("SQRT", Why::Function),
    word("INT", Why::Function),
    word("OPEN", Why::OnLine),
    word("CLOSE", Why::OnLine),
    word("CLS", Why::OnLine),
    word("CLEAR", Why::OnLine),
    word("CLR", Why::OnLine),
    word("DEFINE", Why::OnLine),
    word("DEF", Why::OnLine),
    word("DELETE", Why::OnLine),
    word("DEL", Why::OnLine),
    word("UNDEFINE", Why::OnLine),
    word("UNDEF", Why::OnLine),
    word("LIST", Why::OnLine),
    word("LEARN", Why::OnLine),
    word("GATHER", Why::OnLine),
    word("GAT", Why::OnLine),
    word("ENDGATHER", Why::OnLine),
    word("ENDG", Why::OnLine),
    word("SAVE", Why::OnLine),
    word("SIZE", Why::OnLine),
    word("TYPE", Why::OnLine),
    word("VERSION", Why::OnLine),
    word("VER", Why::OnLine),
    word("DATE", Why::OnLine),
    word("PASSWORD", Why::OnLine),
    word("PMATCH", Why::OnLine),
    word("PC", Why::OnLine),
    word("PE", Why::OnLine),
    word("PR", Why::OnLine),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotary::codes::{CODES, Code};

    #[test]
    fn no_word_is_both_a_command_and_refused() {
        for word in REFUSED {
            assert!(CODES.iter().flat_map(Code::spellings).all(|name| name != word.name), "{}", word.name);
            assert_eq!(REFUSED.iter().filter(|other| other.name == word.name).count(), 1, "{}", word.name);
        }
    }

    #[test]
    fn no_refused_word_begins_with_a_command_that_needs_no_number() {
        // Otherwise "STOPX5" could be parsed as another word.
        use crate::rotary::codes::Shape;
        for code in CODES.iter().filter(|code| matches!(code.shape, Shape::Bare { .. } | Shape::Axes { .. }))
        {
            for name in code.spellings() {
                for word in REFUSED.iter().filter(|word| word.name != "FRAX2") {
                    assert!(!word.name.starts_with(name), "{} begins with {name}", word.name);
                }
            }
        }
    }
}
