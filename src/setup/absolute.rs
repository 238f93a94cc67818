//! Absolute power-on position: the registers that PMAC reads by Ix10, a Turbo board by Ixx10 and Ixx95.
//!
//! Source: PMAC software reference, Ix10; Turbo software reference, Ixx95 (its parallel section means Ixx10 where it
//! prints Ixx81). Both have the same 8-bit format code, in bits 16-23 of Ix10 or of Ixx95: bit 23 set means a signed
//! position. The position that PMAC reads, minus Ix26, is the motor's position after a reset (unless Ix80 bit 2 is
//! set), or after `$*`.

pub mod position;

use std::fmt;

use serde::{Serialize, Serializer};

use crate::map::{Generation, Space};

/// The bits of one PMAC word.
const WORD_BITS: u32 = 24;
/// Stands for multiplexer address (or node) 0, since an address of 0 switches the reading off.
const ZERO: u32 = 0x100;

/// Where an absolute position comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Consecutive registers, whole words or one byte of each.
    Parallel,
    /// The upper 16 bits of a register, as the A/D converters of Acc-28 deliver them.
    Acc28,
    /// A resolver converter on Acc-8D option 7, at the multiplexer port.
    Resolver,
    /// A Sanyo encoder on Acc-49.
    Sanyo,
    /// A Yaskawa encoder on Acc-8D option 9, at the multiplexer port.
    Yaskawa,
    /// A Yaskawa encoder at a MACRO station.
    MacroYaskawa,
    /// A resolver converter at a MACRO station.
    MacroResolver,
    /// Parallel data at a MACRO station.
    MacroParallel,
}

impl Kind {
    /// The device, for people.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Parallel => "parallel data",
            Self::Acc28 => "Acc-28 A/D converter",
            Self::Resolver => "Acc-8D option 7 resolver converter",
            Self::Sanyo => "Acc-49 Sanyo encoder",
            Self::Yaskawa => "Acc-8D option 9 Yaskawa encoder",
            Self::MacroYaskawa => "MACRO station, Yaskawa encoder",
            Self::MacroResolver => "MACRO station, resolver converter",
            Self::MacroParallel => "MACRO station, parallel data",
        }
    }
}

/// A register of PMAC's own memory. Prints with the digits of its board: `Y:$FFD0`, `Y:$078D00`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryAddress {
    /// `X` or `Y`.
    pub space: Space,
    /// The number after the `$`.
    pub number: u32,
    /// Which board's.
    pub generation: Generation,
}

impl fmt::Display for MemoryAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = match self.generation {
            Generation::Pmac => 4,
            Generation::Turbo => 6,
        };
        write!(f, "{}:${:0digits$X}", self.space, self.number)
    }
}

impl Serialize for MemoryAddress {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The part of one register that belongs to a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct RegisterBits {
    /// The register.
    pub address: MemoryAddress,
    /// The lowest of its bits that belongs to the position.
    pub from_bit: u32,
    /// How many of its bits belong to the position.
    pub bits: u32,
}

/// The data that an absolute-position setting makes PMAC read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AbsoluteFormat {
    /// The kind of source.
    pub kind: Kind,
    /// Which half of its memory PMAC reads; `None` at the multiplexer port and over MACRO.
    #[serde(serialize_with = "space_name")]
    pub space: Option<Space>,
    /// Whether the position is a two's complement number.
    pub signed: bool,
    /// How many bits the position has; `None` where the reference does not say.
    pub bits: Option<u32>,
    /// Which bits of which registers hold it, least significant first; empty where the reference does not say.
    pub registers: Vec<RegisterBits>,
    /// The register at which a source begins whose bits are not documented (Acc-49).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub address: Option<MemoryAddress>,
    /// The board's address at the multiplexer port.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub multiplexer_address: Option<u32>,
    /// The converter on that board, 1 to 4.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converter: Option<u32>,
    /// Whether that board's switch SW1-1 is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub switch_open: Option<bool>,
    /// The MACRO node.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub node: Option<u32>,
    /// Further facts about this format.
    pub notes: Vec<&'static str>,
}

// serde passes a reference to the field.
#[allow(clippy::ref_option, clippy::trivially_copy_pass_by_ref)]
fn space_name<S: Serializer>(space: &Option<Space>, serializer: S) -> Result<S::Ok, S::Error> {
    space.map(Space::name).serialize(serializer)
}

