//! Programs on the whole board, in virtual time.

use crate::sim::board::Board;
use crate::sim::program::store::Open;
use crate::sim::testing::{Bench, d, l};
use crate::sim::world::World;

#[path = "rotary_end_tests.rs"]
mod rotary_end;

/// More than a second of servo cycles: longer than any wait here.
const LONG: usize = 200_000;

/// Axes X, Y, Z, A of &1 on motors 1 to 4, 1000 counts per unit; limits too high to act.
fn bench() -> Bench {
    with_axes(Bench::started())
}

fn with_axes(mut bench: Bench) -> Bench {
    for motor in 1..=8 {
        bench.set(100 * motor + 11, 0.0);
        bench.set(100 * motor + 16, 1e6);
        bench.set(100 * motor + 17, 1e6);
        bench.set(100 * motor + 28, 1600.0);
    }
    lines(&mut bench, "&1 #1->1000X #2->1000Y #3->1000Z #4->1000A");
    bench.run(10);
    bench
}

#[track_caller]
fn lines(bench: &mut Bench, text: &str) -> Vec<String> {
    let mut answers = Vec::new();
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let reply = bench.world.execute(line.as_bytes());
        assert_eq!(reply.error, None, "{line}");
        answers.extend(reply.lines);
    }
    answers
}

fn error(bench: &mut Bench, line: &str) -> u16 {
    let reply = bench.world.execute(line.as_bytes());
    reply.error.map_or(0, |error| error.0)
}

#[track_caller]
fn load(bench: &mut Bench, text: &str) {
    lines(bench, "OPEN PROG 1 CLEAR");
    lines(bench, text);
    lines(bench, "CLOSE &1 B1");
}

fn running(board: &Board) -> bool {
    board.coordinate_status(0)[0] & 1 == 1
}

/// Runs to the end; returns the milliseconds and the final axis positions X, Y, Z, A.
#[track_caller]
fn finish(bench: &mut Bench) -> (f64, [f64; 4]) {
    let begin = bench.world.board.stats.servo_cycles;
    bench.until(LONG, |board| !running(board));
    let board = &bench.world.board;
    let ms = (board.stats.servo_cycles - begin) as f64 * board.cycle_ms();
    (ms, positions(board))
}

fn positions(board: &Board) -> [f64; 4] {
    let mut axes = [0.0; 9];
    board.axis_positions(0, &mut axes);
    [axes[6], axes[7], axes[8], axes[0]]
}

/// Checks the duration and the end; allows four interrupts of difference.
#[track_caller]
fn check(bench: &mut Bench, program: &str, ms: f64, end: [f64; 4]) {
    load(bench, program);
    lines(bench, "R");
    let (took, found) = finish(bench);
    assert!((took - ms).abs() < 6.0, "{program}: {took} ms, not {ms}");
    for (found, end) in found.iter().zip(end) {
        assert!((found - end).abs() < 1e-6, "{program}: ends at {found:?}, not {end}");
    }
    assert!(bench.violations().is_empty());
}

#[test]
fn times_of_straight_moves() {
    let ta = "TA100 TS0 F100\n";
    for (program, ms, end) in [
        ("FRAX(X,Y) INC X30 Y40 Z10 F100", 500.0 + 100.0, [30.0, 40.0, 10.0, 0.0]),
        ("FRAX(X,Y,Z) INC X-30 Y-40 Z120 F65", 2000.0 + 100.0, [-30.0, -40.0, 120.0, 0.0]),
        // A sequence lasts the sum of its times and one ramp.
        ("INC F100\nX10\nX10\nY20", 400.0 + 100.0, [20.0, 20.0, 0.0, 0.0]),
        ("INC TM250 X10\nY10 X-10", 500.0 + 100.0, [0.0, 10.0, 0.0, 0.0]),
        // Never shorter than its ramp; without feedrate axes only the ramp counts.
        ("INC X1 F100", 100.0 + 100.0, [1.0, 0.0, 0.0, 0.0]),
        ("INC A50 F100", 100.0 + 100.0, [0.0, 0.0, 0.0, 50.0]),
        ("INC TS80 X10", 160.0 + 160.0, [10.0, 0.0, 0.0, 0.0]),
        ("ABS X(5*2)\nX(Q1+20)", 200.0 + 100.0, [20.0, 0.0, 0.0, 0.0]),
        // A dwell lets the ramp end first; a delay includes it, and blends.
        ("INC X10 DWELL200", 200.0 + 200.0, [10.0, 0.0, 0.0, 0.0]),
        ("INC X10\nDELAY200", 100.0 + 200.0 + 100.0, [10.0, 0.0, 0.0, 0.0]),
        ("INC X10\nDWELL0\nX10", 200.0 + 200.0, [20.0, 0.0, 0.0, 0.0]),
        ("DWELL300", 300.0, [0.0; 4]),
    ] {
        check(&mut bench(), &format!("{ta}{program}"), ms, end);
    }
}

