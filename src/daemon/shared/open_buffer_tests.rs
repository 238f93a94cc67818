//! Which writer may write into which program buffer, and how a board's reports and answers change that.

use super::*;

const ANNE: Writer = Writer::Hand(Account { uid: 1000, pid: 1 });
const BOB: Writer = Writer::Hand(Account { uid: 1001, pid: 2 });

fn sequence(number: u64, inside: bool) -> Writer {
    Writer::Sequence { number, account: Account { uid: 1000, pid: 1 }, inside }
}

/// The begin and the end of a line that the board takes.
fn sent(buffer: &mut OpenBuffer, line: &str, by: Writer) {
    buffer.begin(&Meaning::of(line), by, Instant::now());
    buffer.done(&Meaning::of(line));
}

#[test]
fn only_who_opened_a_buffer_writes_into_it() {
    let mut buffer = OpenBuffer::default();
    let everybody = [ANNE, BOB, sequence(1, false), Writer::Question];
    assert!(everybody.iter().all(|writer| buffer.bars(&Meaning::of("X1"), *writer).is_none()));
    sent(&mut buffer, "OPEN PROG 77 CLEAR", ANNE);
    let other_process = Writer::Hand(Account { uid: 1000, pid: 9 });
    assert_eq!(
        (buffer.bars(&Meaning::of("X1"), ANNE), buffer.bars(&Meaning::of("X1"), other_process)),
        (None, None)
    );
    for writer in [BOB, sequence(1, false), Writer::Question] {
        let Some(Barred::Open(Some(opened))) = buffer.bars(&Meaning::of("X1"), writer) else {
            panic!("{writer:?}")
        };
        assert_eq!((&*opened.name, opened.by), ("PROG 77", ANNE));
    }
    assert!(
        buffer.bars(&Meaning::of("X1"), Writer::Beside).is_some()
            && buffer.bars(&Meaning::of("I122"), Writer::Beside).is_some()
    );
    assert_eq!(
        [&b"CLOSE"[..], b"#1J/", b"#1P"].map(|line| buffer.bars(&Meaning::of(line), Writer::Beside)),
        [None; 3]
    );
    for line in [&b"#2J+"[..], b"#2J=100#1", b"???", b"$$$", b"#3HM", b"&2%50"] {
        for writer in [BOB, Writer::Question, Writer::Beside, Writer::Stop] {
            assert_eq!(buffer.bars(&Meaning::of(line), writer), None, "{}", String::from_utf8_lossy(line));
        }
        assert!(
            buffer.bars(&Meaning::of(line), sequence(1, false)).is_some(),
            "it has lines behind it which enter"
        );
    }
    for line in [&b"CLEAR"[..], b"OPEN PROG 78 CLEAR", b"LEARN"] {
        assert!(matches!(buffer.bars(&Meaning::of(line), BOB), Some(Barred::Changes(Some(_)))));
    }
    assert_eq!(
        [&b" close "[..], b"CLOSE  all", b"cls all"].map(|line| buffer.bars(&Meaning::of(line), BOB)),
        [None; 3]
    );
    assert!(
        buffer.bars(&Meaning::of("CLOSE"), sequence(1, false)).is_some()
            && buffer.bars(&Meaning::of("CLOSE X1"), BOB).is_some()
    );
    sent(&mut buffer, "CLOSE", BOB);
    sent(&mut buffer, "OPEN PLC 3", sequence(1, false));
    assert_eq!(buffer.bars(&Meaning::of("X1"), sequence(1, true)), None);
    assert!(
        buffer.bars(&Meaning::of("X1"), sequence(2, false)).is_some()
            && buffer.bars(&Meaning::of("X1"), ANNE).is_some()
    );
    sent(&mut buffer, "CLOSE", ANNE);
    assert_eq!(
        buffer.bars(&Meaning::of("X1"), sequence(1, true)),
        Some(Barred::Closed),
        "it would be carried out at once"
    );
}

