//! What the EPICS `pmac` driver asks at its start and in its polls, as it asks it: many questions in a row, one blank before the first,
//! the answers told apart by their places alone.

use super::site::{Client, Site, packet};

/// The form of an answer.
#[derive(Debug, Clone, Copy)]
enum Form {
    Is(&'static str),
    Word,
    Whole,
    Number,
    /// A number by which the driver divides.
    NotZero,
    /// So many hexadecimal digits.
    Digits(usize),
}

impl Form {
    fn fits(self, answer: &str) -> bool {
        let hexadecimal = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        match self {
            Self::Is(text) => answer == text,
            Self::Word => !answer.is_empty() && answer.bytes().all(|byte| byte.is_ascii_alphanumeric()),
            Self::Whole => answer.strip_prefix('$').map_or(answer.parse::<i64>().is_ok(), hexadecimal),
            Self::Number => answer.parse::<f64>().is_ok(),
            Self::NotZero => answer.parse::<f64>().is_ok_and(|number| number != 0.0),
            Self::Digits(count) => answer.len() == count && hexadecimal(answer),
        }
    }
}

/// A driver's port: flush, GETRESPONSE, and where a reply is longer, READREADY and GETBUFFER.
fn ask(client: &mut Client, line: &str) -> Vec<String> {
    assert_eq!(client.request(0x40, 0xB3, 0, 0), b"@", "FLUSH");
    let mut reply = client.line(line).into_bytes();
    while reply.last() != Some(&6) {
        assert_ne!(client.request(0xC0, 0xC2, 0, 2), [0, 0], "{line}: {reply:?}");
        reply.extend(client.get_buffer());
    }
    let text = String::from_utf8(reply).unwrap();
    text.trim_end_matches('\x06').split_terminator('\r').map(str::to_owned).collect()
}

/// Asks `questions` as the driver does, so many in a row, and looks at each answer.
fn check(client: &mut Client, questions: &[(String, Form)]) {
    const ROW: usize = 40;
    for row in questions.chunks(ROW) {
        let line: String = row.iter().map(|(question, _)| format!(" {question}")).collect();
        let answers = ask(client, &line);
        assert_eq!(answers.len(), row.len(), "{line}: {answers:?}");
        for ((question, form), answer) in row.iter().zip(&answers) {
            assert!(form.fits(answer), "{question} is answered {answer:?}, which is no {form:?}");
        }
    }
}

/// What a site has on its board for the driver: where the processor's times are, as in its `BRICK_M_variables.pmc`, and a motion
/// program. A real board fills the times in; on a simulated one nothing takes any.
const SITE: [&str; 9] = [
    "M70->X:$FFFF8C,0,24 M71->X:$37,0,24",
    "M72->Y:$37,0,24 M73->X:$B,0,24",
    "M70=2400 M71=120 M72=300 M73=500",
    "&2#2->1000X",
    "#2J/",
    "OPEN PROG 10 CLEAR",
    "DWELL1",
    "CLOSE",
    "#1&1",
];

#[test]
fn the_epics_drivers_questions_are_answered_in_their_forms() {
    const CARD: &str = "602413";
    let site = Site::of("turbo2", &[]);
    for line in SITE {
        site.ask(line);
    }
    let mut client = site.client();
    assert_eq!(client.line("I3=2 I6=1"), "\x06");
    // One by one: the card, its processor, how many coordinate systems there are.
    let single = [("cid", Form::Is(CARD)), ("cpu", Form::Word), ("I68", Form::Whole)];
    for (question, form) in single {
        let answers = ask(&mut client, question);
        assert!(matches!(&answers[..], [answer] if form.fits(answer)), "{question}: {answers:?}");
    }
    let mut fast = vec![("???".to_owned(), Form::Digits(12))];
    let mut medium = Vec::new();
    for variable in ["M70", "M71", "M72", "M73"] {
        fast.push((variable.to_owned(), Form::NotZero));
    }
    for variable in ["M4034", "M4039", "M4040", "M4038"] {
        fast.push((variable.to_owned(), Form::Number));
    }
    for motor in 1..=32 {
        fast.push((format!("#{motor}?"), Form::Digits(12)));
        fast.push((format!("#{motor}P"), Form::Number));
        fast.push((format!("#{motor}F"), Form::Number));
        fast.push((format!("i{motor}24"), Form::Whole));
    }
    for system in 1..=16 {
        fast.push((format!("&{system}??"), Form::Digits(18)));
        fast.push((format!("&{system}Q81"), Form::Number));
        medium.push((format!("&{system}%"), Form::Number));
        for motor in [1, 8, 32] {
            medium.push((format!("&{system}#{motor}->,"), Form::Is("0")));
        }
    }
    let numbers = (5000..5032).chain((0..16).map(|program| 5180 + 100 * program));
    // Inputs and outputs, on each kind of board elsewhere.
    let outputs = (0..8).flat_map(|bit| [1, 33, 7716, 7740, 7616, 7640].map(|first| first + bit));
    for number in numbers.chain(outputs) {
        medium.push((format!("M{number}"), Form::Number));
    }
    let slow = ["I42", "I8", "I7002", "M4037", "M4041", "M4042", "M4049"];
    let slow: Vec<_> = slow.map(|question| (question.to_owned(), Form::Whole)).into();
    for _ in 0..2 {
        check(&mut client, &fast);
        check(&mut client, &medium);
        check(&mut client, &slow);
    }
    let motors: Vec<_> =
        ["I113", "I114", "I130", "I131", "I133"].map(|question| (question.to_owned(), Form::Number)).into();
    check(&mut client, &motors);
    // What it does when it moves and stops, and a trajectory's points.
    let moves = [
        "I122=32 I120=100 #1 J=100.00",
        "#1 J/ M140=1",
        "&2Q72=5 Q70=0.000000 B10R",
        "&1A Q71=Q81",
        "#1K",
        "WL:$10700,$123456,$1",
    ];
    for line in moves {
        assert_eq!(client.line(line), "\x06", "{line}");
    }
    assert_eq!(client.line("UUU"), "\x07ERR003\r");
    // Control characters by their request; the reply has no end of its own.
    let report = client.ask(&packet(0xC0, 0xC4, 0x10, 0, 0, &[]));
    assert!(report.ends_with(b"\r"), "^P: {report:?}");
    assert_eq!(ask(&mut client, "cid"), [CARD]);
}
