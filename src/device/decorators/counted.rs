//! Decorator: counts every access, to words or to byte registers. Bus accesses are the cost on real hardware, so the
//! daemon always counts them.

use crate::device::bus::{ByteBus, ByteBusError};
use crate::device::{Access, Bus, BusError, Presence};
use crate::map::HostOffset;
use crate::protocol::board::Replay;

/// Counts reads and writes of words or bytes. A refused access does not count: the bus never saw it.
pub struct Counted<B> {
    bus: B,
    reads: u64,
    writes: u64,
}

impl<B> Counted<B> {
    /// Starts at zero.
    pub fn new(bus: B) -> Self {
        Self { bus, reads: 0, writes: 0 }
    }

    /// Read accesses so far.
    #[must_use]
    pub fn reads(&self) -> u64 {
        self.reads
    }

    /// Write accesses so far.
    #[must_use]
    pub fn writes(&self) -> u64 {
        self.writes
    }

    /// All accesses so far.
    #[must_use]
    pub fn accesses(&self) -> u64 {
        self.reads + self.writes
    }

    /// The bus itself. The counter does not see accesses made through it.
    pub fn bus(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Replaces the bus and keeps the counts.
    pub fn replace(&mut self, bus: B) {
        self.bus = bus;
    }
}

impl<B: Bus> Bus for Counted<B> {
    fn length(&self) -> usize {
        self.bus.length()
    }

    fn access(&self) -> Access {
        self.bus.access()
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let word = self.bus.read16(offset)?;
        self.reads += 1;
        Ok(word)
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.bus.write16(offset, value)?;
        self.writes += 1;
        Ok(())
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        self.bus.read_block(first, words)?;
        self.reads += words.len() as u64;
        Ok(())
    }

    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        let accesses = self.bus.read_data(first, words)?;
        self.reads += accesses as u64;
        Ok(accesses)
    }

    fn order_reads(&mut self) {
        self.bus.order_reads();
    }

    fn order_writes(&mut self) {
        self.bus.order_writes();
    }
}

impl<B: Presence> Presence for Counted<B> {
    fn still_there(&self) -> bool {
        self.bus.still_there()
    }

    fn answers(&mut self) -> bool {
        self.bus.answers()
    }

    fn replay(&self) -> Option<Replay> {
        self.bus.replay()
    }
}

impl<B: ByteBus> ByteBus for Counted<B> {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        let byte = self.bus.read8(offset)?;
        self.reads += 1;
        Ok(byte)
    }

    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.bus.write8(offset, value)?;
        self.writes += 1;
        Ok(())
    }

    fn order_accesses(&mut self) {
        self.bus.order_accesses();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;

    #[test]
    fn every_word_counts_once_and_refused_ones_do_not() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
        bus.read16(HostOffset::new(0)).unwrap();
        bus.write16(HostOffset::new(2), 1).unwrap();
        bus.read_block(HostOffset::new(4), &mut [0; 30]).unwrap();
        assert!(bus.read16(HostOffset::new(0x4000)).is_err());
        assert_eq!((bus.reads(), bus.writes(), bus.accesses()), (31, 1, 32));
    }
}
