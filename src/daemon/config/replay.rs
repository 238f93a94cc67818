//! A replay has the family of the recorded board, and works by the settings in force at the recording.

use std::path::Path;

use crate::map::Family;
use crate::protocol::BoardSettings;
use crate::recording::About;

/// The family of the board recorded in `directory`, with as much DPRAM as the board had; `named` is the configuration's
/// family.
///
/// # Errors
/// The setting that is wrong, and why.
pub(super) fn family(
    directory: &Path,
    named: Option<&'static Family>,
) -> Result<&'static Family, (&'static str, String)> {
    let recorded = About::read(directory).and_then(|about| about.family(directory));
    let recorded = recorded.map_err(|error| ("board", error.to_string()))?;
    match named.filter(|named| named.generation != recorded.generation) {
        Some(named) => {
            let text = format!(
                "the recording is of a {}, but family = \"{}\" in the configuration says otherwise; remove it",
                recorded.title, named.name
            );
            Err(("family", text))
        }
        None => Ok(recorded),
    }
}

/// The settings in force at the recording.
///
/// # Errors
/// The recording cannot be read.
pub(super) fn settings(directory: &Path) -> Result<BoardSettings, String> {
    About::read(directory).map(|about| about.settings).map_err(|error| error.to_string())
}
