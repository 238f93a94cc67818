//! `pmacctl variable`: PMAC copies or writes the user's registers in its background (I55=1).

use std::time::Duration;

use clap::{Args as ClapArgs, Subcommand};
use serde_json::{Map, Value, json};

use crate::cli::act::watch_values::{self, Watch};
use crate::cli::args::values::seconds;
use crate::cli::console::Table;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::Variable as Entry;
use crate::client::number::short;
use crate::format::{fixed48, float48, int24};
use crate::function::variable_write::WriteRecord;
use crate::map::number;
use crate::map::{BadVariable, PmacAddress, Space, VariableKind, VariableName};
use crate::protocol::board::VariableRecord;

/// The largest number of registers in one call.
const MOST_REGISTERS: usize = 1024;
#[derive(Debug, ClapArgs)]
pub struct Variable {
    #[command(subcommand)]
    command: VariableCommand,
}

#[derive(Debug, Subcommand)]
enum VariableCommand {
    /// Have the board copy registers and print their values as they arrive. P, Q, M and I variables are asked by command line
    Watch(Watch),
    /// List the registers that the board copies now
    List,
    /// Have the board write registers in this order, and wait until the board has
    Set(Set),
}

#[derive(Debug, ClapArgs)]
struct Set {
    /// Y:$0770=5, Y:$0770,8,4=5 (4 bits from bit 8, as in M-variable definitions), D:$0728=-1000, L:$1005=2.5, PLCC:X:7=5 (a
    /// word of function block 7)
    #[arg(required = true, value_name = "REGISTER[,OFFSET[,WIDTH]]=VALUE")]
    values: Vec<String>,
    /// Time limit of the board, in seconds
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds, allow_negative_numbers = true)]
    timeout: Duration,
}

pub fn run(context: &mut Context, options: &Variable) -> Result<Verdict, Failure> {
    match &options.command {
        VariableCommand::Watch(options) => watch_values::run(context, options),
        VariableCommand::List => list(context),
        VariableCommand::Set(options) => set(context, options),
    }
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
        let mut table = Table::new("register|>updates|>value");
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
    if options.values.len() > MOST_REGISTERS {
        return Err(Failure::Request(format!(
            "{} registers are too many; one command writes {MOST_REGISTERS} at most",
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

/// Parses an assignment such as `Y:$0770,8,4=5`.
fn record(text: &str) -> Result<VariableRecord, String> {
    let (target, value) =
        text.split_once('=').ok_or_else(|| format!("{text:?}: no value; write Y:$0770,8,4=5"))?;
    let mut parts = target.split(',');
    let register = parts.next().unwrap_or_default();
    let name: VariableName = register.parse().map_err(|error| match error {
        BadVariable::Register(_) => {
            format!("{register:?} is not a register; write Y:$0770, X:$0771, D:$0728 or L:$1005")
        }
        block @ BadVariable::Block { .. } => block.to_string(),
    })?;
    let mut bits = |what: &str| -> Result<Option<u8>, String> {
        let parse = |part: &str| {
            part.trim()
                .parse()
                .map_err(|_| format!("{text:?}: {part:?} is not a valid {what}; write Y:$0770,8,4=5"))
        };
        parts.next().map(parse).transpose()
    };
    let offset = bits("offset")?;
    let width = bits("width")?;
    if let Some(rest) = parts.next() {
        return Err(format!("{text:?}: {rest:?} is not expected here; write Y:$0770,8,4=5"));
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
        assert_eq!(read("Y:$0770,8,4=5"), made("Y:$0770", Some(8), Some(4), 5.0));
        assert_eq!(read("y:$770,8=1"), made("Y:$0770", Some(8), Some(1), 1.0));
        assert_eq!(read("X:$771=$ff"), made("X:$0771", None, None, 255.0));
        assert_eq!(read("X:$771=-$1"), made("X:$0771", None, None, -1.0));
        assert_eq!(read("D:$0728=-1000"), made("D:$0728", None, None, -1000.0));
        assert_eq!(read("L:$1005=2.5e3"), made("L:$1005", None, None, 2500.0));
        for text in [
            "",
            "Y:$0770",
            "Y:$0770=",
            "Y:$0770=x",
            "Y:$0770=inf",
            "Y:$0770=nan",
            "Q:$0770=1",
            "DP:$0770=1",
            "Y:$0770,8,4,2=1",
            "Y:$0770,-1=1",
            "Y:$0770,8,x=1",
            "Y:$80000=1",
            "Y:$0770=--1",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }
}
