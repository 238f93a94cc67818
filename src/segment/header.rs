//! Checks a header before anything uses it.
//!
//! Works on a private copy read with `pread`. So a truncated file is an error, not a fault, and no process can change
//! the header between check and use.

use std::fmt::Display;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;

use super::layout::*;
use super::payload::blocks::BlockPlace;
use super::ring::Ring;

/// Longest header that this version reads, in bytes: far more than 64 region entries need.
pub(super) const MAX_HEADER: usize = 64 * 1024;

/// The place of every part, with each bound checked against the object's size.
#[derive(Debug)]
pub(super) struct Geometry {
    pub(super) total_length: usize,
    pub(super) clock: ClockKind,
    pub(super) counters: usize,
    pub(super) counter_count: usize,
    pub(super) regions: Vec<Region>,
}

/// One region that this version knows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region {
    pub(super) id: RegionId,
    /// Offset of its entry in bytes.
    pub(super) entry: usize,
    pub(super) payload_bytes: usize,
    pub(super) first_host_offset: u32,
    pub(super) blocks: BlockPlace,
    pub(super) ring: Ring,
    /// Cache lines that a reader copies of a slot.
    pub(super) lines: usize,
}

/// Why a header is rejected.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum HeaderError {
    Malformed(String),
    Version(u64),
}

impl Geometry {
    /// Checks `header`, the first bytes of an object of `length` bytes, as words.
    pub(super) fn parse(header: &[u64], length: u64) -> Result<Self, HeaderError> {
        let word = |offset: usize| header.get(offset / WORD).copied().unwrap_or(0);
        if header.len() * WORD < AT_REGIONS {
            return malformed(format!("it is {length} bytes long, too short for a header"));
        }
        if word(AT_MAGIC) == MAGIC.swap_bytes() {
            return malformed("it was written by a machine of the other byte order");
        }
        if word(AT_MAGIC) != MAGIC {
            return malformed("it does not begin with the mark of a segment");
        }
        if word(AT_ABI_MAJOR) != ABI_MAJOR {
            return Err(HeaderError::Version(word(AT_ABI_MAJOR)));
        }
        if word(AT_BYTE_ORDER) != BYTE_ORDER || word(AT_WORD_BYTES) != WORD as u64 {
            return malformed("its words are of another size or byte order");
        }
        if word(AT_TOTAL_LENGTH) != length {
            return malformed(format!(
                "it is {length} bytes long, its header says {}",
                word(AT_TOTAL_LENGTH)
            ));
        }
        if length > MAX_TOTAL || !length.is_multiple_of(WORD as u64) {
            return malformed(format!("no segment is {length} bytes long"));
        }
        let Some(clock) = ClockKind::from_number(word(AT_CLOCK_KIND)) else {
            return malformed(format!("it uses an unknown clock, kind {}", word(AT_CLOCK_KIND)));
        };
        let header_length = word(AT_HEADER_LENGTH);
        if header_length > (header.len() * WORD) as u64 || header_length < AT_REGIONS as u64 {
            return malformed(format!("no header is {header_length} bytes long"));
        }
        let (table, count, stride) = (word(AT_REGION_TABLE), word(AT_REGION_COUNT), word(AT_REGION_STRIDE));
        if count > MAX_REGIONS as u64
            || stride < REGION_STRIDE as u64
            || !stretch_fits(table, count, stride, WORD as u64, AT_REGIONS as u64..header_length)
        {
            return malformed(format!(
                "a region table of {count} entries of {stride} bytes at {table} does not fit its header"
            ));
        }
        let (counters, counter_count) = (word(AT_COUNTER_TABLE), word(AT_COUNTER_COUNT));
        if !stretch_fits(counters, counter_count, 8, 8, AT_COUNTERS as u64..header_length) {
            return malformed(format!("{counter_count} counters at {counters} do not fit its header"));
        }
        // From here on every offset is below MAX_HEADER: no cast truncates and no sum overflows.
        let (table, stride) = (table as usize, stride as usize);
        let entries = (0..count as usize).map(|index| table + index * stride);
        if word(AT_LAYOUT_HASH) != hash_of(entries.clone(), word) {
            return malformed("its geometry does not match its checksum");
        }
        let mut regions: Vec<Region> = Vec::new();
        for entry in entries {
            let Some(id) = RegionId::from_number(word(entry + REGION_ID)) else { continue };
            if regions.iter().any(|region| region.id == id) {
                return malformed(format!("it has two {} regions", id.name()));
            }
            regions.push(region(id, entry, header_length, length, word)?);
        }
        Ok(Self {
            total_length: length as usize,
            clock,
            counters: counters as usize,
            counter_count: counter_count as usize,
            regions,
        })
    }
}

