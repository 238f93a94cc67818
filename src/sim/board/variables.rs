//! I-, P-, Q- and M-variables (User Manual, "Computational features").
//!
//! I-variables are a table of their own. P- and Q-variables are 48-bit floats in memory (P0 at `L:$1000`), so that
//! memory commands, M-variables and the DPRAM's variable copying see them. M-variables are definitions that point
//! into memory; the definitions are in memory, too (`definitions`).

mod definitions;

use std::collections::BTreeMap;

use crate::map::{IVariables, PmacAddress, Space};
use crate::sim::board::firmware::{DpramHandshake, FirmwareTables};
use crate::sim::board::i_rows::{Scope, Values};
use crate::sim::board::m_definition::MDefinition;
use crate::sim::board::memory::Memory;
use crate::sim::board::number::{decimal, quantised};
use crate::sim::board::password::Password;

/// The four kinds of variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VariableKind {
    /// Set-up of the board.
    I,
    /// Global user variables.
    P,
    /// User variables of a coordinate system.
    Q,
    /// Pointers into memory.
    M,
}

impl VariableKind {
    /// The kind that `letter` (upper case) names.
    #[must_use]
    pub const fn from_letter(letter: u8) -> Option<Self> {
        match letter {
            b'I' => Some(Self::I),
            b'P' => Some(Self::P),
            b'Q' => Some(Self::Q),
            b'M' => Some(Self::M),
            _ => None,
        }
    }

    /// Its letter.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::I => 'I',
            Self::P => 'P',
            Self::Q => 'Q',
            Self::M => 'M',
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Rule {
    kind: Values,
    default: f64,
    hex: bool,
}

/// The variables of a board.
#[derive(Debug, Clone)]
pub struct Variables {
    tables: &'static FirmwareTables,
    rules: Vec<Rule>,
    i: Vec<f64>,
    /// The definitions that are more than a word of memory holds, by the number of the M-variable.
    thumbwheels: BTreeMap<usize, MDefinition>,
    /// The password for programs from 1000 on.
    pub password: Password,
}

/// The variables that `SAVE` keeps: I-variables, M definitions, password, P and Q registers.
#[derive(Debug, Clone)]
pub struct SavedVariables {
    variables: Variables,
    registers: Vec<(u32, u32)>,
}

impl Variables {
    /// Factory defaults of the firmware of `tables`.
    #[must_use]
    pub fn new(tables: &'static FirmwareTables) -> Self {
        let unlisted = Rule { kind: Values::Float, default: 0.0, hex: false };
        let mut rules = vec![unlisted; tables.variables];
        for row in tables.i_rows.iter().copied().flatten() {
            let count = match row.scope {
                Scope::Global => 1,
                Scope::Motor => tables.family.motors,
                Scope::Coordinate => tables.family.coordinate_systems,
            };
            for index in 0..count {
                for n in row.number..=row.last {
                    let number = match row.scope {
                        Scope::Global => n,
                        Scope::Motor => IVariables::motor(index + 1, n),
                        Scope::Coordinate => tables.coordinate_i(index, n),
                    };
                    if let Some(rule) = rules.get_mut(number) {
                        *rule = Rule { kind: row.kind, default: row.default.of(index), hex: row.hex };
                    }
                }
            }
        }
        let i = rules.iter().map(|rule| rule.default).collect();
        Self { tables, rules, i, thumbwheels: BTreeMap::new(), password: Password::default() }
    }

    /// The tables these are of.
    #[must_use]
    pub const fn tables(&self) -> &'static FirmwareTables {
        self.tables
    }

    /// The variables as `SAVE` writes them to flash.
    #[must_use]
    pub fn snapshot(&self, memory: &Memory) -> SavedVariables {
        let registers = self
            .register_addresses()
            .map(|address| (memory.read_y(address), memory.read_x(address)))
            .collect();
        SavedVariables { variables: self.clone(), registers }
    }

    /// Restores the variables of the last `SAVE`; a client must give the password anew.
    pub fn restore(&mut self, saved: &SavedVariables, memory: &mut Memory) {
        *self = saved.variables.clone();
        self.password.close();
        for (address, &(y, x)) in self.register_addresses().zip(&saved.registers) {
            memory.write_y(address, y);
            memory.write_x(address, x);
        }
    }

    /// The addresses of all P- and Q-variables, and of the definitions of M-variables.
    fn register_addresses(&self) -> impl Iterator<Item = u32> + use<> {
        let span = self.tables.variables;
        let q = self.tables.q_addresses.first().copied().unwrap_or(0);
        [self.tables.p_address, q, self.tables.m_address.number]
            .into_iter()
            .flat_map(move |first| (first..).take(span))
    }

