//! The panel against a hand-driven board.

use proptest::prelude::*;

use super::*;
use crate::device::{Counted, FileBoard};

fn bus() -> Counted<FileBoard> {
    let file = tempfile::tempfile().unwrap();
    file.set_len(0x4000).unwrap();
    Counted::new(FileBoard::from_file(&file, 0x4000).unwrap())
}

#[test]
fn a_request_reaches_the_words_of_its_numbers_and_no_other() {
    let mut bus = bus();
    for index in 0..8 {
        bus.write16(at(PANEL_REQUEST, index), 0x1111).unwrap();
    }
    let request = PanelRequest::of(PanelAction::JogPlus, &[1, 3]).unwrap();
    assert_eq!(request.mask, 0b101);
    let before = bus.accesses();
    assert!(Panel::begin(&mut bus, &request).unwrap());
    assert_eq!(bus.accesses() - before, 1 + 2 + 1);
    let words = [0x0004, 0x0008, 0x000C, 0x0020].map(|at| bus.read16(HostOffset::new(at)).unwrap());
    assert_eq!(words, [0x0200, 0x1111, 0x0200, 0x1111]);
    assert_eq!(bus.read16(HostOffset::new(0)).unwrap(), 0b101);

    assert!(!Panel::taken(&mut bus).unwrap());
    let stop = PanelRequest::of(PanelAction::JogStop, &[2]).unwrap();
    assert!(
        !Panel::begin(&mut bus, &stop).unwrap(),
        "PMAC would clear this request's bit with the first one's"
    );
    assert_eq!(bus.read16(HostOffset::new(0x0008)).unwrap(), 0x1111, "nothing was written");
    bus.write16(HostOffset::new(0), 0).unwrap();
    assert!(Panel::taken(&mut bus).unwrap());
    assert!(Panel::begin(&mut bus, &stop).unwrap());
    assert_eq!(bus.read16(HostOffset::new(0x0008)).unwrap(), 0x0300);
}

#[test]
fn both_jogs_are_a_stop_and_other_pairs_a_contradiction() {
    let both = PanelRequest::of(PanelAction::JogMinus, &[4]).unwrap().and(PanelAction::JogPlus, 4).unwrap();
    assert_eq!(both, PanelRequest::of(PanelAction::JogStop, &[4]).unwrap());
    // Motor 2 and coordinate system 2 share a word but not their requests.
    let shared = PanelRequest::of(PanelAction::Home, &[2]).unwrap().and(PanelAction::Start, 2).unwrap();
    assert_eq!(shared.words[1], PANEL_HOME | PANEL_START);
    for (first, second) in [
        (PanelAction::Start, PanelAction::Stop),
        (PanelAction::JogPlus, PanelAction::Home),
        (PanelAction::PreJog, PanelAction::JogStop),
    ] {
        let refused = PanelRequest::of(first, &[1]).unwrap().and(second, 1);
        assert_eq!(refused, Err(PanelError::Contradiction { number: 1, action: second }));
        assert!(PanelRequest::of(first, &[1]).unwrap().and(second, 2).is_ok());
    }
    assert_eq!(PanelRequest::of(PanelAction::Stop, &[0]), Err(PanelError::Number(0)));
    assert_eq!(PanelRequest::of(PanelAction::Stop, &[9]), Err(PanelError::Number(9)));
}

#[test]
fn names_are_read_as_they_are_printed() {
    for action in PanelAction::ALL {
        assert_eq!(action.name().parse::<PanelAction>().unwrap(), action);
        assert_eq!(action.bits() & MOTOR_BITS == 0, !action.is_for_motors());
    }
    assert!("jog".parse::<PanelAction>().unwrap_err().to_string().contains("pre-jog"));
}

#[test]
fn what_a_dead_host_left_is_withdrawn_but_no_override_is_ended() {
    let mut bus = bus();
    bus.write16(PANEL_REQUEST_ENABLE, 0x0005).unwrap();
    bus.write16(PANEL_OVERRIDE_ENABLE, 0x0002).unwrap();
    bus.write16(HostOffset::new(0x000A), 7000).unwrap();
    let (mut panel, before) = (Panel::new(), bus.accesses());
    assert_eq!(panel.take_over(&mut bus).unwrap(), 0x05);
    assert_eq!(bus.accesses() - before, 3);
    assert_eq!(bus.read16(PANEL_REQUEST_ENABLE).unwrap(), 0);
    assert_eq!(bus.read16(PANEL_OVERRIDE_ENABLE).unwrap(), 0x0002);

    let before = bus.accesses();
    assert!(panel.set_override(&mut bus, 1, FeedOverride::from_raw(14507).unwrap()).unwrap());
    assert_eq!(bus.accesses() - before, 2);
    let shown = Panel::show(&mut bus).unwrap();
    assert_eq!(shown.override_enable, 0x0003, "coordinate system 2 keeps the one it had");
    assert_eq!(shown.overrides[..2], [14507, 7000]);
    assert_eq!(bus.accesses() - before, 2 + 18);
    assert!(panel.release_override(&mut bus, 2).unwrap());
    assert_eq!(Panel::show(&mut bus).unwrap().override_enable, 0x0001);
    assert!(panel.set_override(&mut bus, 9, FeedOverride::MAXIMUM).is_err());
}

#[test]
fn an_absent_board_takes_and_adopts_nothing() {
    let mut bus = bus();
    bus.write16(PANEL_REQUEST_ENABLE, u16::MAX).unwrap();
    bus.write16(PANEL_OVERRIDE_ENABLE, u16::MAX).unwrap();
    let writes = bus.writes();
    let stop = PanelRequest::of(PanelAction::Stop, &[1]).unwrap();
    assert!(!Panel::begin(&mut bus, &stop).unwrap());
    assert!(!Panel::new().set_override(&mut bus, 1, FeedOverride::MAXIMUM).unwrap());
    assert!(!Panel::new().release_override(&mut bus, 1).unwrap());
    assert_eq!(bus.writes(), writes);
}

#[test]
fn the_manuals_percentages() {
    const I10: u32 = 3_713_707;
    let percent = |value| FeedOverride::from_percent(value, I10).unwrap().raw();
    assert_eq!((percent(0.0), percent(100.0), percent(50.0)), (0, 14507, 7253));
    assert_eq!((percent(225.87), percent(225.9), percent(1e300)), (32766, 32767, 32767));
    let most = FeedOverride::MAXIMUM.percent(I10).unwrap();
    // The manual cuts 225.875 off.
    assert!((most - 225.87).abs() < 0.01, "{most}");
    assert!(FeedOverride::from_percent(-1.0, I10).is_err());
    assert!(FeedOverride::from_percent(f64::NAN, I10).is_err());
    assert_eq!(FeedOverride::from_percent(100.0, 0), Err(PanelError::NoServoPeriod));
    assert_eq!(FeedOverride::MAXIMUM.percent(0), None);
    assert_eq!(FeedOverride::from_raw(32768), Err(PanelError::Raw(32768)));
}

proptest! {
    #[test]
    fn a_percentage_shown_sets_the_same_word_again(raw in 0u32..=32767, i10 in 1000u32..=8_388_607) {
        let value = FeedOverride::from_raw(raw).unwrap();
        let again = FeedOverride::from_percent(value.percent(i10).unwrap(), i10).unwrap();
        prop_assert_eq!(again, value);
    }
}