#[test]
fn the_boards_reports_tell_what_others_open_and_close() {
    let mut buffer = OpenBuffer::default();
    buffer.see(true, 1);
    assert_eq!(buffer.bars(&Meaning::of("X1"), ANNE), Some(Barred::Open(None)));
    sent(&mut buffer, "CLOSE", ANNE);
    buffer.see(true, 2);
    assert!(!buffer.is_open(), "a report from before");
    buffer.see(true, 2 + OLD_REPORTS);
    assert!(buffer.is_open(), "not closed after all");
    buffer.see(false, 60);
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    buffer.see(false, 61);
    assert!(buffer.is_open(), "a report from before");
    buffer.see(false, 61 + OLD_REPORTS);
    assert!(!buffer.is_open(), "the board has refused the line, or somebody else has closed it");
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    buffer.unsee();
    assert!(buffer.is_open(), "no report comes");
    buffer.learn(Some(-41301), Instant::now());
    assert_eq!(buffer.bars(&Meaning::of("X1"), ANNE), None);
    buffer.learn(Some(41301), Instant::now());
    assert!(!buffer.is_open());
}

#[test]
fn a_report_from_before_a_reset_opens_nothing() {
    let now = Instant::now();
    let mut buffer = OpenBuffer::after_reset();
    buffer.see(true, 700);
    assert!(!buffer.is_open() && buffer.must_ask(&Meaning::of("P1=5"), ANNE, now), "it lay there before");
    buffer.learn(Some(41301), now);
    buffer.see(true, 699 + OLD_REPORTS);
    assert_eq!(
        (buffer.bars(&Meaning::of("P1=5"), ANNE), buffer.must_ask(&Meaning::of("P1=5"), ANNE, now)),
        (None, false)
    );
    buffer.see(true, 700 + OLD_REPORTS);
    assert_eq!(
        buffer.bars(&Meaning::of("P1=5"), ANNE),
        Some(Barred::Open(None)),
        "another host has opened one since"
    );
}

#[test]
fn after_a_close_of_somebody_elses_buffer_the_board_is_asked() {
    let now = Instant::now();
    let mut buffer = OpenBuffer::default();
    buffer.see(true, 1);
    sent(&mut buffer, "CLOSE", ANNE);
    assert!(buffer.must_ask(&Meaning::of("P1=5"), ANNE, now), "it may be open still");
    buffer.learn(Some(-41301), now);
    assert_eq!(buffer.bars(&Meaning::of("P1=5"), ANNE), Some(Barred::Open(None)));
    buffer.learn(Some(41301), now);
    assert!(
        buffer.bars(&Meaning::of("P1=5"), ANNE).is_none()
            && !buffer.must_ask(&Meaning::of("P1=5"), ANNE, now)
    );
    // The user has closed the user's own buffer.
    buffer.see(false, 60);
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    sent(&mut buffer, "CLOSE", ANNE);
    assert!(!buffer.must_ask(&Meaning::of("P1=5"), ANNE, now));
}

#[test]
fn without_reports_the_board_is_asked_before_a_line_that_might_enter() {
    let now = Instant::now();
    let asks = |buffer: &OpenBuffer, line: &str, writer| buffer.must_ask(&Meaning::of(line), writer, now);
    let mut buffer = OpenBuffer::default();
    assert!([ANNE, sequence(1, false), Writer::Question].iter().all(|writer| asks(&buffer, "P1", *writer)));
    assert!(!asks(&buffer, "CLOSE", ANNE) && asks(&buffer, "CLOSE", sequence(1, false)));
    assert!(!asks(&buffer, "#1J/", Writer::Question), "what stops does not wait");
    buffer.learn(Some(-41301), now);
    assert!(!asks(&buffer, "P1", ANNE) && buffer.bars(&Meaning::of("P1"), ANNE) == Some(Barred::Open(None)));
    assert!(buffer.must_ask(&Meaning::of("P1"), ANNE, now + ANSWER_AGE), "too old");
    buffer.learn(None, now);
    assert_eq!(buffer.bars(&Meaning::of("P1"), ANNE), None, "the lines alone tell");
    assert!(buffer.is_not_said(Unsaid::Refused(3), now) && !buffer.is_not_said(Unsaid::Refused(3), now));
    assert!(!asks(&buffer, "P1", ANNE) && buffer.standing().is_unsaid);
    assert_eq!(Unsaid::Refused(3).to_string(), "refuses SIZE (ERR003)");
    assert_eq!(Unsaid::Otherwise.to_string(), "answers SIZE with something else");
    buffer.learn(None, now);
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    let later = now + ANSWER_AGE;
    assert!(
        !buffer.must_ask(&Meaning::of("X1"), ANNE, later) && buffer.must_ask(&Meaning::of("X1"), BOB, later)
    );
    buffer.doubt(&Meaning::of("OPEN PROG 1"));
    assert!(asks(&buffer, "X1", ANNE), "the board may have refused it");
    buffer.learn(Some(41301), now);
    assert!(!asks(&buffer, "X1", ANNE) && !buffer.is_open());
}

