//! Rotary programs that are ended.

use super::*;
use crate::sim::board::firmware::{self, FirmwareTables};
use crate::sim::board::turbo;

/// The board of all tests, with the firmware of `tables`.
fn bench_of(tables: &'static FirmwareTables) -> Bench {
    let mut bench = Bench::of(tables, tables.firmware);
    bench.world.load("shipped", tables.startup).unwrap();
    with_axes(bench)
}

/// The board frees a line at once when the line is executed, also the last line of a program that is ended: B0 points to the
/// lines to come, and `PR` counts only those (Turbo Software Reference p. 286). An abort loses the
/// calculated moves (Turbo User Manual p. 319).
#[test]
fn no_line_that_was_executed_comes_back_when_the_program_is_ended() {
    for family in [&firmware::PMAC, &turbo::TURBO2] {
        for (end, left) in [("Q", 0), ("A", 0), ("/", 0), ("\\", 0), ("Q", 6), ("A", 6), ("/", 6)] {
            for (mode, step) in [("LINEAR", 37), ("SPLINE1", 137), ("RAPID", 137)] {
                for cycles in (1..1200).step_by(step) {
                    let mut bench = bench_of(family);
                    lines(&mut bench, "&1DEFINE ROT 30\nB0 OPEN ROT\nINC TM50 TA20 TS5");
                    lines(&mut bench, mode);
                    lines(&mut bench, "X1 Y2\nX-1 Y2\nX1 Y2");
                    for _ in 0..left {
                        lines(&mut bench, "X1000 Y1000");
                    }
                    lines(&mut bench, "CLOSE\n&1R");
                    bench.run(cycles);
                    lines(&mut bench, &format!("&1{end}"));
                    bench.until(LONG, |board| !running(board));
                    let what = format!("{} {end} {left} {mode} {cycles}", family.firmware);
                    let ahead = lines(&mut bench, "PR");
                    lines(&mut bench, "B0");
                    assert_eq!(lines(&mut bench, "PR"), ahead, "{what}");
                    let rotary = bench.world.programs.store.rotary(0).unwrap();
                    let listed = rotary.lines().count().to_string();
                    assert_eq!([listed], *ahead, "{what}: {ahead:?}");
                }
            }
        }
    }
}
