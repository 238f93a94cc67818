//! Production programs and drivers get what they wait for: their inputs, reduced, in virtual time.

use crate::sim::board::error::CommandError;
use crate::sim::board::firmware::{self, FirmwareTables};
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

const CLASSIC: [&FirmwareTables; 2] = [&firmware::PMAC, &firmware::PMAC2];
const TURBO: [&FirmwareTables; 2] = [&turbo::TURBO, &turbo::TURBO2];

fn board(tables: &'static FirmwareTables) -> Bench {
    Bench::of(tables, tables.firmware)
}

fn refusal(bench: &mut Bench, line: &str) -> Option<CommandError> {
    bench.world.execute(line.as_bytes()).error
}

fn send(bench: &mut Bench, line: &str) -> Vec<String> {
    let reply = bench.world.execute(line.as_bytes());
    assert_eq!(reply.error, None, "{line}");
    reply.lines
}

fn load(bench: &mut Bench, text: &str) {
    for line in text.lines() {
        send(bench, line.trim());
    }
}

fn number(bench: &mut Bench, line: &str) -> f64 {
    send(bench, line)[0].parse().unwrap()
}

#[test]
fn a_plc_that_waits_for_a_countdown_timer_goes_on_when_the_time_is_over() {
    let boards =
        TURBO.map(|tables| (tables, "I5111")).into_iter().chain(CLASSIC.map(|tables| (tables, "M70")));
    for (tables, timer) in boards {
        let mut bench = board(tables);
        if timer == "M70" {
            send(&mut bench, "M70->X:$0700,0,24,S");
        }
        let set = format!("{timer}=500*8388608/I10");
        let wait = format!("WHILE({timer}>0)");
        load(&mut bench, &["OPEN PLC 5 CLEAR", "P51=0", &set, &wait, "ENDWHILE"].join("\n"));
        load(&mut bench, "P51=1\nDISABLE PLC5\nCLOSE\nI5=2");
        send(&mut bench, "ENABLE PLC5");
        let cycles = (500.0 / bench.world.board.cycle_ms()) as usize;
        bench.run(cycles - 10);
        assert_eq!(send(&mut bench, "P51"), ["0"], "{timer}");
        bench.run(20);
        assert_eq!(send(&mut bench, "P51"), ["1"], "{timer}");
    }
}

#[test]
fn timers_are_whole_numbers_of_24_bits_and_those_of_an_inactive_coordinate_system_stand_still() {
    let mut bench = board(&turbo::TURBO2);
    load(&mut bench, "I68=1\nI5111=2.7 I5112=-8388607 I5212=5 I5311=9");
    bench.run(2);
    assert_eq!(send(&mut bench, "I5111 I5112 I5212 I5311"), ["1", "-8388608", "3", "9"]);
    let mut bench = board(&firmware::PMAC);
    load(&mut bench, "WX$700,7\nWY$700,-8388607\nWY$701,0");
    bench.run(3);
    assert_eq!(send(&mut bench, "RX$700 RY$700 RY$701"), ["4", "-8388608", "-3"]);
}

#[test]
fn a_program_that_writes_a_definition_in_memory_points_the_m_variable_elsewhere() {
    for tables in TURBO {
        let mut bench = board(tables);
        load(&mut bench, "M4001->L:$B850\nM4013->Y:$4FA1,0,24\nM4013=$C5FD\nM4001=12.5");
        assert_eq!(send(&mut bench, "M4001-> RL$B850"), ["L:$C5FD", "0"]);
        assert_eq!(send(&mut bench, "M4000->L:$C5FD M4000"), ["12.5"]);
        load(&mut bench, "M2->L:$1000");
        assert_eq!(send(&mut bench, "RHY$4002"), ["001000"]);
        assert_ne!(send(&mut bench, "RHX$4002"), ["000000"]);
    }
    for tables in CLASSIC {
        // The arrays of the User Manual, p. 150.
        let mut bench = board(tables);
        load(&mut bench, "M0->L:$1000\nM10->Y:$BC00,0,12\nM10=5\nM0=73");
        assert_eq!(send(&mut bench, "P5 M0->"), ["73", "L:$1005"]);
    }
}

#[test]
fn each_definition_comes_back_from_its_word_and_after_a_reset() {
    let texts = [
        "*",
        "X:$C000,23",
        "Y:$FFC2,0",
        "Y:$C003,8,16,S",
        "X:$700,4,8,C",
        "Y:$BFF,0,20,D",
        "X:$C001,24,S",
        "D:$28",
        "L:$1000",
        "F:$D210",
        "DP:$D200",
        "TWD:4,0.8,U",
        "TWS:1",
    ];
    for tables in CLASSIC.into_iter().chain(TURBO) {
        let mut bench = board(tables);
        for (number, text) in texts.iter().enumerate() {
            send(&mut bench, &format!("M{number}->{text}"));
        }
        let listed = send(&mut bench, "M0..12->");
        assert_eq!(listed, texts.map(str::to_owned));
        load(&mut bench, "M0=1048577.4\nSAVE\nM3->*\n$$$");
        assert_eq!(send(&mut bench, "M0..12->"), listed);
        assert_eq!(send(&mut bench, "M0 M3->* M3"), ["1", "0"], "20 bits of the word are the value");
        assert_eq!(
            refusal(&mut bench, "M5->Y:$C003,6,8"),
            Some(CommandError::SYNTAX),
            "fields begin at each fourth bit"
        );
    }
}

