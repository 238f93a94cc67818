//! A replay is of the family that was recorded, and works by the settings that were in force then.

use std::path::Path;

use crate::map::Family;
use crate::protocol::BoardSettings;
use crate::recording::About;

/// The family of the board that was recorded in `directory`, with as much DPRAM as it had; `named` is the configuration's.
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

/// The settings that were in force when the board was recorded.
///
/// # Errors
/// The recording cannot be read.
pub(super) fn settings(directory: &Path) -> Result<BoardSettings, String> {
    About::read(directory).map(|about| about.settings).map_err(|error| error.to_string())
}
