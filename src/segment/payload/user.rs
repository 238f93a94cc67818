//! The regions of the site's own words: one for the values, one for the names. `docs/segment.md` has the tables.

use crate::format::{Text, join32, split32};
use crate::map::user_word::{USER_WORDS, UserWord};
use crate::map::{BitField, HostOffset, Space, TypedAddress};

/// 16-bit words before the values: a bit for each name.
pub const HEADER_WORDS: usize = 4;
/// Bytes before the names.
const TABLE_HEADER_BYTES: usize = 16;
/// Bytes of a name's entry.
const ENTRY_BYTES: usize = 64;
const AT_UNIT: usize = 0x20;
const AT_HOST_OFFSET: usize = 0x30;
const AT_PLACE: usize = 0x34;
const AT_COUNT: usize = 0x36;
const AT_SPACE: usize = 0x38;
const AT_BIT: usize = 0x39;
const AT_WIDTH: usize = 0x3A;
const AT_SIGNED: usize = 0x3B;
const AT_GUARD: usize = 0x3C;
/// The guard's offset of a name without a guard; a real offset is even.
const NO_GUARD: u32 = u32::MAX;
/// The spaces by their numbers in an entry.
const SPACES: [Space; 6] = [Space::Y, Space::X, Space::Dp, Space::F, Space::D, Space::L];

/// Bytes of the table of `words`.
#[must_use]
pub const fn table_bytes(words: &[UserWord]) -> usize {
    TABLE_HEADER_BYTES + words.len() * ENTRY_BYTES
}

/// 16-bit words of a sample of `words`.
#[must_use]
pub fn payload_words(words: &[UserWord]) -> usize {
    HEADER_WORDS + words.iter().map(UserWord::words).sum::<usize>()
}

/// The header of a sample in which the names of the mask `whole` have values; bit 0 is the first name.
#[must_use]
pub fn header(whole: u64) -> [u16; HEADER_WORDS] {
    let ([a, b], [c, d]) = (split32(whole as u32), split32((whole >> 32) as u32));
    [a, b, c, d]
}

/// The values of each of `words` in the sample `payload`, unchanged; `None` for words that the daemon could not read
/// whole. `None` instead of the list for a sample that is too short.
#[must_use]
pub fn split<'a>(words: &[UserWord], payload: &'a [u16]) -> Option<Vec<Option<&'a [u16]>>> {
    let (&[a, b, c, d], mut rest) = payload.split_first_chunk::<HEADER_WORDS>()?;
    let whole = u64::from(join32(a, b)) | u64::from(join32(c, d)) << 32;
    let mut all = Vec::with_capacity(words.len());
    for (index, word) in words.iter().enumerate() {
        let (values, behind) = rest.split_at_checked(word.words())?;
        rest = behind;
        all.push((whole >> index & 1 != 0).then_some(values));
    }
    Some(all)
}

/// Encodes the table of `words`.
#[must_use]
pub fn encode_table(words: &[UserWord]) -> Vec<u8> {
    let mut bytes = vec![0; TABLE_HEADER_BYTES];
    bytes[..4].copy_from_slice(&(words.len() as u32).to_ne_bytes());
    bytes[4..8].copy_from_slice(&(ENTRY_BYTES as u32).to_ne_bytes());
    let mut place = HEADER_WORDS;
    for word in words {
        let mut entry = [0; ENTRY_BYTES];
        let mut put = |at: usize, value: &[u8]| entry[at..at + value.len()].copy_from_slice(value);
        put(0, word.name.as_bytes());
        put(AT_UNIT, word.unit.as_bytes());
        put(AT_HOST_OFFSET, &word.location.offset.bytes().to_ne_bytes());
        put(AT_PLACE, &(2 * place as u16).to_ne_bytes());
        put(AT_COUNT, &(word.count as u16).to_ne_bytes());
        let space = SPACES.iter().position(|space| *space == word.location.space).unwrap_or(0);
        let BitField { offset, width } = word.bits.unwrap_or(BitField { offset: 0, width: 0 });
        put(AT_SPACE, &[space as u8, offset as u8, width as u8, word.signed.into()]);
        put(AT_GUARD, &word.guard.map_or(NO_GUARD, HostOffset::bytes).to_ne_bytes());
        bytes.extend_from_slice(&entry);
        place += word.words();
    }
    bytes
}

