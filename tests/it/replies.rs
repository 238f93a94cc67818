//! The board's replies, byte for byte as the manuals print them, over the serial port (tests/data/replies.json).
//!
//! A vector's context is prose; [`SETUPS`] says by number how the board gets into it. What cannot be shown yet is in
//! [`WAITING`], by number, with the reason.

use std::collections::BTreeSet;

use pmac_dpram::sim::board::dpram::Dpram;
use pmac_dpram::sim::board::identity::Identity;
use pmac_dpram::sim::board::memory::Memory;
use pmac_dpram::sim::board::{Board, firmware, turbo};
use pmac_dpram::sim::world::World;
use proptest::prelude::*;

/// How the board comes into the context of vectors: the numbers, and what is sent before.
///
/// The answers to the preparation are not looked at, but it must not ring the bell.
pub const SETUPS: &[(&[u32], &str)] = &[
    (&[1, 2, 3], "I3=0 I6=0 P1=25 P2=50 P3=75\r"),
    (&[5, 6], "I3=1 I6=0 P1=25 P2=50 P3=75\r"),
    (&[7, 9], "I3=2 I6=0 P1=25 P2=50 P3=75\r"),
    (&[10, 11], "I3=3 I6=0 P1=25 P2=50 P3=75\r"),
    (&[13], "I3=0 I6=1\r"),
    (&[14], "I3=2 I6=3\r"),
    (&[15], "I3=1 I6=1\r"),
    (&[17, 19], "I3=2 I4=1\r"),
    (&[18], "I3=2 I4=1\rJ+\x0e"),
    (&[21, 22], "I3=2 I6=1 I9=2 &1#4->5000A\r"),
    (&[23], "I3=2 I6=1 I9=2 &1#4->5000A\r#4->0\r"),
    (
        &[25, 26, 27, 29, 30, 31, 33, 34, 35, 37, 39, 53, 54, 55, 57, 63, 71, 73, 74, 75, 79, 82, 85],
        "I3=2 I6=1 I9=2\r",
    ),
    (&[38], "I3=2 I6=1 I9=2 I10=3713707\r&1%500\r"),
    (&[41], "I3=2 I6=1 I9=2 WX$818,$A8002A WY$817,$020010\r"),
    (&[42], "I3=2 I6=1 I9=2 I5=2\r"),
    (&[43], "I3=2 I6=1 I9=2 I130=60000 I131=5000 I132=5000 I133=50000 I134=1 I135=20000\r"),
    (&[45], "I3=2 I9=1 I125=$C000\r"),
    (&[46], "I3=2 I9=2 I125=$C000\r"),
    (&[47], "I3=2 I9=3 I125=$C000\r"),
    (&[58], "I3=2 I6=1 I9=2 I130=2000\rI130=1.25*I130\r"),
    (&[59], "I3=2 I6=1 I9=2\rI3=5\r"),
    (&[61], "I3=2 I6=1 I9=2 P25=10 I120=45\r"),
    (&[62], "I3=2 I6=1 I9=2 P25=10 I120=45\rI120 = (I120+P25*3)\r"),
    (&[65], "I3=2 I6=1 I9=2 M0->X:$770,24 M0=3548976\r"),
    (&[66], "I3=2 I6=1 I9=2 M165->L:$770 M165=5.75\r"),
    (&[67], "I3=2 I6=1 I9=2 M1..3->Y:$FFC2,0 M2->* M2=0 M1=1\r"),
    (&[69], "I3=2 I6=1 I9=2 M101->X:$C001,24,S M102->Y:$C003,8,16,S M103->X:$C003,24,S\r"),
    (&[70], "I3=2 I9=3 M11->Y:$FFC2,0\r"),
    (&[77], "I3=2 I6=1 I9=2 &1Q255=-3.4578\r"),
    (&[78], "I3=2 I6=1 I9=2 &1Q101=0 Q102=98.5 Q103=-0.333333333\r"),
    (&[86], "I3=2 I6=1 I9=2 I100=1 I200=1\r"),
    // D:$002B and D:$0067 are the actual positions of motors 1 and 2, 3072 units a count.
    (&[102], "I3=2 I6=1 I9=2 WL$2B,6128640\r"),
    (&[103], "I3=2 I6=1 I9=2 WL$67,-1536\r"),
    (&[110], "I3=2 I6=1 I9=2 WX$1000,$123456,$789012,$345678\r"),
    (&[81], "I3=2 I6=1 I9=2 DEFINE TCOMP 100,100000\r"),
    (&[87], "I3=2 I6=1\r"),
    (&[89], "I3=2 I6=1\r&2 DEFINE ROT 100\r&1 DEFINE ROT 100\r"),
    (&[90], "I3=2 I6=1\r&2 DEFINE ROT 100\r&1 DEFINE ROT 100\r&1 B0 &2 B0\r"),
    (&[91], "I3=2 I6=1\r&2 DEFINE ROT 100\r&1 DEFINE ROT 100\r&1 B0 &2 B0\rOPEN ROT\r"),
    (
        &[93],
        "I3=2 I6=1 I100=1 I200=1\r&1#1->X &2#2->X\r#1J/#2J/&2 DEFINE ROT 100\r&1 DEFINE ROT 100\r&1 B0 &2 B0\rOPEN ROT\r\
         &1 X10 Y10 F5\r&2 X30 Y30 F30\r",
    ),
    (&[94], "I3=2 I6=1 I9=2\r&1 DEFINE ROT 100\rB0 OPEN ROT\r"),
    (&[95], "I3=2 I6=1 I9=2\r&1 DEFINE ROT 100\rOPEN PROG 1\r"),
    (
        &[
            121, 122, 123, 125, 126, 127, 129, 130, 131, 133, 134, 135, 137, 138, 139, 141, 142, 143, 145,
            146, 147, 149, 150, 151, 153,
        ],
        "I3=2 I6=1 DEFINE ROT 100\rB0 OPEN ROT\r",
    ),
    // A board without buffers has that much free.
    (&[111], "I3=2 I6=1 I9=2 DELETE GATHER\r"),
    // Turbo boards; at the factory they send checksums (I4=1, Turbo Software Reference p. 38), and the vectors have none.
    (&[49], "I4=0 I3=2 I9=1 I125=$78000\r"),
    (&[50], "I4=0 I3=2 I9=2 I125=$78000\r"),
    (&[51], "I4=0 I3=2 I9=3 I125=$78000\r"),
    (&[97], "I4=0 I3=2 I6=1 I9=2 &1#1->X #1J/\rOPEN PROG 1\rDWELL 100000\rCLOSE\rB1R\r"),
    (&[98], "I4=0 I3=2 I6=1 I9=2\rOPEN PROG 255\r"),
    (&[99], "I4=0 I3=2 I6=1 I9=2\rOPEN PROG 255\rCLOSE\r"),
    // X:$0000EF + $80 a motor holds the averaged velocity, 3072 units a count.
    (&[105], "I4=0 I3=2 I6=1 I9=2 WX$36F,$FFCD9A\r"),
    (&[106], "I4=0 I3=2 I6=1 I9=2 WX$16F,$5B33\r"),
    (&[107, 109, 114, 119], "I4=0 I3=2 I6=1 I9=2\r"),
    (&[115], "I4=0 I3=2 I124=$820401\r"),
    (&[117, 118], "I4=0 I3=0\r$$$***\rI4=0 I3=2\r"),
];

