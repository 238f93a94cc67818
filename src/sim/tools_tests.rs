//! Questions of the tools that sites use to a Turbo board. Each question gets its answer: a missing answer shifts all
//! that a tool reads afterwards.

use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

/// The answer that a tool expects.
enum Answer {
    /// These lines.
    Lines(&'static [&'static str]),
    /// This many lines, of any content.
    Count(usize),
    /// One line that a tool reads as words of this many hex digits.
    Words(usize, usize),
    /// This error.
    Error(&'static str),
}

use Answer::{Count, Error, Lines, Words};

/// The tools, the line that each sends, and the answer. The board has run the shipped start-up file, and has a program.
const ASKED: &[(&str, &str, Answer)] = &[
    ("dls-pmaclib", "i6=1 i3=2 ver", Lines(&["1.947"])),
    ("dls-pmaclib", "cid", Lines(&["602413"])),
    ("dls-pmaclib", "i20 i21 i22 i23 ", Lines(&["$78400", "$0", "$0", "$0"])),
    ("dls-pmaclib", "i20..23", Lines(&["$78400", "$0", "$0", "$0"])),
    ("dls-pmaclib", "#1J^100", Lines(&[])),
    ("dls-pmaclib", "#1J^-100", Lines(&[])),
    ("dls-pmaclib", "#1J=", Lines(&[])),
    ("dls-pmaclib", "#1J+", Lines(&[])),
    ("dls-pmaclib", "#1J-", Lines(&[])),
    ("dls-pmaclib", "#1J/", Lines(&[])),
    ("dls-pmaclib", "#1HM", Lines(&[])),
    ("dls-pmaclib", "i124", Lines(&["$1"])),
    ("dls-pmaclib", "ms0,i910", Error("ERR008")),
    ("dls-pmac-control", "i65???&1??%#1?PVF m190 p99#2?PVF m290 p99", Count(16)),
    ("dls-pmac-control", "i65", Lines(&["0"])),
    ("dls-pmac-control", "I10", Lines(&["3713991"])),
    ("dls-pmac-control", "i5049", Count(1)),
    ("dls-pmac-control", "#1k", Lines(&[])),
    ("dls-pmac-control", "i5051=0 i5050=$3", Lines(&[])),
    ("dls-pmac-control", "i5001=$80008B", Lines(&[])),
    ("dls-pmac-control", "i5001 i5050 i5051", Lines(&["$80008B", "$3", "$0"])),
    ("dls-pmac-control", "i108 i109", Lines(&["96", "96"])),
    ("dls-pmac-control", "&1%50", Lines(&[])),
    ("dls-pmac-control", "&1%", Count(1)),
    ("dls-pmac-control", "&1%100", Lines(&[])),
    ("dls-pmac-control", "m7501 m7503", Lines(&["0", "0"])),
    ("dls-pmacanalyse", "i68", Lines(&["15"])),
    ("dls-pmacanalyse", "#32P", Lines(&["0"])),
    ("dls-pmacanalyse", "&16#32->", Lines(&["0"])),
    ("dls-pmacanalyse", "i0..99", Count(100)),
    ("dls-pmacanalyse", "i8100..8191", Count(92)),
    ("dls-pmacanalyse", "m5000..5031", Count(32)),
    ("dls-pmacanalyse", "p8100..8191", Count(92)),
    ("dls-pmacanalyse", "&2q1..199", Count(199)),
    ("dls-pmacanalyse", "m8100..8191->", Count(92)),
    ("dls-pmacanalyse", "m8100..8191", Count(92)),
    ("dls-pmacanalyse", "list forward,0,80", Error("ERR003")),
    ("dls-pmacanalyse", "list inverse", Error("ERR003")),
    ("dls-pmacanalyse", "list plc31,0,80", Error("ERR003")),
    ("dls-pmacanalyse", "list prog1,0,80", Lines(&["0:DWE1", "1:RET"])),
    ("dls-pmacanalyse", "list prog1,80,80", Error("ERR003")),
    ("dls-pmacanalyse", "i6841..6850", Count(10)),
    ("symetrie", "VERSION CID CPU TYPE VID DATE TIME TODAY", Count(8)),
    ("symetrie", "&2 Q20=5", Lines(&[])),
    ("symetrie", "Q20 Q21", Lines(&["5", "0"])),
    ("symetrie", "M5282", Lines(&["0"])),
    ("symetrie", "i0 i1", Lines(&["0", "0"])),
    ("bliss", "VERSION DATE TYPE", Lines(&["1.947", "07/17/1999", "TURBO2, X4"])),
    ("bliss", "I122=16", Lines(&[])),
    ("bliss", "I122", Lines(&["16"])),
    ("bliss", "#1?", Words(1, 12)),
    ("bliss", "#1P", Count(1)),
    ("bliss", "#1J/", Lines(&[])),
    ("bliss", "#1J:0", Lines(&[])),
    ("bliss", "#1J=10", Lines(&[])),
    ("bliss", "#1K", Lines(&[])),
    ("sardana", "\x02", Words(8, 12)),
    ("sardana", "\x03", Words(8, 18)),
    ("sardana", "\x10", Words(8, 1)),
    ("EPICS pmac", "cid cpu I68 &1%", Lines(&["602413", "DSP56303", "15", "100"])),
    ("EPICS pmac", "M5000 M5180 M1 M33 M7616 M7716", Count(6)),
    ("EPICS pmac", "??????", Count(2)),
    ("EPICS pmac", "#1? #1P &1?? &1#1->, &2#8->,", Count(5)),
    ("EPICS pmac", "I8 I7002 M70..73 M4034", Count(7)),
    ("EPICS pmac", "WL:$10700,$123456789ABC", Lines(&[])),
    ("EPICS pmac", "RHL$10700", Lines(&["123456789ABC"])),
    ("EPICS pmac", "&1B1", Lines(&[])),
    ("EPICS pmac", "&1A", Lines(&[])),
    ("all", "SID IDNUMBER", Lines(&["0", "0"])),
    ("all", "CLOSE ALL", Lines(&[])),
    ("all", "", Lines(&[])),
];

