//! `pmacctl variable`: PMAC copies or writes registers that the user names, in its background (I55=1).

use std::io::{self, Write};
use std::time::{Duration, Instant};

use clap::{Args as ClapArgs, Subcommand};
use serde_json::{Map, Value, json};

use crate::cli::args::values::{rate, seconds};
use crate::cli::console::table::{Align, Table};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::layout::board_layout;
use crate::client::number::{digits, short};
use crate::client::{Variable as Entry, VariableTable, View};
use crate::decode::Scales;
use crate::format::{fixed48, float48, int24};
use crate::function::variable_write::WriteRecord;
use crate::gather::{Column, Reading, Source};
use crate::map::number;
use crate::map::{BadVariable, Layout, PmacAddress, Space, VariableKind, VariableName};
use crate::protocol::board::VariableRecord;
use crate::segment::RegionId;

/// Longest sleep between two checks that the daemon still holds the watch.
const NO_NEWS: Duration = Duration::from_millis(500);
/// How many stale limits PMAC may take for the first values.
const FIRST: u32 = 5;
/// The largest number of registers in one call.
const MOST: usize = 1024;
/// The digits that a product of two 64-bit floats keeps for certain.
const PRODUCT_DIGITS: usize = 15;
/// The largest integer an f64 holds with all integers below it.
const EXACT: f64 = 9_007_199_254_740_992.0;

#[derive(Debug, ClapArgs)]
pub struct Variable {
    #[command(subcommand)]
    command: VariableCommand,
}

#[derive(Debug, Subcommand)]
enum VariableCommand {
    /// Have PMAC copy registers, and print their values as they arrive
    Watch(Watch),
    /// List the registers that PMAC copies now
    List,
    /// Have PMAC write registers in this order, and wait until it is done
    Set(Set),
}

#[derive(Debug, ClapArgs)]
struct Watch {
    /// Y:$0003, X:$0028, D:$002B, L:$1005, or a name such as 1.actual_position; a 24-bit word is signed unless ,u follows.
    /// PLCC:7 is function block 7 of the compiled PLCs, PLCC:X:7 and PLCC:Y:7 are its words (firmware 1.16)
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

#[derive(Debug, ClapArgs)]
struct Set {
    /// Y:$0700=5, Y:$0700,8,4=5 (4 bits from bit 8, as in M-variable definitions), D:$0728=-1000, L:$1005=2.5, PLCC:X:7=5 (a
    /// word of function block 7)
    #[arg(required = true, value_name = "REGISTER[,OFFSET[,WIDTH]]=VALUE")]
    values: Vec<String>,
    /// How long PMAC may take, in seconds
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds, allow_negative_numbers = true)]
    timeout: Duration,
}

pub fn run(context: &mut Context, options: &Variable) -> Result<Verdict, Failure> {
    match &options.command {
        VariableCommand::Watch(options) => watch(context, options),
        VariableCommand::List => list(context),
        VariableCommand::Set(options) => set(context, options),
    }
}

fn watch(context: &mut Context, options: &Watch) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let (layout, scales, _) = board_layout(&mut board)?;
    let wanted: Vec<Wanted> = options
        .registers
        .iter()
        .map(|text| Wanted::parse(text, &layout, &scales))
        .collect::<Result<_, _>>()?;
    let names: Vec<VariableName> = wanted.iter().map(|wanted| wanted.name).collect();
    let mut held = board.watch_variables(&names)?;
    // The board has the table now. Copies must arrive within the region's limit, by the clock of the segment.
    let (began, began_ns) = (Instant::now(), board.subscriber().now_ns());
    let region = board.subscriber().region(RegionId::Variable).map_err(Failure::request)?;
    let first_limit_ns = u64::from(FIRST) * region.stale_after_ns;
    let end = options.seconds.and_then(|seconds| began.checked_add(seconds));
    let left = || end.map_or(NO_NEWS, |end| end.saturating_duration_since(Instant::now()));
    let (mut printed, mut after, mut complete, mut fresh) = (0, 0, false, false);
    while options.count.is_none_or(|count| printed < count) && !left().is_zero() {
        let round = Instant::now();
        board.wait_variables(after, left().min(NO_NEWS))?;
        held.check()?;
        let found = board.variables()?;
        let is_new = |view: &&View<VariableTable>| {
            view.is_fresh() && view.sequence > after && view.data.has_come_to(held.table())
        };
        let values = found.as_ref().filter(is_new);
        let values =
            values.map(|view| (view, names.iter().map(|&name| view.data.value_of(name)).collect::<Vec<_>>()));
        match values {
            Some((view, values)) if values.iter().all(Option::is_some) => {
                after = view.sequence;
                (complete, fresh) = (true, true);
                let longs = values.iter().map(|value| value.map_or(&[][..], Entry::value));
                print(context, view, wanted.iter().zip(longs))?;
                context.output.flush()?;
                printed += 1;
            }
            _ if !complete && board.subscriber().now_ns().saturating_sub(began_ns) > first_limit_ns => {
                return Err(Failure::Refused(
                    "PMAC copies nothing; check that the board runs and I55=1".to_owned(),
                ));
            }
            _ => {
                if let Some(stale) = found.as_ref().and_then(|view| view.stale).filter(|_| fresh) {
                    fresh = false;
                    // Nobody reads it: nothing to be done.
                    let _ = writeln!(io::stderr(), "STALE: {stale}; check that the board runs and I55=1");
                }
                after = found.map_or(after, |view| view.sequence);
            }
        }
        if options.count.is_none_or(|count| printed < count) {
            std::thread::sleep(options.rate.saturating_sub(round.elapsed()).min(left()));
        }
    }
    Ok(fresh.into())
}

