//! The motor and coordinate system that each port addresses.

use crate::sim::board::firmware::Addressing;
use crate::sim::board::output::Port;
use crate::sim::language::interpreter::Interpreter;

/// The interpreters of the ports: one for all ports, or one for each.
#[derive(Debug, Clone)]
pub struct Ports {
    addressing: Addressing,
    serial: Interpreter,
    dpram: Interpreter,
    mailbox: Interpreter,
}

impl Ports {
    /// The ports of a board with that addressing, as after power-up.
    #[must_use]
    pub fn new(addressing: Addressing) -> Self {
        let interpreter = Interpreter::new;
        Self { addressing, serial: interpreter(), dpram: interpreter(), mailbox: interpreter() }
    }

    /// The interpreter of `port`.
    pub fn at(&mut self, port: Port) -> &mut Interpreter {
        match (self.addressing, port) {
            (Addressing::Shared, _) | (_, Port::Dpram) => &mut self.dpram,
            (_, Port::Serial) => &mut self.serial,
            (_, Port::Mailbox) => &mut self.mailbox,
        }
    }

    /// As after power-up and reset.
    pub fn reset(&mut self) {
        *self = Self::new(self.addressing);
    }
}