/// A setting that names no position, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// More than 24 bits.
    #[error("{variable} = ${value:X} has more than 24 bits")]
    TooLarge {
        /// Which variable.
        variable: &'static str,
        /// Its value.
        value: u32,
    },
    /// An address of 0 switches the reading off.
    #[error(
        "{variable} = 0: no absolute position is read. Multiplexer address or node 0 is written as $000100"
    )]
    Off {
        /// Which variable.
        variable: &'static str,
    },
    /// A code that the reference does not list.
    #[error(
        "{variable} = ${value:06X}: format code ${code:02X} is unknown. Known are 00-07 resolver, 08-30 parallel Y, \
         31 Acc-28, 32 Sanyo, 48-70 parallel X, 71 Yaskawa, 72-74 MACRO; plus 80 for a signed position"
    )]
    UnknownCode {
        /// Which variable.
        variable: &'static str,
        /// Its value.
        value: u32,
        /// Its bits 23-16.
        code: u32,
    },
    /// The low bits of Ixx95 do not fit this format.
    #[error("Ixx95 = ${value:06X}: the last four digits are {}", if *parallel {
        "0000 (whole words), 0004, 0005 or 0006 (low, middle or high byte) for parallel data"
    } else { "0000 for this format" })]
    SubFormat {
        /// Ixx95.
        value: u32,
        /// Whether the format is a parallel one.
        parallel: bool,
    },
    /// An address that the board does not have.
    #[error("the position reaches up to address ${last:X}; the board's last is ${limit:X}")]
    OutsideMemory {
        /// The last address that PMAC would read.
        last: u32,
        /// The board's last address.
        limit: u32,
    },
    /// A multiplexer address that does not exist.
    #[error("multiplexer address ${address:X} does not exist; $0001 to $00FF do, and $0100 stands for 0")]
    Multiplexer {
        /// The address.
        address: u32,
    },
    /// A MACRO node that does not exist.
    #[error("MACRO node ${node:X} does not exist; the last is ${limit:X}")]
    Node {
        /// The node.
        node: u32,
        /// The last one.
        limit: u32,
    },
}

/// The setting, taken apart.
#[derive(Clone, Copy)]
struct Setting {
    generation: Generation,
    /// Which variable holds the code, and its whole value, for messages.
    variable: &'static str,
    value: u32,
    code: u32,
    address: u32,
    sub_format: u32,
}

impl AbsoluteFormat {
    /// The meaning of Ix10 on a PMAC or PMAC2: bits 23-16 are the format code, bits 15-0 the address.
    ///
    /// # Errors
    /// [`FormatError`] for 0, which switches the reading off, and for values that no reference explains.
    pub fn pmac(ix10: u32) -> Result<Self, FormatError> {
        let variable = "Ix10";
        in_24_bits(variable, ix10)?;
        if ix10 == 0 {
            return Err(FormatError::Off { variable });
        }
        let (code, address) = (ix10 >> 16, ix10 & 0xFFFF);
        let generation = Generation::Pmac;
        Setting { generation, variable, value: ix10, code, address, sub_format: 0 }.format()
    }

    /// The meaning of Ixx10 (an address) and Ixx95 (bits 23-16 the format code) on a Turbo board.
    ///
    /// # Errors
    /// [`FormatError`] when Ixx10 is 0, which switches the reading off, and for values that no reference explains.
    pub fn turbo(ixx10: u32, ixx95: u32) -> Result<Self, FormatError> {
        in_24_bits("Ixx10", ixx10)?;
        in_24_bits("Ixx95", ixx95)?;
        if ixx10 == 0 {
            return Err(FormatError::Off { variable: "Ixx10" });
        }
        let (code, sub_format) = (ixx95 >> 16, ixx95 & 0xFFFF);
        let generation = Generation::Turbo;
        Setting { generation, variable: "Ixx95", value: ixx95, code, address: ixx10, sub_format }.format()
    }
}

fn in_24_bits(variable: &'static str, value: u32) -> Result<(), FormatError> {
    if value >> WORD_BITS == 0 { Ok(()) } else { Err(FormatError::TooLarge { variable, value }) }
}

impl Setting {
    fn format(self) -> Result<AbsoluteFormat, FormatError> {
        let code = self.code & 0x7F;
        match code {
            0x08..=0x30 => return self.parallel(Space::Y, code),
            0x48..=0x70 => return self.parallel(Space::X, code - 0x40),
            _ => {}
        }
        if self.sub_format != 0 {
            return Err(FormatError::SubFormat { value: self.value, parallel: false });
        }
        match code {
            0x00..=0x07 => self.resolver(code),
            0x31 => self.acc28(),
            0x32 => self.sanyo(),
            0x71 => self.yaskawa(),
            0x72 => self.over_macro(Kind::MacroYaskawa),
            0x73 => self.over_macro(Kind::MacroResolver),
            0x74 => self.over_macro(Kind::MacroParallel),
            _ => {
                let Self { variable, value, code, .. } = self;
                Err(FormatError::UnknownCode { variable, value, code })
            }
        }
    }

