//! The part of the DPRAM that holds tables and buffers of the host's choice, and the start words that name places in it.

use crate::map::{Family, HostOffset};

/// The place of the table with this start word; `None` outside the user area.
#[must_use]
pub fn place(family: &Family, start: u16) -> Option<HostOffset> {
    family.start.offset(start).filter(|&offset| family.user_area.contains(offset))
}

/// Whether `words` 16-bit words from `first` on fit into the DPRAM.
#[must_use]
pub fn has_room(family: &Family, first: HostOffset, words: usize) -> bool {
    first.plus_words(words).bytes() <= family.length
}

/// The first and the last start word, for a message: `$D200-$DFFF`.
#[must_use]
pub fn bounds(family: &Family) -> String {
    let first = family.start.start_word(family.user_area.start);
    let end = family.start.start_word(family.user_area.end);
    format!("${first:04X}-${:04X}", end.wrapping_sub(1))
}