/// What a user wants to see.
struct Wanted {
    name: VariableName,
    column: Column,
    /// How many of its longs belong to another word.
    longs_before: usize,
}

impl Wanted {
    fn parse(text: &str, layout: &Layout, scales: &Scales) -> Result<Self, Failure> {
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
                return Ok(Self { name: source.register.into(), column, longs_before: 0 });
            }
        };
        let (reading, longs_before) = match name {
            VariableName::Block { word: Some(word), .. } => {
                let reading = if unsigned { Reading::Unsigned } else { Reading::Signed };
                // The Y half comes first.
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
}

/// Prints one set of values as a line of text or of JSON.
fn print<'a>(
    context: &mut Context,
    view: &View<VariableTable>,
    values: impl Iterator<Item = (&'a Wanted, &'a [u32])>,
) -> Result<(), Failure> {
    let values = values.map(|(Wanted { column, longs_before, .. }, longs)| {
        let longs = longs.get(*longs_before..).unwrap_or(&[]);
        // JSON has no infinity and no NaN: they become null.
        let number = column.reading.read(longs).map_or(f64::NAN, |number| number * column.factor);
        (column, number)
    });
    if context.output.is_json() {
        let values: Vec<Value> = values
            .map(|(column, number)| {
                let (name, register) = (&column.name, &column.register);
                json!({"name": name, "register": register, "value": plain(number), "unit": column.unit})
            })
            .collect();
        context.output.json_line(&json!({
            "servo_timer": view.servo_timer,
            "time_ns": view.time_ns,
            "values": values,
        }))?;
    } else {
        let values: String =
            values.map(|(column, number)| format!(" {}={}", column.name, shown(column, number))).collect();
        context.output.line(format_args!("servo={}{values}", view.servo_timer))?;
    }
    Ok(())
}

/// A number as text: a 48-bit float with the digits that it has, others with those that a product keeps.
fn shown(column: &Column, number: f64) -> String {
    if column.reading == Reading::Float { short(number) } else { digits(number, PRODUCT_DIGITS) }
}

/// A number for JSON and text. Whole numbers have no decimal point.
fn plain(number: f64) -> Value {
    if number.fract() == 0.0 && number.abs() < EXACT { json!(number as i64) } else { json!(number) }
}

fn list(context: &mut Context) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let found = board.variables()?;
    let live = found.as_ref().filter(|view| view.is_fresh());
    let entries = live.map_or(&[][..], |view| &view.data.variables[..]);
    if context.output.is_json() {
        let entries: Vec<Value> = entries.iter().map(document).collect();
        let (timer, time_ns) = live.map(|view| (view.servo_timer, view.time_ns)).unzip();
        context.output.json(&json!({ "servo_timer": timer, "time_ns": time_ns, "entries": entries }))?;
    } else if entries.is_empty() {
        context.output.line("no register is watched")?;
    } else {
        let mut table =
            Table::new(&[("register", Align::Left), ("updates", Align::Right), ("value", Align::Right)]);
        for entry in entries {
            let value = match (entry.updates, entry.kind) {
                (0, _) => "-".to_owned(),
                (_, VariableKind::Y | VariableKind::X) => int24::signed(entry.longs[0]).to_string(),
                _ => format!("{} (L: {})", fixed(entry), short(float(entry))),
            };
            table.row([name(entry), entry.updates.to_string(), value]);
        }
        context.output.text(table)?;
    }
    Ok(Verdict::Yes)
}

fn name(entry: &Entry) -> String {
    let space = match entry.kind {
        VariableKind::Y => Space::Y,
        VariableKind::X => Space::X,
        VariableKind::Long => Space::D,
        VariableKind::Special => return format!("PLCC:{}", entry.address),
    };
    PmacAddress::new(space, entry.address).to_string()
}

fn fixed(entry: &Entry) -> i64 {
    fixed48::decode(entry.longs[0], entry.longs[1])
}

fn float(entry: &Entry) -> f64 {
    float48::decode(entry.longs[0], entry.longs[1])
}

