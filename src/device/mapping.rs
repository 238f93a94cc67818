//! The only mapping of hardware, and every access to it; the request that sets a bridge's window; and the descriptors
//! that this process inherited.
//!
//! The board writes this memory, too, so no reference or slice points to it. Each access is one instruction on an
//! aligned address, of exactly 16 bits; of 32 bits where the board takes them; of 8 bits for byte registers. The
//! instructions are in assembly: a compiler may fuse or split a volatile access, a 16-bit bus may not tolerate that,
//! and an emulated board decodes only plain moves.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd, RawFd};
use std::sync::atomic::{AtomicU64, Ordering, fence};

use memmap2::{MmapOptions, MmapRaw};

use crate::device::Access;

/// A mapped window of a board's memory, `length` bytes long and 2-byte aligned.
pub struct Mapping {
    map: MmapRaw,
    /// Start of the window in the page-aligned mapping.
    skip: usize,
    length: usize,
    access: Access,
}

impl Mapping {
    /// Maps `length` bytes of `file` from byte `offset` on. The offset must be even; it need not be page-aligned.
    ///
    /// # Errors
    /// The error of `mmap`, or `InvalidInput` for an odd offset or an empty window.
    pub fn new(file: &File, offset: u64, length: usize) -> io::Result<Self> {
        if !offset.is_multiple_of(2) || length == 0 {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!(
                    "a window of {length} bytes at {offset:#x} cannot be mapped: it must be even and not empty"
                ),
            ));
        }
        let skip = offset % page_bytes();
        Self::within(file, offset - skip, skip as usize, length)
    }

    /// Maps `length` bytes that begin `skip` bytes behind the place `start` of `file`. A UIO device's `start` selects
    /// one of its maps, so the window may begin pages behind it.
    ///
    /// # Errors
    /// The error of `mmap`, or `InvalidInput` for a `start` that is not on a page, an odd `skip`, and a window that is
    /// empty or too long.
    pub fn within(file: &File, start: u64, skip: usize, length: usize) -> io::Result<Self> {
        let is_aligned = start.is_multiple_of(page_bytes()) && skip.is_multiple_of(2);
        let total = skip.checked_add(length).filter(|_| is_aligned && length > 0);
        let total = total.ok_or_else(|| {
            let text = format!(
                "a window of {length} bytes, {skip:#x} bytes on, must be even and not empty, from a page on"
            );
            io::Error::new(io::ErrorKind::InvalidInput, text)
        })?;
        let map = MmapOptions::new().offset(start).len(total).map_raw(file)?;
        Ok(Self { map, skip, length, access: Access::Bits16 })
    }

    /// The same window, with data read by accesses of up to this width.
    #[must_use]
    pub fn with_access(self, access: Access) -> Self {
        Self { access, ..self }
    }

    /// The maximum width of a read of data.
    #[must_use]
    pub fn access(&self) -> Access {
        self.access
    }

    /// The window's length in bytes.
    #[must_use]
    pub fn length(&self) -> usize {
        self.length
    }

    /// Reads the word at byte `offset`, or `None` when the offset is odd or outside the window.
    #[inline]
    #[must_use]
    pub fn read16(&self, offset: usize) -> Option<u16> {
        self.word(offset).map(|word| {
            // SAFETY: `word` gives only aligned addresses inside the mapping, which lives as long as `self`.
            unsafe { load16(word) }
        })
    }

    /// Reads consecutive words from byte `offset` on, ascending, each by one access; `None`, without a read, when the
    /// offset is odd or their end outside the window.
    #[inline]
    #[must_use]
    pub fn read_words(&self, offset: usize, words: &mut [u16]) -> Option<()> {
        let end = words.len().checked_mul(2)?.checked_add(offset)?;
        if end % 2 != 0 || end > self.length {
            return None;
        }
        if words.is_empty() {
            return Some(());
        }
        let first = self.word(offset)?;
        for (index, word) in words.iter_mut().enumerate() {
            // SAFETY: the first of these words lies in the mapping, and their end was checked, so all do.
            let place = unsafe { first.add(index) };
            // SAFETY: as above; `word` gives only aligned addresses, and the mapping lives as long as `self`.
            *word = unsafe { load16(place) };
        }
        Some(())
    }

    /// Reads the word at byte `offset` and the next one by one 32-bit access; `None` when its address is no multiple of
    /// 4 or the window ends before.
    #[inline]
    #[must_use]
    pub fn read32(&self, offset: usize) -> Option<[u16; 2]> {
        let end = offset.checked_add(4).filter(|end| *end <= self.length)?;
        let word = self.word(end - 4).filter(|_| (self.skip + offset).is_multiple_of(4))?;
        // SAFETY: `word` lies in the mapping, which lives as long as `self`, and so do the 4 bytes from there on: the
        // window's end was checked. A mapping begins on a page, so `skip + offset` has the address's alignment.
        let pair = unsafe { load32(word.cast()) };
        Some(crate::format::split32(pair))
    }

    /// Writes the word at byte `offset`; `None` when the offset is odd or outside the window.
    #[inline]
    #[must_use]
    pub fn write16(&self, offset: usize, value: u16) -> Option<()> {
        self.word(offset).map(|word| {
            // SAFETY: `word` gives only aligned addresses inside the mapping, which is writable and lives as long as
            // `self`.
            unsafe { store16(word, value) }
        })
    }

    /// Reads the byte register at `offset`, or `None` when it is outside the window.
    #[inline]
    #[must_use]
    pub fn read8(&self, offset: usize) -> Option<u8> {
        self.byte(offset).map(|byte| {
            // SAFETY: `byte` gives only addresses inside the mapping, which lives as long as `self`.
            unsafe { load8(byte) }
        })
    }

    /// Writes the byte register at `offset`; `None` when it is outside the window.
    #[inline]
    #[must_use]
    pub fn write8(&self, offset: usize, value: u8) -> Option<()> {
        self.byte(offset).map(|byte| {
            // SAFETY: `byte` gives only addresses inside the mapping, which is writable and lives as long as `self`.
            unsafe { store8(byte, value) }
        })
    }

    /// Reads before this call happen before reads after it.
    #[inline]
    pub fn order_reads(&self) {
        // x86: uncached reads stay in order (Intel SDM volume 3A, "Methods of Caching Available"), and the fence binds only
        // the compiler. 32-bit ARM: the fence is `dmb ish`; the kernel maps a device as one whose accesses stay in order.
        fence(Ordering::Acquire);
        // 64-bit ARM: the kernel maps a device as Device-nGnRnE or -nGnRE, and accesses to one device stay in order there
        // (ARM DDI 0487, B2 "Device memory"). A bridge has several devices behind it, and a window may be mapped as Normal
        // memory: so a barrier of loads, in the outer shareable domain, which holds the devices, as the kernel's `readw`
        // has it. The fence above orders inner-shareable memory only.
        #[cfg(target_arch = "aarch64")]
        // SAFETY: a barrier instruction touches no memory.
        unsafe {
            std::arch::asm!("dmb oshld", options(nostack, preserves_flags));
        }
    }

    /// Writes before this call reach the memory before writes after it.
    #[inline]
    pub fn order_writes(&self) {
        // As in `order_reads`. x86: uncached writes stay in order, and none is combined with another.
        fence(Ordering::Release);
        // 64-bit ARM: a barrier of stores, as the kernel's `writew` has it.
        #[cfg(target_arch = "aarch64")]
        // SAFETY: a barrier instruction touches no memory.
        unsafe {
            std::arch::asm!("dmb oshst", options(nostack, preserves_flags));
        }
    }

    #[inline]
    fn word(&self, offset: usize) -> Option<*mut u16> {
        if !offset.is_multiple_of(2) || offset.checked_add(2)? > self.length {
            return None;
        }
        // SAFETY: skip + offset + 2 <= skip + length, the length of the mapping.
        Some(unsafe { self.map.as_mut_ptr().add(self.skip + offset) }.cast())
    }

    #[inline]
    fn byte(&self, offset: usize) -> Option<*mut u8> {
        if offset >= self.length {
            return None;
        }
        // SAFETY: skip + offset < skip + length, the length of the mapping.
        Some(unsafe { self.map.as_mut_ptr().add(self.skip + offset) })
    }
}