/// A board whose serial port answers without checksums, as tools set it.
fn board(tables: &'static FirmwareTables) -> Bench {
    let mut bench = Bench::of(tables, tables.firmware);
    bench.world.load("shipped", tables.startup).unwrap();
    bench.world.load("tools", "I4=0\nI3=2\nI6=1\nDELETE GATHER\nOPEN PROG 1 CLEAR\nDWELL1\nCLOSE\n").unwrap();
    bench
}

#[test]
fn what_tools_ask_is_answered_line_by_line() {
    let mut bench = board(&turbo::TURBO2);
    for (tool, asked, answer) in ASKED {
        let character = asked.starts_with(|c: char| c.is_ascii_control());
        let sent = if character { (*asked).to_owned() } else { format!("{asked}\r") };
        let reply = String::from_utf8(bench.world.serial(sent.as_bytes())).unwrap();
        bench.run(50);
        let said = format!("{tool}: {asked:?}: {reply:?}");
        let lines = reply.strip_suffix('\x06').map(|lines| lines.split_terminator('\r').collect::<Vec<_>>());
        match answer {
            Error(error) => assert!(reply.ends_with(&format!("\x07{error}\r")), "{said}"),
            Lines(expected) => assert_eq!(lines.as_deref(), Some(*expected), "{said}"),
            Count(count) => {
                let lines = lines.expect(&said);
                assert!(lines.len() == *count && lines.iter().all(|line| !line.is_empty()), "{said}");
            }
            Words(count, digits) => {
                let line = lines.and_then(|lines| <[&str; 1]>::try_from(lines).ok()).expect(&said);
                let words: Vec<_> = line[0].split(' ').collect();
                assert!(words.len() == *count && words.iter().all(|word| word.len() >= *digits), "{said}");
            }
        }
    }
}

#[test]
fn gathered_words_are_listed_as_tools_read_them() {
    let mut bench = board(&turbo::TURBO2);
    let mut send = |line: &str| {
        let reply = bench.world.execute(line.as_bytes());
        assert_eq!(reply.error, None, "{line}");
        reply.lines
    };
    // X:$78002, D:$88 of motor 1, Y:$78003: four words of 24 bits, two of 48.
    for line in [
        "I5000=0 I5049=1 I5051=0 I5050=$7 I5001=$478002 I5002=$878010 I5003=$078003",
        "WX$78002,$111111 WL$78010,$222222333333 WY$78003,$444444",
        "DEFINE GATHER 100",
        "GATHER",
    ] {
        send(line);
    }
    bench.run(2);
    let mut send = |line: &str| bench.world.execute(line.as_bytes()).lines;
    send("ENDGATHER");
    assert_eq!(send("LIST GATHER"), ["333333111111 444444222222 333333111111 444444222222"]);
    assert_eq!(send("LIST GATHER 1,2"), ["444444222222 333333111111"]);
    // An odd number of words: the sample is filled up.
    for line in ["DELETE GATHER", "I5050=$3", "DEFINE GATHER 100", "GATHER"] {
        send(line);
    }
    bench.run(2);
    let mut send = |line: &str| bench.world.execute(line.as_bytes()).lines;
    send("ENDGATHER");
    let two_samples = ["333333111111 000000222222 333333111111 000000222222"];
    assert_eq!(send("LIST GATHER"), two_samples);
    // The size counts words of 48 bits.
    for line in ["DELETE GATHER", "DEFINE GATHER 4", "GATHER"] {
        send(line);
    }
    bench.run(10);
    assert_eq!(bench.world.execute(b"LIST GATHER").lines, two_samples);
}
