//! The names for the background variable functions: a register, or a function block of a compiled PLC.
//!
//! A function block is two words, and has a number instead of an address: type 4 of an entry of the read table, types 4
//! (Y word) and 6 (X word) of a record to write, with firmware 1.16 (DPRAM manual p. 23 and 25). Its name is `PLCC:7`,
//! and its words are `PLCC:Y:7` and `PLCC:X:7`.

use std::fmt;
use std::str::FromStr;

use super::{BadRegister, Family, PmacRegister, Space, VariableKind, number};

/// The prefix of a function block's number.
const PREFIX: &str = "PLCC:";

/// A register or block that PMAC copies or writes in its background.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum VariableName {
    /// A register.
    Register(PmacRegister),
    /// A function block.
    Block {
        /// Its number.
        number: u16,
        /// One word, `X` or `Y`; `None`: both.
        word: Option<Space>,
    },
}

/// Text that names neither a register nor a function block.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadVariable {
    /// The text looks like a register.
    #[error(transparent)]
    Register(#[from] BadRegister),
    /// The text looks like a function block.
    #[error(
        "{text:?} is no function block; write PLCC:7, or PLCC:X:7 and PLCC:Y:7 for its words, with a number up to 65535"
    )]
    Block {
        /// The text.
        text: String,
    },
}

impl From<PmacRegister> for VariableName {
    fn from(register: PmacRegister) -> Self {
        Self::Register(register)
    }
}

impl FromStr for VariableName {
    type Err = BadVariable;

    /// Reads a name for any family.
    fn from_str(text: &str) -> Result<Self, BadVariable> {
        Self::read(text, str::parse)
    }
}

impl fmt::Display for VariableName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Register(register) => register.fmt(f),
            Self::Block { number, word: None } => write!(f, "{PREFIX}{number}"),
            Self::Block { number, word: Some(word) } => write!(f, "{PREFIX}{word}:{number}"),
        }
    }
}

impl VariableName {
    /// Reads a name for a board of `family`.
    ///
    /// # Errors
    /// [`BadVariable`].
    pub fn parse(text: &str, family: &Family) -> Result<Self, BadVariable> {
        Self::read(text, |text| PmacRegister::parse(text, family))
    }

    fn read(
        text: &str,
        register: impl FnOnce(&str) -> Result<PmacRegister, BadRegister>,
    ) -> Result<Self, BadVariable> {
        let is_block =
            text.trim().get(..PREFIX.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(PREFIX));
        if !is_block {
            return Ok(Self::Register(register(text)?));
        }
        let rest = &text.trim()[PREFIX.len()..];
        let (word, digits) = match rest.split_once(':') {
            None => (None, Some(rest)),
            Some((letter, digits)) => {
                let word =
                    [Space::X, Space::Y].into_iter().find(|space| space.name().eq_ignore_ascii_case(letter));
                (word, word.map(|_| digits))
            }
        };
        let number = digits.and_then(|digits| u16::try_from(number::parse(digits).ok()?).ok());
        let number = number.ok_or_else(|| BadVariable::Block { text: text.to_owned() })?;
        Ok(Self::Block { number, word })
    }

    /// Its kind in the read table. PMAC reads a function block's word only with its block.
    #[must_use]
    pub const fn kind(self) -> VariableKind {
        match self {
            Self::Register(register) => register.kind(),
            Self::Block { .. } => VariableKind::Special,
        }
    }

    /// Its address in the read table: for a function block the number.
    #[must_use]
    pub const fn address(self) -> u32 {
        match self {
            Self::Register(register) => register.address().number,
            Self::Block { number, .. } => number as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::PMAC;
    use super::*;

    #[test]
    fn function_blocks_have_names() {
        for (text, shown, word) in [
            ("PLCC:7", "PLCC:7", None),
            (" plcc:x:7", "PLCC:X:7", Some(Space::X)),
            ("PLCC:y:$7", "PLCC:Y:7", Some(Space::Y)),
        ] {
            let name = VariableName::parse(text, &PMAC).unwrap();
            assert_eq!((name, name.to_string().as_str()), (VariableName::Block { number: 7, word }, shown));
            assert_eq!((name.kind(), name.address()), (VariableKind::Special, 7));
            assert_eq!(shown.parse(), Ok(name));
        }
        for text in ["PLCC:", "PLCC:D:7", "PLCC:65536", "PLCC:-1", "PLCC:X:", "PLCC:X:7:8", "PLCC:7,u"] {
            let why = VariableName::parse(text, &PMAC).unwrap_err().to_string();
            assert!(why.contains("write PLCC:7"), "{text}: {why}");
        }
        let name = VariableName::parse("X:$0028", &PMAC).unwrap();
        assert_eq!(
            (name.kind(), name.address(), name.to_string().as_str()),
            (VariableKind::X, 0x28, "X:$0028")
        );
        assert!(matches!(VariableName::parse("X:$10000", &PMAC), Err(BadVariable::Register(_))));
        assert!("é:7".parse::<VariableName>().is_err());
    }
}
