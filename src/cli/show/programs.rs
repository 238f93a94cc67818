//! The running programs, by the background report: whichever client or earlier `pmacd` started them.

use serde_json::{Value, json};

use crate::client::{Board, View};
use crate::decode::BackgroundData;

/// The coordinate systems that run a program, or whose rotary buffer holds lines.
pub fn documents(data: Option<&BackgroundData>) -> Vec<Value> {
    let systems = data.into_iter().flat_map(|data| &data.coordinate_systems);
    let documents = systems.filter_map(|system| {
        let runs = system.status.map(|status| status.has("running_program"));
        // As `PR`, which counts the lines of the rotary buffer.
        let lines = system.lines_remaining.unwrap_or_default();
        (runs == Some(true) || lines > 0).then(|| {
            json!({ "coordinate_system": system.coordinate_system, "running": runs, "lines_remaining": lines })
        })
    });
    documents.collect()
}

/// The running programs, and how to end them; `None` if no fresh report shows a program. For a user whose line the
/// board refused because of a running program.
pub fn what_runs(board: &mut Board) -> Option<String> {
    let background = board.snapshot().ok()?.background.filter(View::is_fresh)?;
    let documents = documents(Some(&background.data));
    let running = documents.iter().filter(|document| document["running"] == true);
    let systems: Vec<String> =
        running.map(|document| format!("&{}", document["coordinate_system"])).collect();
    let first = systems.first()?;
    let run = if systems.len() == 1 { "runs a program" } else { "run programs" };
    Some(format!("{} {run}; {first}Q ends it after the move under way, {first}A at once", systems.join(" ")))
}

/// A program in words.
pub fn text(document: &Value) -> String {
    let runs = match document["running"].as_bool() {
        Some(true) => "runs",
        Some(false) => "does not run",
        None => "may run: its status is not read",
    };
    let lines = document["lines_remaining"].as_i64().filter(|lines| *lines > 0);
    let lines = lines.map_or_else(String::new, |lines| format!("; {lines} lines left in its rotary buffer"));
    format!("&{} {runs}{lines}", document["coordinate_system"])
}