/// The vectors that cannot be shown, and why.
const WAITING: &[(&[u32], &str)] = &[
    (&[154, 155, 157, 158, 159, 161, 162], "the compiler of binary rotary programs"),
    (&[83, 101], "Option 6L, lookahead"),
    (&[113], "the MACRO option"),
];

#[derive(serde::Deserialize)]
struct Vectors {
    replies: Vec<Vector>,
}

#[derive(serde::Deserialize)]
pub struct Vector {
    pub id: u32,
    context: String,
    pub send: String,
    pub expect: String,
}

pub fn vectors() -> Vec<Vector> {
    let vectors: Vectors = serde_json::from_str(include_str!("../data/replies.json")).unwrap();
    vectors.replies
}

impl Vector {
    /// The board of its context. The manual's Turbo boards answer `VERSION` with 1.934.
    fn board(&self) -> Identity {
        let turbo = self.is_turbo();
        if turbo { Identity::new(&turbo::TURBO2, "1.934") } else { Identity::new(&firmware::PMAC, "1.16D") }
    }

    fn is_turbo(&self) -> bool {
        self.context.starts_with("Turbo")
    }

    /// The same board as `pmac-sim` is told.
    pub fn options(&self) -> &'static [&'static str] {
        if self.is_turbo() { &["--family", "turbo2", "--firmware", "1.934"] } else { &[] }
    }
}

