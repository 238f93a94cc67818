//! Where mailboxes and DPRAM lie on the VME bus, and how the board interrupts: X:$0783 to X:$078C, on Turbo I90 to I99.
//!
//! Source: DPRAM manual, "VME and/or DPRAM Address Setup" (pp. 4-6); PMAC user manual, "Writing a Host Communications
//! Program". The mailbox chip takes 512 bytes, the DPRAM 16 KiB. The DPRAM shares address lines A31-A24 with the
//! mailboxes. A register of its own saves A23-A20. The mailbox chip takes A19-A14, as a byte at $121 from its base;
//! the host writes that byte after every reset, because the board forgets it. The Turbo user manual puts A23-A20 into
//! the low digit of I97; the DPRAM manual, and boards that work, have them in the high digit, as here.

use super::{BusWrite, SetupPlan, SetupValue, WINDOW, last_of_window, with_save_and_reset};
use crate::map::Generation;
use crate::map::mailbox::page_of;

/// The bytes that the mailbox chip occupies.
pub const MAILBOX_BYTES: u32 = crate::map::mailbox::LENGTH as u32;
/// Where, from the mailboxes' base, the host writes A19-A14 of the DPRAM.
pub const PAGE_SELECT: u32 = crate::map::mailbox::PAGE_SELECT as u32;
/// Address-modifier bits that do not matter: the board takes supervisor and user accesses alike.
const MODIFIER_IGNORED: u32 = 0x04;
/// The multiple at which the windows of a Tsi148 begin and end; its driver refuses others
/// (drivers/staging/vme_user/vme_tsi148.c).
const BRIDGE_STEP: u32 = 0x1_0000;

/// How many address lines the board decodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AddressBits {
    /// A16, "short" addressing: modifiers $29 and $2D.
    A16,
    /// A24, "standard" addressing: modifiers $39 and $3D.
    A24,
    /// A32, "extended" addressing: modifiers $09 and $0D.
    A32,
}

impl AddressBits {
    /// Their number.
    #[must_use]
    pub const fn count(self) -> u32 {
        match self {
            Self::A16 => 16,
            Self::A24 => 24,
            Self::A32 => 32,
        }
    }

    const fn modifier(self) -> u32 {
        match self {
            Self::A16 => 0x29,
            Self::A24 => 0x39,
            Self::A32 => 0x09,
        }
    }

    /// Bits 5 and 4 of the bus-width register.
    const fn width(self) -> u32 {
        match self {
            Self::A16 => 0x30,
            Self::A24 => 0x10,
            Self::A32 => 0x00,
        }
    }
}

/// The wanted settings of a board on the VME bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VmeSetup {
    /// The mailboxes' base, a bus address in bytes.
    pub mailbox: u32,
    /// The DPRAM's start, a bus address in bytes; `None` on a board without DPRAM, or to switch it off.
    pub dpram: Option<u32>,
    /// The address lines decoded.
    pub address_bits: AddressBits,
    /// The interrupt line, 1 to 7.
    pub irq_level: u32,
    /// The middle one of the three interrupt vectors: one less means "command taken", this one "response in the
    /// mailboxes", one more "response in the DPRAM" (I56=1).
    pub vector: u32,
    /// Which registers the board has.
    pub generation: Generation,
}

/// The part of the VME bus that a bridge shows to the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BridgeWindow {
    /// Its first bus address.
    pub address: u32,
    /// Its bytes.
    pub size: u32,
    /// The address lines of its accesses.
    pub address_bits: AddressBits,
}

