//! M-variable definitions, as typed after `->`.

use crate::map::{Family, Generation};
use crate::sim::board::error::CommandError;
use crate::sim::board::m_definition::{Format, Half, MDefinition};
use crate::sim::language::scanner::Scanner;

const FORMATS: [(u8, Format); 4] = [
    (b'U', Format::Unsigned),
    (b'S', Format::Signed),
    (b'D', Format::Decimal),
    (b'C', Format::ComplementDecimal),
];

/// The field widths allowed in a definition.
const WIDTHS: [u8; 7] = [1, 4, 8, 12, 16, 20, 24];

/// The registers on the chip of Turbo's processor, above the addresses of the board's memory: the vendor's suggested
/// M-variables for a Turbo PMAC2 point to `X:$FFFF8C`. Here nothing is behind them.
const ON_CHIP: u32 = 0xFF_FF80;
const ON_CHIP_LAST: u32 = 0xFF_FFFF;

#[derive(Clone, Copy)]
enum Prefix {
    Half(Half),
    Fixed,
    Long,
    Single,
    Dual,
    Thumbwheel(char),
}

const PREFIXES: &[(&str, Prefix)] = &[
    ("X", Prefix::Half(Half::X)),
    ("Y", Prefix::Half(Half::Y)),
    ("D", Prefix::Fixed),
    ("L", Prefix::Long),
    ("F", Prefix::Single),
    ("DP", Prefix::Dual),
    ("TWB", Prefix::Thumbwheel('B')),
    ("TWD", Prefix::Thumbwheel('D')),
    ("TWR", Prefix::Thumbwheel('R')),
    ("TWS", Prefix::Thumbwheel('S')),
];

/// Parses the text after `->`. `None` at the end of the line: a query, not a definition.
///
/// # Errors
/// ERR003 for an address that boards of `family` do not have, a field that exceeds a word, and any other text.
pub fn definition(scanner: &mut Scanner, family: &Family) -> Result<Option<MDefinition>, CommandError> {
    if scanner.take(b'*') {
        return Ok(Some(MDefinition::None));
    }
    let mut ahead = scanner.clone();
    let Some(prefix) = ahead.keyword(&[PREFIXES]) else { return Ok(None) };
    let colon = ahead.take(b':');
    if !colon && !ahead.at_unsigned() {
        return Ok(None);
    }
    *scanner = ahead;
    if let Prefix::Thumbwheel(kind) = prefix {
        return thumbwheel(scanner, kind).map(Some);
    }
    let address = scanner.address(ON_CHIP_LAST)?;
    let on_chip = family.generation == Generation::Turbo && address >= ON_CHIP;
    if address > family.last_address() && !on_chip {
        return Err(CommandError::SYNTAX);
    }
    Ok(Some(match prefix {
        Prefix::Half(half) => field(scanner, half, address)?,
        Prefix::Fixed => MDefinition::Fixed(address),
        Prefix::Long => MDefinition::Long(address),
        Prefix::Single => MDefinition::Single(address),
        Prefix::Dual | Prefix::Thumbwheel(_) => MDefinition::Dual(address),
    }))
}

fn field(scanner: &mut Scanner, half: Half, address: u32) -> Result<MDefinition, CommandError> {
    let mut offset = if scanner.take(b',') { small(scanner)? } else { 0 };
    let mut width = 1;
    let mut format = Format::Unsigned;
    let mut more = scanner.take(b',');
    if offset == 24 {
        (offset, width) = (0, 24);
    } else if more {
        width = small(scanner)?;
        more = scanner.take(b',');
    }
    if more {
        let letter = scanner.next_character();
        format = FORMATS
            .iter()
            .find(|(name, _)| Some(*name) == letter)
            .map(|(_, format)| *format)
            .ok_or(CommandError::SYNTAX)?;
    }
    let inside = u32::from(offset) + u32::from(width) <= 24;
    if !WIDTHS.contains(&width) || !inside {
        return Err(CommandError::SYNTAX);
    }
    Ok(MDefinition::Field { half, address, offset, width, format })
}

