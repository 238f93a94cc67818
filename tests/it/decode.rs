//! Decoding of hand-built images, with addresses written out as the manual prints them.

use pmac_dpram::decode::{Image, MotorScales, Scales, Value, background, servo};
use pmac_dpram::format::{Float48Layout, WordOrder};
use pmac_dpram::map::{MotionMode, PMAC, TargetSource, TypedAddress};
use proptest::prelude::*;
use serde_json::{Value as Json, json};

use crate::support::Dump;

const REGISTER: Float48Layout = Float48Layout::Register;

fn scales() -> Scales {
    let motor = MotorScales {
        position_scale: Some(96.0),
        velocity_scale: Some(96.0),
        master_scale: Some(32.0),
        loop_cycles: Some(1.0),
    };
    Scales { motors: vec![motor, MotorScales::default()], i10: Some(3_713_707) }
}

fn servo_dump() -> Dump {
    let mut dump = Dump::new(&PMAC, 0x4000);
    dump.word(0x0024, 0x0001).word(0x0026, 0xFFFE);
    dump.short(0x0028, 0x00_8000).short(0x002C, 0xA8_0001);
    // Motor 1.
    dump.pair(0x0048, 0, 3072).pair(0x0050, -1, -3072).pair(0x0058, 0, 1024).pair(0x0060, 1, 0);
    dump.short(0x0068, -512).short(0x006C, 0x81_2000).short(0x0070, 6144).short(0x0074, 7);
    dump.short(0x0078, 0x00_C000);
    // Motor 2, whose scales are not known.
    dump.pair(0x0084, 2, 0).pair(0x008C, 3, 0).pair(0x0094, 4, 0).pair(0x009C, 5, 0);
    dump.short(0x00A4, 256).short(0x00A8, 0x04_0000).short(0x00AC, -9).short(0x00B0, 10).short(0x00B4, 11);
    // The last register of motor 8.
    dump.short(0x021C, 0x12_3456);
    dump
}

#[test]
fn the_servo_buffer_decodes_field_by_field() {
    let data = servo_dump().image().servo(8, &scales()).unwrap();
    let (timer, pmac_busy, host_busy) = (data.servo_timer, data.pmac_busy, data.host_busy);
    assert_eq!((timer, pmac_busy, host_busy), (0x7FFE, true, true));
    // In the order of `???`: X:$0003 first.
    assert_eq!(data.global_status, Some([0xA8_0001, 0x00_8000]));
    let [first, second] = data.global_flags().unwrap();
    assert!(first.has("data_gathering_on") && first.has("this_card_addressed"));
    assert_eq!(second.names().collect::<Vec<_>>(), ["vme_or_dpram_response_mode"]);
    let activated: Vec<_> = data.motors.iter().map(|motor| motor.is_activated()).collect();
    assert_eq!(activated, [true, false, false, false, false, false, false, false]);
    assert_eq!(data.motors[7].handwheel_pointer.unwrap().raw, 0x12_3456);
}

#[test]
fn a_motor_serialises_with_raw_value_and_unit() {
    let data = servo_dump().image().servo(2, &scales()).unwrap();
    let quantity = |raw: i64, value: f64, unit: &str| json!({"raw": raw, "value": value, "unit": unit});
    let unknown = |raw: i64, unit: &str| json!({"raw": raw, "value": null, "unit": unit});
    assert_eq!(
        serde_json::to_value(&data.motors).unwrap(),
        json!([{
            "motor": 1,
            "commanded_position": quantity(3072, 1.0, "count"),
            "following_error": quantity(6144 - (1 << 24), f64::from(6144 - (1 << 24)) / 3072.0, "count"),
            "actual_position": quantity(-3072, -1.0, "count"),
            "master_position": quantity(1024, 1.0, "count of the master"),
            "compensation_position": quantity(1 << 24, f64::from(1 << 24) / 3072.0, "count"),
            "previous_dac": quantity(-512, -2.0, "DAC bit"),
            "servo_status": unknown(0x81_2000, "bits"),
            "actual_velocity": quantity(6144, 2.0, "count per servo cycle"),
            "velocity": quantity(6144, 2.0 * 8_388_608_000.0 / 3_713_707.0, "count/s"),
            "time_left": quantity(7, 3.5, "msec"),
            "handwheel_pointer": unknown(0xC000, "PMAC address"),
            "status": ["motor_activated", "integration_mode", "desired_velocity_zero"],
        }, {
            "motor": 2,
            "commanded_position": unknown(2 << 24, "1/(Ix08*32) count"),
            "following_error": unknown(-6 << 24, "1/(Ix08*32) count"),
            "actual_position": unknown(3 << 24, "1/(Ix08*32) count"),
            "master_position": unknown(4 << 24, "1/(Ix07*32) count of the master"),
            "compensation_position": unknown(5 << 24, "1/(Ix08*32) count"),
            "previous_dac": quantity(256, 1.0, "DAC bit"),
            "servo_status": unknown(0x04_0000, "bits"),
            "actual_velocity": unknown(-9, "1/(Ix09*32) count per servo cycle"),
            "velocity": unknown(-9, "1/(Ix09*32) count per servo cycle"),
            "time_left": quantity(10, 5.0, "msec"),
            "handwheel_pointer": unknown(11, "PMAC address"),
            "status": ["open_loop"],
        }])
    );
}

