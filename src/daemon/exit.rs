//! The daemon's exit statuses, from `sysexits.h`. A service manager acts on them.
//!
//! After some of them a restart cannot help; the unit lists these (`RestartPreventExitStatus=64 77 78`).

use std::error::Error;
use std::io;

use super::service::privilege::PrivilegeError;
use super::socket::listener::ListenError;
use super::socket::options::ServeError;
use crate::device::refusal::{OpenError, Why};
use crate::segment::SegmentError;

/// The command line is wrong. The daemon has done nothing.
pub const USAGE: u8 = 64;
/// The board, its name or its socket is missing, or another daemon has it. A restart may help.
pub const UNAVAILABLE: u8 = 69;
/// A defect in the daemon.
pub const SOFTWARE: u8 = 70;
/// The system gave no memory, descriptor or thread.
pub const SYSTEM: u8 = 71;
/// A motor whose jog was held may still move: the board did not take the stop before the daemon ended.
pub const MAY_MOVE: u8 = 75;
/// A right is missing.
pub const NO_PERMISSION: u8 = 77;
/// The configuration is wrong.
pub const CONFIGURATION: u8 = 78;

/// Why the daemon ends, and with which status.
#[derive(Debug, thiserror::Error)]
#[error("{reason}")]
pub struct Failure {
    /// One of this module's statuses.
    pub status: u8,
    /// The fault, its place and the remedy.
    pub reason: String,
}

impl Failure {
    /// A failure with a status of this module.
    #[must_use]
    pub fn new(status: u8, reason: impl ToString) -> Self {
        Self { status, reason: reason.to_string() }
    }

    /// The system refused `what` that every daemon needs.
    #[must_use]
    pub fn system(what: &str, error: impl std::fmt::Display) -> Self {
        Self::new(SYSTEM, format!("{what}: {error}"))
    }

    /// The daemon cannot open the board: a right or the board is missing.
    #[must_use]
    pub fn board(error: &(dyn Error + 'static)) -> Self {
        Self::new(if lacks_right(error) { NO_PERMISSION } else { UNAVAILABLE }, error)
    }
}

/// Whether `error` comes from a missing right.
fn lacks_right(error: &(dyn Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        if error.downcast_ref::<io::Error>().is_some_and(|io| io.kind() == io::ErrorKind::PermissionDenied) {
            return true;
        }
        if let Some(OpenError { why, .. }) = error.downcast_ref::<OpenError>() {
            return match why {
                Why::Permission { .. } | Why::RawIo(_) | Why::Lockdown(..) | Why::DeviceControl(_) => true,
                Why::Io { source, .. } => source.kind() == io::ErrorKind::PermissionDenied,
                _ => false,
            };
        }
        next = error.source();
    }
    false
}

impl From<SegmentError> for Failure {
    fn from(error: SegmentError) -> Self {
        let status = match &error {
            // The other owner of the name may end.
            SegmentError::InUse { .. }
            | SegmentError::ForeignOwner { .. }
            | SegmentError::Occupied { .. } => UNAVAILABLE,
            SegmentError::Spec { .. } => SOFTWARE,
            other if lacks_right(other) => NO_PERMISSION,
            _ => SYSTEM,
        };
        Self::new(status, error)
    }
}

impl From<ListenError> for Failure {
    fn from(error: ListenError) -> Self {
        let status = match &error {
            ListenError::Served(_) => UNAVAILABLE,
            ListenError::Foreign(_) => CONFIGURATION,
            ListenError::Group { source, .. } if source.is_of_settings() => CONFIGURATION,
            other if lacks_right(other) => NO_PERMISSION,
            // The directory of the socket is missing, or is no directory.
            ListenError::Io { source, .. } if is_missing(source) => UNAVAILABLE,
            _ => SYSTEM,
        };
        Self::new(status, error)
    }
}

fn is_missing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

impl From<ServeError> for Failure {
    fn from(error: ServeError) -> Self {
        let is_of_settings = matches!(&error, ServeError::Policy(error) if error.is_of_settings());
        Self::new(if is_of_settings { CONFIGURATION } else { SYSTEM }, error)
    }
}

impl From<PrivilegeError> for Failure {
    fn from(error: PrivilegeError) -> Self {
        let no_such_user = matches!(error, PrivilegeError::NoSuchUser(_));
        Self::new(if no_such_user { CONFIGURATION } else { NO_PERMISSION }, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::socket::policy::PolicyError;

    #[derive(Debug, thiserror::Error)]
    #[error("/dev/uio0")]
    struct Wrapped(#[source] io::Error);

    #[test]
    fn a_missing_right_is_told_from_a_missing_board_however_deep_it_lies() {
        let status = |kind: io::ErrorKind| Failure::board(&Wrapped(kind.into())).status;
        assert_eq!(status(io::ErrorKind::PermissionDenied), NO_PERMISSION);
        assert_eq!(status(io::ErrorKind::NotFound), UNAVAILABLE);
        let window = |why: Why| Failure::board(&OpenError::new("mem:0xD4000", why)).status;
        assert_eq!(window(Why::RawIo("/dev/mem".into())), NO_PERMISSION);
        assert_eq!(window(Why::Unsuitable("too short".to_owned())), UNAVAILABLE);
    }

    #[test]
    fn what_starting_again_cannot_mend_has_the_numbers_the_unit_names() {
        let foreign = SegmentError::ForeignOwner { path: "/dev/shm/pmac0".into(), uid: 7 };
        assert_eq!(Failure::from(foreign).status, 69);
        let occupied = SegmentError::Occupied { path: "x".into(), why: "y" };
        assert_eq!(Failure::from(occupied).status, 69);
        assert_eq!(Failure::from(SegmentError::InUse { path: "x".into(), pid: None }).status, 69);
        assert_eq!(Failure::from(ListenError::Foreign("x".into())).status, 78);
        assert_eq!(Failure::from(ListenError::Served("x".into())).status, 69);
        let unknown = PolicyError::NoSuchGroup("x".to_owned());
        assert_eq!(Failure::from(ServeError::Policy(unknown)).status, 78);
        // A name service may recover.
        let failed = || PolicyError::Lookup { group: "x".to_owned(), source: nix::Error::EIO };
        assert_eq!(Failure::from(ServeError::Policy(failed())).status, 71);
        assert_eq!(Failure::from(ListenError::Group { path: "x".into(), source: failed() }).status, 71);
        let denied =
            |kind: io::ErrorKind| ListenError::Io { path: "x".into(), action: "y", source: kind.into() };
        assert_eq!(Failure::from(denied(io::ErrorKind::PermissionDenied)).status, 77);
        assert_eq!(Failure::from(denied(io::ErrorKind::NotFound)).status, 69);
        assert_eq!(Failure::from(denied(io::ErrorKind::OutOfMemory)).status, 71);
    }
}
