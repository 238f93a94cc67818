//! Decoding of hand-built images of a Turbo board's DPRAM. Offsets are those of the Turbo User Manual p. 402-410 and of the
//! vendor's headers, as the record list has them.

use pmac_dpram::decode::{Buffers, Image, Scales};
use pmac_dpram::format::{Float48Layout, WordOrder};
use pmac_dpram::map::{Layout, TURBO, TURBO2};
use serde_json::{Value as Json, json};

use crate::support::Dump;
use crate::support::rig::pmacctl;

const REGISTER: Float48Layout = Float48Layout::Register;
const LENGTH_8K: usize = 0x4000;
const LENGTH_32K: usize = 0x1_0000;

/// Motors 1, 17 and 32 are reported, and coordinate systems 1 and 2; of every other block something is left over.
fn dump(length: usize) -> Dump {
    let mut dump = Dump::new(&TURBO2, length);
    for motor in 0..32 {
        dump.short(0x0080 + 0x30 * motor, 0x7F_FFFF);
    }
    for system in 0..16 {
        dump.short(0x06B0 + 0x80 * system, 0x7F_FFFF);
    }
    dump.word(0x006A, 0x8000).word(0x006C, 0x5678).word(0x006E, 0x8012);
    dump.word(0x0070, 0x0001).word(0x0072, 0x8001);
    for (motor, block) in [(1, 0x0074), (17, 0x0374), (32, 0x0644)] {
        dump.pair(block, -1, -3072 * motor).short(block + 8, -512).short(block + 12, 0x84_2000);
        dump.short(block + 16, 0x10_8400).pair(block + 20, 0, 6144).short(block + 28, -9);
        dump.pair(block + 40, 0, 3072 * motor);
    }
    dump.word(0x0674, 0x0002).word(0x0678, 0xFEDC).word(0x067A, 0x80BA);
    dump.short(0x067C, 0x11_1111).short(0x0680, -1).short(0x0684, 0x33_3333);
    dump.short(0x0688, 0x40_0000).short(0x068C, 0x08_0001);
    // Coordinate system 1 moves by feed rate, coordinate system 2 by time.
    for (block, status) in [(0x069C, 0xA0_0001), (0x071C, 0xA0_0009)] {
        // 10
        dump.pair(block, 0x50_0000, 0x00_0803);
        dump.short(block + 8, 1_856_995).short(block + 12, 0x40_2102).short(block + 16, 0x00_0009);
        dump.short(block + 20, status);
        // -3.25 for V, 1 for Z
        dump.pair(block + 56, 0x98_0000, 0x00_0801).pair(block + 88, 0x40_0000, 0x00_0800);
        dump.short(block + 96, 0x02_0010).short(block + 100, -2).short(block + 104, 9);
        dump.short(block + 108, 11).short(block + 112, -1);
    }
    dump
}

fn scales() -> Scales {
    Scales { motors: Vec::new(), i10: Some(3_713_991) }
}

#[test]
fn decode_shows_the_motors_of_the_mask() {
    let data = dump(LENGTH_32K).image().servo(32, &scales()).unwrap();
    assert_eq!((data.servo_timer, data.pmac_busy, data.host_busy), (0x12_5678, false, true));
    assert_eq!(data.global_status, None);
    let numbers: Vec<_> = data.motors.iter().map(|motor| motor.motor).collect();
    assert_eq!(numbers, [1, 17, 32]);
    let unknown = |raw: i64, unit: &str| json!({"raw": raw, "value": null, "unit": unit});
    let position = "1/(Ix08*32) count";
    assert_eq!(
        serde_json::to_value(data.motors[2]).unwrap(),
        json!({
            "motor": 32,
            "following_error": unknown(-3072 * 32, position),
            "previous_dac": {"raw": -512, "value": -2.0, "unit": "DAC bit"},
            "servo_status": unknown(0x84_2000, "bits"),
            "background_status": unknown(0x10_8400, "bits"),
            "position_bias": unknown(6144, position),
            "filtered_velocity":
                unknown(-9, "1/(Ix09*32) count per servo cycle at the default I60 and I61"),
            "actual_position": unknown(3072 * 32, position),
            "status": ["motor_activated", "open_loop", "desired_velocity_zero"],
        })
    );
}

