//! The panel against a hand-driven board.

use proptest::prelude::*;

use super::super::testing::memory;
use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::{FAMILIES, Family, PMAC, pmac};

/// The families that have a panel: its words, its host's half, and memory.
fn panels() -> impl Iterator<Item = (&'static PanelBlock, Panel, Counted<FileBoard>)> {
    let panel = |family: &&'static Family| {
        let words = family.panel.as_ref()?;
        Some((words, Panel::new(words), Counted::new(memory(family))))
    };
    FAMILIES.iter().filter_map(panel)
}

#[test]
fn a_request_reaches_the_words_of_its_numbers_and_no_other() {
    for (words, panel, mut bus) in panels() {
        let at = |number| place(words, words.request, number - 1);
        for number in 1..=words.numbers {
            bus.write16(at(number), 0x1111).unwrap();
        }
        let request = PanelRequest::of(words, PanelAction::JogPlus, &[1, 3]).unwrap();
        assert_eq!(request.mask, 0b101);
        let before = bus.accesses();
        assert!(panel.begin(&mut bus, &request).unwrap());
        assert_eq!(bus.accesses() - before, 1 + 2 + 1);
        let found = [1, 2, 3, words.numbers].map(|number| bus.read16(at(number)).unwrap());
        assert_eq!(found, [0x0200, 0x1111, 0x0200, 0x1111]);
        assert_eq!(bus.read16(words.request_enable).unwrap(), 0b101);

        assert!(!panel.taken(&mut bus).unwrap());
        let stop = PanelRequest::of(words, PanelAction::JogStop, &[2]).unwrap();
        assert!(
            !panel.begin(&mut bus, &stop).unwrap(),
            "PMAC would clear this request's bit with the first one's"
        );
        assert_eq!(bus.read16(at(2)).unwrap(), 0x1111, "nothing was written");
        bus.write16(words.request_enable, 0).unwrap();
        assert!(panel.taken(&mut bus).unwrap());
        assert!(panel.begin(&mut bus, &stop).unwrap());
        assert_eq!(bus.read16(at(2)).unwrap(), 0x0300);
    }
}

#[test]
fn pmacs_panel_lies_where_the_manual_says() {
    let words = PMAC.panel.as_ref().unwrap();
    let (panel, mut bus) = (Panel::new(words), memory(&PMAC));
    assert!(panel.begin(&mut bus, &PanelRequest::of(words, PanelAction::Home, &[1, 8]).unwrap()).unwrap());
    let found = [0x0000, 0x0004, 0x0008, 0x0020].map(|at| bus.read16(HostOffset::new(at)).unwrap());
    assert_eq!(found, [0x81, 0x4000, 0, 0x4000]);
}

/// A panel with a number for each of the enable words' bits.
#[test]
fn a_request_has_room_for_every_number() {
    let panel = PanelBlock { numbers: 16, ..pmac::PANEL_BLOCK };
    let all: Vec<usize> = (1..=16).collect();
    let stop = PanelRequest::of(&panel, PanelAction::JogStop, &all).unwrap();
    assert_eq!((stop.mask(), stop.stops(), stop.is_stop()), (0xFFFF, 0xFFFF, true));
    assert_eq!(PanelRequest::jog_stop(0xFFFF), stop);
    assert_eq!(format!("{:?}", PanelRequest::jog_stop(0x8000)), "{16: \"0x0300\"}");
}

#[test]
fn both_jogs_are_a_stop_and_other_pairs_a_contradiction() {
    let panel = &pmac::PANEL_BLOCK;
    let both = PanelRequest::of(panel, PanelAction::JogMinus, &[4])
        .unwrap()
        .and(panel, PanelAction::JogPlus, 4)
        .unwrap();
    assert_eq!(both, PanelRequest::of(panel, PanelAction::JogStop, &[4]).unwrap());
    // Motor 2 and coordinate system 2 share a word but not their requests.
    let shared =
        PanelRequest::of(panel, PanelAction::Home, &[2]).unwrap().and(panel, PanelAction::Start, 2).unwrap();
    assert_eq!(shared.words[1], bit::HOME | bit::START);
    for (first, second) in [
        (PanelAction::Start, PanelAction::Stop),
        (PanelAction::JogPlus, PanelAction::Home),
        (PanelAction::PreJog, PanelAction::JogStop),
    ] {
        let refused = PanelRequest::of(panel, first, &[1]).unwrap().and(panel, second, 1);
        assert_eq!(refused, Err(PanelError::Contradiction { number: 1, action: second }));
        assert!(PanelRequest::of(panel, first, &[1]).unwrap().and(panel, second, 2).is_ok());
    }
    assert_eq!(
        PanelRequest::of(panel, PanelAction::Stop, &[0]),
        Err(PanelError::Number { number: 0, numbers: 8 })
    );
    assert_eq!(
        PanelRequest::of(panel, PanelAction::Stop, &[9]),
        Err(PanelError::Number { number: 9, numbers: 8 })
    );
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
    for (words, mut panel, mut bus) in panels() {
        let shown = |bus: &mut Counted<FileBoard>| {
            let mut panel = vec![0; words.region.words()];
            bus.read_block(words.region.start, &mut panel).unwrap();
            PanelWords::of(words, &panel)
        };
        bus.write16(words.request_enable, 0x0005).unwrap();
        bus.write16(words.override_enable, 0x0002).unwrap();
        bus.write16(place(words, words.feed_override, 1), 7000).unwrap();
        let before = bus.accesses();
        panel.acquire(&mut bus).unwrap();
        assert_eq!(bus.accesses() - before, 2);
        assert_eq!(bus.read16(words.request_enable).unwrap(), 0);
        assert_eq!(bus.read16(words.override_enable).unwrap(), 0x0002);

        let before = bus.accesses();
        assert!(panel.set_override(&mut bus, 1, FeedOverride::from_raw(14507).unwrap()).unwrap());
        assert_eq!(bus.accesses() - before, 2);
        let found = shown(&mut bus);
        assert_eq!(found.override_enable, 0x0003, "coordinate system 2 keeps the one it had");
        assert_eq!(found.overrides[..2], [14507, 7000]);
        assert_eq!((found.requests.len(), found.overrides.len()), (words.numbers, words.numbers));
        assert!(panel.release_override(&mut bus, 2).unwrap());
        assert_eq!(shown(&mut bus).override_enable, 0x0001);
        assert!(panel.set_override(&mut bus, words.numbers + 1, FeedOverride::MAXIMUM).is_err());
    }
}

#[test]
fn an_absent_board_takes_and_adopts_nothing() {
    for (words, mut panel, mut bus) in panels() {
        bus.write16(words.request_enable, u16::MAX).unwrap();
        bus.write16(words.override_enable, u16::MAX).unwrap();
        let writes = bus.writes();
        let stop = PanelRequest::of(words, PanelAction::Stop, &[1]).unwrap();
        assert!(!panel.begin(&mut bus, &stop).unwrap());
        assert!(!panel.set_override(&mut bus, 1, FeedOverride::MAXIMUM).unwrap());
        assert!(!panel.release_override(&mut bus, 1).unwrap());
        assert_eq!(bus.writes(), writes);
    }
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
