//! Commands that real programs send: their effects. A line that the board refuses has no effect.

use crate::sim::board::error::CommandError;
use crate::sim::board::firmware::{self, FirmwareTables};
use crate::sim::board::processor::PROCESSORS;
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

fn board(tables: &'static FirmwareTables) -> Bench {
    let mut bench = Bench::of(tables, tables.firmware);
    bench.set(4, 0.0);
    bench
}

fn turbo2() -> Bench {
    board(&turbo::TURBO2)
}

fn refusal(bench: &mut Bench, line: &str) -> Option<CommandError> {
    bench.world.execute(line.as_bytes()).error
}

fn send(bench: &mut Bench, lines: &str) -> Vec<String> {
    let replies = lines.lines().map(|line| {
        let reply = bench.world.execute(line.trim().as_bytes());
        assert_eq!(reply.error, None, "{line}");
        reply.lines
    });
    replies.flatten().collect()
}

#[test]
fn a_paused_plc_goes_on_where_it_stopped_and_a_disabled_one_does_not() {
    let mut bench = turbo2();
    send(
        &mut bench,
        "I5=2
        OPEN PLC 3 CLEAR
        P1=P1+1
        PAUSE PLC3
        P2=P2+1
        CLOSE
        ENABLE PLC3",
    );
    bench.run(50);
    assert_eq!(send(&mut bench, "P1 P2"), ["1", "0"], "it stands behind its own PAUSE");
    send(&mut bench, "RESUME PLC 3");
    bench.run(3);
    assert_eq!(send(&mut bench, "P1 P2"), ["2", "1"], "and comes to it again in the next scan");
    send(&mut bench, "DISABLE PLC3");
    send(&mut bench, "RES PLC3");
    bench.run(5);
    assert_eq!(send(&mut bench, "P1 P2"), ["2", "1"]);
    send(&mut bench, "ENABLE PLC3");
    bench.run(5);
    assert_eq!(send(&mut bench, "P1 P2"), ["3", "1"], "from its top");
    assert_eq!(send(&mut bench, "LIST PLC3")[1], "PAU PLC3");
    send(&mut bench, "OPEN PLC 4 CLEAR\nRES PLC3\nPAU PLC 5..7\nCLOSE");
    assert_eq!(send(&mut bench, "LIST PLC4")[..2], ["RES PLC3", "PAU PLC5..7"]);
}

#[test]
fn a_word_that_is_no_command_does_nothing_before_it_is_refused() {
    let mut bench = board(&firmware::PMAC);
    send(&mut bench, "#1J/\n&1#1->X\nOPEN PROG 1 CLEAR\nX1000\nCLOSE\nB1");
    for line in ["RESUME PLC 3", "PAUSE PLC 3", "R LINEAR", "#1J+ HELLO", "#1J+X1000", "#1J+ P E"] {
        let reply = bench.world.execute(line.as_bytes());
        assert!(reply.error.is_some() && reply.lines.is_empty(), "{line}: {reply:?}");
        bench.run(50);
        assert_eq!(send(&mut bench, "#1P"), ["0"], "{line}");
    }
    send(&mut bench, "&1 A #1 P P1=5 P1 J=*");
    for behind in
        ["P1=1", "P(P1-4)=2*(P1+1)", "I122=*", "M1->*", "M1->Y:$D200,0,8", "#1->2X+5", "#2->0", "P1=7 #1->"]
    {
        let reply = bench.world.execute(format!("&1B1 {behind} RUBISH").as_bytes());
        assert!(reply.error.is_some() && reply.lines.is_empty(), "{behind}: {reply:?}");
        bench.run(50);
        assert_eq!(send(&mut bench, "#1P P1 M1-> #1->"), ["0", "5", "*", "X"], "{behind}");
    }
    assert_eq!(refusal(&mut turbo2(), "EAVERSION"), Some(CommandError::SYNTAX));
}

