//! Keeps the order in which the daemon asks a board where its M-variables point. The order answers none of the
//! questions.
//!
//! The first blocks are those in which the daemon last found a definition that points into the DPRAM. The blocks that
//! sites use follow.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// M-variables of a block: a Turbo board has as many blocks as a word has bits.
pub const BLOCK: u16 = 128;
/// Sites define their M-variables below the first of these numbers and from the second on: the usual M-variables of
/// motors and systems, and those of programs for trajectories.
const LOW: u16 = 1024;
const HIGH: u16 = 4000;

/// The blocks, as bits: bit 0 is the block of M0.
#[derive(Debug, Default)]
pub struct DefinitionBlocks {
    last_time: u64,
    found: AtomicU64,
    is_changed: AtomicBool,
}

impl DefinitionBlocks {
    /// The blocks found `last_time`.
    #[must_use]
    pub const fn new(last_time: u64) -> Self {
        Self { last_time, found: AtomicU64::new(last_time), is_changed: AtomicBool::new(false) }
    }

    /// The spans of `count` M-variables, in the order of the questions.
    #[must_use]
    pub fn order(&self, count: u16) -> Box<[Range<u16>]> {
        let blocks = || (0..count / BLOCK).map(|block| (block, block * BLOCK..(block + 1) * BLOCK));
        let rank = |(block, variables): &(u16, Range<u16>)| match variables {
            _ if self.last_time >> block & 1 != 0 => 0,
            variables if variables.start < LOW || variables.end > HIGH => 1,
            _ => 2,
        };
        let mut spans: Vec<Range<u16>> = Vec::new();
        for (_, next) in (0..3).flat_map(|wanted| blocks().filter(move |block| rank(block) == wanted)) {
            match spans.last_mut() {
                Some(last) if last.end == next.start => last.end = next.end,
                _ => spans.push(next),
            }
        }
        spans.into()
    }

    /// The board has told all its definitions: these blocks have some that point into the DPRAM.
    pub fn set(&self, found: u64) {
        if self.found.swap(found, Ordering::Relaxed) != found {
            self.is_changed.store(true, Ordering::Release);
        }
    }

    /// The blocks found, if they have changed since the last call.
    pub fn take_changed(&self) -> Option<u64> {
        self.is_changed.swap(false, Ordering::Acquire).then(|| self.found.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blocks_of_last_time_come_first_then_those_that_sites_use() {
        let lists = |count, last_time| {
            let order = DefinitionBlocks::new(last_time).order(count);
            order.iter().map(|span| (span.start, span.end)).collect::<Vec<_>>()
        };
        assert_eq!(lists(1024, 0), [(0, 1024)]);
        assert_eq!(lists(1024, 0b100), [(256, 384), (0, 256), (384, 1024)]);
        assert_eq!(lists(8192, 0), [(0, 1024), (3968, 8192), (1024, 3968)]);
        assert_eq!(
            lists(8192, 1 << 16 | 1 << 63),
            [(2048, 2176), (8064, 8192), (0, 1024), (3968, 8064), (1024, 2048), (2176, 3968)]
        );
        for last_time in [0, 1, u64::MAX, 0xAAAA_5555_0F0F_F0F0] {
            let mut all: Vec<u16> =
                DefinitionBlocks::new(last_time).order(8192).iter().cloned().flatten().collect();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..8192), "each once: {last_time:x}");
        }
    }
}
