//! Motors under commands, servo cycle by servo cycle.

use crate::sim::board::axes::AxisDefinition;
use crate::sim::board::jog::Jog;
use crate::sim::board::motor::flags::{PLUS, everywhere};
use crate::sim::control::carry_out;
use crate::sim::testing::{Bench, d, l};

/// Bits of the two words of `?`.
const NEGATIVE_END: u32 = 1 << 22;
const POSITIVE_END: u32 = 1 << 21;
const OPEN_LOOP: u32 = 1 << 18;
const AT_REST: u32 = 1 << 13;
const ABORTING: u32 = 1 << 12;
const SEARCHING: u32 = 1 << 10;
const AMPLIFIER: u32 = 1 << 14;
const ON_LIMIT: u32 = 1 << 11;
const HOMED: u32 = 1 << 10;
const TRIGGER_MOVE: u32 = 1 << 7;
const FATAL: u32 = 1 << 2;
const WARNING: u32 = 1 << 1;
const IN_POSITION: u32 = 1;

/// Cycles in which every move of these tests is over.
const LONG: usize = 100_000;

fn moving(bench: &Bench, motor: usize) -> bool {
    bench.world.board.motors[motor].moving()
}

fn settle(bench: &mut Bench, motor: usize) {
    bench.until(LONG, |board| board.motor_status(motor)[1] & IN_POSITION != 0);
}

fn assign(bench: &mut Bench, motor: usize, terms: &[(f64, char)], offset: f64) {
    let definition = AxisDefinition { coordinate_system: 0, terms: terms.to_vec(), offset };
    bench.world.board.axes.set(motor, Some(definition));
}

#[test]
fn a_definite_jog_ends_exactly_with_the_registers_of_the_manual() {
    let mut bench = Bench::started();
    bench.world.board.jog(2, Jog::To(-1234.5), None).unwrap();
    assert!(moving(&bench, 2));
    bench.run(100);
    let board = &bench.world.board;
    assert_eq!(board.motor_status(2)[0] & AT_REST, 0);
    assert_eq!(board.memory.read_d(d(0x080B + 2 * 0xC0)), -1234 * 3072 - 1536, "target");
    assert!(board.memory.read_x(0x20 + 2 * 0x3C) > 0, "time left");
    settle(&mut bench, 2);
    bench.run(1000);
    let board = &bench.world.board;
    assert_eq!(board.memory.read_d(d(0x28 + 2 * 0x3C)), -1234 * 3072 - 1536, "commanded");
    assert_eq!(board.position(2), -1234.5);
    assert_eq!((board.velocity(2), board.following_error(2)), (0.0, 0.0));
    assert_eq!(board.memory.read_x(0x20 + 2 * 0x3C), 0);
    assert_eq!(board.motor_status(2), [0x81_2000, AMPLIFIER | IN_POSITION]);
}

#[test]
fn following_error_and_output_go_with_velocity() {
    let mut bench = Bench::started();
    bench.world.board.jog(0, Jog::Minus, None).unwrap();
    bench.run(3000);
    let board = &bench.world.board;
    let per_cycle = -32.0 * board.cycle_ms();
    assert!((board.velocity(0) - per_cycle).abs() < 0.04, "{}", board.velocity(0));
    // 3 ms of velocity, less one cycle's step.
    let error = board.following_error(0);
    assert!((-97.0..-80.0).contains(&error), "{error}");
    let dac = f64::from((board.memory.read_x(0x3A) << 8) as i32 >> 8) / 256.0;
    assert!((dac - -32.0 / 400.0 * 32767.0).abs() < 30.0, "{dac}");
    let desired = f64::from((board.memory.read_x(0x26) << 8) as i32 >> 8) * 3.0 / 3072.0;
    assert!((desired - -32.0).abs() < 0.01, "{desired}");
    let average = f64::from((board.memory.read_y(0x082A) << 8) as i32 >> 8) / 3072.0;
    assert!((average - per_cycle).abs() < 0.04, "{average}");
    bench.world.board.jog(0, Jog::Stop, None).unwrap();
    settle(&mut bench, 0);
}

