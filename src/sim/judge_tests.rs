//! The words that a Turbo host may write, and when: the judge finds each breach, and finds none in a host that obeys
//! the manual.

use crate::sim::board::turbo;
use crate::sim::testing::Bench;

/// A Turbo board at factory settings: its functions are off, so that none of its writes hides a write of the host.
fn board() -> Bench {
    Bench::of(&turbo::TURBO2, turbo::TURBO2.firmware)
}

#[test]
fn the_judge_finds_what_a_turbo_host_may_not_write() {
    for (offset, value, said) in [
        (0x006C, 1, "0x006C, which is PMAC's"),
        (0x006E, 0x8000, "0x006E: the host only clears Data-Ready"),
        (0x0074, 1, "0x0074, which is PMAC's"),
        (0x0672, 1, "0x0672, which is PMAC's"),
        (0x0678, 1, "0x0678, which is PMAC's"),
        (0x067A, 0x8000, "0x067A: the host only clears Data-Ready"),
        (0x067A, 0x0012, "0x067A: the host only clears Data-Ready"),
        (0x069C + 0x80 * 15, 1, "0x0E1C, which is PMAC's"),
        (0x0E9C, 2, "0x0E9C = 0x0002: the bits of 0xFFFE are reserved"),
        (0x0F40, 0x000D, "0x0F40: the host writes only 0 there"),
        (0x0F42, 5, "0x0F42, which is PMAC's"),
        (0x0F44, 5, "0x0F44: the host writes only 0 there"),
        (0x0F46, 5, "0x0F46, which is PMAC's"),
    ] {
        let mut bench = board();
        bench.write(offset, value);
        bench.run(60);
        let found = bench.violations();
        assert!(found.len() == 1 && found[0].contains(said), "0x{offset:04X}: {found:?}");
    }
}

#[test]
fn the_judge_finds_a_command_that_changes_behind_its_flag() {
    let mut bench = board();
    bench.set(58, 1.0);
    bench.write(0x0EA0, u16::from_le_bytes(*b"#1"));
    bench.write(0x0EA2, 0);
    bench.write(0x0E9C, 1);
    bench.run(1);
    bench.write(0x0EA0, u16::from_le_bytes(*b"#2"));
    bench.run(2);
    assert!(bench.violations()[0].contains("the command text changed"), "{:?}", bench.violations());
}

#[test]
fn the_judge_lets_a_turbo_host_take_its_reports() {
    // The whole word, or the flag alone: the upper part of the timer stays.
    for keep in [0, 0x7FFF] {
        let mut bench = board();
        bench.world.board.memory.write_x(0, 0x12_0000);
        for (offset, value) in [(0x0070, 0xFFFF), (0x0072, 0xFFFF), (0x0674, 16)] {
            bench.write(offset, value);
        }
        for (number, value) in [(47, 0.0), (48, 1.0), (49, 1.0), (50, 0.0)] {
            bench.set(number, value);
        }
        let mut reports = [0, 0];
        for _ in 0..60 {
            bench.run(1);
            for (count, (busy, ready)) in reports.iter_mut().zip([(0x006A, 0x006E), (0x0676, 0x067A)]) {
                let word = bench.read(ready);
                if word >> 15 == 1 {
                    bench.write(busy, 1 << 15);
                    *count += 1;
                    assert_eq!(word & 0xFF, 0x12);
                    bench.write(ready, word & keep);
                    bench.write(busy, 0);
                }
            }
        }
        assert!(reports.iter().all(|&count| count >= 20), "{reports:?}");
        assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    }
}
