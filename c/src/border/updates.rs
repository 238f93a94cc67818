//! Every update, and the texts of the board's programs.

use std::mem::MaybeUninit;
use std::ptr;

use super::{check_place, ended, fill, freed, given, made, milliseconds};
use crate::board::Board;
use crate::failure::Status;
use crate::snapshot::Snapshot;
use crate::streams::Messages;
use crate::types::{Error, Message};
use crate::updates::Updates;

/// Every servo update from now on, each once. In a forked child they begin anew.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_updates_open(
    board: Option<&Board>,
    updates: Option<&mut MaybeUninit<*mut Updates>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, updates, || Updates::new(given(board, "board")?))
}

/// Frees the updates. No thread may use them then.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_updates_free(updates: Option<Box<Updates>>) {
    freed(updates);
}

/// The next update; waits for it at most `timeout_ms`. It has servo data alone, and its moment tells the updates missing
/// before it. Without one, PMAC_TIMED_OUT if the data are live, else PMAC_STALE or PMAC_GONE; a later call goes on. If
/// several threads call this, each update goes to one of them.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_updates_next(
    updates: Option<&Updates>,
    timeout_ms: u32,
    update: Option<&mut MaybeUninit<*mut Snapshot>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let update = given(update, "update")?;
        update.write(ptr::null_mut());
        let Some(next) = given(updates, "updates")?.next(milliseconds(timeout_ms))? else {
            return Ok(Status::TimedOut);
        };
        update.write(Box::into_raw(Box::new(next)));
        Ok(Status::Ok)
    })
}

/// How many updates the daemon overwrote before this program took them (`lost`), and how many of the board's the daemon
/// did not read in time (`missed`), since these began. Exact.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_updates_counts(
    updates: Option<&Updates>,
    lost: Option<&mut MaybeUninit<u64>>,
    missed: Option<&mut MaybeUninit<u64>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        let counts = given(updates, "updates")?.counts()?;
        given(lost, "lost")?.write(counts.0);
        given(missed, "missed")?.write(counts.1);
        Ok(Status::Ok)
    })
}

/// The texts that the board's programs send from now on (`SEND`, `CMD`), for every reader each.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_messages_open(
    board: Option<&Board>,
    messages: Option<&mut MaybeUninit<*mut Messages>>,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    made(error, messages, || Messages::new(given(board, "board")?))
}

/// Frees the messages. No thread may use them then.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_messages_free(messages: Option<Box<Messages>>) {
    freed(messages);
}

/// The next text; PMAC_TIMED_OUT if none has come within `timeout_ms`. `size` is `sizeof(pmac_message)`.
#[unsafe(no_mangle)]
pub extern "C" fn pmac_messages_next(
    messages: Option<&Messages>,
    timeout_ms: u32,
    message: *mut Message,
    size: usize,
    error: Option<&mut MaybeUninit<Error>>,
) -> Status {
    ended(error, || {
        check_place(message, size)?;
        match given(messages, "messages")?.next(milliseconds(timeout_ms))? {
            Some(found) => fill(message, size, &found),
            None => Ok(Status::TimedOut),
        }
    })
}
