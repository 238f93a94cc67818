//! The MACRO stations of a Turbo board: which there are, and which of their variables are settings.
//!
//! No manual of the stations is at hand: numbers and names come from a tool in use (`dls-pmacanalyse` 3.0.0, `pmac.py`,
//! `pmacstate.py`). Left out are firmware and switches, times, what a card is, readings, and MI198 with MI199, through
//! which a line writes to any register.

use std::ops::RangeInclusive;

use super::listings::read;
use super::settings_file::{Item, NODES};
use crate::cli::context::Failure;
use crate::client::command::lines::LineSequence;
use crate::protocol::answer;

/// The nodes of a MACRO IC.
const NODES_OF_IC: u8 = 16;
/// I20 to I23: where the MACRO ICs are; 0 for none.
const FIRST_BASE: u16 = 20;
/// I6841, and each 50 further: the active nodes of a MACRO IC, a bit each. Nodes 14 and 15 carry no motor.
const FIRST_ACTIVE: u16 = 6841;
const MOTOR_NODES: i64 = 0x3FFF;
/// The nodes that the station serves itself, a bit each, as in I6841.
const SERVED: u16 = 996;
/// A station's settings.
const OF_STATION: [RangeInclusive<u16>; 14] = [
    2..=2,
    6..=6,
    8..=11,
    14..=99,
    101..=108,
    111..=118,
    120..=153,
    161..=196,
    900..=900,
    903..=909,
    940..=943,
    975..=977,
    987..=989,
    992..=999,
];
/// The settings of a node: its channel on the station.
const OF_NODE: [RangeInclusive<u16>; 4] = [910..=918, 923..=923, 925..=926, 928..=929];

/// The settings of the stations on the board's ring. A board without a MACRO IC is asked one line.
///
/// # Errors
/// The board refuses a question about its own variables, or the daemon cannot ask it.
pub fn items(board: &mut LineSequence<'_>) -> Result<Vec<Item>, Failure> {
    let ics = || 0..u16::from(NODES / NODES_OF_IC);
    let (base, active) = (|ic| Item::I(FIRST_BASE + ic), |ic| Item::I(FIRST_ACTIVE + 50 * ic));
    let held = read(board, ics().flat_map(|ic| [base(ic), active(ic)]))?;
    let value = |item| held.get(&item).and_then(|text| answer::integer(text)).unwrap_or(0);
    let is_active = |node: u8| {
        let ic = u16::from(node / NODES_OF_IC);
        value(base(ic)) != 0 && value(active(ic)) & MOTOR_NODES & 1 << (node % NODES_OF_IC) != 0
    };
    let served = |node| Item::OfStation { node, number: SERVED };
    let nodes: Vec<u8> = (0..NODES).filter(|&node| is_active(node)).collect();
    // The nodes at which a station answers.
    let answered = read(board, nodes.into_iter().map(served))?;
    let mut items = Vec::new();
    let mut seen = 0_u64;
    for (item, text) in &answered {
        let &Item::OfStation { node, .. } = item else { continue };
        let of = |ranges: &[RangeInclusive<u16>]| {
            let numbers = ranges.iter().cloned().flatten();
            numbers.map(|number| Item::OfStation { node, number }).collect::<Vec<_>>()
        };
        // A station tells its own settings at each of its nodes: once is enough.
        if seen & 1 << node == 0 {
            items.extend(of(&OF_STATION));
            let served = answer::integer(text).unwrap_or(0) as u64 & 0xFFFF;
            seen |= served << (node / NODES_OF_IC * NODES_OF_IC);
        }
        items.extend(of(&OF_NODE));
    }
    Ok(items)
}
