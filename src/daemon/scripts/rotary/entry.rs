//! The board opens its rotary buffers for all coordinate systems, and closes them for all: the streams share that. The
//! first stream opens them, the last stream closes them, and the others wait meanwhile.

use std::sync::{Arc, Mutex, PoisonError};

/// What the streams know of each other.
#[derive(Debug, Clone, Default)]
pub struct Entry(Arc<Mutex<Shared>>);

#[derive(Debug, Default)]
struct Shared {
    users: usize,
    /// A stream, the only user, opens or closes the rotary buffers at present.
    changes: bool,
    /// The board takes `OPEN ROT` alone.
    opens_text: bool,
}

/// How a stream comes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Enters {
    /// As the first stream, which opens the rotary buffers.
    First,
    /// Beside streams that have opened the rotary buffers.
    Beside,
    /// Not at all: a stream has opened the rotary buffers for text, and the set-up's lines would enter them.
    Text,
    /// Not yet: a stream opens or closes the rotary buffers.
    Later,
}

impl Entry {
    fn with<T>(&self, with: impl FnOnce(&mut Shared) -> T) -> T {
        with(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// A stream wants in.
    pub(super) fn enter(&self) -> Enters {
        self.with(|shared| {
            if shared.users == 0 {
                *shared = Shared { users: 1, changes: true, opens_text: false };
                return Enters::First;
            }
            match (shared.changes, shared.opens_text) {
                (true, _) => Enters::Later,
                (false, true) => Enters::Text,
                (false, false) => {
                    shared.users += 1;
                    Enters::Beside
                }
            }
        })
    }

    /// The first stream has opened the rotary buffers.
    pub(super) fn opened(&self, as_text: bool) {
        self.with(|shared| (shared.changes, shared.opens_text) = (false, as_text));
    }

    /// A stream ends. Returns whether that is the last stream, which then closes the rotary buffers and calls
    /// [`Self::closed`].
    pub(super) fn leave(&self) -> bool {
        self.with(|shared| {
            shared.changes |= shared.users == 1;
            shared.users -= usize::from(!shared.changes);
            shared.changes
        })
    }

    /// The last stream has closed the rotary buffers.
    pub(super) fn closed(&self) {
        self.with(|shared| *shared = Shared::default());
    }
}