#[test]
fn a_killed_motor_is_where_a_driver_writes_its_position_registers() {
    // The registers of motor 2: commanded and actual position.
    let boards = TURBO.map(|tables| (tables, "M261->D:$108 M262->D:$10B"));
    let boards = boards.into_iter().chain(CLASSIC.map(|tables| (tables, "M261->D:$64 M262->D:$67")));
    for (tables, definitions) in boards {
        let mut bench = board(tables);
        load(&mut bench, &format!("I200=1 {definitions}\n#2J=1000"));
        bench.run(20_000);
        assert_eq!(number(&mut bench, "#2P"), 1000.0);
        load(&mut bench, "#2K\nM261=5000*32*I208 M262=5000*32*I208");
        // The next line comes before a servo cycle has passed.
        load(&mut bench, "#2J/");
        bench.run(500);
        assert_eq!((number(&mut bench, "#2P"), number(&mut bench, "#2F")), (5000.0, 0.0));
        load(&mut bench, "#2J=5100");
        bench.run(20_000);
        assert_eq!(number(&mut bench, "#2P"), 5100.0);
        assert_eq!(bench.world.board.notes, [""; 0]);
    }
}

#[test]
fn a_closed_loop_goes_to_the_commanded_position_that_is_written_and_makes_good_a_written_actual_one() {
    let mut bench = board(&firmware::PMAC);
    load(&mut bench, "I111=0 M161->D:$28 M162->D:$2B\n#1J/\nM161=300*I108*32");
    bench.run(2000);
    assert_eq!(send(&mut bench, "#1P"), ["300"]);
    load(&mut bench, "M162=1000*I108*32");
    assert_eq!(send(&mut bench, "#1F"), ["-700"]);
    bench.run(2000);
    assert_eq!(send(&mut bench, "#1P #1F"), ["300", "0"], "the shaft has gone back by 700 counts");
    // A jog goes on over the rest of its way.
    load(&mut bench, "#1J=10300");
    bench.run(100);
    load(&mut bench, "M161=M161+100*I108*32");
    bench.run(20_000);
    assert_eq!(send(&mut bench, "#1P"), ["10400"]);
}

#[test]
fn a_plc_clears_home_complete_as_generated_homing_programs_do() {
    let mut bench = board(&turbo::TURBO2);
    load(&mut bench, "M145->Y:$C0,10\n#1J/HMZ");
    bench.run(3);
    assert_eq!(send(&mut bench, "M145"), ["1"]);
    load(&mut bench, "M145=0");
    bench.run(3);
    assert_eq!(send(&mut bench, "M145"), ["0"]);
}

#[test]
fn a_write_that_the_board_does_not_obey_is_named_once() {
    let mut bench = board(&firmware::PMAC);
    load(&mut bench, "M1->X:$5C,24\nM2->Y:$C003,8,16,S\nM3->D:$0813\nM1=5\nM1=6\nM2=100\nM3=3072");
    let ignored = ["$005C, the time left in the move of motor 2", "$C003, an output, encoder or flag"]
        .map(|what| format!("{what}, has been written: the board keeps the value and does nothing"));
    assert_eq!(bench.world.board.notes, ignored);
    assert_eq!(send(&mut bench, "#1P"), ["1"], "the position bias counts");
    assert!(crate::sim::control::status(&bench.world).contains("the time left in the move of motor 2"));
}

#[test]
fn a_circle_without_segmentation_goes_along_its_chord_and_the_board_says_so() {
    for (tables, variable) in [(&turbo::TURBO2, "I5213"), (&firmware::PMAC, "I13")] {
        let mut bench = board(tables);
        load(&mut bench, "I300=1 I400=1\n&2\n#3->100X\n#4->100Y\n#3J/ #4J/");
        load(&mut bench, "OPEN PROG 2 CLEAR\nINC\nCIRCLE1\nF5\nX0Y0I0J-5\nX2Y2I2J0\nCLOSE\nB2R");
        bench.run(20_000);
        assert_eq!((number(&mut bench, "#3P"), number(&mut bench, "#4P")), (200.0, 200.0));
        let note = format!("coordinate system 2 moves along the chord, not the circle: {variable} is 0");
        assert_eq!(bench.world.board.notes, [note]);
        // G2 of a machine tool, as PROG 1000 makes it.
        load(&mut bench, &format!("{variable}=5\nOPEN PROG 1000 CLEAR\nN2000 CIRCLE1 RETURN\nCLOSE"));
        load(&mut bench, "OPEN PROG 3 CLEAR\nINC\nF5\nG2 X0Y0I0J-5\nCLOSE\nB3R");
        let mut lowest = f64::INFINITY;
        for _ in 0..20_000 {
            bench.run(1);
            lowest = lowest.min(bench.world.board.position(3));
        }
        assert!((lowest + 800.0).abs() < 20.0, "half way round the circle: {lowest}");
        assert_eq!(bench.world.board.notes.len(), 1);
    }
}
