//! A figure: panels one below the other over one horizontal axis, each with a vertical axis of its own, and the places
//! of all parts on the page.

use std::borrow::Cow;

use super::letters::width;
use super::scale::Scale;
use super::scene::{Anchor, Color, Scene, Shape, Text};
use super::trace::drawn;

/// A figure to draw.
#[derive(Debug, Default)]
pub struct Figure<'a> {
    pub title: String,
    /// Below the title.
    pub note: String,
    /// The quantity of the horizontal axis, with its unit.
    pub along: String,
    /// The places of the values of every trace along the horizontal axis.
    pub places: &'a [f64],
    /// The indices, ascending, of values that follow missing values.
    pub gaps: Vec<usize>,
    pub panels: Vec<Panel<'a>>,
}

/// One axis and its traces.
#[derive(Debug)]
pub struct Panel<'a> {
    /// The quantity of the vertical axis, with its unit.
    pub label: String,
    pub traces: Vec<Trace<'a>>,
}

/// A line in a panel.
#[derive(Debug)]
pub struct Trace<'a> {
    pub name: String,
    pub values: Cow<'a, [f64]>,
}

impl Trace<'_> {
    /// The trace's owner: `1` of `1.actual_position`.
    fn owner(&self) -> &str {
        self.name.split_once('.').map_or("", |(owner, _)| owner)
    }
}

const WIDTH: f64 = 960.0;
/// Height of a panel's frame, alone and among others.
const ALONE: f64 = 400.0;
const AMONG: f64 = 200.0;
const EDGE: f64 = 16.0;
/// The distance from a panel to the next panel's legend.
const BETWEEN: f64 = 18.0;
/// Heights of letters: of the title, and of all other texts.
const LARGE: f64 = 16.0;
const SMALL: f64 = 12.0;
/// The distance from line to line of small letters.
const LINE: f64 = 18.0;
/// Length of a mark on an axis, and the distance from the mark to its number.
const MARK: f64 = 5.0;
/// Length of the piece of line in a legend, and the distances from its end to the name, and from the name to the next
/// piece.
const SAMPLE: f64 = 24.0;
const BESIDE: f64 = 6.0;
const APART: f64 = 18.0;
/// Least distance in pixels between two marks on the vertical axis.
const MARK_APART: f64 = 34.0;
/// The most marks on the horizontal axis.
const MARKS_ALONG: usize = 12;

const BLACK: Color = [0x24, 0x29, 0x2F];
const FRAME: Color = [0x8C, 0x95, 0x9F];
const GRID: Color = [0xE4, 0xE8, 0xEC];
/// Colours that all readers tell apart (Okabe and Ito), and one more, for boards of eight motors.
const COLORS: [Color; 8] = [
    [0x00, 0x72, 0xB2],
    [0xD5, 0x5E, 0x00],
    [0x00, 0x9E, 0x73],
    [0xCC, 0x79, 0xA7],
    [0x56, 0xB4, 0xE9],
    [0xE6, 0x9F, 0x00],
    [0x00, 0x00, 0x00],
    [0x99, 0x99, 0x99],
];

/// A trace's look: its colour, and whether it is dashed.
type TraceLook = (Color, bool);

/// The looks of the traces of `panel`. A motor has one colour in every panel, and its second trace is dashed; if one
/// motor owns all traces, each trace has its own colour.
fn looks(panel: &Panel, owners: &[&str]) -> Vec<TraceLook> {
    let own = |index: usize, trace: &Trace| match owners.iter().position(|owner| *owner == trace.owner()) {
        Some(place) if owners.len() > 1 => {
            let before = panel.traces[..index].iter().filter(|other| other.owner() == trace.owner()).count();
            (place, before % 2 == 1)
        }
        _ => (index, index / COLORS.len() % 2 == 1),
    };
    let looks = panel.traces.iter().enumerate().map(|(index, trace)| own(index, trace));
    looks.map(|(place, dashed)| (COLORS[place % COLORS.len()], dashed)).collect()
}

/// The part of the page inside a panel's frame.
#[derive(Debug, Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

