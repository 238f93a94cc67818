//! A jog that lasts only as long as a client holds it.
//!
//! The daemon requests the stop after 200 ms without a call from the holder, whatever the reason: the holder was killed
//! or stopped, or its machine is too busy. So the jog never outlives this process, by the control panel or by command
//! line. A jog by command line also stops as soon as the holder's connection is gone.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use nix::sys::signal::{SigSet, SigmaskHow};

use super::command::{CommandError, Connection, SendAs};
use crate::language::deadlines;
use crate::protocol::{CallError, Function};

/// How long the holder of a jog by command line may be silent; the daemon allows the same for a jog by the panel.
const LEASE_MS: u64 = 200;
/// How often the holder renews the lease: three times before the lease is over.
const RENEW: Duration = Duration::from_millis(60);

/// Whether held jogs use the control panel: the daemon uses the panel, and no M-variable forbids it.
///
/// # Errors
/// [`CommandError`].
pub fn jogs_by_panel(connection: &mut Connection) -> Result<bool, CommandError> {
    Ok(connection.settings()?.functions.has(Function::Panel)
        && connection.info()?.leaves_free(Function::Panel))
}

/// A held jog. Dropping it requests the stop, but not in a forked child: the parent holds the jog.
#[derive(Debug)]
pub struct HeldJog {
    numbers: Vec<u8>,
    /// The holder's process.
    process: u32,
    /// Dropped to end the renewals.
    tell: Option<SyncSender<()>>,
    renewing: Option<JoinHandle<Result<Connection, CommandError>>>,
}

impl HeldJog {
    /// Begins `action` (`jog-` or `jog+`) of the motors `numbers`, and renews the jog from now on: by the control
    /// panel, or, if the daemon does not use the panel, as on a Turbo board, by the command line `#1J-` or `#1J+`. The
    /// line addresses the motor, enters no program buffer, and needs the role engineer. Other clients may still command
    /// the motor: their command ends the hold, and of several motors the daemon stops the others.
    ///
    /// # Errors
    /// As [`Connection::panel`] and [`Connection::send`]. After an error the daemon stops any motor that the board has
    /// started.
    pub fn begin(mut connection: Connection, action: &str, numbers: &[u8]) -> Result<Self, CommandError> {
        if !jogs_by_panel(&mut connection)? {
            return Self::begin_by_line(connection, action, numbers);
        }
        connection.panel_hold(action, numbers)?;
        Self::renewed(connection, numbers, |connection, _| connection.panel_renew())
    }

    fn begin_by_line(mut connection: Connection, action: &str, numbers: &[u8]) -> Result<Self, CommandError> {
        let command = match action {
            "jog-" => "J-",
            "jog+" => "J+",
            _ => return Err(CallError::invalid("action", "jog- or jog+").into()),
        };
        let line: String = numbers.iter().map(|number| format!("#{number}{command}")).collect();
        let send_as = SendAs {
            into_buffer: Some(false),
            while_connected: Some(true),
            silence_ms: Some(LEASE_MS),
            ..SendAs::default()
        };
        connection.send_as(&line, deadlines::PLAIN, send_as)?;
        Self::renewed(connection, numbers, |connection, numbers| {
            // As by the panel, the hold of several motors ends with the first of them.
            let going = connection.jog_renew()?;
            if numbers.iter().all(|number| going.contains(number)) {
                return Ok(());
            }
            let reason = "the jog is over: pmacd has stopped it, or a motor stands or obeys another command; that motor gets no stop, \
                          others of the jog do";
            Err(CallError::Refused { reason: reason.to_owned() }.into())
        })
    }

