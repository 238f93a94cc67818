//! The register map against the record list and against every cell the DPRAM manual prints.

use pmac_dpram::map::{
    Entry, FAMILIES, Family, Generation, HostOffset, Layout, PMAC, PmacAddress, SourceAt, Space, records,
};
use serde_json::Value;

/// A cell's first and last number. `0x0048-0x004E`, `0x0028,A`, `$D08E-92` and a single number are all printed.
fn range(cell: &str) -> (u32, u32) {
    let mut parts = cell.split(['-', ',', ' ']).map(|part| {
        let bare = part.trim_start_matches("0x").trim_start_matches('$');
        (bare.len(), u32::from_str_radix(bare, 16).unwrap_or_else(|_| panic!("cell {cell:?}")))
    });
    let (_, first) = parts.next().unwrap();
    let last = parts.next().map_or(first, |(digits, tail)| {
        // A short second number replaces the last digits of the first.
        let kept = 16u32.pow(digits as u32);
        first / kept * kept + tail
    });
    assert!(parts.next().is_none(), "cell {cell:?}");
    (first, last)
}

/// A cell's space, where one is printed (with or without its colon), and the rest.
fn split_space(cell: &str) -> (Option<Space>, &str) {
    for (letter, space) in [('X', Space::X), ('Y', Space::Y)] {
        if let Some(rest) = cell.strip_prefix(letter) {
            return (Some(space), rest.trim_start_matches(':'));
        }
    }
    (None, cell)
}

fn check_pmac_cell(entry: &Entry, cell: &str) {
    let (space, numbers) = split_space(cell);
    let (first, last) = range(numbers);
    assert_eq!(first, PMAC.pmac_number(entry.offset), "{entry:?} {cell}");
    assert_eq!(last, PMAC.pmac_number(last_word(entry)), "{entry:?} {cell}");
    let half = if entry.register.length == 2 { Some(PMAC.half(entry.offset)) } else { None };
    assert_eq!(space, half, "{entry:?} {cell}");
}

fn check_host_cell(entry: &Entry, cell: &str) {
    let (first, last) = range(cell);
    assert_eq!(first, entry.offset.bytes(), "{entry:?} {cell}");
    assert_eq!(last, last_word(entry).bytes(), "{entry:?} {cell}");
}

fn check_source_cell(address: PmacAddress, cell: &str) {
    let (space, numbers) = split_space(cell);
    let numbers = numbers.trim_start_matches(['D', 'L']).trim_start_matches(':');
    let (first, last) = range(numbers);
    assert_eq!((first, last), (address.number, address.number), "{cell}");
    // The manual prints a 48-bit source without a space.
    let half = matches!(address.space, Space::X | Space::Y).then_some(address.space);
    assert_eq!(space, half, "{cell}");
}

fn last_word(entry: &Entry) -> HostOffset {
    entry.offset.plus_words((entry.register.length as usize / 2).max(1) - 1)
}

#[test]
fn every_cell_of_the_numbered_tables_is_in_the_map() {
    let layout = Layout::new(&PMAC, None);
    let table = include_str!("../data/manual_tables.tsv");
    let (mut cells, mut without_source) = (0, Vec::new());
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let columns: Vec<_> = line.split('\t').collect();
        let [function, register, row] = columns[..3] else { panic!("{line}") };
        assert_eq!(columns.len(), 3 + 8, "{line}");
        for (number, cell) in (1..).zip(&columns[3..]) {
            let entry = layout.find(function, register, Some(number)).unwrap_or_else(|| panic!("{line}"));
            match (row, entry.source(&PMAC)) {
                ("host", _) => check_host_cell(&entry, cell),
                ("pmac", source) => {
                    check_pmac_cell(&entry, cell);
                    if source == SourceAt::None && number == 1 {
                        without_source.push(register.to_owned());
                    }
                }
                ("source", SourceAt::One(address)) => check_source_cell(address, cell),
                ("source_a", SourceAt::Choice([a, _, _])) => check_source_cell(a, cell),
                ("source_b", SourceAt::Choice([_, b, _])) => check_source_cell(b, cell),
                ("source_c", SourceAt::Choice([_, _, c])) => check_source_cell(c, cell),
                (row, source) => panic!("{function} {register} {row}: the map has {source:?}"),
            }
            cells += 1;
        }
    }
    assert_eq!(cells, 848, "31 tables of 8 columns");
    // Exactly the tables printed without a source row.
    let printed_without = [
        "request",
        "feedrate_override",
        "motor_spare",
        "cs_time_left_in_acceleration",
        "cs_program_address_offset",
    ];
    assert_eq!(without_source, printed_without);
}

