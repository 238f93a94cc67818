//! The shape of a register table: rows, grouped into blocks that repeat per motor or coordinate system.
//!
//! A table is constant data; [`super::Layout`] expands it. Another board family is another table of these types.

use std::fmt;

use super::{HostOffset, PmacAddress};

/// The unit of a motor's positions.
pub const POSITION: &str = "1/(Ix08*32) count";

/// The owners that a record's numbers count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NumberKind {
    /// A motor.
    Motor,
    /// A coordinate system.
    CoordinateSystem,
    /// A motor or a coordinate system, by bit.
    MotorOrCoordinateSystem,
}

impl NumberKind {
    /// Its name, before a number.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Motor => "motor",
            Self::CoordinateSystem => "coordinate system",
            Self::MotorOrCoordinateSystem => "motor or coordinate system",
        }
    }
}

/// How much of a PMAC location a register takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Width {
    /// One 16-bit word: the Y or the X half.
    Word,
    /// Whole locations, 32 bits each.
    Long,
    /// Two locations that hold one 48-bit register, Y half first.
    Pair,
}

/// How to read a register's bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// No documented content.
    Unknown,
    /// Sixteen separate bits.
    Bits16,
    /// Separate bits in the low half of a word.
    Bits0To7,
    /// Separate bits of a 24-bit PMAC word.
    Bits24,
    /// Two 24-bit PMAC words of separate bits.
    Bits24Pair,
    /// Unsigned, 15 bits.
    Unsigned15,
    /// Unsigned, 16 bits.
    Unsigned16,
    /// Unsigned 24-bit PMAC word.
    Unsigned24,
    /// Signed 24-bit PMAC word.
    Signed24,
    /// 48-bit fixed point, see [`crate::format::fixed48`].
    Fixed48,
    /// 48-bit floating point, see [`crate::format::float48`].
    Float48,
    /// Packed characters with a NUL at the end, see [`crate::format::TextOrder`].
    Ascii,
    /// An absolute PMAC address.
    Address,
    /// Gathered samples; the gather mask says which.
    Gather,
    /// Separate bits of both halves of a location.
    Bits32,
    /// A Turbo board's place in its user area, in longs from $060450.
    StartOffset,
    /// Words of the site's own.
    Any,
}

impl Format {
    /// The format's name in `pmacctl board map`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::Bits16 => "bits16",
            Self::Bits0To7 => "bits0-7",
            Self::Bits24 => "bits24",
            Self::Bits24Pair => "bits24x2",
            Self::Unsigned15 => "unsigned15",
            Self::Unsigned16 => "unsigned16",
            Self::Unsigned24 => "unsigned24",
            Self::Signed24 => "signed24",
            Self::Fixed48 => "fixed48",
            Self::Float48 => "float48",
            Self::Ascii => "ascii",
            Self::Address => "PMAC address",
            Self::Gather => "gather",
            Self::Bits32 => "bits32",
            Self::StartOffset => "offset from $060450",
            Self::Any => "any",
        }
    }
}

/// How sure an entry of the table is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Confidence {
    /// A page of a manual says it, or two independent sources.
    High,
    /// One good source says it: a driver in production, or the vendor's own headers.
    Medium,
    /// Worked out, or taken over from PMAC. Try it before you rely on it.
    Low,
}

impl Confidence {
    /// `H`, `M` or `L`.
    #[must_use]
    pub const fn letter(self) -> &'static str {
        match self {
            Self::High => "H",
            Self::Medium => "M",
            Self::Low => "L",
        }
    }
}

/// The writer of a register or a bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Writer {
    /// The host alone.
    Host,
    /// PMAC alone.
    Pmac,
    /// The host sets it, PMAC clears it after acting.
    HostSetsPmacClears,
    /// PMAC sets it, the host clears it after reading.
    PmacSetsHostClears,
    /// No documented writer.
    Nobody,
}

impl fmt::Display for Writer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Host => "host",
            Self::Pmac => "PMAC",
            Self::HostSetsPmacClears => "host sets, PMAC clears",
            Self::PmacSetsHostClears => "PMAC sets, host clears",
            Self::Nobody => "-",
        })
    }
}

/// Bits of a register with a meaning and a writer of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bits {
    /// The highest bit.
    pub high: u8,
    /// The lowest bit.
    pub low: u8,
    /// Snake-case name.
    pub name: &'static str,
    /// Their writer.
    pub writer: Writer,
}

impl Bits {
    pub(super) const fn range(high: u8, low: u8, name: &'static str, writer: Writer) -> Self {
        Self { high, low, name, writer }
    }

    pub(super) const fn bit(bit: u8, name: &'static str, writer: Writer) -> Self {
        Self { high: bit, low: bit, name, writer }
    }
}

