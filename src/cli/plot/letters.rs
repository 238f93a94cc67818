//! The widths of the letters of DejaVu Sans, the first font that a picture asks for. Other fonts are hardly wider.

/// The widths of the letters from the space to `~`, in thousandths of the letters' height.
#[rustfmt::skip]
const WIDTHS: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337,
    636, 636, 636, 636, 636, 636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531,
    1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863, 748, 787,
    603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500,
    500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612,
    635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838,
];
/// The width of any other letter: as wide as a letter can be.
const OTHER: u16 = 1000;

/// The width of `text` in letters of `size` pixels.
pub fn width(text: &str, size: f64) -> f64 {
    let width = |letter: char| {
        let place = (letter as usize).checked_sub(usize::from(b' '));
        f64::from(place.and_then(|place| WIDTHS.get(place)).copied().unwrap_or(OTHER))
    };
    text.chars().map(width).sum::<f64>() * size / 1000.0
}