mod vme_user {
    nix::ioctl_write_ptr!(set_master, 0xAE, 4, [u8; 32]);
}

/// Has vme_user set the master window behind `node`; `master` is the kernel's `struct vme_master`.
pub(in crate::device) fn set_vme_master(node: &File, master: &[u8; 32]) -> nix::Result<()> {
    // SAFETY: the request's number holds the argument's size, and the kernel copies these 32 bytes and keeps no pointer to
    // them. A driver without this request refuses it.
    unsafe { vme_user::set_master(node.as_raw_fd(), master) }.map(drop)
}

/// The size of a page in bytes.
#[must_use]
pub fn page_bytes() -> u64 {
    let page = nix::unistd::sysconf(nix::unistd::SysconfVar::PAGE_SIZE).ok().flatten();
    page.and_then(|page| u64::try_from(page).ok()).unwrap_or(4096)
}

/// Descriptors that [`inherited`] has given out, one bit each.
static GIVEN_OUT: AtomicU64 = AtomicU64::new(0);

/// The open descriptor `number` (3 to 63) that this process inherited, set to close in child programs. Gives out each
/// number once, so that each descriptor has one owner.
///
/// Call it only for a number that the service manager handed over to this very process: the service manager promises
/// that nothing else in the process owns the descriptor.
pub(in crate::device) fn inherited(number: RawFd) -> Option<OwnedFd> {
    let bit =
        u32::try_from(number).ok().filter(|number| (3..64).contains(number)).map(|number| 1 << number)?;
    if GIVEN_OUT.fetch_or(bit, Ordering::Relaxed) & bit != 0 {
        return None;
    }
    // SAFETY: F_SETFD on a number that is open here, or EBADF; it touches no memory.
    if unsafe { libc::fcntl(number, libc::F_SETFD, libc::FD_CLOEXEC) } < 0 {
        return None;
    }
    // SAFETY: the descriptor is open; the service manager promises that nothing else in this process owns it; and the
    // bit above keeps it from being given out twice.
    Some(unsafe { OwnedFd::from_raw_fd(number) })
}

