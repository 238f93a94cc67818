//! Messages out of a byte stream: each ends with one NUL.

/// The room that an empty inbox keeps, in bytes.
const KEPT: usize = 16 * 1024;

/// A message is longer than its receiver takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a message is longer than {limit} bytes")]
pub struct TooLong {
    /// The longest message that the receiver takes, in bytes.
    pub limit: usize,
}

/// Cuts received bytes into messages.
///
/// Holds at most one message of the limit plus the last chunk pushed, provided its owner asks [`Inbox::is_full`]
/// before it reads more.
#[derive(Debug)]
pub struct Inbox {
    bytes: Vec<u8>,
    /// Everything before this index has been taken out.
    start: usize,
    /// No NUL lies between `start` and this index.
    scanned: usize,
    limit: usize,
}

impl Inbox {
    /// An empty inbox for messages of at most `limit` bytes.
    #[must_use]
    pub fn new(limit: usize) -> Self {
        Self { bytes: Vec::new(), start: 0, scanned: 0, limit }
    }

    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        // Moving the rest to the front only here keeps a flood of tiny messages linear in its length.
        self.bytes.drain(..self.start);
        self.scanned -= self.start;
        self.start = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// The next whole message without its NUL; `None` until its end has come.
    ///
    /// # Errors
    /// [`TooLong`] when the message at the front has outgrown the limit; the stream cannot be followed further.
    pub fn next_message(&mut self) -> Result<Option<Vec<u8>>, TooLong> {
        let found = self.bytes[self.scanned..].iter().position(|&byte| byte == 0);
        self.scanned = found.map_or(self.bytes.len(), |at| self.scanned + at);
        if self.scanned - self.start > self.limit {
            return Err(TooLong { limit: self.limit });
        }
        if found.is_none() {
            return Ok(None);
        }
        let message = self.bytes[self.start..self.scanned].to_vec();
        self.scanned += 1;
        self.start = self.scanned;
        if self.is_empty() && self.bytes.capacity() > KEPT {
            // The inbox gives back the memory of a long message.
            *self = Self::new(self.limit);
        }
        Ok(Some(message))
    }

    /// The bytes of the next messages, whole or not.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        &self.bytes[self.start..]
    }

    /// Whether the owner should take out messages before it reads more.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.bytes.len() - self.start > self.limit
    }

    /// Whether the inbox holds no part of a message.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.len() == self.start
    }

    /// Whether the inbox holds a part of a message without its end.
    #[must_use]
    pub fn is_half_sent(&self) -> bool {
        !self.is_empty() && !self.bytes[self.scanned..].contains(&0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_cutting_of_the_stream_gives_the_same_messages(
            messages in proptest::collection::vec(proptest::collection::vec(1u8.., 0..40), 0..10),
            cut in 1usize..17,
        ) {
            let stream: Vec<u8> = messages.iter().flat_map(|m| m.iter().copied().chain([0])).collect();
            let mut inbox = Inbox::new(40);
            let mut found = Vec::new();
            for chunk in stream.chunks(cut) {
                inbox.push(chunk);
                while let Some(message) = inbox.next_message().unwrap() {
                    found.push(message);
                }
            }
            prop_assert_eq!(found, messages);
            prop_assert!(inbox.is_empty());
        }
    }

    #[test]
    fn a_message_may_fill_the_limit_and_no_more() {
        let mut inbox = Inbox::new(4);
        inbox.push(b"abcd");
        assert_eq!(inbox.next_message(), Ok(None));
        assert!(!inbox.is_full() && inbox.is_half_sent());
        inbox.push(b"\0abcde");
        assert!(inbox.is_full());
        assert_eq!(inbox.next_message(), Ok(Some(b"abcd".to_vec())));
        assert_eq!(inbox.next_message(), Err(TooLong { limit: 4 }));
        let mut inbox = Inbox::new(4);
        inbox.push(b"abcde\0");
        assert_eq!(inbox.next_message(), Err(TooLong { limit: 4 }));
    }
}
