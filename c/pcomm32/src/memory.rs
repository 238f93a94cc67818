//! The DPRAM by byte offset. Words of the reports come from the segment, without an access to the board; the daemon reads
//! the others. Writes go by the daemon's rules.
//!
//! A program for PComm32 holds the board off with Host-Busy before it reads a report, and asks for the next report. Here
//! the daemon does both for everybody: such writes succeed and change nothing.

use pmac_dpram::client::Board;
use pmac_dpram::map::{Family, HostOffset};
use pmac_dpram::protocol::READ_MAX;
use pmac_dpram::segment::{RegionId, RegionInfo, Sample};

use crate::device::Device;
use crate::fault::Fault;
use crate::process::with;
use crate::variables::family;

/// More bytes than any board's DPRAM has.
const BYTES_MAX: usize = 1 << 17;

/// `count` words from `first` on of a report with these words; `None` unless all of them are there and were read.
fn of_report(region: &RegionInfo, words: &[u16], first: HostOffset, count: usize) -> Option<Vec<u16>> {
    let start = first.bytes().checked_sub(region.first_host_offset)? as usize / 2;
    let found = words.get(start..start.checked_add(count)?)?;
    let (blocks, stride) = (region.blocks.start as usize / 2, region.blocks.stride as usize / 2);
    let is_read = |word: usize| match word
        .checked_sub(blocks)
        .and_then(|word| Some((word.checked_div(stride)?, word % stride)))
    {
        Some((block, word)) => region.selection.has_number(block + 1) && region.selection.has_words(word, 1),
        None => true,
    };
    (start..start + count).all(is_read).then(|| found.to_vec())
}

/// The words from the segment, if a fresh report has all of them.
fn from_segment(board: &mut Board, first: HostOffset, count: usize) -> Option<Vec<u16>> {
    board.refresh().ok()?;
    let subscriber = board.subscriber();
    let mut sample = Sample::new();
    [RegionId::Servo, RegionId::Background, RegionId::Panel].into_iter().find_map(|id| {
        let region = subscriber.region(id).ok()?;
        let words =
            region.first_host_offset..region.first_host_offset.checked_add(region.payload_bytes as u32)?;
        if !words.contains(&first.bytes()) {
            return None;
        }
        subscriber.latest(id, &mut sample).ok()??;
        let found = of_report(&region, sample.words(), first, count)?;
        subscriber.is_fresh(id, &sample.stamp(), subscriber.now_ns()).then_some(found)
    })
}

fn words(device: &Device, first: HostOffset, count: usize) -> Result<Vec<u16>, Fault> {
    if let Ok(Some(words)) = device.read(|board| Ok(from_segment(board, first, count))) {
        return Ok(words);
    }
    let mut words = Vec::with_capacity(count);
    while words.len() < count {
        let part = (count - words.len()).min(READ_MAX);
        let from = first.plus_words(words.len());
        words.extend(device.ask(|connection| connection.read(from, part))?.1);
    }
    Ok(words)
}

/// The bytes from `offset` on, for a program that has room for them.
pub(crate) fn read(number: u32, offset: u32, count: usize, has_room: bool) -> Result<Vec<u8>, Fault> {
    with(number, |device| {
        check(offset, count)?;
        if !has_room {
            return Err(Fault::argument("the room for the bytes is NULL"));
        }
        let skipped = offset as usize & 1;
        let words = words(device, HostOffset::new(offset & !1), (skipped + count).div_ceil(2))?;
        Ok(words.into_iter().flat_map(u16::to_le_bytes).skip(skipped).take(count).collect())
    })
}

/// A call of a program that has lost its way shall not ask for gigabytes.
fn check(offset: u32, count: usize) -> Result<(), Fault> {
    if count > BYTES_MAX || offset as usize > BYTES_MAX {
        return Err(Fault::argument(format!("{count} bytes from offset {offset:#X}: no board has so many")));
    }
    Ok(())
}

/// Whether the word belongs to the handshake of a report.
fn is_handshake(family: &Family, word: HostOffset) -> bool {
    let (servo, background) = (&family.servo, &family.background);
    let busy = background.host_busy.map(|flag| flag.word);
    let flags = [Some(servo.host_busy.word), Some(servo.pmac_status.word), Some(background.ready.word), busy];
    // Both halves of a location: programs write all 32 bits.
    flags.into_iter().flatten().any(|flag| flag.bytes() / 4 == word.bytes() / 4)
}

