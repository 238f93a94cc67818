//! What the coordinate systems run, as the background report tells: whoever started it, and before which `pmacd`.

use serde_json::{Value, json};

use crate::decode::BackgroundData;

/// The coordinate systems that run a program, or whose rotary buffer holds lines.
pub fn documents(data: Option<&BackgroundData>) -> Vec<Value> {
    let systems = data.into_iter().flat_map(|data| &data.coordinate_systems);
    let documents = systems.filter_map(|system| {
        let runs = system.status.map(|status| status.has("running_program"));
        // As PR, which counts the lines of the rotary buffer.
        let lines = system.lines_remaining.unwrap_or_default();
        (runs == Some(true) || lines > 0).then(|| {
            json!({ "coordinate_system": system.coordinate_system, "running": runs, "lines_remaining": lines })
        })
    });
    documents.collect()
}

/// One of them in words.
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
