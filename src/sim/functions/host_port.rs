//! The interrupt registers of the ISA host port, in a file of 16 bytes: one byte for each of its I/O addresses.
//!
//! PMAC(1) has an 8259 at base+8 and +9 (User Manual pp. 249-257). Input IR7 is asserted while a response waits in the
//! DPRAM and I56=1. A set mask bit at +9 keeps it back. After an interrupt the 8259 gives no other until the host
//! writes the end of interrupt, 0x67, to +8.
//!
//! PMAC2 has latches instead (PMAC2 User Manual pp. 91-92): +8 the latched signals, each cleared by a 1 that the host
//! writes there; +9 the signals; +10 the mask, where 1 enables; +11 1 for level, 0 for edge. Bit 5 is the DPRAM's
//! response, bit 7 the watchdog.
//!
//! A file does not show a write of the value that is already there, and +8 reads other values than a host writes to it.
//! So a host writes the value for +8 to byte 12, an address that the port leaves free, and PMAC sets the byte back to
//! 0. PMAC also notices a write to +8 itself that changes the value read at +8: every command of the 8259 does, but not
//! the clearing of exactly the signals that PMAC2 has latched. All other registers are plain bytes. At power-up
//! everything is masked.
//!
//! Not simulated: text through the port (+0 to +7); the 8259's initialisation words (one of them ends the service under
//! way and does nothing else), its priorities, polling and acknowledge cycle (+10): only IR7 is ever asserted. No
//! manual names the value that clears PMAC2's latches.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use nix::fcntl::Flock;

use crate::sim::board::Board;
use crate::sim::board::dpram::{DpramError, open_shared};
use crate::sim::board::firmware::Controller;

/// The file's length.
pub const LENGTH: usize = 16;
/// Command word 0 of the 8259, status of PMAC2.
const STATUS: u64 = 8;
/// Mask of the 8259, signals of PMAC2.
const SECOND: u64 = 9;
/// Mask of PMAC2.
const MASK2: u64 = 10;
/// Level or edge of PMAC2.
const LEVEL2: u64 = 11;
/// The address at which a host writes the value for +8.
const WRITTEN: u64 = 12;

/// 8259: the DPRAM's response.
const IR7: u8 = 1 << 7;
/// 8259: a specific end of interrupt for IR7.
const END_OF_IR7: u8 = 0x67;
/// PMAC2: the DPRAM's response.
const EQU1: u8 = 1 << 5;
/// PMAC2: the watchdog.
const WATCHDOG: u8 = 1 << 7;

/// The port.
#[derive(Debug)]
pub struct HostPort {
    file: Flock<File>,
    controller: Controller,
    /// 8259: IR7 is in service. PMAC2: an interrupt is out for the latched signals.
    in_service: bool,
    /// The value that +8 reads.
    shown: u8,
    /// 8259: +8 reads the service register.
    reads_service: bool,
    /// PMAC2.
    latched: u8,
    /// PMAC2: the watchdog at the last pass.
    watchdog: bool,
}

impl HostPort {
    /// The port in the file at `path`, which is created if missing.
    ///
    /// # Errors
    /// [`DpramError`] when the file has another length, belongs to another running simulator or cannot be opened.
    pub fn open(path: &Path, controller: Controller) -> Result<Self, DpramError> {
        let file = open_shared(path, LENGTH)?;
        let mut start = [0; LENGTH];
        if controller == Controller::Intel8259 {
            start[SECOND as usize] = 0xFF;
        }
        file.write_all_at(&start, 0).map_err(|source| DpramError::File { path: path.to_owned(), source })?;
        let [in_service, reads_service, watchdog] = [false; 3];
        Ok(Self { file, controller, in_service, shown: 0, reads_service, latched: 0, watchdog })
    }

    /// Reads the registers and gives the interrupts for the host. `edges`: DPRAM responses since the last call.
    pub fn poll(&mut self, edges: u64, board: &mut Board) -> u64 {
        let (mut written, direct) = (self.read(WRITTEN), self.read(STATUS));
        if written != 0 {
            self.write(WRITTEN, 0);
        } else if direct != self.shown {
            written = direct;
        }
        let written = if board.faults.host_port_stuck { 0 } else { written };
        let level = response_waits(board);
        let raised = match self.controller {
            Controller::Intel8259 => self.intel8259(written, level, board),
            Controller::Pmac2 => self.pmac2(written, level, edges, board.watchdog),
        };
        u64::from(raised)
    }

