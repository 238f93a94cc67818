//! Which lines only ask.

use super::*;
use proptest::prelude::*;

fn kinds(line: &str) -> Vec<Kind> {
    of(line).into_iter().map(|token| token.kind).collect()
}

fn only_asks(line: &str) -> bool {
    of(line).iter().all(Token::only_asks)
}

#[test]
fn d2_what_stands_behind_a_question_is_a_command_of_its_own() {
    for line in [
        "#1LISTLINKHM",
        "#1LISTLINKK",
        "&1LISTPCR",
        "&1LISTPCA",
        "&1LIST PROG1 S",
        "LISTLINKSAVE",
        "LISTLINKENAPLC1",
        "LISTLINKUNDEFINE",
        "LISTLINKOPENPROG3",
        "LIST HM",
        "LISTS",
        "LIST PROG 1,S",
        "#1RX$0,1$",
        "&1RX$0,1B2",
        "&1RX$0,1A",
        "&1RX$0,R",
        "RX$0000000A",
        "&1RX:1A",
        "&1R",
        "&1RXA",
    ] {
        assert!(!only_asks(line), "{line}");
    }
    for line in [
        "LIST",
        "LIST PROG 1,10,5",
        "LISTPLC3",
        "LIST TCOMP DEF",
        "LIST PC,,5",
        "RX$078000,12",
        "RHY:$700",
        "RL$D200,2 P1",
    ] {
        assert!(only_asks(line), "{line}");
    }
}

#[test]
fn a_list_needs_an_address_only_where_it_is_somebodys() {
    for (needs, lines) in [
        (Needs::Nothing, &["LIST PROG 7", "list plc3,0,2", "LISTPLCC1", "LIST LINK", "LIST GATHER 0,5"][..]),
        (Needs::Motor, &["LIST COMP", "LIST TCOMP DEF", "LISTBLCOMP"]),
        (Needs::System, &["LIST", "LIST PC,,5", "LIST ROT", "LIST FORWARD"]),
    ] {
        for line in lines {
            assert_eq!(kinds(line), [Kind::Asks(needs)], "{line}");
        }
    }
}

#[test]
fn what_clients_poll_only_asks() {
    for line in [
        "i65???&1??%#1?PVF m190 p99#2?PVF m290 p99",
        "#1P ??? #2P #4F ",
        "&1#1->,",
        "&1%",
        "#1->#2->",
        "i20 i21 i22 i23",
        "cid ver cpu type vid date time today",
        "VERSION DATE TYPE",
        "I122",
        "#3?",
        "m5000..5031",
        "&1q1..199",
        "m1..5->",
        "list forward,s,80",
        "list plc3,0,2 list gather",
        "ms0,i910",
        "RX$0 RHY:$700,2 RL$700",
        "?? ???",
        "P",
        "#1",
        "# & ## &&",
        "PR PC",
        "",
    ] {
        assert!(only_asks(line), "{line}: {:?}", kinds(line));
    }
}

#[test]
fn what_does_anything_else_does_not() {
    for line in [
        "#1J+",
        "#1 j =5000",
        "P1=3",
        "P 1 = 3",
        "P1==3",
        "P(1)=3",
        "i6=1 i3=2 ver",
        "#1->X",
        "#1-> 1000X",
        "M1->X:$700",
        "M1->*",
        "M1-> X:$700",
        "&1B1R",
        "&1R",
        "#1K",
        "#1$",
        "$$$",
        "SAVE",
        "OPEN PROG 1 CLEAR",
        "%50",
        "##1",
        "& 1 % 50",
        "WX$700,1",
        "HOME",
        "#1HMZ",
        "#1O10",
        "ENABLE PLC 1",
        "GATHER",
        "ms0,i910=3",
        "MSCLRF0",
        "TYPEX",
        "F100",
        "PMATCH",
        "PASSWORD=x",
        "A",
        "Z",
        "????",
        "I",
        "I3..",
        "date=1",
        "time=12:00",
        "\"P1\"",
    ] {
        assert!(!only_asks(line), "{line}: {:?}", kinds(line));
    }
}

