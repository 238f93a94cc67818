//! The interrupt line: every connected host reads the count of interrupts so far, four bytes in native order, as a UIO
//! descriptor gives it. A host that is slow gets the latest count once, as with UIO.

use crate::sim::process::socket::{Client, Listener};

/// The line and the hosts that listen to it.
#[derive(Debug)]
pub struct InterruptLine {
    listener: Listener,
    clients: Vec<Client>,
    count: u32,
    /// The count has risen since all hosts last got it.
    due: bool,
}

impl InterruptLine {
    /// A line that has not been raised yet.
    #[must_use]
    pub fn new(listener: Listener) -> Self {
        Self { listener, clients: Vec::new(), count: 0, due: false }
    }

    /// Raises the line `times` times.
    pub fn raise(&mut self, times: u64) {
        self.count = self.count.wrapping_add(times as u32);
        self.due = true;
        self.tell();
    }

    /// Takes new hosts and sends the count to those that wait. Reads the words that hosts write (UIO's enable word)
    /// without effect: the line is always enabled.
    pub fn serve(&mut self) {
        self.listener.accept(&mut self.clients);
        let mut buffer = [0; 64];
        for client in &mut self.clients {
            client.receive(&mut buffer);
            client.flush();
        }
        self.clients.retain(|client| !client.gone());
        if self.due {
            self.tell();
        }
    }

    fn tell(&mut self) {
        self.due = false;
        for client in &mut self.clients {
            if client.idle() {
                client.send(&self.count.to_ne_bytes());
            } else {
                // The host's socket is full: the host gets the latest count when it has read on.
                self.due = true;
            }
        }
    }
}