#[test]
fn killed_motors_are_enabled_by_coordinate_system_and_all_together() {
    let mut bench = turbo2();
    send(&mut bench, "I100,2,100=1\n&1#1->X\n&2#2->X\n#1K#2K");
    let closed = |bench: &mut Bench| {
        let words = send(bench, "#1? #2?");
        // Bit 18 of the first word: open loop.
        [0, 1].map(|motor: usize| u32::from_str_radix(&words[motor][..6], 16).unwrap() >> 18 & 1 == 0)
    };
    bench.run(5);
    assert_eq!(closed(&mut bench), [false, false]);
    send(&mut bench, "&2e");
    bench.run(5);
    assert_eq!(closed(&mut bench), [false, true]);
    bench.world.control_character(5);
    bench.run(5);
    assert_eq!(closed(&mut bench), [true, true]);
    assert_eq!(refusal(&mut board(&firmware::PMAC), "&1e"), Some(CommandError::SYNTAX));
}

#[test]
fn a_lock_tells_who_comes_second() {
    let mut bench = turbo2();
    send(&mut bench, "LOCK2,P10\nLOCK2,P11");
    assert_eq!(send(&mut bench, "P10 P11 I4904"), ["0", "1", "$8046"]);
    send(&mut bench, "UNLOCK2\nI5=2\nOPEN PLC 1 CLEAR\nLOCK7,P12\nUNLOCK2\nDISABLE PLC1\nCLOSE\nENABLE PLC1");
    bench.run(5);
    assert_eq!(send(&mut bench, "P12 I4904"), ["0", "$8806"]);
    assert_eq!(send(&mut bench, "LIST PLC1")[..2], ["LOCK7,P12", "UNLOCK2"]);
    send(&mut bench, "$$$");
    assert_eq!(send(&mut bench, "I4904"), ["$8006"]);
    assert_eq!(refusal(&mut bench, "LOCK8,P1"), Some(CommandError::SYNTAX));
}

#[test]
fn the_time_left_of_a_move_falls_to_nothing() {
    let mut bench = turbo2();
    send(&mut bench, "#1J/\n&1#1->X\nOPEN PROG 1 CLEAR\nLINEAR INC TA100 TS0 TM1000 X1000\nCLOSE\n&1B1R");
    bench.until(20, |board| board.motors[0].moving());
    let left: f64 = send(&mut bench, "&1MOVETIME")[0].parse().unwrap();
    assert!((900.0..=1100.0).contains(&left), "{left}");
    bench.run(3000);
    assert_eq!(send(&mut bench, "&1MOVETIME"), ["0"]);
}

#[test]
fn exchanges_of_the_older_ring_protocol_fail_as_without_a_station() {
    let mut bench = turbo2();
    bench.world.board.identity.stations = true;
    for line in ["MXR0,4,P1", "MXW16,4,P1", "MX0,4", "MX0,4=$5"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::MACRO), "{line}");
    }
    assert_eq!(refusal(&mut bench, "MXR0,4"), Some(CommandError::SYNTAX));
}

#[test]
fn gathered_words_are_listed_from_a_start_in_a_count() {
    let mut bench = turbo2();
    send(&mut bench, "I5050=1 I5001=$40000F I5049=1\nDEFINE GATHER 100\nGATHER");
    bench.run(10);
    send(&mut bench, "ENDGATHER");
    assert_eq!(send(&mut bench, "LIST GATHER 0,4")[0].split(' ').count(), 4);
    assert_eq!(send(&mut bench, "LIST GATHER")[0][..51], send(&mut bench, "LIST GATHER 0,4")[0]);
}

#[test]
fn buffers_out_of_their_order_are_refused() {
    let mut bench = turbo2();
    assert_eq!(refusal(&mut bench, "OPEN ROT"), Some(CommandError::SYNTAX));
    send(&mut bench, "DEFINE GATHER 100");
    assert_eq!(refusal(&mut bench, "&1DEFINE LOOKAHEAD 100,10"), Some(CommandError::SYNTAX));
    send(&mut bench, "DELETE GATHER\n&1DEFINE LOOKAHEAD 100,10");
}

