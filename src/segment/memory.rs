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

use super::layout::{LINE, WORD};
use super::ring::{Words, WordsMut};

/// Words of a cache line.
pub(super) const LINE_WORDS: usize = LINE / WORD;

/// A read-only mapping of a segment.
pub(super) struct ReadMap {
    map: MmapRaw,
    words: usize,
    kernel: Kernel,
}

/// The owner's writable mapping of a segment.
pub(super) struct WriteMap(ReadMap);

impl ReadMap {
    /// Maps the first `length` bytes of `file`, which must be that long and stay so.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw_read_only(file)?;
        Ok(Self { map, words: length / WORD, kernel: Kernel::detect() })
    }

    #[inline(always)]
    fn word(&self, index: usize) -> *mut u64 {
        self.run(index, 1)
    }

    /// The address of `count` words from `index` on. Readers check the geometry before they map, so that a position outside is a
    /// defect of this library, not of a segment.
    #[inline(always)]
    fn run(&self, index: usize, count: usize) -> *mut u64 {
        // Values of their own for the message: what it borrows would be stored for it on every access.
        assert!(
            index <= self.words && count <= self.words - index,
            "word {} lies outside a segment of {} words",
            { index },
            { self.words }
        );
        // SAFETY: index + count <= words, and the mapping is at least words * 8 bytes long.
        unsafe { self.map.as_mut_ptr().cast::<u64>().add(index) }
    }

    /// Word by word, what is not of whole lines.
    #[cold]
    fn load_words(&self, index: usize, copy: &mut [u64]) {
        for (offset, word) in copy.iter_mut().enumerate() {
            *word = self.load(index + offset);
        }
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
    #[inline(always)]
    fn load(&self, index: usize) -> u64 {
        // SAFETY: `word` is aligned and inside the mapping, which lives as long as `self`; every access to it by anyone is
        // an atomic one of this width. A relaxed 8-byte load is allowed on read-only pages of 64-bit targets.
        unsafe { AtomicU64::from_ptr(self.word(index)) }.load(Ordering::Relaxed)
    }

    #[inline(always)]
    fn fence_acquire(&self) {
        fence(Ordering::Acquire);
    }

    #[inline(always)]
    fn load_all(&self, index: usize, copy: &mut [u64]) {
        let start = self.run(index, copy.len());
        // SAFETY: `run` checked the stretch of the mapping; the copy is private, as long, and overlaps nothing.
        if !unsafe { self.kernel.copy(start, copy.as_mut_ptr(), copy.len()) } {
            self.load_words(index, copy);
        }
    }
}

/// What the processor copies at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kernel {
    /// Word by word, by Rust's own atomics.
    #[cfg_attr(all(target_arch = "x86_64", not(any(miri, test))), allow(dead_code))]
    Words,
    /// 16 bytes at a time, as every x86-64 processor can.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    Sse2,
    /// 32 bytes at a time.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    Avx,
}

impl Kernel {
    /// The best this processor has.
    fn detect() -> Self {
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        return if std::arch::is_x86_feature_detected!("avx") { Self::Avx } else { Self::Sse2 };
        #[cfg(not(all(target_arch = "x86_64", not(miri))))]
        Self::Words
    }

    /// Copies `words` words, if they are whole cache lines, and says whether they were. Compilers do not join atomic accesses, and
    /// one word at a time takes three times as long.
    ///
    /// On the shared side this counts as relaxed accesses byte by byte, in some order; what was copied is believed only if the sequence
    /// after it says so. Ordinary vector accesses keep their order among loads, and among stores, on x86-64, as word accesses do.
    ///
    /// # Safety
    /// Both `from` and `to` have `words` words, and do not overlap. At most one of them is shared, the other private.
    #[inline(always)]
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    unsafe fn copy(self, from: *const u64, to: *mut u64, words: usize) -> bool {
        if words == 0 || !words.is_multiple_of(LINE_WORDS) {
            return false;
        }
        match self {
            Self::Words => return false,
            // SAFETY: the processor has AVX, as was detected, and the caller answers for the memory; nothing beyond
            // `words` is touched. `vzeroupper` clears what is declared lost. No `nomem`: the fences around keep their order.
            Self::Avx => unsafe {
                std::arch::asm!(
                    "test {left}, 64",
                    "jz 2f",
                    "vmovdqu ymm0, ymmword ptr [{from}]",
                    "vmovdqu ymm1, ymmword ptr [{from} + 32]",
                    "vmovdqu ymmword ptr [{to}], ymm0",
                    "vmovdqu ymmword ptr [{to} + 32], ymm1",
                    "add {from}, 64",
                    "add {to}, 64",
                    "sub {left}, 64",
                    "jz 3f",
                    "2:",
                    "vmovdqu ymm0, ymmword ptr [{from}]",
                    "vmovdqu ymm1, ymmword ptr [{from} + 32]",
                    "vmovdqu ymm2, ymmword ptr [{from} + 64]",
                    "vmovdqu ymm3, ymmword ptr [{from} + 96]",
                    "vmovdqu ymmword ptr [{to}], ymm0",
                    "vmovdqu ymmword ptr [{to} + 32], ymm1",
                    "vmovdqu ymmword ptr [{to} + 64], ymm2",
                    "vmovdqu ymmword ptr [{to} + 96], ymm3",
                    "sub {from}, -128",
                    "sub {to}, -128",
                    "add {left}, -128",
                    "jnz 2b",
                    "3:",
                    "vzeroupper",
                    from = inout(reg) from => _,
                    to = inout(reg) to => _,
                    left = inout(reg) words * WORD => _,
                    out("xmm0") _, out("xmm1") _, out("xmm2") _, out("xmm3") _,
                    out("xmm4") _, out("xmm5") _, out("xmm6") _, out("xmm7") _,
                    out("xmm8") _, out("xmm9") _, out("xmm10") _, out("xmm11") _,
                    out("xmm12") _, out("xmm13") _, out("xmm14") _, out("xmm15") _,
                    options(nostack),
                );
            },
            // SAFETY: as above; SSE2 belongs to x86-64.
            Self::Sse2 => unsafe {
                std::arch::asm!(
                    "2:",
                    "movdqu xmm0, xmmword ptr [{from}]",
                    "movdqu xmm1, xmmword ptr [{from} + 16]",
                    "movdqu xmm2, xmmword ptr [{from} + 32]",
                    "movdqu xmm3, xmmword ptr [{from} + 48]",
                    "movdqu xmmword ptr [{to}], xmm0",
                    "movdqu xmmword ptr [{to} + 16], xmm1",
                    "movdqu xmmword ptr [{to} + 32], xmm2",
                    "movdqu xmmword ptr [{to} + 48], xmm3",
                    "add {from}, 64",
                    "add {to}, 64",
                    "sub {left}, 64",
                    "jnz 2b",
                    from = inout(reg) from => _,
                    to = inout(reg) to => _,
                    left = inout(reg) words * WORD => _,
                    out("xmm0") _, out("xmm1") _, out("xmm2") _, out("xmm3") _,
                    options(nostack),
                );
            },
        }
        true
    }

