//! Errors of the board's programs in the log: so many in a time, then a count. A program that fails in each scan would
//! fill the log.

use std::time::{Duration, Instant};

use log::{info, warn};

use crate::daemon::shared::log_quota::LogQuota;
use crate::daemon::shared::queue::Unsolicited;
use crate::map::errors::meaning;
use crate::protocol::MessageKind;

/// How many errors the log gets, and in which time.
const TOLD: u32 = 10;
const PERIOD: Duration = Duration::from_secs(60);

/// The errors in the log so far.
#[derive(Debug, Default)]
pub(super) struct ProgramErrors {
    quota: Option<LogQuota>,
}

impl ProgramErrors {
    /// Logs `message` if it is an error of a program, or counts it.
    pub(super) fn see(&mut self, message: &Unsolicited, now: Instant) {
        if message.kind != MessageKind::Error {
            return;
        }
        if let Some(quota) = self.quota.take_if(|quota| quota.end() <= now)
            && quota.untold() > 0
        {
            info!("{} more errors of programs of the board within {PERIOD:?}", quota.untold());
        }
        if self.quota.get_or_insert(LogQuota::until(now + PERIOD)).may_tell(TOLD) {
            let text = message.text.to_latin1();
            let number = text.strip_prefix("ERR").and_then(|number| number.parse().ok());
            let meaning = number.and_then(meaning).unwrap_or("unknown error");
            warn!("error of a program of the board: {text}: {meaning}; a CMD in it was refused");
        }
    }
}
