//! The parts of a picture: lines, dots and texts at places in pixels from the top left corner.

/// A colour, red, green and blue.
pub type Color = [u8; 3];

/// The end at which a text is anchored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A text on one line.
#[derive(Debug, Clone, PartialEq)]
pub struct Text {
    /// The text's foot, at the end that `anchor` names.
    pub at: [f64; 2],
    pub text: String,
    /// Height of a letter in pixels.
    pub size: f64,
    pub anchor: Anchor,
    pub color: Color,
    /// The text runs upwards.
    pub upwards: bool,
}

/// A part of a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Line { points: Vec<[f64; 2]>, color: Color, width: f64, dashed: bool },
    Dot { at: [f64; 2], color: Color },
    Text(Text),
}

/// A picture on white.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub width: f64,
    pub height: f64,
    /// The parts, each drawn over the earlier ones.
    pub shapes: Vec<Shape>,
}

/// Radius of a dot.
pub const DOT: f64 = 2.5;
/// Lengths of a dash and the gap after it.
pub const DASH: [f64; 2] = [6.0, 4.0];
