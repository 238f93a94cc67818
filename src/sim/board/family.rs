//! What differs between board families, as data.
//!
//! Everything the language must know about a family is a field here. A further family (Turbo) is a further constant
//! with its own tables, not a branch in the interpreter.

use crate::sim::board::i_rows::{self, Row};

/// The motors and coordinate systems that the board has room for.
pub const MOTORS: usize = 8;

/// How setting I58 changes the handshake variables (DPRAM manual, "DPRAM ASCII Communications").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DpramHandshake {
    /// I4 becomes 0, I6 becomes 1; I3 loses its leading line feeds (firmware before 1.15: becomes 2).
    Forced,
    /// Nothing is forced.
    Untouched,
}

/// The properties of a board family that the command language depends on.
#[derive(Debug)]
pub struct Family {
    /// Name on the command line of the simulator.
    pub name: &'static str,
    /// Number of motors, `#1` upwards.
    pub motors: usize,
    /// Number of coordinate systems, `&1` upwards.
    pub coordinate_systems: usize,
    /// How many I-, P-, Q- and M-variables there are of each kind.
    pub variables: usize,
    /// The highest address memory commands and M-variables may name.
    pub last_address: u32,
    /// Address of P0; each P-variable is an `L:` register (User Manual p. 150).
    pub p_address: u32,
    /// Addresses of Q0, one a coordinate system. The sets overlap: all share `variables` registers from the first
    /// on, cyclically (User Manual p. 151).
    pub q_addresses: &'static [u32],
    /// The number of the I-variable `Ix00` of motor 1, and the step to the next motor's.
    pub motor_i: usize,
    /// The number that stands for `Ix00` of coordinate system 1 (its own start at Ix86).
    pub coordinate_i: usize,
    /// Addresses of the first `??` words (X words), from coordinate system 1 on by a step.
    pub coordinate_status: (u16, u16),
    /// The I-variable tables.
    pub i_rows: &'static [&'static [Row]],
    /// Most digits printed after the decimal point.
    pub decimals: usize,
    /// What setting I58 does.
    pub dpram_handshake: DpramHandshake,
}

impl Family {
    /// The number of motor I-variable `n` (0-99) of the 0-based `motor`: `Ix22` of motor 3 is 322.
    #[must_use]
    pub const fn motor_i(&self, motor: usize, n: usize) -> usize {
        self.motor_i + 100 * motor + n
    }

    /// The number of coordinate-system I-variable `n` (0-99) of the 0-based `cs`: `Ix93` of `&2` is 293.
    #[must_use]
    pub const fn coordinate_i(&self, cs: usize, n: usize) -> usize {
        self.coordinate_i + 100 * cs + n
    }

    /// The address of the first `??` word of the 0-based `cs`, an X word.
    #[must_use]
    pub const fn coordinate_status_address(&self, cs: usize) -> u16 {
        self.coordinate_status.0 + self.coordinate_status.1 * cs as u16
    }
}

/// Classic PMAC(1), firmware 1.1x.
pub static PMAC: Family = Family {
    name: "pmac",
    motors: 8,
    coordinate_systems: 8,
    variables: 1024,
    last_address: 0xFFFF,
    p_address: 0x1000,
    q_addresses: &[0x1400, 0x1600, 0x1500, 0x1700, 0x1480, 0x1680, 0x1580, 0x1780],
    motor_i: 100,
    coordinate_i: 100,
    coordinate_status: (0x0818, 0x00C0),
    i_rows: &[i_rows::GLOBAL, i_rows::MOTOR, i_rows::COORDINATE, i_rows::PMAC],
    decimals: 9,
    dpram_handshake: DpramHandshake::Forced,
};

/// Classic PMAC2, firmware 1.1x: another servo clock, set by I992, I997 and I998.
pub static PMAC2: Family = Family {
    name: "pmac2",
    i_rows: &[i_rows::GLOBAL, i_rows::MOTOR, i_rows::COORDINATE, i_rows::PMAC2],
    motors: PMAC.motors,
    coordinate_systems: PMAC.coordinate_systems,
    variables: PMAC.variables,
    last_address: PMAC.last_address,
    p_address: PMAC.p_address,
    q_addresses: PMAC.q_addresses,
    motor_i: PMAC.motor_i,
    coordinate_i: PMAC.coordinate_i,
    coordinate_status: PMAC.coordinate_status,
    decimals: PMAC.decimals,
    dpram_handshake: DpramHandshake::Forced,
};
