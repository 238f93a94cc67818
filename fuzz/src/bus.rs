//! A board's memory that somebody else writes: before a function looks, and between two of its accesses.

use pmac_dpram::device::{Bus, BusError, ByteBus, ByteBusError};
use pmac_dpram::map::functions::response;
use pmac_dpram::map::{Family, HostOffset, PMAC, PmacAddress, PmacRegister, Space, pmac};

use super::tape::Tape;

const WORDS: usize = pmac::LENGTH as usize / 2;

/// Words of a PMAC that steer the functions: status, counts, indices, controls.
const HOT: [u32; 30] = [
    0x0000, 0x0002, 0x0004, 0x0024, 0x0026, 0x0048, 0x0228, 0x022A, 0x024C, 0x062C, 0x062E, 0x0630, 0x06D0,
    0x06D2, 0x06D4, 0x07D4, 0x07D6, 0x07DC, 0x07DE, 0x07E0, 0x07E2, 0x07E4, 0x07E8, 0x07EA, 0x07EC, 0x07EE,
    0x07F0, 0x07F6, 0x07FC, 0x07FE,
];

/// The register at `address`, in a space that registers have.
pub fn register(space: Space, address: u16) -> PmacRegister {
    PmacRegister::new(PmacAddress::new(space, address.into())).expect("a register's space")
}

/// The same of a board of `family`.
fn hot(family: &Family) -> Vec<usize> {
    if family == &PMAC {
        return HOT.iter().map(|offset| *offset as usize / 2).collect();
    }
    let (read, write, gather) = (&family.variable_read, &family.variable_write, &family.gather);
    let heads = [
        (family.servo.region.start, 9),
        (family.background.region.start, 6),
        (family.ascii.command_loaded.word, 3),
        (family.ascii.response_control, 3),
        (family.rotary.headers[0], 6),
        (family.rotary.headers[1], 6),
    ];
    let words = [read.ready.word, read.timer, read.count, read.start, write.count, write.start, gather.size];
    let heads = heads.into_iter().flat_map(|(first, count)| first.word()..first.word() + count);
    heads.chain(words.map(HostOffset::word)).chain([gather.index.word()]).collect()
}

/// The memory, who touched it, and what will change in it.
pub struct RamBus {
    family: &'static Family,
    /// Words that steer the functions.
    hot: Vec<usize>,
    words: Box<[u16; WORDS]>,
    accesses: u32,
    /// Offsets in bytes the host wrote to since they were last looked at.
    written: Vec<u32>,
    /// After so many accesses, this word becomes that.
    changes: Vec<(u32, usize, u16)>,
}

impl RamBus {
    pub fn new(fill: u16) -> Self {
        Self::of(&PMAC, fill)
    }

    /// The memory of a board of `family`, as long as a PMAC's.
    pub fn of(family: &'static Family, fill: u16) -> Self {
        let words = Box::new([fill; WORDS]);
        Self {
            family,
            hot: hot(family),
            words,
            accesses: 0,
            written: Vec::with_capacity(256),
            changes: Vec::new(),
        }
    }

    /// Accesses since the last call.
    pub fn take_accesses(&mut self) -> u32 {
        std::mem::take(&mut self.accesses)
    }

    /// Asserts that all the host wrote since the last call lies where it may.
    pub fn assert_written(&mut self, what: &str, may: impl Fn(u32) -> bool) {
        let wrong = self.written.iter().find(|offset| !may(**offset));
        assert!(wrong.is_none(), "{what} wrote to {wrong:x?}");
        self.written.clear();
    }

    /// What the board, or whoever plays it, does: `how` is 0 to 7.
    pub fn change(&mut self, how: u8, tape: &mut Tape<'_>) {
        match how & 7 {
            0 => {
                let (at, value) = (usize::from(tape.u16() >> 1), tape.u16());
                self.words[at % WORDS] = value;
            }
            1 | 2 => {
                let at = self.hot(tape.u8());
                self.words[at] = tape.u16();
            }
            3 => {
                let at = self.hot(tape.u8());
                self.words[at] = self.words[at].wrapping_add(u16::from(tape.u8()));
            }
            4 => {
                let at = usize::from(tape.u16() >> 1);
                for (pair, n) in tape.piece().chunks(2).zip(0..) {
                    self.words[(at + n) % WORDS] =
                        u16::from_le_bytes([pair[0], pair.get(1).copied().unwrap_or(0)]);
                }
            }
            5 => {
                // A reply, with its count right: control word, and text.
                let text = tape.piece();
                let ascii = &self.family.ascii;
                let at = ascii.response.word();
                for (pair, n) in text.chunks(2).zip(0..128) {
                    self.words[at + n] = u16::from_le_bytes([pair[0], pair.get(1).copied().unwrap_or(0)]);
                }
                self.words[ascii.response_count.word()] = text.len() as u16 + 1;
                self.words[ascii.response_control.word()] =
                    [response::LINE, response::ACKNOWLEDGE, response::TO_PROGRAM, response::MESSAGE]
                        [usize::from(tape.u8() & 3)];
            }
            _ => {
                if self.changes.len() < 16 {
                    let (after, at) = (u32::from(tape.u8()), self.hot(tape.u8()));
                    self.changes.push((after, at, tape.u16()));
                }
            }
        }
    }

    fn hot(&self, index: u8) -> usize {
        self.hot[usize::from(index) % self.hot.len()]
    }

    fn touch(&mut self, offset: HostOffset) -> Result<usize, BusError> {
        if offset.word() >= WORDS {
            return Err(BusError::OutOfRange { offset, words: 1, length: self.length() });
        }
        self.accesses += 1;
        let Self { words, changes, .. } = self;
        changes.retain_mut(|(after, at, value)| {
            let due = *after == 0;
            *after = after.saturating_sub(1);
            if due {
                words[*at] = *value;
            }
            !due
        });
        Ok(offset.word())
    }
}

impl Bus for RamBus {
    fn length(&self) -> usize {
        pmac::LENGTH as usize
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let at = self.touch(offset)?;
        Ok(self.words[at])
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        let at = self.touch(offset)?;
        self.words[at] = value;
        self.written.push(offset.bytes());
        Ok(())
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        if first.word() + words.len() > WORDS {
            return Err(BusError::OutOfRange { offset: first, words: words.len(), length: self.length() });
        }
        for (word, n) in words.iter_mut().zip(0..) {
            *word = self.read16(first.plus_words(n))?;
        }
        Ok(())
    }

    fn order_reads(&mut self) {}

    fn order_writes(&mut self) {}
}

/// The VME board's byte registers.
pub struct RamBytes {
    pub bytes: [u8; 0x200],
    pub accesses: u32,
}

impl ByteBus for RamBytes {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        self.accesses += 1;
        let value = self.bytes.get(offset as usize).copied();
        value.ok_or(ByteBusError::OutOfRange { offset, length: self.bytes.len() })
    }

    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.accesses += 1;
        let length = self.bytes.len();
        let at = self.bytes.get_mut(offset as usize).ok_or(ByteBusError::OutOfRange { offset, length })?;
        *at = value;
        Ok(())
    }

    fn order_accesses(&mut self) {}
}
