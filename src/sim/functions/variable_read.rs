//! PMAC's half of the background variable read (DPRAM manual pp. 21-24).
//!
//! With I55=1 and 1 to 128 entries, in each background pass. Single-user (bit 8 of the control word clear): when bit 0
//! is clear, all registers are copied, then the timer, then bit 0 is set. Multi-user: every entry whose bit 15 is clear is
//! copied and its bit 15 set; the timer is stored in every pass and the control word is PMAC's to read only. An entry
//! is an address and a type: 0 Y, 1 long, 2 X, 4 PLCC function block. The data follow the last entry: each 24-bit word
//! sign-extended to a long, Y half first.
//!
//! What the manual leaves open: a count above 128 or a table that does not fit into $D200-$DFFF is not acted on; a
//! function block is taken to be one long register, the block's number behind the base address in Y:$9FFF; the other
//! types are copied as Y.

use std::ops::Range;

use crate::format::int24;
use crate::map::classic::{
    DATA_READY, VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_READY, VARIABLE_READ_MULTI_USER,
};
use crate::sim::board::memory::Memory;
use crate::sim::board::{Board, offsets};
use crate::sim::fault::Delay;

/// Type bits of an entry's second word.
const TYPE: u16 = 0b111;
const Y: u16 = 0;
const LONG: u16 = 1;
const X: u16 = 2;
const SPECIAL: u16 = 4;

/// One entry of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Entry {
    address: u16,
    kind: u16,
    /// Byte offset of its type word.
    flag: u16,
    /// Byte offset of its data.
    data: u16,
}

impl Entry {
    fn longs(self) -> u16 {
        if matches!(self.kind, LONG | SPECIAL) { 2 } else { 1 }
    }
}

/// What the function remembers.
#[derive(Debug, Clone, Default)]
pub struct VariableRead {
    start: u16,
    table: Vec<Entry>,
    /// Which entries' data PMAC has written since the table is as it is.
    written: Vec<bool>,
    /// PMAC has stored the timer since then.
    announced: bool,
    delay: Delay,
    /// Entries whose data are still to be written although they are ready.
    rest: Vec<usize>,
}

impl VariableRead {
    /// The bytes that table and data take, while the function runs.
    #[must_use]
    pub fn span(&self) -> Option<Range<u32>> {
        let last = self.table.last()?;
        Some(u32::from(offsets::open_offset(self.start)?)..u32::from(last.data) + 4 * u32::from(last.longs()))
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        if board.variables.i(55) != 1.0 {
            *self = Self::default();
            return;
        }
        let control = board.memory.dpram.read16(offsets::VARIABLE_READ_CONTROL);
        let multi_user = control & VARIABLE_READ_MULTI_USER != 0;
        let table = match table(&board.memory) {
            Ok(table) => table,
            Err(what) => {
                board.judge.state(cycle, "variable read", Some(what));
                *self = Self::default();
                return;
            }
        };
        if table.is_empty() {
            *self = Self::default();
            board.judge.state(cycle, "variable read", None);
            return;
        }
        let start = board.memory.dpram.read16(offsets::VARIABLE_READ_START);
        if table != self.table || start != self.start {
            *self = Self { start, written: vec![false; table.len()], table, ..Self::default() };
        }
        self.judge(control, board);
        let fault = board.faults.variable_read.clone();
        for index in std::mem::take(&mut self.rest) {
            store(self.table[index], &mut board.memory);
        }
        if fault.stuck {
            return;
        }
        let due: Vec<usize> = (0..self.table.len())
            .filter(|&index| {
                if multi_user {
                    board.memory.dpram.read16(self.table[index].flag) & VARIABLE_READ_ENTRY_READY == 0
                } else {
                    control & DATA_READY == 0
                }
            })
            .collect();
        if !due.is_empty() && self.delay.over(fault.late) {
            board.memory.dpram.order_reads();
            let now = if fault.torn { due.len() / 2 } else { due.len() };
            for &index in &due[..now] {
                store(self.table[index], &mut board.memory);
            }
            self.rest = due[now..].to_vec();
            board.memory.dpram.order_writes();
            self.announce(&due, multi_user, board);
        } else if multi_user {
            self.store_timer(board);
        }
    }

