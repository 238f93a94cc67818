//! PMAC's half of the DPRAM's functions, and of the ports beside it.
//!
//! A function has its own state and changes the board, and the programs where it starts some. It never waits: each
//! [`poll`](Functions::poll) does what one background pass of the board does.

pub mod ascii;
#[cfg(test)]
mod ascii_tests;
pub mod background_report;
mod buffer_owners;
pub mod host_port;
pub mod mailbox;
pub mod panel;
pub mod reach;
pub mod requests;
pub mod rotary;
pub mod servo_report;
pub mod variable_read;
pub mod variable_write;

use buffer_owners::BufferOwners;
use panel::Panel;
use rotary::RotaryTransfer;
use variable_read::VariableRead;
use variable_write::VariableWrite;

use crate::sim::board::Board;
use crate::sim::program::Programs;

/// The functions that work by flags in the background pass, and who uses which stretch of the DPRAM's user area.
#[derive(Debug, Clone, Default)]
pub struct Functions {
    panel: Panel,
    variable_read: VariableRead,
    variable_write: VariableWrite,
    /// The first and the second binary rotary buffer.
    rotary: [RotaryTransfer; 2],
    buffer_owners: BufferOwners,
}

impl Functions {
    /// One background pass.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs) {
        self.panel.poll(board, programs);
        self.variable_write.poll(board);
        if board.watchdog {
            return;
        }
        self.variable_read.poll(board);
        for (number, rotary) in self.rotary.iter_mut().enumerate() {
            rotary.poll(number, board, programs);
        }
        let spans = [
            ("the variable read table", self.variable_read.span()),
            ("the variable write records", self.variable_write.span()),
            ("the first rotary buffer", self.rotary[0].span()),
            ("the second rotary buffer", self.rotary[1].span()),
        ];
        self.buffer_owners.poll(&spans, board);
    }
}
