//! Tests of [`super::enable`].

use super::enable::{self, EnableError, EnablePlan, Options};
use crate::map::{Function, PMAC, TURBO2};

fn plan(functions: &[Function], options: &Options) -> Result<EnablePlan, EnableError> {
    enable::plan(functions, options, &PMAC)
}

fn commands(functions: &[Function], options: &Options) -> Vec<String> {
    plan(functions, options).unwrap().commands
}

fn why<'a>(plan: &'a EnablePlan, line: &str) -> &'a str {
    let mut lines = plan.plans.iter().flat_map(|plan| &plan.lines);
    &lines.find(|planned| planned.line == line).unwrap_or_else(|| panic!("no line {line}")).why
}

#[test]
fn each_function_by_itself() {
    let defaults = Options::default();
    let expected: [(Function, &[&str]); 7] = [
        (Function::Ascii, &["I3=2", "I58=1"]),
        (Function::Panel, &["WY$D000,0", "WX$D000,0", "I2=3"]),
        (Function::Servo, &["I19=1", "I59=8", "I48=1", "GATHER"]),
        (Function::Background, &["I59=8", "I49=1"]),
        (Function::Variables, &["WY$D1FB,0", "WY$D1F5,0", "I55=1"]),
        (
            Function::Rotary,
            &[
                "I57=0",
                "WY$D1F9,0",
                "WY$D1FD,0",
                "WX$D1FD,0",
                "&1 DEFINE ROT 100",
                "&1 B0",
                "I57=1",
                "OPEN BINARY ROTARY",
            ],
        ),
        (Function::Gather, &["I19=1", "I45=3", "DEFINE GATHER 1024", "GATHER"]),
    ];
    for (function, lines) in expected {
        assert_eq!(commands(&[function], &defaults), lines, "{function}");
    }
}

#[test]
fn reasons_name_the_side_effects() {
    let plan = plan(&Function::ALL, &Options::default()).unwrap();
    let i58 = why(&plan, "I58=1");
    assert!(i58.contains("I3") && i58.contains("I4=0") && i58.contains("I6=1"), "{i58}");
    assert!(why(&plan, "I2=3").contains("JPAN"));
    assert!(why(&plan, "WY$D1F5,0").contains("watchdog"));
    for line in plan.plans.iter().flat_map(|plan| &plan.lines) {
        assert!(!line.why.is_empty(), "{}", line.line);
    }
}

#[test]
fn together_they_share_settings_and_keep_to_an_order() {
    let options = Options { motors: 4, period: 2, save: true, ..Options::default() };
    // Typed in any order, and twice.
    let typed = [Function::Gather, Function::Background, Function::Servo, Function::Rotary, Function::Servo];
    let lines = commands(&typed, &options);
    assert_eq!(
        lines,
        [
            "I19=2",
            "I59=4",
            "I48=1",
            "I49=1",
            "I57=0",
            "WY$D1F9,0",
            "WY$D1FD,0",
            "WX$D1FD,0",
            "I45=3",
            "SAVE",
            "&1 DEFINE ROT 100",
            "&1 B0",
            "DEFINE GATHER 1024",
            "GATHER",
            "GATHER",
            "I57=1",
            "OPEN BINARY ROTARY"
        ]
    );
}

#[test]
fn gather_beside_servo_needs_a_second_gather() {
    let defaults = Options::default();
    let both = plan(&[Function::Servo, Function::Gather], &defaults).unwrap();
    assert_eq!(both.commands.iter().filter(|line| *line == "GATHER").count(), 2);
    assert!(both.plans[1].lines.last().unwrap().why.contains("second"));
    let alone = plan(&[Function::Gather], &defaults).unwrap();
    assert!(alone.plans[0].notes.iter().any(|note| note.contains("I48=1") && note.contains("once more")));
}

#[test]
fn options_reach_the_lines() {
    let options = Options {
        interrupt: true,
        coordinate_system: 2,
        rotary_words: 200,
        gather_longs: 100,
        gather_wrap: false,
        gather_sources: ["D:$002B", "Y:$C003"].map(|text| text.parse().unwrap()).to_vec(),
        ..Options::default()
    };
    assert_eq!(commands(&[Function::Ascii], &options), ["I3=2", "I58=1", "I56=1"]);
    let gather = plan(&[Function::Gather], &options).unwrap();
    assert_eq!(
        gather.commands,
        ["I19=1", "I45=2", "I20=$000003", "I21=$80002B", "I22=$00C003", "DEFINE GATHER 100", "GATHER"]
    );
    // 3 longs a sample: 100 becomes 102.
    assert!(gather.plans[0].notes.iter().any(|note| note.contains("102 longs")));
    assert!(commands(&[Function::Rotary], &options).contains(&"&2 DEFINE ROT 200".to_owned()));
}