/// A panel with its axis.
struct Measured<'f, 'a> {
    panel: &'f Panel<'a>,
    looks: Vec<TraceLook>,
    scale: Option<Scale>,
    marks: Vec<(f64, String)>,
}

/// The picture of `figure`.
pub fn scene(figure: &Figure) -> Scene {
    let height = if figure.panels.len() == 1 { ALONE } else { AMONG };
    let mut owners: Vec<&str> =
        figure.panels.iter().flat_map(|panel| &panel.traces).map(Trace::owner).collect();
    owners.sort_unstable();
    owners.dedup();
    let panels: Vec<Measured> =
        figure.panels.iter().map(|panel| measured(panel, looks(panel, &owners), height)).collect();
    let numbers = panels.iter().flat_map(|panel| &panel.marks).map(|(_, text)| width(text, SMALL));
    let left = EDGE + LINE + numbers.fold(0.0, f64::max) + MARK + 3.0;
    let right = WIDTH - EDGE - APART;
    let along = Scale::of(figure.places.iter().copied()).unwrap_or(Scale { low: 0.0, high: 1.0 });
    let marks_along = marks_along(along, right - left);
    let mut page = FigurePage { shapes: Vec::new(), y: EDGE };
    page.head(figure, left);
    let count = panels.len();
    for (index, panel) in panels.iter().enumerate() {
        page.legend(panel, left, right);
        let frame = Frame { left, top: page.y, right, bottom: page.y + height };
        page.panel(panel, frame, (along, &marks_along), figure);
        page.y = frame.bottom;
        if index + 1 < count {
            page.y += BETWEEN;
        } else {
            page.numbers_along(frame, along, &marks_along);
        }
    }
    page.y += MARK + LINE;
    page.text([(left + right) / 2.0, page.y + SMALL], &figure.along, Anchor::Middle);
    Scene { width: WIDTH, height: (page.y + SMALL + EDGE).ceil(), shapes: page.shapes }
}

fn measured<'f, 'a>(panel: &'f Panel<'a>, looks: Vec<TraceLook>, height: f64) -> Measured<'f, 'a> {
    let values = panel.traces.iter().flat_map(|trace| trace.values.iter().copied());
    let scale = Scale::of(values).map(Scale::with_room);
    let most = (height / MARK_APART) as usize;
    Measured { panel, looks, scale, marks: scale.map_or_else(Vec::new, |scale| scale.marks(most)) }
}

/// As many marks as fit side by side.
fn marks_along(scale: Scale, room: f64) -> Vec<(f64, String)> {
    let fits = |marks: &Vec<(f64, String)>| {
        let widest = marks.iter().map(|(_, text)| width(text, SMALL)).fold(0.0, f64::max);
        (widest + APART) * marks.len() as f64 <= room
    };
    (1..=MARKS_ALONG).rev().map(|most| scale.marks(most)).find(fits).unwrap_or_default()
}

/// The text, cut where it would leave the page.
fn shortened(text: &str, size: f64, room: f64) -> String {
    if width(text, size) <= room {
        return text.to_owned();
    }
    let mut kept = text.to_owned();
    while !kept.is_empty() && width(&kept, size) + size > room {
        kept.pop();
    }
    kept + "…"
}

