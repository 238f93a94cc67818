//! Small plots side by side, as SVG text. The horizontal axis is logarithmic and marks every number that was measured.

use std::fmt::Write as _;

/// One line of a plot.
pub struct Curve {
    pub label: &'static str,
    pub color: &'static str,
    pub dashed: bool,
    pub points: Vec<[f64; 2]>,
}

/// One plot.
pub struct Panel {
    pub title: &'static str,
    /// Of the vertical axis.
    pub unit: &'static str,
    /// Of the horizontal axis.
    pub along: &'static str,
    pub logarithmic: bool,
    pub curves: Vec<Curve>,
}

const WIDTH: f64 = 280.0;
const HEIGHT: f64 = 178.0;
/// Around the plotted area of a panel: left, top, right, bottom.
const MARGINS: [f64; 4] = [46.0, 46.0, 12.0, 36.0];
const EDGE: f64 = 8.0;
/// Width of a letter, about.
const LETTER: f64 = 5.6;

const STYLE: &str = "text{font-family:Helvetica,Arial,'DejaVu Sans',sans-serif;font-size:11px;fill:#24292f}\
    .title{font-weight:600;font-size:12px}.small{font-size:10px;fill:#57606a}\
    .grid{stroke:#e4e8ec;stroke-width:1}.axis{stroke:#8c959f;stroke-width:1}\
    .curve{fill:none;stroke-width:2;stroke-linejoin:round}.dashed{stroke-width:1.5;stroke-dasharray:4 3}";

/// The panels, `columns` in a row.
pub fn svg(columns: usize, panels: &[Panel]) -> String {
    let width = WIDTH * columns as f64 + 2.0 * EDGE;
    let height = HEIGHT * panels.len().div_ceil(columns) as f64 + 2.0 * EDGE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n\
         <style>{STYLE}</style>\n\
         <rect width=\"{width}\" height=\"{height}\" rx=\"8\" fill=\"#ffffff\"/>\n"
    );
    for (index, panel) in panels.iter().enumerate() {
        let (x, y) = (EDGE + WIDTH * (index % columns) as f64, EDGE + HEIGHT * (index / columns) as f64);
        let _ = writeln!(svg, "<g transform=\"translate({x},{y})\">");
        panel.draw(&mut svg);
        svg += "</g>\n";
    }
    svg + "</svg>\n"
}

impl Panel {
    fn values(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        self.curves.iter().flat_map(|curve| &curve.points).map(move |point| point[axis])
    }

    fn draw(&self, svg: &mut String) {
        let [left, top, right, bottom] = MARGINS;
        let mut marks: Vec<f64> = self.values(0).collect();
        marks.sort_by(f64::total_cmp);
        marks.dedup();
        let (Some(&first), Some(&last)) = (marks.first(), marks.last()) else { return };
        let steps = self.steps();
        let (Some(&low), Some(&high)) = (steps.first(), steps.last()) else { return };
        let across = |value: f64| {
            let part = (value / first).ln() / (last / first).ln().max(f64::MIN_POSITIVE);
            left + 6.0 + part * (WIDTH - left - right - 12.0)
        };
        let up = |value: f64| {
            let part = if self.logarithmic {
                (value.max(low) / low).ln() / (high / low).ln()
            } else {
                (value - low) / (high - low)
            };
            HEIGHT - bottom - part * (HEIGHT - top - bottom)
        };
        let (end, floor) = (WIDTH - right, HEIGHT - bottom);
        let _ = writeln!(svg, "<text class=\"title\" x=\"{left}\" y=\"14\">{}</text>", self.title);
        for step in &steps {
            let y = up(*step);
            let _ = writeln!(
                svg,
                "<line class=\"grid\" x1=\"{left}\" y1=\"{y:.1}\" x2=\"{end}\" y2=\"{y:.1}\"/>\
                 <text class=\"small\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 5.0,
                y + 3.5,
                short(*step)
            );
        }
        for mark in &marks {
            let x = across(*mark);
            let _ = writeln!(
                svg,
                "<line class=\"axis\" x1=\"{x:.1}\" y1=\"{floor}\" x2=\"{x:.1}\" y2=\"{:.1}\"/>\
                 <text class=\"small\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                floor + 4.0,
                floor + 15.0,
                short(*mark)
            );
        }
        let _ = writeln!(
            svg,
            "<line class=\"axis\" x1=\"{left}\" y1=\"{floor}\" x2=\"{end}\" y2=\"{floor}\"/>\
             <text class=\"small\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            (left + end) / 2.0,
            HEIGHT - 7.0,
            self.along
        );
        self.legend(svg);
        for curve in &self.curves {
            let class = if curve.dashed { "curve dashed" } else { "curve" };
            let points: Vec<String> =
                curve.points.iter().map(|[x, y]| format!("{:.1},{:.1}", across(*x), up(*y))).collect();
            let _ = writeln!(
                svg,
                "<polyline class=\"{class}\" stroke=\"{}\" points=\"{}\"/>",
                curve.color,
                points.join(" ")
            );
            for [x, y] in &curve.points {
                let _ = write!(
                    svg,
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.4\" fill=\"{}\"/>",
                    across(*x),
                    up(*y),
                    curve.color
                );
            }
            svg.push('\n');
        }
    }

    /// The unit, then each curve's label behind a piece of it.
    fn legend(&self, svg: &mut String) {
        let y = 31.0;
        let mut x = MARGINS[0];
        let _ = write!(svg, "<text class=\"small\" x=\"{x}\" y=\"{y}\">{}</text>", self.unit);
        x += LETTER * self.unit.chars().count() as f64 + 10.0;
        for curve in self.curves.iter().filter(|curve| !curve.label.is_empty()) {
            let class = if curve.dashed { "curve dashed" } else { "curve" };
            let _ = write!(
                svg,
                "<line class=\"{class}\" stroke=\"{}\" x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>\
                 <text class=\"small\" x=\"{:.1}\" y=\"{y}\">{}</text>",
                curve.color,
                y - 3.5,
                x + 14.0,
                y - 3.5,
                x + 18.0,
                curve.label
            );
            x += 18.0 + LETTER * curve.label.chars().count() as f64 + 9.0;
        }
        svg.push('\n');
    }

    /// Where the grid's lines are, ascending.
    fn steps(&self) -> Vec<f64> {
        let (low, high) = self
            .values(1)
            .fold((f64::INFINITY, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        if self.logarithmic {
            // At least from 10 to 1000, so that most panels have one scale.
            let first = (low.max(0.1).log10().floor() as i32).min(1);
            let last = (high.max(0.2).log10().ceil() as i32).max(3);
            return (first..=last).map(|power| 10_f64.powi(power)).collect();
        }
        let size = 10_f64.powf((high.max(1e-9) / 4.0).log10().floor());
        let step = [1.0, 2.0, 2.5, 5.0, 10.0]
            .into_iter()
            .map(|factor| factor * size)
            .find(|step| step * 4.0 >= high)
            .unwrap_or(size * 10.0);
        (0..=4).map(|index| f64::from(index) * step).collect()
    }
}

/// A number as short as it can be told.
fn short(value: f64) -> String {
    if value >= 10_000.0 {
        format!("{}k", value / 1000.0)
    } else {
        format!("{}", (value * 1e6).round() / 1e6)
    }
}