#[test]
fn jogs_count_from_where_they_say() {
    let mut bench = Bench::started();
    let go = |bench: &mut Bench, jog, end: f64| {
        bench.world.board.jog(0, jog, None).unwrap();
        bench.until(LONG, |board| !board.motors[0].moving());
        assert_eq!(bench.world.board.motors[0].commanded(), end, "{jog:?}");
    };
    go(&mut bench, Jog::ToAsPreJog(500.0), 500.0);
    go(&mut bench, Jog::ByCommanded(-100.25), 399.75);
    go(&mut bench, Jog::PreJog, 500.0);
    bench.world.board.memory.write_l(l(0x082B), 40.0);
    go(&mut bench, Jog::ByCommandedVariable, 540.0);
    go(&mut bench, Jog::ToVariable, 40.0);
    bench.run(1000);
    go(&mut bench, Jog::ByActual(0.3), 40.3125);
    bench.world.board.jog(0, Jog::RoundCommanded, None).unwrap();
    assert_eq!(bench.world.board.motors[0].commanded(), 40.0);
    assert!(bench.world.board.jog(0, Jog::Plus, Some(1.0)).is_err());
    assert!(bench.world.board.jog(8, Jog::Plus, None).is_err());
    bench.set(100, 0.0);
    assert!(bench.world.board.jog(0, Jog::Plus, None).is_err());
    assert_eq!(bench.world.board.motor_status(0)[0], 0);
}

#[test]
fn killed_and_open_loops() {
    let mut bench = Bench::started();
    bench.world.board.kill(0).unwrap();
    let [first, second] = bench.world.board.motor_status(0);
    assert_eq!((first & OPEN_LOOP, second & AMPLIFIER), (OPEN_LOOP, 0));
    bench.world.board.open_loop(0, 10.0).unwrap();
    bench.run(100);
    let board = &bench.world.board;
    // 10% of Ix69 = 20480, of 32767 for 400 counts/ms
    let expected = 2048.0 / 32767.0 * 400.0 * board.cycle_ms();
    assert!((board.velocity(0) - expected).abs() < 0.04);
    assert_eq!(board.motor_status(0)[1] & AMPLIFIER, AMPLIFIER);
    assert!(bench.world.board.open_loop(0, 100.5).is_err());
    let before = bench.world.board.position(0);
    bench.world.board.jog(0, Jog::Stop, None).unwrap();
    settle(&mut bench, 0);
    assert!((bench.world.board.position(0) - before).abs() < 1.0, "closes where it is");
}

#[test]
fn a_hand_turns_an_open_loop_and_a_closed_one_turns_back() {
    let mut bench = Bench::started();
    bench.world.board.kill(0).unwrap();
    for motor in 1..=2 {
        assert_eq!(carry_out(&mut bench.world, &format!("turn {motor} -40")), "ok");
    }
    bench.run(1);
    assert_eq!(bench.world.board.position(0), -40.0);
    bench.run(LONG);
    assert_eq!((bench.world.board.position(0), bench.world.board.position(1)), (-40.0, 0.0));
}

#[test]
fn a_held_shaft_warns_and_then_kills() {
    let mut bench = Bench::started();
    bench.world.board.inputs(0).unwrap().stalled = true;
    bench.world.board.jog(0, Jog::Plus, None).unwrap();
    bench.until(LONG, |board| board.motor_status(0)[1] & WARNING != 0);
    let error = bench.world.board.following_error(0);
    assert!((1000.0..1020.0).contains(&error), "{error}");
    bench.until(LONG, |board| board.motor_status(0)[1] & FATAL != 0);
    let [first, second] = bench.world.board.motor_status(0);
    assert_eq!(first & OPEN_LOOP, OPEN_LOOP);
    assert_eq!(second & (AMPLIFIER | FATAL | WARNING), FATAL | WARNING);
    // Ix25 bits 21-22 = 0: all motors are killed.
    assert_eq!(bench.world.board.motor_status(7)[0] & OPEN_LOOP, OPEN_LOOP);
    bench.world.board.inputs(0).unwrap().stalled = false;
    bench.world.board.jog(0, Jog::Stop, None).unwrap();
    settle(&mut bench, 0);
    assert_eq!(bench.world.board.motor_status(0)[1] & (FATAL | WARNING), 0);
}

