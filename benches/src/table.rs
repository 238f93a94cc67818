//! Ratios of interleaved rounds, and whether they meet their bars.

use std::fmt::Write as _;

/// What a ratio has to be.
#[derive(Clone, Copy)]
pub enum Bar {
    AtMost(f64),
    AtLeast(f64),
    /// Told for comparison.
    None,
}

impl Bar {
    fn is_met(self, ratio: f64) -> &'static str {
        match self {
            Self::AtMost(bar) if ratio <= bar => "yes",
            Self::AtLeast(bar) if ratio >= bar => "yes",
            Self::None => "",
            _ => "NO",
        }
    }

    fn text(self) -> String {
        match self {
            Self::AtMost(bar) => format!("<= {bar}"),
            Self::AtLeast(bar) => format!(">= {bar}"),
            Self::None => String::new(),
        }
    }
}

/// One line of the table, measured once a round.
struct Row {
    number: &'static str,
    figure: &'static str,
    unit: &'static str,
    bar: Bar,
    ours: Vec<f64>,
    peer: Vec<f64>,
}

/// Everything measured so far.
#[derive(Default)]
pub struct Table {
    rows: Vec<Row>,
}

impl Table {
    /// Adds a round's measurement of a figure: ours and what it is compared with, in the same unit.
    pub fn add(
        &mut self,
        number: &'static str,
        figure: &'static str,
        unit: &'static str,
        bar: Bar,
        [ours, peer]: [f64; 2],
    ) {
        let place = self.rows.iter().position(|row| row.figure == figure && row.number == number);
        let place = place.unwrap_or_else(|| {
            self.rows.push(Row { number, figure, unit, bar, ours: vec![], peer: vec![] });
            self.rows.len() - 1
        });
        self.rows[place].ours.push(ours);
        self.rows[place].peer.push(peer);
    }

    /// The table: each figure with the median of ours and of the peer's, and the ratios of the rounds.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{:<4} {:<60} {:>5} {:>9} {:>9} {:>8} {:>8} {:>8} {:>9}  met\n",
            "row", "figure", "unit", "ours", "peer", "min", "median", "max", "bar"
        );
        let mut rows: Vec<&Row> = self.rows.iter().collect();
        rows.sort_by_key(|row| {
            let digits: String = row.number.chars().take_while(char::is_ascii_digit).collect();
            (digits.parse::<u32>().unwrap_or(0), row.number)
        });
        for row in rows {
            let ratios = row.ours.iter().zip(&row.peer).map(|(ours, peer)| ours / peer).collect();
            let [min, median, max] = spread(ratios);
            let [_, ours, _] = spread(row.ours.clone());
            let [_, peer, _] = spread(row.peer.clone());
            let _ = writeln!(
                text,
                "{:<4} {:<60} {:>5} {:>9} {:>9} {:>8} {:>8} {:>8} {:>9}  {}",
                row.number,
                row.figure,
                row.unit,
                short(ours),
                short(peer),
                short(min),
                short(median),
                short(max),
                row.bar.text(),
                row.bar.is_met(median)
            );
        }
        text
    }
}

/// Three or four digits that say something.
fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if size < 0.01 => format!("{value:.1e}"),
        size if size < 10.0 => format!("{value:.2}"),
        size if size < 100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// Least, median and greatest.
pub fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    match values.as_slice() {
        [] => [f64::NAN; 3],
        values => [values[0], values[values.len() / 2], values[values.len() - 1]],
    }
}
