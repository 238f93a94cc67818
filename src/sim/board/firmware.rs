//! What the simulated firmware of a board family knows beyond the family's DPRAM: I-variables, addresses of variables
//! and registers, answers to commands.
//!
//! Motors, coordinate systems, I-variable numbers and everything in the DPRAM come from [`crate::map::Family`]. Another
//! family is another table here (Turbo's stands in [`super::turbo`]), not a branch in the interpreter.

use crate::map::{self, Family, PmacAddress, Space};
use crate::sim::board::i_rows::{self, Row};
use crate::sim::board::number::Resolution;
use crate::sim::board::register_table::{self, RegisterTable};
use crate::sim::board::settings::{Setting, Settings};
use crate::sim::board::status_bits::{self, StatusBits};

/// How setting I58 changes the handshake variables (DPRAM manual, "DPRAM ASCII Communications").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DpramHandshake {
    /// I4 becomes 0, I6 becomes 1; I3 loses its leading line feeds (firmware before 1.15: becomes 2). ^Z sets I58=0.
    Forced,
    /// Nothing is forced, and ^Z leaves I58 as it is.
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

/// What becomes of a variable number that there is not, and whether a command can name numbers that lie apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberRule {
    /// ERR003; a command is for one number or a range.
    Refused,
    /// It is reduced modulo the number of variables (Turbo User Manual p. 243); `I130,4,100` are four, a hundred apart.
    Wrapped,
}

/// Whether `#n`, `&n` and `##n` are in force for all ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Addressing {
    /// One motor and coordinate system for all ports.
    Shared,
    /// Each port has its own (Turbo Software Reference p. 270).
    EachPort,
}

/// How a board tells what card it is: commands that PMAC does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Card {
    /// `CID`: the part number.
    pub part: &'static str,
    /// `VID`: the vendor.
    pub vendor: &'static str,
}

/// A family's firmware as the simulator plays it.
#[derive(Debug)]
pub struct FirmwareTables {
    /// The family.
    pub family: &'static Family,
    /// The firmware that is played when nothing else is asked for.
    pub firmware: &'static str,
    /// How many I-, P-, Q- and M-variables there are of each kind.
    pub variables: usize,
    /// What becomes of another number.
    pub numbers: NumberRule,
    /// Address of P0; each P-variable is an `L:` register (User Manual p. 150).
    pub p_address: u32,
    /// Where the definition of M0 lies: a Y word, or a long register whose Y word is the address.
    pub m_address: PmacAddress,
    /// Addresses of Q0, one a coordinate system. The sets overlap: all share `variables` registers from the first
    /// on, cyclically (User Manual p. 151).
    pub q_addresses: &'static [u32],
    /// The I-variable tables. Where two have a row for a number, the later one counts.
    pub i_rows: &'static [&'static [Row]],
    /// Which I-variables hold the settings whose numbers differ.
    pub settings: Settings,
    /// The registers.
    pub registers: RegisterTable,
    /// The bits of the status words that differ.
    pub status_bits: StatusBits,
    /// Most digits printed after the decimal point.
    pub decimals: usize,
    /// How positions are printed.
    pub positions: Resolution,
    /// How many motors ^B, ^F, ^P and ^V report, and coordinate systems ^C: a group of them.
    pub group: usize,
    /// What setting I58 does.
    pub dpram_handshake: DpramHandshake,
    /// Whose `#n` and `&n` are.
    pub addressing: Addressing,
    /// The interrupt controller of its ISA boards.
    pub controller: Controller,
    /// The answer to `TYPE` (form: Software Reference p. 286).
    pub type_text: &'static str,
    /// The answers to `CID`, `VID` and `CPU`.
    pub card: Option<Card>,
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
        firmware: "1.16D",
        variables: 1024,
        numbers: NumberRule::Refused,
        p_address: 0x1000,
        m_address: PmacAddress::new(Space::Y, 0xBC00),
        q_addresses: &[0x1400, 0x1600, 0x1500, 0x1700, 0x1480, 0x1680, 0x1580, 0x1780],
        i_rows,
        settings: Settings {
            in_position_scans: Setting::Board(7),
            segmentation: Setting::Board(13),
            flag_mode: Setting::Motor(25),
            rapid_speed: Setting::Board(50),
            hold_slew: Setting::Board(52),
            step_mode: Setting::Board(53),
            minimum_arc: Setting::Board(90),
            backlash_hysteresis: Setting::Board(99),
            timers: &[],
            line_from_dpram: Some(47),
            dpram_base: None,
        },
        registers: register_table::pmac(family),
        status_bits: status_bits::PMAC,
        decimals: 9,
        positions: Resolution::Tenths,
        group: 8,
        dpram_handshake: DpramHandshake::Forced,
        addressing: Addressing::Shared,
        controller,
        type_text,
        card: None,
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
