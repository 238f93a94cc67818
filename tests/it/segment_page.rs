//! `docs/segment.md`, held to the code: every number of its tables, and its example, `examples/position.py`.

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

use pmac_dpram::map::user_word::UserWord;
use pmac_dpram::map::{BitField, HostOffset, PMAC, Region, Space, TURBO2, TypedAddress, VariableKind};
use pmac_dpram::segment::payload::gather::{GatherChunk, GatherPhase};
use pmac_dpram::segment::payload::user;
use pmac_dpram::segment::payload::variable::{self, Variable};
use pmac_dpram::segment::{Counter, Identity, RegionId, UserUnit, identity, layout};
use serde_json::Value;

use crate::support::rig::{Rig, pmacctl};

fn file(name: &str) -> String {
    fs::read_to_string(format!("{}/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn page() -> String {
    file("docs/segment.md")
}

/// The rows of the tables of a section, cell by cell, without heads.
fn rows(section: &str) -> Vec<Vec<String>> {
    let page = page();
    let from =
        page.split_once(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("no section {section}")).1;
    let text = from.split("\n## ").next().unwrap();
    let cells = |line: &str| line.trim_matches('|').split(" | ").map(|cell| cell.trim().to_owned()).collect();
    let lines: Vec<&str> = text.lines().collect();
    let is_head = |index: usize| lines.get(index + 1).is_some_and(|next| next.starts_with("|---"));
    let is_row = |index: usize| lines[index].starts_with('|') && !lines[index].starts_with("|---");
    (0..lines.len())
        .filter(|&index| is_row(index) && !is_head(index))
        .map(|index| cells(lines[index]))
        .collect()
}

/// The first word in backticks.
fn name(cell: &str) -> Option<String> {
    cell.split('`').nth(1).map(str::to_owned)
}

fn number(text: &str) -> usize {
    let text = text.split(' ').next().unwrap();
    match text.strip_prefix("0x") {
        Some(digits) => usize::from_str_radix(digits, 16).unwrap(),
        None => text.parse().unwrap(),
    }
}

/// Field and offset of a section's rows whose second or third cell names a field.
fn offsets(section: &str) -> BTreeMap<String, usize> {
    let field = |row: &Vec<String>| name(&row[1]).or_else(|| row.get(2).and_then(|cell| name(cell)));
    rows(section).iter().filter_map(|row| Some((field(row)?, number(&row[0])))).collect()
}

/// The constants of `segment/layout.rs` whose comment begins so, by the field that it names.
fn constants(comment: &str) -> BTreeMap<String, usize> {
    let source = file("src/segment/layout.rs");
    let lines: Vec<&str> = source.lines().collect();
    let pairs = lines.windows(2).filter(|pair| pair[0].starts_with(comment));
    let value = |line: &str| number(line.split(" = ").nth(1).unwrap().trim_end_matches(';'));
    pairs.filter_map(|pair| Some((name(pair[0])?, value(pair[1])))).collect()
}

#[test]
fn every_field_lies_where_the_page_says() {
    for (section, comment, fields) in [
        ("Header", "/// Offset of `", 25),
        ("Region entry", "/// Offset in a region entry of `", 15),
        ("Head and slots", "/// Offset in a slot of `", 5),
    ] {
        let known = constants(comment);
        assert_eq!(known.len(), fields, "{section}: {known:?}");
        let mut shown = offsets(section);
        // The ids of regions stand in a table of their own.
        shown.retain(|field, _| section != "Region entry" || known.contains_key(field));
        assert_eq!(shown, known, "{section}");
    }
}

#[test]
fn the_page_has_every_counter_and_region() {
    let counters: Vec<(usize, String)> =
        rows("Counters").iter().map(|row| (number(&row[0]), name(&row[1]).unwrap())).collect();
    let known: Vec<(usize, String)> =
        Counter::ALL.iter().map(|counter| (*counter as usize, counter.name().to_owned())).collect();
    assert_eq!(counters, known);
    // Each row says what the counter's own comment says.
    let source = file("src/segment/counter.rs");
    for (row, counter) in rows("Counters").iter().zip(Counter::ALL) {
        let comment = format!("/// {}.\n    {counter:?} = {},", row[2], row[0]);
        assert!(source.contains(&comment), "{comment}");
    }
    let regions: Vec<(u64, String)> = rows("Region entry")
        .iter()
        .filter(|row| !row[0].starts_with("0x"))
        .map(|row| (row[0].parse().unwrap(), row[1].clone()))
        .collect();
    let known: Vec<(u64, String)> =
        RegionId::ALL.iter().map(|region| (*region as u64, region.name().to_owned())).collect();
    assert_eq!(regions, known);
}

#[test]
fn the_page_says_the_other_numbers_as_they_are() {
    let page = page();
    for text in [
        format!("`abi_major` | {}. Refuse", layout::ABI_MAJOR),
        format!("`abi_minor` | {}. Accept", layout::ABI_MINOR),
        format!("{:#018X}. It reads", layout::BYTE_ORDER).replace("0X", "0x"),
        format!("the bytes `{}`", String::from_utf8(layout::MAGIC.to_le_bytes().to_vec()).unwrap()),
        format!("at most {} |", layout::MAX_REGIONS),
        format!("at least {} |", layout::REGION_STRIDE),
        format!("{} bytes; ignore", identity::BYTES),
    ] {
        assert!(page.contains(&text), "{text}");
    }
}

/// Of the servo and the background region: what the register map has, of each generation.
#[test]
fn the_registers_are_those_of_the_map() {
    for (section, family) in
        [("Servo and background", &PMAC), ("Servo and background of a Turbo board", &TURBO2)]
    {
        let map: Value = pmacctl(&format!("map --json --family {}", family.name)).json();
        let starts =
            |region: Region, block: HostOffset| [region.start, block].map(|start| start.bytes() as usize);
        let (servo, background) = (&family.servo, &family.background);
        let mut known = Vec::new();
        for (function, [start, blocks]) in [
            ("servo", starts(servo.region, servo.motors.first)),
            ("background", starts(background.region, background.blocks.first)),
        ] {
            for (number, from) in [(Value::Null, start), (1.into(), blocks)] {
                let of_it = |row: &&Value| row["function"] == function && row["number"] == number;
                known.extend(map.as_array().unwrap().iter().filter(of_it).map(|row| {
                    let offset = row["host_offset"].as_u64().unwrap() as usize - from;
                    let text = |name: &str| row[name].as_str().unwrap().to_owned();
                    (offset, text("register"), text("format"))
                }));
            }
        }
        let shown: Vec<(usize, String, String)> = rows(section)
            .iter()
            .map(|row| {
                // `bits0-7` is the name of a format, `-` of none.
                let format = if row[2] == "-" { String::new() } else { row[2].clone() };
                (number(&row[0]), name(&row[1]).unwrap(), format)
            })
            .collect();
        assert_eq!(shown, known, "{section}");
    }
}

#[test]
fn an_identity_lies_as_its_table_says() {
    let mut identity = Identity {
        family: Some(2),
        motors: Some(8),
        coordinate_systems: Some(16),
        servo_period_ps: Some(442_708_000),
        i10: Some(3_713_707),
        servo_report_cycles: Some(3),
        servo_report: Some(4),
        background_report: Some(5),
        motor_mask: Some(0x8000_0001),
        firmware: Some("1.16D".into()),
        board_type: Some("PMAC1".into()),
        replay: true,
        ..Identity::default()
    };
    (identity.ix07[1], identity.ix08[2], identity.ix09[31]) = (Some(-96), Some(97), Some(98));
    identity.ix60[3] = Some(2);
    identity.names[4] = Some("azimuth".into());
    identity.units[5] = Some(UserUnit { name: "deg".into(), counts_per_unit: 12.5 });
    let bytes = identity.encode();
    let at = offsets("Board");
    let u32_at = |at: usize| u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap());
    for (field, value) in [
        ("known", 0x1FFF),
        ("family", 2),
        ("motors", 8),
        ("coordinate_systems", 16),
        ("i10", 3_713_707),
        ("servo_report_cycles", 3),
        ("servo_report", 4),
        ("background_report", 5),
        ("motor_mask", 0x8000_0001),
        ("global_words", 0),
        ("ix07_known", 1 << 1),
        ("ix08_known", 1 << 2),
        ("ix09_known", 1 << 31),
        ("ix60_known", 1 << 3),
    ] {
        assert_eq!(u32_at(at[field]), value, "{field}");
    }
    let period = at["servo_period_ps"];
    assert_eq!(u64::from_ne_bytes(bytes[period..period + 8].try_into().unwrap()), 442_708_000);
    assert_eq!(&bytes[at["firmware"]..][..6], b"1.16D\0");
    assert_eq!(&bytes[at["board_type"]..][..6], b"PMAC1\0");
    assert_eq!(u32_at(at["ix07"] + 4), -96_i32 as u32);
    assert_eq!((u32_at(at["ix08"] + 8), u32_at(at["ix09"] + 31 * 4)), (97, 98));
    assert_eq!(u32_at(at["ix60"] + 3 * 4), 2);
    let scale = at["counts_per_unit"] + 5 * 8;
    assert_eq!(f64::from_ne_bytes(bytes[scale..scale + 8].try_into().unwrap()), 12.5);
    assert_eq!(&bytes[at["names"] + 4 * 16..][..8], b"azimuth\0");
    assert_eq!(&bytes[at["units"] + 5 * 16..][..4], b"deg\0");
    assert_eq!(at.len(), 24, "every field of the table is looked at");

    // Each bit of `known` belongs to the field that the table gives it.
    for row in rows("Board") {
        let Some(bit) = row[3].strip_prefix("bit ") else { continue };
        let field = name(&row[2]).unwrap();
        let only = Identity::default();
        let only = match field.as_str() {
            "family" => Identity { family: Some(1), ..only },
            "motors" => Identity { motors: Some(1), ..only },
            "coordinate_systems" => Identity { coordinate_systems: Some(1), ..only },
            "servo_period_ps" => Identity { servo_period_ps: Some(1), ..only },
            "i10" => Identity { i10: Some(1), ..only },
            "servo_report_cycles" => Identity { servo_report_cycles: Some(1), ..only },
            "servo_report" => Identity { servo_report: Some(1), ..only },
            "background_report" => Identity { background_report: Some(1), ..only },
            "motor_mask" => Identity { motor_mask: Some(1), ..only },
            "global_words" => only,
            "firmware" => Identity { firmware: Some("1".into()), ..only },
            "board_type" => Identity { board_type: Some("1".into()), ..only },
            other => panic!("{other} has a bit"),
        };
        let known = u32::from_ne_bytes(only.encode()[..4].try_into().unwrap());
        // Bit 11 is always set.
        assert_eq!(known, 1 << 11 | 1 << bit.parse::<u32>().unwrap(), "{field}");
    }
}

#[test]
fn variables_and_gathered_samples_lie_as_their_tables_say() {
    let bytes = |words: &[u16]| words.iter().flat_map(|word| word.to_ne_bytes()).collect::<Vec<u8>>();
    let u16_at = |bytes: &[u8], at: usize| u16::from_ne_bytes(bytes[at..at + 2].try_into().unwrap());
    let u32_at =
        |bytes: &[u8], at: usize| u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16;

    let one = Variable { address: 0x5_1234, kind: VariableKind::X, updates: 7, longs: [0x8000_0001, 0] };
    let two = Variable { address: 0x2B, kind: VariableKind::Special, updates: 8, longs: [3, 4] };
    let mut payload = [0; variable::payload_words(2)];
    assert_eq!(variable::encode(9, [one, two].into_iter(), &mut payload), payload.len());
    let (payload, at) = (bytes(&payload), offsets("Variable"));
    assert_eq!((u32_at(&payload, at["table"]), u32_at(&payload, at["entries"])), (9, 2));
    for (entry, address, kind, updates, longs) in
        [(0, 0x1234, 2 | 5 << 8, 7, [0x8000_0001, 0]), (1, 0x2B, 4, 8, [3, 4])]
    {
        let of_entry = |field: &str| at[field] + 16 * entry;
        assert_eq!(
            (u16_at(&payload, of_entry("address")), u16_at(&payload, of_entry("kind"))),
            (address, kind)
        );
        assert_eq!(u32_at(&payload, of_entry("updates")), updates);
        let value = of_entry("value");
        assert_eq!([u32_at(&payload, value), u32_at(&payload, value + 4)], longs);
    }
    assert_eq!(at.len(), 6, "every field of the table is looked at");

    let chunk = GatherChunk {
        gather: 2,
        phase: GatherPhase::Redefined,
        first: 3 << 32 | 4,
        lost: 5 << 32 | 6,
        sample_longs: 2,
        longs: [10, 11, 12, 13],
    };
    let mut payload = [0; 100];
    let words = chunk.encode(&mut payload);
    let (payload, at) = (bytes(&payload[..words]), offsets("Gather"));
    for (field, value) in [("gather", 2), ("phase", 2), ("sample_longs", 2), ("samples", 2)] {
        assert_eq!(u32_at(&payload, at[field]), value, "{field}");
    }
    for (field, low, high) in [("first", 4, 3), ("lost", 6, 5)] {
        assert_eq!((u32_at(&payload, at[field]), u32_at(&payload, at[field] + 4)), (low, high), "{field}");
    }
    assert_eq!(at.len(), 6, "every field of the table is looked at");
    let longs: Vec<u32> = payload[32..].chunks_exact(4).map(|long| u32_at(long, 0)).collect();
    assert_eq!(longs, chunk.longs);
    assert_eq!(rows("Gather").last().unwrap()[0], "32");
}

#[test]
fn the_sites_own_words_lie_as_their_tables_say() {
    let word = |name: &str, unit: &str, space, bits, guard| UserWord {
        name: name.into(),
        unit: unit.into(),
        location: TypedAddress { space, offset: HostOffset::new(0x2840) },
        bits,
        signed: bits.is_some(),
        count: 3,
        guard,
    };
    let bits = BitField { offset: 8, width: 4 };
    let words = [
        word("count", "", Space::Dp, None, None),
        word("mode", "deg", Space::X, Some(bits), Some(HostOffset::new(0x283C))),
    ];
    let (bytes, at) = (user::encode_table(&words), offsets("User"));
    let entry = u32::from_ne_bytes(bytes[at["entry"]..][..4].try_into().unwrap()) as usize;
    assert_eq!((bytes[at["names"]], entry, at.len()), (2, 64, 13));
    let field = |name: &str, entries: usize, length: usize| &bytes[at[name] + entries * entry..][..length];
    assert_eq!((field("name", 1, 5), field("unit", 1, 4)), (&b"mode\0"[..], &b"deg\0"[..]));
    assert_eq!(field("host_offset", 1, 4), 0x2840_u32.to_ne_bytes());
    assert_eq!([0, 1].map(|index| field("guard", index, 4)), [u32::MAX, 0x283C].map(u32::to_ne_bytes));
    assert_eq!([0, 1].map(|index| field("place", index, 2)), [8_u16, 20].map(u16::to_ne_bytes));
    assert_eq!(field("count", 1, 2), 3_u16.to_ne_bytes());
    assert_eq!((field("format", 0, 4), field("format", 1, 4)), (&[2, 0, 0, 0][..], &[1, 8, 4, 1][..]));
    let single = ["format", "bit", "width", "signed"].map(|name| at[name] - at["format"]);
    assert_eq!((single, at["whole"]), ([0, 1, 2, 3], 0));
}

/// The example of the page, against a segment whose contents are known.
fn example(rig: &Rig) -> (bool, String) {
    let code = file("examples/position.py");
    let code = code.replace("/dev/shm/pmac0", &format!("/dev/shm/{}", rig.name));
    let ran = Command::new("python3").args(["-c", &code]).output().unwrap();
    let printed = if ran.status.success() { ran.stdout } else { ran.stderr };
    (ran.status.success(), String::from_utf8(printed).unwrap())
}

/// What the longer example says of the servo sample.
fn segment_reader_finds_it_fresh(rig: &Rig) -> bool {
    let program = "import sys; from segment_reader import Segment; segment = Segment(sys.argv[1]); \
                   servo = segment.regions['servo']; print(segment.is_fresh(servo, servo.latest()))";
    let mut python = Command::new("python3");
    python.args(["-c", program]).arg(rig.publisher.path());
    let ran = python.env("PYTHONPATH", concat!(env!("CARGO_MANIFEST_DIR"), "/examples")).output().unwrap();
    let printed = String::from_utf8(ran.stdout).unwrap();
    assert!(["True\n", "False\n"].contains(&printed.as_str()), "{}", String::from_utf8_lossy(&ran.stderr));
    printed == "True\n"
}

#[test]
#[ignore = "needs python3"]
fn with_python_the_example_prints_where_motor_2_is_and_whether_that_is_fresh() {
    let rig = Rig::new().live();
    assert_eq!(example(&rig), (true, "motor 2: -24.0 counts, fresh\n".to_owned()));
    assert!(segment_reader_finds_it_fresh(&rig));
    let old = (true, "motor 2: -24.0 counts, old\n".to_owned());
    let now_ns = pmac_dpram::segment::monotonic_ns();
    rig.publisher.beat(now_ns + 60_000_000_000);
    assert_eq!(example(&rig), old, "a heartbeat by another clock");
    assert!(!segment_reader_finds_it_fresh(&rig));
    rig.publisher.beat(now_ns);
    rig.publisher.set_region_state(RegionId::Servo, pmac_dpram::segment::RegionState::Stale);
    assert_eq!(example(&rig), old);
}