    fn empty(self, kind: Kind) -> AbsoluteFormat {
        AbsoluteFormat {
            kind,
            space: None,
            signed: self.code & 0x80 != 0,
            bits: None,
            registers: Vec::new(),
            address: None,
            multiplexer_address: None,
            converter: None,
            switch_open: None,
            node: None,
            notes: Vec::new(),
        }
    }

    fn register(self, space: Space, number: u32) -> Result<MemoryAddress, FormatError> {
        // An address of a PMAC has 16 bits, a Turbo address 19.
        let limit = match self.generation {
            Generation::Pmac => 0xFFFF,
            Generation::Turbo => 0x07_FFFF,
        };
        if number > limit {
            return Err(FormatError::OutsideMemory { last: number, limit });
        }
        Ok(MemoryAddress { space, number, generation: self.generation })
    }

    /// `bits` bits from bit 0 on, over as many words as they need; or a byte of each of as many words.
    fn parallel(self, space: Space, bits: u32) -> Result<AbsoluteFormat, FormatError> {
        let (from_bit, each) = match self.sub_format {
            0 => (0, WORD_BITS),
            4..=6 => (8 * (self.sub_format - 4), 8),
            _ => return Err(FormatError::SubFormat { value: self.value, parallel: true }),
        };
        let registers = (0..bits.div_ceil(each))
            .map(|n| {
                let address = self.register(space, self.address + n)?;
                Ok(RegisterBits { address, from_bit, bits: each.min(bits - n * each) })
            })
            .collect::<Result<_, FormatError>>()?;
        Ok(AbsoluteFormat { space: Some(space), bits: Some(bits), registers, ..self.empty(Kind::Parallel) })
    }

    fn acc28(self) -> Result<AbsoluteFormat, FormatError> {
        let address = self.register(Space::Y, self.address)?;
        let registers = vec![RegisterBits { address, from_bit: 8, bits: 16 }];
        let note = if self.code & 0x80 == 0 { "as Acc-28B delivers it" } else { "as Acc-28A delivers it" };
        Ok(AbsoluteFormat {
            space: Some(Space::Y),
            bits: Some(16),
            registers,
            notes: vec![note],
            ..self.empty(Kind::Acc28)
        })
    }

    fn sanyo(self) -> Result<AbsoluteFormat, FormatError> {
        let address = Some(self.register(Space::Y, self.address)?);
        let notes = vec!["the references do not say which bits Acc-49 delivers where"];
        Ok(AbsoluteFormat { space: Some(Space::Y), address, notes, ..self.empty(Kind::Sanyo) })
    }

    fn multiplexer(self) -> Result<Option<u32>, FormatError> {
        match self.address {
            ZERO => Ok(Some(0)),
            address @ 0..=0xFF => Ok(Some(address)),
            address => Err(FormatError::Multiplexer { address }),
        }
    }

    fn resolver(self, code: u32) -> Result<AbsoluteFormat, FormatError> {
        Ok(AbsoluteFormat {
            multiplexer_address: self.multiplexer()?,
            converter: Some(code % 4 + 1),
            switch_open: Some(code >= 4),
            notes: vec![match self.generation {
                Generation::Pmac => "I9x, then I8x, above 0 add the next converters as geared-down stages",
                Generation::Turbo => {
                    "Ixx99, then Ixx98, above 0 add the next converters as geared-down stages"
                }
            }],
            ..self.empty(Kind::Resolver)
        })
    }

    fn yaskawa(self) -> Result<AbsoluteFormat, FormatError> {
        let multiplexer_address = self.multiplexer()?;
        let notes = vec!["this code is known from practice only; check it on the board"];
        Ok(AbsoluteFormat { multiplexer_address, notes, ..self.empty(Kind::Yaskawa) })
    }

    fn over_macro(self, kind: Kind) -> Result<AbsoluteFormat, FormatError> {
        // One MACRO interface with 16 nodes on a PMAC, four on a Turbo PMAC.
        let limit = match self.generation {
            Generation::Pmac => 0x0F,
            Generation::Turbo => 0x3F,
        };
        let mut notes = vec!["the station's MI11x of that node says what it reads"];
        let node = match self.address {
            ZERO => Some(0),
            node if node <= limit => Some(node),
            // A Geo PMAC takes the same code for its EnDat encoders; no manual explains the address then.
            _ if kind == Kind::MacroParallel && self.code == 0xF4 && self.generation == Generation::Pmac => {
                None
            }
            node => return Err(FormatError::Node { node, limit }),
        };
        if kind == Kind::MacroParallel && self.code == 0xF4 && self.generation == Generation::Pmac {
            notes.push("on a Geo PMAC this code reads an EnDat encoder");
        }
        if kind == Kind::MacroYaskawa {
            notes.push("this code is known from practice only; check it on the board");
        }
        Ok(AbsoluteFormat { node, notes, ..self.empty(kind) })
    }
}