/// A board with a host on its serial port.
struct Bench {
    world: World,
}

impl Bench {
    fn new() -> Self {
        Self { world: World::alone(&firmware::PMAC).unwrap() }
    }

    fn of(identity: Identity) -> Self {
        let tables = identity.tables;
        let memory = Memory::new(Dpram::private(tables.family.length).unwrap(), tables);
        Self { world: World::new(Board::new(memory, identity, None, None)) }
    }

    fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.world.serial(bytes)
    }
}

/// Runs lines at I3=2, I6=1 and compares the whole conversation.
#[track_caller]
fn converse(lines: &[(&str, &str)]) {
    let mut bench = Bench::new();
    bench.send(b"I3=2 I6=1\r");
    for (line, reply) in lines {
        let got = bench.send(format!("{line}\r").as_bytes());
        assert_eq!(String::from_utf8_lossy(&got), *reply, "{line}");
    }
}

fn numbers(table: &[(&[u32], &str)]) -> Vec<u32> {
    table.iter().flat_map(|(ids, _)| ids.iter().copied()).collect()
}

#[test]
fn every_vector_is_shown_or_waits_for_a_reason() {
    let listed = [numbers(SETUPS), numbers(WAITING)].concat();
    let distinct: BTreeSet<u32> = listed.iter().copied().collect();
    assert_eq!(listed.len(), distinct.len(), "a vector is listed twice");
    assert_eq!(distinct, vectors().iter().map(|vector| vector.id).collect());
}

