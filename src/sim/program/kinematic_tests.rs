//! Motors that follow their axes through kinematic programs.

use crate::sim::board::error::CommandError;
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

fn refusal(bench: &mut Bench, line: &str) -> Option<CommandError> {
    bench.world.execute(line.as_bytes()).error
}

fn send(bench: &mut Bench, line: &str) -> Vec<String> {
    let reply = bench.world.execute(line.as_bytes());
    assert_eq!(reply.error, None, "{line}");
    reply.lines
}

fn board(text: &str) -> Bench {
    let mut bench = Bench::of(&turbo::TURBO2, turbo::TURBO2.firmware);
    load(&mut bench, text);
    bench
}

fn load(bench: &mut Bench, text: &str) {
    for line in text.lines() {
        send(bench, line.trim());
    }
}

/// A table that turns under a slide: motor 1 is the radius in 1/1000, motor 2 the angle in 1/1000 degrees; at X=1, Y=0.
fn polar() -> Bench {
    let mut bench = board(
        "I200=1 I116=1000 I216=1000 I117=10 I217=10
        &1
        #1->I
        #2->I
        OPEN FORWARD CLEAR
        Q7=P1/1000*COS(P2/1000)
        Q8=P1/1000*SIN(P2/1000)
        CLOSE
        OPEN INVERSE CLEAR
        P1=SQRT(Q7*Q7+Q8*Q8)*1000
        P2=ATAN(Q8/Q7)*1000
        IF(Q10=1)
        P101=(Q7*Q17+Q8*Q18)/P1*1000000
        P102=(Q7*Q18-Q8*Q17)/(P1*P1)*57295779513
        ENDIF
        CLOSE
        I5150=1
        #1J/ #2J/
        #1J=1000",
    );
    bench.run(5000);
    bench
}

/// X and Y where the motors are told to be.
fn place(bench: &Bench) -> (f64, f64) {
    let [radius, angle] = [0, 1].map(|motor| bench.world.board.motors[motor].commanded() / 1000.0);
    (radius * angle.to_radians().cos(), radius * angle.to_radians().sin())
}

/// Runs program 1 to its end; the places on the way.
fn way(bench: &mut Bench) -> Vec<(f64, f64)> {
    send(bench, "&1B1R");
    let mut places = Vec::new();
    for _ in 0..20_000 {
        bench.run(1);
        places.push(place(bench));
        if !bench.world.board.runs_program(0) {
            return places;
        }
    }
    panic!("the program does not end");
}

#[test]
fn a_motor_follows_its_axis_through_the_inverse_program() {
    let mut bench = board(
        "I900=1
        &3
        #9->I
        OPEN FORWARD CLEAR
        Q7=P9
        CLOSE
        OPEN INVERSE CLEAR
        P9=Q7
        CLOSE
        I5350=1
        OPEN PROG 40 CLEAR
        LINEAR ABS TM500
        X1000
        CLOSE
        #9J/",
    );
    for (segmentation, mode) in [(0, "LINEAR"), (5, "LINEAR"), (0, "RAPID"), (0, "SPLINE1"), (0, "PVT100")] {
        load(&mut bench, "#9J=0");
        bench.run(20_000);
        load(
            &mut bench,
            &format!(
                "I5313={segmentation}\nOPEN PROG 40 CLEAR\n{mode} ABS TM500 TA100\nX1000\nCLOSE\n&3B40R"
            ),
        );
        bench.run(20_000);
        assert_eq!(send(&mut bench, "#9P"), ["1000"], "{mode}, I5313={segmentation}");
    }
}

#[test]
fn with_segmentation_the_axes_go_straight_and_without_only_the_end_is_theirs() {
    let mut bench = polar();
    load(&mut bench, "OPEN PROG 1 CLEAR\nLINEAR ABS TM1000 TA100 TS0\nX1 Y1\nCLOSE");
    for (segmentation, least, most) in [(5, 0.0, 0.002), (0, 0.02, 0.2)] {
        load(&mut bench, &format!("I5113={segmentation}\n#1J=1000\n#2J=0"));
        bench.run(20_000);
        let places = way(&mut bench);
        let off = places.iter().map(|(x, _)| (x - 1.0).abs()).fold(0.0, f64::max);
        assert!(off >= least && off <= most, "I5113={segmentation}: {off}");
        let end = place(&bench);
        assert!((end.0 - 1.0).abs() < 0.001 && (end.1 - 1.0).abs() < 0.001, "{end:?}");
    }
}