#[test]
fn a_clients_own_variables_are_found_with_their_values() {
    use Kind::{Sets, Variables, Version};
    let set = |first, last, value| Kind::SetsI(SetsI { first, last, step: 1, value, needs: Needs::Nothing });
    assert_eq!(kinds("i6=1 i3=2 ver"), [set(6, 6, Some(1)), set(3, 3, Some(2)), Version]);
    assert_eq!(kinds("I3=I3|2"), [set(3, 3, None)]);
    assert_eq!(kinds("I0..9=0"), [set(0, 9, None)]);
    assert_eq!(kinds("I 3 = 2I4=0"), [set(3, 3, Some(2)), set(4, 4, Some(0))]);
    assert_eq!(kinds("P1=I3*2 I3"), [Sets(Needs::Nothing), Variables(3, 3, 1)]);
    assert_eq!(
        kinds("P1=SIN(I3)+3 I0..9 I1,3,2"),
        [Sets(Needs::Nothing), Variables(0, 9, 1), Variables(1, 5, 2)]
    );
    assert_eq!(kinds("SEND\"I3=1\""), [Kind::Unknown]);
    assert_eq!(
        kinds("I122=I122&$FD1 #1J=5"),
        [set(122, 122, None), Kind::Motor(1), Kind::Moves(Needs::Motor)]
    );
}

#[test]
fn an_assignment_needs_a_coordinate_system_where_a_q_variable_is_in_it() {
    let needs = |line: &str| match kinds(line)[..] {
        [Kind::Sets(needs)] => needs,
        [Kind::SetsI(SetsI { needs, .. })] => needs,
        ref other => panic!("{line}: {other:?}"),
    };
    for line in ["Q5=3", "q1..9=0", "P1=Q5", "M1=(2*q(3))+1", "I122=Q1", "P1=SQRT(Q2)"] {
        assert_eq!(needs(line), Needs::System, "{line}");
    }
    for line in ["P1=3", "M1=P1", "I122=$FD1", "P1=SQRT(P2)"] {
        assert_eq!(needs(line), Needs::Nothing, "{line}");
    }
}

#[test]
fn a_write_of_memory_ends_behind_its_last_value() {
    for line in ["WX$700,1", "wy:$28,2,-3 , 4", "WL:$C5FC,$112233445566,1.5,+2", "WX 1792,1"] {
        assert_eq!(kinds(line), [Kind::WritesMemory], "{line}");
    }
    assert_eq!(kinds("WX$700,1 #1J+"), [Kind::WritesMemory, Kind::Motor(1), Kind::Moves(Needs::Motor)]);
    for line in ["WX$700", "WX$700,", "WP$700,1", "WX,1", "WX$700,P1", "W"] {
        assert_eq!(kinds(line), [Kind::Unknown], "{line}");
    }
}

#[test]
fn a_command_stands_where_it_is_said_to() {
    let line = " i6=1  ver #2 J= 50 ";
    let told: Vec<&str> = of(line).into_iter().map(|token| &line[token.span]).collect();
    assert_eq!(told.iter().map(|text| text.trim()).collect::<Vec<_>>(), ["i6=1", "ver", "#2", "J= 50"]);
}

#[test]
fn who_needs_what_is_known() {
    use Kind::{Asks, Moves};
    assert_eq!(kinds("?"), [Asks(Needs::Motor)]);
    assert_eq!(kinds("PVF"), [Asks(Needs::Motor); 3]);
    assert_eq!(kinds("Q1%"), [Asks(Needs::System); 2]);
    assert_eq!(kinds("J/K"), [Moves(Needs::Motor); 2]);
    assert_eq!(kinds("B1RA"), [Moves(Needs::System); 3]);
}

proptest! {
    #[test]
    fn any_line_is_cut_in_order_and_to_its_end(line in "[ -~]{0,80}") {
        let mut end = 0;
        for token in of(&line) {
            prop_assert!(line[end..token.span.start].bytes().all(|byte| byte == b' '));
            prop_assert!(token.span.end > token.span.start);
            end = token.span.end;
        }
        prop_assert!(line[end..].trim().is_empty());
    }
}

#[test]
fn behind_an_unknown_command_the_board_may_go_on() {
    let known =
        |line| of_known(line).into_iter().map(|token| line[token.span].to_owned()).collect::<Vec<_>>();
    assert_eq!(known("#1->2000X &3R#2"), ["#1->2000X ", "&3", "R", "#2"]);
    assert_eq!(known("PSET X5 Q"), ["PSET X5 Q"]);
    assert_eq!(kinds("#1->2000X &3R"), [Kind::Unknown]);
}