#[test]
fn the_override_scales_delays_and_not_dwells() {
    let program = |body: &str| format!("TA100 TS0 F100 INC\n{body}");
    for (body, half) in [("X10", 400.0), ("DELAY300", 800.0), ("DWELL300", 300.0)] {
        let mut bench = bench();
        lines(&mut bench, "%50");
        bench.run(3000);
        let end = if body == "X10" { 10.0 } else { 0.0 };
        check(&mut bench, &program(body), half, [end, 0.0, 0.0, 0.0]);
    }
}

#[test]
fn limits_stretch_moves_that_are_not_segmented() {
    // 50 counts/ms wanted, 25 allowed: T doubles.
    let mut bench_ = bench();
    bench_.set(116, 25.0);
    check(&mut bench_, "TA100 TS0 INC F50 X50", 2000.0 + 100.0, [50.0, 0.0, 0.0, 0.0]);
    // 50 counts/ms in 100 ms is 0.5 counts/ms^2; 0.25 takes 200 ms.
    let mut bench_ = bench();
    bench_.set(117, 0.25);
    check(&mut bench_, "TA100 TS0 INC F50 X50", 1000.0 + 200.0, [50.0, 0.0, 0.0, 0.0]);
    bench_.set(13, 10.0);
    check(&mut bench_, "TA100 TS0 INC F50 X50", 1000.0 + 100.0, [100.0, 0.0, 0.0, 0.0]);
}

#[test]
fn splines_and_pvt() {
    for n in 1..=4 {
        let body = vec!["X5 Y-2"; n].join("\n");
        let n = n as f64;
        check(
            &mut bench(),
            &format!("INC SPLINE1 TA100\n{body}"),
            (n + 2.0) * 100.0,
            [5.0 * n, -2.0 * n, 0.0, 0.0],
        );
    }
    check(
        &mut bench(),
        "INC SPLINE2 TA100\nX5\nTA200 X5",
        100.0 + 200.0 + 100.0 + 200.0,
        [10.0, 0.0, 0.0, 0.0],
    );
    check(&mut bench(), "INC PVT200\nX10:100\nPVT100 X5:20\nX1", 400.0, [16.0, 0.0, 0.0, 0.0]);
    // The first segment ends at 100 units/s = 100 counts/ms.
    let mut bench = bench();
    load(&mut bench, "INC PVT200\nX10:100\nX10");
    lines(&mut bench, "R");
    bench.until(LONG, |board| board.motors[0].commanded() >= 10_000.0);
    let velocity = bench.world.board.motors[0].desired_velocity();
    assert!((velocity - 100.0).abs() < 2.0, "{velocity}");
}

