//! The whole simulated board in virtual time: memory, motors, functions, interpreter and ports, one servo cycle a step.
//!
//! The world has no thread, no clock and no socket. [`super::process`] runs one world in real time behind sockets; a
//! test steps a world in its own process, and maps the same memory file as the host.
//!
//! Servo interrupt, once a step: count, time bases, programs, motors, gathering, servo report. Background pass after
//! it: mailboxes, DPRAM ASCII, the functions that work by flags, registers and status words, programs' requests and
//! PLCs, background report, the judge. No background pass runs while a command occupies the background loop.

use super::board::Board;
use super::board::dpram::{Dpram, DpramError};
use super::board::firmware::FirmwareTables;
use super::board::identity::Identity;
use super::board::memory::Memory;
use super::board::output::Port;
use super::fault::Faults;
use super::functions::ascii::AsciiPort;
use super::functions::background_report::BackgroundReport;
use super::functions::host_port::HostPort;
use super::functions::mailbox::Mailbox;
use super::functions::reach::Reach;
use super::functions::servo_report::ServoReport;
use super::functions::{Functions, requests};
use super::language::{Ports, Reply, SerialPort};
use super::program::Programs;

/// A line of a start-up file that the board refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}, line {line}: the board answers ERR{code:03} to {text:?}")]
pub struct RefusedLine {
    /// The file.
    pub name: String,
    /// The line's number, from 1.
    pub line: usize,
    /// The line.
    pub text: String,
    /// The error's number.
    pub code: u16,
}

/// How often the board has raised each of its interrupt lines since the last [`World::take_interrupts`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Interrupts {
    /// A response waits in the DPRAM, or the host port asserts its line.
    pub response: u64,
    /// PMAC has taken a mailbox group (vector v-1).
    pub mailbox_taken: u64,
    /// PMAC has filled the mailboxes (vector v).
    pub mailbox_response: u64,
}

/// The board and everything that runs on it.
pub struct World {
    /// The board.
    pub board: Board,
    /// Program buffers and the programs that run out of them.
    pub programs: Programs,
    /// The interpreters of on-line commands. The start-up file uses the DPRAM port's.
    ports: Ports,
    /// The servo report.
    pub report: ServoReport,
    background: BackgroundReport,
    /// The DPRAM ASCII port.
    pub ascii: AsciiPort,
    mailbox: Option<Mailbox>,
    functions: Functions,
    reach: Reach,
    serial: SerialPort,
    host_port: Option<HostPort>,
    pub(super) interrupts: Interrupts,
    /// The resets of the board that the rest of the world has followed.
    resets: u64,
}

impl World {
    /// `board`, just powered up, and its functions.
    #[must_use]
    pub fn new(board: Board) -> Self {
        let mut world = Self {
            resets: board.stats.resets,
            programs: Programs::new(board.coordinate_systems()),
            ports: Ports::new(board.identity.tables.addressing),
            report: ServoReport::new(board.identity.tables),
            background: BackgroundReport::new(board.family()),
            ascii: AsciiPort::default(),
            mailbox: None,
            functions: Functions::new(board.family()),
            reach: Reach::default(),
            serial: SerialPort::new(),
            host_port: None,
            interrupts: Interrupts::default(),
            board,
        };
        world.power_on();
        world
    }

    /// A board of the family of `tables` with the family's usual firmware and private memory, which no host can map.
    ///
    /// # Errors
    /// [`DpramError`] when the system gives no memory.
    pub fn alone(tables: &'static FirmwareTables) -> Result<Self, DpramError> {
        let memory = Memory::new(Dpram::private(tables.family.length)?, tables);
        Ok(Self::new(Board::new(memory, Identity::new(tables, tables.firmware), None, None)))
    }

    /// Makes the board a VME board with these mailboxes.
    pub fn fit_mailbox(&mut self, mailbox: Mailbox) {
        self.board.fit_vme();
        self.mailbox = Some(mailbox);
    }