fn background_dump() -> Dump {
    let mut dump = Dump::new(&PMAC, 0x4000);
    dump.word(0x0228, 0x0001).word(0x022A, 0xFEDC);
    dump.short(0x022C, 0x11_1111).short(0x0230, -1).short(0x0234, 0x33_3333);
    // Number 3, 2 * 0x7C behind number 1.
    dump.pair(0x0344, -1, -3072).pair(0x034C, 0, 6144).short(0x0354, 0x90_4401);
    dump.pair(0x0358, 0xA8_002A, 0x00_0004);
    let floats = [
        (0x40_0000, 0x00_0800), // 1
        (0x80_0000, 0x00_07FF), // -1
        (0x40_0000, 0x00_07FF), // 0.5
        (0x50_0000, 0x00_0803), // 10
        (0x98_0000, 0x00_0801), // -3.25
        (0, 0),
        (0x60_0000, 0x00_080B), // 3072
        (0x20_0000, 0x00_0801), // 1, not normalised
        (0x40_0000, 0x00_0822), // 2^34
    ];
    for (index, (x, y)) in floats.into_iter().enumerate() {
        dump.pair(0x0360 + 8 * index, x, y);
    }
    dump.short(0x03A8, 0x02_0092).short(0x03AC, -2).short(0x03B0, 9).short(0x03B4, 11).short(0x03B8, -1);
    dump.short(0x03BC, -3072);
    dump
}

#[test]
fn the_background_buffer_decodes_field_by_field() {
    let mut scales = scales();
    scales.motors.push(scales.motors[0]);
    let data = background_dump().image().background(3, &scales, REGISTER).unwrap();
    assert_eq!((data.ready, data.servo_timer), (true, 0xFEDC));
    assert_eq!(
        serde_json::to_value(data.ports).unwrap(),
        json!({"control_panel": 0x11_1111, "thumbwheel": 0xFF_FFFF, "machine_io": 0x33_3333})
    );
    let quantity = |raw: i64, value: f64, unit: &str| json!({"raw": raw, "value": value, "unit": unit});
    assert_eq!(
        serde_json::to_value(data.motors[2]).unwrap(),
        json!({
            "motor": 3,
            "target_position": quantity(-3072, -1.0, "count"),
            "position_bias": quantity(6144, 2.0, "count"),
            "average_velocity": quantity(-3072, -1.0, "count per servo cycle"),
            "motor_status": {"raw": 0x90_4401, "value": null, "unit": "bits"},
            "coordinate_system": 2,
            "status": [
                "assigned_to_coordinate_system", "amplifier_enabled", "home_complete", "in_position"
            ],
        })
    );
    assert_eq!(
        serde_json::to_value(data.coordinate_systems[2]).unwrap(),
        json!({
            "coordinate_system": 3,
            "motor_definition": 4,
            "status_word": 0xA8_002A,
            "status": [
                "z_feedrate", "y_feedrate", "x_feedrate", "radius_vector_incremental", "move_by_time",
                "single_step_mode"
            ],
            "axis_targets": {
                "A": 1.0, "B": -1.0, "C": 0.5, "U": 10.0, "V": -3.25, "W": 0.0, "X": 3072.0, "Y": 1.0,
                "Z": 17_179_869_184.0
            },
            "source": "A",
            "program_status_word": 0x02_0092,
            "program_status": [
                "in_position", "segmented_move", "pvt_or_spline_mode", "counterclockwise_or_rapid_mode"
            ],
            "motion_mode": "pvt",
            "lines_remaining": -2,
            "time_left_in_move": quantity(9, 4.5, "msec"),
            "time_left_in_acceleration": quantity(11, 5.5, "msec"),
            "program_address_offset": 0xFF_FFFF,
        })
    );
    let system = data.coordinate_systems[2];
    assert_eq!((system.axis_targets.axis("V"), system.axis_targets.axis("D")), (Some(-3.25), None));
    let empty = data.coordinate_systems[0];
    assert_eq!(
        (empty.pmac.unwrap().source, empty.motion_mode),
        (Some(TargetSource::C), Some(MotionMode::Linear))
    );
}