#[test]
fn an_absolute_position_comes_from_the_registers_that_are_named() {
    let mut bench = turbo2();
    // The examples of the Turbo Software Reference p. 154: 32 bits in two words; 16 and 18 bits in bytes.
    send(&mut bench, "WY$78D00,$FFFFFE,$FF\nI110=$78D00 I195=$200000\n#1$*");
    assert_eq!(send(&mut bench, "#1P"), ["4294967294"]);
    send(&mut bench, "I195=$A00000 I126=160\n#1$*");
    assert_eq!(send(&mut bench, "#1P"), ["-12"], "signed, and ten counts of I126 less");
    send(&mut bench, "I126=0 WY$78C00,$AB34,$CD12\nI110=$78C00 I195=$100004\n#1$*");
    assert_eq!(send(&mut bench, "#1P"), [0x1234.to_string()]);
    send(&mut bench, "WY$79E03,$3400,$1200,$FF00\nI110=$79E03 I195=$120005\n#1$*");
    assert_eq!(send(&mut bench, "#1P"), [0x3_1234.to_string()]);
    send(&mut bench, "WX$78000,$F12345\nI110=$78000 I195=$540000\nSAVE\n$$$");
    assert_eq!(send(&mut bench, "I4=0 #1P"), [0x1_2345.to_string()], "at power-on");
    send(&mut bench, "I180=4\nSAVE\n$$$");
    assert_eq!(send(&mut bench, "I4=0 #1P"), ["0"], "not with bit 2 of I180");

    let mut bench = board(&firmware::PMAC);
    send(&mut bench, "WY$D210,$8001\nI110=$90D210\n#1$*");
    assert_eq!(send(&mut bench, "#1P"), ["-32767"]);
}

#[test]
fn the_processor_and_the_end_of_memory_are_those_of_the_option() {
    let answers = |option: &str, firmware: &str| {
        let mut bench = turbo2();
        let identity = &mut bench.world.board.identity;
        identity.processor = *PROCESSORS.iter().find(|processor| processor.option == option).unwrap();
        identity.firmware = firmware.into();
        send(&mut bench, "$$$***\nI4=0");
        bench.run(2);
        send(&mut bench, "CPU I4908 ???")
    };
    assert_eq!(answers("5C0", "1.947")[..2], ["DSP56303", "$10800"]);
    assert_eq!(answers("5F3", "1.947")[..2], ["DSP56321", "$30000"]);
    assert_eq!(answers("5F3", "1.936")[1], "$40000", "no user buffer from the factory yet");
    let bits =
        |words: &str| [&words[..6], &words[6..]].map(|word| u32::from_str_radix(word, 16).unwrap() >> 21 & 1);
    assert_eq!(bits(&answers("5E0", "1.947")[2]), [1, 0]);
    let mut bench = turbo2();
    assert_eq!(send(&mut bench, "DEF UBUF 512\nI4908"), ["$10600"]);
    assert_eq!(send(&mut bench, "DELETE UBUF\nI4908"), ["$10800"]);
}

#[test]
fn variables_of_stations_are_hexadecimal_where_i9_says() {
    let mut bench = turbo2();
    bench.world.board.identity.stations = true;
    send(&mut bench, "MS1,I912=2 MS0,MI910=$FFFFFF000000");
    assert_eq!(send(&mut bench, "ms1,i912 ms1,i913 ms0,mi910"), ["$2", "$0", "$FFFFFF000000"]);
    assert_eq!(send(&mut bench, "I9=0 MS1,I912"), ["2"]);
}

#[test]
fn a_listing_ends_by_return_whether_it_was_entered_or_not() {
    let mut bench = turbo2();
    send(&mut bench, "OPEN PROG 1 CLEAR\nX1 Y2\nCLOSE");
    assert_eq!(send(&mut bench, "LIST PROG 1"), ["X1 Y2", "RET"]);
    assert_eq!(send(&mut bench, "LIST PROG 1,0,80 I9=3 LIST PROG 1,2"), ["0:X1 Y2", "2:RET", "2:RETURN"]);
    assert_eq!(refusal(&mut bench, "LIST PROG 1,3"), Some(CommandError::SYNTAX));
    let size = send(&mut bench, "SIZE");
    send(&mut bench, "OPEN PROG 1 CLEAR\nX1 Y2\nRETURN\nCLOSE");
    assert_eq!(send(&mut bench, "LIST PROG 1"), ["X1 Y2", "RETURN"]);
    assert_eq!(send(&mut bench, "SIZE"), size, "it takes the same room");
    for line in ["LIST PLC 5", "LIST PROG 2"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "there is none");
    }
}