/// The words in as many lines as they need.
fn wrapped(text: &str, room: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), SMALL) <= room => {
                *line += " ";
                *line += word;
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The page while the program fills it from top to bottom.
struct FigurePage {
    shapes: Vec<Shape>,
    /// The height filled so far.
    y: f64,
}

impl FigurePage {
    fn text(&mut self, at: [f64; 2], text: &str, anchor: Anchor) {
        let text = text.to_owned();
        self.shapes.push(Shape::Text(Text { at, text, size: SMALL, anchor, color: BLACK, upwards: false }));
    }

    fn line(&mut self, points: Vec<[f64; 2]>, color: Color) {
        self.shapes.push(Shape::Line { points, color, width: 1.0, dashed: false });
    }

    fn head(&mut self, figure: &Figure, left: f64) {
        self.y += LARGE;
        let (at, text) = ([left, self.y], shortened(&figure.title, LARGE, WIDTH - EDGE - left));
        self.shapes.push(Shape::Text(Text {
            at,
            text,
            size: LARGE,
            anchor: Anchor::Start,
            color: BLACK,
            upwards: false,
        }));
        for line in wrapped(&figure.note, WIDTH - EDGE - left) {
            self.y += LINE;
            self.text([left, self.y], &line, Anchor::Start);
        }
        self.y += LINE / 2.0;
    }

    /// Each trace's name behind a piece of its line, above the frame.
    fn legend(&mut self, Measured { panel, looks, .. }: &Measured, left: f64, right: f64) {
        self.y += LINE;
        let mut x = left;
        for (trace, &(color, dashed)) in panel.traces.iter().zip(looks) {
            let name = shortened(&trace.name, SMALL, right - left - SAMPLE - BESIDE);
            let long = SAMPLE + BESIDE + width(&name, SMALL);
            if x > left && x + long > right {
                x = left;
                self.y += LINE;
            }
            let y = self.y - SMALL / 3.0;
            let points = vec![[x, y], [x + SAMPLE, y]];
            self.shapes.push(Shape::Line { points, color, width: 2.0, dashed });
            self.text([x + SAMPLE + BESIDE, self.y], &name, Anchor::Start);
            x += long + APART;
        }
        self.y += SMALL / 2.0;
    }

    fn panel(
        &mut self,
        Measured { panel, looks, scale, marks }: &Measured,
        frame: Frame,
        (along, marks_along): (Scale, &[(f64, String)]),
        Figure { places, gaps, .. }: &Figure,
    ) {
        let Frame { left, top, right, bottom } = frame;
        let x = |place: f64| left + along.part(place) * (right - left);
        for (place, _) in marks_along {
            self.line(vec![[x(*place), top], [x(*place), bottom]], GRID);
        }
        let label = shortened(&panel.label, SMALL, bottom - top);
        self.shapes.push(Shape::Text(Text {
            at: [EDGE + SMALL, (top + bottom) / 2.0],
            text: label,
            size: SMALL,
            anchor: Anchor::Middle,
            color: BLACK,
            upwards: true,
        }));
        let Some(scale) = scale else {
            self.text([(left + right) / 2.0, (top + bottom) / 2.0], "no values", Anchor::Middle);
            self.frame(frame);
            return;
        };
        let y = |value: f64| bottom - scale.part(value) * (bottom - top);
        for (value, text) in marks {
            self.line(vec![[left, y(*value)], [right, y(*value)]], GRID);
            self.text([left - MARK - 3.0, y(*value) + SMALL * 0.36], text, Anchor::End);
        }
        self.frame(frame);
        for (value, _) in marks {
            self.line(vec![[left - MARK, y(*value)], [left, y(*value)]], FRAME);
        }
        let on_page = |(place, value): (&f64, &f64)| {
            (along.has(*place) && scale.has(*value)).then(|| [x(*place), y(*value)])
        };
        for (trace, &(color, dashed)) in panel.traces.iter().zip(looks) {
            let drawn = drawn(places.iter().zip(&*trace.values).map(on_page), gaps);
            let line = |points| Shape::Line { points, color, width: 1.5, dashed };
            self.shapes.extend(drawn.lines.into_iter().map(line));
            self.shapes.extend(drawn.dots.into_iter().map(|at| Shape::Dot { at, color }));
        }
    }

    fn frame(&mut self, Frame { left, top, right, bottom }: Frame) {
        let corners = vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
        self.line(corners, FRAME);
    }

    fn numbers_along(&mut self, frame: Frame, along: Scale, marks: &[(f64, String)]) {
        let Frame { left, right, bottom, .. } = frame;
        for (place, text) in marks {
            let x = left + along.part(*place) * (right - left);
            self.line(vec![[x, bottom], [x, bottom + MARK]], FRAME);
            self.text([x, bottom + MARK + SMALL + 2.0], text, Anchor::Middle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: f64 = f64::NAN;

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|name| (*name).to_owned()).collect()
    }

    /// The picture of two panels, the first with traces of these names.
    fn picture(traces: &[String], values: &[f64]) -> Scene {
        let places: Vec<f64> = (0..values.len()).map(|index| index as f64 * 1e-3).collect();
        let traces = traces.iter().map(|name| Trace { name: name.clone(), values: values.into() }).collect();
        let error = Trace { name: "1.following_error".to_owned(), values: values.into() };
        let figure = Figure {
            title: "a".repeat(400),
            note: "a word or two ".repeat(40),
            along: "time (s)".to_owned(),
            places: &places,
            gaps: vec![2],
            panels: vec![
                Panel { label: "position (count)".to_owned(), traces },
                Panel { label: "following error (count)".repeat(9), traces: vec![error] },
            ],
        };
        scene(&figure)
    }

    /// The rectangle that a text covers: left, top, right, bottom.
    fn place(text: &Text) -> [f64; 4] {
        let width = width(&text.text, text.size);
        let before = match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => width / 2.0,
            Anchor::End => width,
        };
        let ([x, y], size) = (text.at, text.size);
        match text.upwards {
            false => [x - before, y - 0.75 * size, x - before + width, y + 0.2 * size],
            true => [x - 0.75 * size, y + before - width, x + 0.2 * size, y + before],
        }
    }

    fn texts(scene: &Scene) -> Vec<&Text> {
        let mut texts = Vec::new();
        for shape in &scene.shapes {
            if let Shape::Text(text) = shape {
                texts.push(text);
            }
        }
        texts
    }

    #[test]
    fn no_label_is_cut_or_overlaps_another() {
        let many: Vec<String> = (1..=24).map(|motor| format!("{motor}.commanded_position")).collect();
        let huge: Vec<f64> = (0..100).map(|index| 34_359_738_000.0 + f64::from(index) / 1e3).collect();
        for traces in [names(&["1.actual_position"]), names(&[&"x".repeat(500), "&<"]), many] {
            for values in [&[0.0][..], &[NOTHING; 5], &[1e-9, -1e-9], &[1e300, -1e300, NOTHING], &huge] {
                let scene = picture(&traces, values);
                let texts = texts(&scene);
                let places: Vec<[f64; 4]> = texts.iter().map(|text| place(text)).collect();
                for (index, one) in places.iter().enumerate() {
                    let inside =
                        one[0] >= 0.0 && one[1] >= 0.0 && one[2] <= scene.width && one[3] <= scene.height;
                    assert!(inside, "{:?} at {one:?}", texts[index].text);
                    for (other, text) in places[..index].iter().zip(&texts) {
                        let apart = one[0] >= other[2]
                            || other[0] >= one[2]
                            || one[1] >= other[3]
                            || other[1] >= one[3];
                        assert!(apart, "{:?} and {:?}", texts[index].text, text.text);
                    }
                }
            }
        }
    }

    #[test]
    fn a_motor_has_one_colour_and_lines_stay_in_their_frame() {
        let traces = names(&["1.commanded_position", "1.actual_position", "2.actual_position"]);
        let scene = picture(&traces, &[0.0, 5.0, -3.0, 4.0]);
        let lines: Vec<_> = scene
            .shapes
            .iter()
            .filter_map(|shape| match shape {
                Shape::Line { points, color, width: 1.5, dashed } => Some((points, *color, *dashed)),
                _ => None,
            })
            .collect();
        // A gap before the third value parts each of the four traces.
        assert_eq!(lines.len(), 8);
        let look = |index: usize| (lines[index].1, lines[index].2);
        assert_eq!(
            [look(0), look(2), look(4), look(6)],
            [(COLORS[0], false), (COLORS[0], true), (COLORS[1], false), (COLORS[0], false)]
        );
        assert_eq!(lines[0].0.len(), 2);
        let inside = |[x, y]: &[f64; 2]| *x >= 0.0 && *x <= WIDTH && *y >= 0.0 && *y <= scene.height;
        assert!(lines.iter().all(|(points, ..)| points.iter().all(inside)));
    }
}
