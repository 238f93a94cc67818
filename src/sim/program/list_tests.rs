//! Listings of programs: the board's listing of any program downloads again, to the same listing.

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

use crate::sim::board::turbo;
use crate::sim::testing::Bench;

fn board() -> Bench {
    Bench::of(&turbo::TURBO2, turbo::TURBO2.firmware)
}

fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        (0..10_000_u32).prop_map(|number| number.to_string()),
        (0..0x100_0000_u32).prop_map(|number| format!("${number:X}")),
        (-1_000_000..1_000_000_i32).prop_map(|number| format!("{}", f64::from(number) / 1000.0)),
        Just(".5".to_owned()),
        Just("-7.".to_owned()),
    ]
}

fn variable() -> impl Strategy<Value = String> {
    let plain = ("[IPQM]", 0..8192_u32).prop_map(|(letter, number)| format!("{letter}{number}"));
    let computed = ("[IPQM]", 0..100_u32).prop_map(|(letter, number)| format!("{letter}(P{number}*100+1)"));
    prop_oneof![3 => plain, 1 => computed]
}

fn expression() -> impl Strategy<Value = String> {
    let leaf = prop_oneof![number(), variable()];
    leaf.prop_recursive(3, 12, 2, |inner| {
        let operator = prop_oneof!["[-+*/%&|^]", Just(" + ".to_owned()), Just(" & ".to_owned())];
        prop_oneof![
            (inner.clone(), operator, inner.clone()).prop_map(|(one, sign, other)| one + &sign + &other),
            ("(SIN|ATAN2|ABS|INT|SQRT)", inner.clone())
                .prop_map(|(function, inner)| format!("{function}({inner})")),
            inner.prop_map(|inner| format!("( {inner} )")),
        ]
    })
}

/// A constant, or an expression in parentheses.
fn data() -> impl Strategy<Value = String> {
    prop_oneof![number(), expression().prop_map(|text| format!("({text})"))]
}

fn condition() -> impl Strategy<Value = String> {
    let simple = (expression(), "(=|!=|>|!>|<|!<|~|!~)", expression());
    let simple = simple.prop_map(|(one, sign, other)| format!("{one}{sign}{other}")).boxed();
    (simple.clone(), prop::option::of(("( AND | OR )", simple))).prop_map(|(one, more)| match more {
        Some((joint, other)) => one + &joint + &other,
        None => one,
    })
}

/// Statements that both kinds of program hold.
fn common() -> impl Strategy<Value = String> {
    prop_oneof![
        4 => (variable(), expression()).prop_map(|(variable, value)| format!("{variable}={value}")),
        1 => ("(ENABLE|DIS) ?PLCC? ?", "(1|0,2|3\\.\\.7|1,3\\.\\.5,31)").prop_map(|(word, list)| word + &list),
        1 => ("(CMD|COMMAND|SEND)[SPRA]?", "[A-Za-z0-9 #&;,$=+-]{0,20}").prop_map(|(word, text)| format!("{word}\"{text}\"")),
        1 => "(CMD|COMMAND)\\^[ABKX]".prop_map(|text| text),
        1 => Just("MSW16,MI124,P1".to_owned()),
    ]
}

fn motion() -> impl Strategy<Value = String> {
    prop_oneof![
        "(LINEAR|RPD|CIRCLE1|CIR2|SPLINE1|SPLINE 2|TINIT|STOP|BSTART|BSTOP|PSET|CC0|CC2|ABS|INC|FRAX|ABS\\(X,Y\\)|INC\\(A\\)|FRAX\\(X,Z\\))",
        ("[ABCXYZUVW]", data(), prop::option::of(("[:^]", data()))).prop_map(|(axis, to, mark)| match mark {
            Some((mark, value)) => axis + &to + &mark + &value,
            None => axis + &to,
        }),
        ("(F|TA|TS|TM|DWELL|DLY|CALL|CCR|TSEL|ADIS|IROT|I|J|K|R|S|G|T|D|PVT|GOTO|GOSUB|E|H)", data())
            .prop_map(|(word, value)| word + &value),
        ("(HOME|HMZ) ?", "(1|1,32|3\\.\\.7)").prop_map(|(word, list)| word + &list),
        ("M[0-9]{1,4}(==|&=|\\|=|\\^=)", expression()).prop_map(|(place, value)| place + &value),
        Just("READ(A,B)".to_owned()),
        Just("RETURN".to_owned()),
        Just("NORMAL K-1".to_owned()),
    ]
}

