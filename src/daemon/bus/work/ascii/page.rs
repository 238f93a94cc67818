//! The DPRAM's page, while the board does not answer.
//!
//! A VME board forgets its page at a reset, and the host must write it again (User Manual p. 263-267). Until then the
//! host sees all ones, or another page of the same memory. Without reports only the board's silence shows the wrong
//! page. So while the board is silent, the daemon writes the page again before it asks anything more. Writing the right
//! page again does no harm.

use std::time::Instant;

use log::warn;

use super::AsciiQueue;
use crate::daemon::bus::timing::PAGE_AGAIN;
use crate::function::line_port::PortError;
use crate::protocol::CommandState;

/// When to write the page again.
#[derive(Debug, Default)]
pub(super) struct PageAgain {
    due: Option<Instant>,
}

impl AsciiQueue {
    /// Writes the page while the board does not answer.
    pub(super) fn keep_page(&mut self, now: Instant) -> Result<(), PortError> {
        if self.state != CommandState::Silent {
            self.page_again.due = None;
            return Ok(());
        }
        let Some(page) = self.ports.page() else { return Ok(()) };
        if self.page_again.due.is_some_and(|due| now < due) {
            return Ok(());
        }
        if self.page_again.due.replace(now + PAGE_AGAIN).is_none() {
            warn!(
                "the board does not answer: writes the DPRAM's page 0x{page:02X} again, and each second until it answers; after a reset \
                 another page may show"
            );
        }
        self.ports.select_page()
    }
}