#[test]
fn circles_stay_on_their_radius_and_end_where_they_should() {
    for (program, centre, radius, way, end) in [
        ("CIRCLE1 X10 Y10 I10", [10.0, 0.0], 10.0, 0.5, [10.0, 10.0]),
        ("CIRCLE2 X10 Y10 J10", [0.0, 10.0], 10.0, 0.5, [10.0, 10.0]),
        ("CIRCLE1 I3 J4", [3.0, 4.0], 5.0, 2.0, [0.0, 0.0]),
        ("CIRCLE1 X20 R10", [10.0, 0.0], 10.0, 1.0, [20.0, 0.0]),
        ("CIRCLE2 X10 Y10 R-10", [10.0, 0.0], 10.0, 1.5, [10.0, 10.0]),
        ("ABS(R) CIRCLE2 X10 Y10 I0 J10", [0.0, 10.0], 10.0, 0.5, [10.0, 10.0]),
    ] {
        let mut bench = bench();
        bench.set(13, 5.0);
        load(&mut bench, &format!("TA50 TS0 F100\n{program}"));
        lines(&mut bench, "R");
        let begin = bench.world.board.stats.servo_cycles;
        bench.until(LONG, |board| {
            let x = board.motors[0].commanded() / 1000.0 - centre[0];
            let y = board.motors[1].commanded() / 1000.0 - centre[1];
            let off = (x * x + y * y).sqrt() - radius;
            assert!(off.abs() < 1e-6, "{program}: {off}");
            !running(board)
        });
        let board = &bench.world.board;
        let ms = (board.stats.servo_cycles - begin) as f64 * board.cycle_ms();
        let expected = way * std::f64::consts::PI * radius * 10.0 + 50.0;
        assert!((ms - expected).abs() < 6.0, "{program}: {ms}, not {expected}");
        let found = positions(board);
        assert!((found[0] - end[0]).abs() + (found[1] - end[1]).abs() < 1e-6, "{program}: {found:?}");
    }
    // Without segmentation arcs are straight; too small a radius is an error.
    check(&mut bench(), "TA50 TS0 F100 CIRCLE1 X20 R10", 200.0 + 50.0, [20.0, 0.0, 0.0, 0.0]);
    let mut bench = bench();
    bench.set(13, 5.0);
    load(&mut bench, "CIRCLE1 X20 R9");
    lines(&mut bench, "R");
    finish(&mut bench);
    assert_eq!(bench.world.board.coordinate_status(0)[1] >> 21 & 1, 1);
}

#[test]
fn helix_and_other_planes() {
    let mut bench = bench();
    bench.set(13, 5.0);
    check(
        &mut bench,
        "TA50 TS0 F100 NORMAL J-1 INC\nCIRCLE2 X10 Z10 Y7 I10",
        50.0 * std::f64::consts::PI + 50.0,
        [10.0, 7.0, 10.0, 0.0],
    );
}

#[test]
fn rapid_home_and_position_set() {
    let mut bench = bench();
    // 32 counts/ms by Ix22 in 200 ms: 1000 ms for the distance at that speed and 200 of ramps less half of them.
    lines(&mut bench, "I50=0");
    load(&mut bench, "RAPID X32 Y8\nPSET X5 Y5\nLINEAR TM300 TA100 TS0 X6");
    lines(&mut bench, "R");
    let (ms, end) = finish(&mut bench);
    assert!((ms - (1000.0 + 150.0 + 400.0)).abs() < 60.0, "{ms}");
    assert_eq!((end[0].round(), end[1].round()), (6.0, 5.0));
    assert!((bench.world.board.motors[0].commanded() - 33_000.0).abs() < 1e-6);
    load(&mut bench, "HOME1,2\nX1 Y1");
    lines(&mut bench, "R");
    let (_, end) = finish(&mut bench);
    assert!((end[0] - 1.0).abs() + (end[1] - 1.0).abs() < 1e-6, "{end:?}");
    assert_eq!(bench.world.board.motor_status(0)[1] >> 10 & 1, 1, "home complete");
    // A trigger on the way ends the move this far from it.
    load(&mut bench, "RAPID X10^-2\nINC TM100 X1 LINEAR");
    lines(&mut bench, "R");
    finish(&mut bench);
    let end = bench.world.board.motors[0].commanded();
    assert!((end - (8000.0 - 2000.0)).abs() < 1001.0, "{end}");
}

