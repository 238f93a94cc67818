//! PMAC's half of the background variable read (DPRAM manual pp. 21-24).
//!
//! Works with I55=1 and 1 to 128 entries, once a background pass. An entry is an address and a kind
//! ([`VariableKind`]). The data follow the last entry: each 24-bit word sign-extended to a long, Y half first.
//!
//! Single-user: when the ready bit is clear, PMAC copies all registers, then the timer, then sets the bit. Multi-user:
//! PMAC copies every entry whose own ready bit is clear and sets that; it stores the timer in every pass and only reads
//! the control word.
//!
//! The manual leaves open, and the simulator decides:
//! * PMAC does not act on a count above 128, or on a table that does not fit into the user area.
//! * A function block is one long register. The block's number counts from the base address that PMAC keeps.
//! * Other kinds are copied as Y.

use std::ops::Range;

use crate::format::int24;
use crate::map::HostOffset;
use crate::map::functions::{
    Timer, VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_READY, VARIABLE_READ_ENTRY_WORDS, VariableKind,
};
use crate::sim::board::Board;
use crate::sim::board::memory::Memory;
use crate::sim::fault::Delay;
use crate::sim::functions::user_area;

/// One entry of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Entry {
    address: u32,
    /// The type, and its code.
    kind: Option<VariableKind>,
    code: u16,
    /// Its type word.
    flag: HostOffset,
    /// Its data.
    data: HostOffset,
}

impl Entry {
    /// 16-bit words of its data. An undefined type is copied as Y.
    fn words(self) -> usize {
        self.kind.map_or(2, VariableKind::words)
    }
}

/// The state of the function.
#[derive(Debug, Clone, Default)]
pub struct VariableRead {
    /// The place of the table.
    first: Option<HostOffset>,
    table: Vec<Entry>,
    /// Whether PMAC has written the data of each entry of the present table.
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
        Some(self.first?.bytes()..last.data.plus_words(last.words()).bytes())
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        let family = board.family();
        let function = &family.variable_read;
        if !board.enabled(family.i.variables_enable) {
            *self = Self::default();
            return;
        }
        let control = board.memory.dpram.read16(function.ready.word);
        let multi_user = function.multi_user.is_set(control);
        let (first, table) = match table(board) {
            Ok(found) => found,
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
        if table != self.table || first != self.first {
            *self = Self { first, written: vec![false; table.len()], table, ..Self::default() };
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
                    !function.ready.is_set(control)
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
            let ready = board.family().variable_read.ready;
            let control = board.memory.dpram.read16(ready.word);
            board.memory.dpram.order_writes();
            board.memory.dpram.write16(ready.word, control | ready.mask);
        }
    }

    fn store_timer(&mut self, board: &mut Board) {
        let timer = Timer { low: board.family().variable_read.timer, low_bits: 16, high: None };
        let count = board.servo_counter();
        board.memory.dpram.store_timer(timer, count);
        self.announced = true;
    }

    fn judge(&self, control: u16, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        let function = &board.family().variable_read;
        let dpram = &mut board.memory.dpram;
        let multi_user = function.multi_user.is_set(control);
        let ready = function.ready.is_set(control);
        let undefined = self.table.iter().find(|entry| entry.kind.is_none());
        let wrong = if let Some(entry) = undefined {
            Some(format!("a variable read entry has type {}: 0, 1, 2 and 4 are defined", entry.code))
        } else if multi_user && ready {
            Some("the variable read control word has bits 0 and 8 set".into())
        } else if control & !(function.multi_user.mask | function.ready.mask) != 0 {
            Some(format!("the variable read control word is 0x{control:04X}"))
        } else {
            None
        };
        let set = ready && !function.ready.is_set(dpram.shadow(function.ready.word));
        dpram.adopt(function.ready.word, control);
        if self.announced {
            board.judge.pmacs_word(function.timer, cycle, dpram);
        }
        let written = self.table.iter().zip(&self.written).filter(|(_, written)| **written);
        for (entry, _) in written {
            for word in 0..entry.words() {
                board.judge.pmacs_word(entry.data.plus_words(word), cycle, dpram);
            }
        }
        if set && self.announced && !multi_user {
            board.judge.record(cycle, "the host set the variable read's Data-Ready, which it only clears");
        }
        board.judge.state(cycle, "variable read", wrong);
    }
}

/// The place of the table, and the table that the header describes; empty when the count is 0.
fn table(board: &Board) -> Result<(Option<HostOffset>, Vec<Entry>), String> {
    let family = board.family();
    let function = &family.variable_read;
    let dpram = &board.memory.dpram;
    let count = usize::from(dpram.read16(function.count));
    if count == 0 {
        return Ok((None, Vec::new()));
    }
    if count > VARIABLE_READ_ENTRIES {
        return Err(format!("{count} variables to read: 1 to {VARIABLE_READ_ENTRIES} are allowed"));
    }
    dpram.order_reads();
    let start = dpram.read16(function.start);
    let Some(first) = user_area::place(family, start) else {
        let area = user_area::bounds(family);
        return Err(format!("the variable read table starts at ${start:04X}, not in {area}"));
    };
    let too_long = || format!("the variable read table at ${start:04X} goes beyond the DPRAM's end");
    let mut words = VARIABLE_READ_ENTRY_WORDS * count;
    if !user_area::has_room(family, first, words) {
        return Err(too_long());
    }
    let mut table = Vec::with_capacity(count);
    for index in 0..count {
        let entry = entry(board, first, index, first.plus_words(words));
        words += entry.words();
        table.push(entry);
    }
    if user_area::has_room(family, first, words) { Ok((Some(first), table)) } else { Err(too_long()) }
}

/// Entry `index` of the table at `first`, whose data go to `data`.
fn entry(board: &Board, first: HostOffset, index: usize, data: HostOffset) -> Entry {
    let [at, flag] = [0, 1].map(|word| first.plus_words(VARIABLE_READ_ENTRY_WORDS * index + word));
    let words = [at, flag].map(|word| board.memory.dpram.read16(word));
    let code = board.family().variable_read.kind_code(words[1]);
    Entry { address: words[0].into(), kind: VariableKind::of_code(code), code, flag, data }
}

fn store(entry: Entry, memory: &mut Memory) {
    let address = match entry.kind {
        Some(VariableKind::Special) => memory.read(memory.registers().function_blocks) + entry.address,
        _ => entry.address,
    };
    let [y, x] = [memory.read_y(address), memory.read_x(address)].map(int24::extend);
    memory.dpram.write32(entry.data, if entry.kind == Some(VariableKind::X) { x } else { y });
    if entry.words() == 4 {
        memory.dpram.write32(entry.data.plus_words(2), x);
    }
}

#[cfg(test)]
#[path = "variable_read_tests.rs"]
mod tests;
