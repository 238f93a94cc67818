//! The users of each stretch of the DPRAM's user area.
//!
//! The host places the variable read table, the variable write records and the rotary buffers, `DEFINE GATHER` the
//! gather buffer. The board does not keep them apart (manual pp. 22, 24, 25); the judge reports an overlap.

use std::ops::Range;

use crate::sim::board::Board;

/// A user's name and its bytes in the DPRAM, if it has any.
pub type Span<'a> = (&'a str, Option<Range<u32>>);

/// The stretches in use at the last pass.
#[derive(Debug, Clone, Default)]
pub struct BufferOwners {
    known: Vec<(String, Range<u32>)>,
}

impl BufferOwners {
    /// Looks for overlaps when something has moved.
    pub fn poll<'a>(&mut self, spans: impl Iterator<Item = Span<'a>>, board: &mut Board) {
        let gather = board.gather.span(&board.variables);
        let all = spans.chain([("the gather buffer", gather)]);
        let now: Vec<_> = all.filter_map(|(name, span)| Some((name, span?))).collect();
        let known = |span: &(&str, Range<u32>)| {
            self.known.iter().any(|(name, range)| *name == span.0 && *range == span.1)
        };
        if now.len() == self.known.len() && now.iter().all(known) {
            return;
        }
        for (index, (name, span)) in now.iter().enumerate() {
            for (other, others) in &now[index + 1..] {
                let moved = !known(&(name, span.clone())) || !known(&(other, others.clone()));
                if moved && span.start < others.end && others.start < span.end {
                    let cycle = board.stats.servo_cycles;
                    let what = format!(
                        "{name} (0x{:04X}-0x{:04X}) and {other} (0x{:04X}-0x{:04X}) overlap",
                        span.start,
                        span.end - 1,
                        others.start,
                        others.end - 1
                    );
                    board.judge.record(cycle, &what);
                }
            }
        }
        self.known = now.into_iter().map(|(name, span)| (name.to_owned(), span)).collect();
    }
}
