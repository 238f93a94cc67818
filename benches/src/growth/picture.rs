//! Which of the figures are plotted, and how.

use super::plot::{Curve, Panel, svg};
use super::{Line, Results};

const BLUE: &str = "#0969da";
const ORANGE: &str = "#bc4c00";

fn curve(label: &'static str, color: &'static str, lines: &[Line], value: fn(&Line) -> f64) -> Curve {
    let lines = lines.iter().filter(|line| line.count > 0);
    let points = lines.map(|line| [line.count as f64, value(line)]).collect();
    Curve { label, color, dashed: false, points }
}

/// Median and, dashed, 99th percentile of the delay from a servo update to the daemon's first read of it.
fn delays(labels: [&'static str; 2], color: &'static str, lines: &[Line]) -> [Curve; 2] {
    let [median, p99] = labels;
    [
        curve(median, color, lines, |line| line.mirrored.median / 1e3),
        Curve { dashed: true, ..curve(p99, color, lines, |line| line.mirrored.p99 / 1e3) },
    ]
}

/// The results as SVG text: CPU, servo delay and a figure of its own for each of what grows.
pub fn of(results: &Results) -> String {
    const CPU: &str = "CPU of pmacd";
    const DELAY: &str = "servo update to mirror";
    let Results { readers, woken_readers, clients, variables, motors } = results;
    let cpu = |line: &Line| line.cpu;
    let panel = |title, unit, along, logarithmic, curves| Panel { title, unit, along, logarithmic, curves };
    let [median, p99] = delays(["10 Hz", "p99"], BLUE, readers);
    let [woken_median, woken_p99] = delays(["each update", ""], ORANGE, woken_readers);
    let percent = "% of a CPU";
    let mut panels = vec![
        panel(
            CPU,
            percent,
            "readers attached",
            false,
            vec![curve("10 Hz", BLUE, readers, cpu), curve("each update", ORANGE, woken_readers, cpu)],
        ),
        panel(DELAY, "µs", "readers attached", true, vec![median, p99, woken_median, woken_p99]),
        panel(
            "servo update to a woken client",
            "µs",
            "readers attached",
            true,
            vec![
                curve("10 Hz", BLUE, readers, |line| line.woken.median / 1e3),
                Curve { dashed: true, ..curve("p99", BLUE, readers, |line| line.woken.p99 / 1e3) },
                curve("each update", ORANGE, woken_readers, |line| line.woken.median / 1e3),
                Curve { dashed: true, ..curve("", ORANGE, woken_readers, |line| line.woken.p99 / 1e3) },
            ],
        ),
    ];
    for (along, lines, title, unit) in [
        ("command clients", clients, "command lines", "a second, together"),
        ("variables", variables, "tables of variables", "a second"),
        ("motors", motors, "bus accesses", "16 bit, an update"),
    ] {
        panels.push(panel(CPU, percent, along, false, vec![curve("", BLUE, lines, cpu)]));
        panels.push(panel(DELAY, "µs", along, true, delays(["median", "p99"], BLUE, lines).into()));
        panels.push(panel(title, unit, along, false, vec![curve("", BLUE, lines, |line| line.rate)]));
    }
    svg(3, &panels)
}
