//! How calls fail, in the terms of PComm32: a number for `PmacGetError`, a sentence for `PmacGetErrorStrA`, bits for the
//! functions whose names have Ex.

use std::cell::RefCell;
use std::sync::{Mutex, PoisonError};

use pmac_dpram::client::{ClientError, CommandError};
use pmac_dpram::protocol::CallError;

use crate::border::say_once;
use crate::config::DEVICES;

/// The line was taken, and the reply is whole.
pub(crate) const END: u32 = 0x8000_0000;
const TIMED_OUT: u32 = 0xC000_0000;
const ERROR: u32 = 0xE000_0000;
const FAIL: u32 = 0xF000_0000;
/// The bits of the count.
pub(crate) const CHARACTERS: u32 = 0x0FFF_FFFF;

/// The numbers of the board's own errors that other refusals take, too (Software Reference p. 22).
const NOT_NOW: u16 = 1;
const NO_RIGHT: u16 = 2;
const NOT_KNOWN: u16 = 3;
const ILLEGAL: u16 = 4;

/// The kind of a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The board or the daemon refused, with the number of `ERRnnn`.
    Refused(u16),
    /// The board or the daemon did not answer: it may have carried out the line.
    Uncertain,
    /// No daemon answers for the device.
    Gone,
    /// A wrong argument, or a device that is not open.
    Argument,
    /// This library has no such function.
    Lacking,
}

/// A failure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) kind: Kind,
    pub(crate) why: String,
    /// The board's lines before the failure.
    pub(crate) lines: Vec<String>,
}

impl Fault {
    pub(crate) fn argument(why: impl Into<String>) -> Self {
        Self { kind: Kind::Argument, why: why.into(), lines: Vec::new() }
    }

    pub(crate) fn refused(why: impl Into<String>) -> Self {
        Self { kind: Kind::Refused(NOT_NOW), why: why.into(), lines: Vec::new() }
    }

    /// The same failure after `taken` of `all` lines or other `parts`: they are not told as not done.
    pub(crate) fn after(mut self, taken: usize, all: usize, parts: &str) -> Self {
        self.why += &format!("; {taken} of {all} {parts} succeeded");
        if taken > 0 && matches!(self.kind, Kind::Gone | Kind::Argument) {
            self.kind = Kind::Uncertain;
        }
        self
    }

    /// This failure, and that of a later line.
    pub(crate) fn and(mut self, line: &str, later: &Self) -> Self {
        self.why += &format!("; {line}: {}", later.why);
        if later.kind == Kind::Uncertain {
            self.kind = Kind::Uncertain;
        }
        self
    }

    /// The number for `PmacGetError`: the board's for its own errors, negative for all others.
    pub(crate) fn number(&self) -> i32 {
        match self.kind {
            Kind::Refused(number) => number.into(),
            Kind::Uncertain => -1,
            Kind::Gone => -2,
            Kind::Argument => -3,
            Kind::Lacking => -4,
        }
    }

    /// The bits of the functions with Ex.
    pub(crate) fn bits(&self) -> u32 {
        match self.kind {
            Kind::Refused(_) => ERROR,
            Kind::Uncertain => TIMED_OUT,
            Kind::Gone | Kind::Argument | Kind::Lacking => FAIL,
        }
    }

    /// The reply in the program's buffer. Many programs take an empty one for success.
    pub(crate) fn reply(&self) -> String {
        let last = match self.kind {
            Kind::Refused(number) => format!("ERR{number:03}"),
            Kind::Uncertain => "TIMEOUT".to_owned(),
            Kind::Gone | Kind::Argument | Kind::Lacking => "FAIL".to_owned(),
        };
        self.lines.iter().chain([&last]).fold(String::new(), |text, line| text + line + "\r")
    }
}

impl From<CommandError> for Fault {
    fn from(error: CommandError) -> Self {
        let why = error.to_string();
        let kind = match &error {
            CommandError::Refused(CallError::Board { code, .. }) => Kind::Refused(*code),
            error if error.is_uncertain() => Kind::Uncertain,
            CommandError::Refused(CallError::NotPermitted { .. }) => Kind::Refused(NO_RIGHT),
            CommandError::Refused(CallError::InvalidLine { .. }) => Kind::Refused(ILLEGAL),
            CommandError::Refused(
                CallError::OutOfRange
                | CallError::InvalidParameter { .. }
                | CallError::InterfaceNotFound { .. }
                | CallError::MethodNotFound { .. },
            ) => Kind::Refused(NOT_KNOWN),
            CommandError::Refused(_) => Kind::Refused(NOT_NOW),
            _ => Kind::Gone,
        };
        let lines = match error {
            CommandError::Refused(mut error) => error.take_lines(),
            _ => Vec::new(),
        };
        Self { kind, why, lines }
    }
}

