//! Where the DPRAM lies in the memory of an ISA (PC bus) host: X:$0786 and X:$0787, on Turbo I93 and I94.
//!
//! Source: DPRAM manual, "Starting Address" (pp. 3-4), with bit 3 and the size bit as the software reference has them;
//! Turbo: I93 holds A23-A16, the high digit of I94 A15-A14, its low digit 5 for a window of 16 KiB and 4 for 64 KiB.
//! The host owns these registers; PMAC copies them into the working ones (X:$E009, X:$E00A) at reset only.

use super::{SetupPlan, SetupValue, WINDOW, with_save_and_reset};
use crate::map::Generation;

/// How many address lines the DPRAM decodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IsaAddressing {
    /// A19-A14: the first megabyte.
    Bits20,
    /// A23-A14: the first 16 megabytes.
    Bits24,
}

/// How much of the DPRAM a Turbo board shows at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TurboWindow {
    /// 16 KiB: all of an 8K x 16 DPRAM, a bank of a 32K x 16 one.
    #[default]
    Kib16,
    /// 64 KiB: all of a 32K x 16 DPRAM.
    Kib64,
}

impl TurboWindow {
    const fn bytes(self) -> u32 {
        match self {
            Self::Kib16 => WINDOW,
            Self::Kib64 => 4 * WINDOW,
        }
    }
}

/// A set-up that is not possible, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum IsaError {
    /// The start lies between two windows.
    #[error(
        "DPRAM start ${address:06X} is not a multiple of {} KiB (${window:04X}), the smallest step the board can \
         be set to; ${:06X} is", window / 1024, address & !(window - 1)
    )]
    NotAligned {
        /// The start that was asked for.
        address: u32,
        /// The step in bytes.
        window: u32,
    },
    /// The start needs more address lines.
    #[error(
        "DPRAM start ${address:06X} is out of reach of {bits}-bit addressing, whose last start is ${last:06X}{}",
        if *bits == 20 && *address < 1 << 24 { "; use 24-bit addressing" } else { "" }
    )]
    OutOfReach {
        /// The start that was asked for.
        address: u32,
        /// The address lines decoded.
        bits: u32,
        /// The highest possible start.
        last: u32,
    },
    /// A Turbo board has no such setting.
    #[error("no setting of I93 and I94 is known that gives {what} on a Turbo board")]
    NotOnTurbo {
        /// The requested setting.
        what: &'static str,
    },
}

/// Gives the lines that place a PMAC's DPRAM at `address` (bytes, on the ISA bus), enabled or not.
///
/// # Errors
/// [`IsaError`] when no setting of the registers means that address.
pub fn pmac(address: u32, addressing: IsaAddressing, enabled: bool) -> Result<SetupPlan, IsaError> {
    let bits = match addressing {
        IsaAddressing::Bits20 => 20,
        IsaAddressing::Bits24 => 24,
    };
    check(address, bits, WINDOW)?;
    let mode = u32::from(addressing == IsaAddressing::Bits24) << 2;
    let (high, low) = (address >> 16, (address >> 14 & 3) << 6 | mode | u32::from(enabled));
    let unused = if bits == 20 { " (A23-A20 are not decoded)" } else { "" };
    let values = vec![
        SetupValue::new("X:$0786".to_owned(), high).field(
            7,
            0,
            format!("A23-A16 of the DPRAM's start{unused}"),
        ),
        SetupValue::new("X:$0787".to_owned(), low)
            .field(7, 6, "A15-A14 of the DPRAM's start")
            .field(5, 3, "reserved")
            .field(2, 2, format!("{bits}-bit addressing"))
            .field(1, 1, "8K x 16 bit DPRAM")
            .field(0, 0, if enabled { "DPRAM enabled" } else { "DPRAM disabled" }),
    ];
    let line = format!("WX:$786,${high:05X},${low:05X}");
    let warnings = if enabled { neighbours(address, WINDOW) } else { Vec::new() };
    Ok(SetupPlan { commands: with_save_and_reset(vec![line]), after_reset: None, values, warnings })
}