#[test]
fn the_first_reports_may_be_older_than_what_was_opened_before_they_came() {
    let mut buffer = OpenBuffer::default();
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    for report in 700..700 + OLD_REPORTS {
        buffer.see(false, report);
        assert!(buffer.is_open(), "report {report}");
        assert!(buffer.must_ask(&Meaning::of("P1"), BOB, Instant::now()), "others may have opened one, too");
    }
    buffer.see(false, 700 + OLD_REPORTS);
    assert!(!buffer.is_open(), "closed over the serial port");
    assert!(!buffer.must_ask(&Meaning::of("P1"), BOB, Instant::now()));
}

#[test]
fn reports_are_older_as_long_as_the_board_takes_to_open_a_buffer() {
    let now = Instant::now();
    let mut buffer = OpenBuffer::default();
    buffer.see(false, 1);
    buffer.begin(&Meaning::of("OPEN PROG 1"), ANNE, now);
    (2..1000).for_each(|report| buffer.see(false, report));
    assert!(
        buffer.bars(&Meaning::of("X1"), ANNE).is_none() && buffer.bars(&Meaning::of("X1"), BOB).is_some()
    );
    buffer.done(&Meaning::of("OPEN PROG 1"));
    (1000..2000).for_each(|report| buffer.see(true, report));
    assert!(
        buffer.bars(&Meaning::of("X1"), ANNE).is_none() && buffer.bars(&Meaning::of("X1"), BOB).is_some()
    );
    buffer.begin(&Meaning::of("OPEN PROG 2"), ANNE, now);
    buffer.doubt(&Meaning::of("OPEN PROG 2"));
    (2000..3000).for_each(|report| buffer.see(false, report));
    assert!(!buffer.is_open(), "it was not opened");
}

#[test]
fn who_could_not_open_a_buffer_has_not_opened_it() {
    let now = Instant::now();
    let mut buffer = OpenBuffer::default();
    // A host on the serial port was first.
    buffer.begin(&Meaning::of("OPEN PROG 2"), ANNE, now);
    buffer.refused(&Meaning::of("OPEN PROG 2"), IN_USE);
    assert_eq!(buffer.bars(&Meaning::of("X1"), ANNE), Some(Barred::Open(None)));
    sent(&mut buffer, "CLOSE", ANNE);
    sent(&mut buffer, "OPEN PROG 1", ANNE);
    buffer.begin(&Meaning::of("OPEN PROG 2"), ANNE, now);
    buffer.refused(&Meaning::of("OPEN PROG 2"), IN_USE);
    assert_eq!(buffer.opened().map(|opened| &*opened.name), Some("PROG 1"));
}

