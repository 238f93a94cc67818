//! What a picture is made of: lines, dots and texts at places in pixels from the top left corner.

/// A colour, red, green and blue.
pub type Color = [u8; 3];

/// Where a text is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A text on one line.
#[derive(Debug, Clone, PartialEq)]
pub struct Text {
    /// Its foot, where `anchor` holds it.
    pub at: [f64; 2],
    pub text: String,
    /// Height of a letter in pixels.
    pub size: f64,
    pub anchor: Anchor,
    pub color: Color,
    /// It runs upwards.
    pub upwards: bool,
}

/// One part.
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
    /// What is drawn, one over the other.
    pub shapes: Vec<Shape>,
}

/// Radius of a dot.
pub const DOT: f64 = 2.5;
/// Lengths of a dash and the gap after it.
pub const DASH: [f64; 2] = [6.0, 4.0];
