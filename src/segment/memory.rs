//! The segment's memory: the mapping, its words, the futex. The only unsafe code of the segment.
//!
//! What another process writes is never behind a reference to plain data: every access is a relaxed (or, on the writer's
//! side, release) atomic access to one aligned 64-bit word. The same width on both sides, and only relaxed loads on the
//! read-only mapping, which is what Rust promises to work there. The kernel alone looks at half a word (the futex).
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use memmap2::{MmapOptions, MmapRaw};

use super::layout::WORD;
use super::ring::{Words, WordsMut};

/// A read-only mapping of a segment.
pub(super) struct ReadMap {
    map: MmapRaw,
    words: usize,
}

/// The owner's writable mapping of a segment.
pub(super) struct WriteMap(ReadMap);

impl ReadMap {
    /// Maps the first `length` bytes of `file`, which must be that long and stay so.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw_read_only(file)?;
        Ok(Self { map, words: length / WORD })
    }

    #[inline]
    fn word(&self, index: usize) -> *mut u64 {
        self.run(index, 1)
    }

    /// The address of `count` words from `index` on. Readers check the geometry before they map, so that a position outside is a
    /// defect of this library, not of a segment.
    #[inline]
    fn run(&self, index: usize, count: usize) -> *mut u64 {
        assert!(
            index <= self.words && count <= self.words - index,
            "word {index} lies outside a segment of {} words",
            self.words
        );
        // SAFETY: index + count <= words, and the mapping is at least words * 8 bytes long.
        unsafe { self.map.as_mut_ptr().cast::<u64>().add(index) }
    }

    /// Sleeps until the low half of the word at `index` differs from `seen` or someone is woken on it, or until
    /// CLOCK_MONOTONIC reaches `deadline_ns`. May also return for no reason: look again.
    pub(super) fn wait(&self, index: usize, seen: u64, deadline_ns: u64) {
        let deadline = libc::timespec {
            tv_sec: (deadline_ns / 1_000_000_000) as libc::time_t,
            tv_nsec: (deadline_ns % 1_000_000_000) as libc::c_long,
        };
        let word = low_half(self.word(index));
        // SAFETY: the futex word lies inside the mapping, which outlives the call; the kernel only reads it. The
        // time-out is absolute (FUTEX_WAIT_BITSET without FUTEX_CLOCK_REALTIME) and outlives the call.
        unsafe {
            libc::syscall(
                libc::SYS_futex,
                word,
                libc::FUTEX_WAIT_BITSET,
                seen as u32,
                &raw const deadline,
                std::ptr::null::<u32>(),
                libc::FUTEX_BITSET_MATCH_ANY,
            );
        }
    }

    /// Wakes everyone who waits on the word at `index`, and says how many that were.
    pub(super) fn wake(&self, index: usize) -> u64 {
        let word = low_half(self.word(index));
        // SAFETY: the futex word lies inside the mapping; waking reads and writes no memory.
        let woken = unsafe { libc::syscall(libc::SYS_futex, word, libc::FUTEX_WAKE, i32::MAX) };
        u64::try_from(woken).unwrap_or(0)
    }
}

fn low_half(word: *mut u64) -> *mut u32 {
    let half = word.cast::<u32>();
    if cfg!(target_endian = "big") { half.wrapping_add(1) } else { half }
}

impl Words for ReadMap {
    #[inline]
    fn load(&self, index: usize) -> u64 {
        // SAFETY: `word` is aligned and inside the mapping, which lives as long as `self`; every access to it by anyone is
        // an atomic one of this width. A relaxed 8-byte load is allowed on read-only pages of 64-bit targets.
        unsafe { AtomicU64::from_ptr(self.word(index)) }.load(Ordering::Relaxed)
    }

    #[inline]
    fn fence_acquire(&self) {
        fence(Ordering::Acquire);
    }

    #[inline]
    fn load_all(&self, index: usize, copy: &mut [u64]) {
        let start = self.run(index, copy.len());
        let done = load_blocks(start, copy);
        for (offset, word) in copy.iter_mut().enumerate().skip(done) {
            let from = start.wrapping_add(offset);
            // SAFETY: as in `load`; `run` checked the whole stretch.
            *word = unsafe { AtomicU64::from_ptr(from) }.load(Ordering::Relaxed);
        }
    }
}

