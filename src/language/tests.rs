//! The meaning of lines: the table, and cases that no table can hold.

use std::fmt::Write as _;
use std::time::Duration;

use proptest::prelude::*;

use super::lexer::{Does, Kind, tokens};
use super::number::Numbers;
use super::settings::CutsOff;
use super::*;
use crate::map::Motors;

/// A line, a tab, and its meaning, as [`told`] tells it.
const TABLE: &str = include_str!("../../tests/data/line_meanings.tsv");

/// The fields of a meaning that differ from an empty line's.
fn told(meaning: &Meaning) -> String {
    let mut told = String::new();
    let mut tell = |name: &str, what: String| {
        if !what.is_empty() {
            let _ = write!(told, "{}{name}{what}", if told.is_empty() { "" } else { "; " });
        }
    };
    let flag = |name: &str, is: bool| if is { format!("{name} ") } else { String::new() };
    let numbers = |numbers: u32| match numbers {
        0 => String::new(),
        u32::MAX => " all".to_owned(),
        numbers => format!(" {}", Motors::from_bits(numbers)),
    };
    let jogs = |jogs: Jogs| numbers(jogs.motors.bits()) + if jogs.unnamed { " unnamed" } else { "" };
    let WhileOpen { enters, changes, acts, may_act } = meaning.while_open;
    let while_open =
        flag("enters", enters) + &flag("changes", changes) + &flag("acts", acts) + &flag("may-act", may_act);
    let does = flag("may-move", meaning.may_move)
        + &flag("may-start", meaning.may_start_program)
        + &flag("lets-programs-move", meaning.lets_programs_move)
        + &flag("stops", meaning.stops)
        + &flag("resets", meaning.resets)
        + &flag("saves", meaning.saves)
        + &flag("defines-m", meaning.defines_m)
        + &flag("asks", meaning.only_asks_for_variables)
        + &flag("password", meaning.has_password)
        + &flag("by-address", meaning.goes_by_address)
        + &flag("close", meaning.is_close);
    tell("", does.trim_end().to_owned());
    tell("moves", numbers(meaning.moves.bits()));
    tell("jogs", jogs(meaning.jogs));
    tell("jogs if refused", jogs(meaning.jogs_if_refused));
    tell("starts", numbers(meaning.starts.bits()));
    tell("points elsewhere", numbers(meaning.points_elsewhere.bits()));
    tell("aborts", numbers(meaning.aborts.bits()));
    tell("takes away", numbers(meaning.takes_away.bits()));
    tell("clears", numbers(meaning.clears.bits()));
    if let Some(ends) = meaning.ends() {
        tell("ends ", format!("[{}]{}", ends.what, if ends.unnamed { " unnamed" } else { "" }));
        tell("ends motors", numbers(ends.motors.bits()));
        tell("ends systems", numbers(ends.systems.bits()));
    }
    match meaning.buffer {
        Some(Effect::Opens(name)) => tell("opens ", format!("[{name}]")),
        Some(Effect::OpensBinary) => tell("opens", " binary".to_owned()),
        Some(Effect::Closes) => tell("closes", " ".to_owned()),
        None => {}
    }
    tell("while open: ", while_open.trim_end().to_owned());
    if meaning.settings.any {
        let low: Vec<_> =
            (0..64).filter(|number| meaning.settings.has(*number)).map(|i| i.to_string()).collect();
        let low = if low.len() > 3 { "many".to_owned() } else { low.join(" ") };
        tell("sets", format!(" {low}{}", if meaning.settings.several { " and several" } else { "" }));
    }
    if meaning.settings.cuts_off != CutsOff::No {
        tell("cuts off", format!(" {:?}", meaning.settings.cuts_off));
    }
    let deadline = meaning.deadline(deadlines::PLAIN);
    if deadline != deadlines::PLAIN {
        tell("deadline ", format!("{deadline:?}"));
    }
    told
}

#[test]
fn each_line_means_what_the_table_says() {
    let rows = TABLE.lines().filter_map(|row| row.split_once('\t'));
    let wrong: Vec<_> = rows.filter(|(line, meaning)| told(&Meaning::of(line)) != *meaning).collect();
    let is: Vec<_> = wrong.iter().map(|(line, _)| format!("{line}\t{}", told(&Meaning::of(line)))).collect();
    assert!(wrong.is_empty(), "the table says\n{wrong:#?}\nbut it is\n{}", is.join("\n"));
    assert!(TABLE.lines().count() > 500);
}

fn kinds(line: &str) -> Vec<Kind> {
    tokens(line.as_bytes()).map(|token| token.kind).collect()
}

