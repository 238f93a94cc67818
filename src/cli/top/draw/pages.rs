//! The pages that are text: the keys, and the lines of `status`.

use super::Picture;
use crate::cli::show::status;
use crate::cli::top::keys::BINDINGS;

/// The use of the jog keys.
const JOGGING: &str = "Armed, a motor jogs only while its key is held down and repeats: a single press moves nothing. It stops when \
    the key has been silent for 0.2 s, on any other key, and when this program or its terminal dies. When pmacd or this machine \
    dies it goes on: keep the emergency stop at hand.";

/// Each key and its effect.
pub fn help() -> Vec<(String, String)> {
    let keys = BINDINGS.iter().map(|binding| (binding.shown.to_owned(), binding.does.to_owned()));
    keys.chain([(String::new(), JOGGING.to_owned())]).collect()
}

impl Picture<'_> {
    /// Each fact of `status`.
    pub(super) fn status_page(&self) -> Vec<(String, String)> {
        let text = |text: &str| (String::new(), text.to_owned());
        let Some(answer) = self.answer else { return vec![text("pmacd has not answered yet")] };
        let old = self.daemon_fault().map(|fault| text(&fault));
        old.into_iter().chain(status::lines(&answer.status)).collect()
    }
}