fn region(
    id: RegionId,
    entry: usize,
    header_length: u64,
    length: u64,
    word: impl Fn(usize) -> u64,
) -> Result<Region, HeaderError> {
    let [head, slots, slot_count, slot_stride, payload, host_offset] = [
        REGION_HEAD,
        REGION_SLOTS,
        REGION_SLOT_COUNT,
        REGION_SLOT_STRIDE,
        REGION_PAYLOAD,
        REGION_HOST_OFFSET,
    ]
    .map(|field| word(entry + field));
    let refuse = |why: &str| malformed(format!("its {} region {why}", id.name()));
    if payload > MAX_PAYLOAD {
        return refuse(&format!("has a payload of {payload} bytes"));
    }
    if !slot_count.is_power_of_two() || slot_count < 2 {
        return refuse(&format!("has {slot_count} slots, not a power of two"));
    }
    if slot_stride < slot_bytes(payload as usize) as u64 || !slot_stride.is_multiple_of(LINE as u64) {
        return refuse(&format!("has slots of {slot_stride} bytes for a payload of {payload}"));
    }
    if !stretch_fits(head, 1, LINE as u64, LINE as u64, header_length..length)
        || !stretch_fits(slots, slot_count, slot_stride, LINE as u64, header_length..length)
    {
        return refuse("lies outside the segment");
    }
    let Ok(first_host_offset) = u32::try_from(host_offset) else {
        return refuse(&format!("mirrors host offset {host_offset}"));
    };
    let place =
        [REGION_BLOCK_START, REGION_BLOCK_STRIDE, REGION_BLOCK_COUNT].map(|field| word(entry + field));
    let [Ok(start), Ok(stride), Ok(count)] = place.map(u32::try_from) else {
        return refuse("has blocks outside its payload");
    };
    let blocks = BlockPlace { start, stride, count };
    if !blocks.fits(payload) {
        return refuse("has blocks outside its payload");
    }
    Ok(Region {
        id,
        entry,
        payload_bytes: payload as usize,
        first_host_offset,
        blocks,
        ring: ring_at(
            head as usize,
            slots as usize,
            slot_count as usize,
            slot_stride as usize,
            payload as usize,
        ),
        lines: slot_bytes(payload as usize).div_ceil(LINE),
    })
}

/// Bytes of a slot before rounding up to cache lines.
pub(super) fn slot_bytes(payload_bytes: usize) -> usize {
    SLOT_PAYLOAD + payload_bytes.next_multiple_of(WORD)
}

/// The ring with these offsets and lengths in bytes.
pub(super) fn ring_at(head: usize, slots: usize, count: usize, stride: usize, payload_bytes: usize) -> Ring {
    let body = (slot_bytes(payload_bytes) - SLOT_TIME) / WORD;
    Ring { head: head / WORD, slots: slots / WORD, count, stride: stride / WORD, body }
}

/// The layout hash over `word(offset)`, given the offsets of the region entries.
pub(super) fn hash_of(entries: impl Iterator<Item = usize>, word: impl Fn(usize) -> u64) -> u64 {
    let fixed = [
        AT_ABI_MAJOR,
        AT_HEADER_LENGTH,
        AT_TOTAL_LENGTH,
        AT_REGION_TABLE,
        AT_REGION_COUNT,
        AT_REGION_STRIDE,
        AT_COUNTER_TABLE,
    ];
    let of_entries = entries.flat_map(|entry| (0..REGION_FIXED_WORDS).map(move |index| entry + index * WORD));
    layout_hash(fixed.into_iter().chain(of_entries).map(word))
}

/// Whether `count` pieces of `stride` bytes from `start` on are aligned and lie in `room`.
fn stretch_fits(start: u64, count: u64, stride: u64, alignment: u64, room: Range<u64>) -> bool {
    let end = count.checked_mul(stride).and_then(|bytes| start.checked_add(bytes));
    start.is_multiple_of(alignment)
        && stride.is_multiple_of(alignment)
        && start >= room.start
        && end.is_some_and(|end| end <= room.end)
}

fn malformed<T>(why: impl Display) -> Result<T, HeaderError> {
    Err(HeaderError::Malformed(why.to_string()))
}

/// Reads the start of `file` as words, at most [`MAX_HEADER`] bytes, and the file's length in bytes.
pub(super) fn read(file: &File) -> io::Result<(Vec<u64>, u64)> {
    let length = file.metadata()?.len();
    let mut bytes = vec![0; (length.min(MAX_HEADER as u64) as usize) / WORD * WORD];
    file.read_exact_at(&mut bytes, 0)?;
    let words = bytes.chunks_exact(WORD).map(|word| {
        let mut whole = [0; WORD];
        whole.copy_from_slice(word);
        u64::from_ne_bytes(whole)
    });
    Ok((words.collect(), length))
}
