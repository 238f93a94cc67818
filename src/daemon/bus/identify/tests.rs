//! The daemon's questions to a board that answers, refuses, changes or says nothing.

use super::*;
use crate::map::{FAMILIES, PMAC, TURBO2};

fn answer(identifier: &mut Identifier, now: Instant, lines: &[&str]) -> String {
    let (line, _) = identifier.next_line(u16::MAX, now).unwrap();
    identifier.sent();
    for line in lines {
        identifier.line(line.as_bytes());
    }
    identifier.done();
    String::from_utf8(line.as_bytes().to_vec()).unwrap()
}

#[test]
fn it_asks_everything_once_and_tells_it_once() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
    assert_eq!(identifier.take_update(), Some(Identity::default()), "what is configured is known at once");
    assert_eq!(answer(&mut identifier, now, &["PMAC1, ISA, FLASH, PID, CLK X1"]), "TYPE");
    answer(&mut identifier, now, &["1.16D"]);
    answer(&mut identifier, now, &["3713707", "I19=1", "1", "1", "$8", "3", "0"]);
    let enabling = Enabling { panel: Some(true), variables: Some(false), asked: Some(now) };
    assert_eq!(identifier.enabling(), enabling);
    assert_eq!(identifier.take_update(), None);
    let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
    let scales: Vec<&str> = scales.iter().map(String::as_str).collect();
    let line = answer(&mut identifier, now, &scales);
    assert!(line.starts_with("I107I108I109I160I207") && line.len() <= LINE_MAX);
    assert_eq!(answer(&mut identifier, now, &["0", "1"]), "I5 I6");
    assert_eq!(identifier.program_reports(), [Some(0), Some(1)]);
    let identity = identifier.take_update().unwrap();
    assert_eq!(identity.firmware.as_deref(), Some("1.16D"));
    assert_eq!((identity.servo_report_cycles, identity.reported_motors()), (Some(1), Some(8)));
    assert_eq!(identity.servo_period_ps, Some(442_708_373));
    assert_eq!((identity.ix07[0], identity.ix08[0], identity.ix09[7]), (Some(90), Some(91), Some(120)));
    assert_eq!(identity.ix08[8], None);
    assert!(identifier.next_line(u16::MAX, now).is_none());
    assert_eq!(identifier.due_in(now), IDENTITY_RECHECK);
}

#[test]
fn what_another_host_changes_is_found_within_half_a_minute() {
    let start = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
    let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
    let mut scales: Vec<&str> = scales.iter().map(String::as_str).collect();
    for lines in
        [&["PMAC1"][..], &["1.16D"], &["3713707", "1", "1", "1", "8", "3", "1", "2"], &scales, &["0", "1"]]
    {
        answer(&mut identifier, start, lines);
    }
    let first = identifier.take_update().unwrap();
    let now = start + IDENTITY_RECHECK;
    scales[1] = "48";
    let asked = answer(&mut identifier, now, &["3713707", "1", "1", "1", "8", "1", "1", "2"]);
    assert_eq!(asked, "I10 I19 I48 I49 I59 I2 I55 I3", "who it is, is not asked again");
    answer(&mut identifier, now, &scales);
    answer(&mut identifier, now, &["0", "1"]);
    let change = identifier.changes()[5].unwrap();
    assert_eq!((change.variable, change.was, change.is, change.since), (2, 3, 1, start));
    assert_eq!(identifier.enabling().panel, Some(false));
    let second = identifier.take_update().unwrap();
    assert_eq!((second.ix08[0], second.board_type), (Some(48), first.board_type));
    identifier.line_goes(&Meaning::of("I2=3"), now);
    assert_eq!(identifier.changes()[5], None);
    identifier.begin_anew(now);
    assert!(identifier.changes().iter().all(Option::is_none));
}

#[test]
fn what_a_line_may_set_of_the_errors_of_programs_is_unknown_until_the_board_has_told_it_again() {
    let now = Instant::now();
    for (line, left) in [
        ("I5=2", [None, Some(1)]),
        ("I(P1)=2", [None, None]),
        ("$$$", [None, None]),
        ("I6..7=1", [Some(0), None]),
        ("I50=5", [Some(0), Some(1)]),
    ] {
        let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
        let mut asked = String::new();
        while asked != "I5 I6" {
            asked = answer(&mut identifier, now, &["0", "1"]);
        }
        assert_eq!(identifier.program_reports(), [Some(0), Some(1)]);
        identifier.line_goes(&Meaning::of(line), now);
        assert_eq!(identifier.program_reports(), left, "{line}");
    }
}

