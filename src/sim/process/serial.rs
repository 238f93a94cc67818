//! The serial port: raw bytes both ways. The bytes of several clients form one stream, as on a wire; each gets every
//! reply.

use crate::sim::process::socket::{Client, Listener};
use crate::sim::world::World;

/// The port and its clients.
pub struct Serial {
    listener: Listener,
    clients: Vec<Client>,
}

impl Serial {
    /// A port without clients.
    #[must_use]
    pub fn new(listener: Listener) -> Self {
        Self { listener, clients: Vec::new() }
    }

    /// Takes new clients, gives their bytes to the board, sends the board's answer back.
    pub fn serve(&mut self, world: &mut World) {
        self.listener.accept(&mut self.clients);
        let mut output = Vec::new();
        let mut buffer = [0; 1024];
        for client in &mut self.clients {
            client.flush();
            output.extend(world.serial(client.receive(&mut buffer)));
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
