//! The vector copy: the words of a slot between shared and private memory, 16 or 32 bytes at a time (x86-64).
//!
//! Compilers do not merge atomic accesses, and one word at a time takes three times as long. So [`super::memory`]
//! copies whole cache lines with the assembly in this file, and everything else word by word. This page argues why that
//! is correct.
//!
//! # Where the driver uses it
//! Only for the words of a slot, between the ring's marks (see [`super::ring`]): the writer copies in after it has
//! stored the odd sequence and before it stores the even one; a reader copies out after it has loaded the head and
//! before it loads the sequence. Head and sequence themselves are always stored as one atomic word each, and loaded so
//! wherever a decision depends on them.
//!
//! # Why it is right
//! Rust's memory model does not cover it: there, racing accesses of different sizes are undefined. The other side may
//! also be another process, in C or Python, which that model does not know. The argument rests on the processor:
//! * **The compiler sees nothing of it.** The assembly is volatile (no `pure`) and may access any memory (no `nomem`,
//!   no `readonly`). So the compiler keeps it in place between the atomic accesses and fences around it, and can
//!   conclude nothing from a race that it does not see. The shared address is a raw pointer; no reference to it exists.
//! * **x86-64 keeps the order (TSO).** On ordinary write-back memory, such as that of a mapped file, loads are made in
//!   program order and stores become visible in program order; this holds for vector moves, too. It does not hold for
//!   string moves (`rep movs`) and non-temporal stores, so this file uses neither. The ring's acquire and release
//!   fences bind only the compiler and need no instruction on x86-64.
//! * **So the sequence vouches for every byte.** If a byte of a reader's copy was stored for a later sample of the
//!   slot, the odd sequence of that sample was visible before it. The load of the sequence after the copy sees it, and
//!   the reader discards the copy. If the head said `n`, every byte of sample `n` was visible before the first load of
//!   the copy.
//! * **Tearing does no harm.** A vector access may take effect in pieces, of any size and in any order among
//!   themselves. The argument above holds for each byte by itself and needs no two bytes to appear together.
//!
//! # The tests
//! The tests below compare it with a copy word by word: every length and alignment, and random contents, with guards
//! around both sides. `tests/it/segment.rs` and `segment_life.rs` race it between threads and processes, with a writer
//! at full speed. The model checker (`tests/it/segment_loom.rs`) does **not** run it: it runs the ring over copies word
//! by word, in either order.
#![allow(unsafe_code)]

#[cfg(any(all(target_arch = "x86_64", not(miri)), test))]
use super::layout::LINE_WORDS;
#[cfg(all(target_arch = "x86_64", not(miri)))]
use super::layout::WORD;

/// How much one step copies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WideCopy {
    /// Nothing: the caller copies word by word with Rust's atomics.
    #[cfg_attr(all(target_arch = "x86_64", not(any(miri, test))), allow(dead_code))]
    Words,
    /// 16 bytes, as every x86-64 processor can.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    Sse2,
    /// 32 bytes.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    Avx,
}

impl WideCopy {
    /// The widest that this processor supports.
    pub(super) fn detect() -> Self {
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        return if std::arch::is_x86_feature_detected!("avx") { Self::Avx } else { Self::Sse2 };
        #[cfg(not(all(target_arch = "x86_64", not(miri))))]
        Self::Words
    }

    /// Copies `words` words if they are one or more whole cache lines. Otherwise copies nothing and returns false.
    ///
    /// # Safety
    /// `self` comes from [`Self::detect`]. Both `from` and `to` have `words` words and do not overlap. At most one of
    /// them is shared, the other private. Trust a copy from shared memory only as the head of this file says.
    #[inline(always)]
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    pub(super) unsafe fn copy(self, from: *const u64, to: *mut u64, words: usize) -> bool {
        if words == 0 || !words.is_multiple_of(LINE_WORDS) {
            return false;
        }
        match self {
            Self::Words => return false,
            // SAFETY: the processor has AVX, as was detected, and the caller vouches for the memory; nothing beyond
            // `words` is touched. `vzeroupper` clears the registers declared lost. No `nomem`, no `pure`: see the head
            // of this file.
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
            // SAFETY: as above; every x86-64 processor has SSE2.
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
    pub(super) unsafe fn copy(self, _from: *const u64, _to: *mut u64, _words: usize) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A value that no test copies.
    const GUARD: u64 = 0xA5A5_A5A5_A5A5_A5A5;

    fn all() -> Vec<WideCopy> {
        let all = vec![WideCopy::Words, WideCopy::detect()];
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        let all = [all, vec![WideCopy::Sse2]].concat();
        all
    }

    /// Copies `values`, `from` and `to` words behind the start of a cache line; returns the result and the whole
    /// destination: guard, copy, guard.
    fn copied(copy: WideCopy, values: &[u64], from: usize, to: usize) -> (bool, Vec<u64>) {
        // Aligned to 64 bytes, whatever the allocator returns.
        let aligned = |memory: &[u64]| memory.as_ptr().align_offset(64);
        let length = values.len() + 3 * LINE_WORDS;
        let (mut source, mut destination) = (vec![GUARD; length], vec![GUARD; length]);
        let (from, to) = (aligned(&source) + from, aligned(&destination) + to);
        source[from..from + values.len()].copy_from_slice(values);
        let (start, end) = (source[from..].as_ptr(), destination[to..].as_mut_ptr());
        // SAFETY: both have room for the values behind these places, and do not overlap.
        let done = unsafe { copy.copy(start, end, values.len()) };
        let copied = destination.split_off(to);
        assert!(destination.iter().all(|word| *word == GUARD), "something before was written");
        (done, copied)
    }

    /// The result of a copy word by word.
    fn by_word(values: &[u64], room: usize) -> Vec<u64> {
        let mut expected = vec![GUARD; room];
        for (to, value) in expected.iter_mut().zip(values) {
            *to = *value;
        }
        expected
    }

    #[test]
    fn every_length_and_alignment_is_copied_as_word_by_word() {
        for copy in all() {
            for words in 0..=12 * LINE_WORDS {
                let values: Vec<u64> = (1..=words as u64).collect();
                for (from, to) in (0..LINE_WORDS).flat_map(|from| (0..LINE_WORDS).map(move |to| (from, to))) {
                    let (done, found) = copied(copy, &values, from, to);
                    let whole = words > 0 && words.is_multiple_of(LINE_WORDS) && copy != WideCopy::Words;
                    assert_eq!(done, whole, "{copy:?} {words}");
                    let expected = by_word(if whole { &values } else { &[] }, found.len());
                    assert_eq!(found, expected, "{copy:?}: {words} words from {from} to {to}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn any_contents_are_copied_as_word_by_word(
            values in prop::collection::vec(any::<[u64; LINE_WORDS]>(), 1..80),
            from in 0..LINE_WORDS,
            to in 0..LINE_WORDS,
        ) {
            let values = values.as_flattened();
            for copy in all().into_iter().filter(|copy| *copy != WideCopy::Words) {
                let (done, found) = copied(copy, values, from, to);
                prop_assert!(done);
                prop_assert_eq!(&found, &by_word(values, found.len()));
            }
        }
    }
}
