//! Reset, save, gathering, and a board that loses its memory.

use crate::format::fixed48;
use crate::sim::board::firmware;
use crate::sim::board::gather::Activity;
use crate::sim::board::jog::Jog;
use crate::sim::board::turbo;
use crate::sim::testing::{Bench, d};

/// Free long words of a board without buffers.
const FREE: i64 = 41_301;

#[test]
fn a_reset_goes_back_to_what_was_saved_and_stops_the_servo_report() {
    let mut bench = Bench::started();
    bench.set(122, 5.0);
    bench.world.board.jog(0, Jog::To(500.0), None).unwrap();
    bench.run(5000);
    bench.write(0x0024, 1);
    bench.write_text("I19");
    bench.write(0x062C, 1);
    bench.run(5);
    assert_ne!(bench.read(0x06D0), 0);
    bench.world.reset();
    let board = &bench.world.board;
    assert_eq!(board.variables.i(122), 32.0, "the shipped file saves its values");
    assert_eq!((board.stats.resets, board.position(0), board.memory.read_x(0)), (1, 0.0, 0));
    assert_eq!(board.motor_status(0)[0] & 1 << 18, 1 << 18, "Ix80=0 leaves motors killed");
    for (offset, value) in [(0x0026, 0), (0x062C, 0), (0x06D0, 0), (0x0024, 1)] {
        assert_eq!(bench.read(offset), value, "{offset:#06x}");
    }
    bench.write(0x0024, 0);
    bench.run(50);
    assert_eq!(bench.read(0x0026), 0, "needs a new GATHER");
    bench.world.board.gather(false).unwrap();
    bench.run(1);
    assert_eq!(bench.read(0x0026), 51);
    bench.world.execute(b"$$$***");
    assert_eq!(bench.world.board.variables.i(58), 0.0);
    bench.world.reset();
    assert_eq!(bench.world.board.variables.i(58), 1.0, "the saved values stay until SAVE");
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn factory_values_last_until_the_next_reset_unless_they_are_saved() {
    let asked = "I122 I48 P5 #1->";
    let [factory, saved] = [["32", "0", "0", "0"], ["77", "1", "6", "5X"]];
    for tables in [&firmware::PMAC, &turbo::TURBO2] {
        let mut bench = Bench::of(tables, tables.firmware);
        for (line, answer) in [
            ("I122=77 I48=1 P5=6 #1->5X OPEN PROG 1 DWELL1 CLOSE", &[][..]),
            ("SAVE", &[]),
            ("$$$***", &[]),
            (asked, &factory),
            ("$$$***", &[]),
            ("$$$", &[]),
            (asked, &saved),
            ("LIST PROG 1", &["DWE1", "RET"]),
            ("$$$***", &[]),
            ("SAVE", &[]),
            ("$$$", &[]),
            (asked, &factory),
        ] {
            let reply = bench.world.execute(line.as_bytes());
            assert_eq!(reply.error, None, "{line}");
            assert_eq!(reply.lines, answer, "{line}");
        }
    }
}

#[test]
fn ix80_closes_loops_at_power_on() {
    let mut bench = Bench::started();
    bench.set(180, 1.0);
    bench.world.execute(b"SAVE");
    bench.world.reset();
    assert_eq!(bench.world.board.motor_status(0)[0] & 1 << 18, 0);
    assert_eq!(bench.world.board.motor_status(1)[0] & 1 << 18, 1 << 18);
}

#[test]
fn gather_and_endgather_count() {
    let mut bench = Bench::started();
    let board = &mut bench.world.board;
    assert!(board.gather(false).is_err(), "the servo report runs; gathering has no buffer");
    board.define_gather(Some(10), FREE).unwrap();
    board.gather(false).unwrap();
    assert!(board.gather.runs(Activity::Gathering));
    assert!(board.define_gather(None, FREE).is_err());
    assert!(board.delete_gather().is_err());
    board.end_gather().unwrap();
    assert!(!board.gather.runs(Activity::Gathering));
    bench.run(1);
    assert_eq!(bench.read(0x0026), 1, "the servo report runs on");
    bench.world.board.end_gather().unwrap();
    bench.run(5);
    assert_eq!(bench.read(0x0026), 1);
    bench.set(48, 0.0);
    bench.world.board.gather(false).unwrap();
    assert!(bench.world.board.gather.runs(Activity::Gathering), "with I48=0 the first GATHER gathers");
}

/// One short and one long source, in the DPRAM.
fn gathering(firmware: &str, mode: f64, size: u32) -> Bench {
    let mut bench = Bench::bare(firmware);
    for (variable, value) in [
        (19, 2.0),
        (20, f64::from(0b101)),
        (21, f64::from(0x40_0000)),
        (23, f64::from(0x80_002B)),
        (45, mode),
    ] {
        bench.set(variable, value);
    }
    // Motor 1 off, so that no servo cycle writes its register.
    bench.set(100, 0.0);
    bench.world.board.memory.write_d(d(0x2B), -3072);
    bench.world.board.define_gather(Some(size), FREE).unwrap();
    bench.world.board.gather(false).unwrap();
    bench
}

#[test]
fn gathered_samples_lie_in_the_dpram_in_order_of_their_sources() {
    let mut bench = gathering("1.16B", 2.0, 7);
    bench.run(1);
    assert_eq!((bench.read(0x07FC), bench.read(0x07FE)), (7, 3));
    assert_eq!(bench.world.board.global_status()[0] & 1 << 19, 1 << 19);
    bench.run(2);
    assert_eq!(bench.read(0x07FE), 6);
    assert_eq!([bench.read32(0x0800), bench.read32(0x080C)], [1, 3], "servo counter, every second cycle");
    assert_eq!(fixed48::decode(bench.read32(0x0810), bench.read32(0x0814)), -3072);
    bench.run(2);
    // 7 is rounded up to 9, then it is over.
    assert_eq!(bench.read(0x07FE), 9);
    assert!(!bench.world.board.gather.runs(Activity::Gathering));
    bench.run(10);
    assert_eq!((bench.read(0x07FE), bench.read32(0x0824)), (9, 0));
    assert!(bench.world.board.gather(false).is_err(), "needs DEFINE GATHER");
}

#[test]
fn a_round_gather_buffer_starts_again_and_later_firmware_keeps_it_elsewhere() {
    let mut bench = gathering("1.16D", 3.0, 6);
    bench.run(3);
    assert_eq!((bench.read(0x08FC), bench.read(0x08FE)), (6, 0));
    bench.run(2);
    assert_eq!((bench.read(0x08FE), bench.read32(0x0900), bench.read32(0x090C)), (3, 5, 3));
    assert_eq!(bench.read32(0x0800), 0);
}

#[test]
fn gathering_into_pmacs_own_memory_takes_free_memory() {
    let mut bench = gathering("1.16D", 0.0, 301);
    let free = bench.world.programs.free_memory(&bench.world.board);
    assert_eq!(free, 41_301 - 301);
    bench.run(5);
    assert_eq!(
        bench.world.board.gather.stored(),
        [1, 0xFF_F400, 0xFF_FFFF, 3, 0xFF_F400, 0xFF_FFFF, 5, 0xFF_F400, 0xFF_FFFF]
    );
    assert_eq!(bench.read32(0x0900), 0);
}

#[test]
fn a_buffer_larger_than_the_dpram_is_refused() {
    let mut bench = Bench::bare("1.16B");
    bench.set(45, 2.0);
    assert!(bench.world.board.define_gather(Some(3585), FREE).is_err());
    assert!(bench.world.board.define_gather(Some(0), FREE).is_err());
    bench.world.board.define_gather(None, FREE).unwrap();
    assert_eq!(bench.read(0x07FC), 3584);
}

#[test]
fn a_board_that_is_gone_reads_all_ones_and_comes_back() {
    let mut bench = Bench::started();
    bench.run(5);
    bench.world.board.faults.all_ones = true;
    bench.run(3);
    for offset in [0x0024, 0x0026, 0x0228, 0x06D0, 0x3FFE] {
        assert_eq!(bench.read(offset), 0xFFFF);
    }
    bench.world.board.faults.all_ones = false;
    bench.run(1);
    assert_eq!((bench.read(0x0024), bench.read(0x0026) & 0x8000, bench.read(0x0228)), (0, 0, 1));
    bench.run(1);
    assert_eq!(bench.read(0x0026), 10);
    bench.world.board.faults.all_zeros = true;
    bench.run(3);
    assert_eq!((bench.read(0x0026), bench.read(0x0228), bench.read(0x3FFE)), (0, 0, 0));
    bench.world.board.faults.all_zeros = false;
    bench.run(2);
    assert_eq!(bench.read(0x0026), 15);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn set_up_registers_survive_a_reset_once_saved_and_act_after_it() {
    let mut bench = Bench::bare("1.16D");
    let mut send = |line: &str| {
        let reply = bench.world.execute(line.as_bytes());
        assert_eq!(reply.error, None, "{line}");
        reply.lines.concat()
    };
    assert_eq!(send("RHX$783,10"), "000039 000004 000000 00000D 000045 000002 0000A1 000010 000060 000010");
    send("WX$786,$0E,$C5 WY$720,$00C000");
    assert_eq!(send("RHX$E009,2"), "00000D 000045", "not in force yet");
    send("$$$");
    assert_eq!(send("RHX$786,2"), "00000D 000045", "not saved");
    send("WX$786,$0E,$C5 WY$720,$00C000");
    send("SAVE");
    send("$$$");
    assert_eq!(send("RHX$786,2"), "00000E 0000C5");
    assert_eq!(send("RHX$E009,2"), "00000E 0000C5");
    assert_eq!(send("RHY$720"), "00C000");
    send("$$$***");
    assert_eq!(send("RHX$786,2"), "00000D 000045");
    assert_eq!(send("RHY$720"), "000000");
}

#[test]
fn gathering_can_wait_for_a_machine_input() {
    let mut bench = gathering("1.16D", 2.0, 40);
    let board = &mut bench.world.board;
    board.end_gather().unwrap();
    assert!(!board.gather.runs(Activity::Gathering));
    board.define_gather(Some(40), FREE).unwrap();
    board.memory.write_y(0xFFC2, 2);
    board.gather(true).unwrap();
    let state = |bench: &Bench| bench.world.board.global_status()[0] >> 17 & 0b101;
    bench.run(5);
    assert_eq!(state(&bench), 0b001, "the input was on already: it has to come anew");
    bench.world.board.memory.write_y(0xFFC2, 0);
    bench.run(5);
    assert_eq!(state(&bench), 0b001);
    bench.world.board.memory.write_y(0xFFC2, 2);
    bench.run(1);
    assert_eq!(state(&bench), 0b100);
}

#[test]
fn a_wrong_set_up_line_takes_the_dpram_from_its_host_once_it_acts() {
    for (line, is_found) in
        [("WX$786,$0E,$C5", false), ("WX$787,$44", false), ("WX$787,$45", true), ("WX$786,$FD,$41", true)]
    {
        let mut bench = Bench::bare("1.16D");
        let send =
            |bench: &mut Bench, line: &str| assert_eq!(bench.world.execute(line.as_bytes()).error, None);
        send(&mut bench, "M1->Y:$D200,0,16 M1=$1234");
        send(&mut bench, line);
        bench.run(5);
        assert_eq!(bench.read(0x0800), 0x1234, "{line}: it is not in force yet");
        send(&mut bench, "SAVE");
        send(&mut bench, "$$$");
        bench.run(5);
        assert_eq!(bench.read(0x0800), if is_found { 0x1234 } else { 0xFFFF }, "{line}");
        send(&mut bench, "$$$***");
        bench.run(5);
        assert_ne!(bench.read(0x0800), 0xFFFF, "{line}: the factory's place is the host's");
    }
}

#[test]
fn a_vme_host_finds_what_the_set_up_has_left_where_it_was() {
    use crate::sim::board::bus_setup::Found;
    let found = |line: &str| {
        let mut bench = Bench::bare("1.16D");
        bench.world.board.fit_vme();
        for line in [line, "SAVE", "$$$"] {
            assert_eq!(bench.world.execute(line.as_bytes()).error, None, "{line}");
        }
        let Found { dpram, mailboxes, interrupts } = bench.world.board.found;
        [dpram, mailboxes, interrupts]
    };
    assert_eq!(found("WX$783,$39,$04,$00,$7F,$A0"), [true, true, true], "the factory's own");
    assert_eq!(found("WX$786,$7F,$B0"), [false, false, true], "other mailboxes, and the page goes there");
    assert_eq!(found("WX$788,$02,$B1"), [true, true, false], "other vectors");
    assert_eq!(found("WX$78A,$20"), [false, true, true], "another DPRAM");
    assert_eq!(found("WX$78B,$E0"), [true, true, true], "enabled");
    assert_eq!(found("WX$78B,$00"), [false, true, true], "switched off");
}
