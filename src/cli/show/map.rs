//! `pmacctl board map`: lists the registers and their addresses from the register table.

use clap::Args;

use crate::cli::args::values::family;
use crate::cli::console::{Table, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::map::{DEFAULT_FAMILY, Family, Firmware, Layout, MapRecord};

#[derive(Debug, Args)]
pub struct Map {
    /// The board's family [default: that of pmacd's board, else pmac]. For Turbo boards the list tells each register's
    /// confidence: H a manual or two sources, M one source, L worked out
    #[arg(long, value_name = "FAMILY", value_parser = family)]
    pub family: Option<&'static Family>,
    /// The board's firmware, as VERSION answers [default: that of pmacd's board; with --family, the printed manual's map]
    #[arg(long, value_name = "VERSION")]
    pub firmware: Option<Firmware>,
}

pub fn run(context: &mut Context, options: &Map) -> Result<Verdict, Failure> {
    let told = if options.family.is_none() { context.board_family()? } else { None };
    let board = told.as_ref().and_then(|(_, info)| info.firmware.as_ref()?.parse().ok());
    let (family, firmware) = match (options.family, &told) {
        (Some(family), _) => (family, options.firmware),
        (None, Some((family, info))) => {
            let firmware = options.firmware.or(board);
            let version = firmware.map_or_else(String::new, |firmware| format!(", firmware {firmware}"));
            note(format_args!("the map of {}: {}{version}", info.name, family.title));
            (*family, firmware)
        }
        (None, None) => (DEFAULT_FAMILY, options.firmware),
    };
    let records = Layout::new(family, firmware).records();
    context.output.show(&records, || table(&records))?;
    Ok(Verdict::Yes)
}

fn table(records: &[MapRecord]) -> Table {
    let mut table = Table::new("offset|address|>bytes|space|format|>number|function|register|confidence");
    for record in records {
        table.row([
            format!("0x{:04X}", record.host_offset),
            record.pmac_address.clone(),
            record.length.to_string(),
            record.space.to_owned(),
            record.format.to_owned(),
            record.number.map_or_else(String::new, |number| number.to_string()),
            record.function.to_owned(),
            record.register.to_owned(),
            record.confidence.unwrap_or_default().to_owned(),
        ]);
    }
    // Confidence exists only for a family whose registers are not all in its own DPRAM manual.
    if records.iter().all(|record| record.confidence.is_none()) {
        table.drop_column("confidence");
    }
    table
}
