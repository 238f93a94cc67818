//! `pmacctl read`: reads words of the DPRAM through the daemon.

use clap::Args;
use serde::Serialize;

use crate::cli::args::values::{Float48, family};
use crate::cli::console::table::{Align, Table};
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::number::{float32, short};
use crate::decode::{Value, value};
use crate::format::join32;
use crate::map::{BitField, Family, Field, Space};

#[derive(Debug, Args)]
pub struct Read {
    /// Y:$D001, X:$D009, DP:$D200, D:$D014, L:$D09A, F:$D210, a host offset 0x0024, or bits as Y:$D001,8,4
    #[arg(required = true, value_name = "ADDR")]
    pub addresses: Vec<String>,
    /// The board's family, instead of the one that the daemon reports
    #[arg(long, value_name = "FAMILY", value_parser = family)]
    pub family: Option<&'static Family>,
    /// The layout of L: values
    #[arg(long, value_name = "LAYOUT", default_value = "register")]
    pub float48: Float48,
}

/// The result of one address.
#[derive(Debug, Serialize)]
struct Found {
    /// The address, as typed.
    address: String,
    pmac_address: String,
    host_offset: u32,
    /// The bits of the value, if not all.
    #[serde(skip_serializing_if = "Option::is_none")]
    bits: Option<BitField>,
    /// CLOCK_MONOTONIC time of the first read.
    time_ns: u64,
    #[serde(skip)]
    space: Space,
    /// The 16-bit words, ascending.
    words: Vec<u16>,
    value: Option<Value>,
}

pub fn run(context: &mut Context, options: &Read) -> Result<Verdict, Failure> {
    // Check the addresses before asking the daemon, if the family is known.
    if let Some(family) = options.family {
        fields(options, family)?;
    }
    let mut connection = context.connection()?;
    let family = Context::family(options.family, &mut connection)?;
    let mut found = Vec::new();
    for (address, Field { location, bits }) in options.addresses.iter().zip(fields(options, family)?) {
        let (time_ns, words) = connection.read(location.offset, location.space.words())?;
        found.push(Found {
            address: address.clone(),
            pmac_address: location.pmac_address(family).to_string(),
            bits,
            host_offset: location.offset.bytes(),
            time_ns,
            space: location.space,
            value: match bits {
                None => value(location.space, &words, options.float48.into()),
                Some(bits) => part(bits, &words),
            },
            words,
        });
    }
    if context.output.is_json() {
        context.output.json(&found)?;
    } else {
        context.output.text(table(&found))?;
    }
    Ok(Verdict::Yes)
}

fn fields(options: &Read, family: &Family) -> Result<Vec<Field>, Failure> {
    options.addresses.iter().map(|text| Field::parse(text, family).map_err(Failure::request)).collect()
}

/// The value of a bit field.
fn part(bits: BitField, words: &[u16]) -> Option<Value> {
    let word = match *words {
        [word] => word.into(),
        [low, high] => join32(low, high),
        _ => return None,
    };
    let value = bits.of(word);
    Some(u16::try_from(value).map_or(Value::Fixed(value.into()), Value::Word))
}

fn table(found: &[Found]) -> Table {
    let mut table = Table::new(&[
        ("address", Align::Left),
        ("offset", Align::Left),
        ("words", Align::Left),
        ("value", Align::Right),
    ]);
    for found in found {
        table.row([
            match found.bits {
                None => found.pmac_address.clone(),
                Some(bits) => format!("{},{},{}", found.pmac_address, bits.offset, bits.width),
            },
            format!("0x{:04X}", found.host_offset),
            found.words.iter().map(|word| format!("{word:04X}")).collect::<Vec<_>>().join(" "),
            match found.value {
                Some(Value::Float(value)) if found.space == Space::F => float32(value),
                Some(Value::Float(value)) => short(value),
                Some(Value::Fixed(value)) => value.to_string(),
                Some(Value::Long(value)) => value.to_string(),
                Some(Value::Word(value)) => value.to_string(),
                None => String::new(),
            },
        ]);
    }
    table
}
