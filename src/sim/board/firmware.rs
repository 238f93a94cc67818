//! What the simulated firmware of a board family knows beyond the family's DPRAM: I-variables, addresses of variables
//! and registers, answers to commands.
//!
//! Motors, coordinate systems, I-variable numbers and everything in the DPRAM come from [`crate::map::Family`]. Another
//! family is another table here, not a branch in the interpreter.

use crate::map::{self, Family};
use crate::sim::board::i_rows::{self, Row};
use crate::sim::board::register_table::{self, RegisterTable};

/// How setting I58 changes the handshake variables (DPRAM manual, "DPRAM ASCII Communications").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DpramHandshake {
    /// I4 becomes 0, I6 becomes 1; I3 loses its leading line feeds (firmware before 1.15: becomes 2).
    Forced,
    /// Nothing is forced.
    Untouched,
}

/// The interrupt controller at the ISA host port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// PMAC(1): an 8259.
    Intel8259,
    /// PMAC2: latches.
    Pmac2,
}

/// A family's firmware as the simulator plays it.
#[derive(Debug)]
pub struct FirmwareTables {
    /// The family.
    pub family: &'static Family,
    /// How many I-, P-, Q- and M-variables there are of each kind.
    pub variables: usize,
    /// Address of P0; each P-variable is an `L:` register (User Manual p. 150).
    pub p_address: u32,
    /// Addresses of Q0, one a coordinate system. The sets overlap: all share `variables` registers from the first
    /// on, cyclically (User Manual p. 151).
    pub q_addresses: &'static [u32],
    /// The I-variable tables.
    pub i_rows: &'static [&'static [Row]],
    /// The registers.
    pub registers: RegisterTable,
    /// Most digits printed after the decimal point.
    pub decimals: usize,
    /// What setting I58 does.
    pub dpram_handshake: DpramHandshake,
    /// The interrupt controller of its ISA boards.
    pub controller: Controller,
    /// The answer to `TYPE` (form: Software Reference p. 286).
    pub type_text: &'static str,
    /// The start-up file that enables all functions of the DPRAM.
    pub startup: &'static str,
}

impl FirmwareTables {
    /// The number of coordinate-system I-variable `n` (0-99) of the 0-based `cs`: `Ix87` of `&2` is 287.
    #[must_use]
    pub const fn coordinate_i(&self, cs: usize, n: usize) -> usize {
        // Ix93 is the one that the map has; the others stand beside it.
        self.family.i.time_base(cs + 1) - 93 + n
    }
}

const fn pmac(
    family: &'static Family,
    i_rows: &'static [&'static [Row]],
    controller: Controller,
    type_text: &'static str,
) -> FirmwareTables {
    FirmwareTables {
        family,
        variables: 1024,
        p_address: 0x1000,
        q_addresses: &[0x1400, 0x1600, 0x1500, 0x1700, 0x1480, 0x1680, 0x1580, 0x1780],
        i_rows,
        registers: register_table::pmac(family),
        decimals: 9,
        dpram_handshake: DpramHandshake::Forced,
        controller,
        type_text,
        startup: include_str!("../dpram-startup.pmc"),
    }
}

/// PMAC(1), firmware 1.1x: its servo clock is set by jumpers.
pub static PMAC: FirmwareTables = pmac(
    &map::PMAC,
    &[i_rows::GLOBAL, i_rows::MOTOR, i_rows::COORDINATE, i_rows::PMAC],
    Controller::Intel8259,
    "PMAC1, ISA, FLASH, PID, CLK X1",
);

/// PMAC2, firmware 1.1x: its servo clock is set by I992, I997 and I998.
pub static PMAC2: FirmwareTables = pmac(
    &map::PMAC2,
    &[i_rows::GLOBAL, i_rows::MOTOR, i_rows::COORDINATE, i_rows::PMAC2],
    Controller::Pmac2,
    "PMAC2, ISA, FLASH, PID, CLK X2",
);

/// The families that can be simulated.
pub static SIMULATED: &[&FirmwareTables] = &[&PMAC, &PMAC2];