    /// A jog that has begun; `renew` renews it.
    fn renewed(
        mut connection: Connection,
        numbers: &[u8],
        renew: impl Fn(&mut Connection, &[u8]) -> Result<(), CommandError> + Send + 'static,
    ) -> Result<Self, CommandError> {
        let (tell, told) = sync_channel::<()>(0);
        let motors = numbers.to_vec();
        // After an error the connection ends at once: the daemon stops the motors that still jog.
        let renewing = without_signals(move || {
            while matches!(told.recv_timeout(RENEW), Err(RecvTimeoutError::Timeout)) {
                renew(&mut connection, &motors)?;
            }
            Ok(connection)
        });
        let renewing = renewing.map_err(|error| CallError::Interrupted {
            reason: format!("no thread can renew the jog ({error}), so pmacd stops it"),
        })?;
        let process = std::process::id();
        Ok(Self { numbers: numbers.to_vec(), process, tell: Some(tell), renewing: Some(renewing) })
    }

    /// Whether this process still renews the jog; false after the daemon has ended it or cannot be reached, and in a
    /// forked child.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.process == std::process::id()
            && self.renewing.as_ref().is_some_and(|renewing| !renewing.is_finished())
    }

    /// Stops the motors, and returns when the board has taken the stop.
    ///
    /// # Errors
    /// Why the daemon had ended the hold before (the motors were killed or aborted, or a loop has opened), or that the
    /// board did not take the stop; then the daemon goes on requesting the stop. [`CommandError::OtherProcess`] in a
    /// forked child, which stops nothing.
    pub fn stop(mut self) -> Result<Connection, CommandError> {
        self.end()
    }

    /// The words for `motor` after [`Self::stop`] failed by `error`: without `pmacd` nobody stops the motor. `None` if the
    /// error tells how the jog ended.
    #[must_use]
    pub fn may_be_moving(motor: u8, error: &CommandError) -> Option<String> {
        if matches!(error, CommandError::Refused(_) | CommandError::OtherProcess { .. }) {
            return None;
        }
        Some(format!(
            "motor {motor} may be moving: pmacd did not confirm the stop, and one that is started again does not stop it; use the \
             emergency stop, or #{motor}J/ once pmacd runs ({error})"
        ))
    }

    fn end(&mut self) -> Result<Connection, CommandError> {
        if self.process != std::process::id() {
            // The thread is in the parent: the child may not wait for it, nor touch anything that it may have locked.
            std::mem::forget((self.tell.take(), self.renewing.take()));
            return Err(CommandError::OtherProcess { process: self.process });
        }
        drop(self.tell.take());
        let ended = self.renewing.take().and_then(|renewing| renewing.join().ok());
        // If the hold has ended before, the daemon has also stopped the motors: a second stop could close the loop of a
        // killed motor.
        let mut connection =
            ended.unwrap_or_else(|| Err(CallError::Protocol("the hold is over".to_owned()).into()))?;
        connection.panel("jog-stop", &self.numbers)?;
        Ok(connection)
    }
}

/// Begins a thread in which no handler of the program's signals runs: it could hold up the renewal.
fn without_signals<R: Send + 'static>(run: impl FnOnce() -> R + Send + 'static) -> io::Result<JoinHandle<R>> {
    // The new thread inherits the mask.
    let before = SigSet::all().thread_swap_mask(SigmaskHow::SIG_SETMASK)?;
    let begun = thread::Builder::new().name("jog".to_owned()).spawn(run);
    before.thread_set_mask()?;
    begun
}

impl Drop for HeldJog {
    fn drop(&mut self) {
        if self.renewing.is_some() {
            // If it fails, the connection is closed and the daemon requests the stop.
            let _ = self.end();
        }
    }
}

#[cfg(test)]
mod tests {
    use nix::sys::signal::Signal;

    use super::*;

    #[test]
    fn no_signal_is_handled_in_the_thread_and_the_caller_handles_them_as_before() {
        let mask = || SigSet::thread_get_mask().unwrap();
        let before = mask();
        let inside = without_signals(mask).unwrap().join().unwrap();
        for signal in [Signal::SIGTERM, Signal::SIGALRM, Signal::SIGUSR1, Signal::SIGPROF] {
            assert!(inside.contains(signal), "{signal}");
        }
        assert_eq!(mask(), before);
    }
}