    /// The DPRAM page that the host has written to the mailbox port since the last reset.
    #[must_use]
    pub fn selected_page(&self) -> Option<u8> {
        self.mailbox.as_ref()?.selected_page()
    }

    /// Gives the board the interrupt registers of an ISA host port.
    pub fn fit_host_port(&mut self, port: HostPort) {
        self.host_port = Some(port);
    }

    /// Sends the lines of a start-up file to the board. `;` begins a comment. `name` stands in the error.
    ///
    /// # Errors
    /// The first line that the board refuses; the lines before it are in force.
    pub fn load(&mut self, name: &str, text: &str) -> Result<(), RefusedLine> {
        for (index, line) in text.lines().enumerate() {
            let command = line.split(';').next().unwrap_or("").trim();
            if command.is_empty() {
                continue;
            }
            if let Some(error) = self.execute(command.as_bytes()).error {
                let (name, text) = (name.to_owned(), command.to_owned());
                return Err(RefusedLine { name, line: index + 1, text, code: error.0 });
            }
        }
        Ok(())
    }

    /// Carries out one on-line command line, as any of the board's ports does.
    pub fn execute(&mut self, line: &[u8]) -> Reply {
        let reply = self.ports.at(Port::Dpram).execute(&mut self.board, &mut self.programs, line);
        self.follow_reset();
        reply
    }

    /// Carries out a control character; `None` for a character that is no command.
    pub fn control_character(&mut self, character: u8) -> Option<Reply> {
        let reply = self.ports.at(Port::Dpram).control(&mut self.board, &mut self.programs, character);
        self.follow_reset();
        reply
    }

    /// Carries out a program's `CMD"text"` at once.
    pub fn command_message(&mut self, text: &str) {
        requests::command(&mut self.board, &mut self.programs, text);
        self.follow_reset();
    }

    /// Gives `bytes` to the serial port and returns the port's answer. A board whose watchdog has tripped is deaf.
    pub fn serial(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut output = Vec::new();
        for &byte in bytes {
            if self.board.watchdog {
                break;
            }
            let Self { board, programs, ports, .. } = self;
            self.serial.receive(board, programs, ports.at(Port::Serial), byte, &mut output);
            self.follow_reset();
        }
        output
    }

