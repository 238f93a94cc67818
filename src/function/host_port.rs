//! The board's own interrupt controller behind its ISA or PCI host port: unmask, acknowledge (PMAC User Manual
//! p. 249-257, PMAC2 User Manual p. 91-92).
//!
//! | base + | PMAC(1): an 8259 | PMAC2 |
//! |---|---|---|
//! | 8 | command word 0: end of interrupt, 0x60 + line | latched lines; a 1 written clears the line |
//! | 9 | mask, 1 = **masked** | lines as they stand |
//! | 10 | - | mask, 1 = **enabled** |
//! | 11 | - | 1 = level, 0 = edge |
//!
//! A DPRAM ASCII response raises line 7 of a PMAC(1) (EQU4, by jumper E55) and bit 5 of a PMAC2. Other hosts or
//! drivers may own other lines of the same controller, so this host changes one bit of the mask only.
//!
//! The order of service: read the response, write 0 to 0x06D0, acknowledge here, then look at 0x06D0 once more. That
//! look finds a response that came before the acknowledgement; a later response raises the line again. The line has no
//! latch on the board: an interrupt with 0x06D0 = 0 is an old one that the host has served already.
//!
//! We infer from the manual's "write clears" that a write of ones clears a PMAC2's latched lines. No manual tells how
//! a PMAC(1) leaves its 8259 at power-on, so the initialisation is a setting, and off.

use crate::device::{ByteBus, ByteBusError};
use crate::map::Controller;

/// Registers of the controller, in bytes from the host port's base.
mod register {
    /// PMAC(1): ICW1, OCW2, OCW3. PMAC2: latched lines.
    pub const COMMAND: u32 = 8;
    /// PMAC(1): ICW2, ICW4, mask.
    pub const PIC_MASK: u32 = 9;
    /// PMAC2: mask.
    pub const ENABLE: u32 = 10;
}

/// 8259: specific end of interrupt, the line in bits 2-0.
const SPECIFIC_END: u8 = 0x60;

/// The three words that make an 8259 ready, in the order in which the host writes them: ICW1, ICW2, ICW4.
pub type Initialisation = [u8; 3];

/// The controller of one board and the line that is ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HostPort {
    /// Which controller.
    pub controller: Controller,
    /// The line, 0-7.
    pub line: u8,
    /// How to initialise an 8259 before its line is enabled; `None` leaves it as it is.
    #[serde(default)]
    pub initialisation: Option<Initialisation>,
}

impl HostPort {
    /// A PMAC(1) whose DPRAM ASCII interrupt is on line 7 (jumper E55).
    pub const PMAC: Self = Self { controller: Controller::Pic8259, line: 7, initialisation: None };
    /// A PMAC2, whose DPRAM ASCII interrupt is bit 5.
    pub const PMAC2: Self = Self { controller: Controller::Pmac2, line: 5, initialisation: None };

    /// The usual line of a board with this controller, without an initialisation.
    #[must_use]
    pub const fn usual(controller: Controller) -> Self {
        match controller {
            Controller::Pic8259 => Self::PMAC,
            Controller::Pmac2 => Self::PMAC2,
        }
    }

    const fn bit(&self) -> u8 {
        1 << (self.line & 7)
    }

