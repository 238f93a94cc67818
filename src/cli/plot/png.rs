//! A picture as PNG, with two dots a pixel, for paper and sharp screens.

use std::io;

use png::{BitDepth, ColorType, Encoder};
use tiny_skia::{
    FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, PremultipliedColorU8, Stroke, StrokeDash, Transform,
};

use super::font::Font;
use super::scene::{Anchor, Color, DASH, DOT, Scene, Shape, Text};

/// Dots a pixel.
const FINE: f32 = 2.0;

/// The picture.
///
/// # Errors
/// When it is too large for memory.
pub fn png(scene: &Scene, font: &Font) -> io::Result<Vec<u8>> {
    let [width, height] = [scene.width, scene.height].map(|length| (length as f32 * FINE).ceil() as u32);
    let too_large = || io::Error::other("the picture is too large");
    let mut map = Pixmap::new(width, height).ok_or_else(too_large)?;
    map.fill(tiny_skia::Color::WHITE);
    for shape in &scene.shapes {
        draw(&mut map, shape, font);
    }
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    // Everything is opaque: on white.
    let rgb = |pixel: &PremultipliedColorU8| [pixel.red(), pixel.green(), pixel.blue()];
    let pixels: Vec<u8> = map.pixels().iter().flat_map(rgb).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

fn draw(map: &mut Pixmap, shape: &Shape, font: &Font) {
    let fine = Transform::from_scale(FINE, FINE);
    match shape {
        Shape::Line { points, color, width, dashed } => {
            let stroke = Stroke {
                width: *width as f32,
                line_join: LineJoin::Round,
                dash: if *dashed { StrokeDash::new(DASH.to_vec(), 0.0) } else { None },
                ..Stroke::default()
            };
            if let Some(path) = line(points) {
                map.stroke_path(&path, &paint(*color), &stroke, fine, None);
            }
        }
        Shape::Dot { at: [x, y], color } => {
            if let Some(path) = PathBuilder::from_circle(*x as f32, *y as f32, DOT as f32) {
                map.fill_path(&path, &paint(*color), FillRule::Winding, fine, None);
            }
        }
        Shape::Text(text) => {
            if let Some(path) = font.outline(&text.text) {
                let place = fine.pre_concat(place(text, font));
                map.fill_path(&path, &paint(text.color), FillRule::Winding, place, None);
            }
        }
    }
}

/// From letters of height 1 to where they stand.
fn place(text: &Text, font: &Font) -> Transform {
    let [x, y] = text.at.map(|place| place as f32);
    let size = text.size as f32;
    let held = match text.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => 0.5,
        Anchor::End => 1.0,
    };
    let back = held * font.width(&text.text, 1.0) as f32;
    let turned = if text.upwards { Transform::from_rotate(-90.0) } else { Transform::identity() };
    Transform::from_translate(x, y)
        .pre_concat(turned)
        .pre_concat(Transform::from_scale(size, -size))
        .pre_concat(Transform::from_translate(-back, 0.0))
}

fn line(points: &[[f64; 2]]) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (index, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if index == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
    }
    path.finish()
}

fn paint([red, green, blue]: Color) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, 255);
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn e3_letters_are_where_they_stand() {
        let text = |text: &str| Text {
            at: [50.0, 40.0],
            text: text.to_owned(),
            size: 20.0,
            anchor: Anchor::Start,
            color: [0; 3],
            upwards: false,
        };
        let dark = |letters: &str| {
            let shapes = vec![Shape::Text(text(letters))];
            let bytes = png(&Scene { width: 200.0, height: 60.0, shapes }, &Font::new()).unwrap();
            let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            let dots = pixels.chunks(3).enumerate().filter(|(_, dot)| dot[0] < 128);
            dots.map(|(at, _)| [at % 400 / 2, at / 400 / 2]).collect::<Vec<_>>()
        };
        let drawn = dark("Motor 1");
        assert!(drawn.len() > 100, "{drawn:?}");
        let is_inside = |[x, y]: &[usize; 2]| (50..140).contains(x) && (20..41).contains(y);
        assert!(drawn.iter().all(is_inside), "{drawn:?}");
        assert!(dark(" ").is_empty());
    }
}
