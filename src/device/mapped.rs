//! Mapped memory as a bus: what every board that is mapped does alike, each word by one access, ascending, once.

use super::mapping::Mapping;
use super::{Bus, BusError};
use crate::map::HostOffset;

impl Bus for Mapping {
    fn length(&self) -> usize {
        Mapping::length(self)
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        Mapping::read16(self, offset.bytes() as usize).ok_or_else(|| out_of_range(self, offset, 1))
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        Mapping::write16(self, offset.bytes() as usize, value).ok_or_else(|| out_of_range(self, offset, 1))
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        let (start, count) = (first.bytes() as usize, words.len());
        if start + 2 * count > Mapping::length(self) {
            return Err(out_of_range(self, first, count));
        }
        for (index, word) in words.iter_mut().enumerate() {
            let read = Mapping::read16(self, start + 2 * index);
            *word = read.ok_or_else(|| out_of_range(self, first, count))?;
        }
        Ok(())
    }

    fn order_reads(&mut self) {
        Mapping::order_reads(self);
    }

    fn order_writes(&mut self) {
        Mapping::order_writes(self);
    }
}

fn out_of_range(mapping: &Mapping, offset: HostOffset, words: usize) -> BusError {
    BusError::OutOfRange { offset, words, length: mapping.length() }
}
