//! Who uses which stretch of the DPRAM's open part ($D200-$DFFF).
//!
//! The host places the variable read table, the variable write records and the rotary buffers, `DEFINE GATHER` the
//! gather buffer; nothing on the board keeps them apart (manual pp. 22, 24, 25). The judge does.

use std::ops::Range;

use crate::sim::board::Board;

/// A user's name and its bytes in the DPRAM, if it has any.
pub type Span = (&'static str, Option<Range<u32>>);

/// The stretches in use at the last pass.
#[derive(Debug, Clone, Default)]
pub struct BufferOwners {
    known: Vec<(&'static str, Range<u32>)>,
}

impl BufferOwners {
    /// Looks for overlaps when something has moved.
    pub fn poll(&mut self, spans: &[Span], board: &mut Board) {
        let gather = board.gather.span(&board.variables);
        let all = spans.iter().cloned().chain([("the gather buffer", gather)]);
        let now: Vec<_> = all.filter_map(|(name, span)| Some((name, span?))).collect();
        if now == self.known {
            return;
        }
        for (index, (name, span)) in now.iter().enumerate() {
            for (other, others) in &now[index + 1..] {
                let fresh = |pair: &(&'static str, Range<u32>)| !self.known.contains(pair);
                let moved = fresh(&(name, span.clone())) || fresh(&(other, others.clone()));
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
        self.known = now;
    }
}