/// Gives the lines that place a Turbo board's DPRAM at `address` (bytes, on the ISA bus).
///
/// # Errors
/// [`IsaError`] when no setting of I93 and I94 means that address.
pub fn turbo(address: u32, window: TurboWindow) -> Result<SetupPlan, IsaError> {
    check(address, 24, window.bytes())?;
    let mode = if window == TurboWindow::Kib16 { 5 } else { 4 };
    let (high, low) = (address >> 16, (address >> 14 & 3) << 6 | mode);
    let values = vec![
        SetupValue::new("I93".to_owned(), high).field(7, 0, "A23-A16 of the DPRAM's start"),
        SetupValue::new("I94".to_owned(), low)
            .field(7, 6, if mode == 5 { "A15-A14 of the DPRAM's start" } else { "0 for a window of 64 KiB" })
            .field(5, 4, "0")
            .field(3, 0, if mode == 5 { "a window of 16 KiB" } else { "a window of 64 KiB" }),
    ];
    let lines = vec![format!("I93=${high:02X}"), format!("I94=${low:02X}")];
    let warnings = neighbours(address, window.bytes());
    Ok(SetupPlan { commands: with_save_and_reset(lines), after_reset: None, values, warnings })
}

/// As [`pmac`] or [`turbo`], by the board's generation.
///
/// # Errors
/// [`IsaError`]; for a Turbo board also for 20-bit addressing or a disabled DPRAM.
pub fn plan(
    generation: Generation,
    address: u32,
    addressing: IsaAddressing,
    enabled: bool,
    window: TurboWindow,
) -> Result<SetupPlan, IsaError> {
    match generation {
        Generation::Pmac => pmac(address, addressing, enabled),
        Generation::Turbo if !enabled => Err(IsaError::NotOnTurbo { what: "a disabled DPRAM" }),
        Generation::Turbo if addressing == IsaAddressing::Bits20 => {
            Err(IsaError::NotOnTurbo { what: "20-bit addressing" })
        }
        Generation::Turbo => turbo(address, window),
    }
}

fn check(address: u32, bits: u32, window: u32) -> Result<(), IsaError> {
    if address >> bits != 0 {
        return Err(IsaError::OutOfReach { address, bits, last: (1 << bits) - window });
    }
    if !address.is_multiple_of(window) {
        return Err(IsaError::NotAligned { address, window });
    }
    Ok(())
}

