//! Images of a DPRAM, built word by word.

use pmac_dpram::decode::Image;
use pmac_dpram::format::WordOrder;
use pmac_dpram::map::Family;

/// A dump under construction.
pub struct Dump {
    family: &'static Family,
    bytes: Vec<u8>,
}

impl Dump {
    /// `length` bytes of a board of `family`, all of them 0.
    pub fn new(family: &'static Family, length: usize) -> Self {
        Self { family, bytes: vec![0; length] }
    }

    /// The bytes, as `pmacctl board decode` takes them.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// A 16-bit word.
    pub fn word(&mut self, at: usize, value: u16) -> &mut Self {
        self.bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
        self
    }

    /// A 24-bit PMAC word, sign-extended as PMAC stores it.
    pub fn short(&mut self, at: usize, value: i32) -> &mut Self {
        self.bytes[at..at + 4].copy_from_slice(&((value << 8) >> 8).to_le_bytes());
        self
    }

    /// A 48-bit register, Y half first.
    pub fn pair(&mut self, at: usize, x: i32, y: i32) -> &mut Self {
        self.short(at, y).short(at + 4, x)
    }

    /// The whole, as the family's image.
    pub fn image(&self) -> Image {
        Image::from_bytes(&self.bytes, self.family, WordOrder::Little).unwrap()
    }
}
