//! Texts that the board's programs send: `SEND"…"`, and the answers to `CMD"…"`.
//!
//! One connection to `pmacd` receives them for all clients. A client gets the next text when it fetches and no reply
//! waits: so a text stands behind replies, never within a reply.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use log::warn;
use pmac_dpram::client::{CommandError, Messages};
use pmac_dpram::language::deadlines;
use pmac_dpram::protocol::CallError;

use crate::board::Place;

/// Texts kept for the clients. A client that fetches too slowly loses the oldest.
const KEPT_MAX: usize = 64;
/// How long the gateway waits before it connects to `pmacd` again.
const AGAIN: Duration = Duration::from_secs(1);
/// How long the gateway trusts the board's last answer about the mark (I64).
const BELIEVED: Duration = Duration::from_secs(1);

/// The last texts, shared by all clients.
#[derive(Debug, Clone, Default)]
pub struct Texts(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    /// Each text with its number; texts that `pmacd` dropped have numbers, too.
    texts: VecDeque<(u64, String)>,
    /// The next text's number.
    end: u64,
}

impl Texts {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of the next text to come.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.kept().end
    }

    /// The first kept text from number `first` on, with its number.
    #[must_use]
    pub fn next(&self, first: u64) -> Option<(u64, String)> {
        self.kept().texts.iter().find(|(number, _)| *number >= first).cloned()
    }

    /// Keeps `text`, after `lost` lost texts.
    fn keep(&self, text: &str, lost: u64) {
        let mut kept = self.kept();
        if kept.texts.len() >= KEPT_MAX {
            kept.texts.pop_front();
        }
        let number = kept.end.saturating_add(lost);
        // A CR would end the text, and the client would take the rest for a reply.
        kept.texts.push_back((number, text.replace(|character: char| character.is_ascii_control(), "")));
        kept.end = number.saturating_add(1);
    }

    /// Receives the texts of the board at `place`, for ever.
    pub fn hear(&self, place: &Place) {
        let mut mark = Mark::default();
        loop {
            // An error here is in the log already, or the client learns it with his next line.
            if let Ok(mut messages) = place.connect().and_then(|connection| connection.messages()) {
                self.pass_on(&mut messages, place, &mut mark);
            }
            thread::sleep(AGAIN);
        }
    }

    /// Keeps the texts until the connection ends.
    fn pass_on(&self, messages: &mut Messages, place: &Place, mark: &mut Mark) {
        while !messages.ended() {
            match messages.next_within(AGAIN) {
                Ok(Some(message)) if mark.is_set(place) => self.keep(&message.text, message.lost),
                Ok(_) => {}
                Err(_) => return,
            }
        }
    }
}

/// Whether the board marks its texts (I64=1). A client could not tell an unmarked text from a reply.
#[derive(Debug, Default)]
struct Mark {
    /// The board's last answer, and its time.
    said: Option<(bool, Instant)>,
    /// The log says already that texts do not reach the clients.
    is_told: bool,
}

impl Mark {
    fn is_set(&mut self, place: &Place) -> bool {
        if self.said.is_none_or(|(_, when)| when.elapsed() >= BELIEVED) {
            // While a program buffer is open, `pmacd` refuses the question, which would enter the buffer: the last
            // answer holds.
            if let Some(is_set) = asked(place) {
                self.said = Some((is_set, Instant::now()));
            }
        }
        let is_set = self.said.is_some_and(|(is_set, _)| is_set);
        if !is_set && !self.is_told {
            warn!("a program of the board sends a text, which clients get only where I64=1 marks it");
        }
        self.is_told = !is_set;
        is_set
    }
}

/// The board's answer; `None` if the gateway could not ask, or the board has not answered.
fn asked(place: &Place) -> Option<bool> {
    match place.connect().and_then(|mut connection| connection.question("I64", deadlines::PLAIN)) {
        // "I64=" or "$" may stand before the value, depending on I9.
        Ok(lines) => Some(lines.first()?.rsplit(['=', '$']).next()?.trim() == "1"),
        // Firmware before 1.16F knows no I64, and no mark.
        Err(CommandError::Refused(CallError::Board { .. })) => Some(false),
        Err(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_does_not_fetch_in_time_loses_the_oldest_and_can_count_them() {
        let texts = Texts::default();
        let first = texts.end();
        assert_eq!(texts.next(first), None);
        texts.keep("a\rb\u{6}", 0);
        texts.keep("c", 2);
        assert_eq!(texts.next(first), Some((0, "ab".to_owned())));
        assert_eq!(texts.next(1), Some((3, "c".to_owned())), "two are lost before it");
        assert_eq!((texts.next(4), texts.end()), (None, 4));
        for _ in 0..KEPT_MAX {
            texts.keep("d", 0);
        }
        assert_eq!(texts.next(first), Some((4, "d".to_owned())), "the oldest make room");
        assert_eq!(texts.kept().texts.len(), KEPT_MAX);
    }
}
