//! The site's own words, which its PLCs and motion programs write whenever they like.
//!
//! No handshake says when the words are whole. The reader takes words under a guard only if the guard is even, and
//! equal before and after them. Without a guard it reads a value of several words twice and takes the value only if
//! both readings are equal: two halves of different values never make a third.

use crate::device::{Bus, BusError};
use crate::map::HostOffset;
use crate::map::user_word::UserWord;

/// How often one poll reads the words if the board writes them meanwhile.
const TRIES: usize = 4;
/// Words of the longest value.
const LONGEST_VALUE: usize = 4;

/// Words that are whole together.
struct Group {
    guard: Option<HostOffset>,
    /// Each word's number and its place in the image.
    members: Vec<(usize, usize)>,
}

/// Reads the words.
pub struct UserWordsReader {
    words: Box<[UserWord]>,
    groups: Box<[Group]>,
    image: Box<[u16]>,
}

impl UserWordsReader {
    /// A reader of `words`.
    #[must_use]
    pub fn new(words: &[UserWord]) -> Self {
        let mut groups: Vec<Group> = Vec::new();
        let mut at = 0;
        for (index, word) in words.iter().enumerate() {
            let guarded = groups.iter_mut().find(|group| word.guard.is_some() && group.guard == word.guard);
            match guarded {
                Some(group) => group.members.push((index, at)),
                None => groups.push(Group { guard: word.guard, members: vec![(index, at)] }),
            }
            at += word.words();
        }
        Self { words: words.into(), groups: groups.into(), image: vec![0; at].into() }
    }

    /// The words' names and places.
    #[must_use]
    pub fn words(&self) -> &[UserWord] {
        &self.words
    }

    /// The words as the reader read them last.
    #[must_use]
    pub fn image(&self) -> &[u16] {
        &self.image
    }

    /// Reads all words; returns which are whole, bit 0 for the first.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus) -> Result<u64, BusError> {
        let Self { words, groups, image } = self;
        let mut whole = 0;
        for group in groups {
            for _ in 0..TRIES {
                if group.read(bus, words, image)? {
                    whole |= group.members.iter().fold(0, |mask, (index, _)| mask | 1 << index);
                    break;
                }
            }
        }
        Ok(whole)
    }
}

impl Group {
    /// Reads the group once; returns whether it is whole.
    fn read(&self, bus: &mut impl Bus, words: &[UserWord], image: &mut [u16]) -> Result<bool, BusError> {
        let before = self.guard.map(|guard| bus.read16(guard)).transpose()?;
        if before.is_some_and(|guard| !guard.is_multiple_of(2)) {
            return Ok(false);
        }
        bus.order_reads();
        for (index, at) in &self.members {
            let Some(word) = words.get(*index) else { continue };
            let Some(image) = image.get_mut(*at..at + word.words()) else { continue };
            if !read_values(bus, word, image)? {
                return Ok(false);
            }
        }
        bus.order_reads();
        Ok(before == self.guard.map(|guard| bus.read16(guard)).transpose()?)
    }
}

/// Reads the values of `word`; returns whether each value is whole.
fn read_values(bus: &mut impl Bus, word: &UserWord, image: &mut [u16]) -> Result<bool, BusError> {
    let length = word.location.space.words();
    for (index, value) in image.chunks_exact_mut(length).enumerate() {
        bus.read_block(word.place(index), value)?;
        if length > 1 && word.guard.is_none() {
            let mut again = [0; LONGEST_VALUE];
            bus.order_reads();
            bus.read_block(word.place(index), &mut again[..length])?;
            if again[..length] != *value {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::function::cost_tests::{Rig, documented};
    use crate::map::{Space, TypedAddress};

    fn word(space: Space, offset: u32, count: usize, guard: Option<u32>) -> UserWord {
        UserWord {
            name: "word".into(),
            unit: "".into(),
            location: TypedAddress { space, offset: HostOffset::new(offset) },
            bits: None,
            signed: false,
            count,
            guard: guard.map(HostOffset::new),
        }
    }

    #[test]
    fn words_cost_what_the_table_says() {
        let guarded = [word(Space::Dp, 0x2840, 3, Some(0x283C)), word(Space::X, 0x2852, 2, Some(0x283C))];
        let plain = [word(Space::Dp, 0x2840, 4, None), word(Space::Y, 0x2880, 2, None)];
        for (words, row) in [(guarded, "the site's own words under"), (plain, "the site's own words without")]
        {
            let (mut rig, mut reader) = (Rig::new(), UserWordsReader::new(&words));
            rig.put(HostOffset::new(0x2842), 7);
            let (whole, cost) = rig.cost(|bus| reader.poll(bus).unwrap());
            assert_eq!((whole, cost, reader.image()[1]), (0b11, documented(row), 7), "{row}");
        }
    }

    #[test]
    fn an_odd_guard_takes_its_words_away_and_no_others() {
        let words = [
            word(Space::L, 0x2840, 1, Some(0x283C)),
            word(Space::Y, 0x2850, 1, None),
            word(Space::X, 0x2852, 1, Some(0x283C)),
        ];
        let (mut rig, mut reader) = (Rig::new(), UserWordsReader::new(&words));
        rig.put(HostOffset::new(0x283C), 3);
        assert_eq!(reader.poll(&mut rig.host).unwrap(), 0b010);
        rig.put(HostOffset::new(0x283C), 4);
        assert_eq!(reader.poll(&mut rig.host).unwrap(), 0b111);
    }
}
