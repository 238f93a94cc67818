//! The MACRO stations on the board's ring, as memories: a station's variable reads back the value that was written to
//! it.
//!
//! Files that sites load into their boards set variables of their stations (`MS0,I996=$0FB333`, `MSW16,MI124,P1`). A board
//! without stations answers ERR008 (Software Reference, list of errors).

use std::collections::BTreeMap;

use super::Board;
use super::error::CommandError;
use super::variables::VariableKind;

/// The highest number of a station.
pub const LAST_STATION: usize = 63;

/// A variable of a station. `I5` and `MI5` are the same variable: files use both names.
pub type StationVariable = (usize, usize);

/// The stations' variables. The stations have their own supply: a reset of the board does not touch them.
#[derive(Debug, Clone, Default)]
pub struct MacroStations {
    values: BTreeMap<StationVariable, f64>,
    /// The variables as `MSSAVE` stored them.
    saved: BTreeMap<StationVariable, f64>,
}

/// A command to a station as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StationCommand {
    /// `MS$$$`: back to the saved values.
    Reset,
    /// `MS$$$***`: back to factory values, here 0. The saved values stay, as the board's own do.
    FactoryReset,
    /// `MSCLRF`: a station here has no faults.
    ClearFaults,
    /// `MSSAVE`.
    Save,
}

impl MacroStations {
    fn carry_out(&mut self, command: StationCommand, node: usize) {
        let nothing = BTreeMap::new();
        let (to, from) = match command {
            StationCommand::ClearFaults => return,
            StationCommand::Reset => (&mut self.values, &self.saved),
            StationCommand::FactoryReset => (&mut self.values, &nothing),
            StationCommand::Save => (&mut self.saved, &self.values),
        };
        to.retain(|&(station, _), _| station != node);
        to.extend(from.iter().filter(|&(&(station, _), _)| station == node));
    }
}

/// `MSR` and `MSW`: a transfer between a station's variable and a board's variable.
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

    /// Carries out a program's transfer; without stations it does nothing.
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

    /// A command to the station at `node`.
    ///
    /// # Errors
    /// ERR008 without stations.
    pub fn command_station(&mut self, command: StationCommand, node: usize) -> Result<(), CommandError> {
        if !self.identity.stations {
            return Err(CommandError::MACRO);
        }
        self.stations.carry_out(command, node);
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
