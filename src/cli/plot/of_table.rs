//! The parts of a table that a picture shows: time along, and a panel for each kind of value.

use std::borrow::Cow;

use super::figure::{Figure, Panel, Trace};
use crate::cli::context::Failure;
use crate::table::{Field, Table};

/// The columns that can give the time, the best first, and the name of the axis.
const TIMES: [(&str, &str); 4] = [
    ("time_s", "time (s)"),
    ("servo_cycle", "time (servo cycles)"),
    ("sample", "sample"),
    ("update", "update"),
];
/// Columns about the row, not about the machine.
const OWN: [&str; 6] = ["time_s", "servo_cycle", "sample", "update", "unix_s", "missed"];
/// The column that counts lost updates.
const LOST: &str = "lost";

/// A figure of `table`: of the named columns and differences of two columns, or of all columns but times and status
/// words. `title` is the figure's title.
///
/// # Errors
/// [`Failure::Request`] names the column that the table does not have.
pub fn figure<'a>(table: &'a Table, columns: &[String], title: String) -> Result<Figure<'a>, Failure> {
    if table.rows() == 0 {
        return Err(Failure::Refused(format!("{title}: no rows, so nothing is drawn")));
    }
    let time = TIMES.iter().find_map(|(name, label)| Some((table.column(name)?, *label)));
    let Some((places, along)) = time else {
        let names = TIMES.map(|(name, _)| name).join(", ");
        return Err(Failure::Request(format!("{title}: no column of time; one of {names} is needed")));
    };
    let fields = (0..).zip(&table.fields);
    let is_named = |name: &String| columns.contains(name);
    let is_usual = |name: &&str| !OWN.contains(name) && *name != LOST && !name.ends_with("_status");
    let drawn = fields.filter(|(_, field)| match columns {
        [] => is_usual(&&*field.name),
        _ => is_named(&field.name),
    });
    let mut panels: Vec<Panel> = Vec::new();
    let mut add = |label: String, trace: Trace<'a>| match panels.iter_mut().find(|panel| panel.label == label)
    {
        Some(panel) => panel.traces.push(trace),
        None => panels.push(Panel { label, traces: vec![trace] }),
    };
    for (index, Field { name, unit, .. }) in drawn {
        let values = Cow::from(&table.columns[index]);
        add(label(name, unit), Trace { name: name.clone(), values });
    }
    for name in columns.iter().filter(|name| table.index(name).is_none()) {
        let Some((unit, values)) = difference(table, name)? else {
            let names: Vec<&str> = table.fields.iter().map(|field| &*field.name).collect();
            let names = names.join(", ");
            return Err(Failure::Request(format!("{title}: no column {name:?}; it has {names}")));
        };
        add(label("difference", unit), Trace { name: name.clone(), values: values.into() });
    }
    if panels.is_empty() {
        let why = "only times and status words in it; name columns with --columns to draw them";
        return Err(Failure::Request(format!("{title}: {why}")));
    }
    let gaps = gaps(table).into_iter().map(|(index, _)| index).collect();
    Ok(Figure { title, note: missing(table), along: along.to_owned(), places, gaps, panels })
}

/// The unit and the values of `a-b`, a column less another; `None` if the table lacks one of them. A column's name may
/// have hyphens, too.
fn difference<'a>(table: &'a Table, text: &str) -> Result<Option<(&'a str, Vec<f64>)>, Failure> {
    let places = text.match_indices('-').map(|(place, _)| place);
    let mut pairs =
        places.filter_map(|place| Some((table.index(&text[..place])?, table.index(&text[place + 1..])?)));
    let Some((a, b)) = pairs.next_back() else { return Ok(None) };
    let [of_a, of_b] = [a, b].map(|index| &*table.fields[index].unit);
    if of_a != of_b {
        return Err(Failure::Request(format!("{text}: a difference of [{of_a}] and [{of_b}] has no unit")));
    }
    let values = table.columns[a].iter().zip(&table.columns[b]).map(|(a, b)| a - b).collect();
    Ok(Some((of_a, values)))
}

/// The name of an axis for values like the column's: `1.actual_position` and `2.commanded_position` are positions.
fn label(name: &str, unit: &str) -> String {
    let kind = match name.split_once('.') {
        Some((_, kind)) if kind.ends_with("_position") => "position",
        Some((_, kind)) => kind,
        None => name,
    };
    let kind = kind.replace('_', " ");
    if unit.is_empty() { kind } else { format!("{kind} ({unit})") }
}

