//! The whole simulated board in virtual time: memory, motors, functions, interpreter and ports, one servo cycle a step.
//!
//! It has no thread, no clock and no socket. [`super::process`] runs one in real time behind sockets; a test steps one
//! in its own process, and maps the same memory file as the host.

use super::board::Board;
use super::fault::Faults;
use super::host_port::HostPort;
use super::language::{Family, Interpreter, Reply, SerialPort};
use super::{ascii, dpram::DpramError, functions, mailbox};

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
    /// Its interpreter, as the DPRAM port and the start-up file use it.
    pub interpreter: Interpreter,
    serial: SerialPort,
    pub(super) host_port: Option<HostPort>,
    pub(super) interrupts: Interrupts,
}

impl World {
    /// `board` with its interpreter and, on an ISA board that has one, its host port.
    #[must_use]
    pub fn new(board: Board, host_port: Option<HostPort>) -> Self {
        Self {
            board,
            interpreter: Interpreter::new(),
            serial: SerialPort::new(),
            host_port,
            interrupts: Interrupts::default(),
        }
    }

    /// A board of `family` with firmware 1.16D and memory of its own, which no host can map.
    ///
    /// # Errors
    /// [`DpramError`] when the system gives no memory.
    pub fn alone(family: &'static Family) -> Result<Self, DpramError> {
        Ok(Self::new(Board::alone(family)?, None))
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
        self.interpreter.execute(&mut self.board, line)
    }

    /// Gives `bytes` to the serial port and returns what the port answers. A board whose watchdog has tripped is deaf.
    pub fn serial(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut output = Vec::new();
        for &byte in bytes {
            if !self.board.watchdog {
                self.serial.receive(&mut self.board, &mut self.interpreter, byte, &mut output);
            }
        }
        output
    }

    /// What the board has sent to the serial port without being asked (`SEND`, `CMD`) since the last call.
    pub fn take_serial_messages(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.board.serial_output)
    }

    /// As the reset switch.
    pub fn reset(&mut self) {
        self.board.reset(false);
        self.interpreter.reset();
    }

    /// One servo cycle, the background pass after it, and the interrupts that follow. Once the watchdog has tripped only
    /// the host port is alive.
    pub fn step(&mut self) {
        if !self.board.watchdog {
            self.cycle();
        }
        let raised = std::mem::take(&mut self.board.ascii.interrupts);
        let raised = match &mut self.host_port {
            Some(port) => port.poll(raised, &mut self.board),
            None => raised,
        };
        let faults = &mut self.board.faults;
        let spurious = u64::from(faults.spurious_interrupts > 0);
        faults.spurious_interrupts = faults.spurious_interrupts.saturating_sub(1);
        self.interrupts.response += lose(raised, faults) + spurious;
        if let Some(mailbox) = &mut self.board.mailbox {
            self.interrupts.mailbox_taken += lose(std::mem::take(&mut mailbox.taken), faults);
            self.interrupts.mailbox_response += lose(std::mem::take(&mut mailbox.responses), faults);
        }
    }

    fn cycle(&mut self) {
        let board = &mut self.board;
        board.servo_cycle();
        if !board.faults.hides_memory() {
            mailbox::poll(board, &mut self.interpreter);
        }
        if board.is_out_of_reach() {
            if !board.faults.hides_memory() {
                board.housekeeping();
            }
            return;
        }
        ascii::poll(board, &mut self.interpreter);
        functions::poll(board);
        if !board.watchdog {
            board.housekeeping();
        }
    }

    /// The interrupts raised since the last call.
    pub fn take_interrupts(&mut self) -> Interrupts {
        std::mem::take(&mut self.interrupts)
    }
}

/// The interrupts that are left of `raised` when the fault `lost_interrupt` has taken its share.
fn lose(raised: u64, faults: &mut Faults) -> u64 {
    let lost = raised.min(faults.lost_interrupts);
    if faults.lost_interrupts != u64::MAX {
        faults.lost_interrupts -= lost;
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
