//! PMAC's half of the DPRAM's functions, and of the ports beside the DPRAM.
//!
//! A function has its own state. It changes the board, and some functions start programs. A function never waits: each
//! [`poll`](Functions::poll) does the work of one background pass of the board. The board's [`Family`] has the
//! addresses of the functions' words.

pub mod ascii;
#[cfg(test)]
mod ascii_tests;
pub mod background_report;
mod buffer_owners;
mod copies;
pub mod host_port;
pub mod mailbox;
pub mod panel;
pub mod reach;
pub mod requests;
pub mod rotary;
pub mod servo_report;
mod user_area;
pub mod variable_read;
pub mod variable_write;

use buffer_owners::BufferOwners;
use panel::Panel;
use rotary::RotaryTransfer;
use variable_read::VariableRead;
use variable_write::VariableWrite;

use crate::map::Family;
use crate::sim::board::Board;
use crate::sim::program::Programs;

/// The functions that work by flags in the background pass, and the users of each stretch of the DPRAM's user area.
#[derive(Debug, Clone)]
pub struct Functions {
    panel: Panel,
    variable_read: VariableRead,
    variable_write: VariableWrite,
    /// The binary rotary buffers.
    rotary: Vec<RotaryTransfer>,
    buffer_owners: BufferOwners,
}

impl Functions {
    /// The functions of `family`.
    #[must_use]
    pub fn new(family: &Family) -> Self {
        let headers = family.rotary.headers.iter().zip(1..);
        Self {
            panel: Panel::default(),
            variable_read: VariableRead::default(),
            variable_write: VariableWrite::default(),
            rotary: headers.map(|(&header, number)| RotaryTransfer::new(number, header)).collect(),
            buffer_owners: BufferOwners::default(),
        }
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs) {
        self.panel.poll(board, programs);
        self.variable_write.poll(board);
        if board.watchdog {
            return;
        }
        self.variable_read.poll(board);
        for rotary in &mut self.rotary {
            rotary.poll(board, programs);
        }
        let tables = [
            ("the variable read table", self.variable_read.span()),
            ("the variable write records", self.variable_write.span()),
        ];
        let buffers = self.rotary.iter().map(|rotary| (rotary.name(), rotary.span()));
        self.buffer_owners.poll(tables.into_iter().chain(buffers), board);
    }
}