#[test]
fn an_arc_of_kinematic_axes_is_an_arc() {
    let mut bench = polar();
    load(&mut bench, "I5113=5\nOPEN PROG 1 CLEAR\nABS CIRCLE1 TM2000 TA100\nX2 Y0 I0.5 J0\nCLOSE");
    let places = way(&mut bench);
    for (x, y) in places {
        let radius = (x - 1.5).hypot(y);
        assert!((radius - 0.5).abs() < 0.002, "{x} {y}");
    }
    let end = place(&bench);
    assert!((end.0 - 2.0).abs() < 0.001 && end.1.abs() < 0.001, "{end:?}");
}

#[test]
fn the_inverse_program_makes_the_velocities_of_pvt_moves() {
    let mut bench = polar();
    load(&mut bench, "OPEN PROG 1 CLEAR\nABS PVT500\nX1:0 Y0.5:1\nX1:0 Y1:1\nX1:0 Y1.5:0\nCLOSE\nI5190=1000");
    let places = way(&mut bench);
    let off = places.iter().map(|(x, _)| (x - 1.0).abs()).fold(0.0, f64::max);
    assert!(off < 0.02, "{off}");
    // In the middle Y goes at 1 per second, 0.0004427 a servo cycle.
    let fastest = places.windows(2).map(|pair| pair[1].1 - pair[0].1).fold(0.0, f64::max);
    assert!((fastest - 0.000_66).abs() < 0.000_1, "{fastest}");
}

#[test]
fn pmatch_and_the_start_run_the_forward_program() {
    let mut bench = polar();
    load(&mut bench, "#2J=60000");
    bench.run(20_000);
    load(&mut bench, "&1PMATCH");
    assert!((send(&mut bench, "Q7")[0].parse::<f64>().unwrap() - 0.5).abs() < 0.001);
    load(&mut bench, "#2J=0");
    bench.run(20_000);
    // The axis that the line leaves out keeps the position that the forward program finds.
    load(&mut bench, "I5113=5\nOPEN PROG 1 CLEAR\nLINEAR ABS TM500\nY1\nCLOSE");
    way(&mut bench);
    let end = place(&bench);
    assert!((end.0 - 1.0).abs() < 0.001 && (end.1 - 1.0).abs() < 0.001, "{end:?}");
}

#[test]
fn a_start_without_whole_kinematic_programs_is_refused_with_its_reason() {
    let mut bench =
        board("#1->I\nI5150=1\n#1J/\nOPEN PROG 1 CLEAR\nX1\nCLOSE\nB1\nOPEN FORWARD CLEAR\nQ7=P1\nCLOSE");
    assert_eq!(refusal(&mut bench, "R"), Some(CommandError::NO_PROGRAM));
    load(&mut bench, "OPEN INVERSE CLEAR\nWHILE(P1<5)\nP1=P1+1");
    assert_eq!(refusal(&mut bench, "R"), Some(CommandError::NO_PROGRAM), "it is open");
    load(&mut bench, "CLOSE");
    assert_eq!(refusal(&mut bench, "R"), Some(CommandError::BAD_STRUCTURE));
    load(&mut bench, "OPEN INVERSE\nENDWHILE\nCLOSE\nOPEN FORWARD CLEAR\nWHILE(1=1)\nENDWHILE\nCLOSE");
    assert_eq!(refusal(&mut bench, "R"), Some(CommandError::BAD_STRUCTURE));
    let told = |reason: &str| format!("coordinate system 1 does not start: its {reason}");
    let reasons = [
        told("inverse kinematic program is empty"),
        told("inverse kinematic program has a block that does not end"),
        "coordinate system 1: its forward kinematic program does not come to its end".to_owned(),
    ];
    assert_eq!(bench.world.board.notes, reasons);
    for line in ["X=5", "Z"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "{line}");
    }
    load(&mut bench, "I5150=0\nR");
}

#[test]
fn an_inverse_program_without_end_ends_the_motion_program() {
    let mut bench = board(
        "#1->I\nI5150=1\n#1J/\nOPEN PROG 1 CLEAR\nX1\nCLOSE\nOPEN FORWARD CLEAR\nQ7=P1\nCLOSE
        OPEN INVERSE CLEAR\nWHILE(1=1)\nENDWHILE\nCLOSE\nB1R",
    );
    bench.run(50);
    assert!(!bench.world.board.runs_program(0));
    assert_ne!(bench.world.board.coordinate_status(0)[1] & 1 << 22, 0, "run-time error");
    assert_eq!(
        bench.world.board.notes,
        ["coordinate system 1: its inverse kinematic program does not come to its end"]
    );
}
