//! Which coordinate system is addressed while the rotary buffers are open for text: the next program line enters the rotary buffer of
//! that one (Software Reference p. 273), whoever has addressed it. So what somebody else addresses meanwhile is put back before the next
//! line of who opened the buffers.

use super::writer::Writer;
use crate::language::Meaning;

/// The step before a line goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AddressFirst {
    /// The board is asked what is addressed.
    Ask,
    /// This coordinate system is addressed again.
    PutBack(u32),
    /// The address is unknown: the daemon does not send the line.
    Unknown,
}

/// Follows the addresses of a board's lines from the line on that has opened the rotary buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RotaryAddress {
    /// The opener's coordinate system, as the board said.
    told: Option<u32>,
    /// The board was asked, and did not tell.
    is_untold: bool,
    /// The client that has addressed another system since.
    moved_by: Option<Writer>,
}

impl RotaryAddress {
    /// What has to be done before `writer` sends `line`, where `opener` has opened the buffers; `enters`: it enters them, and may.
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

    /// `writer` sends `line`, where `opener` has opened the buffers.
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

    /// The board tells what is addressed, or does not.
    pub(super) fn told(&mut self, system: Option<u32>) {
        self.told = system;
        self.is_untold = system.is_none();
    }

    /// The opener's coordinate system is addressed again.
    pub(super) fn is_back(&mut self) {
        self.moved_by = None;
    }
}

/// Whether what one of the two has addressed is what the other one means: by hand, one user's commands are one.
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