/// Loads a number by one instruction: that for x86 or that for 64-bit ARM. On other processors a volatile access is the best
/// that Rust offers.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
macro_rules! load {
    ($place:ident: $number:ty, $class:ident, $x86:literal, $arm:literal) => {{
        let value: $number;
        // No `nomem`, so the compiler keeps the order of accesses.
        std::arch::asm!($x86, out($class) value, in(reg) $place, options(nostack, preserves_flags, readonly));
        value
    }};
}
#[cfg(target_arch = "aarch64")]
macro_rules! load {
    ($place:ident: $number:ty, $class:ident, $x86:literal, $arm:literal) => {{
        let value: $number;
        std::arch::asm!($arm, out(reg) value, in(reg) $place, options(nostack, preserves_flags, readonly));
        value
    }};
}
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64")))]
macro_rules! load {
    ($place:ident: $number:ty, $class:ident, $x86:literal, $arm:literal) => {
        $place.read_volatile()
    };
}

/// Stores a number by one instruction, as [`load`] loads one.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
macro_rules! store {
    ($place:ident = $value:expr, $class:ident, $x86:literal, $arm:literal) => {
        std::arch::asm!($x86, in(reg) $place, in($class) $value, options(nostack, preserves_flags))
    };
}
#[cfg(target_arch = "aarch64")]
macro_rules! store {
    ($place:ident = $value:expr, $class:ident, $x86:literal, $arm:literal) => {
        std::arch::asm!($arm, in(reg) $place, in(reg) $value, options(nostack, preserves_flags))
    };
}
#[cfg(not(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64")))]
macro_rules! store {
    ($place:ident = $value:expr, $class:ident, $x86:literal, $arm:literal) => {
        $place.write_volatile($value)
    };
}

/// A bus bridge keeps the addresses of bytes, so a word's first byte is its low byte on big-endian hosts, too.
///
/// # Safety
/// `word` is 2-byte aligned and points into a live readable mapping.
#[inline]
unsafe fn load16(word: *const u16) -> u16 {
    // SAFETY: by the caller's promise.
    u16::from_le(unsafe { load!(word: u16, reg, "mov {0:x}, word ptr [{1}]", "ldrh {0:w}, [{1}]") })
}

/// The word at the lower address is the low half on every host: see [`load16`].
///
/// # Safety
/// `pair` is 4-byte aligned and points to 4 bytes of a live readable mapping.
#[inline]
unsafe fn load32(pair: *const u32) -> u32 {
    // SAFETY: by the caller's promise.
    u32::from_le(unsafe { load!(pair: u32, reg, "mov {0:e}, dword ptr [{1}]", "ldr {0:w}, [{1}]") })
}

/// See [`load16`].
///
/// # Safety
/// `word` is 2-byte aligned and points into a live writable mapping.
#[inline]
unsafe fn store16(word: *mut u16, value: u16) {
    // SAFETY: by the caller's promise.
    unsafe { store!(word = value.to_le(), reg, "mov word ptr [{0}], {1:x}", "strh {1:w}, [{0}]") }
}

/// # Safety
/// `byte` points into a live readable mapping.
#[inline]
unsafe fn load8(byte: *const u8) -> u8 {
    // SAFETY: by the caller's promise.
    unsafe { load!(byte: u8, reg_byte, "mov {0}, byte ptr [{1}]", "ldrb {0:w}, [{1}]") }
}