#[test]
fn every_single_register_is_in_the_map_and_the_misprints_are_known() {
    let layout = Layout::new(&PMAC, None);
    let table = include_str!("../data/manual_registers.tsv");
    let mut misprints = 0;
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let columns: Vec<_> = line.split('\t').collect();
        let [function, register, host, pmac, source, remark] = columns[..] else { panic!("{line}") };
        let entry = layout.find(function, register, None).unwrap_or_else(|| panic!("{line}"));
        check_pmac_cell(&entry, pmac);
        match (source, entry.source(&PMAC)) {
            ("", SourceAt::None) => {}
            (cell, SourceAt::One(address)) => check_source_cell(address, cell),
            (cell, source) => panic!("{line}: {cell:?} but the map has {source:?}"),
        }
        if remark == "misprint" {
            assert_ne!(range(host).0, entry.offset.bytes(), "{line}");
            misprints += 1;
        } else {
            check_host_cell(&entry, host);
        }
    }
    assert_eq!(misprints, 5);
}

/// The record list of boards of `family`.
fn record_list(family: &Family) -> Vec<Value> {
    let file = match family.generation {
        Generation::Pmac => include_str!("../data/registers.json"),
        Generation::Turbo => include_str!("../data/registers_turbo.json"),
    };
    let file: Value = serde_json::from_str(file).unwrap();
    file["records"].as_array().unwrap().clone()
}

#[test]
fn the_map_is_the_record_list_record_by_record() {
    for family in FAMILIES {
        let expected = record_list(family);
        let (records_there_are, keys) = match family.generation {
            Generation::Pmac => (289, 8),
            // And how sure each is.
            Generation::Turbo => (722, 9),
        };
        assert_eq!(expected.len(), records_there_are);
        let ours = serde_json::to_value(records(family, None)).unwrap();
        let ours = ours.as_array().unwrap();
        assert_eq!(ours.len(), expected.len());
        for (ours, expected) in ours.iter().zip(&expected) {
            let record = ours.as_object().unwrap();
            assert_eq!(record.len(), keys);
            for (key, value) in record {
                assert_eq!(value, &expected[key], "{key} of {expected}");
            }
        }
    }
}

#[test]
fn sources_agree_with_the_record_list() {
    for family in FAMILIES {
        let mut only_ours = Vec::new();
        for (entry, expected) in Layout::new(family, None).entries().zip(record_list(family)) {
            assert!(!entry.register.title.is_empty(), "{expected}");
            let cell = |key: &str| expected["source"][key].as_str();
            match entry.source(family) {
                SourceAt::None => assert_eq!(expected["source"], serde_json::json!({}), "{expected}"),
                SourceAt::One(address) => match cell("source") {
                    Some(cell) => check_source_cell(address, cell),
                    None => only_ours.push((entry.register.function, entry.register.name)),
                },
                SourceAt::Choice(addresses) => {
                    for (address, key) in addresses.into_iter().zip(["source_A", "source_B", "source_C"]) {
                        check_source_cell(address, cell(key).unwrap());
                    }
                }
            }
        }
        // The manual gives this one in its text (p. 22).
        let known: &[_] = match family.generation {
            Generation::Pmac => &[("variable_read", "servo_timer")],
            Generation::Turbo => &[],
        };
        assert_eq!(only_ours, known, "{}", family.name);
    }
}