#[test]
fn a_variable_is_read_with_its_number_and_its_value() {
    use Numbers::{One, Range, Unknown};
    let read = |line: &str| match kinds(line)[..] {
        [Kind::Variables(_, numbers, Does::Sets { value, .. })] => (numbers, value),
        ref other => panic!("{line}: {other:?}"),
    };
    for (line, numbers, value) in [
        ("I58=0", One(58), Some(0)),
        (" i 5 8 = 1 ", One(58), Some(1)),
        ("I50..60=0", Range(50, 60, 1), Some(0)),
        ("I108,8,100=96", Range(108, 808, 100), Some(96)),
        ("I1,2=3", Range(1, 2, 1), Some(3)),
        ("I(P1+(2))=7", Unknown, Some(7)),
        ("I58=$0", One(58), Some(0)),
        ("I58=P1", One(58), None),
        ("I58=1&0", One(58), Some(0)),
        ("I2=1.0", One(2), Some(1)),
        ("I2=1.5", One(2), None),
        ("I3=*", One(3), None),
        ("I(57+1)=0", One(58), Some(0)),
        ("I( 60 - 2 )=0", One(58), Some(0)),
        ("I(29*2)=0", One(58), Some(0)),
        ("I(2+7*8)=0", One(58), Some(0)),
        ("I((2+5)*8+2)=0", One(58), Some(0)),
        ("I($3A)=0", One(58), Some(0)),
        ("I(-5+63)=0", One(58), Some(0)),
        ("I(116/2)=0", One(58), Some(0)),
        ("I(158%100)=0", One(58), Some(0)),
        ("I(63&58)=0", One(58), Some(0)),
        ("I(50|8)=0", One(58), Some(0)),
        ("I(59^1)=0", One(58), Some(0)),
        ("I(SQRT(3364))=0", One(58), Some(0)),
        ("I(INT(58.5))=0", One(58), Some(0)),
        ("I(ABS(-58))=0", One(58), Some(0)),
        ("I8250=0", One(58), Some(0)),
        ("I(8192+58)=0", One(58), Some(0)),
        ("I(58-8192)=0", One(58), Some(0)),
        ("I(57.6)=0", Range(57, 58, 1), Some(0)),
        ("I(50)..60=0", Range(50, 60, 1), Some(0)),
        ("I50..(50+9)=0", Range(50, 59, 1), Some(0)),
        ("I(48),2,(9+1)=0", Range(48, 58, 10), Some(0)),
        ("I(P1*0+58)=0", Unknown, Some(0)),
        ("I(Q(5)+1)=0", Unknown, Some(0)),
        ("I(SIN(3))=0", Unknown, Some(0)),
        ("I(1/0)=0", Unknown, Some(0)),
        ("I50..(P1)=0", Unknown, Some(0)),
        ("P1=ATAN2(1)+SQRT(4)%3", One(1), None),
    ] {
        assert_eq!(read(line), (numbers, value), "{line}");
    }
    assert!(Range(8200, 8260, 1).has(58) && !Range(8200, 8249, 1).has(58), "a Turbo board begins again at 0");
    assert!(Range(0, u32::MAX, 1).has(58) && !Range(60, 50, 1).has(58));
    let range = Range(108, 808, 100);
    assert!(range.has(208) && range.has(808) && !range.has(209) && !range.has(908) && !Unknown.has(1));
    let deep = format!("I{}58{}=0", "(".repeat(100_000), ")".repeat(100_000));
    assert_eq!(read(&deep), (Unknown, Some(0)), "and asks for no more than a part of the stack");
    // A variable of a MACRO station, of a comparison or in quotation marks is none of the board's.
    for line in ["MS0,I58=0 ms 16 , i 58 = 0 MSI58=0", "MI58=0", "IF(I58=0)", "SEND\"I58=0\"", "I58", "P58=0"]
    {
        assert!(!Meaning::of(line).settings.any, "{line}");
    }
    for line in ["M0,I58=0", "MS,I58=0", "#8KI58=0", "#1HMI58=0", "&1SI58=0", "FOO I58=0", "P1=SIN I58=0"] {
        assert_eq!(Meaning::of(line).settings.cuts_off, CutsOff::Enable, "{line}");
    }
}

#[test]
fn a_line_that_asks_for_many_values_has_a_longer_deadline() {
    for (line, seconds) in
        [("I0..999", 25), ("P1..0", 5), ("P0..4294967295", 60), ("SAVE $$$", 60), ("LIST", 60)]
    {
        assert_eq!(Meaning::of(line).deadline(deadlines::PLAIN).as_secs(), seconds, "{line}");
    }
    let patient = Duration::from_secs(300);
    assert_eq!(["LIST", "P0..9"].map(|line| Meaning::of(line).deadline(patient)), [patient; 2]);
}

proptest! {
    #[test]
    fn any_line_is_cut_in_order_and_to_its_end(line in "[ -~]{0,80}") {
        let mut end = 0;
        for token in tokens(line.as_bytes()) {
            prop_assert!(line[end..token.span.start].bytes().all(|byte| byte == b' '));
            prop_assert!(token.span.end > token.span.start);
            end = token.span.end;
        }
        prop_assert!(line[end..].trim().is_empty());
        prop_assert_eq!(Meaning::of(line.to_ascii_lowercase()), Meaning::of(line.to_ascii_uppercase()));
    }
}
