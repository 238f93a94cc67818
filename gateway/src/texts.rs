//! Texts that the board's programs send by themselves: `SEND"…"`, and what a `CMD"…"` is answered.
//!
//! One connection to `pmacd` hears them for all clients. Each client takes them one by one, when he looks for something and nothing
//! else is there to be fetched: so a text stands behind replies, and never in one.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use log::warn;
use pmac_dpram::client::{CommandError, Messages};
use pmac_dpram::language::deadlines;
use pmac_dpram::protocol::CallError;

use crate::board::Place;

/// Texts that wait for the clients. Of a client who does not fetch his in time the oldest are lost.
const KEPT_MAX: usize = 64;
/// How long until `pmacd` is asked again for the texts.
const AGAIN: Duration = Duration::from_secs(1);
/// How long the board's answer is believed that its texts have a mark.
const BELIEVED: Duration = Duration::from_secs(1);

/// The texts that were sent last, shared by all clients.
#[derive(Debug, Clone, Default)]
pub struct Texts(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    /// Each with its number; those that `pmacd` had to drop have numbers, too.
    texts: VecDeque<(u64, String)>,
    /// The number of the next one.
    end: u64,
}

impl Texts {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of the next text that will come.
    #[must_use]
    pub fn end(&self) -> u64 {
        self.kept().end
    }

    /// The first text from number `first` on, and its number.
    #[must_use]
    pub fn next(&self, first: u64) -> Option<(u64, String)> {
        self.kept().texts.iter().find(|(number, _)| *number >= first).cloned()
    }

    /// Keeps `text`, before which `lost` have been lost.
    fn keep(&self, text: &str, lost: u64) {
        let mut kept = self.kept();
        if kept.texts.len() >= KEPT_MAX {
            kept.texts.pop_front();
        }
        let number = kept.end.saturating_add(lost);
        // A CR would end the text, and what is behind it would be taken for a reply.
        kept.texts.push_back((number, text.replace(|character: char| character.is_ascii_control(), "")));
        kept.end = number.saturating_add(1);
    }

    /// Hears the texts of the board at `place`, for ever.
    pub fn hear(&self, place: &Place) {
        let mut mark = Mark::default();
        loop {
            // Whatever is wrong, the log has been told, or a client is told with his next line.
            if let Ok(mut messages) = place.connect().and_then(|connection| connection.messages()) {
                self.pass_on(&mut messages, place, &mut mark);
            }
            thread::sleep(AGAIN);
        }
    }

    /// Keeps what comes, until the connection ends.
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

/// Whether the board marks such texts, by I64=1. Nobody could tell one without a mark from a reply.
#[derive(Debug, Default)]
struct Mark {
    /// What the board has said last, and when.
    said: Option<(bool, Instant)>,
    /// The log has been told that texts do not reach the clients.
    is_told: bool,
}

impl Mark {
    fn is_set(&mut self, place: &Place) -> bool {
        if self.said.is_none_or(|(_, when)| when.elapsed() >= BELIEVED) {
            // While a program buffer is open, the question would enter it, and is refused: the last answer holds.
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

/// What the board says; `None` if it was not asked, or has not answered.
fn asked(place: &Place) -> Option<bool> {
    match place.connect().and_then(|mut connection| connection.question("I64", deadlines::PLAIN)) {
        // With "I64=" or "$" before it, as its I9 wants it.
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
