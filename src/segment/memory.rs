//! The segment's memory: the mapping, its words, the futex.
//!
//! Another process writes this memory, so no reference to it as plain data ever exists. There are two kinds of access:
//! * **One word**: a relaxed or release atomic access to one aligned 64-bit word. Both sides access head, sequence and
//!   every header field only like this. Readers use relaxed loads alone. Rust guarantees that these work on the read-only
//!   mapping of a 64-bit target; on a 32-bit target [`load_word`] makes the load, and says why it is as good.
//! * **The words of a slot together** ([`Words::load_all`], [`WordsMut::store_all`]): on x86-64 whole cache lines go
//!   through [`super::wide_copy`], in vector registers; everything else goes word by word as above. That file explains
//!   why both kinds may access the same memory.
//!
//! Only the kernel reads half a word: the futex is the low half of a head.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use memmap2::{MmapOptions, MmapRaw};

use super::layout::{LINE_WORDS, WORD};
use super::ring::{Words, WordsMut};
use super::wide_copy::WideCopy;

/// The futex call whose time has 64 bits. On 32-bit targets that is `futex_time64` (since Linux 5.1), of one number on all:
/// the older call's time ends in 2038, and not every kernel has that call.
const SYS_FUTEX: libc::c_long = if cfg!(target_pointer_width = "64") { libc::SYS_futex } else { 422 };

/// The line and exit status for an access to mapped memory that has vanished.
static ON_BUS_ERROR: OnceLock<(&str, u8)> = OnceLock::new();

/// From now on an access to mapped memory that has vanished, as after a truncation of the segment, ends this process
/// with `line` on stderr and exit status `status`, instead of a core dump. For programs, at their start: the first call
/// counts.
///
/// # Errors
/// The system refuses the signal's handler.
pub fn end_on_bus_error(line: &'static str, status: u8) -> io::Result<()> {
    let _ = ON_BUS_ERROR.set((line, status));
    // SAFETY: all zero is a valid `sigaction`: no flags, an empty mask.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    action.sa_sigaction = on_bus_error as extern "C" fn(libc::c_int) as libc::sighandler_t;
    // SAFETY: the handler makes only calls that a handler may make, and does not return.
    if unsafe { libc::sigaction(libc::SIGBUS, &raw const action, std::ptr::null_mut()) } == 0 {
        return Ok(());
    }
    Err(io::Error::last_os_error())
}

extern "C" fn on_bus_error(_: libc::c_int) {
    let (line, status) = ON_BUS_ERROR.get().copied().unwrap_or(("SIGBUS\n", 1));
    // SAFETY: a call that a signal's handler may make; it reads a line of static memory.
    unsafe { libc::write(libc::STDERR_FILENO, line.as_ptr().cast(), line.len()) };
    // SAFETY: a call that a signal's handler may make.
    unsafe { libc::_exit(status.into()) }
}

/// A read-only mapping of a segment.
pub(super) struct ReadMap {
    map: MmapRaw,
    words: usize,
    copy: WideCopy,
}

/// The owner's writable mapping of a segment.
pub(super) struct WriteMap(ReadMap);

