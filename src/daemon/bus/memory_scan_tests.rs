//! The scan's questions, their order, and its conclusions from the answers.

use super::*;
use crate::map::{PMAC, TURBO2};

fn scan_of(family: &'static Family, wanted: bool, now: Instant) -> MemoryScan {
    MemoryScan::new(family, wanted, Arc::default(), now)
}

#[test]
fn where_a_definition_was_found_last_time_is_asked_for_first_and_told_at_once() {
    let now = Instant::now();
    let blocks = Arc::new(DefinitionBlocks::new(0));
    let mut scan = MemoryScan::new(&TURBO2, true, Arc::clone(&blocks), now);
    answer(&mut scan, &[(2050, "DP:$60080"), (7, "X:$C000,8")], now);
    let found = blocks.take_changed().unwrap();
    assert_eq!((found, blocks.take_changed()), (1 << 16, None));
    let mut scan = MemoryScan::new(&TURBO2, true, Arc::new(DefinitionBlocks::new(found)), now);
    let (line, _) = scan.next_line(u16::MAX, now).unwrap();
    assert_eq!(line.as_bytes(), b"M2048..2097->");
    scan.sent(now);
    (2048..2098).for_each(|number| scan.line(if number == 2050 { b"DP:$60080" } else { b"*" }));
    scan.done(false, now);
    assert_eq!(scan.take_outcome(now), Some(Outcome::More), "it is told before the others are read");
    assert_eq!(scan.progress().read, 50);
}

/// Answers every question with `*`, except for these `definitions`. Returns how many the scan asked for.
fn answer(scan: &mut MemoryScan, definitions: &[(u16, &str)], now: Instant) -> usize {
    let mut asked = 0;
    while let Some((line, _)) = scan.next_line(u16::MAX, now) {
        let line = std::str::from_utf8(line.as_bytes()).unwrap();
        let range = line.strip_prefix('M').and_then(|line| line.strip_suffix("->")).unwrap();
        let (first, last) = range.split_once("..").unwrap();
        let (first, last): (u16, u16) = (first.parse().unwrap(), last.parse().unwrap());
        assert!(last - first < 50, "{line}: at most 50 lines");
        scan.sent(now);
        for number in first..=last {
            let own = definitions.iter().find(|(own, _)| *own == number);
            scan.line(own.map_or("*", |(_, text)| text).as_bytes());
        }
        scan.done(false, now);
        asked += 1;
    }
    asked
}

#[test]
fn every_m_variable_is_asked_for_and_those_in_the_dpram_are_kept() {
    let now = Instant::now();
    for (family, asked) in [(&PMAC, 21), (&TURBO2, 165)] {
        let base = family.base;
        let definitions = [
            (211, format!("DP:${:X}", base + 0x80)),
            (212, format!("DP:${:X}", base + 0x80)),
            (m_variables(family) - 1, format!("X:${:X},0,16,S", base + 5)),
            (3, "X:$C000,8".to_owned()),
        ];
        let definitions: Vec<_> = definitions.iter().map(|(number, text)| (*number, text.as_str())).collect();
        let mut scan = scan_of(family, true, now);
        assert_eq!(scan.take_outcome(now), None);
        assert_eq!(answer(&mut scan, &definitions, now), asked);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
        assert_eq!(scan.take_outcome(now), None, "told once");
        let found: Vec<_> = scan.words().map(|(at, number)| (at.bytes(), number)).collect();
        assert_eq!(found, [(0x16, m_variables(family) - 1), (0x200, 211), (0x202, 211)]);
        // A line takes one definition away.
        scan.line_goes(&Meaning::of("M211->*"), now);
        assert_eq!(scan.next_line(u16::MAX, now), None, "more may follow");
        assert_eq!(answer(&mut scan, &definitions[1..], now + DEFINITIONS_AFTER_LINE), asked);
        assert_eq!(scan.words().nth(1).unwrap().1, 212);
    }
}

