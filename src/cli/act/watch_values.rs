//! `pmacctl variable watch`: side by side, the values of registers that PMAC copies, and of P, Q, M and I variables,
//! which pmacctl asks for by command line.

use std::time::{Duration, Instant};

use clap::Args as ClapArgs;
use serde_json::{Value, json};

use crate::cli::args::values::{rate, seconds};
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::layout::board_layout;
use crate::client::command::variables::board_variable;
use crate::client::number::{digits, short};
use crate::client::{Board, Connection, Variable as Entry, VariableTable, VariableWatch, View};
use crate::decode::Scales;
use crate::gather::{Column, Reading, Source};
use crate::language::deadlines;
use crate::map::word_use::m_variables;
use crate::map::{BadVariable, Layout, Space, VariableName};
use crate::segment::RegionId;

/// Longest sleep between two checks that the daemon still holds the watch.
const NO_NEWS: Duration = Duration::from_millis(500);
/// How many stale limits PMAC may take until the first values.
const FIRST: u32 = 5;
/// The digits that a product of two 64-bit floats surely keeps.
const PRODUCT_DIGITS: usize = 15;
/// The largest integer an f64 holds with all integers below it.
const EXACT: f64 = 9_007_199_254_740_992.0;

#[derive(Debug, ClapArgs)]
pub struct Watch {
    /// Y:$0003, X:$0028, D:$002B, L:$1005, or a name such as 1.actual_position; a 24-bit word is signed unless ,u follows.
    /// PLCC:7 is function block 7 of the compiled PLCs, PLCC:X:7 and PLCC:Y:7 are its words (firmware 1.16). P1, Q1 (of the
    /// coordinate system that is addressed), I122 and M102 are asked for by command line (M: role engineer)
    #[arg(required = true, value_name = "REGISTER")]
    registers: Vec<String>,
    /// Stop after this many prints
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Stop after this time, in seconds
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    seconds: Option<Duration>,
    /// The most prints a second
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate, allow_negative_numbers = true)]
    rate: Duration,
}

pub fn run(context: &mut Context, options: &Watch) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let (layout, scales, _) = board_layout(&mut board)?;
    let wanted: Vec<WatchedName> = options
        .registers
        .iter()
        .map(|text| WatchedName::parse(text, &layout, &scales))
        .collect::<Result<_, _>>()?;
    let mut copies = Copies::begin(&mut board, &wanted)?;
    let mut questions = Questions::begin(context, &wanted)?;
    let end = options.seconds.and_then(|seconds| Instant::now().checked_add(seconds));
    let left = || end.map_or(NO_NEWS, |end| end.saturating_duration_since(Instant::now()));
    let mut printed = 0;
    while options.count.is_none_or(|count| printed < count) && !left().is_zero() {
        let round = Instant::now();
        let table = match &mut copies {
            Some(copies) => copies.next(&mut board, left().min(NO_NEWS))?,
            None => None,
        };
        if table.is_some() || copies.is_none() {
            let answers = questions.as_mut().map_or(Ok(Vec::new()), Questions::ask)?;
            print(context, table.as_ref(), &wanted, &answers)?;
            context.output.flush()?;
            printed += 1;
        }
        if options.count.is_none_or(|count| printed < count) {
            std::thread::sleep(options.rate.saturating_sub(round.elapsed()).min(left()));
        }
    }
    Ok(copies.map_or(printed > 0, |copies| copies.fresh).into())
}

/// A name that the user watches.
enum WatchedName {
    /// A register that PMAC copies.
    Copied(Copied),
    /// A variable, by the name in the question to the board.
    Asked(String),
}

/// A register that PMAC copies.
pub struct Copied {
    name: VariableName,
    column: Column,
    /// How many longs at the start of its entry belong to another word.
    longs_before: usize,
}

impl WatchedName {
    fn parse(text: &str, layout: &Layout, scales: &Scales) -> Result<Self, Failure> {
        let count = m_variables(layout.family());
        match board_variable(text) {
            // A board has as many of each kind.
            Some(name) if name[1..].parse().is_ok_and(|number: u16| number < count) => Ok(Self::Asked(name)),
            Some(name) => {
                let (kind, title, last) = (&name[..1], layout.family().title, count - 1);
                Err(Failure::Request(format!("there is no {name}: a {title} has {kind}0 to {kind}{last}")))
            }
            None => Copied::parse(text, layout, scales).map(Self::Copied),
        }
    }
}

