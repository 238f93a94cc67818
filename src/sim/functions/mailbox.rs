//! The VME mailbox port (User Manual pp. 263-267) as a file of 0x200 bytes that a host maps too.
//!
//! Mailboxes 0 to 15 are byte registers at the odd addresses base+1 to base+0x1F.
//!
//! To PMAC: the host writes a group of at most 15 characters, the second and following ones into mailboxes 2 to 15, and
//! last the first one into mailbox 0, the trigger. PMAC takes the group and interrupts with vector v-1. A line ends with
//! `<CR>`; a control character goes alone into mailbox 0.
//!
//! From PMAC: when the host writes 0 to mailbox 1, PMAC fills mailboxes 0 to 15 once, with up to 16 characters, and
//! interrupts with vector v. The characters are those that the serial port would send under I3, I4 and I6. A `<CR>`
//! ends a group, `<ACK>` has its own group. The text after the `<BELL>` of an error is in the same group, but on Turbo
//! boards in the next. PMAC leaves the mailboxes that it does not fill as they are, except 0 and 1 (see below).
//!
//! base+0x121 takes the DPRAM's page, A19-A14 of its address, and forgets the page at a reset. With a page given to
//! [`Mailbox::open`], the DPRAM is out of reach until the host writes that page.
//!
//! A file does not show a write of the value that is already there. So PMAC leaves bytes there that no host writes: 0
//! in mailbox 0 after it has taken a group, 0xFF in mailbox 1 after it has taken the permission, 0xFF in the page
//! register after a reset. PMAC always notices a host that writes 16 bits at base+2n, the character in the high byte,
//! because PMAC keeps 0xFF in the even bytes, as an empty byte lane reads. So `pmacd` writes 16 bits to such a file,
//! but not to a board. PMAC misses one write of a host that writes bytes: a group that begins with the first character
//! of the response before it. A real board sees that write, too.

use std::fs::File;
use std::path::Path;

use nix::fcntl::Flock;

use crate::device::mapping::Mapping;
use crate::map::{self, Generation};
use crate::sim::board::Board;
use crate::sim::board::dpram::{DpramError, open_shared};
use crate::sim::fault::Delay;
use crate::sim::language::interpreter::Interpreter;
use crate::sim::language::serial::SerialPort;
use crate::sim::program::Programs;

/// The file's length: the stretch of the VME bus that the board's mailbox circuit takes.
pub const LENGTH: usize = map::mailbox::LENGTH;
/// The page register, as the offset of its even byte.
const PAGE: usize = map::mailbox::PAGE_SELECT - 1;
const MAILBOXES: usize = map::mailbox::MAILBOXES;
/// The even byte of a register, mailbox 1 and the page while no host has written there.
const UNTOUCHED: u8 = 0xFF;

const ACK: u8 = 0x06;
const BELL: u8 = 0x07;
const CR: u8 = 0x0D;
const CANCEL: u8 = 0x18;

/// The port.
pub struct Mailbox {
    mapping: Mapping,
    _lock: Flock<File>,
    port: SerialPort,
    /// The values that PMAC has left in mailboxes 0 and 1.
    left: [u8; 2],
    /// The host has written 0 to mailbox 1 since the last response.
    may_fill: bool,
    /// The registers as they were when the trigger was first seen.
    seen: Option<[u8; MAILBOXES]>,
    taking: Delay,
    answering: Delay,
    /// Characters still to be put into their mailboxes although the interrupt is out.
    rest: Vec<(usize, u8)>,
    /// The page that brings the DPRAM into reach; without a page the DPRAM always is in reach.
    page: Option<u8>,
    /// Interrupts with vector v-1, "taken", not yet given to the hosts.
    pub taken: u64,
    /// Interrupts with vector v, "response", not yet given to the hosts.
    pub responses: u64,
}

impl Mailbox {
    /// The port in the file at `path`, which is created if missing.
    ///
    /// # Errors
    /// [`DpramError`] when the file has another length, belongs to another running simulator or cannot be mapped.
    pub fn open(path: &Path, page: Option<u8>) -> Result<Self, DpramError> {
        let lock = open_shared(path, LENGTH)?;
        let mapping = Mapping::new(&lock, 0, LENGTH)
            .map_err(|source| DpramError::File { path: path.to_owned(), source })?;
        let mut mailbox = Self {
            mapping,
            _lock: lock,
            port: SerialPort::new(),
            left: [0; 2],
            may_fill: false,
            seen: None,
            taking: Delay::default(),
            answering: Delay::default(),
            rest: Vec::new(),
            page,
            taken: 0,
            responses: 0,
        };
        mailbox.reset();
        Ok(mailbox)
    }

    /// A board's reset: no group under way, mailboxes 0.
    pub fn reset(&mut self) {
        for number in 0..MAILBOXES {
            self.leave(number, 0);
        }
        self.leave(1, UNTOUCHED);
        self.put(PAGE, UNTOUCHED);
        self.port = SerialPort::new();
        self.may_fill = false;
        self.seen = None;
        self.rest.clear();
    }

