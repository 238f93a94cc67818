//! A board's settings, read in one sequence: variables, definitions and programs, and the lines that set them again.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use clap::ValueEnum;
use serde_json::json;

use crate::cli::console::{Interrupt, note, rfc3339_now};
use crate::cli::context::Failure;
use crate::cli::files::listings::read;
use crate::cli::files::sequence::{ask, begin};
use crate::cli::files::settings_file::Item;
use crate::cli::files::stations;
use crate::client::Connection;
use crate::client::command::lines::LineSequence;
use crate::map::{DEFAULT_FAMILY, Family, Generation, IVariables};
use crate::protocol::BoardInfo;

/// PLC programs of any board (Software Reference, `OPEN`).
const PLCS: u8 = 32;

/// Kinds of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum What {
    #[value(name = "I")]
    I,
    #[value(name = "P")]
    P,
    #[value(name = "Q")]
    Q,
    #[value(name = "M")]
    M,
    /// Variables of MACRO stations.
    #[value(name = "MS")]
    Stations,
    /// Axis definitions.
    #[value(name = "AXES")]
    Axes,
    /// Kinematic programs.
    #[value(name = "KIN")]
    Kinematics,
    /// Motion programs.
    #[value(name = "PROG")]
    Programs,
    /// PLC programs.
    #[value(name = "PLC")]
    Plcs,
}

/// A board's settings, and its identity.
pub struct Saved {
    info: BoardInfo,
    board_type: String,
    firmware: String,
    date: String,
    taken: String,
    held: BTreeMap<Item, String>,
}

impl Saved {
    /// Asks the board for `wanted`, in a sequence that the daemon calls a `kind` to other clients; of motion programs,
    /// for those in the range `programs`. A `stop` ends the sequence after the line under way.
    ///
    /// # Errors
    /// The board refuses a question or gives an unexpected answer, or the daemon cannot ask it.
    pub fn ask(
        connection: &mut Connection,
        kind: &str,
        wanted: &[What],
        programs: (u16, u16),
        stop: Option<&Interrupt>,
    ) -> Result<Self, Failure> {
        let info = connection.info()?;
        let mut board = begin(connection, kind, true);
        if let Some(stop) = stop {
            board.stop_on(stop.flag());
        }
        let items = items(wanted, programs, &info.family);
        let has_stations = wanted.contains(&What::Stations) && info.family.parse() == Ok(Generation::Turbo);
        // Ask the board: a daemon that has just started does not know the answers yet.
        let said = ask(&mut board, &["TYPE", "VERSION", "DATE"]);
        let held = said.and_then(|said| Ok((said, settings(&mut board, items, has_stations)?)));
        // Also after a refusal: the next client must not wait until the daemon misses this client.
        finish(board)?;
        let (said, held) = held?;
        let say = |index: usize| said.get(index).map_or(String::new(), |reply| reply.join(" "));
        let (board_type, firmware, date) = (say(0), say(1), say(2));
        let taken = rfc3339_now().replace(".000000", "");
        Ok(Self { info, board_type, firmware, date, taken, held })
    }

    /// As readable lines for `restore`.
    pub fn text(&self) -> String {
        let Self { info, board_type, firmware, date, taken, held } = self;
        let mut text = format!(
            "; settings of {}\n; board {board_type} ({})\n; firmware {firmware}, {date}\n; taken {taken}\n",
            info.name, info.family
        );
        listing(held, &mut text);
        text
    }

    /// As JSON.
    ///
    /// # Errors
    /// JSON cannot hold the settings.
    pub fn document(&self) -> Result<String, Failure> {
        let variables: Vec<_> =
            self.held.iter().map(|(item, text)| json!({ "variable": name(*item), "value": text })).collect();
        let document = json!({ "name": self.info.name, "board_type": self.board_type, "family": self.info.family,
            "firmware": self.firmware, "firmware_date": self.date, "taken": self.taken, "variables": variables });
        let mut text = serde_json::to_string_pretty(&document).map_err(Failure::request)?;
        text.push('\n');
        Ok(text)
    }
}

/// All `wanted` items of a board of `family`.
fn items(wanted: &[What], programs: (u16, u16), family: &str) -> Vec<Item> {
    let count = variables_of(family);
    let is_wanted = |kind| wanted.contains(&kind);
    let mut items: Vec<Item> = Vec::new();
    if is_wanted(What::I) {
        // A timer's value has changed before the program can compare it or put it back.
        items.extend((0..count).filter(|&number| !IVariables::is_timer(number)).map(Item::I));
    }
    if is_wanted(What::P) {
        items.extend((0..count).map(Item::P));
    }
    if is_wanted(What::Q) {
        // The Q-variables of the coordinate systems overlap. The Q-variables of &1 reach every register.
        items.extend((0..count).map(|number| Item::Q { system: 1, number }));
    }
    if is_wanted(What::M) {
        items.extend((0..count).map(Item::Definition));
    }
    items.extend(others(wanted, programs, Family::by_name(family).unwrap_or(DEFAULT_FAMILY)));
    items
}