/// Copies whole blocks of four words where the processor can load them at once, and says how many words that were. Compilers do not
/// join atomic loads, and one word at a time takes twice as long.
///
/// Counts as relaxed loads byte by byte, in some order; what it copied is believed only if the sequence after it says so. Ordinary
/// vector loads keep their order among loads on x86-64, as word loads do.
#[inline]
#[cfg(all(target_arch = "x86_64", not(miri)))]
fn load_blocks(from: *const u64, copy: &mut [u64]) -> usize {
    let words = copy.len() / 4 * 4;
    if words == 0 || !std::arch::is_x86_feature_detected!("avx") {
        return 0;
    }
    // SAFETY: the processor has AVX. `from` has as many words as `copy` in the mapping (`run` checked them), neither is
    // touched beyond `words`, and the private copy overlaps nothing. No `nomem`: the fences around keep their order.
    unsafe {
        std::arch::asm!(
            "2:",
            "vmovdqu ymm0, ymmword ptr [{from} + rcx]",
            "vmovdqu ymmword ptr [{to} + rcx], ymm0",
            "add rcx, 32",
            "cmp rcx, {end}",
            "jb 2b",
            "vzeroupper",
            from = in(reg) from,
            to = in(reg) copy.as_mut_ptr(),
            inout("rcx") 0usize => _,
            end = in(reg) words * WORD,
            clobber_abi("C"),
            options(nostack),
        );
    }
    words
}

#[inline]
#[cfg(not(all(target_arch = "x86_64", not(miri))))]
fn load_blocks(_from: *const u64, _copy: &mut [u64]) -> usize {
    0
}

impl WriteMap {
    /// Maps the first `length` bytes of `file` for writing, all pages present at once. The file must be that long, with
    /// its memory already set aside, and stay so.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw(file)?;
        Ok(Self(ReadMap { map, words: length / WORD }))
    }

    /// See [`ReadMap::wake`].
    pub(super) fn wake(&self, index: usize) -> u64 {
        self.0.wake(index)
    }

    #[inline]
    fn atomic(&self, index: usize) -> &AtomicU64 {
        // SAFETY: `word` is aligned and inside the writable mapping, which lives as long as `self`; every access to it by
        // anyone is an atomic one of this width.
        unsafe { AtomicU64::from_ptr(self.0.word(index)) }
    }
}

impl Words for WriteMap {
    #[inline]
    fn load(&self, index: usize) -> u64 {
        self.0.load(index)
    }

    #[inline]
    fn fence_acquire(&self) {
        self.0.fence_acquire();
    }
}

impl WordsMut for WriteMap {
    #[inline]
    fn store(&self, index: usize, value: u64) {
        self.atomic(index).store(value, Ordering::Relaxed);
    }

    #[inline]
    fn store_release(&self, index: usize, value: u64) {
        self.atomic(index).store(value, Ordering::Release);
    }

    #[inline]
    fn fence_release(&self) {
        fence(Ordering::Release);
    }

    #[inline]
    fn store_all(&self, index: usize, values: &[u64]) {
        let start = self.0.run(index, values.len());
        for (offset, value) in values.iter().enumerate() {
            let to = start.wrapping_add(offset);
            // SAFETY: as in `atomic`; `run` checked the whole stretch.
            unsafe { AtomicU64::from_ptr(to) }.store(*value, Ordering::Relaxed);
        }
    }
}

/// Private words seen as 16-bit halves, in memory order.
pub(super) fn halves(words: &[u64]) -> &[u16] {
    // SAFETY: any bytes are a u16, and u64 is stricter aligned; private memory, borrowed as long as the result.
    unsafe { std::slice::from_raw_parts(words.as_ptr().cast(), words.len() * 4) }
}

/// Private words seen as bytes, in memory order.
pub(super) fn bytes(words: &[u64]) -> &[u8] {
    // SAFETY: any bytes are bytes; private memory, borrowed as long as the result.
    unsafe { std::slice::from_raw_parts(words.as_ptr().cast(), words.len() * 8) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_written_on_one_mapping_is_read_on_the_other() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(4096).unwrap();
        let writer = WriteMap::new(&file, 4096).unwrap();
        let reader = ReadMap::new(&file, 4096).unwrap();
        writer.store(1, 0x0123_4567_89AB_CDEF);
        writer.store_all(509, &[1, 2, 3]);
        assert_eq!(reader.load(1), 0x0123_4567_89AB_CDEF);
        let mut copy = [0; 4];
        reader.load_all(508, &mut copy);
        assert_eq!(copy, [0, 1, 2, 3]);
    }

    #[test]
    #[should_panic(expected = "outside a segment")]
    fn nothing_outside_is_touched() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(4096).unwrap();
        ReadMap::new(&file, 4096).unwrap().load_all(510, &mut [0; 3]);
    }

    #[test]
    fn halves_and_bytes_lie_as_in_memory() {
        let words = [u64::from_ne_bytes([1, 2, 3, 4, 5, 6, 7, 8])];
        assert_eq!(bytes(&words), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(halves(&words)[1], u16::from_ne_bytes([3, 4]));
    }
}