    /// Ends the line's last interrupt, in case no host has ended it, and opens the line. The other lines stay as they
    /// are; an initialisation closes them. Returns whether the line was open already. 1 read and 2 writes; 4 more with
    /// an initialisation.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn enable(&self, bus: &mut impl ByteBus) -> Result<bool, ByteBusError> {
        if let (Controller::Pic8259, Some([icw1, icw2, icw4])) = (self.controller, self.initialisation) {
            bus.write8(register::COMMAND, icw1)?;
            bus.write8(register::PIC_MASK, icw2)?;
            bus.write8(register::PIC_MASK, icw4)?;
            // Initialising opens every line.
            bus.write8(register::PIC_MASK, u8::MAX)?;
        }
        self.acknowledge(bus)?;
        self.change_mask(bus, true)
    }

    /// Closes the line, and leaves the others as they are. 1 read, 1 write.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn disable(&self, bus: &mut impl ByteBus) -> Result<(), ByteBusError> {
        self.change_mask(bus, false).map(|_| ())
    }

    /// Ends the line's interrupt, so that the next one can come. The PC's own controllers are the kernel's business.
    /// 1 write.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn acknowledge(&self, bus: &mut impl ByteBus) -> Result<(), ByteBusError> {
        let value = match self.controller {
            Controller::Pic8259 => SPECIFIC_END | self.line & 7,
            Controller::Pmac2 => self.bit(),
        };
        bus.write8(register::COMMAND, value)?;
        bus.order_accesses();
        Ok(())
    }

    /// Whether the line is open. 1 read.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn is_enabled(&self, bus: &mut impl ByteBus) -> Result<bool, ByteBusError> {
        let (register, one_is_enabled) = self.mask();
        Ok((bus.read8(register)? & self.bit() != 0) == one_is_enabled)
    }

    /// The mask's register, and whether a 1 in it opens a line.
    const fn mask(&self) -> (u32, bool) {
        match self.controller {
            Controller::Pic8259 => (register::PIC_MASK, false),
            Controller::Pmac2 => (register::ENABLE, true),
        }
    }

    /// Opens or closes the line; returns whether it was open.
    fn change_mask(&self, bus: &mut impl ByteBus, enabled: bool) -> Result<bool, ByteBusError> {
        let (register, one_is_enabled) = self.mask();
        let mask = bus.read8(register)?;
        let set = enabled == one_is_enabled;
        bus.write8(register, if set { mask | self.bit() } else { mask & !self.bit() })?;
        bus.order_accesses();
        Ok((mask & self.bit() != 0) == one_is_enabled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The controller's registers; every write is kept.
    struct Registers {
        values: [u8; 16],
        written: Vec<(u32, u8)>,
        reads: usize,
    }

    impl Registers {
        fn new() -> Self {
            Self { values: [0; 16], written: Vec::new(), reads: 0 }
        }
    }

    impl ByteBus for Registers {
        fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
            self.reads += 1;
            Ok(self.values[offset as usize])
        }
        fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
            self.written.push((offset, value));
            self.values[offset as usize] = value;
            Ok(())
        }
        fn order_accesses(&mut self) {}
    }

    #[test]
    fn a_pmac_is_acknowledged_by_a_specific_end_and_masks_with_ones() {
        let mut bus = Registers::new();
        bus.values[9] = 0xFF;
        assert!(!HostPort::PMAC.enable(&mut bus).unwrap(), "it was shut");
        assert!(HostPort::PMAC.enable(&mut bus).unwrap(), "it is open");
        bus = Registers::new();
        bus.values[9] = 0xFF;
        HostPort::PMAC.enable(&mut bus).unwrap();
        assert_eq!((bus.written.as_slice(), bus.reads), (&[(8, 0x67), (9, 0x7F)][..], 1));
        HostPort::PMAC.acknowledge(&mut bus).unwrap();
        assert_eq!(bus.written.last(), Some(&(8, 0x67)));
        bus.values[9] = 0x5B;
        assert!(HostPort::PMAC.is_enabled(&mut bus).unwrap());
        HostPort::PMAC.disable(&mut bus).unwrap();
        assert!(!HostPort::PMAC.is_enabled(&mut bus).unwrap());
        assert_eq!(bus.values[9], 0xDB, "the other lines are not ours");
    }

    #[test]
    fn a_pmac2_is_the_other_way_round() {
        let mut bus = Registers::new();
        bus.values[10] = 0x81;
        assert!(!HostPort::PMAC2.enable(&mut bus).unwrap());
        assert_eq!((bus.written.as_slice(), bus.reads), (&[(8, 0x20), (10, 0xA1)][..], 1));
        HostPort::PMAC2.disable(&mut bus).unwrap();
        assert_eq!(bus.values[10], 0x81);
    }

    #[test]
    fn an_initialised_controller_opens_our_line_only() {
        let mut bus = Registers::new();
        HostPort { initialisation: Some([0x13, 0x08, 0x01]), ..HostPort::PMAC }.enable(&mut bus).unwrap();
        assert_eq!(bus.written, [(8, 0x13), (9, 0x08), (9, 0x01), (9, 0xFF), (8, 0x67), (9, 0x7F)]);
    }

    #[test]
    fn any_line_can_be_ours() {
        for line in 0..8 {
            let mut bus = Registers::new();
            let port = HostPort { line, ..HostPort::PMAC };
            bus.values[9] = 0xFF;
            port.enable(&mut bus).unwrap();
            assert_eq!(bus.written, [(8, 0x60 + line), (9, !(1 << line))]);
        }
    }
}