/// The board's values of `items`, the values of the M-variables that point nowhere, and if `with_stations`, the
/// variables of its MACRO stations.
fn settings(
    board: &mut LineSequence<'_>,
    items: Vec<Item>,
    with_stations: bool,
) -> Result<BTreeMap<Item, String>, Failure> {
    let mut held = read(board, items)?;
    // A missing definition or program is no setting: `restore` deletes none.
    held.retain(|item, text| is_there(*item, text));
    let own: Vec<Item> = held
        .iter()
        .filter_map(|(item, text)| match item {
            Item::Definition(number) if text == "*" => Some(Item::M(*number)),
            _ => None,
        })
        .collect();
    held.extend(read(board, own)?);
    if with_stations {
        let items = stations::items(board)?;
        held.extend(read(board, items)?);
    }
    Ok(held)
}

/// Whether the board has `item` at all, which it lists as `text`.
pub fn is_there(item: Item, text: &str) -> bool {
    match item {
        Item::Axis { .. } => text != "0",
        item => !item.is_program() || !text.is_empty(),
    }
}

/// The items besides variables.
pub fn others(wanted: &[What], programs: (u16, u16), family: &Family) -> Vec<Item> {
    let is_wanted = |kind| wanted.contains(&kind);
    let systems = || 1..=family.coordinate_systems as u8;
    let mut items = Vec::new();
    if is_wanted(What::Axes) {
        let motors = 1..=family.motors as u8;
        items.extend(
            systems().flat_map(|system| motors.clone().map(move |motor| Item::Axis { system, motor })),
        );
    }
    if is_wanted(What::Kinematics) && family.generation == Generation::Turbo {
        items.extend(
            systems().flat_map(|system| [false, true].map(|inverse| Item::Kinematics { system, inverse })),
        );
    }
    if is_wanted(What::Programs) {
        items.extend((programs.0..=programs.1).map(Item::Program));
    }
    if is_wanted(What::Plcs) {
        items.extend((0..PLCS).map(Item::Plc));
    }
    items
}

/// The name of an item in JSON: the left side of its line.
pub fn name(item: Item) -> String {
    let arrow = if item.sign() == "->" { "->" } else { "" };
    format!("{item}{arrow}")
}

/// The lines for each item, sorted.
fn listing(held: &BTreeMap<Item, String>, text: &mut String) {
    let mut system = None;
    for (item, value) in held {
        if let Some(own) = item.system()
            && system != Some(own)
        {
            system = Some(own);
            // Writing to a String cannot fail.
            let _ = writeln!(text, "&{own}");
        }
        item.lines_there(value).iter().for_each(|line| {
            let _ = writeln!(text, "{line}");
        });
    }
}

/// How many variables of each kind a board has (User Manual p. 148; Turbo User Manual).
fn variables_of(family: &str) -> u16 {
    match family.parse() {
        Ok(Generation::Turbo) => 8192,
        _ => 1024,
    }
}

/// Ends a sequence, and prints what the sequence leaves on the board.
pub fn finish(sequence: LineSequence<'_>) -> Result<(), Failure> {
    let over = sequence.finish()?;
    over.notes.iter().for_each(note);
    over.failure.map_or(Ok(()), |failure| Err(Failure::Refused(failure.message)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::files::settings_file::parse;

    #[test]
    fn what_is_listed_reads_back_the_same() {
        let q = |system, number| Item::Q { system, number };
        let held: BTreeMap<Item, String> = [
            (Item::M(3), "7"),
            (Item::Definition(3), "*"),
            (q(2, 1), "5"),
            (q(1, 1), "4"),
            (Item::P(0), "-0.5"),
            (Item::I(125), "$C000"),
            (Item::I(2), "0"),
        ]
        .into_iter()
        .map(|(item, text)| (item, text.to_owned()))
        .collect();
        let mut text = String::new();
        listing(&held, &mut text);
        assert_eq!(text, "I2=0\nI125=$C000\nP0=-0.5\n&1\nQ1=4\n&2\nQ1=5\nM3->*\nM3=7\n");
        let again: BTreeMap<Item, String> =
            parse("f", &text).unwrap().into_iter().map(|entry| (entry.item, entry.text)).collect();
        assert_eq!(again, held);
    }
}
