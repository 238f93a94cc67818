//! Reads an image of the DPRAM through the daemon, a few words at a time, without command lines and responses.

use crate::cli::context::Failure;
use crate::client::Connection;
use crate::map::{AsciiPort, HostOffset};
use crate::protocol::READ_MAX;

/// Pieces to read before another client gets a turn.
const PIECES_A_STEP: usize = 8;

/// An image under way.
pub struct ImageReading {
    port: &'static AsciiPort,
    words: Vec<u16>,
    next: usize,
    t_ns: Option<u64>,
}

impl ImageReading {
    /// Of a DPRAM of `bytes`; `port` has the places of command lines and responses.
    pub fn new(port: &'static AsciiPort, bytes: u32) -> Self {
        Self { port, words: vec![0; bytes as usize / 2], next: 0, t_ns: None }
    }

    /// Reads some pieces; with the last piece, returns the time of the first word and all words.
    pub fn step(&mut self, connection: &mut Connection) -> Result<Option<(u64, Vec<u16>)>, Failure> {
        for _ in 0..PIECES_A_STEP {
            let Some((first, count)) = self.piece() else {
                return Ok(Some((self.t_ns.unwrap_or_default(), std::mem::take(&mut self.words))));
            };
            let (t_ns, words) = connection.read(HostOffset::new(0).plus_words(first), count)?;
            self.words[first..first + count].copy_from_slice(&words);
            self.t_ns.get_or_insert(t_ns);
            self.next = first + count;
        }
        Ok(None)
    }

    /// The next words to read: the first, and how many.
    fn piece(&self) -> Option<(usize, usize)> {
        let is_text = |word: &usize| self.port.has_text_in(HostOffset::new(0).plus_words(*word), 1);
        let first = (self.next..self.words.len()).find(|word| !is_text(word))?;
        let count = (first..self.words.len()).take(READ_MAX).take_while(|word| !is_text(word)).count();
        Some((first, count))
    }
}
