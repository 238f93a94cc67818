//! A warning while pmacd has not yet answered a stop.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::cli::console::note::note;

/// How long `pmacd` may leave a stop unanswered before pmacctl warns.
pub const WARN_AFTER: Duration = Duration::from_secs(1);

/// The warning.
pub const UNANSWERED: &str = "pmacd has not answered for a second: nothing is known to stand; use the emergency stop, or ^A \
                              over the serial port";

/// Does `stop`. If `stop` takes longer than a second, warns meanwhile that the motors may still move.
pub fn warn_if_late<T>(stop: impl FnOnce() -> T) -> T {
    std::thread::scope(|scope| {
        let (done, over) = channel::<()>();
        scope.spawn(move || {
            if over.recv_timeout(WARN_AFTER) == Err(RecvTimeoutError::Timeout) {
                note(format_args!("pmacctl: {UNANSWERED}"));
            }
        });
        let stopped = stop();
        drop(done);
        stopped
    })
}
