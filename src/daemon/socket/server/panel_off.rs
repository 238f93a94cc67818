//! The board has stopped reading the control panel: holds are over, and motors that the panel set in motion may go on.

use std::time::Instant;

use log::warn;

use super::Service;
use crate::daemon::shared::open_buffer::Account;
use crate::map::Motors;
use crate::protocol::Function;

impl Service {
    /// The board has stopped reading the control panel: `by` has switched the panel off, or an unknown sender.
    pub(super) fn panel_ended(&mut self, by: Option<Account>, now: Instant) {
        self.ledger.panel_ended(by, now);
        let going = self.ledger.newly_alone(self.info.motion());
        if !going.is_empty() {
            warn!(target: "audit", "{}", self.without_panel(going));
        }
    }

    /// The warning about motors that the panel set in motion and that go on while the panel is off.
    pub(super) fn jogs_without_panel(&self) -> Option<String> {
        let going = self.ledger.going_by_panel(self.info.motion());
        let is_off = self.info.enabling().panel == Some(false);
        (is_off && !going.is_empty()).then(|| self.without_panel(going))
    }

    fn without_panel(&self, motors: Motors) -> String {
        let cure = if self.uses(Function::Ascii) {
            "pmacctl jog N stop stops it by command line, pmacctl abort everything"
        } else {
            "pmacd sends no command lines, so nothing of it stops it until the panel is on again"
        };
        format!(
            "motor {motors} was set in motion by the control panel, which is off (I{} is not 3), and may go on: {cure}",
            self.info.family().i.panel.unwrap_or_default()
        )
    }
}