impl Copied {
    pub fn parse(text: &str, layout: &Layout, scales: &Scales) -> Result<Self, Failure> {
        let (address, unsigned) = text.strip_suffix(",u").map_or((text, false), |address| (address, true));
        let name = match VariableName::parse(address, layout.family()) {
            Ok(VariableName::Block { word: None, .. }) if unsigned => {
                return Err(Failure::request(BadVariable::Block { text: text.to_owned() }));
            }
            Ok(name @ VariableName::Block { .. }) => name,
            Err(error @ BadVariable::Block { .. }) => return Err(Failure::request(error)),
            _ => {
                let source = Source::parse(text, layout).map_err(Failure::request)?;
                let column = Column::new(&source, scales);
                let [register] = source.registers[..] else {
                    return Err(Failure::Request(format!("{text}: the board has no register for it")));
                };
                return Ok(Self { name: register.into(), column, longs_before: 0 });
            }
        };
        let (reading, longs_before) = match name {
            VariableName::Block { word: Some(word), .. } => {
                let reading = if unsigned { Reading::Unsigned } else { Reading::Signed };
                // The Y half stands first.
                (reading, usize::from(word == Space::X))
            }
            _ => (Reading::Fixed, 0),
        };
        let sign = if unsigned { ",u" } else { "" };
        let column = Column {
            name: format!("{name}{sign}"),
            register: name.to_string(),
            reading,
            factor: 1.0,
            unit: "",
        };
        Ok(Self { name, column, longs_before })
    }

    pub const fn name(&self) -> VariableName {
        self.name
    }

    /// Its value in `table`; NaN if there is none.
    fn number(&self, table: Option<&VariableTable>) -> f64 {
        let longs = table.and_then(|table| table.value_of(self.name)).map_or(&[][..], Entry::value);
        let longs = longs.get(self.longs_before..).unwrap_or(&[]);
        self.column.reading.read(longs).map_or(f64::NAN, |number| number * self.column.factor)
    }

    /// Its value in `table` as text; `None` if there is none yet.
    pub fn text(&self, table: &VariableTable) -> Option<String> {
        table.value_of(self.name)?;
        Some(shown(&self.column, self.number(Some(table))))
    }
}

/// The registers that PMAC copies for this watch.
struct Copies {
    held: VariableWatch,
    names: Vec<VariableName>,
    /// The time of the last values, or of the watch's begin, by the clock of the segment; and how long values may take,
    /// at first and after another client's watch has changed the table.
    since_ns: u64,
    limit_ns: u64,
    /// The number of the last seen table.
    after: u64,
    complete: bool,
    fresh: bool,
}

impl Copies {
    /// Has PMAC copy the registers among `wanted`; `None` if there are none.
    fn begin(board: &mut Board, wanted: &[WatchedName]) -> Result<Option<Self>, Failure> {
        let name = |wanted: &WatchedName| match wanted {
            WatchedName::Copied(copied) => Some(copied.name),
            WatchedName::Asked(_) => None,
        };
        let names: Vec<VariableName> = wanted.iter().filter_map(name).collect();
        if names.is_empty() {
            return Ok(None);
        }
        let held = board.watch_variables(&names)?;
        // The board has the table now. Copies must arrive within the region's limit, by the clock of the segment.
        let since_ns = board.subscriber().now_ns();
        let region = board.subscriber().region(RegionId::Variable).map_err(Failure::request)?;
        let limit_ns = u64::from(FIRST) * region.stale_after_ns;
        Ok(Some(Self { held, names, since_ns, limit_ns, after: 0, complete: false, fresh: false }))
    }

