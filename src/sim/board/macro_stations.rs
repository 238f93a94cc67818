//! The MACRO stations on the board's ring, as memories: what is written to a variable of a station is read back from it.
//!
//! Files that sites load into their boards set variables of their stations (`MS0,I996=$0FB333`, `MSW16,MI124,P1`). A board
//! without stations answers ERR008 (Software Reference, list of errors).

use std::collections::BTreeMap;

use super::Board;
use super::error::CommandError;
use super::variables::VariableKind;

/// The highest number of a station.
pub const LAST_STATION: usize = 63;

/// A variable of a station. `I5` and `MI5` are the same one: files write both for it.
pub type StationVariable = (usize, usize);

/// What the stations keep. They have their own supply: a reset of the board does not touch it.
#[derive(Debug, Clone, Default)]
pub struct MacroStations {
    values: BTreeMap<StationVariable, f64>,
}

/// `MSR` and `MSW`: a variable of a station to or from one of the board.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    /// `MSW`, from the board's to the station's.
    pub write: bool,
    /// The station's.
    pub station: StationVariable,
    /// The board's: kind and number.
    pub own: (VariableKind, usize),
}

impl Transfer {
    /// The statement as `LIST` shows it.
    #[must_use]
    pub fn text(&self) -> String {
        let ((node, variable), (kind, number)) = (self.station, self.own);
        let word = if self.write { "MSW" } else { "MSR" };
        format!("{word}{node},MI{variable},{}{number}", kind.letter())
    }

    /// Carries it out in a program; without stations nothing happens.
    pub fn carry_out(&self, board: &mut Board, cs: usize) {
        let _ = board.transfer(self, cs);
    }
}

impl Board {
    /// A variable of a station; 0 until it is set.
    ///
    /// # Errors
    /// ERR008 without stations.
    pub fn station_variable(&self, variable: StationVariable) -> Result<f64, CommandError> {
        if !self.identity.stations {
            return Err(CommandError::MACRO);
        }
        Ok(self.stations.values.get(&variable).copied().unwrap_or(0.0))
    }

    /// Sets a variable of a station.
    ///
    /// # Errors
    /// ERR008 without stations.
    pub fn set_station_variable(
        &mut self,
        variable: StationVariable,
        value: f64,
    ) -> Result<(), CommandError> {
        self.station_variable(variable)?;
        self.stations.values.insert(variable, value);
        Ok(())
    }

    /// `MSR` or `MSW`, with the Q-variables of the 0-based `cs`.
    ///
    /// # Errors
    /// ERR008 without stations.
    pub fn transfer(&mut self, transfer: &Transfer, cs: usize) -> Result<(), CommandError> {
        let (kind, number) = transfer.own;
        if transfer.write {
            let value = self.value(kind, cs, number);
            return self.set_station_variable(transfer.station, value);
        }
        let value = self.station_variable(transfer.station)?;
        self.assign(kind, cs, number, value);
        Ok(())
    }
}