/// The PMAC register that a DPRAM register copies, for number 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Not a copy, or not documented.
    None,
    /// The same register for every number.
    Fixed(PmacAddress),
    /// A motor register; the next motor's follows by the family's motor stride.
    Motor(PmacAddress),
    /// A coordinate system register; the next one's follows by the family's coordinate system stride.
    System(PmacAddress),
    /// One of three coordinate system registers, A, B or C, by the program status (Note 1 on p. 21):
    /// A if bit 7 is set and bit 5 clear, else B if bit 9 is set, else C.
    Choice([PmacAddress; 3]),
}

/// A [`Source`] worked out for one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceAt {
    /// Not a copy, or not documented.
    None,
    /// This register.
    One(PmacAddress),
    /// One of the registers A, B, C; see [`Source::Choice`].
    Choice([PmacAddress; 3]),
}

impl fmt::Display for SourceAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => Ok(()),
            Self::One(address) => write!(f, "{address}"),
            Self::Choice([a, b, c]) => write!(f, "A {a}, B {b}, C {c}"),
        }
    }
}

/// A row of a register table: one register of number 1, or of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Register {
    /// The automatic function it belongs to.
    pub function: &'static str,
    /// Its identifier within the function.
    pub name: &'static str,
    /// The register in words.
    pub title: &'static str,
    /// Its place (for number 1).
    pub offset: HostOffset,
    /// Its length in bytes; 0 for a buffer whose length is set at run time.
    pub length: u32,
    /// How much of a PMAC location it takes.
    pub width: Width,
    /// How to read its bits.
    pub format: Format,
    /// The unit of its value, in PMAC's own words; empty without one.
    pub units: &'static str,
    /// Its numbers count these; `None` for a register of the board.
    pub number: Option<NumberKind>,
    /// Its writer.
    pub writer: Writer,
    /// Bits with a meaning of their own.
    pub bits: &'static [Bits],
    /// The register that it copies.
    pub source: Source,
    /// A note for a reader of the manual.
    pub note: &'static str,
    /// How sure the row is; `None` where the board's own DPRAM manual says it.
    pub confidence: Option<Confidence>,
}

impl Register {
    pub(super) const fn word(function: &'static str, name: &'static str, offset: HostOffset) -> Self {
        Self::new(function, name, offset, 2, Width::Word)
    }

    pub(super) const fn long(function: &'static str, name: &'static str, offset: HostOffset) -> Self {
        Self::new(function, name, offset, 4, Width::Long)
    }

    pub(super) const fn longs(
        function: &'static str,
        name: &'static str,
        offset: HostOffset,
        length: u32,
    ) -> Self {
        Self::new(function, name, offset, length, Width::Long)
    }

    pub(super) const fn pair(function: &'static str, name: &'static str, offset: HostOffset) -> Self {
        Self::new(function, name, offset, 8, Width::Pair)
    }

    const fn new(
        function: &'static str,
        name: &'static str,
        offset: HostOffset,
        length: u32,
        width: Width,
    ) -> Self {
        Self {
            function,
            name,
            title: "",
            offset,
            length,
            width,
            format: Format::Unknown,
            units: "",
            number: None,
            writer: Writer::Nobody,
            bits: &[],
            source: Source::None,
            note: "",
            confidence: None,
        }
    }

    pub(super) const fn is(mut self, title: &'static str, format: Format, units: &'static str) -> Self {
        self.title = title;
        self.format = format;
        self.units = units;
        self
    }

    pub(super) const fn of(mut self, kind: NumberKind) -> Self {
        self.number = Some(kind);
        self
    }

    pub(super) const fn by(mut self, writer: Writer) -> Self {
        self.writer = writer;
        self
    }

    pub(super) const fn bits(mut self, bits: &'static [Bits]) -> Self {
        self.bits = bits;
        self
    }

    pub(super) const fn from(mut self, source: Source) -> Self {
        self.source = source;
        self
    }

    pub(super) const fn note(mut self, note: &'static str) -> Self {
        self.note = note;
        self
    }

    pub(super) const fn sure(mut self, confidence: Confidence) -> Self {
        self.confidence = Some(confidence);
        self
    }
}

/// Rows that belong together, and how often and how far apart they repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// How many numbers have these registers; 0 for registers of the board, which have no number.
    pub count: usize,
    /// Bytes from one number's registers to the next one's.
    pub stride: u32,
    /// The page of the family's DPRAM manual with the register map; `None` where no manual describes it.
    pub page: Option<u16>,
    /// The rows, in ascending order.
    pub registers: &'static [Register],
}

impl Block {
    pub(super) const fn once(page: Option<u16>, registers: &'static [Register]) -> Self {
        Self { count: 0, stride: 0, page, registers }
    }

    pub(super) const fn each(
        count: usize,
        stride: u32,
        page: Option<u16>,
        registers: &'static [Register],
    ) -> Self {
        Self { count, stride, page, registers }
    }
}