    /// The next table that has all values; `None` if none has come in time.
    fn next(&mut self, board: &mut Board, time: Duration) -> Result<Option<View<VariableTable>>, Failure> {
        board.wait_variables(self.after, time)?;
        self.held.check()?;
        let found = board.variables()?;
        let is_new = |view: &View<VariableTable>| {
            let has_all = || self.names.iter().all(|&name| view.data.value_of(name).is_some());
            view.is_fresh()
                && view.sequence > self.after
                && view.data.has_come_to(self.held.table())
                && has_all()
        };
        if let Some(view) = found.as_ref().filter(|view| is_new(view)) {
            (self.after, self.since_ns) = (view.sequence, board.subscriber().now_ns());
            (self.complete, self.fresh) = (true, true);
            return Ok(found);
        }
        let is_late = board.subscriber().now_ns().saturating_sub(self.since_ns) > self.limit_ns;
        if !self.complete && is_late {
            return Err(Failure::Refused(
                "PMAC copies nothing; check that the board runs and I55=1".to_owned(),
            ));
        }
        if let Some(stale) = found.as_ref().and_then(|view| view.stale).filter(|_| self.fresh && is_late) {
            self.fresh = false;
            note(format_args!("STALE: {stale}; check that the board runs and I55=1"));
        }
        self.after = found.map_or(self.after, |view| view.sequence);
        Ok(None)
    }
}

/// The variables that pmacctl asks for by command line.
struct Questions {
    connection: Connection,
    names: Vec<String>,
}

impl Questions {
    /// For the variables among `wanted`; `None` if there are none.
    fn begin(context: &Context, wanted: &[WatchedName]) -> Result<Option<Self>, Failure> {
        let name = |wanted: &WatchedName| match wanted {
            WatchedName::Asked(name) => Some(name.clone()),
            WatchedName::Copied(_) => None,
        };
        let names: Vec<String> = wanted.iter().filter_map(name).collect();
        if names.is_empty() {
            return Ok(None);
        }
        Ok(Some(Self { connection: context.connection()?, names }))
    }

    fn ask(&mut self) -> Result<Vec<String>, Failure> {
        Ok(self.connection.ask_variables(&self.names, deadlines::PLAIN)?)
    }
}

/// Prints one set of values as a line of text or of JSON.
fn print(
    context: &mut Context,
    table: Option<&View<VariableTable>>,
    wanted: &[WatchedName],
    answers: &[String],
) -> Result<(), Failure> {
    let mut answers = answers.iter();
    // The name, the register or variable, the unit, the value as JSON and as text.
    let values = wanted.iter().map(|wanted| match wanted {
        WatchedName::Asked(name) => {
            let answer = answers.next().map_or("", String::as_str);
            let value = answer.parse().map_or(json!(answer), plain);
            (name.as_str(), name.as_str(), "", value, answer.to_owned())
        }
        WatchedName::Copied(copied) => {
            // JSON has no infinity and no NaN: they become null.
            let number = copied.number(table.map(|view| &view.data));
            let Column { name, register, unit, .. } = &copied.column;
            (name.as_str(), register.as_str(), *unit, plain(number), shown(&copied.column, number))
        }
    });
    if context.output.is_json() {
        let values: Vec<Value> = values
            .map(|(name, register, unit, value, _)| json!({"name": name, "register": register, "value": value, "unit": unit}))
            .collect();
        context.output.json_line(&json!({
            "servo_timer": table.map(|view| view.servo_timer),
            "time_ns": table.map(|view| view.time_ns),
            "values": values,
        }))?;
    } else {
        let servo = table.map(|view| format!("servo={}", view.servo_timer));
        let values = values.map(|(name, _, unit, _, text)| format!("{name}={text}{}", if_raw(unit)));
        let line: Vec<String> = servo.into_iter().chain(values).collect();
        context.output.line(line.join(" "))?;
    }
    Ok(())
}

/// The unit behind a raw number, whose scale is unknown.
fn if_raw(unit: &str) -> String {
    if unit.starts_with("1/") { format!("[{unit}]") } else { String::new() }
}

/// A number as text: a 48-bit float with its own digits, other numbers with those that a product keeps.
fn shown(column: &Column, number: f64) -> String {
    if column.reading == Reading::Float { short(number) } else { digits(number, PRODUCT_DIGITS) }
}

/// A number for JSON and text. Whole numbers have no decimal point.
fn plain(number: f64) -> Value {
    if number.fract() == 0.0 && number.abs() < EXACT { json!(number as i64) } else { json!(number) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_have_no_point() {
        assert_eq!(plain(-5.0).to_string(), "-5");
        assert_eq!(plain(0.5).to_string(), "0.5");
        assert_eq!(plain(f64::NAN).to_string(), "null");
    }

    #[test]
    fn a_number_without_its_scale_says_so() {
        assert_eq!(if_raw("count"), "");
        assert_eq!(if_raw("1/(Ix08*32) count"), "[1/(Ix08*32) count]");
    }
}
