//! The following error of one motor over the last seconds, in dots.

use std::time::Instant;

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::symbols::Marker;
use ratatui::text::Span;
use ratatui::widgets::{Axis, Chart, Dataset, GraphType};

use super::Look;
use crate::cli::top::trace::{Trace, WINDOW};
use crate::client::number::short;

pub fn draw(frame: &mut Frame<'_>, area: Rect, trace: &Trace, look: Look, now: Instant) {
    let most = round_up(trace.peak().unwrap_or_default());
    let stretches = trace.stretches(now);
    let lines = stretches.iter().map(|stretch| {
        Dataset::default()
            .marker(Marker::Braille)
            .graph_type(GraphType::Line)
            .style(look.trace())
            .data(stretch)
    });
    let window = WINDOW.as_secs_f64();
    let label = |text: String| Span::raw(text);
    let y =
        Axis::default().bounds([-most, most]).labels([short(-most), "0".to_owned(), short(most)].map(label));
    let mut x = Axis::default().bounds([-window, 0.0]);
    // The axis' labels take two rows.
    if area.height > 5 {
        x = x.labels([format!("-{window} s"), "now".to_owned()].map(label));
    }
    frame.render_widget(Chart::new(lines.collect()).x_axis(x).y_axis(y), area);
}

/// The next of 1, 2, 5, 10, 20, ...: an axis that does not change with every count.
fn round_up(value: f64) -> f64 {
    let decade = 10_f64.powf(value.max(1.0).log10().floor());
    [1.0, 2.0, 5.0].map(|step| step * decade).into_iter().find(|step| value <= *step).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_ends_at_a_round_number() {
        for (value, end) in
            [(0.0, 1.0), (0.3, 1.0), (1.0, 1.0), (1.1, 2.0), (4.9, 5.0), (5.1, 10.0), (73_000.0, 100_000.0)]
        {
            assert_eq!(round_up(value), end, "{value}");
        }
    }
}
