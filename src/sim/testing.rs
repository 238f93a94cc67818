//! A board in virtual time for the unit tests, and a host that pokes at its DPRAM.

use std::fs::{File, OpenOptions};

#[cfg(any(feature = "cli", feature = "daemon"))]
use crate::device::FileBoard;
use crate::device::mapping::Mapping;
use crate::map::{self, HostOffset, PmacAddress, Space};
use crate::sim::board::Board;
use crate::sim::board::dpram::Dpram;
use crate::sim::board::firmware::{self, FirmwareTables};
use crate::sim::board::identity::Identity;
use crate::sim::board::memory::Memory;
use crate::sim::world::World;

/// The fixed-point register at `number`.
pub const fn d(number: u32) -> PmacAddress {
    PmacAddress::new(Space::D, number)
}

/// The floating-point register at `number`.
pub const fn l(number: u32) -> PmacAddress {
    PmacAddress::new(Space::L, number)
}

/// The memory of a PMAC that no host can map.
pub fn memory() -> Memory {
    Memory::new(Dpram::private(map::PMAC.length).unwrap(), &firmware::PMAC)
}

/// A board at factory defaults that no host can map.
pub fn board() -> Board {
    Board::new(memory(), Identity::new(&firmware::PMAC, "1.16D"), None, None)
}

/// A board and the host's view of its memory.
pub struct Bench {
    pub world: World,
    host: Mapping,
    /// Where its memory lies.
    #[cfg(any(feature = "cli", feature = "daemon"))]
    directory: tempfile::TempDir,
}

impl Bench {
    /// A PMAC at factory defaults.
    pub fn bare(version: &str) -> Self {
        Self::of(&firmware::PMAC, version)
    }

    /// A board with the firmware of `tables`, at factory defaults.
    pub fn of(tables: &'static FirmwareTables, version: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        let memory = Memory::new(Dpram::open(&path, tables.family.length).unwrap(), tables);
        let identity = Identity::new(tables, version);
        let board = Board::new(memory, identity, None, None);
        let file: File = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let host = Mapping::new(&file, 0, tables.family.length as usize).unwrap();
        Self {
            world: World::new(board),
            host,
            #[cfg(any(feature = "cli", feature = "daemon"))]
            directory,
        }
    }

    /// With the shipped start-up file.
    pub fn started() -> Self {
        let mut bench = Self::bare("1.16D");
        bench.world.load("shipped", firmware::PMAC.startup).unwrap();
        bench
    }

    /// The memory as a host's driver opens it.
    #[cfg(any(feature = "cli", feature = "daemon"))]
    pub fn bus(&self) -> FileBoard {
        let path = self.directory.path().join("dpram");
        let file = OpenOptions::new().read(true).write(true).open(path).unwrap();
        FileBoard::from_file(&file, self.world.board.family().length as usize).unwrap()
    }

    pub fn run(&mut self, cycles: usize) {
        for _ in 0..cycles {
            self.world.step();
        }
    }

    /// Runs until `done`, at most `cycles` cycles.
    pub fn until(&mut self, cycles: usize, mut done: impl FnMut(&mut Board) -> bool) {
        for _ in 0..cycles {
            self.world.step();
            if done(&mut self.world.board) {
                return;
            }
        }
        panic!("not within {cycles} cycles");
    }

    pub fn set(&mut self, variable: usize, value: f64) {
        self.world.board.variables.set_i(variable, value);
        self.world.board.i_assigned(variable);
    }

    pub fn read(&self, offset: u32) -> u16 {
        self.host.read16(offset as usize).unwrap()
    }

    pub fn read32(&self, offset: u32) -> u32 {
        u32::from(self.read(offset)) | u32::from(self.read(offset + 2)) << 16
    }

    pub fn write(&self, offset: u32, value: u16) {
        self.host.write16(offset as usize, value).unwrap();
    }

    pub fn read8(&self, offset: u32) -> u8 {
        self.host.read8(offset as usize).unwrap()
    }

    pub fn write8(&self, offset: u32, value: u8) {
        self.host.write8(offset as usize, value).unwrap();
    }

    /// Puts a text and its NUL into the host's buffer.
    pub fn write_text(&self, text: &str) {
        let place = self.world.board.family().ascii.command.bytes();
        let mut bytes = text.as_bytes().to_vec();
        bytes.push(0);
        bytes.resize(160.min(bytes.len() + bytes.len() % 2), 0);
        for (index, pair) in bytes.chunks(2).enumerate() {
            self.write(place + 2 * index as u32, u16::from_le_bytes([pair[0], *pair.get(1).unwrap_or(&0)]));
        }
    }

    /// Puts a line into the host's buffer and sets its flag.
    pub fn offer(&self, line: &str) {
        self.write_text(line);
        self.write(self.world.board.family().ascii.command_loaded.word.bytes(), 1);
    }

    /// The next response: control word and text; frees the buffer.
    pub fn response(&mut self) -> (u16, String) {
        let port = &self.world.board.family().ascii;
        let [control_word, count, text] =
            [port.response_control, port.response_count, port.response].map(HostOffset::bytes);
        for _ in 0..100 {
            let control = self.read(control_word);
            if control != 0 {
                let count = usize::from(self.read(count));
                let bytes: Vec<u8> =
                    (0..count).map(|at| self.read(text + (at as u32 & !1)).to_le_bytes()[at % 2]).collect();
                let (nul, text) = bytes.split_last().unwrap();
                assert_eq!(*nul, 0);
                self.write(control_word, 0);
                return (control, String::from_utf8(text.to_vec()).unwrap());
            }
            self.run(1);
        }
        panic!("no response");
    }

    /// Sends a line and gives the responses up to the end or an error.
    pub fn send(&mut self, line: &str) -> Vec<(u16, String)> {
        self.offer(line);
        let mut responses = Vec::new();
        loop {
            let response = self.response();
            let last = response.0 != 0x000D;
            responses.push(response);
            if last {
                return responses;
            }
        }
    }

    pub fn violations(&self) -> &[String] {
        self.world.board.judge.violations()
    }
}
