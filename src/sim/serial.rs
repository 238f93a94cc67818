//! The serial port: raw bytes both ways. What several clients send is one stream, as on a wire; each gets every reply.

use super::language::SerialPort;
use super::machine::Board;
use super::socket::{Client, Listener};

/// The port and who is connected to it.
pub struct Serial {
    listener: Listener,
    clients: Vec<Client>,
    port: SerialPort,
}

impl Serial {
    /// A port nobody is connected to.
    #[must_use]
    pub fn new(listener: Listener, port: SerialPort) -> Self {
        Self { listener, clients: Vec::new(), port }
    }

    /// Takes new clients, gives what they sent to the board, sends back what it answers.
    pub fn serve(&mut self, board: &mut Board) {
        self.listener.accept(&mut self.clients);
        let mut output = Vec::new();
        let mut buffer = [0; 1024];
        for client in &mut self.clients {
            client.flush();
            for &byte in client.receive(&mut buffer) {
                // A board whose watchdog has tripped hears nothing.
                if board.machine.watchdog {
                    continue;
                }
                self.port.receive(&mut board.machine, &mut board.interpreter, byte, &mut output);
            }
        }
        self.transmit(&output);
        self.clients.retain(|client| !client.gone());
    }

    /// Sends `bytes` to everybody.
    pub fn transmit(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            for client in &mut self.clients {
                client.send(bytes);
            }
        }
    }
}
