//! `pmacctl read`: words of the DPRAM, through the daemon.

use serde::Serialize;

use super::args::Read;
use super::table::{Align, Table};
use super::{Context, Failure, Verdict};
use crate::decode::{Value, value};
use crate::map::{Family, Location};

/// One address read.
#[derive(Debug, Serialize)]
struct Found {
    /// As it was typed.
    address: String,
    pmac_address: String,
    host_offset: u32,
    /// CLOCK_MONOTONIC of the first read.
    time_ns: u64,
    /// The 16-bit words, ascending.
    words: Vec<u16>,
    value: Option<Value>,
}

pub fn run(context: &mut Context, options: &Read) -> Result<Verdict, Failure> {
    // A wrong address is found before anything is asked, as far as the family is known without asking.
    if let Some(family) = options.family {
        locations(options, family)?;
    }
    let mut connection = context.connection()?;
    let family = match options.family {
        Some(family) => family,
        None => Family::by_name(&connection.info()?.family)
            .map_err(|error| Failure::Request(format!("{error}; say --family")))?,
    };
    let mut found = Vec::new();
    for (address, location) in options.addresses.iter().zip(locations(options, family)?) {
        let (time_ns, words) = connection.read(location.offset, location.space.words())?;
        found.push(Found {
            address: address.clone(),
            pmac_address: location.pmac_address(family).to_string(),
            host_offset: location.offset.bytes(),
            time_ns,
            value: value(location.space, &words, options.float48.into()),
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

fn locations(options: &Read, family: &Family) -> Result<Vec<Location>, Failure> {
    options.addresses.iter().map(|text| Location::parse(text, family).map_err(Failure::request)).collect()
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
            found.pmac_address.clone(),
            format!("0x{:04X}", found.host_offset),
            found.words.iter().map(|word| format!("{word:04X}")).collect::<Vec<_>>().join(" "),
            found.value.map_or_else(String::new, |value| value.to_string()),
        ]);
    }
    table
}