#[test]
fn limits_stop_at_ix15_and_let_out_again() {
    for software in [true, false] {
        let mut bench = Bench::started();
        bench.world.board.jog(0, Jog::Plus, None).unwrap();
        bench.run(1000);
        if software {
            bench.set(113, bench.world.board.motors[0].commanded() + 100.0);
        } else {
            bench.world.board.inputs(0).unwrap().places[PLUS] = everywhere(true);
        }
        bench.until(LONG, |board| board.motor_status(0)[0] & POSITIVE_END != 0);
        assert_eq!(bench.world.board.motor_status(0)[0] & (ABORTING | NEGATIVE_END), ABORTING);
        let started = bench.world.board.motors[0].commanded();
        bench.until(LONG, |board| !board.motors[0].moving());
        bench.run(2);
        let [first, second] = bench.world.board.motor_status(0);
        assert_eq!((first & (AT_REST | ABORTING), second & ON_LIMIT), (AT_REST, ON_LIMIT));
        // v^2/2a at 32 counts/ms and 0.25 counts/ms^2
        let way = bench.world.board.motors[0].commanded() - started;
        assert!((2030.0..2065.0).contains(&way), "{way}");
        bench.world.board.jog(0, Jog::Plus, None).unwrap();
        bench.until(100, |board| !board.motors[0].moving());
        bench.world.board.jog(0, Jog::Minus, None).unwrap();
        bench.run(1000);
        assert!(moving(&bench, 0));
        assert_eq!(bench.world.board.motor_status(0)[1] & ON_LIMIT, 0);
    }
}

#[test]
fn homing_finds_the_index_and_comes_back_to_it() {
    let mut bench = Bench::started();
    bench.set(126, 160.0);
    bench.world.board.jog(0, Jog::To(3000.0), None).unwrap();
    settle(&mut bench, 0);
    bench.world.board.home(0).unwrap();
    bench.run(2);
    let [first, second] = bench.world.board.motor_status(0);
    assert_eq!((first & SEARCHING, second & (HOMED | TRIGGER_MOVE)), (SEARCHING, TRIGGER_MOVE));
    bench.until(LONG, |board| board.motor_status(0)[1] & HOMED != 0);
    assert_eq!(bench.world.board.motor_status(0)[0] & SEARCHING, 0);
    settle(&mut bench, 0);
    bench.run(1000);
    let board = &bench.world.board;
    assert_eq!(board.position(0), 0.0);
    assert_eq!(board.memory.read_y(0x0815), 8000, "captured encoder count");
    // The index is at 8000 of the encoder, home Ix26/16 = 10 counts further on.
    assert_eq!(board.motors[0].target(), 0.0);
    bench.world.board.inputs(0).unwrap().no_index = true;
    bench.world.board.home(0).unwrap();
    bench.run(20_000);
    assert_eq!(bench.world.board.motor_status(0)[0] & SEARCHING, SEARCHING);
    bench.world.board.inputs(0).unwrap().trigger = true;
    settle(&mut bench, 0);
    assert_eq!(bench.world.board.motor_status(0)[1] & HOMED, HOMED);
}

#[test]
fn home_is_reported_as_the_axis_offset() {
    let mut bench = Bench::started();
    assign(&mut bench, 0, &[(2000.0, 'Z')], 3000.0);
    bench.world.board.home_zero(0).unwrap();
    assert_eq!(bench.world.board.position(0), 3000.0);
    assert_eq!(bench.world.board.motor_status(0)[1] & (HOMED | 0xF0_0000), HOMED | 0x80_0000);
}