#[test]
fn flow_calls_and_variables() {
    let mut bench = bench();
    lines(&mut bench, "OPEN PROG 1000 CLEAR\nN0 RAPID RETURN\nN1000 LINEAR RETURN\nN2000 CIRCLE1 RET\nCLOSE");
    lines(&mut bench, "OPEN PROG 1001 CLEAR\nN3000 READ(P,Q)\nP10=Q116 P11=Q117 P12=Q100\nRET\nCLOSE");
    load(
        &mut bench,
        "P1=0 P2=0 P3=0
         WHILE (P1<5)
         P1=P1+1
         IF (P1>3) P2=P2+10
         ELSE P2=P2+1
         IF (P1=2)
         P3=100
         ELSE
         IF (P1=4)
         P3=P3+1
         ENDIF
         ENDIF
         ENDWHILE
         WHILE (P4<7) P4=P4+1
         GOSUB 500
         M3 P7 Q8 G1 TM100 X5
         GOTO 900
         N500 P5=42
         RETURN
         N900 P6=P5+1
         P7=P6 G17 T99",
    );
    lines(&mut bench, "R");
    finish(&mut bench);
    let values = lines(&mut bench, "P1..7");
    assert_eq!(values, ["5", "23", "101", "7", "42", "43", "43"]);
    assert_eq!(lines(&mut bench, "P10..12"), ["7", "8", "98304"]);
    assert!((positions(&bench.world.board)[0] - 5.0).abs() < 1e-9);
    // Ready to run again from its start; a block without an end cannot run.
    assert_eq!(lines(&mut bench, "PC"), ["P1:0"]);
    load(&mut bench, "WHILE(P1=P1)\nP8=P8+1\nENDWHILE");
    lines(&mut bench, "R");
    bench.run(100);
    assert!(running(&bench.world.board));
    lines(&mut bench, "A");
    load(&mut bench, "IF(P1=1)\nX5");
    assert_eq!(error(&mut bench, "R"), 16);
    load(&mut bench, "CALL77");
    lines(&mut bench, "R");
    finish(&mut bench);
    assert_eq!(bench.world.board.coordinate_status(0)[1] >> 22 & 1, 1);
    assert_eq!(bench.world.board.motor_status(0)[0] >> 14 & 1, 1);
}

#[test]
fn synchronous_assignments_wait_for_the_next_move() {
    let mut bench = bench();
    lines(&mut bench, "M1->* M2->* M1=0 M2=$F0");
    load(&mut bench, "INC TA100 TS0 TM300\nX10\nM1==5 M2|=$F P1=1\nX10\nM2^=$FF\nDWELL10\nM1==9");
    lines(&mut bench, "P1=0 R");
    bench.run(100);
    // The assignment of the second line is calculated; the synchronous one waits.
    assert_eq!(lines(&mut bench, "P1 M1 M2"), ["1", "0", "240"]);
    bench.run(700);
    assert_eq!(lines(&mut bench, "M1 M2"), ["5", "255"]);
    finish(&mut bench);
    assert_eq!(lines(&mut bench, "M1 M2"), ["5", "0"], "what no move follows never happens");
}

#[test]
fn step_stop_quit_abort_and_hold() {
    let mut bench = bench();
    let x = |bench: &Bench| (positions(&bench.world.board)[0] * 1e6).round() / 1e6;
    load(&mut bench, "ABS TA100 TS0 TM300\nX10\nP1=3 X20\nX30\nSTOP\nX40\nX50");
    // Three steps: modes alone are no step.
    for expected in [10.0, 20.0] {
        lines(&mut bench, "S");
        assert_eq!(bench.world.board.coordinate_status(0)[0] & 0b1_0011, 0b11);
        finish(&mut bench);
        assert_eq!(x(&bench), expected);
    }
    lines(&mut bench, "R");
    finish(&mut bench);
    assert_eq!((x(&bench), lines(&mut bench, "PC").concat().as_str()), (30.0, "P1:9"));
    lines(&mut bench, "R");
    bench.run(100);
    assert_eq!(error(&mut bench, "#1J+"), 1);
    assert_eq!(error(&mut bench, "OPEN PROG 2"), 1);
    assert_eq!(error(&mut bench, "B1"), 1);
    lines(&mut bench, "/");
    finish(&mut bench);
    assert_eq!((x(&bench), lines(&mut bench, "LIST PC").concat().as_str()), (40.0, "P1:10:X50"));
    // After a jog the program does not continue.
    lines(&mut bench, "#1J:100");
    bench.until(LONG, |board| !board.motors[0].moving());
    bench.run(2);
    assert_eq!(error(&mut bench, "R"), 17);
    lines(&mut bench, "#1J=");
    bench.until(LONG, |board| !board.motors[0].moving());
    bench.run(2);
    lines(&mut bench, "R");
    finish(&mut bench);
    assert_eq!(x(&bench), 50.0);

    lines(&mut bench, "B1R");
    bench.run(200);
    lines(&mut bench, "Q");
    finish(&mut bench);
    assert_eq!(x(&bench), 20.0, "the move under way and the one calculated");
    lines(&mut bench, "R");
    bench.run(300);
    lines(&mut bench, "A");
    assert!(!running(&bench.world.board));
    assert_eq!(bench.world.board.motor_status(0)[0] >> 12 & 1, 1);
    bench.until(LONG, |board| !board.motors[0].moving());
    assert!(x(&bench) > 20.0 && x(&bench) < 50.0);

    lines(&mut bench, "B1R");
    bench.run(300);
    lines(&mut bench, "H");
    bench.run(3000);
    let held = x(&bench);
    bench.run(100);
    assert_eq!((x(&bench), running(&bench.world.board)), (held, true));
    lines(&mut bench, "R");
    finish(&mut bench);
    assert_eq!(x(&bench), 30.0);
}