#[test]
fn no_report_says_that_a_kinematic_program_is_closed() {
    let now = Instant::now();
    for name in ["FORWARD", "INVERSE"] {
        let mut buffer = OpenBuffer::default();
        buffer.see(false, 1);
        sent(&mut buffer, &format!("&3open {name} clear"), ANNE);
        (2..1000).for_each(|report| buffer.see(false, report));
        assert!(
            buffer.bars(&Meaning::of("P1=Q1"), ANNE).is_none()
                && buffer.bars(&Meaning::of("P1=Q1"), BOB).is_some()
        );
        buffer.learn(Some(41301), now);
        assert!(!buffer.is_open(), "the board's answer tells");
        sent(&mut buffer, &format!("OPEN {name}"), ANNE);
        sent(&mut buffer, "CLOSE", ANNE);
        assert!(!buffer.is_open());
    }
}

#[test]
fn reports_are_enough_unless_a_line_was_refused() {
    let now = Instant::now();
    let mut buffer = OpenBuffer::default();
    buffer.see(false, 1);
    assert!(!buffer.must_ask(&Meaning::of("P1"), BOB, now));
    buffer.begin(&Meaning::of("OPEN PROG 1"), ANNE, now);
    buffer.doubt(&Meaning::of("OPEN PROG 1"));
    assert!(buffer.must_ask(&Meaning::of("P1"), ANNE, now));
    buffer.see(false, 1 + OLD_REPORTS);
    assert!(!buffer.must_ask(&Meaning::of("P1"), ANNE, now) && !buffer.is_open());
    buffer.unsee();
    assert!(buffer.must_ask(&Meaning::of("P1"), ANNE, now));
}

#[test]
fn lines_open_and_close() {
    let mut buffer = OpenBuffer::default();
    for (line, open) in [
        ("CLOSE", None),
        ("SEND\"OPEN PROG 1\"", None),
        ("OPEN PROG 1", Some("PROG 1")),
        ("X10 Y20", Some("PROG 1")),
        ("CMD\"CLOSE\"", Some("PROG 1")),
        ("close", None),
        ("&1open rot", Some("ROT")),
        ("$$$", None),
        ("CLOSE OPEN PLC 3 CLEAR", Some("PLC 3")),
        ("OPENPROG77CLEAR", Some("PROG 77")),
        ("OPEN", Some("")),
        ("OPENPROG 123456789012345678", Some("PROG 12345678901")),
        ("OPENED CLS", None),
        ("OPEN BINARY ROTARY", None),
        ("CLOSE ALL", None),
    ] {
        sent(&mut buffer, line, ANNE);
        assert_eq!(buffer.opened.as_ref().map(|opened| &*opened.name), open, "{line}");
    }
}

#[test]
fn a_line_that_belongs_into_a_buffer_is_not_sent_when_that_is_closed() {
    let inside = Writer::IntoBuffer(Account { uid: 1000, pid: 1 });
    let mut buffer = OpenBuffer::default();
    sent(&mut buffer, "OPEN PROG 7 CLEAR", ANNE);
    assert_eq!(buffer.bars(&Meaning::of("X1"), inside), None);
    sent(&mut buffer, "CLOSE", BOB);
    assert_eq!(buffer.bars(&Meaning::of("P1=5"), inside), Some(Barred::Closed));
    assert_eq!(buffer.bars(&Meaning::of("P1=5"), ANNE), None, "by hand it goes");
    for line in ["CLOSE", "#1J/", "OPEN PROG 8 CLEAR"] {
        assert_eq!(buffer.bars(&Meaning::of(line), inside), None, "{line}");
    }
    sent(&mut buffer, "OPEN PROG 9", BOB);
    assert!(matches!(buffer.bars(&Meaning::of("P1=5"), inside), Some(Barred::Open(_))), "another one's");
    sent(&mut buffer, "CLOSE", BOB);
    assert_eq!(
        buffer.bars(&Meaning::of("X1 CLOSE"), inside),
        Some(Barred::Closed),
        "a part of it is carried out"
    );
    let same_user = Writer::IntoBuffer(Account { uid: 1000, pid: 9 });
    sent(&mut buffer, "OPEN PROG 10", same_user);
    assert_eq!(
        (buffer.bars(&Meaning::of("X1"), same_user), buffer.bars(&Meaning::of("X1"), ANNE)),
        (None, None)
    );
    for line in ["X1", "P1=5 OPEN PROG 7"] {
        assert!(matches!(buffer.bars(&Meaning::of(line), inside), Some(Barred::Open(_))), "{line}");
    }
}

