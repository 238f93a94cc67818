//! `pmac-sim` in real time, and a host that races with it.

use std::time::Instant;

use crate::support::PATIENCE;
use crate::support::sim::Sim;

#[test]
fn real_time_goes_on_by_itself_and_refuses_steps() {
    let mut sim = Sim::start(&["--dpram-startup", "--servo-hz", "1000"]);
    let start = Instant::now();
    while sim.status("updates") < 20 {
        assert!(start.elapsed() < PATIENCE, "the servo does not run");
    }
    assert!(sim.ask("step 1").starts_with("error: step needs"));
    // Simulated time may slip behind, never run ahead.
    assert!(u128::from(sim.status("servo_cycles")) <= start.elapsed().as_millis() + 2000);
}

#[test]
fn a_racing_host_finds_no_two_updates_in_one_copy() {
    const COPIES: usize = 20_000;
    let mut sim = Sim::start(&["--dpram-startup", "--servo-hz", "5000"]);
    sim.ok("tag on");
    let start = Instant::now();
    let (mut good, mut numbers) = (0, std::collections::BTreeSet::new());
    while good < COPIES || numbers.len() < 10 {
        assert!(start.elapsed() < PATIENCE, "{good} copies of {} updates", numbers.len());
        let status = sim.read(0x0026);
        sim.memory.order_reads();
        let words: Vec<u16> =
            (0x0028..0x0030).chain(0x0048..0x007C).step_by(2).map(|at| sim.read(at)).collect();
        sim.memory.order_reads();
        if status & 0x8000 != 0 || sim.read(0x0026) != status {
            continue;
        }
        let longs: Vec<u32> =
            words.chunks(2).map(|pair| u32::from(pair[0]) | u32::from(pair[1]) << 16).collect();
        // The update under way when tags were switched on still has registers in it.
        if numbers.is_empty() && longs.iter().any(|&long| long != longs[0]) {
            continue;
        }
        assert!(longs.iter().all(|&long| long == longs[0]), "{longs:x?}");
        numbers.insert(longs[0]);
        good += 1;
    }
    assert_eq!(sim.status("violations_total"), 0);
}

#[test]
fn a_racing_host_reads_and_writes_variables_without_a_violation() {
    const ROUNDS: u16 = 300;
    let mut sim = Sim::start(&["--dpram-startup", "--servo-hz", "5000"]);
    let start = Instant::now();
    let until = |done: &dyn Fn() -> bool| {
        while !done() {
            assert!(start.elapsed() < PATIENCE, "no answer");
            std::hint::spin_loop();
        }
    };
    // Four times the servo counter from $D400 on; records at $D300.
    sim.write(0x07EE, 0xD400);
    for entry in 0..4 {
        sim.write(0x1000 + 4 * entry, 0);
        sim.write(0x1002 + 4 * entry, 2);
    }
    sim.write(0x07E8, 0);
    sim.memory.order_writes();
    sim.write(0x07EC, 4);
    sim.write(0x07D6, 0xD300);
    for round in 0..ROUNDS {
        until(&|| sim.read(0x07E8) & 1 == 1);
        sim.memory.order_reads();
        let counters = [0, 4, 8, 12].map(|at| sim.read(0x1010 + at));
        assert_eq!(counters, [sim.read(0x07EA); 4], "one pass");
        sim.memory.order_reads();
        sim.write(0x07E8, 0);

        until(&|| sim.read(0x07D4) == 0);
        for (word, value) in [0x2000, 0, round, 0, 0, 0].into_iter().enumerate() {
            sim.write(0x0C00 + 2 * word, value);
        }
        sim.memory.order_writes();
        sim.write(0x07D4, 1);
        // The panel: motor 1 there and back.
        until(&|| sim.read(0x0000) == 0);
        sim.write(0x0004, if round % 2 == 0 { 1 << 9 } else { 1 << 8 });
        sim.memory.order_writes();
        sim.write(0x0000, 1);
    }
    until(&|| sim.read(0x07D4) == 0 && sim.read(0x0000) == 0);
    sim.write_text("RY$2000");
    sim.memory.order_writes();
    sim.write(0x062C, 1);
    until(&|| sim.read(0x06D0) == 0x000D);
    let text: Vec<u8> = [0x06D4, 0x06D6].iter().flat_map(|&at| sim.read(at).to_le_bytes()).collect();
    assert_eq!(text[..3], *b"299");
    let status = sim.ask("status");
    assert!(status.contains("\"violations\":[]"), "{status}");
}