#[test]
fn impossible_options_are_refused_with_their_range() {
    let refused = |function, options| plan(&[function], &options).unwrap_err().to_string();
    let defaults = Options::default;
    assert_eq!(
        refused(Function::Servo, Options { motors: 9, ..defaults() }),
        "motor 9 is not possible; it is 1 to 8"
    );
    assert!(refused(Function::Background, Options { motors: 0, ..defaults() }).contains("1 to 8"));
    assert!(refused(Function::Servo, Options { period: 0, ..defaults() }).contains("1 to 8388607"));
    assert!(refused(Function::Gather, Options { gather_longs: 3585, ..defaults() }).contains("1 to 3584"));
    let wide = Options {
        gather_longs: 3584,
        gather_sources: ["D:$002B", "Y:$C003"].map(|text| text.parse().unwrap()).to_vec(),
        ..defaults()
    };
    assert!(refused(Function::Gather, wide).contains("3585 is not possible"));
    let far = Options { gather_sources: vec!["Y:$10000".parse().unwrap()], ..defaults() };
    let error = plan(&[Function::Gather], &far).unwrap_err().to_string();
    assert_eq!(error, "address of a gather source 65536 is not possible; it is 0 to 65535");
    let many = Options { gather_sources: vec!["Y:$1".parse().unwrap(); 25], ..defaults() };
    assert!(refused(Function::Gather, many).contains("0 to 24"));
    assert!(refused(Function::Rotary, Options { coordinate_system: 9, ..defaults() }).contains("1 to 8"));
    // A function ignores options that it does not use.
    assert!(plan(&[Function::Panel], &Options { motors: 9, period: 0, ..defaults() }).is_ok());
}

#[test]
fn the_numbers_are_the_familys() {
    let options =
        Options { motors: 32, gather_sources: vec!["Y:$7A205".parse().unwrap(); 25], ..Options::default() };
    let lines = |function| enable::plan(&[function], &options, &TURBO2).unwrap().commands;
    // I47 to I49, I55, I58 (Turbo User Manual pp. 403-410); I5000 to I5051 (Turbo Software Reference pp. 170-171). No
    // I-variable sets how many motors the board reports.
    assert_eq!(lines(Function::Ascii), ["I58=1"]);
    assert_eq!(lines(Function::Servo), ["I47=1", "I57=0", "I48=1"]);
    assert_eq!(lines(Function::Background), ["I50=0", "I49=1"]);
    assert_eq!(lines(Function::Variables), ["WY$060412,0", "WY$060413,0", "I55=1"]);
    let gather = lines(Function::Gather);
    assert_eq!(gather[..5], ["I5049=1", "I5000=3", "I5050=$FFFFFF", "I5051=$000001", "I5001=$07A205"]);
    assert_eq!(gather[28..30], ["I5025=$07A205", "DEFINE GATHER 1024"]);
    // The header of coordinate system 16 is the last.
    let sixteen = Options { coordinate_system: 16, ..Options::default() };
    let rotary = enable::plan(&[Function::Rotary], &sixteen, &TURBO2).unwrap().commands;
    assert_eq!(rotary[..2], ["WY$060416,0", "WY$060419,0"]);
    assert_eq!(rotary[14..17], ["WY$060440,0", "WY$060442,0", "WX$060442,0"]);
    assert_eq!(rotary[17..], ["&16 DEFINE ROT 100", "&16 B0", "OPEN BINARY ROTARY"]);
    let error = enable::plan(&[Function::Panel], &options, &TURBO2).unwrap_err();
    assert_eq!(error, EnableError::Missing { function: Function::Panel, family: "Turbo PMAC2" });
}

#[test]
fn a_turbo_boards_report_starts_without_gather() {
    let options = Options::default();
    let both = enable::plan(&[Function::Servo, Function::Gather], &options, &TURBO2).unwrap();
    assert_eq!(both.commands.iter().filter(|line| *line == "GATHER").count(), 1, "gathering's own");
    assert_eq!(why(&both, "GATHER"), "starts gathering");
    let notes: Vec<_> = both.plans.iter().flat_map(|plan| &plan.notes).collect();
    assert!(notes.iter().all(|note| !note.contains("GATHER")), "{notes:?}");
    assert!(notes.iter().any(|note| note.contains("0x0070 (Y:$06001C)")), "{notes:?}");
}

#[test]
fn functions_by_name() {
    for function in Function::ALL {
        assert_eq!(function.name().to_uppercase().parse(), Ok(function));
    }
    let error = "mailbox".parse::<Function>().unwrap_err().to_string();
    assert!(error.contains("\"mailbox\"") && error.contains("gather"));
}

#[test]
fn a_report_that_runs_takes_no_gather() {
    let runs = Options { servo_runs: true, ..Options::default() };
    assert_eq!(commands(&[Function::Servo], &runs), ["I19=1", "I59=8", "I48=1"]);
    let both = plan(&[Function::Servo, Function::Gather], &runs).unwrap();
    assert_eq!(both.commands.iter().filter(|line| *line == "GATHER").count(), 1);
    assert!(both.plans[0].notes[0].contains("GATHER is left out"), "{:?}", both.plans[0].notes);
}

#[test]
fn a_turbo_board_is_told_which_dpram_its_functions_use() {
    // Turbo User Manual p. 45: I24 names the one DPRAM of all functions; the board finds it at a re-initialisation.
    for (family, told) in [(&TURBO2, 1), (&PMAC, 0)] {
        let plans =
            enable::plan(&[Function::Servo, Function::Ascii], &Options::default(), family).unwrap().plans;
        let notes = plans.iter().flat_map(|plan| &plan.notes);
        assert_eq!(notes.filter(|note| note.contains("I24=$60000")).count(), told, "{}", family.name);
    }
}
