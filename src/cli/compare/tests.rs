//! Differences of recordings.

use super::*;
use crate::map::functions::response;
use crate::map::{HostOffset, PMAC};
use crate::recording::testing::recording;
use crate::recording::{Access, Answer, Image, Op};

/// A board that updates its servo report each `cycles` servo cycles of 400 us, and acknowledges a line as `order` says.
fn board(cycles: u64, order: &[(char, HostOffset, u16)]) -> Recording {
    let mut recording = recording();
    recording.variables = Some("I10=3713991\nP1=2\nM1->Y:$FFC2,8\n".to_owned());
    recording.answers =
        vec![Answer { line: "LIST PC".to_owned(), reply: vec!["P1".to_owned()], refused: None }];
    let status = PMAC.servo.pmac_status.word;
    let mut add = |t_ns, op, offset, value: u16| {
        let op = if op == 'r' { Op::Read } else { Op::Write };
        recording.accesses.push(Access { t_ns, op, offset, width: 16, value: value.into() });
    };
    for update in 1..20 {
        add(update * cycles * 400_000, 'r', status, (update * cycles) as u16);
    }
    for (op, offset, value) in order {
        add(100_000_000, *op, *offset, *value);
    }
    recording
}

fn found(first: &Recording, second: &Recording) -> Vec<String> {
    let found = differences(first, Path::new("."), second).unwrap();
    found
        .into_iter()
        .map(|Difference { kind, what, first, second }| format!("{kind} {what}: {first} / {second}"))
        .collect()
}

fn acknowledged() -> Vec<(char, HostOffset, u16)> {
    let port = &PMAC.ascii;
    vec![
        ('w', port.command_loaded.word, 1),
        ('r', port.command_loaded.word, 0),
        ('r', port.response_control, response::LINE),
        ('w', port.response_control, 0),
        ('r', port.response_control, response::LINE),
        ('w', port.response_control, 0),
        ('r', port.response_control, response::ACKNOWLEDGE),
        ('w', port.response_control, 0),
    ]
}

#[test]
fn e6_two_recordings_of_one_board_have_no_difference() {
    let order = acknowledged();
    let mut one = board(2, &order);
    let other = board(2, &order);
    assert_eq!(found(&one, &other), [""; 0]);
    one.about.board_type = Some("PMAC1".to_owned());
    one.about.firmware = Some("1.16B".to_owned());
    one.answers.push(Answer { line: "TYPE".to_owned(), reply: vec!["PMAC1".to_owned()], refused: None });
    assert_eq!(found(&one, &other), [""; 0], "who the board is stands apart");
}

#[test]
fn e6_each_kind_of_difference_is_told() {
    let order = acknowledged();
    let one = board(2, &order);
    let late: Vec<_> = [0, 2, 1, 3, 6, 7].map(|at| order[at]).to_vec();
    let mut other = board(1, &late);
    other.variables = Some("I10=3713991\nP1=2.0\nM1->Y:$FFC2,9\nQ1=1\n".to_owned());
    other.answers[0].reply = vec!["P2".to_owned()];
    let image = |t_ns, value| {
        let mut words = vec![0; PMAC.length as usize / 2];
        words[PMAC.background.blocks.first.word()] = value;
        Image { t_ns, words }
    };
    other.images = vec![image(0, 0), image(1, 9)];
    assert_eq!(
        found(&one, &other),
        [
            "answer `LIST PC`: P1 / P2",
            "variable M1->: Y:$FFC2,8 / Y:$FFC2,9",
            "words background: writes none / writes 1",
            "update servo cycles from one update to the next: 2 / 1",
            "handshake line: line, command flag cleared, reply line, <ACK> / not seen",
            "handshake line: not seen / line, reply line, command flag cleared, <ACK>",
        ]
    );
}

#[test]
fn e6_a_capture_without_a_trace_says_nothing_of_what_the_board_writes() {
    let one = board(2, &acknowledged());
    let mut other = board(2, &acknowledged());
    other.accesses.clear();
    assert_eq!(found(&one, &other), [""; 0]);
}

/// Somebody watches a register on the one and not on the other.
#[test]
fn e6_what_clients_have_asked_for_is_no_difference() {
    let (mut one, other) = (board(2, &acknowledged()), board(2, &acknowledged()));
    let image = |t_ns, value| {
        let mut words = vec![0; PMAC.length as usize / 2];
        words[PMAC.variable_read.timer.word()] = value;
        Image { t_ns, words }
    };
    one.images = vec![image(0, 0), image(1, 9)];
    assert_eq!(Seen::of(&one, &PMAC).words["variables"], 1);
    assert_eq!(found(&one, &other), [""; 0]);
}

/// A board whose servo cycle takes 400 us, whose updates are seen as late as `late_ns` tells by their number.
fn seen_late(cycle_ns: u64, late_ns: impl Fn(u64) -> u64) -> Recording {
    let mut recording = recording();
    for update in 1..500 {
        let t_ns = update * cycle_ns + late_ns(update);
        let value = update as u32;
        let offset = PMAC.servo.pmac_status.word;
        recording.accesses.push(Access { t_ns, op: Op::Read, offset, width: 16, value });
    }
    recording
}

#[test]
fn e6_a_machine_that_looks_late_is_no_difference_in_the_servo_period() {
    let on_time = seen_late(400_000, |_| 0);
    // Held up for 5 ms at each tenth update: most periods are longer than they should be.
    let late = seen_late(400_000, |update| update / 10 * 5_000_000 / 2 + u64::from(update % 3 == 0) * 90_000);
    assert_eq!(found(&on_time, &late), [""; 0]);
    let slower = seen_late(440_000, |update| u64::from(update % 3 == 0) * 90_000);
    let told = found(&on_time, &slower).join("\n");
    assert!(told.starts_with("update servo period: 400.00 to 400.00 us / 43"), "{told}");
}

#[test]
fn e6_variables_that_cannot_be_read_are_no_agreement() {
    let (one, mut other) = (board(2, &acknowledged()), board(2, &acknowledged()));
    other.variables = Some("I10=3713991\nP1=\n".to_owned());
    let Err(Failure::Request(why)) = differences(&one, Path::new("."), &other) else {
        panic!("told as equal");
    };
    assert!(why.starts_with("variables.pmc:2: ") && why.ends_with("no variable can be compared"), "{why}");
}
