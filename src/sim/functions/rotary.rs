//! PMAC's half of the binary rotary buffers in the DPRAM (DPRAM manual p. 30, which has the first buffer's header only).
//!
//! With I57=1, or while `OPEN BINARY ROTARY` is in force on a Turbo board, each background pass copies the lines
//! between PMAC's index and the host's into the coordinate system's internal rotary buffer while that has room. PMAC's
//! index follows line by line. A line begins with a command whose start-of-line bit is set and ends before the next
//! such command. The end marker at the host's index has that bit too. PMAC sees an advance of the host's index in one
//! pass and takes the lines in the next, to catch a host that still changes them. Indexes and size count 32-bit words.
//! A command takes two of these words, and their low 24 bits count.
//!
//! Status word: bit 14 while the internal buffer does not take the next line; bit 15, with a code in bits 7-0, while the
//! transfer cannot go on.
//!
//! The manual leaves open, and the simulator decides:
//! * The codes are the numbers of the errors that a command line would get: 3 for a header against the rules or a
//!   command that does not exist, 5 without an internal buffer. The error stays as long as its cause, and no index
//!   moves.
//! * A header whose size is 0 is not in use. PMAC owns its index and the status while it transfers and the size is not 0;
//!   the host sets the index up before.
//! * A Turbo board has no I57. Each header belongs to one coordinate system (docs/evidence.md); a header with another
//!   number is an error.
//! * The number of coordinate system 1 in the header is a setting.

use std::ops::Range;

use crate::format::int24;
use crate::map::functions::rotary_header;
use crate::map::{Family, HostOffset};
use crate::sim::board::Board;
use crate::sim::fault::Delay;
use crate::sim::functions::user_area;
use crate::sim::program::Programs;
use crate::sim::program::binary::{Command, START_OF_LINE};
use crate::sim::program::rotary::AppendError;
use crate::sim::program::store::Open;

/// The command that has to be at the host's index.
const END_MARKER: Command = (0x00_0800, 0x00_FFFF);
/// 32-bit words of a command.
const COMMAND: u16 = 2;
/// Smallest buffer in 32-bit words.
const SMALLEST: u16 = 6;
/// Error codes: numbers of command errors.
const BAD_HEADER: u16 = 3;
const NO_COMMAND: u16 = 3;
const NO_BUFFER: u16 = 5;

/// The header as it stands in the DPRAM, and the buffer that its start word names.
#[derive(Debug, Clone, Copy)]
struct Header {
    cs: u16,
    host: u16,
    pmac: u16,
    size: u16,
    start: u16,
    buffer: Option<HostOffset>,
}

/// The transfer out of one buffer.
#[derive(Debug, Clone)]
pub struct RotaryTransfer {
    /// The judge's name for the buffer.
    name: String,
    /// Where its header begins.
    header: HostOffset,
    state: Progress,
}

/// The state of a buffer's transfer.
#[derive(Debug, Clone, Default)]
struct Progress {
    /// I57 was set and the header in use at the last pass.
    running: bool,
    span: Option<Range<u32>>,
    /// PMAC's index at the end of the last pass.
    index: u16,
    /// The commands between the indexes, as they were at the last pass.
    seen: Vec<Command>,
    delay: Delay,
    /// Where PMAC's index goes after a pass in the middle of a line.
    rest: Option<u16>,
}

impl RotaryTransfer {
    /// The transfer out of buffer `number`, from 1, whose header is at `header`.
    #[must_use]
    pub fn new(number: usize, header: HostOffset) -> Self {
        Self { name: format!("rotary buffer {number}"), header, state: Progress::default() }
    }

    /// The judge's name for the buffer.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The bytes that the buffer takes, while it is in use.
    #[must_use]
    pub fn span(&self) -> Option<Range<u32>> {
        self.state.span.clone()
    }