#[test]
fn a_jog_until_trigger_ends_a_distance_from_it() {
    let mut bench = Bench::started();
    bench.world.board.jog(0, Jog::To(20_000.0), Some(-250.0)).unwrap();
    assert_eq!(bench.world.board.motor_status(0)[1] & TRIGGER_MOVE, TRIGGER_MOVE);
    settle(&mut bench, 0);
    assert_eq!(bench.world.board.motors[0].commanded(), 7750.0);
    assert_eq!(bench.world.board.motor_status(0)[1] & TRIGGER_MOVE, 0);
    bench.world.board.inputs(0).unwrap().no_index = true;
    bench.world.board.jog(0, Jog::To(20_000.0), Some(-250.0)).unwrap();
    settle(&mut bench, 0);
    assert_eq!(bench.world.board.motors[0].commanded(), 20_000.0);
    assert_eq!(bench.world.board.motor_status(0)[1] & TRIGGER_MOVE, TRIGGER_MOVE);
}

#[test]
fn the_time_base_slows_and_holds_motors_of_its_coordinate_system() {
    let mut bench = Bench::started();
    assign(&mut bench, 0, &[(1.0, 'X')], 0.0);
    for motor in [0, 1] {
        bench.world.board.jog(motor, Jog::Plus, None).unwrap();
    }
    bench.world.board.set_override(0, 50.0);
    assert_eq!(bench.world.board.override_percent(0).round(), 50.0);
    bench.run(6000);
    let board = &bench.world.board;
    assert!((board.velocity(0) - 16.0 * board.cycle_ms()).abs() < 0.04);
    assert!((board.velocity(1) - 32.0 * board.cycle_ms()).abs() < 0.04);
    bench.world.board.feed_hold(0);
    // From 50% at Ix95 = 1644 a cycle: 1130 cycles.
    bench.run(1000);
    assert!(bench.world.board.velocity(0) > 0.1);
    bench.run(200);
    let held = bench.world.board.motors[0].commanded();
    bench.run(100);
    assert_eq!(bench.world.board.motors[0].commanded(), held);
    assert_eq!(bench.world.board.memory.read_x(0x0808), 0);
    assert!(bench.world.programs.run(&mut bench.world.board, 0).is_err(), "there is no program");
    bench.run(3000);
    assert_eq!(bench.world.board.override_percent(0).round(), 50.0);
    assert!(bench.world.board.motors[0].commanded() > held);
    bench.world.board.set_override(0, 500.0);
    assert!((bench.world.board.override_percent(0) - 225.88).abs() < 0.01, "saturates");
}

#[test]
fn in_position_needs_i7_more_scans() {
    let mut bench = Bench::started();
    bench.set(7, 9.0);
    bench.world.board.jog(0, Jog::Stop, None).unwrap();
    bench.world.board.kill(0).unwrap();
    bench.run(2);
    bench.world.board.jog(0, Jog::Stop, None).unwrap();
    bench.run(9);
    assert_eq!(bench.world.board.motor_status(0)[1] & IN_POSITION, 0);
    bench.run(1);
    assert_eq!(bench.world.board.motor_status(0)[1] & IN_POSITION, IN_POSITION);
}

#[test]
fn an_abort_stops_and_closes_loops() {
    let mut bench = Bench::started();
    assign(&mut bench, 0, &[(1.0, 'X')], 0.0);
    assign(&mut bench, 1, &[(1.0, 'Y')], 0.0);
    bench.world.board.jog(0, Jog::Plus, None).unwrap();
    bench.world.board.kill(1).unwrap();
    bench.run(1000);
    bench.world.programs.abort(&mut bench.world.board, 0);
    assert_eq!(bench.world.board.motor_status(0)[0] & ABORTING, ABORTING);
    assert_eq!(bench.world.board.motor_status(1)[0] & OPEN_LOOP, 0);
    bench.until(1000, |board| !board.motors[0].moving());
    assert_eq!(bench.world.board.coordinate_status(0)[0], 0xA8_0020);
    settle(&mut bench, 0);
    bench.run(1);
    assert_eq!(bench.world.board.coordinate_status(0)[1], 1 << 17);
    assert_eq!(bench.world.board.memory.read_y(0x0818), 0b11);
}

