//! The plan: the buffers' places, refused settings, and the owner of each word.

use proptest::prelude::*;

use super::super::FAMILIES;
use super::super::PMAC;
use super::*;

fn layout(firmware: Option<&str>) -> Layout {
    Layout::new(&PMAC, firmware.map(|text| text.parse().unwrap()))
}

fn at(number: u32) -> HostOffset {
    HostOffset::new(4 * (number - 0xD000))
}

#[test]
fn gathering_begins_where_the_firmware_has_it_and_the_rest_stays() {
    for (firmware, start, end) in [(None, 0xD200, 0xD7C0), (Some("1.16D"), 0xD240, 0xD800)] {
        let plan = BufferLayout::new(&layout(firmware), &BufferSettings::default()).unwrap();
        assert_eq!((plan.gather().start, plan.gather().end), (at(start), at(end)));
        assert_eq!([0, 1].map(|index| plan.rotary()[index].start), [at(0xDE00), at(0xDC00)]);
        assert_eq!((plan.variable_read().start, plan.variable_read().words()), (at(0xDA80), 768));
        assert_eq!((plan.variable_write().start, plan.variable_write().words()), (at(0xDA20), 192));
        let open = plan.user_regions();
        assert_eq!(open.len(), 1);
        assert_eq!((open[0].start, open[0].end), (at(end), at(0xDA20)));
        assert!(plan.check_user_area(at(0xD800), 2).is_ok());
    }
}

#[test]
fn gather_sizes_are_whole_samples() {
    let settings = BufferSettings { gather_longs: 4000 / 2, ..BufferSettings::default() };
    let plan = BufferLayout::new(&layout(None), &settings).unwrap();
    assert_eq!(plan.gather_size(3), Some(1998));
    assert_eq!(plan.gather_size(0), None);
    assert_eq!(plan.gather_size(49), None);
    let none = BufferSettings { gather_longs: 5, ..settings };
    assert_eq!(BufferLayout::new(&layout(None), &none).unwrap().gather_size(6), None);
}

#[test]
fn buffers_that_overlap_are_named_with_their_addresses() {
    let refused =
        |settings: BufferSettings| BufferLayout::new(&layout(None), &settings).unwrap_err().to_string();
    let wide = BufferSettings { gather_longs: 0x900, ..BufferSettings::default() };
    assert_eq!(
        refused(wide),
        "gather ($D200-$DAFF) and variable_read ($DA80-$DBFF) overlap; make one of them smaller, or give it \
         another place: gather_longs, variable_read_entries, variable_read_start"
    );
    let placed = BufferSettings { variable_read_start: 0xD700, ..BufferSettings::default() };
    assert!(refused(placed).starts_with("gather ($D200-$D7BF) and variable_read ($D700-$D87F) overlap"));
    let placed = BufferSettings { rotary_start: vec![0, 0xDFF0], ..BufferSettings::default() };
    assert!(refused(placed).starts_with("rotary_2 does not fit into the area user ($D200-$DFFF);"));
    for start in [0xD1FF, 0xE000, u32::MAX, 1] {
        let placed = BufferSettings { variable_write_start: start, ..BufferSettings::default() };
        assert!(refused(placed).starts_with("variable_write does not fit"), "{start:#X}");
    }
    let huge = BufferSettings { gather_longs: u32::MAX, ..BufferSettings::default() };
    assert!(refused(huge).starts_with("gather does not fit"));
    // The user does not own the firmware's words below a moved gather buffer either.
    let below = BufferSettings {
        variable_write_start: 0xD200,
        variable_write_records: 1,
        ..BufferSettings::default()
    };
    assert!(
        BufferLayout::new(&layout(Some("1.16D")), &below)
            .unwrap_err()
            .to_string()
            .starts_with("firmware ($D200-$D23F)")
    );
}

#[test]
fn sizes_no_function_takes_are_refused() {
    for (settings, buffer) in [
        (BufferSettings { variable_read_entries: 129, ..BufferSettings::default() }, "variable_read"),
        (BufferSettings { variable_write_records: 33, ..BufferSettings::default() }, "variable_write"),
        (BufferSettings { rotary_longs: Some(vec![4, 0]), ..BufferSettings::default() }, "rotary_1"),
        (BufferSettings { rotary_longs: Some(vec![0, 7]), ..BufferSettings::default() }, "rotary_2"),
    ] {
        let error = BufferLayout::new(&layout(None), &settings).unwrap_err();
        assert!(matches!(error, BufferLayoutError::Size { buffer: named, .. } if named == buffer), "{error}");
        // It begins with a name that the configuration has.
        let settings = serde_json::to_value(&settings).unwrap();
        let text = error.to_string();
        let name = text.split([',', ':']).next().unwrap();
        assert!(settings.get(name).is_some(), "{text}");
    }
}

#[test]
fn every_word_has_the_owner_the_map_gives_it() {
    let plan = BufferLayout::new(&layout(Some("1.16D")), &BufferSettings::default()).unwrap();
    let owner = |number| plan.classify(at(number)).unwrap().to_string();
    assert_eq!(owner(0xD000), "the panel area");
    assert_eq!(owner(0xD1F5), "the pointers area");
    assert!(owner(0xD23F).starts_with("the firmware"));
    assert_eq!(owner(0xD240), "the gather buffer");
    assert_eq!(plan.classify(at(0xD800)), Some(Owner::User));
    assert_eq!(owner(0xDFFF), "the rotary_1 buffer");
    assert_eq!(plan.classify(HostOffset::new(0x4000)), None);
}

