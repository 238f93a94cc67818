//! `pmacctl setup user`: `[[user]]` tables for pmacd's configuration, from the M-variables that point into the DPRAM's user area.

use std::fmt::{Display, Write};

use serde_json::json;

use super::pointers::{Pointer, Pointers};
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::map::m_definition::MDefinition;
use crate::map::user_word::USER_WORDS;
use crate::map::word_use::function_of;
use crate::map::{BufferLayout, Family};
use crate::protocol::BoardSettings;

/// Prints the tables.
pub fn run(context: &mut Context) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    let (settings, firmware) = (connection.settings()?, connection.info()?.firmware);
    let layout = layout(&settings, family, firmware.as_deref())?;
    let Pointers { found, unclear } = Pointers::asked(&mut connection, family)?;
    for line in &unclear {
        note(format_args!("not told: {line}"));
    }
    let mut tables = Vec::new();
    for pointer in found {
        let end = pointer.at.space.words() - 1;
        let function =
            [0, end].iter().find_map(|word| function_of(&layout, pointer.at.offset.plus_words(*word)));
        match (function, Word::of(&pointer, family)) {
            (None, Some(word)) => tables.push(word),
            (None, None) => left_out(&pointer, "its bits lie above the 16 that the DPRAM has of a word"),
            (Some(function), _) => left_out(&pointer, format_args!("the words are those of {function}")),
        }
    }
    if tables.len() > USER_WORDS {
        note(format_args!(
            "{} M-variables point there, and pmacd takes {USER_WORDS} words: the first are printed",
            tables.len()
        ));
        tables.truncate(USER_WORDS);
    }
    if context.output.is_json() {
        let documents = tables
            .iter()
            .map(|word| json!({"name": word.name, "address": word.address, "format": word.format}));
        context.output.json(&documents.collect::<Vec<_>>())?;
    } else {
        context.output.text(text(&tables))?;
    }
    if tables.is_empty() {
        note("no M-variable points into the user area of the DPRAM");
    }
    Ok((!tables.is_empty()).into())
}

fn left_out(pointer: &Pointer, why: impl Display) {
    note(format_args!("left out: M{}->{}: {why}", pointer.number, pointer.text));
}

fn layout(
    settings: &BoardSettings,
    family: &'static Family,
    firmware: Option<&str>,
) -> Result<BufferLayout, Failure> {
    let firmware = firmware.and_then(|text| text.parse().ok());
    BufferLayout::new(&settings.layout(family, firmware), &settings.plan).map_err(Failure::request)
}

/// One table.
struct Word {
    name: String,
    address: String,
    format: String,
}

impl Word {
    /// For an M-variable; `None` for bits that the DPRAM does not have.
    fn of(pointer: &Pointer, family: &Family) -> Option<Self> {
        let format = match MDefinition::parse(&pointer.text)? {
            MDefinition::Register { space, .. } => space.to_string(),
            MDefinition::Field { space, offset, width, format, .. } => {
                let sign = if format == 'S' { ",S" } else { "" };
                match (offset, width) {
                    // The DPRAM has the low 16 of a word's 24 bits.
                    (0, 16 | 24) if sign.is_empty() => space.to_string(),
                    (0, 24) => format!("{space}:0,16{sign}"),
                    (offset, width) if offset + width <= 16 => format!("{space}:{offset},{width}{sign}"),
                    _ => return None,
                }
            }
            MDefinition::Nowhere | MDefinition::Thumbwheel { .. } => return None,
        };
        let address = pointer.at.pmac_address(family).to_string();
        let (_, address) = address.split_once(':')?;
        Some(Self { name: format!("M{}", pointer.number), address: address.to_owned(), format })
    }
}

fn text(tables: &[Word]) -> String {
    let mut text = String::new();
    for Word { name, address, format } in tables {
        // Writing to a String cannot fail.
        let _ =
            writeln!(text, "[[user]]\nname = \"{name}\"\naddress = \"{address}\"\nformat = \"{format}\"\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{HostOffset, PMAC, Space, TypedAddress};

    #[test]
    fn a_definition_becomes_a_table_that_reads_the_same_bits() {
        for (text, address, format) in [
            ("DP:$DA10", "$DA10", "DP"),
            ("Y:$DA11,8,4", "$DA11", "Y:8,4"),
            ("X:$DA12,0,16,S", "$DA12", "X:0,16,S"),
            ("X:$DA12,0,16", "$DA12", "X"),
            ("Y:$DA13,3", "$DA13", "Y:3,1"),
            ("L:$DA14", "$DA14", "L"),
        ] {
            let place = text.split(',').next().unwrap();
            let at = TypedAddress::parse(place, &PMAC).unwrap();
            let word = Word::of(&Pointer { number: 7, text: text.to_owned(), at }, &PMAC).unwrap();
            assert_eq!((&word.name[..], &word.address[..], &word.format[..]), ("M7", address, format));
        }
        let at = TypedAddress { space: Space::Y, offset: HostOffset::new(0x2844) };
        assert!(Word::of(&Pointer { number: 7, text: "Y:$DA11,16,8".to_owned(), at }, &PMAC).is_none());
    }
}