#[test]
fn rotary_buffers_open_for_binary_lines_shut_nobody_out() {
    let now = Instant::now();
    let stream = sequence(1, false);
    let mut buffer = OpenBuffer::default();
    buffer.see(false, 1);
    sent(&mut buffer, "OPEN BINARY ROTARY", stream);
    assert!(!buffer.is_open() && buffer.standing().info().is_none());
    let others = [ANNE, BOB, sequence(2, false), Writer::Question, Writer::Beside];
    for (line, writer) in
        ["I100=5", "P1", "X10", "#1J+", "GATHER"].into_iter().flat_map(|l| others.map(|w| (l, w)))
    {
        assert_eq!(
            buffer.bars(&Meaning::of(line), writer),
            None,
            "{line}: the board carries it out, or refuses it"
        );
        assert!(!buffer.must_ask(&Meaning::of(line), writer, now));
    }
    // Only one buffer can be open at a time.
    for line in [&b"OPEN PROG 1 CLEAR"[..], b"OPEN ROT", b"CLEAR", b"LEARN"] {
        let Some(Barred::Changes(Some(opened))) = buffer.bars(&Meaning::of(line), BOB) else {
            panic!("{line:?}")
        };
        assert_eq!((&*opened.name, opened.by), ("BINARY ROTARY", stream));
        assert_eq!(buffer.bars(&Meaning::of(line), stream), None);
    }
    assert!(
        buffer.bars(&Meaning::of("CLOSE"), sequence(2, false)).is_some()
            && buffer.bars(&Meaning::of("CLOSE"), BOB).is_none()
    );
    // A stream that goes beside the opener, and may go on after it.
    let stream = Writer::Sequence { number: 1, account: Account { uid: 1001, pid: 2 }, inside: false };
    sent(&mut buffer, "???", stream);
    let barred = buffer.bars(&Meaning::of("OPEN PROG 1"), ANNE).map(|barred| barred.reason(now));
    assert!(barred.as_ref().is_some_and(|text| text.contains("uid 1001 (pid 2)")), "{barred:?}");
    // Without reports: no manual tells the sign of the board's answer then.
    buffer.unsee();
    for size in [-41301, 41301] {
        buffer.learn(Some(size), now);
        assert_eq!(buffer.bars(&Meaning::of("P1=5"), BOB), None);
    }
    // Another host has closed the rotary buffers and opened a program.
    buffer.see(true, 60);
    assert_eq!(buffer.bars(&Meaning::of("P1=5"), BOB), Some(Barred::Open(None)));
    assert!(buffer.bars(&Meaning::of("CLOSE"), stream).is_some(), "that is not the stream's");
    buffer.see(false, 61);
    assert_eq!(buffer.bars(&Meaning::of("OPEN PROG 1"), BOB), None);
}

#[test]
fn whoever_closes_them_or_could_not_open_them_has_no_rotary_buffers_open_for_binary_lines() {
    for end in ["CLOSE", "$$$"] {
        let mut buffer = OpenBuffer::default();
        sent(&mut buffer, "OPEN BIN ROT", sequence(1, false));
        assert!(buffer.has_binary());
        sent(&mut buffer, end, BOB);
        assert!(!buffer.has_binary() && buffer.bars(&Meaning::of("OPEN PROG 1"), ANNE).is_none(), "{end}");
    }
    for error in [3, IN_USE] {
        let mut buffer = OpenBuffer::default();
        buffer.begin(&Meaning::of("OPEN BINARY ROTARY"), sequence(1, false), Instant::now());
        buffer.refused(&Meaning::of("OPEN BINARY ROTARY"), error);
        assert!(!buffer.has_binary());
        assert!(
            buffer.must_ask(&Meaning::of("OPEN ROT"), sequence(1, false), Instant::now()),
            "something may be open"
        );
    }
}
