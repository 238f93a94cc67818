//! The set-up registers outside the I-variables that `SAVE` keeps and a reset restores (Software Reference
//! pp. 389-391; User Manual pp. 258-262).
//!
//! X:$0783-$078C set up the VME or ISA address of mailboxes and DPRAM. At a reset the board copies them to
//! X:$E006-$E00F, where they act. `SAVE` and reset treat the encoder conversion table Y:$0720-$073F the same way; its
//! entries have no effect here, where each motor has one encoder.
//!
//! On Turbo, I90 to I99 set up the addresses, and the acting copies begin at X:$070006 (Turbo User Manual pp. 399-400).

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
/// The values of X:$0786 and X:$0787 on an ISA board: DPRAM at $D4000, enabled.
const ISA: [u32; 2] = [0x0D, 0x45];

/// The ports and interrupts that a PMAC's host finds with the set-up in force. The simulated host looks at the
/// addresses and takes the interrupts of the factory values: a user tells a real host other addresses, but not this
/// host. The simulator does not judge Turbo boards: those on the PCI bus use none of this set-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// The DPRAM.
    pub dpram: bool,
    /// The VME mailboxes; their chip also takes the DPRAM's page.
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
        // The register with the enable bits has the factory value, or enables the DPRAM.
        let enabled = active[8] == VME[8] || active[8] & VME_DPRAM != 0;
        let mailboxes = active[..5] == VME[..5] && active[9] == VME[9];
        Self {
            dpram: mailboxes && active[7] == VME[7] && enabled,
            mailboxes,
            interrupts: active[5..7] == VME[5..7],
        }
    }
}

/// The registers' values, present or saved.
#[derive(Debug, Clone)]
pub struct BusSetup {
    bus: Vec<u32>,
    conversion: Vec<u32>,
}

impl BusSetup {
    /// The factory values of an ISA board, or with `vme` of a VME board.
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

    /// Writes the values back to the registers, and puts the bus set-up into force.
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