#[test]
fn a_program_hold_stops_on_the_path() {
    let mut bench = bench();
    bench.set(13, 10.0);
    load(&mut bench, "ABS TA100 TS0 TM500\nX0 Y0\nX10 Y20\nX20 Y0");
    lines(&mut bench, "R");
    bench.until(LONG, |board| board.motors[0].commanded() > 5000.0);
    lines(&mut bench, "\\");
    bench.until(200, |board| !running(board));
    let [x, y, ..] = positions(&bench.world.board);
    assert!((y - 2.0 * x).abs() < 1e-6 && x < 6.0, "{x} {y}");
    assert_eq!(bench.world.board.coordinate_status(0)[1] >> 23 & 1, 1);
    bench.run(2);
    lines(&mut bench, "#1J:500");
    bench.until(LONG, |board| !board.motors[0].moving());
    bench.run(2);
    assert_eq!(error(&mut bench, "R"), 17);
    lines(&mut bench, "#1J=");
    bench.until(LONG, |board| !board.motors[0].moving());
    bench.run(2);
    lines(&mut bench, "R");
    let (_, end) = finish(&mut bench);
    assert!((end[0] - 20.0).abs() + end[1].abs() < 1e-6, "{end:?}");
}

/// `Q` ends a program after the moves that the board has calculated, and a program that waits for lines at once (User Manual
/// p. 213).
#[test]
fn a_quit_ends_a_rotary_program_in_every_cycle_of_its_last_move() {
    for (mode, segmentation, step) in
        [("LINEAR", 0.0, 11), ("LINEAR", 10.0, 41), ("SPLINE1", 0.0, 41), ("RAPID", 0.0, 41)]
    {
        for cycles in (1..1200).step_by(step) {
            let mut bench = bench();
            bench.set(13, segmentation);
            lines(&mut bench, "&1DEFINE ROT 30\nB0 OPEN ROT\nINC TM50 TA20 TS5");
            lines(&mut bench, mode);
            lines(&mut bench, "X1 Y2\nX-1 Y2\nCLOSE\n&1R");
            bench.run(cycles);
            lines(&mut bench, "&1Q");
            bench.until(4000, |board| !running(board));
        }
    }
}

#[test]
fn a_limit_on_the_way_ends_the_program() {
    let mut bench = bench();
    bench.set(113, 20_000.0);
    load(&mut bench, "TA100 TS0 F50 X50 Y50");
    lines(&mut bench, "R");
    finish(&mut bench);
    let board = &bench.world.board;
    assert_eq!(board.motor_status(0)[0] >> 21 & 1, 1);
    assert_eq!(board.motor_status(1)[0] >> 12 & 1, 1, "the others stop too");
}

