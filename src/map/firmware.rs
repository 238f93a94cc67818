//! A firmware version, as `VERSION` answers: `1.16D` on PMAC and PMAC2, `1.947` on Turbo.

use std::fmt;
use std::str::FromStr;

/// A firmware version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Firmware {
    major: u16,
    minor: u16,
    letter: Option<char>,
}

/// Text that is no firmware version.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is not a firmware version; write it as the VERSION command answers, for example 1.16D")]
pub struct BadFirmware {
    /// The text.
    pub text: String,
}

impl FromStr for Firmware {
    type Err = BadFirmware;

    fn from_str(text: &str) -> Result<Self, BadFirmware> {
        parse(text.trim()).ok_or_else(|| BadFirmware { text: text.to_owned() })
    }
}

impl Firmware {
    /// The first version with these numbers, without a letter.
    #[must_use]
    pub const fn first(major: u16, minor: u16) -> Self {
        Self { major, minor, letter: None }
    }

    /// The version with these numbers and this capital letter.
    #[must_use]
    pub const fn lettered(major: u16, minor: u16, letter: char) -> Self {
        Self { major, minor, letter: Some(letter) }
    }
}

fn parse(text: &str) -> Option<Firmware> {
    let (major, rest) = text.split_once('.')?;
    let (minor, letter) = match rest.chars().next_back()? {
        last if last.is_ascii_alphabetic() => (&rest[..rest.len() - 1], Some(last.to_ascii_uppercase())),
        _ => (rest, None),
    };
    let number = |digits: &str, most: usize| {
        let plain = (1..=most).contains(&digits.len()) && digits.bytes().all(|digit| digit.is_ascii_digit());
        if plain { digits.parse().ok() } else { None }
    };
    // Two decimals on PMAC and PMAC2, three on Turbo; one would be ambiguous.
    if minor.len() < 2 {
        return None;
    }
    Some(Firmware { major: number(major, 2)?, minor: number(minor, 3)?, letter })
}

impl fmt::Display for Firmware {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:02}", self.major, self.minor)?;
        self.letter.map_or(Ok(()), |letter| write!(f, "{letter}"))
    }
}

impl From<Firmware> for String {
    fn from(firmware: Firmware) -> Self {
        firmware.to_string()
    }
}

impl TryFrom<String> for Firmware {
    type Error = BadFirmware;

    fn try_from(text: String) -> Result<Self, BadFirmware> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_print_as_they_were_read() {
        for text in ["1.16D", "1.15", "1.947", "1.08", "1.17C"] {
            assert_eq!(text.parse::<Firmware>().unwrap().to_string(), text);
        }
        assert_eq!(" 1.16d\n".parse::<Firmware>().unwrap().to_string(), "1.16D");
        assert!("1.16C".parse::<Firmware>().unwrap() < "1.16D".parse().unwrap());
    }

    #[test]
    fn what_is_no_version_is_refused() {
        for text in ["", "1", "1.", ".16", "1.1", "1.16DD", "1.+6", "x.16", "1.16.2", "1.16é", "1.9470"] {
            assert!(text.parse::<Firmware>().is_err(), "{text}");
        }
    }
}