impl ReadMap {
    /// Maps the first `length` bytes of `file`. The file must have that length and keep it.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw_read_only(file)?;
        Ok(Self { map, words: length / WORD, copy: WideCopy::detect() })
    }

    #[inline(always)]
    fn word(&self, index: usize) -> *mut u64 {
        self.run(index, 1)
    }

    /// The address of `count` words from `index` on. Readers check the geometry before they map, so a position outside
    /// is a bug of this library, not a fault of the segment.
    #[inline(always)]
    fn run(&self, index: usize, count: usize) -> *mut u64 {
        // Copies for the message: borrowed values would be written to the stack on every access.
        assert!(
            index <= self.words && count <= self.words - index,
            "word {} lies outside a segment of {} words",
            { index },
            { self.words }
        );
        // SAFETY: index + count <= words, and the mapping is at least words * 8 bytes long.
        unsafe { self.map.as_mut_ptr().cast::<u64>().add(index) }
    }

    /// The address of the low half of the word at `index`: the half that every publication changes.
    fn low_half(&self, index: usize) -> *mut u32 {
        self.word(index).cast::<u32>().wrapping_add(usize::from(cfg!(target_endian = "big")))
    }

    /// Copies a part of a cache line word by word.
    #[cold]
    fn load_words(&self, index: usize, copy: &mut [u64]) {
        for (offset, word) in copy.iter_mut().enumerate() {
            *word = self.load(index + offset);
        }
    }

    /// Sleeps until the low half of the word at `index` differs from `seen`, a writer wakes it, or CLOCK_MONOTONIC
    /// reaches `deadline_ns`. May also return without any of these: check again.
    pub(super) fn wait(&self, index: usize, seen: u64, deadline_ns: u64) {
        // The kernel's time: seconds and nanoseconds, of 64 bits each on every target.
        let deadline = [deadline_ns / 1_000_000_000, deadline_ns % 1_000_000_000];
        let word = self.low_half(index);
        // SAFETY: the futex word lies inside the mapping, which outlives the call; the kernel only reads it. The
        // time-out is absolute (FUTEX_WAIT_BITSET without FUTEX_CLOCK_REALTIME) and outlives the call.
        unsafe {
            libc::syscall(
                SYS_FUTEX,
                word,
                libc::FUTEX_WAIT_BITSET,
                seen as u32,
                deadline.as_ptr(),
                std::ptr::null::<u32>(),
                libc::FUTEX_BITSET_MATCH_ANY,
            );
        }
    }

    /// Wakes all waiters on the word at `index`, and returns their number.
    pub(super) fn wake(&self, index: usize) -> u64 {
        let word = self.low_half(index);
        // SAFETY: the futex word lies inside the mapping; waking reads and writes no memory.
        let woken = unsafe { libc::syscall(SYS_FUTEX, word, libc::FUTEX_WAKE, i32::MAX) };
        u64::try_from(woken).unwrap_or(0)
    }
}

impl Words for ReadMap {
    #[inline(always)]
    fn load(&self, index: usize) -> u64 {
        // SAFETY: `word` is aligned and inside the mapping, which lives as long as `self`. Nobody makes a plain access
        // to it: this process uses atomics of this width and `wide_copy`, which explains why a race with it does no
        // harm.
        unsafe { load_word(self.word(index)) }
    }

    #[inline(always)]
    fn fence_acquire(&self) {
        fence(Ordering::Acquire);
    }

    #[inline(always)]
    fn load_all(&self, index: usize, copy: &mut [u64]) {
        let start = self.run(index, copy.len());
        // SAFETY: `run` checked this part of the mapping, which is the shared side; the copy is private, equally long,
        // and overlaps nothing. The ring trusts the copy only after it has checked the sequence.
        if !unsafe { self.copy.copy(start, copy.as_mut_ptr(), copy.len()) } {
            self.load_words(index, copy);
        }
    }
}

impl WriteMap {
    /// Maps the first `length` bytes of `file` for writing, with all pages present at once. The file must have that
    /// length and keep it, with its memory allocated.
    pub(super) fn new(file: &File, length: usize) -> io::Result<Self> {
        let map = MmapOptions::new().len(length).populate().map_raw(file)?;
        Ok(Self(ReadMap { map, words: length / WORD, copy: WideCopy::detect() }))
    }

    /// Locks its pages in memory, if this process may: the daemon locks its other pages at its start.
    pub(super) fn lock(&self) {
        let _ = self.0.map.lock();
    }

    /// See [`ReadMap::wake`].
    pub(super) fn wake(&self, index: usize) -> u64 {
        self.0.wake(index)
    }

    #[inline]
    fn atomic(&self, index: usize) -> &AtomicU64 {
        // SAFETY: `word` is aligned and inside the writable mapping, which lives as long as `self`. Nobody makes a
        // plain access to it: see `load`.
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
        // SAFETY: `run` checked this part of the writable mapping, which is the shared side; the values are private,
        // equally many, and overlap nothing. The ring marked the slot as being written before.
        let done = if unsafe { self.0.copy.copy(values.as_ptr(), start, whole) } { whole } else { 0 };
        for (offset, value) in values.iter().enumerate().skip(done) {
            let to = start.wrapping_add(offset);
            // SAFETY: as in `atomic`; `run` checked the whole range.
            unsafe { AtomicU64::from_ptr(to) }.store(*value, Ordering::Relaxed);
        }
    }
}