#[test]
fn lines_that_always_wait_neither_keep_a_recheck_off_nor_wait_for_all_of_it() {
    let start = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
    for lines in
        [&["PMAC1"][..], &["1.16D"], &["3713707", "1", "1", "1", "8", "3", "1", "2"], &["96"], &["0", "1"]]
    {
        answer(&mut identifier, start, lines);
    }
    assert!(!identifier.is_overdue(start + IDENTITY_RECHECK));
    let now = start + IDENTITY_RECHECK + IDENTITY_PUT_OFF_AT_MOST;
    assert!(identifier.is_overdue(now), "lines wait for it now");
    answer(&mut identifier, now, &["3713707", "1", "1", "1", "8", "3", "1", "2"]);
    assert!(!identifier.is_overdue(now), "lines go before the next question");
    assert!(identifier.is_overdue(now + IDENTITY_PUT_OFF_AT_MOST));
}

#[test]
fn every_motors_scales_are_asked_in_lines_that_the_board_takes() {
    for family in FAMILIES {
        let now = Instant::now();
        let mut identifier = Identifier::new(family, Identity::default(), true, now);
        let mut asked = Vec::new();
        while let Some((line, _)) = identifier.next_line(u16::MAX, now) {
            assert!(line.len() <= family.ascii.line_limit.min(LINE_MAX), "{line:?}");
            let numbers: Vec<_> = line.split('I').skip(1).map(|number| number.trim().to_owned()).collect();
            identifier.sent();
            for number in &numbers {
                identifier.line(number.as_bytes());
            }
            if numbers.first().is_some_and(|number| number.ends_with("07")) {
                asked.extend(numbers);
            }
            identifier.done();
        }
        let all = (1..=family.motors)
            .flat_map(|motor| [7, 8, 9, 60].map(|which| (100 * motor + which).to_string()));
        assert_eq!(asked, all.collect::<Vec<_>>(), "{}", family.name);
        identifier.take_update();
        for motor in 1..=family.motors {
            let scale = |table: &[Option<i32>]| table[motor - 1];
            let asking = &identifier.asking;
            let scales = [&asking.ix07, &asking.ix08, &asking.ix09, &asking.ix60].map(|table| scale(table));
            assert_eq!(scales, [7, 8, 9, 60].map(|which| Some(100 * motor as i32 + which)));
        }
    }
}

#[test]
fn a_family_is_asked_for_the_variables_it_has() {
    let line = |family| questions(family)[2].line();
    assert_eq!(line(&PMAC), "I10 I19 I48 I49 I59 I2 I55 I3");
    // On a Turbo board no I-variable tells the number of reported motors, or the panel's place.
    assert_eq!(line(&TURBO2), "I10 I47 I48 I57 I49 I55 I3");
}

#[test]
fn a_report_in_the_background_is_told_without_a_period() {
    for (in_background, i47, cycles, on_request) in
        [("1", "10", 0, false), ("0", "10", 10, false), ("0", "0", 0, true), ("1", "0", 0, false)]
    {
        let now = Instant::now();
        let mut identifier = Identifier::new(&TURBO2, Identity::default(), true, now);
        answer(&mut identifier, now, &["TURBO2, X4"]);
        answer(&mut identifier, now, &["1.947"]);
        // Turbo User Manual p. 403: I57=1 is the report in the background, by I50.
        answer(&mut identifier, now, &["3713991", i47, "0", in_background, "1", "0", "2"]);
        assert_eq!(identifier.asking.servo_report_cycles, Some(cycles), "I57={in_background} I47={i47}");
        assert!(!identifier.on_request(), "told with all else of this round");
        while identifier.next < identifier.questions.len() {
            identifier.done();
        }
        assert_eq!(identifier.on_request(), on_request, "I57={in_background} I47={i47}");
    }
}

#[test]
fn a_silent_board_is_asked_again_later_and_a_changed_one_soon() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
    identifier.next_line(u16::MAX, now).unwrap();
    identifier.failed(now);
    assert!(identifier.next_line(u16::MAX, now).is_none());
    assert!(identifier.next_line(u16::MAX, now + IDENTITY_AGAIN).is_some());
    identifier.ask_again(now);
    assert!(identifier.next_line(u16::MAX, now + IDENTITY_AFTER_LINE).is_some());
    let mut quiet = Identifier::new(&PMAC, Identity::default(), false, now);
    quiet.ask_again(now);
    assert!(quiet.next_line(u16::MAX, now + IDENTITY_AGAIN).is_none(), "told not to ask");
}

#[test]
fn a_board_that_does_not_tell_all_scales_in_time_is_asked_for_fewer() {
    let mut now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
    let mut asked = Vec::new();
    for _ in 0..20 {
        while let Some((line, _)) = identifier.next_line(u16::MAX, now) {
            let numbers: Vec<_> = line.split('I').skip(1).collect();
            identifier.sent();
            if line.contains("07I") {
                asked.push(numbers.len());
                // The board tells one motor's scales in time.
                if numbers.len() > 4 {
                    identifier.failed(now);
                    break;
                }
            }
            numbers.iter().for_each(|number| identifier.line(number.as_bytes()));
            identifier.done();
        }
        now += IDENTITY_AGAIN;
    }
    assert_eq!(asked[..4], [32, 16, 8, 4]);
    let identity = identifier.take_update().unwrap();
    assert_eq!((identity.ix08[0], identity.ix08[7]), (Some(108), Some(808)));
}

