//! Variables of MACRO stations, as typed: `0,I996` and `16,MI124,P1`.

use crate::map::Generation;
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::macro_stations::{LAST_STATION, StationCommand, StationVariable, Transfer};
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::variable_number;
use crate::sim::language::scanner::Scanner;

/// The words of `MSR` and `MSW`, and whether they write to the station.
const TRANSFERS: &[(&str, bool)] =
    &[("MSR", false), ("MSW", true), ("MACROSLVREAD", false), ("MACROSLVWRITE", true)];

/// The commands to a station that get no answer (Turbo Software Reference p. 369).
const COMMANDS: &[(&str, StationCommand)] = &[
    ("$$$", StationCommand::Reset),
    ("$$$***", StationCommand::FactoryReset),
    ("CLRF", StationCommand::ClearFaults),
    ("SAVE", StationCommand::Save),
];

/// The command after `MS`; `None`, with the scanner unmoved, for other text.
pub fn command(scanner: &mut Scanner) -> Option<StationCommand> {
    scanner.keyword(&[COMMANDS])
}

/// The number of a station.
///
/// # Errors
/// ERR003 for a number that no station can have.
pub fn node(scanner: &mut Scanner) -> Result<usize, CommandError> {
    Some(scanner.integer()?).filter(|&node| node <= LAST_STATION).ok_or(CommandError::SYNTAX)
}

/// A station and one of its variables.
///
/// # Errors
/// ERR003 for any other text.
pub fn variable(scanner: &mut Scanner) -> Result<StationVariable, CommandError> {
    let node = node(scanner)?;
    scanner.expect(b',')?;
    scanner.take(b'M');
    scanner.expect(b'I')?;
    Ok((node, scanner.integer()?))
}

/// `MSR` or `MSW` and its operands; `None`, with the scanner unmoved, for other text. PMAC's programs have no such
/// statement.
///
/// # Errors
/// ERR003 for a wrong statement.
pub fn transfer(scanner: &mut Scanner, board: &Board) -> Result<Option<Transfer>, CommandError> {
    if board.family().generation != Generation::Turbo {
        return Ok(None);
    }
    let Some(write) = scanner.keyword(&[TRANSFERS]) else { return Ok(None) };
    operands(scanner, board, write).map(Some)
}

/// The operands of `MSR` or, with `write`, of `MSW`.
///
/// # Errors
/// ERR003 for any other text.
pub fn operands(scanner: &mut Scanner, board: &Board, write: bool) -> Result<Transfer, CommandError> {
    let station = variable(scanner)?;
    scanner.expect(b',')?;
    let kind = scanner.next_character().and_then(VariableKind::from_letter).ok_or(CommandError::SYNTAX)?;
    let number = variable_number(scanner, board, 0)?;
    Ok(Transfer { write, station, own: (kind, number) })
}