/// A line of `statement`s, or a block of lines between a condition and its end.
fn lines(statement: BoxedStrategy<String>) -> impl Strategy<Value = Vec<String>> {
    let line = prop::collection::vec(statement, 1..4).prop_map(|parts| vec![parts.join(" ")]);
    let block = line.prop_recursive(2, 10, 3, |inner| {
        let inside = prop::collection::vec(inner, 0..3).prop_map(|parts| parts.concat());
        (condition(), any::<bool>(), inside.clone(), inside).prop_map(|(condition, turns, inside, other)| {
            let first = format!("{} ({condition})", if turns { "WHILE" } else { "IF" });
            let other = if turns { Vec::new() } else { [vec!["ELSE".to_owned()], other].concat() };
            let end = if turns { "ENDWHILE" } else { "ENDIF" };
            [vec![first], inside, other, vec![end.to_owned()]].concat()
        })
    });
    prop::collection::vec(block, 1..5).prop_map(|blocks| blocks.concat())
}

/// Enters `lines`; how many were taken.
fn enter(bench: &mut Bench, name: &str, lines: &[String]) -> usize {
    let opened = bench.world.execute(format!("OPEN {name} CLEAR").as_bytes());
    assert_eq!(opened.error, None);
    let taken = lines.iter().filter(|line| bench.world.execute(line.as_bytes()).error.is_none()).count();
    assert_eq!(bench.world.execute(b"CLOSE").error, None);
    taken
}

#[test]
fn what_is_listed_of_any_program_downloads_to_the_same_listing() {
    let bench = RefCell::new(board());
    let plc = lines(common().boxed()).prop_map(|lines| ("PLC 3", lines));
    let program = lines(prop_oneof![common(), motion()].boxed()).prop_map(|lines| ("PROG 7", lines));
    let cases = (prop_oneof![plc, program], 2..4_u32);
    let mut runner = TestRunner::new(Config { cases: 300, failure_persistence: None, ..Config::default() });
    let outcome = runner.run(&cases, |((name, lines), form)| {
        let mut bench = bench.borrow_mut();
        bench.set(9, form.into());
        let list = format!("LIST {name}");
        let taken = enter(&mut bench, name, &lines);
        prop_assert_eq!(taken, lines.len(), "the board takes every line");
        let listed = bench.world.execute(list.as_bytes()).lines;
        let size = bench.world.execute(b"SIZE").lines;
        prop_assert_eq!(
            enter(&mut bench, name, &listed),
            listed.len(),
            "and every line that it lists: {:?}",
            listed
        );
        prop_assert_eq!(bench.world.execute(list.as_bytes()).lines, listed);
        prop_assert_eq!(bench.world.execute(b"SIZE").lines, size, "it takes as much room");
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn a_hex_number_ends_before_the_word_behind_it() {
    let mut bench = board();
    for line in [
        "I5=2 P1=15 P2=1",
        "OPEN PLC 1 CLEAR",
        "IF (P1=$F AND P2=1)",
        "P3=P1&$C",
        "ENDIF",
        "CLOSE",
        "ENABLE PLC 1",
    ] {
        assert_eq!(bench.world.execute(line.as_bytes()).error, None, "{line}");
    }
    bench.run(3);
    assert_eq!(bench.world.execute(b"P3").lines, ["12"]);
    assert_eq!(bench.world.execute(b"LIST PLC 1").lines[0], "IF(P1=$F ANDP2=1)");
}