    /// Timer and ready bits. In multi-user mode the timer comes last, as the manual has it.
    fn announce(&mut self, due: &[usize], multi_user: bool, board: &mut Board) {
        for &index in due {
            self.written[index] = true;
        }
        if multi_user {
            for &index in due {
                let entry = self.table[index];
                let flag = board.memory.dpram.read16(entry.flag) | VARIABLE_READ_ENTRY_READY;
                board.memory.dpram.write16(entry.flag, flag);
            }
            self.store_timer(board);
        } else {
            self.store_timer(board);
            let control = board.memory.dpram.read16(offsets::VARIABLE_READ_CONTROL);
            board.memory.dpram.order_writes();
            board.memory.dpram.write16(offsets::VARIABLE_READ_CONTROL, control | DATA_READY);
        }
    }

    fn store_timer(&mut self, board: &mut Board) {
        let timer = board.memory.read_x(offsets::SERVO_COUNTER) as u16;
        board.memory.dpram.write16(offsets::VARIABLE_READ_TIMER, timer);
        self.announced = true;
    }

    fn judge(&self, control: u16, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        let dpram = &mut board.memory.dpram;
        let multi_user = control & VARIABLE_READ_MULTI_USER != 0;
        let undefined = self.table.iter().find(|entry| !matches!(entry.kind, Y | LONG | X | SPECIAL));
        let wrong = if let Some(entry) = undefined {
            Some(format!("a variable read entry has type {}: 0, 1, 2 and 4 are defined", entry.kind))
        } else if multi_user && control & DATA_READY != 0 {
            Some("the variable read control word has bits 0 and 8 set".into())
        } else if control & !(VARIABLE_READ_MULTI_USER | DATA_READY) != 0 {
            Some(format!("the variable read control word is 0x{control:04X}"))
        } else {
            None
        };
        let own = dpram.shadow(offsets::VARIABLE_READ_CONTROL);
        let set = control & !own & DATA_READY != 0;
        dpram.adopt(offsets::VARIABLE_READ_CONTROL, control);
        if self.announced {
            board.judge.pmacs_word(offsets::VARIABLE_READ_TIMER, cycle, dpram);
        }
        let written = self.table.iter().zip(&self.written).filter(|(_, written)| **written);
        for (entry, _) in written {
            for word in 0..2 * entry.longs() {
                board.judge.pmacs_word(entry.data + 2 * word, cycle, dpram);
            }
        }
        if set && self.announced && !multi_user {
            board.judge.record(cycle, "the host set the variable read's Data-Ready, which it only clears");
        }
        board.judge.state(cycle, "variable read", wrong);
    }
}

/// The table as the header describes it; empty when the count is 0.
fn table(memory: &Memory) -> Result<Vec<Entry>, String> {
    let dpram = &memory.dpram;
    let count = dpram.read16(offsets::VARIABLE_READ_COUNT);
    if count == 0 {
        return Ok(Vec::new());
    }
    if usize::from(count) > VARIABLE_READ_ENTRIES {
        return Err(format!("{count} variables to read: 1 to {VARIABLE_READ_ENTRIES} are allowed"));
    }
    dpram.order_reads();
    let start = dpram.read16(offsets::VARIABLE_READ_START);
    let Some(first) = offsets::open_offset(start) else {
        return Err(format!("the variable read table starts at ${start:04X}, not in $D200-$DFFD"));
    };
    let too_long = || format!("the variable read table at ${start:04X} goes beyond $DFFF");
    let end = offsets::LENGTH as u16;
    let mut data = first + 4 * count;
    if data > end {
        return Err(too_long());
    }
    let mut table = Vec::with_capacity(count.into());
    for flag in (first..first + 4 * count).step_by(4).map(|at| at + 2) {
        let kind = dpram.read16(flag) & TYPE;
        let entry = Entry { address: dpram.read16(flag - 2), kind, flag, data };
        data += 4 * entry.longs();
        table.push(entry);
    }
    if data > end { Err(too_long()) } else { Ok(table) }
}

fn store(entry: Entry, memory: &mut Memory) {
    let address = match entry.kind {
        SPECIAL => (memory.read_y(offsets::FUNCTION_BLOCKS) as u16).wrapping_add(entry.address),
        _ => entry.address,
    };
    let [y, x] = [memory.read_y(address), memory.read_x(address)].map(int24::extend);
    memory.dpram.write32(entry.data, if entry.kind == X { x } else { y });
    if entry.longs() == 2 {
        memory.dpram.write32(entry.data + 4, x);
    }
}

#[cfg(test)]
#[path = "variable_read_tests.rs"]
mod tests;
