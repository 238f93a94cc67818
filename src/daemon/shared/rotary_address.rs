//! Follows the addressed coordinate system while the rotary buffers are open for text. The next program line enters the
//! rotary buffer of the addressed system (Software Reference p. 273), whoever has addressed it. So the daemon puts the
//! opener's address back before the opener's next line if another sender has changed the address.

use super::writer::Writer;
use crate::language::Meaning;

/// The daemon's step before it sends a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AddressFirst {
    /// The daemon asks the board which system it addresses.
    Ask,
    /// The daemon addresses this coordinate system again.
    PutBack(u32),
    /// The address is unknown: the daemon does not send the line.
    Unknown,
}

/// Follows the addresses of a board's lines from the line on that has opened the rotary buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RotaryAddress {
    /// The opener's coordinate system, by the board's answer.
    told: Option<u32>,
    /// The daemon has asked the board, and the board has not told.
    is_untold: bool,
    /// The client that has addressed another system since then.
    moved_by: Option<Writer>,
}

impl RotaryAddress {
    /// The step before `writer` sends `line` while the buffers of `opener` are open. `enters`: the line enters the
    /// buffers, and may.
    pub(super) fn before(
        &self,
        line: &Meaning,
        writer: Writer,
        opener: Writer,
        enters: bool,
    ) -> Option<AddressFirst> {
        if enters && self.moved_by.is_some_and(|by| !is_same(by, writer)) && !line.begins_with_system {
            return Some(self.told.map_or(AddressFirst::Unknown, AddressFirst::PutBack));
        }
        // A stop does not wait.
        let moves = !is_one(opener, writer) && line.addresses_system && !line.stops;
        let is_unasked = self.moved_by.is_none() && self.told.is_none() && !self.is_untold;
        (moves && is_unasked).then_some(AddressFirst::Ask)
    }

    /// `writer` sends `line` while the buffers of `opener` are open.
    pub(super) fn goes(&mut self, line: &Meaning, writer: Writer, opener: Writer) {
        if !line.addresses_system || writer == Writer::Stop && line.ends_with_system {
            return;
        }
        if is_one(opener, writer) {
            *self = Self::default();
            return;
        }
        if self.moved_by.is_some_and(|by| is_same(by, opener)) && !is_same(writer, opener) {
            // The daemon did not ask for an address that the user's other process set.
            self.told(None);
        }
        self.moved_by = Some(writer);
    }

    /// The board has told the addressed system, or has failed to.
    pub(super) fn told(&mut self, system: Option<u32>) {
        self.told = system;
        self.is_untold = system.is_none();
    }

    /// The daemon has addressed the opener's coordinate system again.
    pub(super) fn is_back(&mut self) {
        self.moved_by = None;
    }
}

/// Whether both writers mean the same address: the commands that one user sends by hand count as one writer's.
fn is_same(one: Writer, other: Writer) -> bool {
    match (one, other) {
        (Writer::Hand(one), Writer::Hand(other)) => one.uid == other.uid,
        _ => is_one(one, other),
    }
}

/// Whether both are one process, or one sequence.
fn is_one(one: Writer, other: Writer) -> bool {
    match (one, other) {
        (Writer::Hand(one) | Writer::IntoBuffer(one), Writer::Hand(other) | Writer::IntoBuffer(other)) => {
            one == other
        }
        (Writer::Sequence { number: one, .. }, Writer::Sequence { number: other, .. }) => one == other,
        _ => false,
    }
}

#[cfg(test)]
#[path = "rotary_address_tests.rs"]
mod tests;
