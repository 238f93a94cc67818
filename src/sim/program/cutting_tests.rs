//! Cutter radius compensation on the whole board: the path of the axes.

use crate::sim::board::Board;
use crate::sim::testing::Bench;

fn send(bench: &mut Bench, text: &str) {
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let reply = bench.world.execute(line.as_bytes());
        assert_eq!(reply.error, None, "{line}");
    }
}

fn position(board: &Board) -> [f64; 2] {
    let mut axes = [0.0; 9];
    board.axis_positions(0, &mut axes);
    [axes[6], axes[7]]
}

/// Runs a program from (0, 0); returns the path, the end and the second `??` word.
fn run(program: &str) -> (Vec<[f64; 2]>, [f64; 2], u32) {
    let mut bench = Bench::started();
    send(
        &mut bench,
        "I13=2 I89=0.9998 I111=0 I211=0 I116=1E6 I117=1E6 I216=1E6 I217=1E6"
            .replace("1E6", "1000000")
            .as_str(),
    );
    send(&mut bench, "&1 #1->1000X #2->1000Y\nOPEN PROG 1 CLEAR\nLINEAR ABS TA1 TS0 F100 CCR1");
    send(&mut bench, program);
    send(&mut bench, "CLOSE B1 R");
    let mut way = Vec::new();
    bench.until(200_000, |board| {
        way.push(position(board));
        board.coordinate_status(0)[0] & 1 == 0
    });
    let board = &bench.world.board;
    (way, position(board), board.coordinate_status(0)[1])
}

/// Distance of `point` from the outline of the square (0,0) to (10,10).
fn from_square([x, y]: [f64; 2]) -> f64 {
    let out = |v: f64| (v - 10.0).max(-v);
    let (dx, dy) = (out(x), out(y));
    if dx > 0.0 && dy > 0.0 { dx.hypot(dy) } else { dx.max(dy) }
}

#[test]
fn outside_a_square_the_cutter_stays_a_radius_away_and_goes_round_its_corners() {
    // Clockwise, cutter to the left; in from (-5, 0), out to (-5, -1).
    let (way, end, status) = run("X-5\nCC1 X0 Y0\nY10\nX10\nY0\nX0\nCC0 X-5 Y-1");
    let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-6;
    assert!(close(end, [-5.0, -1.0]), "{end:?}");
    assert_eq!(status >> 22 & 1, 0);
    // From (-1, 0), beside (0, 0), to (0, -1), beneath it.
    let begun = way.iter().position(|p| p[0] < -4.9).unwrap();
    let first = begun + way[begun..].iter().position(|p| from_square(*p) < 1.001).unwrap();
    let last = way.iter().rposition(|p| from_square(*p) < 1.001).unwrap();
    for point in &way[first..=last] {
        // Blending rounds the corners slightly.
        assert!((from_square(*point) - 1.0).abs() < 0.02, "{point:?}");
    }
    assert!(way.iter().any(|p| (p[0] - 10.707).abs() < 0.06 && (p[1] - 10.707).abs() < 0.06));
    assert!(
        way.iter().any(|p| close(*p, [-1.0, 5.0]) || (p[0] + 1.0).abs() < 1e-3 && p[1] > 1.0 && p[1] < 9.0)
    );
}

#[test]
fn inside_a_square_paths_meet_and_an_arc_has_a_smaller_radius() {
    let (way, end, _) = run("CC2 X1 Y1\nY10\nX10\nCIRCLE1 X5 Y5 I-2.5 J-2.5\nLINEAR X2 Y5\nCC0 X0 Y0");
    assert!(end[0].abs() < 1e-6 && end[1].abs() < 1e-6, "{end:?}");
    // To the right of going up along X=1 is X=2; beneath Y=10 is Y=9.
    assert!(way.iter().any(|p| (p[0] - 2.0).abs() < 1e-3 && (p[1] - 5.0).abs() < 1.0));
    assert!(way.iter().any(|p| (p[1] - 9.0).abs() < 1e-3 && (p[0] - 5.0).abs() < 1.0));
    assert!(!way.iter().any(|p| p[1] > 9.0 + 1e-3));
    // Around (7.5, 7.5) at 2.5 * sqrt(2) - 1.
    let radius = |p: &[f64; 2]| (p[0] - 7.5).hypot(p[1] - 7.5);
    assert!(
        way.iter().any(|p| (radius(p) - (12.5f64.sqrt() - 1.0)).abs() < 1e-3 && p[0] > 7.5 && p[1] < 7.5)
    );
}

#[test]
fn a_cutter_that_does_not_fit_is_a_run_time_error() {
    // A notch half a unit wide, with a cutter of radius 1.
    let (_, end, status) = run("CC1 X5 Y0\nX10\nY0.5\nX5\nCC0 X0");
    assert_eq!(status >> 22 & 1, 1, "{status:06X}");
    assert_eq!(status >> 10 & 1, 1);
    assert!(end[0] < 10.0);
    // Without segmentation there is no compensation.
    let mut bench = Bench::started();
    send(
        &mut bench,
        "&1 #1->1000X #2->1000Y\nOPEN PROG 1 CLEAR\nLINEAR TA1 TS0 F100 CCR1 CC1 X5\nX10\nCLOSE B1 R",
    );
    bench.until(200_000, |board| board.coordinate_status(0)[0] & 1 == 0);
    assert_eq!(position(&bench.world.board)[1], 0.0);
}