/// # Safety
/// `byte` points into a live writable mapping.
#[inline]
unsafe fn store8(byte: *mut u8, value: u8) {
    // SAFETY: by the caller's promise.
    unsafe { store!(byte = value, reg_byte, "mov byte ptr [{0}], {1}", "strb {1:w}, [{0}]") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_land_where_they_should_and_nowhere_else() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x3000).unwrap();
        let window = Mapping::new(&file, 0x1802, 0x100).unwrap();
        let whole = Mapping::new(&file, 0, 0x3000).unwrap();
        window.write16(0x10, 0xBEEF).unwrap();
        assert_eq!(whole.read16(0x1812), Some(0xBEEF));
        assert_eq!(whole.read16(0x1810), Some(0));
        assert_eq!(whole.read16(0x1814), Some(0));
    }

    #[test]
    fn a_window_may_begin_pages_behind_the_place_that_is_mapped() {
        let file = tempfile::tempfile().unwrap();
        let page = page_bytes() as usize;
        file.set_len(4 * page as u64).unwrap();
        let window = Mapping::within(&file, page as u64, page + 0x10, 0x20).unwrap();
        window.write16(0x1E, 0xCAFE).unwrap();
        assert_eq!(window.read16(0x20), None);
        assert_eq!(Mapping::new(&file, 0, 4 * page).unwrap().read16(2 * page + 0x2E), Some(0xCAFE));
        assert!(Mapping::within(&file, 0, 1, 2).is_err() && Mapping::within(&file, 2, 0, 2).is_err());
        assert!(Mapping::within(&file, 0, usize::MAX - 1, 2).is_err());
    }

    #[test]
    fn consecutive_words_are_all_inside_or_none_is_read() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        let window = Mapping::new(&file, 0x102, 0x20).unwrap();
        for word in 0..0x10 {
            window.write16(2 * word, 0x1100 + word as u16).unwrap();
        }
        let mut words = [0; 4];
        assert_eq!(
            (window.read_words(0x18, &mut words), words),
            (Some(()), [0x110C, 0x110D, 0x110E, 0x110F])
        );
        for wrong in [0x1A, 0x19, 0x20, usize::MAX - 1, usize::MAX - 5] {
            assert_eq!((window.read_words(wrong, &mut words), words[0]), (None, 0x110C), "{wrong:#x}");
        }
        assert_eq!([0, 0x20].map(|end| window.read_words(end, &mut [])), [Some(()); 2]);
        assert_eq!([1, 0x22].map(|end| window.read_words(end, &mut [])), [None; 2]);
    }

    #[test]
    fn two_words_are_read_at_once_where_they_are_aligned() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        for (start, first) in [(0x100, 0), (0x102, 2)] {
            let window = Mapping::new(&file, start, 0x20).unwrap();
            for word in 0..0x10 {
                window.write16(2 * word, 0x1100 + word as u16).unwrap();
            }
            let word = 0x1100 + first as u16 / 2;
            assert_eq!(window.read32(first), Some([word, word + 1]));
            assert_eq!(window.read32(first + 4), Some([word + 2, word + 3]));
            for wrong in [first + 1, first + 2, first + 3, 0x1E, 0x20, usize::MAX - 3, usize::MAX] {
                assert_eq!(window.read32(wrong), None, "{start:#x} {wrong:#x}");
            }
        }
        assert_eq!(Mapping::new(&file, 0x100, 0x20).unwrap().read32(0x1C), Some([0x110E - 1, 0x110F - 1]));
    }

    #[test]
    fn descriptors_nobody_handed_over_are_not_taken() {
        assert!(inherited(0).is_none() && inherited(2).is_none() && inherited(-1).is_none());
        assert!(inherited(64).is_none() && inherited(i32::MAX).is_none());
    }

    #[test]
    fn a_byte_register_leaves_its_neighbours_alone() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        let window = Mapping::new(&file, 0x200, 0x200).unwrap();
        for offset in 0..3 {
            window.write16(2 * offset, 0x1111).unwrap();
        }
        window.write8(3, 0xAB).unwrap();
        assert_eq!((window.read8(2), window.read8(3), window.read8(4)), (Some(0x11), Some(0xAB), Some(0x11)));
        assert_eq!(window.read16(2), Some(0xAB11));
        assert_eq!(Mapping::new(&file, 0, 0x1000).unwrap().read8(0x203), Some(0xAB));
        assert_eq!((window.read8(0x1FF), window.read8(0x200)), (Some(0), None));
        assert_eq!(window.write8(0x200, 1), None);
    }

    #[test]
    fn nothing_outside_the_window_or_odd_is_touched() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        let window = Mapping::new(&file, 0, 0x100).unwrap();
        assert_eq!(window.read16(0x100), None);
        assert_eq!(window.read16(0xFF), None);
        assert_eq!(window.read16(usize::MAX - 1), None);
        assert_eq!(window.write16(0x100, 1), None);
        assert_eq!(window.read16(0xFE), Some(0));
        assert!(Mapping::new(&file, 1, 2).is_err());
        assert!(Mapping::new(&file, 0, 0).is_err());
    }
}