#[test]
fn axes_are_renamed_by_the_bias() {
    let mut bench = Bench::started();
    assign(&mut bench, 0, &[(100.0, 'X')], 30.0);
    bench.world.board.jog(0, Jog::To(500.0), None).unwrap();
    assert_eq!(bench.world.board.rename_axis(0, 'X', 7.0).unwrap_err().0, 11);
    settle(&mut bench, 0);
    bench.run(1000);
    bench.world.board.rename_axis(0, 'X', 7.0).unwrap();
    assert_eq!(bench.world.board.position(0), 730.0);
    assert_eq!(bench.world.board.memory.read_l(l(0x081F)), 7.0);
    bench.world.board.zero_axes(0).unwrap();
    assert_eq!(bench.world.board.position(0), 30.0);
    assert_eq!(bench.world.board.rename_axis(0, 'Y', 7.0).unwrap_err().0, 3);
    // Limits and jogs still count from home.
    assert_eq!(bench.world.board.motors[0].commanded(), 500.0);
}

/// A bench of a Turbo PMAC2 whose first motor stands at the shaft's zero, with its switches in `places`.
fn flagged(places: &[&str]) -> Bench {
    let mut bench = Bench::of(&crate::sim::board::turbo::TURBO2, "1.947");
    for place in places {
        assert_eq!(carry_out(&mut bench.world, &format!("place 1 {place}")), "ok");
    }
    for line in ["I123=-10 I115=100 I119=1", "#1J/"] {
        assert_eq!(bench.world.execute(line.as_bytes()).error, None);
    }
    bench
}

#[test]
fn a_search_finds_the_edge_of_the_flag_that_its_channel_selects() {
    // I7012 and I7013, the flag's place, and the shaft's position there: the flag comes on, or goes off.
    for (setting, place, edge) in [
        ("I7012=2 I7013=0", "home -2500 -1500", -1500.0),
        ("I7012=2 I7013=3", "user -2500 -1500", -1500.0),
        ("I7012=10 I7013=0", "home -1500 100", -1500.0),
        ("I7012=1", "home -2500 -1500", -8000.0),
        ("I7012=3 I7013=0", "home -9000 -7900", -8000.0),
        ("I125=$3440", "home -2500 -1500", -8000.0),
    ] {
        let mut bench = flagged(&[place]);
        for line in [setting, "#1HM"] {
            assert_eq!(bench.world.execute(line.as_bytes()).error, None);
        }
        bench.until(LONG, |board| board.motor_status(0)[1] & HOMED != 0);
        settle(&mut bench, 0);
        bench.run(500);
        let board = &bench.world.board;
        assert_eq!(board.position(0), 0.0, "{setting}");
        assert!((board.motors[0].shaft() - edge).abs() < 0.1, "{setting}: {}", board.motors[0].shaft());
    }
}

#[test]
fn limit_switches_and_hard_stops_have_their_places() {
    let mut bench = flagged(&["minus -10000000 -3000", "stop 2000 10000000"]);
    let board = &mut bench.world.board;
    board.jog(0, Jog::Minus, None).unwrap();
    bench.until(LONG, |board| !board.motors[0].moving());
    assert_eq!(bench.world.board.motor_status(0)[1] & ON_LIMIT, ON_LIMIT);
    assert_eq!(bench.world.board.motor_status(0)[0] & NEGATIVE_END, NEGATIVE_END);
    // Bit 17 of I124 lets the motor go on.
    for line in ["I124=$20001", "#1J:-1000"] {
        assert_eq!(bench.world.execute(line.as_bytes()).error, None);
    }
    settle(&mut bench, 0);
    assert_eq!(bench.world.board.motor_status(0)[0] & NEGATIVE_END, 0);
    // Bit 1 of I197: the warning following error is the trigger.
    for line in ["I111=320000 I197=3", "#1J=100000^-500"] {
        assert_eq!(bench.world.execute(line.as_bytes()).error, None);
    }
    bench.until(LONG, |board| board.motor_status(0)[1] & TRIGGER_MOVE == 0);
    settle(&mut bench, 0);
    bench.run(500);
    let shaft = bench.world.board.motors[0].shaft();
    assert!((1460.0..=1500.0).contains(&shaft), "{shaft}");
}
