//! `pmacctl backup --check`: whether a board still holds its backup, for a nightly job.

use std::collections::BTreeSet;
use std::path::Path;

use clap::ValueEnum;

use super::differences::{differences, document, entries, held_of};
use super::saved::{What, is_there, name, others};
use super::settings_file::{Entry, Item};
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::preprocess::shown;

/// The most differences in the list of a check.
const LISTED: usize = 20;

/// Compares the board with `file`. Also finds axis definitions and programs that `file` does not name.
///
/// # Errors
/// The check could not be made; never [`Failure::Refused`], whose exit status would mean a difference.
pub fn check(
    context: &mut Context,
    file: &Path,
    what: &[What],
    programs: (u16, u16),
) -> Result<Verdict, Failure> {
    compare(context, file, what, programs).map_err(|failure| match failure {
        Failure::Refused(why) => Failure::Request(why),
        other => other,
    })
}

fn compare(
    context: &mut Context,
    file: &Path,
    what: &[What],
    programs: (u16, u16),
) -> Result<Verdict, Failure> {
    let ours: Vec<Entry> =
        entries(file)?.into_iter().filter(|entry| what.contains(&kind(entry.item))).collect();
    let shown = shown(file);
    if ours.is_empty() {
        return Err(Failure::Request(format!(
            "{shown} has no settings of these kinds: nothing was compared"
        )));
    }
    let family = Context::family(None, &mut context.connection()?)?;
    let named: BTreeSet<Item> = ours.iter().map(|entry| entry.item).collect();
    let asked = named.iter().copied().chain(others(what, programs, family));
    let mut held = held_of(context, "check", asked)?;
    held.retain(|item, text| named.contains(item) || is_there(*item, text));
    let differences = differences(ours, &held);
    if context.output.is_json() {
        context.output.json(&document(&differences))?;
        return Ok(differences.is_empty().into());
    }
    for (item, (one, other)) in differences.iter().take(LISTED) {
        let name = name(*item);
        let line = match (one, other.as_deref()) {
            (None, _) => format!("{name}: on the board, not in {shown}"),
            (Some(_), None | Some("")) => format!("{name}: in {shown}, not on the board"),
            _ if item.is_program() => format!("{name}: another program on the board"),
            (Some(one), Some(other)) => format!("{name}: {one} in {shown}, {other} on the board"),
        };
        context.output.line(line)?;
    }
    let kinds: BTreeSet<What> = named.iter().map(|item| kind(*item)).collect();
    let missing = differences.keys().map(|item| kind(*item)).filter(|kind| !kinds.contains(kind));
    let missing: BTreeSet<What> = missing.collect();
    if !missing.is_empty() {
        let names = missing.iter().filter_map(|kind| Some(kind.to_possible_value()?.get_name().to_owned()));
        let without = names.collect::<Vec<_>>().join(", ");
        note(format_args!("{shown} has no {without}; --what leaves kinds out of the comparison"));
    }
    if let Some(more) = differences.len().checked_sub(LISTED).filter(|more| *more > 0) {
        context.output.line(format_args!("and {more} more: --json has them all"))?;
    }
    Ok(differences.is_empty().into())
}

/// The kind of settings to which `item` belongs.
const fn kind(item: Item) -> What {
    match item {
        Item::I(_) => What::I,
        Item::P(_) => What::P,
        Item::Q { .. } => What::Q,
        Item::Definition(_) | Item::M(_) => What::M,
        Item::OfStation { .. } => What::Stations,
        Item::Axis { .. } => What::Axes,
        Item::Kinematics { .. } => What::Kinematics,
        Item::Program(_) => What::Programs,
        Item::Plc(_) => What::Plcs,
    }
}