impl From<ClientError> for Fault {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Socket(error) => error.into(),
            error => Self { kind: Kind::Gone, why: error.to_string(), lines: Vec::new() },
        }
    }
}

thread_local! {
    /// The outcome of this thread's last call for each device.
    static LAST: RefCell<Outcomes> = const { RefCell::new([const { None }; DEVICES]) };
}

/// At `exit()` the main thread's own values are gone before the program's last functions run: those keep theirs here.
static LAST_AT_EXIT: Mutex<Outcomes> = Mutex::new([const { None }; DEVICES]);

/// The outcome for each device.
type Outcomes = [Option<Fault>; DEVICES];

fn with_last<T>(work: impl Fn(&mut Outcomes) -> T) -> T {
    LAST.try_with(|last| work(&mut last.borrow_mut()))
        .unwrap_or_else(|_| work(&mut LAST_AT_EXIT.lock().unwrap_or_else(PoisonError::into_inner)))
}

/// Keeps the outcome of a call of this thread.
pub(crate) fn keep(device: u32, fault: Option<&Fault>) {
    with_last(|last| {
        if let Some(last) = last.get_mut(device as usize) {
            *last = fault.cloned();
        }
    });
}

/// Why this thread's last call for the device failed; `None`: it did not.
pub(crate) fn last(device: u32) -> Option<Fault> {
    match with_last(|last| last.get(device as usize).cloned()) {
        Some(last) => last,
        None => Some(Fault::argument(format!("device {device}: there are 0 to {}", DEVICES - 1))),
    }
}

/// Says once that this library lacks the function `name`, and keeps that as the outcome of the call.
pub(crate) fn lacks(device: Option<u32>, name: &'static str) {
    let why = format!("{name} is not there on Linux; docs/pcomm32.md says why");
    say_once(name, &why);
    if let Some(device) = device {
        keep(device, Some(&Fault { kind: Kind::Lacking, why, lines: Vec::new() }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_an_unknown_outcome_and_a_daemon_that_is_gone_differ_in_every_form() {
        let board = CallError::Board { code: 3, meaning: "unknown".to_owned(), lines: vec!["7".to_owned()] };
        let permitted = CallError::NotPermitted { role_needed: "engineer".to_owned() };
        let late = CallError::TimedOut { lines: Vec::new() };
        let away = CommandError::Connect { path: "x".into(), source: std::io::ErrorKind::NotFound.into() };
        for (error, number, bits, reply) in [
            (board.into(), 3, 0xE000_0000, "7\rERR003\r"),
            (permitted.into(), 2, 0xE000_0000, "ERR002\r"),
            (late.into(), -1, 0xC000_0000, "TIMEOUT\r"),
            (away, -2, 0xF000_0000, "FAIL\r"),
        ] {
            let fault = Fault::from(error);
            assert_eq!((fault.number(), fault.bits(), fault.reply().as_str()), (number, bits, reply));
            assert!(!fault.why.is_empty());
        }
    }

    #[test]
    fn a_daemon_that_goes_between_two_lines_leaves_an_unknown_outcome() {
        let gone = || Fault { kind: Kind::Gone, why: "gone".to_owned(), lines: Vec::new() };
        assert_eq!(gone().after(0, 2, "lines").kind, Kind::Gone);
        let fault = gone().after(1, 2, "lines");
        assert_eq!((fault.kind, fault.why.as_str()), (Kind::Uncertain, "gone; 1 of 2 lines succeeded"));
        assert_eq!(Fault::refused("no").after(1, 2, "lines").kind, Kind::Refused(NOT_NOW));
    }

    #[test]
    fn each_device_keeps_its_last_outcome_and_others_have_none() {
        keep(3, Some(&Fault::argument("x")));
        assert!(last(3).is_some() && last(4).is_none());
        keep(3, None);
        assert!(last(3).is_none());
        assert_eq!(last(8).map(|fault| fault.number()), Some(-3));
        keep(99, Some(&Fault::argument("x")));
    }
}