fn document(entry: &Entry) -> Value {
    let mut document = Map::from_iter([
        ("register".to_owned(), json!(name(entry))),
        ("updates".to_owned(), json!(entry.updates)),
    ]);
    match entry.kind {
        _ if entry.updates == 0 => {}
        VariableKind::Y | VariableKind::X => {
            document.insert("value".to_owned(), json!(int24::signed(entry.longs[0])));
        }
        VariableKind::Long | VariableKind::Special => {
            document.insert("fixed".to_owned(), json!(fixed(entry)));
            document.insert("float".to_owned(), json!(float(entry)));
        }
    }
    document.into()
}

fn set(context: &mut Context, options: &Set) -> Result<Verdict, Failure> {
    // Parse every argument before sending any, and send all in one call: all or none.
    if options.values.len() > MOST {
        return Err(Failure::Request(format!(
            "{} registers are too many; one command writes {MOST} at most",
            options.values.len()
        )));
    }
    let records: Vec<VariableRecord> =
        options.values.iter().map(|text| record(text)).collect::<Result<_, _>>().map_err(Failure::Request)?;
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    for record in &records {
        WriteRecord::of(record, family).map_err(Failure::Request)?;
    }
    connection.write_variables(&records, options.timeout)?;
    Ok(Verdict::Yes)
}

/// Parses an assignment such as `Y:$0700,8,4=5`.
fn record(text: &str) -> Result<VariableRecord, String> {
    let (target, value) =
        text.split_once('=').ok_or_else(|| format!("{text:?}: no value; write Y:$0700,8,4=5"))?;
    let mut parts = target.split(',');
    let register = parts.next().unwrap_or_default();
    let name: VariableName = register.parse().map_err(|error| match error {
        BadVariable::Register(_) => {
            format!("{register:?} is not a register; write Y:$0700, X:$0701, D:$0728 or L:$1005")
        }
        block @ BadVariable::Block { .. } => block.to_string(),
    })?;
    let mut bits = |what: &str| -> Result<Option<u8>, String> {
        let parse = |part: &str| {
            part.trim()
                .parse()
                .map_err(|_| format!("{text:?}: {part:?} is not a valid {what}; write Y:$0700,8,4=5"))
        };
        parts.next().map(parse).transpose()
    };
    let offset = bits("offset")?;
    let width = bits("width")?;
    if let Some(rest) = parts.next() {
        return Err(format!("{text:?}: {rest:?} is not expected here; write Y:$0700,8,4=5"));
    }
    // An offset without a width names one bit, as in M-variable definitions.
    let width = width.or(offset.map(|_| 1));
    let value = value_of(value.trim())
        .ok_or_else(|| format!("{text:?}: {value:?} is not a number; write 5, -5, $FF or, for L:, 2.5"))?;
    Ok(VariableRecord { register: name.to_string(), offset, width, value })
}

fn value_of(text: &str) -> Option<f64> {
    let (negative, digits) = text.strip_prefix('-').map_or((false, text), |digits| (true, digits));
    let value = if digits.starts_with(['$']) || digits.starts_with("0x") || digits.starts_with("0X") {
        // Hex is for words of 24 bits. For 48 bits the order of the halves would be ambiguous.
        f64::from(number::parse(digits).ok()?)
    } else if digits.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        digits.parse().ok()?
    } else {
        return None;
    };
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_as_m_variables_are_defined() {
        let read = |text: &str| record(text).map(|r| (r.register, r.offset, r.width, r.value));
        let made = |register: &str, offset, width, value| Ok((register.to_owned(), offset, width, value));
        assert_eq!(read("Y:$0700,8,4=5"), made("Y:$0700", Some(8), Some(4), 5.0));
        assert_eq!(read("y:$700,8=1"), made("Y:$0700", Some(8), Some(1), 1.0));
        assert_eq!(read("X:$701=$ff"), made("X:$0701", None, None, 255.0));
        assert_eq!(read("X:$701=-$1"), made("X:$0701", None, None, -1.0));
        assert_eq!(read("D:$0728=-1000"), made("D:$0728", None, None, -1000.0));
        assert_eq!(read("L:$1005=2.5e3"), made("L:$1005", None, None, 2500.0));
        for text in [
            "",
            "Y:$0700",
            "Y:$0700=",
            "Y:$0700=x",
            "Y:$0700=inf",
            "Y:$0700=nan",
            "Q:$0700=1",
            "DP:$0700=1",
            "Y:$0700,8,4,2=1",
            "Y:$0700,-1=1",
            "Y:$0700,8,x=1",
            "Y:$80000=1",
            "Y:$0700=--1",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn whole_numbers_have_no_point() {
        assert_eq!(plain(-5.0).to_string(), "-5");
        assert_eq!(plain(0.5).to_string(), "0.5");
        assert_eq!(plain(f64::NAN).to_string(), "null");
    }
}