    fn intel8259(&mut self, command: u8, level: bool, board: &mut Board) -> bool {
        if command & 0x10 != 0 {
            self.in_service = false;
        } else if command & 0x18 == 0x08 {
            if command & 0b10 != 0 {
                self.reads_service = command & 1 == 1;
            }
        } else if command & 0x20 != 0 {
            let specific = command & 0x40 != 0;
            if specific && command & 7 != END_OF_IR7 & 7 {
                let what = format!("0x{command:02X} to the 8259 is no end of the DPRAM's interrupt");
                board.judge.record(board.stats.servo_cycles, &what);
            } else {
                self.in_service = false;
            }
        }
        let raise = level && !self.in_service && self.read(SECOND) & IR7 == 0;
        self.in_service |= raise;
        let shown = if self.reads_service { self.in_service } else { level };
        self.show(if shown { IR7 } else { 0 });
        raise
    }

    fn pmac2(&mut self, cleared: u8, level: bool, edges: u64, watchdog: bool) -> bool {
        if cleared != 0 {
            self.latched &= !cleared;
            self.in_service = false;
        }
        let by_level = self.read(LEVEL2);
        let latch = |bit: u8, level: bool, edge: bool| {
            let set = if by_level & bit != 0 { level } else { edge };
            if set { bit } else { 0 }
        };
        self.latched |= latch(EQU1, level, edges > 0) | latch(WATCHDOG, watchdog, watchdog && !self.watchdog);
        self.watchdog = watchdog;
        self.show(self.latched);
        self.write(SECOND, if level { EQU1 } else { 0 } | if watchdog { WATCHDOG } else { 0 });
        let pending = self.latched & self.read(MASK2) != 0;
        let raise = pending && !self.in_service;
        self.in_service = pending;
        raise
    }

    fn show(&mut self, value: u8) {
        self.shown = value;
        self.write(STATUS, value);
    }

    fn read(&self, register: u64) -> u8 {
        let mut byte = [0];
        // A file cut short by somebody reads as registers that are 0.
        let _ = self.file.read_exact_at(&mut byte, register);
        byte[0]
    }

    fn write(&self, register: u64, value: u8) {
        if self.read(register) != value {
            let _ = self.file.write_all_at(&[value], register);
        }
    }
}

/// Whether the interrupt line of the DPRAM's responses is asserted: I56=1, and the host has not taken the last
/// response.
fn response_waits(board: &Board) -> bool {
    let family = board.family();
    board.enabled(family.i.interrupt)
        && !board.out_of_reach
        && board.memory.dpram.read16(family.ascii.response_control) != 0
}

#[cfg(test)]
mod tests {
    use std::fs::OpenOptions;

    use tempfile::TempDir;

    use super::*;
    use crate::sim::testing::Bench;

    struct Rig {
        bench: Bench,
        host: File,
        _directory: TempDir,
    }

    impl Rig {
        fn new(controller: Controller) -> Self {
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("port");
            let port = HostPort::open(&path, controller).unwrap();
            let host = OpenOptions::new().read(true).write(true).open(&path).unwrap();
            let mut bench = Bench::started();
            bench.world.fit_host_port(port);
            Self { bench, host, _directory: directory }
        }

        fn write(&self, register: u64, value: u8) {
            self.host.write_all_at(&[value], register).unwrap();
        }

        fn read(&self, register: u64) -> u8 {
            let mut byte = [0];
            self.host.read_exact_at(&mut byte, register).unwrap();
            byte[0]
        }

        /// Some cycles; gives the interrupts.
        fn run(&mut self) -> u64 {
            self.bench.run(5);
            self.bench.world.take_interrupts().response
        }

        fn ask(&mut self) -> u64 {
            self.bench.write_text("P1");
            self.bench.write(0x062C, 1);
            self.run()
        }
    }