#[test]
fn a_board_that_cannot_be_asked_keeps_nobody_waiting() {
    let now = Instant::now();
    let begun = || scan_of(&PMAC, true, now);
    // The board refuses, does not answer, answers something else, or is never free. After an answer the daemon first
    // asks for fewer definitions: 6, 12, 24, 50 …
    type Answering = fn(&mut MemoryScan, Instant);
    let answers: [(Answering, usize); 4] = [
        (|scan, now| scan.done(true, now), 23),
        (MemoryScan::failed, 23),
        (
            |scan, now| {
                scan.line(b"*");
                scan.done(false, now);
            },
            23,
        ),
        (|_, _| {}, 21),
    ];
    for (otherwise, questions) in answers {
        let mut scan = begun();
        let mut time = now;
        while time < now + DEFINITIONS_NOT_TOLD {
            assert_eq!(scan.take_outcome(time), None, "silent now is not silent for ten seconds");
            if scan.next_line(u16::MAX, time).is_some() {
                scan.sent(time);
                otherwise(&mut scan, time);
            }
            time += DEFINITIONS_AGAIN;
        }
        assert_eq!(scan.take_outcome(time), Some(Outcome::Unknown));
        assert_eq!(scan.take_outcome(time + DEFINITIONS_AGAIN_AT_LAST), None, "told once");
        assert_eq!(answer(&mut scan, &[], time + DEFINITIONS_AGAIN_AT_LAST), questions, "it is asked again");
        assert_eq!(scan.take_outcome(time + DEFINITIONS_AGAIN_AT_LAST), Some(Outcome::Known));
    }
    let mut scan = scan_of(&PMAC, false, now);
    assert_eq!((scan.due_in(now), scan.take_outcome(now + DEFINITIONS_AGAIN)), (Duration::MAX, None));
}

#[test]
fn a_board_that_refuses_to_tell_is_waited_for_no_longer_because_it_answers_other_questions() {
    let now = Instant::now();
    let mut scan = scan_of(&PMAC, true, now);
    let mut time = now;
    // The daemon asks for the board's identity first.
    while time < now + 2 * DEFINITIONS_NOT_TOLD {
        time += DEFINITIONS_AGAIN;
        scan.is_answering(time);
        assert_eq!(scan.take_outcome(time), None);
    }
    let begun = time;
    while scan.take_outcome(time).is_none() {
        assert!(time <= begun + DEFINITIONS_NOT_TOLD, "{:?}", time - begun);
        if scan.next_line(u16::MAX, time).is_some() {
            scan.sent(time);
            scan.done(true, time);
        }
        scan.is_answering(time);
        time += DEFINITIONS_AGAIN;
    }
}

#[test]
fn what_was_told_stands_whatever_becomes_of_the_other_questions() {
    let now = Instant::now();
    let mut scan = scan_of(&PMAC, true, now);
    for question in 0..3_u16 {
        assert!(scan.next_line(u16::MAX, now).is_some());
        scan.sent(now);
        for number in 0..A_QUESTION {
            scan.line(if (question, number) == (1, 5) { b"DP:$D012" } else { b"*" });
        }
        scan.done(false, now);
        assert_eq!(scan.take_outcome(now), (question == 1).then_some(Outcome::More));
    }
    // The board answers the fourth question short, then with one line more, and then not at all.
    let (mut time, mut told) = (now, Vec::new());
    for answer in 0..8 {
        let (line, _) = scan.next_line(u16::MAX, time).unwrap();
        let lines: [&[u8]; 4] = [b"M150..199->", b"M150..174->", b"M150..161->", b"M150..155->"];
        assert_eq!(line.as_bytes(), lines[answer.min(3)], "they are asked again, fewer");
        scan.sent(time);
        if answer == 0 {
            scan.line(b"Y:$D000");
            scan.done(false, time);
        } else {
            scan.failed(time);
        }
        time += DEFINITIONS_AGAIN;
        told.extend(scan.take_outcome(time));
    }
    assert_eq!(told, [Outcome::More]);
    assert_eq!(scan.take_outcome(now + DEFINITIONS_NOT_TOLD), Some(Outcome::Unknown));
    let numbers: Vec<_> = scan.words().map(|(_, number)| number).collect();
    assert_eq!(numbers, [150, 55, 55]);
    assert_eq!(
        answer(&mut scan, &[], now + DEFINITIONS_NOT_TOLD + DEFINITIONS_AGAIN_AT_LAST),
        20,
        "the others are not asked again"
    );
}

