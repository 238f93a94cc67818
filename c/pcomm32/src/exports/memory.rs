//! The DPRAM by byte offset.

use super::{BOOL, DWORD, FALSE, int};
use crate::border::{Memory, Place, exports};
use crate::memory;
use pmac_dpram::format::{Float48Layout, fixed48};

/// Writes; `PmacGetError` tells a failure.
fn set(number: DWORD, offset: DWORD, bytes: &[u8]) {
    let _ = memory::write(number, offset, bytes);
}

fn set_bit(number: DWORD, offset: DWORD, bit: DWORD, on: bool) {
    let _ = memory::bit(number, bit).and_then(|mask| memory::set_bits(number, offset, mask, on));
}

exports! {
    /// Copies bytes of the DPRAM; NULL after a failure.
    PmacDPRGetMem(number: DWORD, offset: DWORD, count: usize, room: Memory) -> Memory = Memory::NULL =>
        // Some programs declare the count as an `int`.
        match memory::read(number, offset, count & 0xFFFF_FFFF, !room.is_null()) {
            Ok(bytes) => room.put(&bytes),
            Err(_) => Memory::NULL,
        };
    /// Writes bytes of the DPRAM; NULL after a failure.
    PmacDPRSetMem(number: DWORD, offset: DWORD, count: usize, bytes: Memory) -> Memory = Memory::NULL =>
        match memory::write_copy(number, offset, count & 0xFFFF_FFFF, |count| bytes.copy(count)) {
            Ok(()) => bytes,
            Err(_) => Memory::NULL,
        };
    /// The 16 bits at `offset`; 0 after a failure.
    PmacDPRGetWord(number: DWORD, offset: DWORD) -> u16 = 0 => memory::word(number, offset).unwrap_or(0);
    /// The 32 bits at `offset`; 0 after a failure.
    PmacDPRGetDWord(number: DWORD, offset: DWORD) -> DWORD = 0 => memory::long(number, offset).unwrap_or(0);
    /// The float at `offset`; 0 after a failure.
    PmacDPRGetFloat(number: DWORD, offset: DWORD) -> f32 = 0.0 =>
        memory::long(number, offset).map_or(0.0, f32::from_bits);
    /// Writes 16 bits.
    PmacDPRSetWord(number: DWORD, offset: DWORD, value: u16) -> () = () => set(number, offset, &value.to_le_bytes());
    /// Writes 32 bits.
    PmacDPRSetDWord(number: DWORD, offset: DWORD, value: DWORD) -> () = () =>
        set(number, offset, &value.to_le_bytes());
    /// Writes a float.
    PmacDPRSetFloat(number: DWORD, offset: DWORD, value: f64) -> () = () =>
        set(number, offset, &(value as f32).to_le_bytes());
    /// The bits of `mask` at `offset`.
    PmacDPRGetDWordMask(number: DWORD, offset: DWORD, mask: DWORD) -> DWORD = 0 =>
        memory::long(number, offset).unwrap_or(0) & mask;
    /// Sets the bits of `mask`, or clears them.
    PmacDPRSetDWordMask(number: DWORD, offset: DWORD, mask: DWORD, on: BOOL) -> () = () =>
        drop(memory::set_bits(number, offset, mask, on != FALSE));
    /// Whether a bit is set.
    PmacDPRDWordBitSet(number: DWORD, offset: DWORD, bit: DWORD) -> BOOL = FALSE =>
        match memory::bit(number, bit) {
            Ok(mask) => BOOL::from(memory::long(number, offset).is_ok_and(|long| long & mask != 0)),
            Err(_) => FALSE,
        };
    /// Sets a bit.
    PmacDPRSetDWordBit(number: DWORD, offset: DWORD, bit: DWORD) -> () = () => set_bit(number, offset, bit, true);
    /// Clears a bit.
    PmacDPRResetDWordBit(number: DWORD, offset: DWORD, bit: DWORD) -> () = () =>
        set_bit(number, offset, bit, false);
    /// The 48-bit float in two longs, times `scale`.
    PmacDPRFloat(longs: Place<int>, scale: f64) -> f64 = f64::NAN =>
        longs.copy(2).map_or(f64::NAN, |longs| Float48Layout::default().decode(longs[0] as u32, longs[1] as u32) * scale);
    /// The 48-bit integer in two longs, times `scale`.
    PmacDPRLFixed(longs: Place<int>, scale: f64) -> f64 = f64::NAN =>
        longs.copy(2).map_or(f64::NAN, |longs| fixed48::decode(longs[0] as u32, longs[1] as u32) as f64 * scale);
}