    /// I-variable `number`; 0 for a number that no I-variable has.
    #[must_use]
    pub fn i(&self, number: usize) -> f64 {
        self.i.get(number).copied().unwrap_or(0.0)
    }

    /// I-variable `number` as an integer, fractions cut off.
    #[must_use]
    pub fn i_integer(&self, number: usize) -> i64 {
        self.i(number) as i64
    }

    /// Sets I-variable `number`. A value out of range is no error: the board rounds it and reduces it modulo the range
    /// (I3=5 sets 1). The caller then calls [`super::Board::i_assigned`] for the effects.
    pub fn set_i(&mut self, number: usize, value: f64) {
        let (Some(rule), Some(slot)) = (self.rules.get(number), self.i.get_mut(number)) else { return };
        *slot = match rule.kind {
            Values::Float => quantised(value),
            Values::Whole(low, high) => {
                // Far beyond every range, and far inside i128.
                let most = 2f64.powi(100);
                let whole = quantised(value).round_ties_even().clamp(-most, most) as i128;
                let (low, span) = (i128::from(low), i128::from(high - low) + 1);
                ((whole - low).rem_euclid(span) + low) as f64
            }
        };
    }

    /// The factory default of I-variable `number`.
    #[must_use]
    pub fn default_i(&self, number: usize) -> f64 {
        self.rules.get(number).map_or(0.0, |rule| rule.default)
    }

    /// I-variable `number` as listed: decimal, or hex for an address when bit 1 of I9 is set.
    #[must_use]
    pub fn i_text(&self, number: usize) -> String {
        let value = self.i(number);
        if self.hex_listing() && self.rules.get(number).is_some_and(|rule| rule.hex) {
            return format!("${:X}", value as i64 & 0xFF_FFFF);
        }
        decimal(value, self.tables.decimals)
    }

    /// Bit 0 of I9: listings in the long form `I5=2`.
    #[must_use]
    pub fn long_listing(&self) -> bool {
        self.i_integer(9) & 1 != 0
    }

    /// Bit 1 of I9: addresses in hex.
    #[must_use]
    pub fn hex_listing(&self) -> bool {
        self.i_integer(9) & 2 != 0
    }

    /// P-variable `number`.
    #[must_use]
    pub fn p(&self, memory: &Memory, number: usize) -> f64 {
        memory.read_l(self.p_address(number))
    }

    /// Sets P-variable `number`.
    pub fn set_p(&self, memory: &mut Memory, number: usize, value: f64) {
        memory.write_l(self.p_address(number), value);
    }

    /// Q-variable `number` of the 0-based coordinate system `cs`.
    #[must_use]
    pub fn q(&self, memory: &Memory, cs: usize, number: usize) -> f64 {
        memory.read_l(self.q_address(cs, number))
    }

    /// Sets Q-variable `number` of the 0-based coordinate system `cs`, and with it a Q-variable of every other
    /// coordinate system: the sets overlap.
    pub fn set_q(&self, memory: &mut Memory, cs: usize, number: usize, value: f64) {
        memory.write_l(self.q_address(cs, number), value);
    }

    fn p_address(&self, number: usize) -> PmacAddress {
        PmacAddress::new(Space::L, self.tables.p_address + (number % self.tables.variables) as u32)
    }

    fn q_address(&self, cs: usize, number: usize) -> PmacAddress {
        let first = self.tables.q_addresses.first().copied().unwrap_or(0);
        let own = self.tables.q_addresses.get(cs).copied().unwrap_or(0);
        let index = (own.saturating_sub(first) as usize + number) % self.tables.variables;
        PmacAddress::new(Space::L, first + index as u32)
    }
}