    /// One background pass.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs) {
        let family = board.family();
        let header = self.read_header(board);
        let enabled = match family.i.rotary_enable {
            Some(number) => board.enabled(number),
            None => programs.store.open() == Some(Open::BinaryRotary),
        };
        if !enabled || header.size == 0 {
            self.state = Progress::default();
            return;
        }
        let cycle = board.stats.servo_cycles;
        let [status, index] =
            [rotary_header::STATUS, rotary_header::PMAC_INDEX].map(|word| self.header.plus_words(word));
        let dpram = &mut board.memory.dpram;
        if self.state.running {
            board.judge.pmacs_word(status, cycle, dpram);
            board.judge.pmacs_word(index, cycle, dpram);
        } else {
            // The host may have set the index up until now.
            let found = dpram.read16(index);
            dpram.adopt(index, found);
        }
        self.state.running = true;
        let found = match check(family, header, board.rotary_cs_base).and_then(|cs| self.is_own(family, cs)) {
            Ok(cs) => {
                board.judge.state(cycle, &self.name, None);
                self.transfer(header, cs, board, programs)
            }
            Err(what) => {
                board.judge.state(cycle, &self.name, Some(format!("{}: {what}", self.name)));
                self.state.seen.clear();
                self.state.span = None;
                rotary_header::ERROR | BAD_HEADER
            }
        };
        board.memory.dpram.write16(status, found);
    }

    /// `cs`, unless this is the buffer of another coordinate system.
    fn is_own(&self, family: &Family, cs: usize) -> Result<usize, String> {
        let is_own = family.rotary.headers.get(cs) == Some(&self.header);
        if is_own || !family.rotary.one_a_system {
            return Ok(cs);
        }
        Err(format!("it is not coordinate system {}'s", cs + 1))
    }

    /// Takes all lines that it can; gives the status word.
    fn transfer(&mut self, mut header: Header, cs: usize, board: &mut Board, programs: &mut Programs) -> u16 {
        let first = header.buffer.map_or(0, HostOffset::bytes);
        self.state.span = Some(first..first + 4 * u32::from(header.size));
        if let Some(target) = self.state.rest.take() {
            header.pmac = target;
            self.move_index(target, board);
        }
        if header.pmac != self.state.index {
            self.state.seen.clear();
        }
        let commands = commands(header, board);
        self.judge(header, &commands, board);
        let available = self.state.seen.len().min(commands.len());
        let fault = board.faults.rotary.clone();
        let (mut taken, mut status) = (0, 0);
        if available > 0 && !fault.stuck && self.state.delay.over(fault.late) {
            while taken < available {
                let length = line_length(&commands[taken..available]);
                let line = &commands[taken..taken + length];
                status = append(cs, line, board, programs);
                if status != 0 {
                    break;
                }
                taken += length;
                board.memory.dpram.order_reads();
                let target = (header.pmac + COMMAND * taken as u16) % header.size;
                if fault.torn && length > 1 {
                    self.state.rest = Some(target);
                    let middle = (target + header.size - COMMAND) % header.size;
                    self.move_index(middle, board);
                    break;
                }
                self.move_index(target, board);
            }
        }
        self.state.seen = commands[taken..].to_vec();
        self.state.index = (header.pmac + COMMAND * taken as u16) % header.size;
        status
    }

    fn move_index(&self, to: u16, board: &mut Board) {
        board.memory.dpram.write16(self.header.plus_words(rotary_header::PMAC_INDEX), to);
    }

    fn read_header(&self, board: &Board) -> Header {
        let read = |word| board.memory.dpram.read16(self.header.plus_words(word));
        let start = read(rotary_header::START);
        let header = Header {
            cs: read(rotary_header::COORDINATE_SYSTEM),
            host: read(rotary_header::HOST_INDEX),
            pmac: read(rotary_header::PMAC_INDEX),
            size: read(rotary_header::SIZE),
            start,
            buffer: user_area::place(board.family(), start),
        };
        board.memory.dpram.order_reads();
        header
    }

    fn judge(&self, header: Header, commands: &[Command], board: &mut Board) {
        let Header { host, pmac, size, .. } = header;
        let cycle = board.stats.servo_cycles;
        let known = self.state.seen.len();
        if commands.len() < known {
            board.judge.record(cycle, &format!("the rotary host index went back to {host}"));
        }
        if commands.iter().zip(&self.state.seen).any(|(now, seen)| now != seen) {
            board.judge.record(cycle, "rotary commands changed after the host index had passed them");
        }
        let Some(fresh) = commands.get(known..).filter(|fresh| !fresh.is_empty()) else { return };
        if fresh[0].0 & START_OF_LINE == 0 {
            let at = (pmac + COMMAND * known as u16) % size;
            board.judge.record(cycle, &format!("the rotary host index had split a line at {at}"));
        }
        // A host that is quick has begun to write the next line over the marker; that has the same bit.
        let marker = command(header, host, board);
        let is_marker = marker.0 != END_MARKER.0 || marker == END_MARKER;
        if marker.0 & START_OF_LINE == 0 || !is_marker {
            board.judge.record(cycle, &format!("there is no end marker at the rotary host index {host}"));
        }
        if COMMAND * commands.len() as u16 > size - 4 {
            let what = format!("the rotary host index {host} goes beyond full: PMAC's is {pmac} of {size}");
            board.judge.record(cycle, &what);
        }
    }
}

