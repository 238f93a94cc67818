//! Tests of [`super::vme`].

use super::BusWrite;
use super::vme::{AddressBits, VmeSetup};
use crate::map::Generation;
use proptest::prelude::*;

const MANUAL: VmeSetup = VmeSetup {
    mailbox: 0x7F_A000,
    dpram: Some(0x1F_C000),
    address_bits: AddressBits::A24,
    irq_level: 2,
    vector: 0xA1,
    generation: Generation::Pmac,
};

fn refused(setup: VmeSetup) -> String {
    setup.plan().unwrap_err().to_string()
}

#[test]
fn the_manuals_example() {
    let plan = MANUAL.plan().unwrap();
    assert_eq!(plan.commands, ["WX$0783,$39,$4,$0,$7F,$A0,$02,$A1,$10,$E0,$90", "SAVE", "$$$"]);
    assert_eq!(plan.after_reset, Some(vec![BusWrite { address: 0x7F_A121, value: 0x3F }]));
    let json = serde_json::to_value(&plan).unwrap();
    assert_eq!(json["after_reset"], serde_json::json!([{ "address": "0x7FA121", "value": "0x3F" }]));
    assert!(plan.warnings.is_empty());
    // The user manual's other start.
    let plan = VmeSetup { dpram: Some(0x78_0000), ..MANUAL }.plan().unwrap();
    assert_eq!(plan.commands[0], "WX$0783,$39,$4,$0,$7F,$A0,$02,$A1,$70,$E0,$90");
    assert_eq!(plan.after_reset.unwrap()[0].value, 0x20);
}

#[test]
fn a_window_shows_both_parts_in_steps_of_64_kib() {
    let window = |mailbox, dpram, address_bits| {
        let window = VmeSetup { mailbox, dpram, address_bits, ..MANUAL }.window().unwrap();
        (window.address, window.size)
    };
    let a24 = AddressBits::A24;
    assert_eq!(window(0x7F_A000, Some(0x1F_C000), a24), (0x1F_0000, 0x61_0000));
    assert_eq!(window(0x7F_A000, Some(0x7F_C000), a24), (0x7F_0000, 0x1_0000));
    assert_eq!(window(0x70_0000, Some(0xFF_C000), a24), (0x70_0000, 0x90_0000));
    assert_eq!(window(0x7F_A000, None, a24), (0x7F_0000, 0x1_0000));
    assert_eq!(window(0xFE00, Some(0), AddressBits::A16), (0, 0x1_0000));
    let a32 = AddressBits::A32;
    assert_eq!(window(0xFF00_0000, Some(0xFFFF_C000), a32), (0xFF00_0000, 0x100_0000));
    let error = VmeSetup { mailbox: 0x7F_A100, ..MANUAL }.window().unwrap_err();
    assert!(error.to_string().contains("not a multiple of 512"), "{error}");
}

#[test]
fn a_board_without_dpram() {
    let plan = VmeSetup { dpram: None, ..MANUAL }.plan().unwrap();
    assert_eq!(plan.commands[0], "WX$0783,$39,$4,$0,$7F,$A0,$02,$A1,$00,$60,$10");
    assert_eq!(plan.after_reset, Some(Vec::new()));
}

#[test]
fn turbo_boards_have_variables_instead() {
    let setup = VmeSetup { dpram: Some(0x70_0000), generation: Generation::Turbo, ..MANUAL };
    assert_eq!(
        setup.plan().unwrap().commands,
        [
            "I90=$39", "I91=$04", "I92=$00", "I93=$7F", "I94=$A0", "I95=$02", "I96=$A1", "I97=$70",
            "I98=$E0", "I99=$90", "SAVE", "$$$"
        ]
    );
}

#[test]
fn the_other_widths() {
    let wide =
        VmeSetup { mailbox: 0x187F_A000, dpram: Some(0x18C4_0000), address_bits: AddressBits::A32, ..MANUAL };
    let plan = wide.plan().unwrap();
    assert_eq!(plan.commands[0], "WX$0783,$09,$4,$18,$7F,$A0,$02,$A1,$C0,$E0,$80");
    assert_eq!(plan.after_reset.unwrap(), [BusWrite { address: 0x187F_A121, value: 0x10 }]);
    let short = VmeSetup { mailbox: 0xA000, dpram: Some(0x4000), address_bits: AddressBits::A16, ..MANUAL };
    let plan = short.plan().unwrap();
    assert_eq!(plan.commands[0], "WX$0783,$29,$4,$0,$00,$A0,$02,$A1,$00,$E0,$B0");
    assert_eq!(plan.after_reset.unwrap()[0].value, 0x01);
    assert_eq!(plan.warnings.len(), 1);
    let plan = VmeSetup { dpram: None, ..short }.plan().unwrap();
    assert_eq!(plan.commands[0], "WX$0783,$29,$4,$0,$00,$A0,$02,$A1,$00,$60,$30");
    assert!(plan.warnings.is_empty());
}