/// The effect of the assignment I58=1 on I3, I4 and I6, once, at that assignment (DPRAM manual, "DPRAM ASCII
/// Communications"): I4=0, I6=1; I3 loses its line feeds (3 to 2, 1 to 0), in firmware before 1.15 it becomes 2.
///
/// `firmware` is the version as `VERSION` reports it.
pub fn force_dpram_handshake(variables: &mut Variables, firmware: &str) {
    if variables.tables.dpram_handshake == DpramHandshake::Untouched {
        return;
    }
    let version: f64 =
        firmware.trim_end_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(f64::INFINITY);
    let i3 = if version < 1.15 { 2.0 } else { (variables.i_integer(3) & 2) as f64 };
    variables.set_i(3, i3);
    variables.set_i(4, 0.0);
    variables.set_i(6, 1.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::Board;
    use crate::sim::board::firmware;
    use crate::sim::testing;

    #[test]
    fn values_out_of_range_wrap() {
        let mut variables = Variables::new(&firmware::PMAC);
        for (number, value, kept) in [
            (3, 5.0, 1.0),
            (3, -1.0, 3.0),
            (126, 8_388_608.0, -8_388_608.0),
            (10, 8_388_608.0, 0.0),
            (5, 1.6, 2.0),
            (122, 12.5, 12.5),
            (59, 9.0, 0.0),
            (67, -2.25, -2.25),
        ] {
            variables.set_i(number, value);
            assert_eq!(variables.i(number), kept, "I{number}={value}");
        }
    }

    #[test]
    fn factory_defaults_by_motor_and_coordinate_system() {
        let variables = Variables::new(&firmware::PMAC);
        for (number, value) in [
            (100, 1.0),
            (200, 0.0),
            (125, 49152.0),
            (825, 49180.0),
            (103, 1824.0),
            (803, 1831.0),
            (193, 2054.0),
            (293, 2246.0),
            (10, 3_713_707.0),
            (117, 0.015_625),
        ] {
            assert_eq!(variables.i(number), value, "I{number}");
        }
        assert_eq!(Variables::new(&firmware::PMAC2).i(10), 3_713_991.0);
    }

    #[test]
    fn every_default_is_inside_its_range() {
        for &tables in crate::sim::board::families::SIMULATED {
            let mut variables = Variables::new(tables);
            for number in 0..tables.variables {
                let default = variables.default_i(number);
                variables.set_i(number, default);
                assert!((variables.i(number) - default).abs() <= default.abs() * 1e-10, "I{number}");
            }
        }
    }

    #[test]
    fn a_new_board_has_the_defaults_that_people_are_told() {
        let number = |text: &str| match text.strip_prefix('$') {
            Some(digits) => i64::from_str_radix(digits, 16).ok().map(|word| word as f64),
            None => text.parse::<f64>().ok(),
        };
        for &tables in crate::sim::board::families::SIMULATED {
            let variables = Variables::new(tables);
            let mut compared = 0;
            for n in 0..tables.variables {
                let told = crate::map::i_variable(&format!("I{n}"), tables.family);
                let Some(default) = told.as_ref().and_then(|told| number(told.default)) else { continue };
                // A 0 here may be of a variable that the simulator does not play.
                let played = variables.default_i(n);
                if played != 0.0 {
                    assert!(
                        (default - played).abs() < 1e-4,
                        "{} I{n}: {played}, {told:?}",
                        tables.family.name
                    );
                    compared += 1;
                }
            }
            assert!(compared > 150, "{}: {compared}", tables.family.name);
        }
    }

    #[test]
    fn q_sets_overlap_as_on_the_board() {
        let mut board = testing::board();
        let Board { memory, variables, .. } = &mut board;
        // Q0 of each coordinate system, as &1 sees it.
        for (cs, as_seen_by_1) in [0, 512, 256, 768, 128, 640, 384, 896].into_iter().enumerate() {
            variables.set_q(memory, cs, 0, 10.0 + cs as f64);
            assert_eq!(variables.q(memory, 0, as_seen_by_1), 10.0 + cs as f64);
        }
        variables.set_q(memory, 1, 600, 3.0);
        assert_eq!(variables.q(memory, 0, 88), 3.0, "the set of &2 wraps around");
    }

    #[test]
    fn dpram_ascii_forces_the_handshake() {
        for (firmware, before, after) in [
            ("1.16D", 3.0, 2.0),
            ("1.16D", 1.0, 0.0),
            ("1.15", 2.0, 2.0),
            ("1.16D", 0.0, 0.0),
            ("1.14C", 1.0, 2.0),
        ] {
            let mut variables = Variables::new(&firmware::PMAC);
            variables.set_i(3, before);
            variables.set_i(4, 1.0);
            force_dpram_handshake(&mut variables, firmware);
            assert_eq!(
                [variables.i(3), variables.i(4), variables.i(6)],
                [after, 0.0, 1.0],
                "{firmware} I3={before}"
            );
        }
    }

    #[test]
    fn a_snapshot_brings_everything_back() {
        let mut board = testing::board();
        let Board { memory, variables, .. } = &mut board;
        variables.set_i(122, 50.0);
        variables.set_p(memory, 1023, 7.0);
        variables.set_q(memory, 0, 1023, 8.0);
        let saved = variables.snapshot(memory);
        *variables = Variables::new(variables.tables());
        variables.set_p(memory, 1023, 0.0);
        variables.set_q(memory, 0, 1023, 0.0);
        variables.restore(&saved, memory);
        assert_eq!(
            (variables.i(122), variables.p(memory, 1023), variables.q(memory, 0, 1023)),
            (50.0, 7.0, 8.0)
        );
    }
}
