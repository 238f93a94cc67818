//! `pmacctl coordinates`: the coordinate systems of the background data, as a table or JSON.

use serde_json::{Value, json};

use crate::cli::console::number::{NOT_READ, fixed, short};
use crate::cli::console::table::{Align, Table};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors::stamp;
use crate::client::{Snapshot, Staleness};
use crate::decode::{BackgroundData, CoordinateSystem, Quantity};
use crate::map::AXES;

pub fn run(context: &mut Context) -> Result<Verdict, Failure> {
    let snapshot = context.board()?.snapshot()?;
    if context.output.is_json() {
        context.output.json(&document(&snapshot))?;
    } else {
        context.output.text(text(&snapshot))?;
    }
    Ok(snapshot.background.is_some_and(|background| background.is_fresh()).into())
}

fn document(snapshot: &Snapshot) -> Value {
    let mut document = json!({ "background": stamp(snapshot.background.as_ref(), snapshot.stale) });
    add(&mut document, snapshot.background.as_ref().map(|background| &background.data));
    document
}

/// Adds the background data to a document. Without data the parts are empty.
pub fn add(document: &mut Value, data: Option<&BackgroundData>) {
    document["coordinate_systems"] = data.map_or(json!([]), |data| json!(data.coordinate_systems));
    document["background_motors"] = data.map_or(json!([]), |data| json!(data.motors));
    document["ports"] = data.map_or(Value::Null, |data| json!(data.ports));
}

fn text(snapshot: &Snapshot) -> String {
    let Some(background) = &snapshot.background else {
        let reason = snapshot.stale.map_or_else(|| Staleness::Off.to_string(), |stale| stale.to_string());
        return format!("STALE: there are no background data yet: {reason}\n");
    };
    let note = background.stale.map_or_else(String::new, |stale| format!("STALE: {stale}\n"));
    note + &table(&background.data)
}

/// The table of the coordinate systems.
pub fn table(data: &BackgroundData) -> String {
    let mut table = Table::new(&[
        ("system", Align::Right),
        ("mode", Align::Left),
        ("lines", Align::Right),
        ("left ms", Align::Right),
        ("flags", Align::Left),
        ("targets", Align::Left),
    ]);
    for system in &data.coordinate_systems {
        table.row([
            format!("&{}", system.coordinate_system),
            mode(system),
            system.lines_remaining.map_or_else(|| NOT_READ.to_owned(), |lines| lines.to_string()),
            system.time_left_in_move.map_or_else(|| NOT_READ.to_owned(), milliseconds),
            flags(system).join(" "),
            targets(system),
        ]);
    }
    table.to_string()
}

/// The flags to show from both status words: errors first, then the state.
const SHORT: [(&str, &str); 9] = [
    ("run_time_error", "run-time-error"),
    ("circle_radius_error", "radius-error"),
    ("amplifier_fault", "amplifier-fault"),
    ("fatal_following_error", "fatal-error"),
    ("warning_following_error", "warning-error"),
    ("running_program", "running"),
    ("program_hold_stop", "hold"),
    ("single_step_mode", "single-step"),
    ("in_position", "in-position"),
];

fn mode(system: &CoordinateSystem) -> String {
    let unknown = if system.program_status.is_some() { "?" } else { NOT_READ };
    system.motion_mode.map_or_else(|| unknown.to_owned(), |mode| format!("{mode:?}").to_lowercase())
}

fn milliseconds(time: Quantity) -> String {
    time.value.map_or_else(String::new, |left| fixed(left, 1))
}

fn flags(system: &CoordinateSystem) -> Vec<&'static str> {
    let words = [system.status, system.program_status];
    if words == [None; 2] {
        return vec![NOT_READ];
    }
    let set = |name: &str| words.iter().flatten().any(|word| word.has(name));
    SHORT.iter().filter(|(name, _)| set(name)).map(|(_, short)| *short).collect()
}

/// The axes with targets other than 0. Most machines use few of the nine.
fn targets(system: &CoordinateSystem) -> String {
    if system.axis_targets.0 == [None; AXES.len()] {
        return NOT_READ.to_owned();
    }
    let axes = AXES.iter().zip(system.axis_targets.0);
    let axes = axes.filter_map(|(axis, target)| Some((axis, target.filter(|target| *target != 0.0)?)));
    axes.map(|(axis, target)| format!("{axis}{}", short(target))).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn every_short_word_stands_for_a_flag_there_is() {
        for (name, _) in SHORT {
            let mut flags = PMAC.status.coordinate_system.iter().flat_map(|table| table.flags);
            assert!(flags.any(|(_, flag)| *flag == name), "{name}");
        }
    }
}
