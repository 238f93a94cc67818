//! Background variables: registers that PMAC copies for watches, and registers that it writes. Besides, the I-, M-, P-
//! and Q-variables, which go by command line.

use std::os::fd::{AsFd, BorrowedFd};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::{
    CommandError, Connection, DAEMON_TIMEOUT, Link, MARGIN, after, check_process, fault, milliseconds,
    not_taken, read_reply, when_used,
};
use crate::map::VariableName;
use crate::protocol::board::{Done, VariableRecord, WatchReply};
use crate::protocol::message::encode;
use crate::protocol::parameters::to_map;
use crate::protocol::{BOARD, Call, CallError, calls};

/// The most variables in one line: every port has room for their replies.
const AT_ONCE: usize = 8;

/// The I-, M-, P- or Q-variable that `text` names, as `P1`; `None` for any other text.
#[must_use]
pub fn board_variable(text: &str) -> Option<String> {
    let name = text.to_ascii_uppercase();
    let digits = name.strip_prefix(['I', 'M', 'P', 'Q'])?;
    let is_number = !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
    is_number.then_some(name)
}

impl Connection {
    /// The board's answer for each of the variables `names` ([`board_variable`]). A Q-variable is that of the addressed
    /// coordinate system.
    ///
    /// # Errors
    /// As [`Connection::send`], with [`CallError::Refused`] inside if the board answers with more or fewer values.
    pub fn ask_variables(
        &mut self,
        names: &[String],
        timeout: Duration,
    ) -> Result<Vec<String>, CommandError> {
        let mut answers = Vec::new();
        for names in names.chunks(AT_ONCE) {
            let line = names.join(" ");
            let reply = self.question(&line, timeout)?;
            if reply.len() != names.len() {
                let reason = format!("{line}: the board answers {}", reply.join(" "));
                return Err(CallError::Refused { reason }.into());
            }
            answers.extend(reply.into_iter().map(|text| text.trim().to_owned()));
        }
        Ok(answers)
    }

    /// Turns the connection into a watch on registers and function blocks. PMAC copies them in the background until the
    /// caller drops the watch. Returns when the board has the table with them.
    ///
    /// # Errors
    /// [`CommandError`], with [`CallError::Refused`] inside if no entry is left, or I55 is not 1.
    pub fn watch_variables(mut self, names: &[VariableName]) -> Result<VariableWatch, CommandError> {
        let registers = names.iter().map(ToString::to_string).collect();
        let parameters = to_map(&calls::WatchVariables { registers });
        let mut call = Call::new(format!("{BOARD}.WatchVariables"), parameters);
        call.more = Some(true);
        let path = self.path.clone();
        let mut link = self.take_link()?;
        let WatchReply { table, .. } = when_used(|| {
            let deadline = Instant::now() + DAEMON_TIMEOUT;
            link.call(&encode(&call), deadline).map_err(|error| not_taken(&path, error))?;
            read_reply(link.next_reply(deadline).map_err(|error| fault(&path, error))?)
        })?;
        Ok(VariableWatch { path, link, table })
    }

    /// Has PMAC write registers in the background, in this order, and waits until PMAC has written them.
    ///
    /// # Errors
    /// [`CommandError`], with [`CallError::Refused`] inside, and nothing written, for a register that PMAC cannot
    /// write.
    pub fn write_variables(
        &mut self,
        records: &[VariableRecord],
        timeout: Duration,
    ) -> Result<(), CommandError> {
        let parameters =
            calls::WriteVariables { records: records.to_vec(), timeout_ms: Some(milliseconds(timeout)) };
        let Done {} = self.call_used("WriteVariables", &parameters, timeout.saturating_add(MARGIN))?;
        Ok(())
    }
}

/// Registers that PMAC copies as long as this value exists.
#[derive(Debug)]
pub struct VariableWatch {
    path: PathBuf,
    link: Link,
    table: u32,
}

impl VariableWatch {
    /// The number of the first table that has all the registers; see [`crate::client::VariableTable::number`].
    #[must_use]
    pub const fn table(&self) -> u32 {
        self.table
    }

    /// Whether the daemon still holds the watch. Does not wait; to wait, poll the descriptor, which becomes readable at
    /// the watch's end.
    ///
    /// # Errors
    /// [`CommandError`] if the daemon has ended the watch, or is gone.
    pub fn check(&mut self) -> Result<(), CommandError> {
        check_process(&self.link)?;
        let mut descriptors = [PollFd::new(self.as_fd(), PollFlags::POLLIN)];
        if !poll(&mut descriptors, PollTimeout::ZERO).is_ok_and(|ready| ready > 0) {
            return Ok(());
        }
        match self.link.next_reply(after(DAEMON_TIMEOUT)) {
            Err(source) => Err(CommandError::StreamEnded { path: self.path.clone(), source }),
            // The only reply has come already; another reply can only be the end.
            Ok(reply) => match reply.error() {
                Some(error) => Err(error.into()),
                None => Err(CallError::Protocol("a second reply to a watch".to_owned()).into()),
            },
        }
    }
}

impl AsFd for VariableWatch {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.link.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::board_variable;

    #[test]
    fn variables_go_by_their_letter_and_number() {
        for (text, name) in [
            ("p1", Some("P1")),
            ("I122", Some("I122")),
            ("M8191", Some("M8191")),
            ("Q0", Some("Q0")),
            ("P99999", Some("P99999")),
        ] {
            assert_eq!(board_variable(text).as_deref(), name, "{text}");
        }
        for text in ["P", "L:$1005", "PLCC:7", "1.actual_position", "P1=5", "X1", "M1->X:$10", "P-1"] {
            assert_eq!(board_variable(text), None, "{text}");
        }
    }
}