/// A set-up that is not possible, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VmeError {
    /// An address needs more lines than the board decodes.
    #[error(
        "{what} address ${address:X} is out of reach of {bits}-bit addressing, whose last base is ${last:X}"
    )]
    OutOfReach {
        /// `mailbox` or `DPRAM`.
        what: &'static str,
        /// The requested address.
        address: u32,
        /// The address lines decoded.
        bits: u32,
        /// The highest possible base.
        last: u32,
    },
    /// The mailboxes' base lies between two possible ones.
    #[error(
        "mailbox address ${address:X} is not a multiple of 512 ($200): A8-A0 must be 0; ${:X} is possible",
        address & !(MAILBOX_BYTES - 1)
    )]
    MailboxNotAligned {
        /// The requested address.
        address: u32,
    },
    /// The DPRAM's start lies between two pages.
    #[error(
        "DPRAM address ${address:X} is not a multiple of 16 KiB ($4000): A13-A0 must be 0; ${:X} is possible",
        address & !(WINDOW - 1)
    )]
    DpramNotAligned {
        /// The requested address.
        address: u32,
    },
    /// Mailboxes and DPRAM differ in A31-A24, for which the board has one register.
    #[error(
        "A31-A24 are shared: the mailboxes at ${mailbox:08X} have ${:02X}, the DPRAM at ${dpram:08X} has ${:02X}",
        mailbox >> 24, dpram >> 24
    )]
    DifferentA31ToA24 {
        /// The mailboxes' base.
        mailbox: u32,
        /// The DPRAM's start.
        dpram: u32,
    },
    /// The mailboxes would lie inside the DPRAM.
    #[error(
        "the mailboxes at ${mailbox:X}-${:X} lie inside the DPRAM at ${dpram:X}-${:X}; move one of them",
        mailbox.saturating_add(MAILBOX_BYTES - 1), last_of_window(*dpram)
    )]
    Overlap {
        /// The mailboxes' base.
        mailbox: u32,
        /// The DPRAM's start.
        dpram: u32,
    },
    /// No such interrupt line.
    #[error("interrupt level {level} does not exist; the VME bus has levels 1 to 7")]
    Level {
        /// The requested level.
        level: u32,
    },
    /// More than a byte, or no room for the neighbours.
    #[error(
        "vector ${vector:02X} leaves no room for its neighbours; PMAC uses v-1, v and v+1, so v is $01 to $FD"
    )]
    VectorRange {
        /// The requested vector.
        vector: u32,
    },
    /// An even vector.
    #[error(
        "vector ${vector:02X} is even; PMAC uses v-1, v and v+1 with an odd v (its default is $A1), so take \
         ${:02X}", vector | 1
    )]
    EvenVector {
        /// The requested vector.
        vector: u32,
    },
}

impl VmeSetup {
    /// Gives the lines to send, and the byte to write on the bus after every reset.
    ///
    /// # Errors
    /// [`VmeError`] when no setting of the registers has the requested meaning, or parts of the board would collide.
    pub fn plan(&self) -> Result<SetupPlan, VmeError> {
        self.check()?;
        let commands = match self.generation {
            Generation::Pmac => vec![self.pmac_line()],
            Generation::Turbo => self
                .registers()
                .iter()
                .enumerate()
                .map(|(n, value)| format!("I{}=${value:02X}", 90 + n))
                .collect(),
        };
        Ok(SetupPlan {
            commands: with_save_and_reset(commands),
            after_reset: Some(self.page().into_iter().collect()),
            values: self.values(),
            warnings: self.warnings(),
        })
    }

    /// A19-A14 of the DPRAM, as the host writes them after every reset.
    #[must_use]
    pub fn page(&self) -> Option<BusWrite> {
        let at = self.mailbox.saturating_add(PAGE_SELECT);
        self.dpram.map(|dpram| BusWrite { address: at, value: page_of(dpram) })
    }

    /// The smallest window of a bridge that shows mailboxes and DPRAM.
    ///
    /// # Errors
    /// As [`plan`](Self::plan).
    pub fn window(&self) -> Result<BridgeWindow, VmeError> {
        self.check()?;
        let last = self.dpram.map_or(0, last_of_window).max(self.mailbox + MAILBOX_BYTES - 1);
        let address = self.dpram.unwrap_or(self.mailbox).min(self.mailbox) & !(BRIDGE_STEP - 1);
        // Mailboxes and DPRAM share A31-A24, so the window has at most 16 MiB.
        let size = (last | (BRIDGE_STEP - 1)) - address + 1;
        Ok(BridgeWindow { address, size, address_bits: self.address_bits })
    }

    /// The ten registers, from X:$0783 (I90) on.
    fn registers(&self) -> [u32; 10] {
        let (nibble, enable, with_dpram) = match self.dpram {
            Some(dpram) => (dpram >> 16 & 0xF0, 0xE0, 0x80),
            None => (0x00, 0x60, 0x00),
        };
        [
            self.address_bits.modifier(),
            MODIFIER_IGNORED,
            self.mailbox >> 24,
            self.mailbox >> 16 & 0xFF,
            self.mailbox >> 8 & 0xFF,
            self.irq_level,
            self.vector,
            nibble,
            enable,
            self.address_bits.width() | with_dpram,
        ]
    }

    /// One line, to the letter as the manual prints it: the second and third value without a leading zero.
    fn pmac_line(&self) -> String {
        let values = self.registers().into_iter().enumerate().map(|(n, value)| match n {
            1 | 2 => format!(",${value:X}"),
            _ => format!(",${value:02X}"),
        });
        std::iter::once("WX$0783".to_owned()).chain(values).collect()
    }

