//! The set-up registers outside the I-variables that `SAVE` keeps and a reset brings back (Software Reference
//! pp. 389-391; User Manual pp. 258-262).
//!
//! X:$0783-$078C set up the VME or ISA address of mailboxes and DPRAM. At a reset the board copies them to
//! X:$E006-$E00F, where they act. The encoder conversion table Y:$0720-$073F is kept the same way; its entries are
//! taken as they are and do nothing here, where motors have one encoder each.
//!
//! On Turbo I90 to I99 set the addresses up, and the copies that act begin at X:$070006 (Turbo User Manual pp. 399-400).

use crate::sim::board::memory::Memory;
use crate::sim::board::variables::Variables;

/// Entries of the encoder conversion table.
const CONVERSIONS: usize = 32;

/// The first of the I-variables in place of the registers.
const FIRST_VARIABLE: usize = 90;

/// Factory values of X:$0783 and following.
const VME: [u32; 10] = [0x39, 0x04, 0x00, 0x7F, 0xA0, 0x02, 0xA1, 0x10, 0x60, 0x10];
/// In X:$078B: the DPRAM is enabled.
const VME_DPRAM: u32 = 0x80;
/// Those of X:$0786 and X:$0787 on an ISA board: DPRAM at $D4000, enabled.
const ISA: [u32; 2] = [0x0D, 0x45];

/// What the host of a PMAC finds with the set-up in force. It looks where the factory values put things, and takes the interrupts
/// that they name: a real host would be told another place, this one is not. Turbo boards are not judged: those of the PCI
/// bus use none of this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// The DPRAM.
    pub dpram: bool,
    /// The VME mailboxes, whose chip also takes the DPRAM's page.
    pub mailboxes: bool,
    /// The VME interrupts, by their level and vectors.
    pub interrupts: bool,
}

impl Found {
    /// With the registers in force in `memory`.
    pub fn with(memory: &Memory, vme: bool) -> Self {
        let at = memory.registers();
        if at.bus_setup.is_none() {
            return Self { dpram: true, mailboxes: true, interrupts: true };
        }
        let active: Vec<u32> =
            (at.bus_active.number..).take(VME.len()).map(|address| memory.read_x(address) & 0xFF).collect();
        if !vme {
            let [high, low] = [active[3], active[4]];
            // Bit 0 enables; bits 7 and 6 are A15-A14; without bit 2 A23-A20 are not decoded.
            let place = |high: u32, low: u32| (if low & 4 == 0 { high & 0xF } else { high }, low & 0xC1);
            return Self {
                dpram: place(high, low) == place(ISA[0], ISA[1]),
                mailboxes: true,
                interrupts: true,
            };
        }
        // The register with the enable bits is as the factory left it, or says DPRAM.
        let enabled = active[8] == VME[8] || active[8] & VME_DPRAM != 0;
        let mailboxes = active[..5] == VME[..5] && active[9] == VME[9];
        Self {
            dpram: mailboxes && active[7] == VME[7] && enabled,
            mailboxes,
            interrupts: active[5..7] == VME[5..7],
        }
    }
}

/// What the registers hold, or held when they were saved.
#[derive(Debug, Clone)]
pub struct BusSetup {
    bus: Vec<u32>,
    conversion: Vec<u32>,
}

impl BusSetup {
    /// The factory values of an ISA board, or of one on the VME bus.
    pub fn factory(vme: bool) -> Self {
        let mut bus = VME.to_vec();
        if !vme {
            bus[3..5].copy_from_slice(&ISA);
        }
        Self { bus, conversion: vec![0; CONVERSIONS] }
    }

    /// The present values, as `SAVE` takes them.
    pub fn of(memory: &Memory) -> Self {
        let at = memory.registers();
        Self {
            bus: at.bus_setup.map_or_else(Vec::new, |first| {
                (first.number..).take(VME.len()).map(|address| memory.read_x(address)).collect()
            }),
            conversion: (at.conversion_table.number..)
                .take(CONVERSIONS)
                .map(|address| memory.read_y(address))
                .collect(),
        }
    }

    /// Puts them back, and the bus set-up into force.
    pub fn put(&self, memory: &mut Memory, variables: &Variables) {
        let at = memory.registers();
        let active = at.bus_active.number..;
        if let Some(first) = at.bus_setup {
            for ((saved, active), &value) in (first.number..).zip(active).zip(&self.bus) {
                memory.write_x(saved, value);
                memory.write_x(active, value);
            }
        } else {
            for (number, active) in (FIRST_VARIABLE..).zip(active).take(VME.len()) {
                memory.write_x(active, variables.i(number) as u32);
            }
        }
        for (address, &value) in (at.conversion_table.number..).zip(&self.conversion) {
            memory.write_y(address, value);
        }
    }
}
