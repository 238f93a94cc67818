//! What a file of settings and another file or a board hold differently.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::json;

use super::listings;
use super::mistakes::mistaken;
use super::saved::{finish, name};
use super::sequence::begin;
use super::settings_file::{Entry, Item, parse};
use crate::cli::console::input::read;
use crate::cli::context::{Context, Failure};
use crate::format::file_text;
use crate::map::IVariables;
use crate::preprocess::shown;

/// Largest file. All variables of any board fit.
const LARGEST_FILE: u64 = 16 << 20;

/// The settings in a file.
pub fn entries(path: &Path) -> Result<Vec<Entry>, Failure> {
    let file = shown(path);
    let bytes = read(path, LARGEST_FILE).map_err(|why| Failure::Request(format!("{file}: {why}")))?;
    let text = file_text::read(&bytes).map_err(|reason| Failure::Request(format!("{file}: {reason}")))?;
    let mut entries = parse(&file, &text).map_err(|mistakes| mistaken(&mistakes))?;
    // A file of another program may set timers. Their values have changed before the program can compare them.
    entries.retain(|entry| !matches!(entry.item, Item::I(number) if IVariables::is_timer(number)));
    Ok(entries)
}

/// The board's values of `items`, read in a sequence of their own.
pub fn held_of(
    context: &Context,
    kind: &str,
    items: impl Iterator<Item = Item>,
) -> Result<BTreeMap<Item, String>, Failure> {
    let mut connection = context.connection()?;
    let mut board = begin(&mut connection, kind, true);
    let held = listings::read(&mut board, items);
    finish(board)?;
    held
}

/// Items with their texts in two places, of which one may lack them.
type Differences = BTreeMap<Item, (Option<String>, Option<String>)>;

/// The items whose texts in `ours` and `theirs` do not mean the same.
pub fn differences(ours: Vec<Entry>, theirs: &BTreeMap<Item, String>) -> Differences {
    let only_theirs = theirs.iter().map(|(item, text)| (*item, (None, Some(text.clone()))));
    let mut differences: Differences = only_theirs.collect();
    for Entry { item, text, .. } in ours {
        match theirs.get(&item) {
            Some(other) if item.same(&text, other) => drop(differences.remove(&item)),
            other => drop(differences.insert(item, (Some(text), other.cloned()))),
        }
    }
    differences
}

/// Differences as JSON.
pub fn document(differences: &Differences) -> Vec<serde_json::Value> {
    let document = differences
        .iter()
        .map(|(item, (one, other))| json!({ "variable": name(*item), "first": one, "second": other }));
    document.collect()
}