/// Gives a line to the internal buffer; returns the status word.
fn append(cs: usize, line: &[Command], board: &mut Board, programs: &mut Programs) -> u16 {
    if programs.rotary_remaining(cs).is_none() {
        return rotary_header::ERROR | NO_BUFFER;
    }
    if !programs.rotary_room(cs, line.len()) {
        return rotary_header::BUSY;
    }
    match programs.rotary_append(board, cs, line) {
        Ok(()) => 0,
        Err(AppendError::Full) => rotary_header::BUSY,
        Err(AppendError::Undefined) => rotary_header::ERROR | NO_BUFFER,
        Err(AppendError::Command(_)) => rotary_header::ERROR | NO_COMMAND,
    }
}

/// The 0-based coordinate system, when the header keeps the rules.
fn check(family: &Family, header: Header, base: u16) -> Result<usize, String> {
    let Header { cs, host, pmac, size, start, buffer } = header;
    if size < SMALLEST || !size.is_multiple_of(COMMAND) {
        return Err(format!("its size is {size}: even and at least {SMALLEST} it has to be"));
    }
    if !buffer.is_some_and(|first| user_area::has_room(family, first, 2 * usize::from(size))) {
        return Err(format!("{size} words at ${start:04X} do not lie in {}", user_area::bounds(family)));
    }
    for (whose, index) in [("host", host), ("PMAC", pmac)] {
        if index >= size || !index.is_multiple_of(COMMAND) {
            return Err(format!("the {whose} index is {index}, the size {size}"));
        }
    }
    cs.checked_sub(base)
        .map(usize::from)
        .filter(|&cs| cs < family.coordinate_systems)
        .ok_or_else(|| format!("there is no coordinate system {cs} counted from {base}"))
}

/// The command at an index.
fn command(header: Header, index: u16, board: &Board) -> Command {
    let first = header.buffer.unwrap_or(HostOffset::new(0));
    let at = first.plus_words(2 * usize::from(index % header.size));
    let word = |at| int24::unsigned(board.memory.dpram.read32(at));
    (word(at), word(at.plus_words(2)))
}

/// The commands between the indexes, in order.
fn commands(header: Header, board: &Board) -> Vec<Command> {
    let used = (header.host + header.size - header.pmac) % header.size;
    (0..used)
        .step_by(COMMAND.into())
        .map(|step| command(header, (header.pmac + step) % header.size, board))
        .collect()
}

/// Commands up to the next start of a line.
fn line_length(commands: &[Command]) -> usize {
    let next = commands.iter().skip(1).position(|command| command.0 & START_OF_LINE != 0);
    next.map_or(commands.len(), |position| position + 1)
}

#[cfg(test)]
#[path = "rotary_tests.rs"]
mod tests;
