//! `pmacctl read`: reads words of the DPRAM through the daemon.

use clap::Args;
use serde::Serialize;

use crate::cli::args::values::{Float48, family};
use crate::cli::console::Table;
use crate::cli::context::{Context, Failure, GIVE_FAMILY, Verdict};
use crate::client::Connection;
use crate::client::number::{float32, short};
use crate::decode::{self, Value, value};
use crate::map::{BitField, Family, Field, Space, TURBO2, TypedAddress};
use crate::protocol::function::NO_FAMILY;

#[derive(Debug, Args)]
pub struct Read {
    /// Y:$D001, X:$D009, DP:$D200, D:$D014, L:$D09A, F:$D210, a host offset 0x0024, or bits as Y:$D001,8,4
    #[arg(required = true, value_name = "ADDR")]
    pub addresses: Vec<String>,
    /// The board's family [default: as the daemon reports]
    #[arg(long, value_name = "FAMILY", value_parser = family)]
    pub family: Option<&'static Family>,
    /// The layout of L: values
    #[arg(long, value_name = "LAYOUT", default_value = "register")]
    pub float48: Float48,
}

/// The result of one address.
#[derive(Debug, Serialize)]
struct WordsRead {
    /// The address, as typed.
    address: String,
    /// `None` while the family is unknown.
    pmac_address: Option<String>,
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
    let family = board_family(options, &mut connection)?;
    let mut found = Vec::new();
    // Only the daemon knows where the DPRAM of plain offsets ends.
    let fields = fields(options, family.unwrap_or(&TURBO2))?;
    for (address, Field { location, bits }) in options.addresses.iter().zip(fields) {
        let (time_ns, words) = connection.read(location.offset, location.space.words())?;
        found.push(WordsRead {
            address: address.clone(),
            pmac_address: family.map(|family| location.pmac_address(family).to_string()),
            bits,
            host_offset: location.offset.bytes(),
            time_ns,
            space: location.space,
            value: match bits {
                None => value(location.space, &words, options.float48.into()),
                Some(field) => decode::value::bits(field, false, &words),
            },
            words,
        });
    }
    context.output.show(&found, || table(&found))?;
    Ok(Verdict::Yes)
}

/// The board's family. The program reads host offsets without it, too.
fn board_family(options: &Read, connection: &mut Connection) -> Result<Option<&'static Family>, Failure> {
    if options.family.is_some() || connection.info()?.family != NO_FAMILY {
        return Context::family(options.family, connection).map(Some);
    }
    if options.addresses.iter().all(|text| TypedAddress::is_host_offset(text)) {
        return Ok(None);
    }
    Err(Failure::Request(format!("{GIVE_FAMILY}, or host offsets alone, which need none")))
}

fn fields(options: &Read, family: &Family) -> Result<Vec<Field>, Failure> {
    options.addresses.iter().map(|text| Field::parse(text, family).map_err(Failure::request)).collect()
}

fn table(found: &[WordsRead]) -> Table {
    let mut table = Table::new("address|offset|words|>value");
    for found in found {
        let offset = format!("0x{:04X}", found.host_offset);
        let address = found.pmac_address.as_ref().unwrap_or(&offset);
        table.row([
            match found.bits {
                None => address.clone(),
                Some(bits) => format!("{address},{},{}", bits.offset, bits.width),
            },
            offset,
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