/// A question costs a slow board 0.4 s, or each definition 0.15 s: the daemon reads all definitions, and tells how long
/// that takes.
#[test]
fn a_slow_board_is_read_to_its_end_and_how_far_that_is_is_known() {
    for (a_question, a_line, most) in [(400, 0, 67), (0, 150, 1500)] {
        let began = Instant::now();
        let mut scan = scan_of(&TURBO2, true, began);
        assert_eq!(scan.progress(), DefinitionsRead { read: 0, of: 8192, seconds_left: None });
        let (mut now, mut half) = (began, None);
        while !scan.is_over() {
            now += scan.due_in(now);
            let (_, patience) = scan.next_line(u16::MAX, now).unwrap();
            scan.sent(now);
            let lines = scan.last() - scan.next + 1;
            let takes = Duration::from_millis(a_question + a_line * u64::from(lines));
            now += takes.min(patience);
            if takes > patience {
                scan.failed(now);
            } else {
                (0..lines).for_each(|_| scan.line(b"*"));
                scan.done(false, now);
            }
            assert_ne!(scan.take_outcome(now), Some(Outcome::Unknown));
            if scan.read >= 4096 {
                half.get_or_insert((now, scan.progress().seconds_left.unwrap()));
            }
        }
        let ((half, told), all) = (half.unwrap(), now.duration_since(began));
        assert!(all < Duration::from_secs(most), "{all:?}");
        let left = now.duration_since(half).as_secs_f64();
        assert!((f64::from(told) - left).abs() < 0.1 * left, "{told} s were told, {left} s were left");
    }
}

#[test]
fn a_slow_board_is_asked_for_as_many_as_it_tells_in_time() {
    let now = Instant::now();
    let asked = |most_lines| {
        let line = scan_of(&TURBO2, true, now).next_line(most_lines, now).unwrap().0;
        String::from_utf8(line.as_bytes().to_vec()).unwrap()
    };
    assert_eq!([20, 2].map(asked), ["M0..19->", "M0..5->"]);
}

#[test]
fn time_in_which_others_hold_the_port_does_not_count() {
    let now = Instant::now();
    let mut scan = scan_of(&PMAC, true, now);
    for second in 0..60 {
        let time = now + Duration::from_secs(second);
        scan.pass(second > 2, time);
        assert_eq!(scan.take_outcome(time), None, "{second}");
    }
    let freed = now + Duration::from_secs(59);
    assert!(scan.is_overdue(freed), "lines that always wait do not put it off for ever");
    scan.pass(false, freed + Duration::from_secs(7));
    assert_eq!(scan.take_outcome(freed + Duration::from_secs(7)), None);
    assert_eq!(scan.take_outcome(freed + DEFINITIONS_NOT_TOLD), Some(Outcome::Unknown));
}

#[test]
fn an_answer_that_is_no_definition_does_not_say_that_none_points() {
    let now = Instant::now();
    let mut scan = scan_of(&PMAC, true, now);
    assert_eq!(answer(&mut scan, &[(7, "M8->DP:$D012"), (9, "?")], now), 21);
    let unclear = Unclear { variable: 7, text: Text::from_bytes(b"M8->DP:$D012") };
    assert_eq!(scan.take_outcome(now), Some(Outcome::Unclear(unclear)));
    scan.begin_anew(now);
    assert_eq!(answer(&mut scan, &[(8, "M8->DP:$D012")], now), 21);
    assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
    assert_eq!(scan.words().count(), 2);
}

#[test]
fn what_is_defined_during_a_pass_begins_another() {
    let now = Instant::now();
    let mut scan = scan_of(&PMAC, true, now);
    assert!(scan.next_line(u16::MAX, now).is_some());
    scan.sent(now);
    scan.line_goes(&Meaning::of("M5->Y:$D000"), now);
    (0..A_QUESTION).for_each(|_| scan.line(b"*"));
    scan.done(false, now);
    assert_eq!(answer(&mut scan, &[(5, "Y:$D000,0,16")], now + DEFINITIONS_AFTER_LINE), 21);
    assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
    assert_eq!(scan.words().count(), 1);
}