#[test]
fn replies_byte_for_byte_of_every_family() {
    let mut wrong = Vec::new();
    for vector in vectors() {
        let Some((_, setup)) = SETUPS.iter().find(|(ids, _)| ids.contains(&vector.id)) else { continue };
        let mut bench = Bench::of(vector.board());
        let prepared = bench.send(setup.as_bytes());
        assert!(!prepared.contains(&7), "the preparation of vector {} fails", vector.id);
        let got = bench.send(vector.send.as_bytes());
        if got != vector.expect.as_bytes() {
            let got = String::from_utf8_lossy(&got).into_owned();
            wrong.push(format!(
                "{} ({}): {:?} gives {got:?}, not {:?}",
                vector.id, vector.context, vector.send, vector.expect
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_definitions_and_assignments_leave_behind() {
    converse(&[
        ("&2#4->5000A", "\x06"),
        ("#4->", "5000A\r\x06"),
        ("&1#4->", "0\r\x06"),
        ("#4->X", "\x07ERR003\r"),
        ("#4->0 &2#4->", "5000A\r\x06"),
        ("&1#8->3333.333Z-666.667 #8->", "3333.333Z-666.667\r\x06"),
        ("#8 ->", "\x07ERR003\r"),
        ("&2#4->0", "\x06"),
        ("&1#4->X", "\x06"),
        ("UNDEFINE #4->", "0\r\x06"),
        ("342", "\x06"),
        ("P0 $1F", "342\r\x07ERR003\r"),
        ("$1F", "\x06"),
        ("P0", "31\r\x06"),
        ("M1..3->Y:$770,0,4 M1=20 M3", "4\r\x06"),
        ("M0..1023->*", "\x06"),
        ("M3->", "*\r\x06"),
        ("I5=9 I5", "1\r\x06"),
        ("I130..132=7 I130..132=* I130..132", "2000\r1280\r1280\r\x06"),
        ("I1024", "\x07ERR003\r"),
        ("I5..3", "\x07ERR003\r"),
        ("P(5*2)=3 P10", "3\r\x06"),
        ("P1=10*2/3 P1", "6.666666667\r\x06"),
        ("P1=+P2", "\x07ERR003\r"),
        // An ampersand after a value is an operator, whatever the blanks.
        ("P1=6 &3 P1", "2\r\x06"),
        ("&2Q0=5", "\x06"),
        ("&1Q512", "5\r\x06"),
        ("P1=7 RHL$1001", "700000000802\r\x06"),
    ]);
}

#[test]
fn addressing_is_modal_and_shared_by_lines() {
    converse(&[
        ("#&@", "1\r1\r0\r\x06"),
        ("#3&2@4", "\x06"),
        ("# & @", "3\r2\r4\r\x06"),
        ("#9", "\x07ERR003\r"),
        ("&0", "\x07ERR003\r"),
        ("#", "3\r\x06"),
        // The reset brings back I3=1, and what follows on the line is lost with it.
        ("$$$ P1", "\n"),
        ("#&", "\n1\r\n1\r\n"),
    ]);
}

#[test]
fn errors_by_situation() {
    converse(&[
        ("", "\x06"),
        ("X1000 Y1000", "\x07ERR005\r"),
        ("LINEAR", "\x07ERR005\r"),
        ("DWELL100", "\x07ERR005\r"),
        ("F5", "\x07ERR005\r"),
        ("M1==1", "\x07ERR005\r"),
        ("HOME1,2", "\x07ERR005\r"),
        ("CLEAR", "\x07ERR005\r"),
        ("CLOSE", "\x06"),
        ("OPEN ROT", "\x07ERR003\r"),
        ("OPEN PROG 0", "\x07ERR003\r"),
        ("OPEN PLC 32", "\x07ERR003\r"),
        ("LIST", "\x07ERR005\r"),
        ("LIST PROG 1", "\x07ERR003\r"),
        ("PC", "\x07ERR003\r"),
        ("PR", "\x07ERR003\r"),
        ("B1", "\x07ERR003\r"),
        ("R", "\x07ERR015\r"),
        ("S", "\x07ERR015\r"),
        ("##", "1\r1\r\x06"),
        ("#2J+", "\x07ERR003\r"),
        ("#1O101", "\x07ERR003\r"),
        ("%-5", "\x07ERR003\r"),
        ("GATHER", "\x07ERR003\r"),
        ("DEFINE GATHER 100 GATHER ENDGATHER DELETE GATHER", "\x06"),
        ("RX$10000", "\x07ERR003\r"),
        ("RX$1000,17", "\x07ERR003\r"),
        ("WX$FFFF,1,2", "\x07ERR003\r"),
        ("WX$1000", "\x07ERR003\r"),
        ("; comment", "\x07ERR003\r"),
        ("P1=5;comment", "\x07ERR003\r"),
        ("PASSWORD=aBc", "\x06"),
        ("PASSWORD", "aBc\r\x06"),
        ("VERSION TYPE DATE", "1.16D\rPMAC1, ISA, FLASH, PID, CLK X1\r07/17/1999\r\x06"),
    ]);
}

#[test]
fn a_running_program_keeps_its_motors() {
    converse(&[
        ("&2#1->X I200=1", "\x06"),
        // Bit 0 of the first status word of &2: a program runs.
        ("WX$8D8,$A80001", "\x06"),
        ("#1J+", "\x07ERR001\r"),
        ("K", "\x07ERR001\r"),
        ("HM", "\x07ERR001\r"),
        ("#2J+", "\x06"),
        ("B0", "\x07ERR001\r"),
        ("X=5", "\x07ERR001\r"),
        ("Z", "\x07ERR001\r"),
        ("UNDEFINE", "\x07ERR001\r"),
        ("&1UNDEFINE ALL", "\x07ERR001\r"),
        ("&2#1->0", "\x07ERR001\r"),
        ("SAVE", "\x07ERR001\r"),
        ("A #1J/", "\x06"),
    ]);
}

#[test]
fn lines_that_drivers_send() {
    converse(&[
        ("I300=1 I200=1", "\x06"),
        ("#3 I322=10 I320=100 J=5000", "\x06"),
        ("I322=12.5 I320=80 #3 J^1000", "\x06"),
        ("#3 HOME", "\x06"),
        ("#3 J/ M340=1", "\x06"),
        ("#3K M361=0", "\x06"),
        ("&2A Q71=Q81", "\x06"),
        ("#1J=100^5 J:-20^-5 J^*^3 J=* J:* J==7.5 J! J=", "\x06"),
        ("J=#3J-", "\x06"),
        ("i322 I320", "12.5\r80\r\x06"),
        ("&2 INC(X,R) ABS FRAX(X,Y) ??", "280020000000\r\x06"),
        ("I113 I114 I130 I131 I133", "0\r0\r2000\r1280\r0\r\x06"),
        ("$ $* $", "\x06"),
        ("&1H/\\Q%", "100\r\x06"),
    ]);
}

#[test]
fn dpram_ascii_forces_the_handshake_once() {
    converse(&[
        ("I3=3 I6=3 I58=1", "\x06"),
        ("I3 I4 I6", "2\r0\r1\r\x06"),
        ("I3=3", "\x06"),
        ("I58", "\n1\r\x06"),
    ]);
    let mut bench = Bench::new();
    bench.send(b"I58=1\r\x1a");
    assert_eq!(bench.send(b"I58\r"), b"0\r");
}

#[test]
fn programs_are_stored_and_listed() {
    converse(&[
        ("OPEN PROG 10", "\x06"),
        ("OPEN PLC 1", "\x07ERR007\r"),
        ("CLEAR SIZE", "-41301\r\x06"),
        ("linear abs f ( p1 * 2 )", "\x06"),
        ("X10 Y20.5 Z(P1+SIN(30))", "\x06"),
        ("N10 X1000:50 Y3^-0.01", "\x06"),
        ("IF (P1>5 AND P2!<3 OR (P3~2)) CMD\"#1J+ abc\"", "\x06"),
        ("WHILE(M11=0) WAIT", "\x06"),
        ("IF(P1=1)", "\x06"),
        ("ENDWHILE", "\x07ERR009\r"),
        ("P(P1+5)=-3 M1==1 M2|=$0F Q5=P1+2*3", "\x06"),
        ("ELSE", "\x06"),
        ("HOME1..3,5 HMZ 2 ENA PLC 1,3..5", "\x06"),
        ("ENDIF", "\x06"),
        ("DWE250 DLY(Q1) NRM K-1 PSET X0 FRAX(X,Y) INC(R) TSEL2 CC1 CCR0.5", "\x06"),
        ("CIR2 X5 I2.5 SPLINE1 PVT200 STOP BSTART BSTOP RPD TA100 TS50 TM30", "\x06"),
        ("G1 M3 T(P1) D2.5 S1500 CALL20.15 GOTO10 GOSUB(P1) READ(X,Y) RET", "\x06"),
        // What is no statement is carried out.
        ("#2 &2 M5-> ? J/", "*\r000000000000\r\x07ERR003\r"),
        ("&1", "\x06"),
        ("P1=7 OPEN", "\x07ERR003\r"),
        ("X", "\x07ERR003\r"),
        ("ENDIF", "\x07ERR009\r"),
        ("ADIS100 BOGUS", "\x07ERR003\r"),
        ("R", "\x07ERR015\r"),
        (
            "LIST",
            "LIN ABS F(P1*2)\rX10 Y20.5 Z(P1+SIN(30))\rN10 X1000:50 Y3^-0.01\r\
             IF(P1>5ANDP2!<3OR(P3~2)) CMD\"#1J+ abc\"\rWHILE(M11=0) WAIT\rIF(P1=1)\r\
             P(P1+5)=-3 M1==1 M2|=15 Q5=P1+2*3\rELSE\rHM1..3,5 HMZ2 ENA PLC1,3..5\rENDI\r\
             DWE250 DLY(Q1) NRM K-1 PSET X0 FRAX(X,Y) INC(R) TSEL2 CC1 CCR0.5\r\
             CIR2 X5 I2.5 SPLINE1 PVT200 STOP BSTART BSTOP RPD TA100 TS50 TM30\r\
             G1 M3 T(P1) D2.5 S1500 CALL20.15 GOTO10 GOSUB(P1) READ(X,Y) RET\rP1=7\rADIS100\r\x06",
        ),
        ("CLOSE CLOSE", "\x06"),
        ("X5", "\x07ERR005\r"),
        ("R", "\x07ERR015\r"),
        ("B10.1", "\x07ERR003\r"),
        ("B10.0001 PC", "P10:11\r\x06"),
        ("LIST PC", "P10:11:N10 X1000:50 Y3^-0.01\r\x06"),
        ("LIST PC,1", "11:N10 X1000:50 Y3^-0.01\r\x06"),
        ("I9=3 LIST PROG10,0,4", "0:LINEAR ABS F(P1*2)\r\x06"),
        ("LIST PROG 10,10,6", "11:N10 X1000:50 Y3^-0.01\r\x06"),
        ("LIST PLC 1", "\x07ERR003\r"),
        ("PASSWORD=x", "\x06"),
        ("SAVE $$$", "\x06"),
        ("OPEN PROG 1000", "\x07ERR002\r"),
        ("LIST PLC 1", "\x07ERR002\r"),
        ("OPEN PROG 10 CLOSE LIST PROG 10,0,1", "0:LINEAR ABS F(P1*2)\r\x06"),
        ("PASSWORD=x", "\x06"),
        ("OPEN PROG 1000 CLOSE", "\x06"),
    ]);
}

#[test]
fn buffers_take_and_give_back_memory() {
    converse(&[
        ("DEFINE GATHER 100", "\x06"),
        ("&2 DEFINE ROT 50", "\x07ERR003\r"),
        ("DELETE GATHER", "\x06"),
        ("&2 DEFINE ROT 50", "\x06"),
        ("&3 DEFINE ROT 50", "\x07ERR003\r"),
        ("&1 DEFINE ROT 4 SIZE", "41247\r\x06"),
        ("DEFINE ROT 5", "\x07ERR003\r"),
        ("DEFINE UBUFFER 1000 SIZE", "40247\r\x06"),
        ("DEFINE UBUFFER 99999", "\x07ERR006\r"),
        ("PR", "0\r\x06"),
        ("OPEN ROT", "\x06"),
        ("X10 Y20", "\x06"),
        ("IF(P1=1)", "\x07ERR003\r"),
        ("GOTO 5", "\x07ERR003\r"),
        ("X(P1+2)", "\x07ERR006\r"),
        ("CMD\"A\"", "\x06"),
        ("&3X1", "\x07ERR005\r"),
        ("&1LIST ROT PR", "X10 Y20\rCMD\"A\"\r2\r\x06"),
        ("&2 X1 &1", "\x06"),
        ("&2 PR", "1\r\x06"),
        ("CLEAR PR", "0\r\x06"),
        ("CLOSE DELETE ROT", "\x06"),
        ("&1 DELETE ROT DELETE UBUFFER SIZE", "41301\r\x06"),
        ("DELETE ROT", "\x07ERR003\r"),
        ("OPEN PLC 3", "\x06"),
        ("X5", "\x07ERR003\r"),
        ("P1=P1+1 ADR#2&3 SEND\"hi\"", "\x06"),
        ("M1==1", "\x07ERR003\r"),
        ("CLOSE LIST PLC 3", "P1=P1+1 ADR#2&3 SEND\"hi\"\rRET\r\x06"),
        ("ENABLE PLC 3,5..7", "\x06"),
        ("ENABLE PLC 32", "\x07ERR003\r"),
        ("DEFINE COMP 3,100", "\x06"),
        ("5", "\x06"),
        ("-6", "\x06"),
        ("7", "\x06"),
        ("8", "\x06"),
        ("P0 LIST COMP", "8\r5\r-6\r7\r\x06"),
        ("OPEN PROG 1000 X5 CLOSE", "\x06"),
    ]);
}

/// Pieces of real lines, so that random texts get past the first token.
const PIECES: &[&str] = &[
    "#1",
    "&2",
    "J",
    "+",
    "-",
    "/",
    "=",
    ":",
    "^",
    "*",
    "..",
    "->",
    "X",
    "Y:",
    "L",
    "DP:$D200",
    ",24,S",
    "(",
    ")",
    "$",
    "$$$",
    "P",
    "Q1",
    "M",
    "I",
    "1023",
    "0.5",
    "SIN(",
    "ATAN2(",
    "%",
    "&",
    "|",
    "RHX$1000",
    "WL",
    ",",
    "HOME",
    "DEFINE",
    "GATHER",
    "DELETE",
    "ABS(",
    "INC",
    "PASSWORD",
    "UNDEFINE",
    "ALL",
    "5000A",
    "99999999999999999999",
    "LIST",
    "OPEN PROG 1",
    "OPEN ROT",
    "OPEN PLC 1",
    "CLOSE",
    "DEFINE ROT 50",
    "IF(",
    "WHILE(",
    "ELSE",
    "ENDIF",
    "AND",
    "CIR1",
    "CALL",
    "READ(",
    "B0",
    "R",
    "N5",
    ",",
    "\"",
    " ",
    "\t",
    "?",
];

proptest! {
    #[test]
    fn no_byte_stream_upsets_the_board(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let mut bench = Bench::new();
        bench.send(&bytes);
        bench.send(b"\x18I3=2\r");
        prop_assert_eq!(bench.send(b"P1023=1 P1023\r").split_last().map(|(last, _)| *last), Some(6));
    }

    #[test]
    fn no_line_upsets_the_board(pieces in proptest::collection::vec(proptest::sample::select(PIECES), 0..40)) {
        let mut bench = Bench::new();
        bench.send(b"I3=2 I4=0 I6=1\r");
        let out = bench.send(format!("{}\r", pieces.concat()).as_bytes());
        prop_assert!(!out.is_empty() || bench.world.board.variables.i(3) == 0.0);
    }
}
