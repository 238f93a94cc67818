//! The DPRAM while the host cannot reach it, because a fault hides the DPRAM or the host has not selected its page.
//!
//! The host then reads all ones or zeros. Without its page the DPRAM stands still: its functions rest, but the writes
//! of PMAC's own commands count.

use super::servo_report::ServoReport;
use crate::sim::board::Board;

/// The memory's content before it went out of reach.
#[derive(Debug, Clone, Default)]
pub struct Reach {
    before: Option<Vec<u16>>,
}

impl Reach {
    /// Puts all ones (or zeros) into the whole DPRAM while it is out of reach, and the old content back afterwards. In
    /// place of another page, which the host may write meanwhile, it puts zeros once.
    pub fn poll(&mut self, board: &mut Board, page_selected: bool, report: &mut ServoReport) {
        let dpram = &mut board.memory.dpram;
        let words = dpram.words();
        board.out_of_reach = board.faults.hides_memory() || !page_selected;
        if board.out_of_reach {
            let shows_other = board.faults.other_page && !board.faults.hides_memory();
            let reads = if board.faults.all_zeros || shows_other { 0 } else { 0xFFFF };
            let fresh = self.before.is_none();
            let before =
                self.before.get_or_insert_with(|| words.clone().map(|offset| dpram.read16(offset)).collect());
            for (offset, before) in words.zip(before) {
                let found = dpram.read16(offset);
                if !fresh && found != reads && found == dpram.shadow(offset) {
                    *before = found;
                }
                if found != reads && (fresh || !shows_other) {
                    dpram.disturb(offset, reads);
                }
            }
            return;
        }
        let Some(before) = self.before.take() else { return };
        let status = board.identity.tables.family.servo.pmac_status.word;
        let hidden = dpram.read16(status);
        for (offset, value) in words.zip(&before).filter(|(offset, _)| *offset != status) {
            dpram.disturb(offset, *value);
        }
        // The board did not stand still meanwhile: the status word of before is not to be seen again beside the old data.
        report.cycle(board);
        if board.memory.dpram.read16(status) == hidden {
            board.memory.dpram.disturb(status, before[status.word()]);
        }
    }
}