#[test]
fn what_is_not_open_is_refused_with_what_is() {
    let plan = BufferLayout::new(&layout(None), &BufferSettings::default()).unwrap();
    assert_eq!(
        plan.check_user_area(HostOffset::new(0x0026), 1).unwrap_err().to_string(),
        "0x0026 (X:$D009) belongs to the servo area; the user area is $D7C0-$DA1F"
    );
    assert!(plan.check_user_area(at(0xDA1F), 2).is_ok());
    assert!(plan.check_user_area(at(0xDA1F), 4).unwrap_err().to_string().contains("variable_write"));
    assert!(matches!(plan.check_user_area(at(0xDFFF), 4), Err(NotUserArea::Outside { .. })));
    assert!(matches!(plan.check_user_area(at(0xD800), usize::MAX / 4), Err(NotUserArea::Outside { .. })));
}

#[test]
fn without_buffers_all_of_the_area_is_open() {
    let settings = BufferSettings {
        gather_longs: 0,
        variable_read_entries: 0,
        variable_write_records: 0,
        rotary_longs: Some(Vec::new()),
        ..BufferSettings::default()
    };
    let plan = BufferLayout::new(&layout(None), &settings).unwrap();
    assert_eq!(plan.user_regions(), [Region::new("user", at(0xD200), HostOffset::new(0x4000))]);
}

#[test]
fn a_family_has_as_many_rotary_buffers_as_headers() {
    for family in FAMILIES {
        let layout = Layout::new(family, None);
        let count = family.rotary.headers.len();
        let settings =
            |longs: Vec<u32>| BufferSettings { rotary_longs: Some(longs), ..BufferSettings::default() };
        let kept = BufferLayout::new(&layout, &BufferSettings::default()).unwrap();
        assert!(kept.rotary().iter().all(|region| region.words() > 0), "each has room by default");
        let plan = BufferLayout::new(&layout, &settings(vec![6; count])).unwrap();
        assert_eq!(plan.rotary().len(), count, "{}", family.name);
        let mut end = family.user_area.end;
        for (index, region) in plan.rotary().iter().enumerate() {
            assert_eq!((region.end, region.words()), (end, 12), "{}", family.name);
            let owner = plan.classify(region.start).unwrap().to_string();
            assert_eq!(owner, format!("the rotary_{} buffer", index + 1));
            assert_eq!(plan.check_rotary(index, region.start, 6), Ok(()));
            end = region.start;
        }
        assert!(plan.check_rotary(count, end, 6).is_err());
        // A list may be shorter than the board's, not longer.
        let plan = BufferLayout::new(&layout, &settings(vec![6])).unwrap();
        assert!(plan.rotary()[1..].iter().all(|region| region.words() == 0));
        let error = BufferLayout::new(&layout, &settings(vec![0; count + 1])).unwrap_err().to_string();
        assert_eq!(error, format!("rotary_longs lists {} buffers; the board has {count}", count + 1));
    }
}

proptest! {
    #[test]
    fn a_plan_that_is_accepted_gives_every_word_one_owner(
        gather_longs in 0u32..2000,
        variable_read_entries in 0u32..=128,
        variable_write_records in 0u32..=32,
        rotary in 3u32..400,
        start in 0xD200u32..0xE000,
        moved in any::<bool>(),
    ) {
        let settings = BufferSettings {
            gather_longs,
            variable_read_entries,
            variable_write_records,
            rotary_longs: Some(vec![2 * rotary]),
            variable_read_start: start,
            ..BufferSettings::default()
        };
        let layout = layout(moved.then_some("1.16D"));
        if let Ok(plan) = BufferLayout::new(&layout, &settings) {
            let open = plan.user_regions();
            for bytes in (0x0800..0x4000).step_by(2) {
                let offset = HostOffset::new(bytes);
                let owners = plan.buffers().chain(open.iter().copied()).filter(|region| region.contains(offset)).count();
                prop_assert_eq!(owners, 1);
                let is_open = plan.classify(offset) == Some(Owner::User);
                prop_assert_eq!(is_open, open.iter().any(|region| region.contains(offset)));
            }
        }
    }
}

#[test]
fn a_gather_buffer_may_grow_up_to_the_next_buffer() {
    let layout = Layout::new(&PMAC, None);
    let plan = BufferLayout::new(&layout, &BufferSettings::default()).unwrap();
    let start = layout.gather().buffer;
    let room = (plan.variable_write().start.bytes() - start.bytes()) / 4;
    assert_eq!(plan.check_gather(start, room, 1), Ok(()));
    assert!(matches!(plan.check_gather(start, room + 1, 1), Err(BufferLayoutError::Overlap { .. })));
    // Rounded up to whole samples, as the board does.
    let sample = (2..48).find(|sample| !room.is_multiple_of(*sample)).unwrap();
    assert!(plan.check_gather(start, room, sample).is_err());
    assert!(matches!(plan.check_gather(start, u32::MAX, 7), Err(BufferLayoutError::Outside { .. })));
    assert!(matches!(plan.check_gather(HostOffset::new(0), 10, 1), Err(BufferLayoutError::Outside { .. })));
}