#[test]
fn impossible_addresses_are_refused_with_the_reason() {
    assert_eq!(
        refused(VmeSetup { mailbox: 0x7F_A100, ..MANUAL }),
        "mailbox address $7FA100 is not a multiple of 512 ($200): A8-A0 must be 0; $7FA000 is possible"
    );
    assert_eq!(
        refused(VmeSetup { dpram: Some(0x1F_C200), ..MANUAL }),
        "DPRAM address $1FC200 is not a multiple of 16 KiB ($4000): A13-A0 must be 0; $1FC000 is possible"
    );
    assert_eq!(
        refused(VmeSetup { mailbox: 0x187F_A000, ..MANUAL }),
        "mailbox address $187FA000 is out of reach of 24-bit addressing, whose last base is $FFFE00"
    );
    assert_eq!(
        refused(VmeSetup { mailbox: 0xA000, address_bits: AddressBits::A16, ..MANUAL }),
        "DPRAM address $1FC000 is out of reach of 16-bit addressing, whose last base is $C000"
    );
    assert_eq!(
        refused(VmeSetup { mailbox: 0x187F_A000, address_bits: AddressBits::A32, ..MANUAL }),
        "A31-A24 are shared: the mailboxes at $187FA000 have $18, the DPRAM at $001FC000 has $00"
    );
    assert_eq!(
        refused(VmeSetup { mailbox: 0x1F_FE00, ..MANUAL }),
        "the mailboxes at $1FFE00-$1FFFFF lie inside the DPRAM at $1FC000-$1FFFFF; move one of them"
    );
    // Right before and right behind is possible.
    assert!(VmeSetup { mailbox: 0x1F_BE00, ..MANUAL }.plan().is_ok());
    assert!(VmeSetup { mailbox: 0x20_0000, ..MANUAL }.plan().is_ok());
}

#[test]
fn impossible_interrupts_are_refused_with_the_reason() {
    for irq_level in [0, 8, u32::MAX] {
        assert!(refused(VmeSetup { irq_level, ..MANUAL }).contains("levels 1 to 7"));
    }
    for vector in [0, 0xFE, 0xFF, 0x100, 0x1A1] {
        assert!(refused(VmeSetup { vector, ..MANUAL }).contains("no room"), "{vector:X}");
    }
    assert_eq!(
        refused(VmeSetup { vector: 0xA0, ..MANUAL }),
        "vector $A0 is even; PMAC uses v-1, v and v+1 with an odd v (its default is $A1), so take $A1"
    );
    assert!(VmeSetup { vector: 0x01, irq_level: 7, ..MANUAL }.plan().is_ok());
    assert!(VmeSetup { vector: 0xFD, irq_level: 1, ..MANUAL }.plan().is_ok());
}

proptest! {
    #[test]
    fn registers_and_page_spell_the_addresses(mailbox in any::<u32>(), dpram in any::<u32>()) {
        let (mailbox, dpram) = (mailbox & !0x1FF, dpram & 0x00FF_C000 | mailbox & 0xFF00_0000);
        let setup = VmeSetup { mailbox, dpram: Some(dpram), address_bits: AddressBits::A32, ..MANUAL };
        let Ok(plan) = setup.plan() else {
            prop_assert_eq!(mailbox >> 14, dpram >> 14);
            return Ok(());
        };
        let saved: Vec<u32> = plan.commands[0].split(",$").skip(1)
            .map(|digits| u32::from_str_radix(digits, 16).unwrap()).collect();
        prop_assert_eq!(saved[2] << 24 | saved[3] << 16 | saved[4] << 8, mailbox);
        let page = plan.after_reset.unwrap()[0];
        prop_assert_eq!(page.address, mailbox + 0x121);
        prop_assert_eq!(saved[2] << 24 | saved[7] << 16 | u32::from(page.value) << 14, dpram);
    }

    #[test]
    fn nothing_panics(mailbox in any::<u32>(), dpram in any::<u32>(), vector in any::<u32>()) {
        for address_bits in [AddressBits::A16, AddressBits::A24, AddressBits::A32] {
            let _ = VmeSetup { mailbox, dpram: Some(dpram), vector, address_bits, ..MANUAL }.plan();
        }
    }
}