    #[inline(always)]
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    unsafe fn copy(self, _from: *const u64, _to: *mut u64, _words: usize) -> bool {
        false
    }
}

impl WriteMap {
    /// Maps the first `length` bytes of `file` for writing, all pages present at once. The file must be that long, with
    /// its memory already set aside, and stay so.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw(file)?;
        Ok(Self(ReadMap { map, words: length / WORD, kernel: Kernel::detect() }))
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
        let whole = values.len() / LINE_WORDS * LINE_WORDS;
        // SAFETY: `run` checked the stretch of the writable mapping; the values are private, as many, and overlap nothing.
        let done = if unsafe { self.0.kernel.copy(values.as_ptr(), start, whole) } { whole } else { 0 };
        for (offset, value) in values.iter().enumerate().skip(done) {
            let to = start.wrapping_add(offset);
            // SAFETY: as in `atomic`; `run` checked the whole stretch.
            unsafe { AtomicU64::from_ptr(to) }.store(*value, Ordering::Relaxed);
        }
    }
}

/// Private memory of whole cache lines, which begins on one.
#[derive(Clone, Debug, Default)]
pub(super) struct Lines(Vec<Line>);

#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Line([u64; LINE_WORDS]);

impl Lines {
    /// Room for so many lines, as words. Allocates only when it has to grow.
    #[inline(always)]
    pub(super) fn room(&mut self, lines: usize) -> &mut [u64] {
        if self.0.len() != lines {
            self.resize(lines);
        }
        self.words_mut()
    }

    /// As [`Lines::room`], if it is there already.
    #[inline(always)]
    pub(super) fn has_room(&mut self, lines: usize) -> Option<&mut [u64]> {
        (self.0.len() == lines).then(|| self.words_mut())
    }

    #[inline(always)]
    fn words_mut(&mut self) -> &mut [u64] {
        // SAFETY: a line is its words and nothing else; private memory, borrowed as long as the result.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), self.0.len() * LINE_WORDS) }
    }

    #[cold]
    fn resize(&mut self, lines: usize) {
        self.0.resize(lines, Line::default());
    }

    /// Makes the words of the first line 0.
    pub(super) fn clear_first(&mut self) {
        self.0.iter_mut().take(1).for_each(|line| *line = Line::default());
    }

    /// The words.
    #[inline(always)]
    pub(super) fn words(&self) -> &[u64] {
        // SAFETY: as in `words_mut`.
        unsafe { std::slice::from_raw_parts(self.0.as_ptr().cast(), self.0.len() * LINE_WORDS) }
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
    fn every_kernel_copies_what_it_is_given_and_no_more() {
        let mut kernels = vec![Kernel::Words, Kernel::detect()];
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        kernels.push(Kernel::Sse2);
        let file = tempfile::tempfile().unwrap();
        file.set_len(4096).unwrap();
        for kernel in kernels {
            let mut writer = WriteMap::new(&file, 4096).unwrap();
            writer.0.kernel = kernel;
            for (start, count) in (0..10).flat_map(|start| (0..60).map(move |count| (start, count))) {
                writer.store_all(0, &[0; 128]);
                let values: Vec<u64> = (1..=count).collect();
                writer.store_all(start, &values);
                let mut copy = vec![9; count as usize + 2];
                writer.0.load_all(start, &mut copy[1..=count as usize]);
                assert_eq!((copy[0], copy[count as usize + 1]), (9, 9));
                assert_eq!(copy[1..=count as usize], values, "{kernel:?} {start}");
                assert_eq!(writer.load(start + count as usize), 0, "{kernel:?} {start} {count}");
                assert!((0..start).all(|index| writer.load(index) == 0));
            }
        }
    }

    #[test]
    fn halves_and_bytes_lie_as_in_memory() {
        let words = [u64::from_ne_bytes([1, 2, 3, 4, 5, 6, 7, 8])];
        assert_eq!(bytes(&words), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(halves(&words)[1], u16::from_ne_bytes([3, 4]));
    }
}