/// The usual devices at that place in a PC (DPRAM manual p. 3); between $B0000 and $EFFFF a PC may have room.
fn neighbours(address: u32, window: u32) -> Vec<String> {
    let last = address + (window - 1);
    let others = [
        (0x00_0000, 0x09_FFFF, "the PC's main memory"),
        (0x0A_0000, 0x0A_FFFF, "graphics memory"),
        (0x0F_0000, 0x0F_FFFF, "the system BIOS"),
        (0x10_0000, 0xFF_FFFF, "main memory, unless the BIOS leaves a hole for ISA boards there"),
    ];
    let meets = |(first, end, _): &&(u32, u32, &str)| address <= *end && *first <= last;
    others
        .iter()
        .filter(meets)
        .map(|(_, _, what)| {
            format!("${address:06X}-${last:06X} is usually {what}; nothing else may answer there")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn commands(address: u32, addressing: IsaAddressing, enabled: bool) -> Vec<String> {
        pmac(address, addressing, enabled).unwrap().commands
    }

    #[test]
    fn the_manuals_examples() {
        use IsaAddressing::{Bits20, Bits24};
        assert_eq!(commands(0xEC000, Bits24, true), ["WX:$786,$0000E,$000C5", "SAVE", "$$$"]);
        assert_eq!(commands(0xEC000, Bits24, false), ["WX:$786,$0000E,$000C4", "SAVE", "$$$"]);
        // The factory's own setting is $0D, $45.
        assert_eq!(commands(0xD4000, Bits24, true)[0], "WX:$786,$0000D,$00045");
        assert_eq!(commands(0xEC000, Bits20, true)[0], "WX:$786,$0000E,$000C1");
        assert_eq!(commands(0xFF_C000, Bits24, true)[0], "WX:$786,$000FF,$000C5");
    }

    #[test]
    fn turbo_boards_have_variables_instead() {
        let lines = |address, window| turbo(address, window).unwrap().commands;
        assert_eq!(lines(0x0E_C000, TurboWindow::Kib16), ["I93=$0E", "I94=$C5", "SAVE", "$$$"]);
        assert_eq!(lines(0x0C_0000, TurboWindow::Kib64), ["I93=$0C", "I94=$04", "SAVE", "$$$"]);
        assert_eq!(lines(0x0D_4000, TurboWindow::Kib16)[..2], ["I93=$0D", "I94=$45"]);
        assert!(turbo(0x0C_4000, TurboWindow::Kib64).is_err());
        let disabled = plan(Generation::Turbo, 0xEC000, IsaAddressing::Bits24, false, TurboWindow::Kib16);
        assert!(disabled.unwrap_err().to_string().contains("a disabled DPRAM"));
        assert!(plan(Generation::Turbo, 0xEC000, IsaAddressing::Bits20, true, TurboWindow::Kib16).is_err());
    }

    #[test]
    fn impossible_addresses_are_refused_with_the_reason() {
        let refused = |address, addressing| pmac(address, addressing, true).unwrap_err().to_string();
        assert_eq!(
            refused(0xEC100, IsaAddressing::Bits24),
            "DPRAM start $0EC100 is not a multiple of 16 KiB ($4000), the smallest step the board can be set to; \
             $0EC000 is"
        );
        assert_eq!(
            refused(0x10_0000, IsaAddressing::Bits20),
            "DPRAM start $100000 is out of reach of 20-bit addressing, whose last start is $0FC000; \
             use 24-bit addressing"
        );
        assert_eq!(
            refused(0x100_0000, IsaAddressing::Bits24),
            "DPRAM start $1000000 is out of reach of 24-bit addressing, whose last start is $FFC000"
        );
        assert!(refused(u32::MAX, IsaAddressing::Bits20).contains("out of reach"));
    }

    #[test]
    fn a_likely_neighbour_is_named() {
        let warnings = |address| pmac(address, IsaAddressing::Bits24, true).unwrap().warnings;
        assert!(warnings(0xEC000).is_empty());
        assert!(warnings(0xB0000).is_empty());
        assert!(warnings(0x98000)[0].contains("main memory"));
        assert!(warnings(0xF0000)[0].contains("BIOS"));
        assert!(warnings(0xF0_0000)[0].contains("hole"));
        assert!(pmac(0x98000, IsaAddressing::Bits24, false).unwrap().warnings.is_empty());
    }

    proptest! {
        #[test]
        fn the_values_spell_the_address(window in 0u32..0x400, wide in any::<bool>(), enabled in any::<bool>()) {
            let addressing = if wide { IsaAddressing::Bits24 } else { IsaAddressing::Bits20 };
            let address = window << 14;
            let Ok(plan) = pmac(address, addressing, enabled) else {
                prop_assert!(!wide && address > 0xF_C000);
                return Ok(());
            };
            let numbers: Vec<u32> = plan.commands[0].split(",$").skip(1)
                .map(|digits| u32::from_str_radix(digits, 16).unwrap()).collect();
            prop_assert_eq!(numbers[0] << 16 | (numbers[1] & 0xC0) << 8, address);
            prop_assert_eq!(numbers[1] & 0x3F, u32::from(wide) << 2 | u32::from(enabled));
        }

        #[test]
        fn no_address_panics(address in any::<u32>()) {
            let _ = pmac(address, IsaAddressing::Bits20, true);
            let _ = turbo(address, TurboWindow::Kib64);
        }
    }
}