fn thumbwheel(scanner: &mut Scanner, kind: char) -> Result<MDefinition, CommandError> {
    let mut arguments = vec![scanner.unsigned()?];
    let mut format = None;
    while arguments.len() < 4 && scanner.take(b',') {
        if scanner.at_unsigned() {
            arguments.push(scanner.unsigned()?);
            continue;
        }
        let letter = scanner.next_character().filter(|c| b"USDC".contains(c)).ok_or(CommandError::SYNTAX)?;
        format = Some(char::from(letter));
        break;
    }
    Ok(MDefinition::Thumbwheel { kind, arguments, format })
}

fn small(scanner: &mut Scanner) -> Result<u8, CommandError> {
    let value = scanner.integer()?;
    if value <= 24 { Ok(value as u8) } else { Err(CommandError::SYNTAX) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::testing;

    fn parse(text: &str) -> Result<Option<MDefinition>, CommandError> {
        definition(&mut Scanner::new(text.as_bytes()), &crate::map::PMAC)
    }

    #[test]
    fn definitions_list_in_the_short_form() {
        for (typed, listed) in [
            ("*", "*"),
            ("X:$C001,24,S", "X:$C001,24,S"),
            ("x:$c001,0,24,s", "X:$C001,24,S"),
            ("Y:$C003,8,16,S", "Y:$C003,8,16,S"),
            ("Y:$FFC2,8", "Y:$FFC2,8"),
            ("Y:$FFC2,8,1,U", "Y:$FFC2,8"),
            ("Y:$FFC2", "Y:$FFC2,0"),
            ("Y:49152,0,4,D", "Y:$C000,0,4,D"),
            ("X$0806,24", "X:$806,24"),
            ("D:$28", "D:$28"),
            ("L:$1000", "L:$1000"),
            ("F:$D210", "F:$D210"),
            ("DP:$D200", "DP:$D200"),
            ("TWD:4,0.8,U", "TWD:4,0.8,U"),
            ("TWS:1", "TWS:1"),
        ] {
            assert_eq!(parse(typed).unwrap().unwrap().text(), listed, "{typed}");
        }
    }

    #[test]
    fn what_is_no_definition() {
        for text in ["X:$10000,0", "X:$C000,25", "X:$C000,20,8", "X:$C000,0,5", "X:$C000,0,8,Q", "X:", "DP:"]
        {
            assert_eq!(parse(text), Err(CommandError::SYNTAX), "{text}");
        }
        assert_eq!(parse(""), Ok(None));
        assert_eq!(parse("M2->"), Ok(None));
    }

    #[test]
    fn fields_read_and_write_their_bits_only() {
        let mut board = testing::board();
        let memory = &mut board.memory;
        memory.write_y(0x770, 0xABCDEF);
        for (text, value, read, word) in [
            ("Y:$770,8,8", 257.0, 1.0, 0xAB01EF),
            ("Y:$770,8,8,S", -1.0, -1.0, 0xABFFEF),
            ("Y:$770,0,4", 16.4, 0.0, 0xABFFE0),
            ("Y:$770,0,12,D", 1234.0, 234.0, 0xABF234),
            ("Y:$770,0,12,C", 234.0, 234.0, 0xABFDCB),
            ("Y:$770,24,S", -16384.0, -16384.0, 0xFFC000),
            ("Y:$770,23", 0.0, 0.0, 0x7FC000),
        ] {
            let definition = parse(text).unwrap().unwrap();
            assert!(definition.write(memory, value));
            assert_eq!((definition.read(memory), memory.read_y(0x770)), (Some(read), word), "{text}={value}");
        }
    }

    #[test]
    fn wide_forms_keep_their_value() {
        let mut board = testing::board();
        let memory = &mut board.memory;
        for (text, value) in [
            ("D:$28", -6_000_000_000.0),
            ("L:$1000", 5.75),
            ("F:$D210", -0.5),
            ("DP:$D200", -70000.0),
            ("DP:$D204", 2_147_483_647.0),
        ] {
            let definition = parse(text).unwrap().unwrap();
            assert!(definition.write(memory, value));
            assert_eq!(definition.read(memory), Some(value), "{text}");
        }
        assert!(!MDefinition::None.write(memory, 1.0));
    }
}
