//! Notes that clients leave for whoever asks for the state of the board, as why a gateway has ended a connection of its
//! own.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::policy::Peer;

/// How many notes the daemon keeps.
const KEPT: usize = 4;
/// A user leaves one note in this time.
const EVERY: Duration = Duration::from_secs(1);

#[derive(Debug)]
struct Note {
    by: Peer,
    text: String,
    at: Instant,
}

/// The last notes.
#[derive(Debug, Default)]
pub struct Notes(VecDeque<Note>);

impl Notes {
    /// Keeps a note; `false` if the same user has just left another one.
    pub fn add(&mut self, by: Peer, text: String, now: Instant) -> bool {
        if self.0.iter().any(|note| note.by.uid == by.uid && now < note.at + EVERY) {
            return false;
        }
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(Note { by, text, at: now });
        true
    }

    /// The notes as sentences, the latest last.
    pub fn told(&self, now: Instant) -> Vec<String> {
        let told = |Note { by: Peer { uid, pid, .. }, text, at }: &Note| {
            format!("{} s ago, uid {uid} pid {pid}: {text}", now.duration_since(*at).as_secs())
        };
        self.0.iter().map(told).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::unistd::{Gid, Uid};

    #[test]
    fn a_few_notes_are_kept_and_no_user_floods_them() {
        let by = |uid| Peer { uid: Uid::from_raw(uid), gid: Gid::from_raw(9), pid: 7 };
        let began = Instant::now();
        let at = |seconds| began + Duration::from_secs(seconds);
        let mut notes = Notes::default();
        assert!(notes.add(by(1), "one".to_owned(), at(0)) && !notes.add(by(1), "two".to_owned(), at(0)));
        assert!(notes.add(by(2), "three".to_owned(), at(0)));
        assert_eq!(notes.told(at(5)), ["5 s ago, uid 1 pid 7: one", "5 s ago, uid 2 pid 7: three"]);
        for second in 1..5 {
            assert!(notes.add(by(1), second.to_string(), at(second)));
        }
        assert_eq!(notes.told(at(4))[0], "3 s ago, uid 1 pid 7: 1");
        assert_eq!(notes.told(at(4)).len(), 4);
    }
}