#[test]
fn a_slow_board_is_asked_for_as_many_scales_as_it_tells_in_time() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&TURBO2, Identity::default(), true, now);
    let mut asked = Vec::new();
    while let Some((line, _)) = identifier.next_line(6, now) {
        let numbers: Vec<_> = line.split('I').skip(1).collect();
        asked.extend(line.contains("07I").then_some(numbers.len()));
        identifier.sent();
        numbers.iter().for_each(|number| identifier.line(number.as_bytes()));
        identifier.done();
    }
    assert_eq!(asked, [4; 32]);
    let identity = identifier.take_update().unwrap();
    assert_eq!((identity.ix08[0], identity.ix09[31]), (Some(108), Some(3209)));
}

#[test]
fn a_board_without_reports_is_asked_again_and_again() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now).without_reports();
    while identifier.next_line(u16::MAX, now).is_some() {
        identifier.sent();
        identifier.done();
    }
    assert_eq!(identifier.due_in(now), IDENTITY_AGAIN);
    assert!(identifier.next_line(u16::MAX, now + IDENTITY_AGAIN).is_some());
    let mut quiet = Identifier::new(&PMAC, Identity::default(), false, now).without_reports();
    assert_eq!((quiet.next_line(u16::MAX, now + IDENTITY_AGAIN), quiet.due_in(now)), (None, Duration::MAX));
}

#[test]
fn a_change_in_mid_question_neither_mixes_the_answers_nor_is_forgotten() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
    answer(&mut identifier, now, &["PMAC1"]);
    answer(&mut identifier, now, &["1.16D"]);
    identifier.next_line(u16::MAX, now).unwrap();
    identifier.sent();
    identifier.ask_again(now);
    for line in ["3713707", "1", "1", "1", "8", "3", "1"] {
        identifier.line(line.as_bytes());
    }
    identifier.done();
    assert_eq!(identifier.enabling(), Enabling::default(), "asked before the change");
    assert_eq!(answer(&mut identifier, now + IDENTITY_AFTER_LINE, &["PMAC1"]), "TYPE", "it begins again");
}

#[test]
fn a_scale_in_doubt_is_unknown_until_the_board_has_told_it_again() {
    let now = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, now);
    let scales: Vec<String> = (0..32).map(|index| (90 + index).to_string()).collect();
    let scales: Vec<&str> = scales.iter().map(String::as_str).collect();
    let all = |identifier: &mut Identifier, now| {
        let reports = ["3713707", "1", "1", "1", "8", "3", "1"];
        for lines in [&["PMAC1"][..], &["1.16D"], &reports, &scales, &["0", "1"]] {
            answer(identifier, now, lines);
        }
    };
    all(&mut identifier, now);
    identifier.take_update();
    identifier.line_goes(&Meaning::of("I122=3"), now);
    assert_eq!(identifier.take_update(), None, "no scale");
    identifier.line_goes(&Meaning::of("I208=48"), now);
    let told = identifier.take_update().unwrap();
    assert_eq!((told.ix08[0], told.ix08[1], told.ix07[1]), (Some(91), None, Some(94)));
    assert_eq!(told.firmware.as_deref(), Some("1.16D"));
    // Another change while the daemon asks the board.
    answer(&mut identifier, now + IDENTITY_AFTER_LINE, &["PMAC1"]);
    identifier.line_goes(&Meaning::of("I308=48"), now + IDENTITY_AFTER_LINE);
    assert_eq!(identifier.take_update().unwrap().ix08[1..3], [None, None]);
    all(&mut identifier, now + 2 * IDENTITY_AFTER_LINE);
    assert_eq!(identifier.take_update().unwrap().ix08[1..3], [Some(95), Some(99)]);
}

#[test]
fn a_stream_of_changes_puts_the_answer_off_but_not_for_ever() {
    let start = Instant::now();
    let mut identifier = Identifier::new(&PMAC, Identity::default(), true, start);
    identifier.take_update();
    let mut answered_at = None;
    for step in 0..100 {
        let now = start + Duration::from_millis(50 * step);
        identifier.ask_again(now);
        if identifier.next_line(u16::MAX, now).is_some() {
            identifier.sent();
            identifier.line(b"1");
            identifier.done();
        }
        if identifier.take_update().is_some() {
            answered_at.get_or_insert(now - start);
        }
    }
    let answered_at = answered_at.expect("an answer in spite of them");
    assert!(
        (IDENTITY_PUT_OFF_AT_MOST..2 * IDENTITY_PUT_OFF_AT_MOST).contains(&answered_at),
        "{answered_at:?}"
    );
    assert!(!identifier.is_overdue(identifier.not_before + IDENTITY_AFTER_LINE));
    assert!(identifier.is_overdue(identifier.not_before + IDENTITY_PUT_OFF_AT_MOST));
}