#[test]
fn decode_shows_the_coordinate_systems_that_are_reported() {
    let data = dump(LENGTH_32K).image().background(16, &scales(), REGISTER).unwrap();
    assert_eq!((data.ready, data.servo_timer), (true, 0xBA_FEDC));
    let ports = json!({"control_panel": 0x11_1111, "machine_io": 0xFF_FFFF, "thumbwheel": 0x33_3333});
    assert_eq!(serde_json::to_value(data.ports).unwrap(), ports);
    let [first, second] = data.global_flags().unwrap();
    assert!(first.has("data_gathering_on") && first.has("this_card_addressed"));
    assert_eq!(second.names().collect::<Vec<_>>(), ["vme_board"]);
    assert_eq!(data.coordinate_systems.len(), 2, "the word at 0x0674 says two");
    assert!(data.motors.is_empty());
    let quantity = |raw: i64, value: f64, unit: &str| json!({"raw": raw, "value": value, "unit": unit});
    let mut expected = json!({
        "coordinate_system": 1,
        "feed_rate": 10.0,
        "move_time_ms": null,
        "time_base": quantity(1_856_995, 1_856_995.0 / 3_713_991.0 * 100.0, "%"),
        "time_base_register": {"raw": 0x00_2102, "value": null, "unit": "PMAC address"},
        "feed_hold": true,
        "lookahead_status_word": 9,
        "lookahead_status": ["radius_error", "in_program_position_match"],
        "status_word": 0xA0_0001,
        "status": ["z_feedrate", "y_feedrate", "running_program"],
        "axis_targets": {
            "A": 0.0, "B": 0.0, "C": 0.0, "U": 0.0, "V": -3.25, "W": 0.0, "X": 0.0, "Y": 0.0, "Z": 1.0
        },
        "program_status_word": 0x02_0010,
        "program_status": ["in_position", "pvt_or_spline_mode"],
        "motion_mode": null,
        "lines_remaining": -2,
        "time_left_in_move": quantity(9, 4.5, "msec"),
        "time_left_in_acceleration": quantity(11, 5.5, "msec"),
        "program_address_offset": 0xFF_FFFF,
    });
    assert_eq!(serde_json::to_value(data.coordinate_systems[0]).unwrap(), expected);
    for (key, value) in [
        ("coordinate_system", json!(2)),
        ("feed_rate", Json::Null),
        ("move_time_ms", json!(10.0)),
        ("status_word", json!(0xA0_0009)),
        ("status", json!(["z_feedrate", "y_feedrate", "move_by_time", "running_program"])),
    ] {
        expected[key] = value;
    }
    assert_eq!(serde_json::to_value(data.coordinate_systems[1]).unwrap(), expected);
}

/// Tables as a driver in production lays them: the read table at $060540, start word $F0.
fn with_buffers(mut dump: Dump) -> Dump {
    dump.word(0x1044, 0x0001).word(0x1046, 0x4321).word(0x1048, 3).word(0x104A, 0x00F0);
    // X:$078000 is $8000 and $0027, with the ready bit of multi-user mode.
    let table = 4 * 0x540;
    dump.word(table, 0x8000).word(table + 2, 0x8020);
    dump.word(table + 4, 0x002B).word(table + 6, 0x0010);
    dump.word(table + 8, 0x0700).word(table + 10, 0x0000);
    dump.short(table + 12, -5).pair(table + 16, 0x40_0000, 0x00_0800).short(table + 24, 7);
    // The header of coordinate system 16.
    dump.word(0x1104, 0xC003).word(0x1106, 16).word(0x1108, 12).word(0x110A, 8);
    dump.word(0x110C, 512).word(0x110E, 0x0400);
    dump.word(0x113C, 300).word(0x113E, 12);
    dump
}

#[test]
fn decode_shows_gathering_tables_and_rotary_buffers() {
    let image = with_buffers(dump(LENGTH_32K)).image();
    let buffers = json!(Buffers::of(&image, &Layout::new(image.family(), None), REGISTER));
    assert_eq!(buffers["gather"], json!({"size_longs": 300, "next_long": 12}));
    assert_eq!(
        buffers["variable_read"],
        json!({"multi_user": false, "ready": true, "servo_timer": 0x4321, "count": 3, "entries": [
            {"kind": "x", "address": "$008000", "ready": true, "value": -5},
            {"kind": "long", "address": "$00002B", "ready": false, "fixed": (0x40_0000_i64 << 24) + 0x800, "float": 1.0},
            {"kind": "y", "address": "$000700", "ready": false, "value": 7},
        ]})
    );
    assert_eq!(buffers["variable_write"], json!(null));
    let rotary = buffers["rotary"].as_array().unwrap();
    assert_eq!(rotary.len(), 16);
    assert_eq!(
        rotary[15],
        json!({
            "buffer": 16, "coordinate_system": 16, "full": true, "error": 3, "host_index": 12, "pmac_index": 8,
            "size_longs": 512, "host_offset": 4 * 0x850,
        })
    );
    assert_eq!(rotary[0]["size_longs"], 0);
}