#[test]
fn a_rotary_buffer_starves_and_goes_on() {
    let mut bench = bench();
    assert_eq!(
        lines(&mut bench, "&1DEFINE ROT 30\nI16=2 I17=4\nB0 OPEN ROT\nINC TA100 TS0 TM300\nX10\nX10\nPR"),
        ["3"]
    );
    bench.run(1);
    let request = |bench: &Bench| bench.world.board.coordinate_status(0)[1] >> 16 & 1;
    assert_eq!(request(&bench), 0);
    lines(&mut bench, "X10\nX10");
    assert_eq!((request(&bench), lines(&mut bench, "PR")[0].as_str()), (1, "5"));
    assert_eq!(bench.world.board.memory.read_y(0x08AE), 5);
    lines(&mut bench, "CLOSE R");
    bench.run(10);
    assert_eq!(lines(&mut bench, "PR PE LIST PE"), ["2", "P0:4", "P0:4:X10"]);
    assert_eq!(request(&bench), 1);
    bench.run(8000);
    // Without lines the program runs and rests, and the board has freed all lines.
    let board = &bench.world.board;
    assert!(running(board));
    assert_eq!(board.motor_status(0)[0] & (1 << 17 | 1 << 13), 1 << 13);
    assert!((positions(board)[0] - 40.0).abs() < 1e-9);
    assert_eq!(bench.world.programs.store.rotary(0).map(|rotary| rotary.free()), Some(30));
    assert_eq!(request(&bench), 0);
    lines(&mut bench, "OPEN ROT\nX5\nX5");
    bench.run(10);
    assert!(bench.world.board.motors[0].moving());
    bench.run(8000);
    assert!((positions(&bench.world.board)[0] - 50.0).abs() < 1e-9);
    lines(&mut bench, "Q");
    bench.run(1);
    assert!(!running(&bench.world.board));
    // It also takes words: X-10, a whole line.
    let World { board, programs, .. } = &mut bench.world;
    assert!(programs.rotary_room(0, 10) && !programs.rotary_room(1, 1) && !programs.rotary_room(0, 31));
    programs.rotary_append(board, 0, &[(0x000E23, 0xB00000)]).unwrap();
    assert!(programs.rotary_append(board, 0, &[(0x000800, 0x00FFFF)]).is_err());
    lines(&mut bench, "R");
    bench.run(8000);
    assert!((positions(&bench.world.board)[0] - 40.0).abs() < 1e-9);
    assert_eq!(bench.world.programs.store.open(), Some(Open::Rotary));
}

#[test]
fn a_segmented_rotary_line_that_comes_in_time_is_blended() {
    for (wait, blended) in [(300, true), (1000, false)] {
        let mut bench = bench();
        bench.set(13, 10.0);
        lines(&mut bench, "&1DEFINE ROT 30\nB0 OPEN ROT\nINC TA100 TS0 TM300\nX10\nR");
        bench.run(wait);
        let motor = &bench.world.board.motors[0];
        let mut rested = motor.desired_velocity() == 0.0 && motor.commanded() == 10_000.0;
        lines(&mut bench, "X10");
        bench.until(LONG, |board| {
            let motor = &board.motors[0];
            rested |= motor.desired_velocity() == 0.0 && (9_000.0..15_000.0).contains(&motor.commanded());
            motor.commanded() > 15_000.0
        });
        assert_eq!(rested, !blended);
    }
}

#[test]
fn programs_speak_and_ask_and_switch_plcs() {
    let mut bench = bench();
    lines(
        &mut bench,
        "OPEN PLC 3 CLEAR\nP50=P50+1\nIF(P50=5) SEND\"five\"\nWHILE(P51=0)\nP52=P52+1\nENDWHILE\nCLOSE",
    );
    lines(&mut bench, "I5=2");
    bench.run(20);
    assert_eq!(lines(&mut bench, "P50 P52"), ["0", "0"], "opening has disabled it");
    load(&mut bench, "ENABLE PLC 3\nSEND\"hello\"\nCMD\"I59 #2P\"\nDWELL20\nDISABLE PLC 3");
    bench.world.board.serial_becomes_active();
    lines(&mut bench, "I3=2 R");
    bench.run(10);
    let values = lines(&mut bench, "P50 P52");
    assert_eq!(values[0], "1");
    assert!(values[1] > "1".into());
    lines(&mut bench, "P51=1");
    finish(&mut bench);
    bench.run(2);
    let stopped = lines(&mut bench, "P50");
    bench.run(20);
    assert_eq!(lines(&mut bench, "P50"), stopped);
    let said = String::from_utf8(bench.world.board.output.serial.clone()).unwrap();
    assert!(said.starts_with("hello\r8\r0\r") && said.contains("five\r"), "{said:?}");
}