    fn check(&self) -> Result<(), VmeError> {
        self.reach("mailbox", self.mailbox, MAILBOX_BYTES)?;
        if !self.mailbox.is_multiple_of(MAILBOX_BYTES) {
            return Err(VmeError::MailboxNotAligned { address: self.mailbox });
        }
        if let Some(dpram) = self.dpram {
            self.check_dpram(dpram)?;
        }
        if !(1..=7).contains(&self.irq_level) {
            return Err(VmeError::Level { level: self.irq_level });
        }
        match self.vector {
            0x01..=0xFD if !self.vector.is_multiple_of(2) => Ok(()),
            0x01..=0xFD => Err(VmeError::EvenVector { vector: self.vector }),
            vector => Err(VmeError::VectorRange { vector }),
        }
    }

    fn check_dpram(&self, dpram: u32) -> Result<(), VmeError> {
        self.reach("DPRAM", dpram, WINDOW)?;
        if !dpram.is_multiple_of(WINDOW) {
            return Err(VmeError::DpramNotAligned { address: dpram });
        }
        if dpram >> 24 != self.mailbox >> 24 {
            return Err(VmeError::DifferentA31ToA24 { mailbox: self.mailbox, dpram });
        }
        // The mailboxes' 512 bytes are aligned, so they lie wholly inside a 16-KiB page or wholly outside it.
        if self.mailbox & !(WINDOW - 1) == dpram {
            return Err(VmeError::Overlap { mailbox: self.mailbox, dpram });
        }
        Ok(())
    }

    fn reach(&self, what: &'static str, address: u32, step: u32) -> Result<(), VmeError> {
        let bits = self.address_bits.count();
        let end = 1_u64 << bits;
        if u64::from(address) < end {
            return Ok(());
        }
        Err(VmeError::OutOfReach { what, address, bits, last: (end - u64::from(step)) as u32 })
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.dpram.is_some() && self.address_bits == AddressBits::A16 {
            warnings.push(
                "16-bit addressing with DPRAM takes a quarter of the 64 KiB there are, and no board set up so is \
                 known; 24-bit addressing is usual"
                    .to_owned(),
            );
        }
        warnings
    }

    fn values(&self) -> Vec<SetupValue> {
        let name = |n: usize| match self.generation {
            Generation::Pmac => format!("X:${:04X}", 0x0783 + n),
            Generation::Turbo => format!("I{}", 90 + n),
        };
        let mut values: Vec<_> =
            self.registers().iter().enumerate().map(|(n, value)| SetupValue::new(name(n), *value)).collect();
        let bits = self.address_bits.count();
        let unless = |needed: u32, text: &str| {
            if bits < needed { format!("{text} (not decoded)") } else { text.to_owned() }
        };
        let has_dpram = self.dpram.is_some();
        let meanings: [Vec<(u32, u32, String)>; 10] = [
            vec![(7, 0, format!("address modifier of {bits}-bit addressing"))],
            vec![(7, 0, "modifier bits that do not matter".to_owned())],
            vec![(7, 0, unless(32, "A31-A24 of mailboxes and DPRAM"))],
            vec![(7, 0, unless(24, "A23-A16 of the mailboxes"))],
            vec![(7, 1, "A15-A9 of the mailboxes".to_owned()), (0, 0, "A8, always 0".to_owned())],
            vec![(2, 0, format!("interrupt level {}", self.irq_level))],
            vec![(
                7,
                0,
                format!(
                    "interrupt vector v: v-1 = ${:02X} command taken, v response in the mailboxes, \
                                 v+1 = ${:02X} response in the DPRAM",
                    self.vector - 1,
                    self.vector + 1
                ),
            )],
            vec![(7, 4, unless(24, "A23-A20 of the DPRAM")), (3, 0, "always 0".to_owned())],
            vec![
                (7, 7, (if has_dpram { "DPRAM enabled" } else { "DPRAM disabled" }).to_owned()),
                (6, 0, "always $60".to_owned()),
            ],
            vec![
                (7, 7, (if has_dpram { "DPRAM fitted" } else { "no DPRAM" }).to_owned()),
                (6, 0, format!("bus width of {bits} address bits")),
            ],
        ];
        for (value, meanings) in values.iter_mut().zip(meanings) {
            for (high, low, meaning) in meanings {
                *value = value.clone().field(high, low, meaning);
            }
        }
        values
    }
}