/// Decodes a table; `None` if it ends before its last name, or has a name that no daemon writes.
#[must_use]
pub fn decode_table(bytes: &[u8]) -> Option<Vec<UserWord>> {
    let (count, stride) = (u32_at(bytes, 0)? as usize, u32_at(bytes, 4)? as usize);
    let entries = bytes.get(TABLE_HEADER_BYTES..)?.chunks_exact(stride.max(ENTRY_BYTES));
    if count > USER_WORDS || entries.len() < count {
        return None;
    }
    entries.take(count).map(decode_entry).collect()
}

fn decode_entry(entry: &[u8]) -> Option<UserWord> {
    let guard = u32_at(entry, AT_GUARD)?;
    let (offset, width) = (u32::from(*entry.get(AT_BIT)?), u32::from(*entry.get(AT_WIDTH)?));
    let space = *SPACES.get(usize::from(*entry.get(AT_SPACE)?))?;
    let is_field = offset + width <= 16 * space.words().min(2) as u32;
    Some(UserWord {
        name: text(entry.get(..AT_UNIT)?),
        unit: text(entry.get(AT_UNIT..AT_HOST_OFFSET)?),
        location: TypedAddress { space, offset: HostOffset::checked(u32_at(entry, AT_HOST_OFFSET)?)? },
        bits: if width == 0 {
            None
        } else {
            Some(BitField { offset, width }).filter(|_| is_field).map(Some)?
        },
        signed: *entry.get(AT_SIGNED)? != 0,
        count: u16::from_ne_bytes(*entry.get(AT_COUNT..)?.first_chunk()?).into(),
        guard: if guard == NO_GUARD { None } else { Some(HostOffset::checked(guard)?) },
    })
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_ne_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn text<const N: usize>(bytes: &[u8]) -> Text<N> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    Text::from_bytes(&bytes[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(name: &str, space: Space, bits: Option<BitField>, guard: Option<u32>) -> UserWord {
        UserWord {
            name: name.into(),
            unit: "mm".into(),
            location: TypedAddress { space, offset: HostOffset::new(0x2840) },
            bits,
            signed: bits.is_some(),
            count: 2,
            guard: guard.map(HostOffset::new),
        }
    }

    #[test]
    fn a_table_and_a_sample_are_read_as_they_were_written() {
        let words = [
            word("count", Space::Dp, None, None),
            word(
                "a-name-of-thirty-two-bytes-in-all",
                Space::Y,
                Some(BitField { offset: 8, width: 4 }),
                Some(0x283C),
            ),
        ];
        let bytes = encode_table(&words);
        assert_eq!(
            (bytes.len(), &bytes[..8]),
            (table_bytes(&words), [2_u32, 64].map(u32::to_ne_bytes).as_flattened())
        );
        assert_eq!(bytes[0x10 + 0x38..0x10 + 0x3C], [2, 0, 0, 0]);
        assert_eq!(bytes[0x50 + 0x34..0x50 + 0x38], *[16_u16, 2].map(u16::to_ne_bytes).as_flattened());
        assert_eq!(bytes[0x50 + 0x38..0x50 + 0x3C], [0, 8, 4, 1]);
        assert_eq!(decode_table(&bytes).unwrap(), words);
        let payload = [header(0b10).to_vec(), vec![1, 2, 3, 4, 5, 6]].concat();
        assert_eq!(payload.len(), payload_words(&words));
        assert_eq!(split(&words, &payload).unwrap(), [None, Some(&[5, 6][..])]);
        assert_eq!(split(&words, &payload[1..]), None);
    }

    #[test]
    fn a_table_that_no_daemon_writes_is_none() {
        let whole = encode_table(&[word("count", Space::Dp, None, None)]);
        assert!(decode_table(&whole[..79]).is_none());
        let low = if cfg!(target_endian = "big") { 3 } else { 0 };
        let odd = 0x10 + AT_HOST_OFFSET + low;
        for (at, value) in [(low, 200), (0x10 + AT_SPACE, 9), (0x10 + AT_WIDTH, 40), (odd, 1)] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            assert_eq!(decode_table(&bytes), None, "{at:#x}");
        }
    }
}
