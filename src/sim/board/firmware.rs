//! The simulated firmware of a board family, beyond the family's DPRAM: I-variables, addresses of variables and
//! registers, answers to commands.
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
    /// I58=1 forces nothing, and ^Z leaves I58 as it is.
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

/// The board's treatment of a variable number beyond the last, and of commands that name several separate numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberRule {
    /// ERR003; a command names one number or a range.
    Refused,
    /// The board reduces the number modulo the number of variables (Turbo User Manual p. 243); `I130,4,100` names four
    /// variables, a hundred apart.
    Wrapped,
}

/// Whether `#n`, `&n` and `##n` are in force for all ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Addressing {
    /// All ports share one motor and one coordinate system.
    Shared,
    /// Each port has its own (Turbo Software Reference p. 270).
    EachPort,
}

/// A board's answers about its card, to commands that PMAC does not have.
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
    /// The firmware that the simulator plays unless the user names another.
    pub firmware: &'static str,
    /// The number of I-variables, and of P-, Q- and M-variables.
    pub variables: usize,
    /// The board's treatment of a number beyond the last.
    pub numbers: NumberRule,
    /// Address of P0; each P-variable is an `L:` register (User Manual p. 150).
    pub p_address: u32,
    /// The address of the definition of M0: a Y word, or a long register whose Y word is the address.
    pub m_address: PmacAddress,
    /// Addresses of Q0, one a coordinate system. The sets overlap: all share the `variables` registers from the first
    /// address on, cyclically (User Manual p. 151).
    pub q_addresses: &'static [u32],
    /// The I-variable tables. Where two tables have a row for a number, the later row counts.
    pub i_rows: &'static [&'static [Row]],
    /// The I-variables of the settings whose numbers differ between families.
    pub settings: Settings,
    /// The registers.
    pub registers: RegisterTable,
    /// The bits of the status words that differ.
    pub status_bits: StatusBits,
    /// Most digits printed after the decimal point.
    pub decimals: usize,
    /// How positions are printed.
    pub positions: Resolution,
    /// The size of a group: the motors that ^B, ^F, ^P and ^V report, and the coordinate systems that ^C reports.
    pub group: usize,
    /// The effect of setting I58.
    pub dpram_handshake: DpramHandshake,
    /// Whether the ports share `#n` and `&n`.
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
        // The map has Ix93; the other variables are next to Ix93.
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
            error_trigger: (Setting::Motor(3), 1 << 17),
            has_channels: false,
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
