//! Shows live data: repainted in place on a terminal, else as lines.

use std::io;

use rustix::termios::tcgetwinsize;
use serde_json::Value;

use crate::cli::console::Output;
use crate::cli::context::Failure;
use crate::client::{Staleness, View};

/// Move the cursor to the top left; clear its line; clear from the cursor to the end of the screen.
const HOME: &str = "\x1b[H";
const CLEAR_LINE: &str = "\x1b[K";
const CLEAR_BELOW: &str = "\x1b[J";

/// The columns and rows of a window.
type Size = (usize, usize);

/// The display for live data.
pub struct Screen {
    repaint: bool,
    /// The text below the title.
    note: String,
}

impl Screen {
    pub fn new(repaint: bool) -> Self {
        Self { repaint, note: String::new() }
    }

    /// With one line below the title; in a narrow window with several lines.
    pub fn with_note(mut self, note: String) -> Self {
        self.note = note;
        self
    }

    pub fn show(&mut self, output: &mut Output, title: &str, live: &dyn Live) -> Result<(), Failure> {
        if output.is_json() {
            output.json_line(&live.document())?;
        } else if self.repaint {
            let size = size();
            let text = live.text(size.map(|(columns, _)| columns), &mut |stale| stale.to_string());
            let note = wrapped(&self.note, size);
            let screen = format!("{title}  update {}\n{note}{text}", live.update().0);
            output.text(HOME)?;
            // Clear the line before the text: after the last column, a clear would remove the last letter.
            for line in fitting(&screen, size) {
                output.text(format_args!("{CLEAR_LINE}{line}\n"))?;
            }
            output.text(CLEAR_BELOW)?;
        } else {
            output.line(live.line())?;
        }
        Ok(())
    }
}

/// Data to show live.
pub trait Live {
    /// The number of the update, and whether the update is live.
    fn update(&self) -> (u64, bool);
    /// As JSON.
    fn document(&self) -> Value;
    /// The data as a table, at most `width` wide if given; `why` explains stale data in a sentence.
    fn text(&self, width: Option<usize>, why: &mut dyn FnMut(Staleness) -> String) -> String;
    /// The data on one line.
    fn line(&self) -> String;
}

/// The window's size, which may change. `None` if the terminal does not tell.
fn size() -> Option<Size> {
    let size = tcgetwinsize(io::stdout()).ok()?;
    (size.ws_col > 0 && size.ws_row > 0).then(|| (size.ws_col.into(), size.ws_row.into()))
}

/// The whole line, wrapped to the window.
fn wrapped(line: &str, size: Option<Size>) -> String {
    let columns = size.map_or(usize::MAX, |(columns, _)| columns);
    let characters: Vec<char> = line.chars().collect();
    characters.chunks(columns).flat_map(|row| row.iter().copied().chain(['\n'])).collect()
}

/// Cuts the lines to the window. The last row is for the cursor.
fn fitting(text: &str, size: Option<Size>) -> Vec<String> {
    let lines = text.lines();
    let Some((columns, rows)) = size else { return lines.map(str::to_owned).collect() };
    let cut = |line: &str| line.chars().take(columns).collect::<String>();
    let room = rows.saturating_sub(1).max(1);
    let count = lines.clone().count();
    if count <= room {
        return lines.map(cut).collect();
    }
    let shown = room - 1;
    let rest = format!("... {} more", count - shown);
    lines.take(shown).chain(std::iter::once(rest.as_str())).map(cut).collect()
}

/// The number of the update in `view`, and whether the update is live.
pub fn update<T>(view: Option<&View<T>>) -> (u64, bool) {
    view.map_or((0, false), |view| (view.sequence, view.is_fresh()))
}

/// The same on a line.
pub fn state<T>(view: Option<&View<T>>, otherwise: Option<Staleness>) -> String {
    let Some(view) = view else {
        return format!("update=0 stale={}", otherwise.map_or("no_data", Staleness::name));
    };
    let state = view.stale.map_or_else(|| "fresh".to_owned(), |stale| format!("stale={}", stale.name()));
    format!("update={} {state}", view.sequence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_fits_its_window() {
        let text = "one\ntwo and more\nthree\n";
        let fit = |size| fitting(text, size);
        assert_eq!(fit(None), ["one", "two and more", "three"]);
        assert_eq!(fit(Some((80, 4))), ["one", "two and more", "three"]);
        assert_eq!(fit(Some((5, 4))), ["one", "two a", "three"]);
        assert_eq!(fit(Some((80, 3))), ["one", "... 2 more"]);
        assert_eq!(fit(Some((80, 2))), ["... 3 more"]);
        assert_eq!(fit(Some((5, 1))), ["... 3"]);
    }

    #[test]
    fn a_line_to_copy_is_never_cut() {
        assert_eq!(wrapped("try: pmacctl", Some((5, 4))), "try: \npmacc\ntl\n");
        assert_eq!(wrapped("try", None), "try\n");
        assert_eq!(wrapped("", Some((5, 4))), "");
    }
}
