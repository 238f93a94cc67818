//! The letters of pictures: DejaVu Sans, so that a PNG needs no font of the machine's.

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, OutlineBuilder};

/// Width of a letter that the font does not have, as a part of its height.
const USUAL: f64 = 0.6;

/// The font.
pub struct Font(Option<Face<'static>>);

impl Font {
    pub fn new() -> Self {
        Self(Face::parse(dejavu::sans::regular(), 0).ok())
    }

    /// The width of `text` in letters of `size` pixels.
    pub fn width(&self, text: &str, size: f64) -> f64 {
        text.chars().map(|letter| self.advance(letter)).sum::<f64>() * size
    }

    fn advance(&self, letter: char) -> f64 {
        let advance = self.0.as_ref().and_then(|face| {
            let units = f64::from(face.units_per_em());
            Some(f64::from(face.glyph_hor_advance(face.glyph_index(letter)?)?) / units)
        });
        advance.unwrap_or(USUAL)
    }

    /// The outline of `text`, from a foot at 0, 0 on, in letters of height 1 that stand upwards. `None` if there is none.
    pub fn outline(&self, text: &str) -> Option<Path> {
        let face = self.0.as_ref()?;
        let scale = 1.0 / f32::from(face.units_per_em());
        let mut letters = Letters { path: PathBuilder::new(), left: 0.0, scale };
        for letter in text.chars() {
            if let Some(glyph) = face.glyph_index(letter) {
                face.outline_glyph(glyph, &mut letters);
            }
            letters.left += self.advance(letter) as f32;
        }
        letters.path.finish()
    }
}

/// Letters one beside the other.
struct Letters {
    path: PathBuilder,
    left: f32,
    scale: f32,
}

impl Letters {
    fn x(&self, x: f32) -> f32 {
        x * self.scale + self.left
    }
}

impl OutlineBuilder for Letters {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.x(x), y * self.scale);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.x(x), y * self.scale);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.quad_to(self.x(x1), y1 * self.scale, self.x(x), y * self.scale);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let scale = self.scale;
        self.path.cubic_to(self.x(x1), y1 * scale, self.x(x2), y2 * scale, self.x(x), y * scale);
    }

    fn close(&mut self) {
        self.path.close();
    }
}
