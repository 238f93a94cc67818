//! `LOCK` and `UNLOCK` of Turbo boards: eight bits by which programs of different priority keep each other from the
//! same data. I4904 shows the bits as its bits 4 to 11 (Turbo Software Reference p. 164).

use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::variable_number;
use crate::sim::language::scanner::Scanner;

/// The I-variable that shows the bits, and the place of the first.
const SHOWN: usize = 4904;
const FIRST: usize = 4;
const BITS: usize = 8;

/// The statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lock {
    /// Which bit.
    pub bit: usize,
    /// `LOCK`: the P-variable that tells whether the bit was set before. `UNLOCK` has none.
    pub before: Option<usize>,
}

impl Lock {
    /// The statement as `LIST` shows it.
    #[must_use]
    pub fn text(self) -> String {
        match self.before {
            Some(variable) => format!("LOCK{},P{variable}", self.bit),
            None => format!("UNLOCK{}", self.bit),
        }
    }

    /// Carries the statement out.
    pub fn carry_out(self, board: &mut Board) {
        let (shown, bit) = (board.variables.i_integer(SHOWN), 1 << (FIRST + self.bit));
        let locked = if self.before.is_some() { shown | bit } else { shown & !bit };
        board.variables.set_i(SHOWN, locked as f64);
        if let Some(variable) = self.before {
            let was_set = f64::from(u8::from(shown & bit != 0));
            board.assign(VariableKind::P, 0, variable, was_set);
        }
    }
}

/// The operands of `LOCK`, or with `lock` false of `UNLOCK`.
///
/// # Errors
/// ERR003 for any other text.
pub fn operands(scanner: &mut Scanner, board: &Board, lock: bool) -> Result<Lock, CommandError> {
    let bit = Some(scanner.integer()?).filter(|&bit| bit < BITS).ok_or(CommandError::SYNTAX)?;
    if !lock {
        return Ok(Lock { bit, before: None });
    }
    scanner.expect(b',')?;
    scanner.expect(b'P')?;
    Ok(Lock { bit, before: Some(variable_number(scanner, board, 0)?) })
}
