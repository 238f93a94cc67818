//! The values of the site's own words.

use super::value::{Value, bits, value};
use crate::format::Float48Layout;
use crate::map::user_word::UserWord;

/// The values of `word`, whose 16-bit words are `words`.
#[must_use]
pub fn values(word: &UserWord, words: &[u16]) -> Vec<Value> {
    let space = word.location.space;
    let one = |words: &[u16]| match word.bits {
        None => value(space, words, Float48Layout::Register),
        Some(field) => bits(field, word.signed, words),
    };
    words.chunks_exact(space.words()).filter_map(one).collect()
}