    /// Text that the board has sent to the serial port unasked (`SEND`, `CMD`) since the last call.
    pub fn take_serial_messages(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.board.output.serial)
    }

    /// Resets the board as the reset switch does.
    pub fn reset(&mut self) {
        self.board.reset(false);
        self.programs.reset(false);
        self.follow_reset();
    }

    /// Resets the functions when a command has reset the board.
    fn follow_reset(&mut self) {
        if self.resets != self.board.stats.resets {
            self.resets = self.board.stats.resets;
            self.power_on();
        }
    }

    /// The common end of power-up and reset, after board and programs.
    fn power_on(&mut self) {
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.reset();
        }
        self.ports.reset();
        self.functions = Functions::new(self.board.family());
        self.report.reset();
        self.programs.point_at_power_up(&mut self.board);
        self.programs.note_end_of_memory(&mut self.board);
        self.housekeeping();
    }

    /// One servo cycle, the background pass after it, and the interrupts that follow. Once the watchdog has tripped,
    /// only the host port is alive.
    pub fn step(&mut self) {
        if !self.board.watchdog {
            self.cycle();
        }
        let raised = std::mem::take(&mut self.ascii.interrupts);
        let raised = match &mut self.host_port {
            Some(port) => port.poll(raised, &mut self.board),
            None => raised,
        };
        let faults = &mut self.board.faults;
        let spurious = u64::from(faults.spurious_interrupt > 0);
        faults.spurious_interrupt = faults.spurious_interrupt.saturating_sub(1);
        self.interrupts.response += lose(raised, faults) + spurious;
        // A host hears interrupts only at the level and vector that the factory values set.
        let reach = u64::from(self.board.found.interrupts);
        if let Some(mailbox) = &mut self.mailbox {
            self.interrupts.mailbox_taken += reach * lose(std::mem::take(&mut mailbox.taken), faults);
            self.interrupts.mailbox_response += reach * lose(std::mem::take(&mut mailbox.responses), faults);
        }
    }

    fn cycle(&mut self) {
        self.servo_interrupt();
        if self.board.is_at_work() {
            self.board.work();
            return;
        }
        let hidden = self.board.faults.hides_memory();
        let found = self.board.found;
        if let Some(mailbox) = self.mailbox.as_mut().filter(|_| !hidden && found.mailboxes) {
            mailbox.poll(&mut self.board, &mut self.programs, self.ports.at(Port::Mailbox));
            self.follow_reset();
        }
        let page_selected = self.mailbox.as_ref().is_none_or(Mailbox::reaches_dpram);
        self.reach.poll(&mut self.board, page_selected && found.dpram, &mut self.report);
        if self.reaches_dpram() {
            self.ascii.poll(&mut self.board, &mut self.programs, self.ports.at(Port::Dpram));
            self.follow_reset();
            self.functions.poll(&mut self.board, &mut self.programs);
        }
        if !self.board.watchdog && !hidden {
            self.housekeeping();
        }
    }

    /// Whether the functions see the DPRAM.
    fn reaches_dpram(&self) -> bool {
        !self.board.out_of_reach && self.board.uses_dpram()
    }

    fn servo_interrupt(&mut self) {
        self.programs.servo_interrupt(&mut self.board);
        if self.reaches_dpram() {
            self.report.cycle(&mut self.board);
        }
    }

    /// The part of a background pass that runs without a host's request.
    fn housekeeping(&mut self) {
        let reaches_dpram = self.reaches_dpram();
        let Self { board, programs, background, report, .. } = self;
        programs.background_registers(board);
        requests::poll(board, programs);
        programs.background_plcs(board);
        programs.write_global_status(board);
        if reaches_dpram {
            if background.poll(board, &programs.report, report) {
                board.stats.background_updates += 1;
            }
            board.judge.poll(board.stats.servo_cycles, &mut board.memory.dpram);
        }
        self.follow_reset();
    }

    /// The interrupts raised since the last call.
    pub fn take_interrupts(&mut self) -> Interrupts {
        std::mem::take(&mut self.interrupts)
    }
}

/// The interrupts of `raised` that remain when the fault `lost_interrupt` has taken its share.
fn lose(raised: u64, faults: &mut Faults) -> u64 {
    let lost = raised.min(faults.lost_interrupt);
    if faults.lost_interrupt != u64::MAX {
        faults.lost_interrupt -= lost;
    }
    raised - lost
}

#[cfg(test)]
mod tests {
    use crate::sim::control::carry_out;
    use crate::sim::testing::Bench;

    #[test]
    fn a_response_raises_one_interrupt_that_is_given_out_once() {
        let mut bench = Bench::started();
        bench.write_text("P1");
        bench.write(0x062C, 1);
        bench.run(5);
        assert_eq!(bench.world.take_interrupts().response, 1);
        assert_eq!(bench.world.take_interrupts().response, 0);
        assert_eq!(bench.response(), (0x000D, "0".into()));
        carry_out(&mut bench.world, "fault spurious_interrupt 2");
        carry_out(&mut bench.world, "fault lost_interrupt 1");
        bench.run(3);
        assert_eq!(bench.world.take_interrupts().response, 2, "the <ACK> is lost, two come for nothing");
    }

    #[test]
    fn the_serial_port_answers_and_says_what_programs_send() {
        let mut bench = Bench::bare("1.16D");
        assert_eq!(bench.world.serial(b"I3=0 P1=3 P1\r"), b"3\r");
        assert_eq!(carry_out(&mut bench.world, "send HELLO"), "ok");
        assert_eq!(bench.world.take_serial_messages(), b"HELLO\r");
        assert_eq!(carry_out(&mut bench.world, "step 3"), "ok");
        assert_eq!(bench.world.board.stats.servo_cycles, 3);
        bench.world.board.watchdog = true;
        assert_eq!(bench.world.serial(b"P1\r"), b"");
    }
}