/// Loads the aligned word at `word`, which may lie on a read-only page, by one access. Rust promises such a load of 8 bytes
/// on 64-bit targets only. The stores need no such care: a page that is written is no read-only page, and there
/// [`AtomicU64`] has one access on every target that has the type.
///
/// # Safety
/// `word` is 8-byte aligned and points into a live mapping, to which nobody makes a plain access.
#[cfg(target_pointer_width = "64")]
#[inline(always)]
unsafe fn load_word(word: *mut u64) -> u64 {
    // SAFETY: by the caller's promise.
    unsafe { AtomicU64::from_ptr(word) }.load(Ordering::Relaxed)
}

/// As on 64-bit targets, by one instruction that reads 8 bytes and writes nothing. The assembly may access any memory (no
/// `nomem`, no `readonly`), so the compiler keeps it in place between the atomic accesses and fences around it.
/// * x86: a processor from the Pentium on reads an aligned quadword at once (Intel SDM volume 3A, "Guaranteed Atomic
///   Operations"). `fild` and `fistp` carry all 64 bits unchanged, for the x87 registers have a significand of 64 bits, and
///   every such processor has them, as not every one has SSE2.
/// * ARMv7: `ldrexd` reads an aligned doubleword at once (ARM DDI 0406C, A3.5.3 "Atomicity in the ARM architecture"). It
///   leaves the exclusive monitor set, which does no harm: each store-exclusive follows a load-exclusive of its own.
#[cfg(not(target_pointer_width = "64"))]
#[inline]
unsafe fn load_word(word: *mut u64) -> u64 {
    #[cfg(target_arch = "x86")]
    {
        let mut value = 0_u64;
        // SAFETY: by the caller's promise; `value` is private. All x87 registers are declared lost, so the stack is empty.
        unsafe {
            std::arch::asm!(
                "fild qword ptr [{from}]",
                "fistp qword ptr [{to}]",
                from = in(reg) word,
                to = in(reg) &raw mut value,
                out("st(0)") _, out("st(1)") _, out("st(2)") _, out("st(3)") _,
                out("st(4)") _, out("st(5)") _, out("st(6)") _, out("st(7)") _,
                options(nostack),
            );
        }
        value
    }
    #[cfg(target_arch = "arm")]
    {
        let (first, second): (u32, u32);
        // SAFETY: by the caller's promise.
        unsafe {
            std::arch::asm!("ldrexd r0, r1, [{from}]", from = in(reg) word, out("r0") first, out("r1") second, options(nostack));
        }
        u64::from(first) | u64::from(second) << 32
    }
    #[cfg(not(any(target_arch = "x86", target_arch = "arm")))]
    compile_error!("this processor has no known instruction that loads 8 bytes of the segment at once")
}

/// Private memory in whole cache lines, aligned to one.
#[derive(Clone, Debug, Default)]
pub(super) struct Lines(Vec<Line>);

#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Line([u64; LINE_WORDS]);

impl Lines {
    /// Room for `lines` cache lines, as words. Allocates only when it has to grow.
    #[inline(always)]
    pub(super) fn room(&mut self, lines: usize) -> &mut [u64] {
        if self.0.len() != lines {
            self.resize(lines);
        }
        self.words_mut()
    }

    /// As [`Lines::room`], but `None` when it would have to allocate.
    #[inline(always)]
    pub(super) fn has_room(&mut self, lines: usize) -> Option<&mut [u64]> {
        (self.0.len() == lines).then(|| self.words_mut())
    }

    #[inline(always)]
    fn words_mut(&mut self) -> &mut [u64] {
        // SAFETY: a line consists of its words alone; private memory, borrowed as long as the result.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), self.0.len() * LINE_WORDS) }
    }

    #[cold]
    fn resize(&mut self, lines: usize) {
        self.0.resize(lines, Line::default());
    }

    /// Zeroes the first line.
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
    fn halves_and_bytes_lie_as_in_memory() {
        let words = [u64::from_ne_bytes([1, 2, 3, 4, 5, 6, 7, 8])];
        assert_eq!(bytes(&words), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(halves(&words)[1], u16::from_ne_bytes([3, 4]));
    }
}