/// Writes bytes from `offset` on, each with the mask of the bits to change.
fn write_masked(device: &Device, offset: u32, bytes: &[(u8, u8)]) -> Result<(), Fault> {
    check(offset, bytes.len())?;
    let family = family(device)?;
    let mut padded = vec![(0, 0); offset as usize & 1];
    padded.extend_from_slice(bytes);
    padded.resize(padded.len().next_multiple_of(2), (0, 0));
    let words: Vec<(u16, u16)> = padded
        .chunks_exact(2)
        .map(|pair| (u16::from_le_bytes([pair[0].0, pair[1].0]), u16::from_le_bytes([pair[0].1, pair[1].1])))
        .collect();
    let first = HostOffset::new(offset & !1);
    let places: Vec<_> = words.iter().enumerate().map(|(at, word)| (first.plus_words(at), *word)).collect();
    let mut written = 0;
    // No run reaches over a word of the handshake.
    for run in
        places.chunk_by(|(before, _), (next, _)| is_handshake(family, *before) == is_handshake(family, *next))
    {
        if is_handshake(family, run[0].0) {
            continue;
        }
        for part in run.chunks(READ_MAX) {
            let words: Vec<_> = part.iter().map(|(_, word)| *word).collect();
            device.ask(|connection| connection.write(part[0].0, &words, false)).map_err(|fault| {
                if written == 0 { fault } else { fault.after(written, places.len(), "words") }
            })?;
            written += words.len();
        }
    }
    Ok(())
}

/// Writes bytes from `offset` on.
pub(crate) fn write(number: u32, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
    let bytes: Vec<_> = bytes.iter().map(|byte| (*byte, 0xFF)).collect();
    with(number, |device| write_masked(device, offset, &bytes))
}

/// As [`write`], of bytes that `copy` takes from the program once the device and the count are good.
pub(crate) fn write_copy(
    number: u32,
    offset: u32,
    count: usize,
    copy: impl FnOnce(usize) -> Option<Vec<u8>>,
) -> Result<(), Fault> {
    let bytes = with(number, |_| {
        check(offset, count)?;
        copy(count).ok_or_else(|| Fault::argument("the bytes are NULL"))
    })?;
    write(number, offset, &bytes)
}

/// The 16 bits at `offset`.
pub(crate) fn word(number: u32, offset: u32) -> Result<u16, Fault> {
    let bytes = read(number, offset, 2, true)?;
    let bytes = bytes.try_into().map_err(|_| Fault::refused("the DPRAM ends there"))?;
    Ok(u16::from_le_bytes(bytes))
}

/// The 32 bits at `offset`.
pub(crate) fn long(number: u32, offset: u32) -> Result<u32, Fault> {
    let bytes = read(number, offset, 4, true)?;
    let bytes = bytes.try_into().map_err(|_| Fault::refused("the DPRAM ends there"))?;
    Ok(u32::from_le_bytes(bytes))
}

/// Sets the bits of `mask` at `offset`, or clears them.
pub(crate) fn set_bits(number: u32, offset: u32, mask: u32, on: bool) -> Result<(), Fault> {
    let bytes = mask.to_le_bytes().map(|mask| (if on { 0xFF } else { 0 }, mask));
    with(number, |device| write_masked(device, offset, &bytes))
}

/// The mask of bit `bit`.
pub(crate) fn bit(number: u32, bit: u32) -> Result<u32, Fault> {
    with(number, |_| {
        1_u32.checked_shl(bit).ok_or_else(|| Fault::argument(format!("bit {bit}: there are 0 to 31")))
    })
}

#[cfg(test)]
mod tests {
    use pmac_dpram::map::{PMAC, Selection, TURBO2};
    use pmac_dpram::segment::RegionState;
    use pmac_dpram::segment::payload::blocks::BlockPlace;

    use super::*;

    #[test]
    fn host_busy_and_data_ready_are_the_daemons() {
        let word = |family: &Family, number: u32| HostOffset::new((number - family.base) * 4);
        for number in [0xD009, 0xD08A] {
            let place = word(&PMAC, number);
            assert!(is_handshake(&PMAC, place) && is_handshake(&PMAC, place.plus_words(1)), "{number:X}");
            assert!(!is_handshake(&PMAC, place.plus_words(2)));
        }
        assert!(
            is_handshake(&TURBO2, TURBO2.servo.host_busy.word)
                && !is_handshake(&TURBO2, TURBO2.user_area.start)
        );
    }

    #[test]
    fn a_word_that_the_daemon_does_not_read_does_not_come_from_the_segment() {
        let region = RegionInfo {
            id: RegionId::Servo,
            slots: 4,
            payload_bytes: 40,
            first_host_offset: 100,
            state: RegionState::Live,
            period_ns: 0,
            stale_after_ns: 0,
            published: 1,
            blocks: BlockPlace { start: 4, stride: 8, count: 4 },
            selection: Selection::new(std::iter::once(0..2), [1, 2]),
        };
        let payload: Vec<u16> = (0..20).collect();
        let read = |offset, count| of_report(&region, &payload, HostOffset::new(offset), count);
        assert_eq!(read(100, 4), Some(vec![0, 1, 2, 3]));
        assert_eq!(read(112, 2), Some(vec![6, 7]));
        for (offset, count) in [(108, 1), (104, 3), (120, 1), (98, 1), (138, 2)] {
            assert_eq!(read(offset, count), None, "{offset}");
        }
    }
}
