//! PMAC's half of the background variable write (DPRAM manual pp. 24-25).
//!
//! With I55=1, from firmware 1.15G on, and a count of 1 to 32, PMAC writes that many records into its registers and
//! sets the count to 0. PMAC sees the count in one background pass and acts in the next, to catch a host that goes on
//! writing after it.
//!
//! A record is six 16-bit words: address, type, data 1 low and high, data 2 low and high. The type word holds kind,
//! width (0 is 24), offset and special type. An X or Y word takes the low bits of data 1 at the offset and keeps its other
//! bits. A long register takes 48 bits, 32 from data 1 and 16 from data 2, whatever width and offset say.
//!
//! The register at address 0 is the servo clock: a write there trips the watchdog, and the board is dead until a reset.
//!
//! A board does nothing if no manual describes its family's records.
//!
//! The manual leaves open, and the simulator decides:
//! * PMAC does not act on a count above 32, or on records that do not fit into the user area.
//! * PMAC accepts a width that the manual's table does not have, and loses bits beyond bit 23.
//! * PMAC skips a record of an undefined kind or special type.
//! * Kinds 4 and 6 write the Y and X word of a function block, which the variable read copies as one long register.

use std::ops::Range;

use crate::format::{join32, write48};
use crate::map::functions::{
    RECORD_OFFSET, RECORD_SPECIAL, RECORD_WIDTH, VARIABLE_WRITE_RECORD_WORDS as WORDS, VARIABLE_WRITE_RECORDS,
};
use crate::map::{Family, HostOffset};
use crate::sim::board::Board;
use crate::sim::fault::Delay;
use crate::sim::functions::user_area;

/// The widths of the manual's table; 0 is 24.
const WIDTHS: [u16; 7] = [0, 1, 4, 8, 12, 16, 20];
/// Bits of a register.
const REGISTER: u16 = 24;

const Y: u16 = 0;
const LONG: u16 = 1;
const X: u16 = 2;
const SPECIAL_Y: u16 = 4;
const SPECIAL_X: u16 = 6;

/// A record, as the host wrote it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Record {
    address: u16,
    kind: u16,
    /// The width in the type word: 0 is 24.
    width: u16,
    offset: u16,
    special: u16,
    data: [u32; 2],
}

impl Record {
    fn new(words: [u16; WORDS]) -> Self {
        let [address, word, data @ ..] = words;
        let field = |from: u32, end: u32| word >> from & ((1 << (end - from)) - 1);
        Self {
            address,
            kind: field(0, RECORD_WIDTH),
            width: field(RECORD_WIDTH, RECORD_OFFSET),
            offset: field(RECORD_OFFSET, RECORD_SPECIAL),
            special: word >> RECORD_SPECIAL,
            data: [join32(data[0], data[1]), join32(data[2], data[3])],
        }
    }

    fn width(self) -> u16 {
        if self.width == 0 { REGISTER } else { self.width }
    }

    /// The mistake in the record, if any.
    fn wrong(self) -> Option<String> {
        let Self { address, kind, special, offset, .. } = self;
        if !matches!(kind, Y | LONG | X | SPECIAL_Y | SPECIAL_X) {
            Some(format!("a record for ${address:04X} has type {kind}: 0, 1, 2, 4 and 6 are defined"))
        } else if special != 0 {
            Some(format!("a record for ${address:04X} has special type {special}, which is reserved"))
        } else if kind == LONG {
            None
        } else if !WIDTHS.contains(&self.width) || offset + self.width() > REGISTER {
            let width = self.width();
            Some(format!("a record for ${address:04X} has width {width} at offset {offset}"))
        } else {
            None
        }
    }
}

/// The host's request: the place of the records, and the records.
type Request = (HostOffset, Vec<Record>);

/// The state of the function.
#[derive(Debug, Clone, Default)]
pub struct VariableWrite {
    /// The request at the last pass.
    seen: Option<Request>,
    delay: Delay,
    /// Records still to be written although the count is 0.
    rest: Vec<Record>,
}

