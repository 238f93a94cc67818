//! PMAC's half of the background variable write (DPRAM manual pp. 24-25).
//!
//! With I55=1 and 1 to 32 at 0x07D4: that many records of six 16-bit words, from the PMAC address at 0x07D6 on, are
//! written into PMAC, then the count is set to 0. The count is seen in one background pass and acted on in the next, so
//! that a host that goes on writing after it is found out. A record is address, type, data 1 low and high, data 2 low
//! and high; its type word holds type (bits 0-2), width (3-7, 0 is 24), offset (8-12) and special type (13-15). An X or
//! Y word takes the low bits of data 1 at the offset, its other bits stay; a long register takes 48 bits, 32 from data 1
//! and 16 from data 2, whatever width and offset say.
//!
//! A register at address 0 is the servo clock: the watchdog trips and the board is dead until a reset.
//!
//! What the manual leaves open: a count above 32 or records that do not fit into $D200-$DFFF are not acted on; a width
//! that is not in the table is taken as it is, bits beyond bit 23 are lost; a record of an undefined type or special type
//! is skipped; types 4 and 6 write the Y and X word of a function block as the variable read takes it.

use std::ops::Range;

use crate::format::{join32, write48};
use crate::map::classic::{VARIABLE_WRITE_RECORD_WORDS as WORDS, VARIABLE_WRITE_RECORDS};
use crate::sim::board::{Board, offsets};
use crate::sim::fault::Delay;

/// The widths of the manual's table; 0 is 24.
const WIDTHS: [u16; 7] = [0, 1, 4, 8, 12, 16, 20];
/// Bits of a register.
const REGISTER: u16 = 24;

const Y: u16 = 0;
const LONG: u16 = 1;
const X: u16 = 2;
const SPECIAL_Y: u16 = 4;
const SPECIAL_X: u16 = 6;

/// One record, as the host wrote it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Record {
    address: u16,
    kind: u16,
    data: [u32; 2],
}

impl Record {
    fn width(self) -> u16 {
        match self.kind >> 3 & 0x1F {
            0 => REGISTER,
            width => width,
        }
    }

    fn offset(self) -> u16 {
        self.kind >> 8 & 0x1F
    }

    /// What is wrong with it, if anything.
    fn wrong(self) -> Option<String> {
        let (kind, special, address) = (self.kind & 0b111, self.kind >> 13, self.address);
        if !matches!(kind, Y | LONG | X | SPECIAL_Y | SPECIAL_X) {
            Some(format!("a record for ${address:04X} has type {kind}: 0, 1, 2, 4 and 6 are defined"))
        } else if special != 0 {
            Some(format!("a record for ${address:04X} has special type {special}, which is reserved"))
        } else if kind == LONG {
            None
        } else if !WIDTHS.contains(&(self.kind >> 3 & 0x1F)) || self.offset() + self.width() > REGISTER {
            let (width, offset) = (self.width(), self.offset());
            Some(format!("a record for ${address:04X} has width {width} at offset {offset}"))
        } else {
            None
        }
    }
}

/// Count, start and records.
type Request = (u16, u16, Vec<Record>);

/// What the function remembers.
#[derive(Debug, Clone, Default)]
pub struct VariableWrite {
    /// The request as it was at the last pass.
    seen: Option<Request>,
    delay: Delay,
    /// Records still to be written although the count is 0.
    rest: Vec<Record>,
}

impl VariableWrite {
    /// The bytes that the records take, while there are some.
    #[must_use]
    pub fn span(&self) -> Option<Range<u32>> {
        let (count, start, _) = self.seen.as_ref()?;
        let first = u32::from(offsets::open_offset(*start)?);
        Some(first..first + 2 * WORDS as u32 * u32::from(*count))
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board) {
        let cycle = board.stats.servo_cycles;
        if board.variables.i(55) != 1.0 {
            *self = Self::default();
            return;
        }
        write_all(&std::mem::take(&mut self.rest), board);
        let request = match request(board) {
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
        let (_, _, mut records) = request;
        if fault.torn {
            self.rest = records.split_off(records.len() / 2);
        }
        write_all(&records, board);
        if board.watchdog {
            return;
        }
        self.seen = None;
        board.memory.dpram.order_writes();
        board.memory.dpram.write16(offsets::VARIABLE_WRITE_COUNT, 0);
    }
}

/// What the host asks for; `None` when the count is 0.
fn request(board: &Board) -> Result<Option<Request>, String> {
    let dpram = &board.memory.dpram;
    let count = dpram.read16(offsets::VARIABLE_WRITE_COUNT);
    if count == 0 {
        return Ok(None);
    }
    if usize::from(count) > VARIABLE_WRITE_RECORDS {
        return Err(format!("{count} variables to write: 1 to {VARIABLE_WRITE_RECORDS} are allowed"));
    }
    dpram.order_reads();
    let start = dpram.read16(offsets::VARIABLE_WRITE_START);
    let Some(first) = offsets::open_offset(start) else {
        return Err(format!("the variable write records start at ${start:04X}, not in $D200-$DFFD"));
    };
    let length = 2 * WORDS as u16;
    if first + length * count > offsets::LENGTH as u16 {
        return Err(format!("{count} variable write records at ${start:04X} go beyond $DFFF"));
    }
    let records = (0..count)
        .map(|index| {
            let word = |number: u16| dpram.read16(first + length * index + 2 * number);
            let data = [join32(word(2), word(3)), join32(word(4), word(5))];
            Record { address: word(0), kind: word(1), data }
        })
        .collect();
    Ok(Some((count, start, records)))
}

/// Writes record by record; a write to the servo clock is the last one.
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
    let Record { address, kind, data } = record;
    if kind >> 13 != 0 {
        return;
    }
    let memory = &mut board.memory;
    let block = (memory.read_y(offsets::FUNCTION_BLOCKS) as u16).wrapping_add(address);
    let field = |old: u32| {
        let mask = (((1u64 << record.width()) - 1) << record.offset()) as u32;
        old & !mask | (u64::from(data[0]) << record.offset()) as u32 & mask
    };
    match kind & 0b111 {
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
    if address == offsets::SERVO_COUNTER && matches!(kind & 0b111, Y | X | LONG) {
        let cycle = board.stats.servo_cycles;
        board.judge.record(cycle, "a variable write went to address 0, the servo clock: the watchdog trips");
        board.watchdog = true;
    }
}

#[cfg(test)]
#[path = "variable_write_tests.rs"]
mod tests;