    /// The page the host has written since the last reset.
    #[must_use]
    pub fn selected_page(&self) -> Option<u8> {
        let [_, value] = self.word(PAGE);
        (value != UNTOUCHED).then_some(value & 0x3F)
    }

    /// Whether the host reaches the DPRAM.
    #[must_use]
    pub fn reaches_dpram(&self) -> bool {
        self.page.is_none() || self.page == self.selected_page()
    }

    /// Even and odd byte at `register`.
    fn word(&self, register: usize) -> [u8; 2] {
        self.mapping.read16(register).unwrap_or(0xFFFF).to_le_bytes()
    }

    fn put(&self, register: usize, value: u8) {
        let _ = self.mapping.write16(register, u16::from_le_bytes([UNTOUCHED, value]));
    }

    /// Leaves a character in a mailbox.
    fn leave(&mut self, number: usize, value: u8) {
        self.put(2 * number, value);
        if let Some(left) = self.left.get_mut(number) {
            *left = value;
        }
    }

    /// Whether the host has written to mailbox 0 or 1.
    fn touched(&self, number: usize) -> bool {
        let [mark, value] = self.word(2 * number);
        mark != UNTOUCHED || value != self.left[number]
    }

    /// The characters of a group.
    fn group(boxes: &[u8; MAILBOXES]) -> Vec<u8> {
        let mut group = vec![boxes[0]];
        if boxes[0] < b' ' {
            return group;
        }
        for &character in &boxes[2..] {
            group.push(character);
            if character == CR {
                break;
            }
        }
        group
    }

    /// Reads mailbox 1, which enables a response.
    fn poll_enable(&mut self, board: &mut Board) {
        if !self.touched(1) {
            return;
        }
        let [_, value] = self.word(2);
        self.leave(1, UNTOUCHED);
        if value == 0 {
            self.may_fill = true;
        } else {
            let cycle = board.stats.servo_cycles;
            board.judge.record(cycle, &format!("the host wrote 0x{value:02X} to mailbox 1, which takes 0"));
        }
    }

    /// Takes the host's group in the pass after the one that first saw the group.
    fn take(&mut self, board: &mut Board) -> Option<Vec<u8>> {
        if !self.touched(0) {
            self.seen = None;
            return None;
        }
        self.mapping.order_reads();
        let boxes = std::array::from_fn(|mailbox| self.word(2 * mailbox)[1]);
        let seen = self.seen.replace(boxes)?;
        let group = Self::group(&boxes);
        if Self::group(&seen) != group {
            let cycle = board.stats.servo_cycles;
            board.judge.record(cycle, "the mailboxes changed before PMAC had taken the group");
        }
        let fault = &board.faults.mailbox;
        if fault.stuck || !self.taking.over(fault.late) {
            return None;
        }
        self.seen = None;
        self.leave(0, 0);
        for (number, &value) in boxes.iter().enumerate().take(group.len() + 1).skip(2) {
            self.leave(number, value);
        }
        self.taken += 1;
        Some(group)
    }

    /// Fills the mailboxes when the host has enabled a response and the board has text for it.
    fn respond(&mut self, board: &mut Board) {
        let fault = &board.faults.mailbox;
        if !self.may_fill
            || board.output.mailbox.is_empty()
            || fault.stuck
            || !self.answering.over(fault.late)
        {
            return;
        }
        self.may_fill = false;
        let mut group = Vec::new();
        while let Some(&character) = board.output.mailbox.front() {
            if group.len() == MAILBOXES || character == ACK && !group.is_empty() {
                break;
            }
            board.output.mailbox.pop_front();
            group.push(character);
            let bell_ends = board.family().generation == Generation::Turbo;
            if matches!(character, CR | ACK) || character == BELL && bell_ends {
                break;
            }
        }
        let now = if fault.torn { group.len() / 2 } else { group.len() };
        for (mailbox, &character) in group.iter().enumerate() {
            if mailbox < now {
                self.leave(mailbox, character);
            } else {
                self.rest.push((mailbox, character));
            }
        }
        self.mapping.order_writes();
        self.responses += 1;
    }

    /// One background pass: the host's permission, its group, the command in the group, a response.
    pub fn poll(&mut self, board: &mut Board, programs: &mut Programs, interpreter: &mut Interpreter) {
        for (number, character) in std::mem::take(&mut self.rest) {
            self.leave(number, character);
        }
        self.poll_enable(board);
        if let Some(group) = self.take(board) {
            board.mailbox_becomes_active();
            let resets = board.stats.resets;
            let mut output = Vec::new();
            for character in group {
                if character == CANCEL {
                    board.output.mailbox.clear();
                }
                self.port.receive(board, programs, interpreter, character, &mut output);
            }
            if board.stats.resets == resets {
                board.output.mailbox.extend(output);
            } else {
                self.reset();
            }
        }
        self.respond(board);
    }
}

#[cfg(test)]
#[path = "mailbox_tests.rs"]
mod tests;