#[test]
fn tables_that_cannot_be_are_not_shown() {
    let read = |image: &Image| Buffers::of(image, &Layout::new(image.family(), None), REGISTER);
    let mut dump = with_buffers(dump(LENGTH_8K));
    dump.word(0x1048, 129);
    let buffers = read(&dump.image());
    assert_eq!((buffers.variable_read.count, &buffers.variable_read.entries), (129, &None));
    // $060FFF is the last location of 8K x 16: the entry fits, its value does not.
    dump.word(0x1048, 1).word(0x104A, 0x0BAF);
    assert_eq!(read(&dump.image()).variable_read.entries, None);
    dump.word(0x1048, 0);
    assert_eq!(read(&dump.image()).variable_read.entries, Some(Vec::new()));
    // A kind that is none, and one with bits below it, which may belong to the address.
    for kind in [0x0030, 0x0027] {
        let mut dump = with_buffers(self::dump(LENGTH_8K));
        dump.word(4 * 0x540 + 2, kind);
        assert_eq!(read(&dump.image()).variable_read.entries, None);
    }
}

#[test]
fn an_image_may_be_of_either_size() {
    for (length, board) in [(LENGTH_8K, &TURBO), (LENGTH_32K, &TURBO2)] {
        for family in [&TURBO, &TURBO2] {
            let image = Image::from_bytes(&vec![0; length], family, WordOrder::Little).unwrap();
            assert_eq!((image.family().name, image.family().length), (family.name, board.length));
        }
    }
    let error = Image::from_bytes(&[0; 0x8000], &TURBO, WordOrder::Little).unwrap_err().to_string();
    assert_eq!(error, "an image of the DPRAM of a Turbo PMAC has 16384 or 65536 bytes, not 32768");
}

const TEXT: &str = "\
motor    actual  following error  flags
   #1   3072raw         -3072raw  open-loop homed
  #17  52224raw        -52224raw  open-loop homed
  #32  98304raw        -98304raw  open-loop homed

system  mode  lines        PE  left ms  feed  override  targets    flags
    &1  ?        -2  16777215      4.5   F10         -  V-3.25 Z1  radius-error running in-position hold
    &2  ?        -2  16777215      4.5  TM10         -  V-3.25 Z1  radius-error running in-position hold
ports: JPAN $111111  JTHW $333333  JOPTO $FFFFFF
gather: 300 longs, the next item goes to 12
variable read: a table of 3, ready
rotary 16: 512 longs at $060850, host at 12, PMAC at 8, PMAC's own buffer is full, error 3
global status: $080001 $400000: data_gathering_on this_card_addressed vme_board
";

#[test]
fn pmacctl_decodes_a_turbo_image() {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), with_buffers(dump(LENGTH_8K)).bytes()).unwrap();
    let path = file.path().display();
    for family in ["turbo", "turbo2"] {
        let document = pmacctl(&format!("decode {path} --family {family} --json")).json();
        assert_eq!(document["servo"]["servo_timer"], 0x12_5678);
        assert_eq!(document["motors"][1]["motor"], 17);
        assert_eq!(document["motors"][1]["homed"], true);
        let motor = document["motors"][1].as_object().unwrap();
        for absent in ["commanded_position", "target_position", "reported_position", "velocity"] {
            assert!(!motor.contains_key(absent), "{absent}");
        }
        assert_eq!(document["global_status"]["words"], json!(["$080001", "$400000"]));
        assert_eq!(document["coordinate_systems"][1]["move_time_ms"], 10.0);
        assert_eq!(document["buffers"]["gather"]["next_long"], 12);
    }
    let text = pmacctl(&format!("decode {path} --family turbo2")).stdout;
    assert_eq!(text, TEXT);
    assert_eq!(pmacctl(&format!("decode {path}")).code, Some(0), "16 KiB may be a PMAC's");
    std::fs::write(file.path(), vec![0; LENGTH_32K]).unwrap();
    let empty = pmacctl(&format!("decode {path} --family turbo2")).stdout;
    assert!(empty.starts_with("no motor is reported\n"), "{empty}");
}