#[test]
fn the_background_report_shows_a_segmented_program() {
    let mut bench = bench();
    bench.set(13, 10.0);
    load(&mut bench, "TA200 TS0 TM1000\nX10 Y20 Z30\nX0");
    lines(&mut bench, "R");
    bench.run(200);
    bench.write(0x0228, 0);
    bench.run(1);
    let block = 0x022C + 0x14;
    let status = bench.world.board.coordinate_status(0);
    assert_eq!(status[1] & 0b1110_0000, 0b1100_0000, "segmented, in its ramp: {status:X?}");
    assert_eq!(status[0] & 0b1_1111, 0b1_1001, "{status:X?}");
    let _ = block;
    let time_left = f64::from(bench.world.board.memory.read_x(0x20)) / 2.0;
    let ms = 200.0 * bench.world.board.cycle_ms();
    assert!((time_left - (1000.0 - ms)).abs() < 10.0, "{time_left}");
    let [ramp, offset, _] = bench.world.programs.report[0];
    assert!((f64::from(ramp) / 2.0 - (200.0 - ms)).abs() < 5.0, "{ramp}");
    assert_eq!(offset, 3);
    for (register, expected) in [(0x087C, 10.0), (0x087D, 20.0), (0x087E, 30.0), (0x081F, 10.0)] {
        assert_eq!(bench.world.board.memory.read_l(l(register)), expected);
    }
    assert_eq!(bench.world.board.memory.read_d(d(0x080B)), 10_000 * 3072, "target of motor 1");
}

#[test]
fn transformations_turn_what_is_programmed() {
    let mut bench = bench();
    lines(
        &mut bench,
        "DEFINE TBUF 1\nQ10=0 Q11=-1 Q12=0 Q13=1 Q14=0 Q15=0 Q16=0 Q17=0 Q18=1 Q20=100 Q21=0 Q22=0",
    );
    check(
        &mut bench,
        "TSEL1 TINIT AROT10 ADIS20 TM100 TA50 TS0\nX1 Y2\nINC X1",
        250.0,
        [98.0, 2.0, 0.0, 0.0],
    );
}

#[test]
fn programs_outlive_a_reset_only_when_saved() {
    let mut bench = bench();
    load(&mut bench, "X10\nX20");
    lines(&mut bench, "SAVE\nOPEN PROG 2 X5\nCLOSE\nDEFINE ROT 50\n$$$");
    assert_eq!(lines(&mut bench, "LIST PROG 1"), ["X10", "X20", "RET"]);
    assert_eq!(error(&mut bench, "LIST PROG 2"), 3);
    assert_eq!(error(&mut bench, "PR"), 3);
    lines(&mut bench, "$$$***");
    assert_eq!(error(&mut bench, "LIST PROG 1"), 3);
}

#[test]
fn cutter_compensation_is_listed_and_ends_the_program_that_gets_there() {
    let mut bench = bench();
    load(&mut bench, "LINEAR ABS TM100 CC0 CCR0.5 X1\nCC1 X2\nX3");
    assert_eq!(lines(&mut bench, "LIST PROG 1")[1], "CC1 X2");
    lines(&mut bench, "R");
    let (_, [x, ..]) = finish(&mut bench);
    assert!(x <= 1.0, "{x}");
    assert_eq!(bench.world.board.coordinate_status(0)[1] >> 22 & 1, 1);
}

#[test]
fn a_program_that_runs_everything_keeps_its_distance_from_the_text() {
    // A closed figure of everything that blends, repeated: no error may build up.
    let mut bench = bench();
    bench.set(13, 10.0);
    load(
        &mut bench,
        "P1=0 INC TA40 TS10 F200
         WHILE(P1<20)
         LINEAR X10 A3
         CIRCLE1 X10 Y10 J10 I0
         CIRCLE2 X-20 Y-10 I-10 J0 Z4
         LINEAR DELAY20 A-3 Z-4
         P1=P1+1
         ENDWHILE",
    );
    lines(&mut bench, "R");
    let (_, end) = finish(&mut bench);
    for position in end {
        assert!(position.abs() < 1e-6, "{end:?}");
    }
    assert_eq!(lines(&mut bench, "P1"), ["20"]);
}