    #[test]
    fn the_8259_gives_no_second_interrupt_before_0x67() {
        let mut rig = Rig::new(Controller::Intel8259);
        assert_eq!(rig.read(9), 0xFF, "masked at power-up");
        assert_eq!((rig.ask(), rig.read(8)), (0, IR7));
        rig.write(9, 0x7F);
        assert_eq!(rig.run(), 1);
        assert_eq!(rig.run(), 0);
        // The line is answered, the <ACK> follows: IR7 is asserted still, but in service.
        rig.bench.write(0x06D0, 0);
        assert_eq!((rig.run(), rig.read(8)), (0, IR7));
        rig.write(12, 0x0B);
        rig.run();
        assert_eq!((rig.read(8), rig.read(12)), (IR7, 0), "in service");
        rig.write(12, END_OF_IR7);
        assert_eq!(rig.run(), 1);
        rig.bench.write(0x06D0, 0);
        rig.write(12, END_OF_IR7);
        assert_eq!((rig.run(), rig.read(8)), (0, 0));
        assert!(rig.bench.violations().is_empty(), "{:?}", rig.bench.violations());
    }

    #[test]
    fn a_command_written_to_its_own_address_is_noticed() {
        let mut rig = Rig::new(Controller::Intel8259);
        rig.write(9, 0);
        assert_eq!(rig.ask(), 1);
        rig.write(8, END_OF_IR7);
        assert_eq!((rig.run(), rig.read(8)), (1, IR7));
        let mut rig = Rig::new(Controller::Pmac2);
        assert_eq!((rig.ask(), rig.read(8)), (0, EQU1));
        rig.write(8, 0xFF);
        assert_eq!((rig.run(), rig.read(8)), (0, 0));
    }

    #[test]
    fn an_end_before_the_response_is_fetched_interrupts_again() {
        let mut rig = Rig::new(Controller::Intel8259);
        rig.write(9, 0);
        assert_eq!(rig.ask(), 1);
        rig.write(12, END_OF_IR7);
        assert_eq!(rig.run(), 1);
    }

    #[test]
    fn a_wrong_end_of_interrupt_is_recorded_and_ends_nothing() {
        let mut rig = Rig::new(Controller::Intel8259);
        rig.write(12, END_OF_IR7);
        rig.run();
        assert!(rig.bench.violations().is_empty(), "with nothing in service it does no harm");
        rig.write(9, 0);
        assert_eq!(rig.ask(), 1);
        rig.write(12, 0x65);
        assert_eq!(rig.run(), 0);
        assert_eq!(rig.bench.violations().len(), 1, "{:?}", rig.bench.violations());
        rig.bench.world.board.faults.host_port_stuck = true;
        rig.write(12, END_OF_IR7);
        assert_eq!(rig.run(), 0);
        rig.bench.world.board.faults.host_port_stuck = false;
        rig.write(12, 0x20);
        assert_eq!(rig.run(), 1, "an unspecific end will do");
    }

    #[test]
    fn pmac2_latches_until_ones_are_written_and_its_mask_enables() {
        let mut rig = Rig::new(Controller::Pmac2);
        assert_eq!((rig.ask(), rig.read(8), rig.read(9)), (0, EQU1, EQU1));
        rig.write(10, EQU1);
        assert_eq!(rig.run(), 1);
        assert_eq!(rig.run(), 0);
        rig.write(12, EQU1);
        assert_eq!((rig.run(), rig.read(8), rig.read(9)), (0, 0, EQU1), "by edge: once");
        rig.bench.write(0x06D0, 0);
        assert_eq!((rig.run(), rig.read(8)), (1, EQU1), "the <ACK>");
        rig.bench.write(0x06D0, 0);
        assert_eq!((rig.run(), rig.read(8), rig.read(9)), (0, EQU1, 0), "an old one");
        rig.write(12, 0xFF);
        rig.run();
        assert_eq!(rig.read(8), 0);
    }

    #[test]
    fn pmac2_by_level_interrupts_again_while_the_response_waits_and_tells_the_watchdog() {
        let mut rig = Rig::new(Controller::Pmac2);
        rig.write(10, 0xFF);
        rig.write(11, EQU1);
        assert_eq!(rig.ask(), 1);
        rig.write(12, EQU1);
        assert_eq!(rig.run(), 1);
        rig.bench.write(0x06D0, 0);
        rig.run();
        rig.bench.write(0x06D0, 0);
        rig.write(12, EQU1);
        assert_eq!((rig.run(), rig.read(8)), (0, 0));
        rig.bench.world.board.watchdog = true;
        assert_eq!((rig.run(), rig.read(8), rig.read(9)), (1, WATCHDOG, WATCHDOG));
    }
}