impl VariableWrite {
    /// The bytes that the records take; `None` without records.
    #[must_use]
    pub fn span(&self) -> Option<Range<u32>> {
        let (first, records) = self.seen.as_ref()?;
        Some(first.bytes()..first.plus_words(WORDS * records.len()).bytes())
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        let family = board.family();
        let plays = family.variable_write.since.is_some_and(|since| !board.is_older_than(since));
        if !board.enabled(family.i.variables_enable) || !plays {
            *self = Self::default();
            return;
        }
        write_all(&std::mem::take(&mut self.rest), board);
        let request = match request(family, board) {
            Ok(Some(request)) => request,
            Ok(None) => {
                self.seen = None;
                board.judge.state(cycle, "variable write", None);
                return;
            }
            Err(what) => {
                self.seen = None;
                board.judge.state(cycle, "variable write", Some(what));
                return;
            }
        };
        let Some(seen) = self.seen.replace(request.clone()) else { return };
        if seen != request {
            board.judge.record(cycle, "the records of a variable write changed after their count was set");
        }
        let fault = board.faults.variable_write.clone();
        if fault.stuck || !self.delay.over(fault.late) {
            return;
        }
        let (_, mut records) = request;
        if fault.torn {
            self.rest = records.split_off(records.len() / 2);
        }
        write_all(&records, board);
        if board.watchdog {
            return;
        }
        self.seen = None;
        board.memory.dpram.order_writes();
        board.memory.dpram.write16(family.variable_write.count, 0);
    }
}

/// The host's request; `None` when the count is 0.
fn request(family: &Family, board: &Board) -> Result<Option<Request>, String> {
    let function = &family.variable_write;
    let dpram = &board.memory.dpram;
    let count = usize::from(dpram.read16(function.count));
    if count == 0 {
        return Ok(None);
    }
    if count > VARIABLE_WRITE_RECORDS {
        return Err(format!("{count} variables to write: 1 to {VARIABLE_WRITE_RECORDS} are allowed"));
    }
    dpram.order_reads();
    let start = dpram.read16(function.start);
    let Some(first) = user_area::place(family, start) else {
        let area = user_area::bounds(family);
        return Err(format!("the variable write records start at ${start:04X}, not in {area}"));
    };
    if !user_area::has_room(family, first, WORDS * count) {
        return Err(format!("{count} variable write records at ${start:04X} go beyond the DPRAM's end"));
    }
    let records = (0..count).map(|index| {
        let words = std::array::from_fn(|word| dpram.read16(first.plus_words(WORDS * index + word)));
        Record::new(words)
    });
    Ok(Some((first, records.collect())))
}

/// Writes record by record; ends after a write to the servo clock.
fn write_all(records: &[Record], board: &mut Board) {
    for &record in records {
        if board.watchdog {
            return;
        }
        let cycle = board.stats.servo_cycles;
        if let Some(what) = record.wrong() {
            board.judge.record(cycle, &what);
        }
        write(record, board);
    }
}

fn write(record: Record, board: &mut Board) {
    let Record { address, kind, offset, special, data, .. } = record;
    if special != 0 {
        return;
    }
    let memory = &mut board.memory;
    let registers = memory.registers();
    let address = u32::from(address);
    let block = memory.read(registers.function_blocks) + address;
    let field = |old: u32| {
        let mask = (((1u64 << record.width()) - 1) << offset) as u32;
        old & !mask | (u64::from(data[0]) << offset) as u32 & mask
    };
    match kind {
        Y => memory.write_y(address, field(memory.read_y(address))),
        X => memory.write_x(address, field(memory.read_x(address))),
        SPECIAL_Y => memory.write_y(block, field(memory.read_y(block))),
        SPECIAL_X => memory.write_x(block, field(memory.read_x(block))),
        LONG => {
            let [y, x] = write48::unpack(data);
            memory.write_y(address, y);
            memory.write_x(address, x);
        }
        _ => return,
    }
    if matches!(kind, Y | X | LONG) {
        board.register_written(address);
    }
    if address == registers.servo_counter.number && matches!(kind, Y | X | LONG) {
        let cycle = board.stats.servo_cycles;
        board.judge.record(cycle, "a variable write went to address 0, the servo clock: the watchdog trips");
        board.watchdog = true;
    }
}

#[cfg(test)]
#[path = "variable_write_tests.rs"]
mod tests;