/// How many samples or updates the table lacks.
fn missing(table: &Table) -> String {
    let sum = |name| table.column(name).map_or(0.0, |counts| counts.iter().sum::<f64>());
    let updates = sum("missed") + sum(LOST);
    let samples: f64 = gaps(table).iter().map(|(_, samples)| samples).sum();
    match (updates > 0.0, samples > 0.0) {
        (true, _) => format!("missing updates: {updates}"),
        (false, true) => format!("missing samples: {samples}"),
        (false, false) => String::new(),
    }
}

/// The rows of a gather after missing samples, and how many are missing before each.
fn gaps(table: &Table) -> Vec<(usize, f64)> {
    let numbers = table.column("sample").unwrap_or_default();
    let jump = |(index, pair): (usize, &[f64])| (index + 1, pair[1] - pair[0] - 1.0);
    numbers.windows(2).enumerate().map(jump).filter(|(_, samples)| *samples > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        Table::parse(text.as_bytes()).unwrap()
    }

    fn panels(table: &Table, columns: &[&str]) -> Result<Vec<String>, String> {
        let columns: Vec<String> = columns.iter().map(|name| (*name).to_owned()).collect();
        let figure = figure(table, &columns, "x.csv".to_owned()).map_err(|error| error.to_string())?;
        let names =
            |panel: &Panel| panel.traces.iter().map(|trace| trace.name.clone()).collect::<Vec<_>>().join(" ");
        Ok(figure.panels.iter().map(|panel| format!("{}: {}", panel.label, names(panel))).collect())
    }

    #[test]
    fn what_is_alike_shares_an_axis() {
        let log = table(
            "update,time_s,unix_s,missed,lost,1.commanded_position [count],1.following_error [count],1.servo_status,2.actual_position \
             [count],X:$0033\n1,0,1,0,0,1,2,3,4,5\n2,1,1,3,0,,,,,\n3,2,1,0,4,,,,,\n",
        );
        assert_eq!(
            panels(&log, &[]).unwrap(),
            [
                "position (count): 1.commanded_position 2.actual_position",
                "following error (count): 1.following_error",
                "X:$0033: X:$0033"
            ]
        );
        assert_eq!(panels(&log, &["1.servo_status"]).unwrap(), ["servo status: 1.servo_status"]);
        let drawn = figure(&log, &[], String::new()).unwrap();
        assert_eq!((&*drawn.along, &*drawn.note), ("time (s)", "missing updates: 7"));
        assert_eq!(
            panels(&log, &["1.commanded_position-2.actual_position", "1.following_error"]).unwrap(),
            [
                "following error (count): 1.following_error",
                "difference (count): 1.commanded_position-2.actual_position"
            ]
        );
        let drawn =
            figure(&log, &["1.commanded_position-2.actual_position".to_owned()], String::new()).unwrap();
        assert_eq!(drawn.panels[0].traces[0].values[0], 1.0 - 4.0);
        assert!(panels(&log, &["1.following_error-X:$0033"]).unwrap_err().contains("has no unit"));
        for name in ["1.following_error-x", "-1.following_error", "1.following_error-"] {
            assert!(panels(&log, &[name]).unwrap_err().contains("no column"), "{name}");
        }
        assert!(panels(&log, &["x"]).unwrap_err().contains("no column \"x\"; it has update, time_s"));
    }

    #[test]
    fn a_gather_tells_what_it_lost() {
        let gather = table("sample,servo_cycle,Y:$C003\n0,0,1\n1,2,1\n5,10,1\n6,12,1\n");
        let drawn = figure(&gather, &[], String::new()).unwrap();
        assert_eq!(
            (&*drawn.along, &*drawn.note, drawn.gaps),
            ("time (servo cycles)", "missing samples: 3", vec![2])
        );
    }

    #[test]
    fn what_cannot_be_drawn_says_why() {
        assert_eq!(
            panels(&table("sample,time_s,a\n"), &[]),
            Err("x.csv: no rows, so nothing is drawn".to_owned())
        );
        assert!(panels(&table("a,b\n1,2\n"), &[]).unwrap_err().contains("no column of time"));
        assert!(panels(&table("time_s\n1\n"), &[]).unwrap_err().contains("name columns with --columns"));
    }
}
