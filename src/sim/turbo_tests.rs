//! Turbo PMAC and Turbo PMAC2: a DPRAM of 16 or 64 KiB with 32 motors, addresses of 19 bits, masks and 24-bit timers.

use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

fn bench() -> Bench {
    bare(&turbo::TURBO2)
}

/// A board at factory settings whose commands go without checksums.
fn bare(tables: &'static FirmwareTables) -> Bench {
    let mut bench = Bench::of(tables, tables.firmware);
    bench.set(4, 0.0);
    bench
}

fn send(bench: &mut Bench, line: &str) -> Vec<String> {
    let reply = bench.world.execute(line.as_bytes());
    assert_eq!(reply.error, None, "{line}");
    reply.lines
}

#[test]
fn the_servo_report_has_the_masked_motors_and_a_timer_of_24_bits() {
    let mut bench = bench();
    send(&mut bench, "I3200=1 #32J/");
    send(&mut bench, "#32J=1000");
    bench.run(5000);
    assert_eq!(send(&mut bench, "#32P"), ["1000"]);
    for (number, value) in [(47, 1.0), (48, 1.0)] {
        bench.set(number, value);
    }
    bench.world.board.memory.write_x(0, 0x12_FFFE);
    // Motors 2 and 32; bit 15 of 0x006E is set when the data are whole.
    bench.write(0x0070, 0b10);
    bench.write(0x0072, 0x8000);
    bench.run(2);
    assert_eq!([bench.read(0x006C), bench.read(0x006E)], [0x0000, 0x8013], "without a GATHER");
    let position = |motor: u32| bench.read32(0x0074 + 0x30 * (motor - 1) + 40);
    assert_eq!((position(2), position(32)), (0, 1000 * 3072));
    bench.write(0x006A, 1 << 15);
    bench.run(3);
    assert_eq!((bench.read(0x006C), bench.world.report.skipped), (0, 3));
    bench.write(0x006A, 0);
    bench.world.board.faults.servo_busy_stuck = true;
    bench.run(1);
    assert_eq!(bench.read(0x006E), 0x0013, "not ready while PMAC writes");
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn addresses_have_19_bits_and_the_dpram_64_kib() {
    let mut bench = bench();
    send(&mut bench, "WX$63FFF,$1234");
    assert_eq!(bench.read(0xFFFE), 0x1234);
    send(&mut bench, "WY$7FFFF,$ABCDEF");
    assert_eq!(send(&mut bench, "RHY$7FFFF"), ["ABCDEF"]);
    assert!(bench.world.execute(b"RX$80000").error.is_some());
    send(&mut bench, "M1->DP:$60450");
    send(&mut bench, "M1=-2");
    assert_eq!(bench.read32(0x1140), 0xFFFF_FFFE);
}

#[test]
fn the_background_report_obeys_its_own_count_and_busy_flag() {
    let mut bench = bench();
    bench.set(49, 1.0);
    bench.run(2);
    assert_eq!(bench.read(0x067A), 0, "no coordinate system is asked for");
    bench.write(0x0674, 16);
    bench.write(0x0676, 1 << 15);
    bench.run(2);
    assert_eq!(bench.read(0x067A), 0, "the host is busy");
    bench.write(0x0676, 0);
    bench.world.board.memory.write_x(0, 0x45_6788);
    bench.run(1);
    assert_eq!([bench.read(0x0678), bench.read(0x067A)], [0x6789, 0x8045]);
}

#[test]
fn with_a_period_of_0_an_update_waits_for_the_host() {
    let mut bench = bench();
    bench.write(0x0070, 1);
    bench.set(48, 1.0);
    bench.run(1);
    let first = bench.read(0x006C);
    assert_eq!(bench.read(0x006E), 0x8000);
    bench.run(5);
    assert_eq!(bench.read(0x006C), first, "I47=0: not taken yet");
    bench.write(0x006E, 0);
    bench.run(1);
    assert_eq!([bench.read(0x006C), bench.read(0x006E)], [first + 6, 0x8000]);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    bench.set(48, 0.0);
    bench.write(0x006E, 1);
    bench.run(1);
    assert!(bench.violations()[0].contains("0x006E"), "the timer is PMAC's: {:?}", bench.violations());
}

#[test]
fn updates_that_come_by_themselves_wait_for_no_host() {
    let mut bench = bench();
    bench.write(0x0070, 1);
    bench.set(47, 3.0);
    bench.set(48, 1.0);
    bench.run(1);
    let first = bench.read(0x006C);
    bench.run(6);
    assert_eq!(bench.read(0x006C) - first, 6);
}

#[test]
fn motors_can_be_reported_in_the_background() {
    let mut bench = bench();
    bench.set(48, 1.0);
    bench.set(57, 1.0);
    assert_eq!(send(&mut bench, "I48"), ["0"], "I57 switches I48 off");
    bench.write(0x0070, 1);
    bench.run(3);
    assert_eq!(bench.read(0x006E), 0, "it needs I49, too");
    bench.set(49, 1.0);
    bench.set(50, 4.0);
    bench.run(2);
    let [motors, systems] = [0x006C, 0x0678].map(|word| bench.read(word));
    assert_eq!(
        (motors, bench.read(0x006E), bench.read(0x067A)),
        (systems, 0x8000, 0x8000),
        "no coordinate system, yet motors"
    );
    bench.run(4);
    assert_eq!(bench.read(0x006C), motors, "not more than I50 servo cycles");
    bench.run(1);
    assert_eq!([0x006C, 0x0678].map(|word| bench.read(word)), [motors + 5; 2]);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

/// In both ways of reading the host gets every update, on request too: it clears the flag each time.
#[cfg(any(feature = "cli", feature = "daemon"))]
#[test]
fn the_host_takes_every_update_of_the_motors() {
    use crate::function::servo::{ServoPoll, ServoReader, ServoReading};
    for reading in [ServoReading::Optimistic, ServoReading::Handshake] {
        for period in [0, 1, 3] {
            let mut bench = bench();
            bench.set(47, period.into());
            bench.set(48, 1.0);
            let mut bus = bench.bus();
            let mut reader = ServoReader::new(&crate::map::TURBO2.servo, reading, crate::map::Selection::ALL);
            reader.set_motors(crate::map::Motors::from_bits(1 << 31 | 1));
            let mut timers = Vec::new();
            for _ in 0..60 {
                bench.run(1);
                if let ServoPoll::First(timer) | ServoPoll::Update(timer) = reader.poll(&mut bus).unwrap() {
                    timers.push(timer);
                }
            }
            let every = period.max(1);
            let steps: Vec<u32> = timers.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert_eq!(steps, vec![every; steps.len()], "{reading:?} I47={period}");
            assert!(steps.len() as u32 >= 60 / every - 3, "{reading:?} I47={period}: {timers:?}");
            let report = &bench.world.report;
            assert_eq!((report.skipped, bench.read(0x0070), bench.read(0x0072)), (0, 1, 1 << 15));
            assert!(bench.violations().is_empty(), "{:?}", bench.violations());
        }
    }
}

/// The host asks for a report of sixteen coordinate systems and gets it, while a host before it left its busy bit set.
#[cfg(any(feature = "cli", feature = "daemon"))]
#[test]
fn the_host_asks_for_coordinate_systems() {
    use crate::function::background::{BackgroundPoll, BackgroundReader};
    for period in [0, 7] {
        let mut bench = bench();
        bench.set(49, 1.0);
        bench.set(50, period.into());
        bench.write(0x0676, 1 << 15);
        let mut bus = bench.bus();
        let mut reader = BackgroundReader::new(&crate::map::TURBO2.background, crate::map::Selection::ALL);
        let mut reports = 0;
        reader.ask(&mut bus).unwrap();
        for _ in 0..100 {
            bench.run(1);
            // A bus thread polls many times in a servo cycle.
            for _ in 0..20 {
                if let BackgroundPoll::Report(_) = reader.poll(&mut bus).unwrap() {
                    reports += 1;
                    reader.ask(&mut bus).unwrap();
                    break;
                }
            }
        }
        assert!(reports >= 100 / (period + 1) - 1, "I50={period}: {reports}");
        assert_eq!((bench.read(0x0674), bench.read(0x0676)), (16, 0));
        assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    }
}

#[test]
fn lines_go_through_the_ascii_port() {
    let mut bench = bench();
    bench.set(58, 1.0);
    bench.set(3, 2.0);
    for (at, byte) in [(0x0EA0, u16::from_le_bytes(*b"#3")), (0x0EA2, u16::from(b'P'))] {
        bench.write(at, byte);
    }
    bench.write(0x0E9C, 1);
    bench.run(3);
    let [control, count, text] = [0x0F40, 0x0F42, 0x0F44].map(|at| bench.read(at));
    assert_eq!((control, count, text), (0x000D, 2, u16::from(b'0')));
    bench.write(0x0F40, 0);
    bench.run(1);
    assert_eq!(bench.read(0x0F40), 0x0006);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn variables_are_read_by_offset_and_none_are_written() {
    let mut bench = bench();
    bench.set(55, 1.0);
    send(&mut bench, "WX$8205,$7FFFFE");
    // One record at 0x1140 + 4 * $40, as PMAC has them: X, all 24 bits, to X:$8205.
    for (value, word) in [0x8205, 2, 0x1234, 0x0056, 0, 0].into_iter().zip(0..) {
        bench.write(0x1240 + 2 * word, value);
    }
    bench.write(0x104E, 0x40);
    bench.write(0x104C, 1);
    // An entry at 0x1140: X:$8205.
    bench.write(0x1140, 0x8205);
    bench.write(0x1142, 2 << 4);
    bench.write(0x104A, 0);
    bench.write(0x1048, 1);
    bench.run(3);
    assert_eq!((bench.read(0x104C), bench.read(0x1044)), (1, 1));
    assert_eq!(bench.read32(0x1144), 0x7F_FFFE);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
    // Bits below the kind: no text has a place for the higher address bits.
    bench.write(0x1142, 2 << 4 | 0x7);
    bench.run(1);
    assert!(bench.violations()[0].contains("a variable read entry has type"), "{:?}", bench.violations());
}

#[test]
fn each_of_sixteen_rotary_buffers_is_watched() {
    let mut bench = bench();
    // Buffer 16, a size that is odd.
    bench.write(0x1050 + 12 * 15 + 8, 7);
    bench.run(1);
    assert_eq!(bench.read(0x1050 + 12 * 15), 0, "no binary lines are let in");
    send(&mut bench, "&16DEFINE ROT 10");
    send(&mut bench, "OPEN ROT");
    bench.run(1);
    assert_eq!(bench.read(0x1050 + 12 * 15), 0, "text is");
    send(&mut bench, "CLOSE OPEN BIN ROT");
    bench.run(1);
    assert_eq!(bench.read(0x1050 + 12 * 15), 0x8003);
    assert!(bench.violations()[0].contains("rotary buffer 16: its size is 7"), "{:?}", bench.violations());
}

#[test]
fn gathering_takes_sources_of_both_masks() {
    let mut bench = bench();
    for (number, value) in [(5000, 2.0), (5049, 1.0), (5050, 1.0), (5051, f64::from(1 << 23))] {
        bench.set(number, value);
    }
    // Source 1 is Y:$78001, source 48 is X:$78002.
    bench.set(5001, f64::from(0x07_8001));
    bench.set(5048, f64::from(0x47_8002));
    send(&mut bench, "WY$78001,5 WX$78002,6");
    send(&mut bench, "DELETE GATHER");
    send(&mut bench, "DEFINE GATHER 4");
    send(&mut bench, "GATHER");
    bench.run(1);
    assert_eq!([bench.read32(0x1140), bench.read32(0x1144)], [5, 6]);
    assert_eq!([bench.read(0x113C), bench.read(0x113E)], [4, 2]);
}

/// The serial port's answer to `line`, as bytes.
fn serial(bench: &mut Bench, line: &str) -> String {
    String::from_utf8(bench.world.serial(line.as_bytes())).unwrap()
}

#[test]
fn a_turbo_board_tells_what_it_is() {
    for (tables, name) in [(&turbo::TURBO, "TURBO1, X4"), (&turbo::TURBO2, "TURBO2, X4")] {
        let mut bench = bare(tables);
        assert_eq!(
            send(&mut bench, "TYPE VERSION CID CPU VID TODAY TIME"),
            [name, "1.947", "602413", "DSP56303", "1", "SAT 01/01/2000", "00:00:00"]
        );
        assert_eq!(send(&mut bench, "DATE"), ["07/17/1999"]);
        // Three seconds later; a reset begins anew.
        bench.run((3100.0 / bench.world.board.cycle_ms()) as usize);
        assert_eq!(send(&mut bench, "TIME"), ["00:00:03"]);
        assert_eq!(
            send(&mut bench, "TODAY=12/31/2026 TIME=23:59 TODAY TIME"),
            ["THU 12/31/2026", "23:59:00"]
        );
        bench.run((61_000.0 / bench.world.board.cycle_ms()) as usize);
        assert_eq!(send(&mut bench, "TODAY TIME"), ["FRI 01/01/2027", "00:00:01"]);
        for line in ["TIME=24:00:00", "TIME=7", "TODAY=2/29/2026", "TODAY=1/1", "TIME="] {
            assert!(bench.world.execute(line.as_bytes()).error.is_some(), "{line}");
        }
        assert_eq!(send(&mut bench, "TIME=17:45:24 TIME"), ["17:45:24"]);
        send(&mut bench, "$$$");
        assert_eq!(send(&mut bench, "TIME"), ["00:00:00"]);
    }
}

#[test]
fn status_words_have_turbos_bits() {
    let mut bench = bench();
    assert_eq!(
        send(&mut bench, "?"),
        ["850000000000"],
        "activated, open loop, integration: as a board was seen"
    );
    assert_eq!(send(&mut bench, "??"), ["A80020000000000000"]);
    assert_eq!(send(&mut bench, "???"), ["000000000000"]);
    send(&mut bench, "&16 #32->X I3200=1 #32J/");
    bench.run(3);
    // Amplifier enabled, standing; C.S. 16, an axis of XYZ, assigned, in position.
    assert_eq!(send(&mut bench, "#32?"), ["892000F78001"]);
    assert_eq!(send(&mut bench, "&16??"), ["A80020020000000000"]);
    send(&mut bench, "OPEN PROG 1");
    bench.run(1);
    assert_eq!(send(&mut bench, "???"), ["000000080000"]);
}

#[test]
fn i24_names_the_dpram_that_the_functions_use() {
    let mut bench = bench();
    assert_eq!(send(&mut bench, "RHY$3F"), ["064000"], "Turbo User Manual p. 402");
    let counts = |bench: &mut Bench| {
        bench.run(10);
        let before = bench.world.report.updates;
        bench.run(10);
        bench.world.report.updates - before
    };
    send(&mut bench, "I47=1 I48=1");
    bench.write(0x0070, 1);
    assert_eq!(counts(&mut bench), 10);
    send(&mut bench, "I24=$6C000");
    assert_eq!((counts(&mut bench), bench.world.board.takes_ascii()), (0, false));
    send(&mut bench, "I24=*");
    assert_eq!((counts(&mut bench), bench.world.board.takes_ascii()), (10, true));
}

#[test]
fn variables_go_to_8191_and_wrap_and_have_factory_values() {
    let mut bench = bench();
    assert_eq!(send(&mut bench, "P8191=5 M8191->* M8191=6 Q8191=7 P8191 M8191 Q8191"), ["5", "6", "7"]);
    assert_eq!(send(&mut bench, "P8192=8 P0"), ["8"], "reduced, no error");
    assert_eq!(send(&mut bench, "I8191=3 I8191"), ["3"]);
    assert_eq!(
        send(&mut bench, "I3200 I3222 I5113 I6688 I5193 I6693 I6699 I24 I5049 I63 I4904"),
        ["0", "32", "0", "50", "$2000", "$2F00", "0.9998474121", "$60000", "0", "1", "$8006"]
    );
    send(&mut bench, "I130,4,100=7");
    assert_eq!(send(&mut bench, "I130,5,100"), ["7", "7", "7", "7", "2000"]);
    send(&mut bench, "I130,4,100=*");
    assert_eq!(send(&mut bench, "I130 I430"), ["2000", "2000"]);
    for line in ["I130,0,100", "I130,4", "I130,4,0", "I130,9000,1"] {
        assert!(bench.world.execute(line.as_bytes()).error.is_some(), "{line}");
    }
    assert_eq!(bench.world.board.memory.read_x(0x7_0008), 0xFF, "I92 in force");
}

#[test]
fn each_port_addresses_its_own_motor_and_group() {
    let mut bench = bench();
    send(&mut bench, "I3=2 I6=1");
    assert_eq!(serial(&mut bench, "#7&9##3\r"), "\x06");
    assert_eq!(send(&mut bench, "#&##"), ["1", "1", "0"], "another port");
    assert_eq!(serial(&mut bench, "#&##\r"), "7\r9\r3\r\x06");
    // D:$00008B and on are the actual positions, 3072 units a count; motor 25 is the first of group 3.
    send(&mut bench, "WL$C8B,-17810016");
    assert_eq!(serial(&mut bench, "\x10"), "-5797.53125 0 0 0 0 0 0 0\r\x06");
    assert_eq!(serial(&mut bench, "##4\r"), "\x07ERR003\r");
    assert_eq!(serial(&mut bench, "#25P\r"), "-5797.53125\r\x06");
    // Group 3 goes with coordinate systems 9 to 16.
    send(&mut bench, "WX$2840,$123456");
    assert!(serial(&mut bench, "\x03").starts_with("123456000000000000 A80020"));
    send(&mut bench, "$$$");
    assert_eq!(serial(&mut bench, "I4=0 I3=2\r##\r"), "\x060\r\x06", "a reset is for every port");
    assert_eq!(serial(&mut bench, "\x18"), "\x18", "I63=1: ^X is echoed");
}

#[test]
fn programs_name_the_port_that_they_speak_to() {
    let mut bench = bench();
    send(&mut bench, "I3=2 I6=1 I64=1 I5=2 I9=2");
    for line in [
        "OPEN PLC 1 CLEAR",
        "SEND\"ACTIVE\"",
        "SENDS\"SERIAL\"",
        "SENDR\"DPRAM\"",
        "SENDP\"BUS\"",
        "SENDA\"AUXILIARY\"",
        "CMD\"P1=7 P1\"",
        "CMDS\"P1\"",
        "CMDR\"P1 #99\"",
        "CMDS\"UUU\"",
        "CMD\"UUU\"",
        "DISABLE PLC 1",
        "CLOSE",
    ] {
        send(&mut bench, line);
    }
    assert_eq!(send(&mut bench, "LIST PLC 1")[2..4], ["SENDR\"DPRAM\"", "SENDP\"BUS\""]);
    assert_eq!(serial(&mut bench, "I64\r"), "1\r\x06", "the serial port is the active one");
    send(&mut bench, "ENABLE PLC 1");
    bench.run(20);
    // ^B marks unasked text, and replaces the BELL of an error. The answer to a CMD without a letter goes nowhere.
    let said = String::from_utf8(std::mem::take(&mut bench.world.board.output.serial)).unwrap();
    assert_eq!(said, "\x02ACTIVE\r\x02SERIAL\r\x027\r\x02");
    let dpram = [(0x020D, "DPRAM"), (0x010D, "7")];
    for (control, text) in dpram {
        assert_eq!(bench.read(0x0F40), control);
        let bytes = (0x0F44..).map(|at| bench.read8(at)).take_while(|&byte| byte != 0);
        assert_eq!(bytes.map(char::from).collect::<String>(), text);
        bench.write(0x0F40, 0);
        bench.run(1);
    }
    assert_eq!(bench.read(0x0F40), 0x8003);
    let mut pmac = Bench::bare("1.16D");
    assert!(pmac.world.execute(b"OPEN PLC 1").error.is_none());
    assert!(pmac.world.execute(b"SENDR\"DPRAM\"").error.is_some(), "Turbo boards know the letters");
}

#[test]
fn control_characters_go_to_the_port_that_a_program_names() {
    let mut bench = bench();
    send(&mut bench, "I3=2 I6=1 I64=1 I5=2 I9=2");
    let program = ["SENDS^M", "SEND^@", "SENDR^G", "SENDA^[", "CMDR^P", "CMD^P", "DIS PLC1"];
    send(&mut bench, "OPEN PLC 1 CLEAR");
    for line in program {
        send(&mut bench, line);
    }
    for line in ["SENDS^5", "SENDS^", "CMD^5"] {
        assert_eq!(bench.world.execute(line.as_bytes()).error.map(|error| error.0), Some(3), "{line}");
    }
    assert_eq!(send(&mut bench, "CLOSE LIST PLC 1")[..7], program);
    assert_eq!(serial(&mut bench, "I64\r"), "1\r\x06", "the serial port is the active one");
    send(&mut bench, "ENABLE PLC 1");
    bench.run(20);
    assert_eq!(bench.world.take_serial_messages(), b"\r\0");
    assert_eq!(bench.response(), (0x020D, "\x07".into()));
    assert_eq!(bench.response(), (0x010D, "0 0 0 0 0 0 0 0".into()));
    let mut pmac = Bench::bare("1.16D");
    for (line, error) in [("OPEN PLC 1", None), ("CMD^K", None), ("SEND^M", Some(3)), ("CMDS^K", Some(3))] {
        assert_eq!(pmac.world.execute(line.as_bytes()).error.map(|error| error.0), error, "{line}");
    }
}

#[test]
fn what_the_board_does_not_have_is_answered_as_a_board_without_it() {
    let mut bench = bench();
    for (line, error) in [
        ("MS0,MI910", 8),
        ("ms8,i910=7", 8),
        ("MSR0,MI4,P1", 8),
        ("LIST FORWARD", 3),
        ("LIST INVERSE", 3),
        ("#33", 3),
        ("&17", 3),
    ] {
        assert_eq!(bench.world.execute(line.as_bytes()).error.map(|error| error.0), Some(error), "{line}");
    }
    send(&mut bench, "OPEN PROG 1 CLOSE ALL DISABLE PLCC 1");
    assert_eq!(bench.world.execute(b"X5").error.map(|error| error.0), Some(5), "nothing is open");
    send(&mut bench, "DELETE GATHER DEFINE GATHER 47.0");
    for (name, error) in [("CID", 3), ("CPU", 3), ("TODAY", 3)] {
        let mut bench = Bench::bare("1.16D");
        assert_eq!(
            bench.world.execute(name.as_bytes()).error.map(|error| error.0),
            Some(error),
            "{name}, PMAC"
        );
    }
}

#[test]
fn lookahead_buffers_are_defined_downwards_and_deleted_upwards() {
    let mut bench = bench();
    for (line, error) in [
        ("&2DEFINE LOOKAHEAD 500", Some(3)),
        ("&2DEFINE LOOKAHEAD 0,10", Some(3)),
        ("&2DEF LOOKAHEAD 99999999999999999999,1", Some(6)),
        ("&2DEF LOOKAHEAD 1,99999999999999999999", Some(6)),
        ("DEFINE UBUFFER 99999999999999999999", Some(6)),
        ("DEFINE GATHER 100", None),
        ("&2DEFINE LOOKAHEAD 500,10", Some(3)),
        ("DELETE GATHER", None),
        ("&2DEFINE LOOKAHEAD 500,10", None),
        ("&2DEFINE LOOKAHEAD 500,10", Some(3)),
        ("&3DEFINE LOOKAHEAD 500,10", Some(3)),
        ("&1DEFINE LOOKAHEAD 500,0", None),
        ("&16DEF ROT 50", None),
        ("&15DEF ROT 50", None),
        ("&1DELETE LOOKAHEAD", Some(3)),
        ("&15DEL ROT", None),
        ("&16DEL ROT", None),
        ("DEFINE GATHER 100", None),
        ("&1DELETE LOOKAHEAD", Some(3)),
        ("DELETE GATHER", None),
        ("&2DEL LOOKAHEAD", Some(3)),
        ("&1DEL LOOKAHEAD", None),
        ("&2DEL LOOKAHEAD", None),
        ("&2DEL LOOKAHEAD", None),
        ("&1DEFINE LOOKAHEAD 500,10", None),
        ("SAVE $$$", None),
        ("&2DEFINE LOOKAHEAD 500,10", None),
    ] {
        assert_eq!(bench.world.execute(line.as_bytes()).error.map(|error| error.0), error, "{line}");
    }
    let free = |bench: &mut Bench| send(bench, "SIZE")[0].parse::<i64>().unwrap();
    let with_lookahead = free(&mut bench);
    send(&mut bench, "&2DELETE LOOKAHEAD");
    assert_eq!(free(&mut bench) - with_lookahead, 500 + 2 * 10);
    let mut pmac = Bench::bare("1.16D");
    for line in ["DEFINE LOOKAHEAD 500,10", "DELETE LOOKAHEAD"] {
        assert!(pmac.world.execute(line.as_bytes()).error.is_some(), "Option 6L: {line}");
    }
}

#[test]
fn rotary_buffers_are_deleted_upwards() {
    let mut turbo = bench();
    let mut pmac = Bench::bare("1.16D");
    for (line, on_turbo, on_pmac) in [
        ("&8DEF ROT 50", None, None),
        ("&7DEF ROT 50", None, None),
        ("&8DEL ROT", Some(3), None),
        ("&7DEL ROT", None, None),
        ("&8DEL ROT", None, Some(3)),
    ] {
        for (bench, error) in [(&mut turbo, on_turbo), (&mut pmac, on_pmac)] {
            assert_eq!(bench.world.execute(line.as_bytes()).error.map(|error| error.0), error, "{line}");
        }
    }
}

#[test]
fn the_shipped_start_up_reports_all_motors_and_coordinate_systems() {
    for tables in [&turbo::TURBO, &turbo::TURBO_32K, &turbo::TURBO2, &turbo::TURBO2_8K] {
        let mut bench = Bench::of(tables, tables.firmware);
        bench.world.load("shipped", tables.startup).unwrap();
        bench.run(2);
        assert_eq!([0x0070, 0x0072, 0x0674].map(|word| bench.read(word)), [0xFFFF, 0xFFFF, 16]);
        assert_eq!([0x006E, 0x067A].map(|word| bench.read(word) >> 15), [1, 1]);
        // Motor 32: activated, closed loop. Coordinate system 16: FRAX(X,Y,Z).
        assert_eq!(bench.read(0x0074 + 0x30 * 31 + 14), 0xFF89);
        assert_eq!(bench.read32(0x069C + 0x80 * 15 + 20) & 0xFF_FFFF, 0xA8_0020);
        send(&mut bench, "#32J+");
        bench.run(3000);
        assert!(send(&mut bench, "#32V")[0].parse::<f64>().unwrap() > 10.0);
        assert!(bench.violations().is_empty(), "{:?}", bench.violations());
        // The saved values come back by themselves.
        bench.world.reset();
        bench.run(2);
        assert_eq!([0x006E, 0x067A].map(|word| bench.read(word) >> 15), [1, 1]);
    }
}
