//! Both reports against the register table, record by record.

use serde_json::Value;

use crate::map::HostOffset;
use crate::sim::functions::background_report::BackgroundReport;
use crate::sim::testing::Bench;

const TABLE: &str = include_str!("../../tests/data/registers.json");

/// `$002B` is a whole register, `X:$003A` and `Y:$0817` are halves.
fn source(text: &str) -> (Option<char>, u32) {
    let (half, address) = match text.split_once(':') {
        Some((half, address)) => (half.chars().next(), address),
        None => (None, text),
    };
    (half, u32::from_str_radix(address.trim_start_matches('$'), 16).unwrap())
}

#[test]
fn every_register_of_both_reports_is_copied_to_its_place() {
    let mut bench = Bench::started();
    let table: Value = serde_json::from_str(TABLE).unwrap();
    let records: Vec<&Value> = table["records"].as_array().unwrap().iter().collect();
    let board = &mut bench.world.board;
    // A value of its own for every word that a report can copy; no servo cycle runs, so nothing changes them.
    for address in (0..0x1000).chain(0xFFC0..0xFFC3) {
        board.memory.write_x(address, 0x80_0001 + 2 * address);
        board.memory.write_y(address, 0x40_0000 + address);
    }
    // PSTATUS chooses source C.
    for cs in 0..8 {
        board.memory.write(board.memory.registers().program_status.of(cs), 0);
    }
    board.memory.dpram.write16(HostOffset::new(0x0228), 0);
    bench.world.report.cycle(board);
    assert!(BackgroundReport::new(board.family()).poll(board, &[], &mut bench.world.report));
    let mut checked = 0;
    for record in records {
        let function = record["function"].as_str().unwrap();
        if !["servo", "background"].contains(&function) || record["space"] == "Y" || record["space"] == "X" {
            continue;
        }
        let name = format!("{function} {} {}", record["register"], record["number"]);
        let from = record["source"].get("source").or(record["source"].get("source_C"));
        let Some(from) = from.and_then(Value::as_str) else { continue };
        let (half, address) = source(from);
        let offset = record["host_offset"].as_u64().unwrap() as u32;
        let words = match half {
            Some('X') => vec![bench.world.board.memory.read_x(address)],
            Some(_) => vec![bench.world.board.memory.read_y(address)],
            None => {
                vec![bench.world.board.memory.read_y(address), bench.world.board.memory.read_x(address)]
            }
        };
        assert_eq!(record["length"].as_u64().unwrap(), 4 * words.len() as u64, "{name}");
        for (index, word) in words.into_iter().enumerate() {
            let expected = ((word << 8) as i32 >> 8) as u32;
            assert_eq!(bench.read32(offset + 4 * index as u32), expected, "{name}");
        }
        checked += 1;
    }
    // 9 registers and 2 globals of the servo report; 3 ports and per motor 4 + 9 axes + 4 of the background report.
    assert_eq!(checked, 8 * 9 + 2 + 3 + 8 * 17);
}
