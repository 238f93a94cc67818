//! Tests of [`super::absolute`].

use super::absolute::{AbsoluteFormat, FormatError, Kind};
use crate::map::Space;
use serde_json::{Value, json};

fn document(format: Result<AbsoluteFormat, FormatError>) -> Value {
    let mut document = serde_json::to_value(format.unwrap()).unwrap();
    document.as_object_mut().unwrap().remove("notes");
    document
}

fn parallel(space: &str, signed: bool, bits: u32, registers: &[(&str, u32, u32)]) -> Value {
    let registers: Vec<Value> = registers
        .iter()
        .map(|(address, from_bit, bits)| json!({ "address": address, "from_bit": from_bit, "bits": bits }))
        .collect();
    json!({ "kind": "parallel", "space": space, "signed": signed, "bits": bits, "registers": registers })
}

#[test]
fn the_reference_pages_examples() {
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_8D00, 0x20_0000)),
        parallel("Y", false, 32, &[("Y:$078D00", 0, 24), ("Y:$078D01", 0, 8)])
    );
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_8C00, 0x10_0004)),
        parallel("Y", false, 16, &[("Y:$078C00", 0, 8), ("Y:$078C01", 0, 8)])
    );
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_9E03, 0x12_0005)),
        parallel("Y", false, 18, &[("Y:$079E03", 8, 8), ("Y:$079E04", 8, 8), ("Y:$079E05", 8, 2)])
    );
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_8000, 0x54_0000)),
        parallel("X", false, 20, &[("X:$078000", 0, 20)])
    );
    let acc28 = json!({ "kind": "acc28", "space": "Y", "signed": true, "bits": 16,
        "registers": [{ "address": "Y:$078005", "from_bit": 8, "bits": 16 }] });
    assert_eq!(document(AbsoluteFormat::turbo(0x07_8005, 0xB1_0000)), acc28);
    assert!(!AbsoluteFormat::turbo(0x07_8005, 0x31_0000).unwrap().signed);
}

#[test]
fn parallel_data_to_the_ends_of_their_ranges() {
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_8D00, 0xB0_0000)),
        parallel("Y", true, 48, &[("Y:$078D00", 0, 24), ("Y:$078D01", 0, 24)])
    );
    assert_eq!(
        document(AbsoluteFormat::turbo(0x07_8D00, 0x88_0006)),
        parallel("Y", true, 8, &[("Y:$078D00", 16, 8)])
    );
    let six = AbsoluteFormat::turbo(0x07_8D00, 0xF0_0006).unwrap();
    assert_eq!((six.space, six.bits, six.registers.len()), (Some(Space::X), Some(48), 6));
    assert_eq!(AbsoluteFormat::turbo(0x07_8D00, 0x8C_0000).unwrap().bits, Some(12));
}

#[test]
fn pmac_boards_have_all_in_one_word() {
    assert_eq!(document(AbsoluteFormat::pmac(0x16_FFD1)), parallel("Y", false, 22, &[("Y:$FFD1", 0, 22)]));
    assert_eq!(
        document(AbsoluteFormat::pmac(0xA0_FFD0)),
        parallel("Y", true, 32, &[("Y:$FFD0", 0, 24), ("Y:$FFD1", 0, 8)])
    );
    assert_eq!(document(AbsoluteFormat::pmac(0x54_C000)), parallel("X", false, 20, &[("X:$C000", 0, 20)]));
    let acc28 = AbsoluteFormat::pmac(0xB1_C006).unwrap();
    assert_eq!((acc28.kind, acc28.signed), (Kind::Acc28, true));
    assert_eq!(acc28.registers[0].address.to_string(), "Y:$C006");
}

#[test]
fn sources_outside_the_memory() {
    let resolver = AbsoluteFormat::pmac(0x86_0010).unwrap();
    assert_eq!((resolver.kind, resolver.space, resolver.signed), (Kind::Resolver, None, true));
    assert_eq!((resolver.converter, resolver.switch_open), (Some(3), Some(true)));
    assert_eq!((resolver.multiplexer_address, resolver.registers.len()), (Some(0x10), 0));
    assert_eq!(AbsoluteFormat::pmac(0x00_0100).unwrap().multiplexer_address, Some(0));
    assert_eq!(AbsoluteFormat::turbo(0x08, 0).unwrap().converter, Some(1));
    let kinds = [
        (0x71_0008, Kind::Yaskawa, None),
        (0x72_0004, Kind::MacroYaskawa, Some(4)),
        (0xF3_0000, Kind::MacroResolver, Some(0)),
        (0xF4_000D, Kind::MacroParallel, Some(13)),
        (0x32_FFD0, Kind::Sanyo, None),
    ];
    for (ix10, kind, node) in kinds {
        let format = AbsoluteFormat::pmac(ix10).unwrap();
        assert_eq!((format.kind, format.node), (kind, node), "{ix10:06X}");
        assert_eq!(format.signed, ix10 >= 0x80_0000);
    }
    let sanyo = AbsoluteFormat::turbo(0x07_8C00, 0xB2_0000).unwrap();
    assert_eq!(sanyo.address.unwrap().to_string(), "Y:$078C00");
    assert_eq!(sanyo.space, Some(Space::Y));
    assert_eq!(AbsoluteFormat::turbo(0x100, 0x74_0000).unwrap().node, Some(0));
    assert_eq!(AbsoluteFormat::turbo(0x3F, 0x74_0000).unwrap().node, Some(0x3F));
}

#[test]
fn every_code_is_either_listed_or_refused() {
    for code in 0..=0xFF_u32 {
        let known = matches!(code & 0x7F, 0x00..=0x32 | 0x48..=0x74);
        assert_eq!(AbsoluteFormat::turbo(0x0008, code << 16).is_ok(), known, "{code:02X}");
        assert_eq!(AbsoluteFormat::pmac(code << 16 | 0x0008).is_ok(), known, "{code:02X}");
    }
}

#[test]
fn what_no_reference_explains_is_refused_with_the_reason() {
    let turbo = |ixx10, ixx95| AbsoluteFormat::turbo(ixx10, ixx95).unwrap_err().to_string();
    assert!(turbo(0x07_8D00, 0x33_0000).starts_with("Ixx95 = $330000: format code $33 is unknown"));
    assert!(turbo(0x07_8D00, 0x20_0007).contains("0004, 0005 or 0006"));
    assert!(turbo(0x07_8D00, 0x20_0104).contains("0004, 0005 or 0006"));
    assert!(turbo(0x07_8D00, 0x31_0004).contains("0000 for this format"));
    assert!(turbo(0, 0x20_0000).contains("no absolute position is read"));
    assert!(turbo(0x100_0000, 0x20_0000).contains("more than 24 bits"));
    assert_eq!(
        turbo(0x07_FFFF, 0x20_0000),
        "the position reaches up to address $80000; the board's last is $7FFFF"
    );
    assert!(turbo(0x101, 0x00_0000).contains("multiplexer address $101"));
    assert!(turbo(0x40, 0x73_0000).contains("MACRO node $40"));
    let pmac = |ix10| AbsoluteFormat::pmac(ix10).unwrap_err().to_string();
    assert!(pmac(0).contains("no absolute position is read"));
    assert!(pmac(0x30_FFFF).contains("$10000"));
    assert!(pmac(0x74_0010).contains("MACRO node $10"));
    assert!(pmac(0x100_0000).contains("more than 24 bits"));
    assert_eq!(AbsoluteFormat::pmac(0xF4_0100).unwrap().node, Some(0));
    assert_eq!(AbsoluteFormat::pmac(0xF4_C000).unwrap().node, None);
}