#[test]
fn a_mirror_needs_only_the_words_of_the_motors_it_reports() {
    let image = servo_dump().image();
    let words = &image.words()[0x0024 / 2..];
    for motors in 0..=8 {
        let needed = 18 + 30 * motors;
        assert_eq!(servo(&PMAC, &words[..needed], motors, &scales()).unwrap().motors.len(), motors);
        let error = servo(&PMAC, &words[..needed - 1], motors, &scales()).unwrap_err();
        assert_eq!((error.needed, error.got), (needed, needed - 1));
    }
    // The buffer has room for 8; more are not asked of it.
    assert_eq!(servo(&PMAC, words, 9, &scales()).unwrap().motors.len(), 8);
    assert_eq!(
        background(&PMAC, &[0; 18], 1, &scales(), REGISTER).unwrap_err().to_string(),
        "the background region of 1 numbers takes 80 words; only 18 are there"
    );
}

#[test]
fn a_dump_is_read_in_both_word_orders_and_refused_at_another_size() {
    let dump = servo_dump();
    let swapped: Vec<u8> = dump.bytes().chunks(2).flat_map(|pair| [pair[1], pair[0]]).collect();
    let image = Image::from_bytes(&swapped, &PMAC, WordOrder::Swapped).unwrap();
    assert_eq!(image, dump.image());
    assert_ne!(Image::from_bytes(&swapped, &PMAC, WordOrder::Little).unwrap(), image);
    for length in [0, 0x3FFF, 0x4001, 0x10000] {
        let error = Image::from_bytes(&vec![0; length], &PMAC, WordOrder::Little).unwrap_err().to_string();
        assert_eq!(error, format!("an image of the DPRAM of a PMAC has 16384 bytes, not {length}"));
    }
}

#[test]
fn typed_addresses_read_the_image() {
    let image = servo_dump().image();
    let at = |text: &str| image.value(TypedAddress::parse(text, &PMAC).unwrap(), REGISTER);
    assert_eq!(at("X:$D009"), Some(Value::Word(0xFFFE)));
    assert_eq!(at("0x0026"), Some(Value::Word(0xFFFE)));
    assert_eq!(at("D:$D014"), Some(Value::Fixed(-3072)));
    assert_eq!(at("DP:$D01A"), Some(Value::Long(-512)));
    assert_eq!(
        background_dump().image().value(TypedAddress::parse("L:$D0E0", &PMAC).unwrap(), REGISTER),
        Some(Value::Float(-3.25))
    );
    assert_eq!(at("L:$DFFE"), Some(Value::Float(0.0)));
}

proptest! {
    /// Whatever a board holds decodes, and to finite numbers where raw integers are scaled.
    #[test]
    fn no_content_panics(words in prop::collection::vec(any::<u16>(), 0..600), count in 0usize..12) {
        if let Ok(data) = servo(&PMAC, &words, count, &scales()) {
            let text = serde_json::to_string(&data).unwrap();
            prop_assert!(serde_json::from_str::<Json>(&text).is_ok());
            prop_assert!(data.motors.iter().all(|m| m.commanded_position.unwrap().raw.unsigned_abs() <= 1 << 47));
        }
        for layout in [Float48Layout::Register, Float48Layout::Printed] {
            if let Ok(data) = background(&PMAC, &words, count, &scales(), layout) {
                prop_assert!(serde_json::to_string(&data).is_ok());
            }
        }
    }
}
