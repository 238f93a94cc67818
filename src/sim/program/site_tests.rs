//! Programs as sites write them: the statements of files for real boards, in small programs of our own.

use crate::sim::board::error::CommandError;
use crate::sim::board::firmware::{self, FirmwareTables};
use crate::sim::board::turbo;
use crate::sim::testing::Bench;

const FAMILIES: [&FirmwareTables; 4] = [&firmware::PMAC, &firmware::PMAC2, &turbo::TURBO, &turbo::TURBO2];

fn board(tables: &'static FirmwareTables) -> Bench {
    Bench::of(tables, tables.firmware)
}

fn refusal(bench: &mut Bench, line: &str) -> Option<CommandError> {
    bench.world.execute(line.as_bytes()).error
}

fn send(bench: &mut Bench, line: &str) -> Vec<String> {
    let reply = bench.world.execute(line.as_bytes());
    assert_eq!(reply.error, None, "{line}");
    reply.lines
}

fn load(bench: &mut Bench, text: &str) {
    for line in text.lines() {
        send(bench, line.trim());
    }
}

#[test]
fn conditions_go_on_over_lines() {
    let program =
        "OPEN PLC 1 CLEAR\nIF (P1=1)\nAND (P2=1)\n or(P3=1 and P2!=7)\nP10=1\nELSE\nP10=2\nENDIF\nP11=0
        WHILE(P11<5)\nAND (P11<P4)\nP11=P11+1\nENDWHILE\nCLOSE\nI5=2 ENABLE PLC 1";
    for tables in FAMILIES {
        let mut bench = board(tables);
        load(&mut bench, program);
        // AND binds tighter than OR, as on one line.
        for (p1, p2, p3, taken) in
            [(1, 1, 0, 1), (1, 0, 0, 2), (0, 1, 0, 2), (0, 0, 1, 1), (1, 0, 1, 1), (0, 7, 1, 2), (1, 1, 1, 1)]
        {
            send(&mut bench, &format!("P1={p1} P2={p2} P3={p3} P4=0"));
            bench.run(6);
            assert_eq!(send(&mut bench, "P10"), [taken.to_string()], "{p1} {p2} {p3}");
        }
        for (limit, reached) in [(3, "3"), (9, "5")] {
            // The PLC begins anew at its top.
            send(&mut bench, &format!("DISABLE PLC 1 P4={limit} P11=0"));
            send(&mut bench, "ENABLE PLC 1");
            let mut most = 0;
            for _ in 0..20 {
                bench.run(1);
                most = most.max(send(&mut bench, "P11")[0].parse::<i32>().unwrap());
            }
            assert_eq!(most.to_string(), reached);
        }
        assert_eq!(send(&mut bench, "LIST PLC 1")[..3], ["IF(P1=1)", "AND(P2=1)", "OR(P3=1ANDP2!=7)"]);
    }
}

#[test]
fn a_condition_that_goes_on_needs_one_above_it() {
    let mut bench = board(&turbo::TURBO2);
    assert_eq!(refusal(&mut bench, "AND (P1=1)"), Some(CommandError::NO_OPEN_BUFFER));
    send(&mut bench, "OPEN PLC 1 CLEAR");
    assert_eq!(refusal(&mut bench, "AND (P1=1)"), Some(CommandError::STRUCTURE));
    load(&mut bench, "IF (P1=1)\nP2=1");
    assert_eq!(refusal(&mut bench, "OR (P1=1)"), Some(CommandError::STRUCTURE), "a statement stands between");
    load(&mut bench, "ENDIF\nIF (P1=1) P2=1");
    assert_eq!(refusal(&mut bench, "AND (P1=1)"), Some(CommandError::STRUCTURE), "that IF is its line's");
    load(&mut bench, "CLOSE\nOPEN PROG 1 CLEAR\nIF (P1=1)");
    assert_eq!(refusal(&mut bench, "AND (P1=1)"), Some(CommandError::SYNTAX), "motion programs have none");
}

#[test]
fn end_may_stand_apart() {
    for tables in FAMILIES {
        let mut bench = board(tables);
        load(
            &mut bench,
            "END GATHER\nOPEN PLC 1 CLEAR\nWHILE (P1<2)\nIF (P1=0)\nP1=1\nEnd If\nend  while\nEND GATHER\nCLOSE",
        );
        assert_eq!(
            send(&mut bench, "LIST PLC 1"),
            ["WHILE(P1<2)", "IF(P1=0)", "P1=1", "ENDI", "ENDW", "RET"]
        );
        assert_eq!(refusal(&mut bench, "END"), Some(CommandError::SYNTAX));
        assert_eq!(refusal(&mut bench, "END IF"), Some(CommandError::SYNTAX));
    }
}

#[test]
fn a_loop_on_one_line_waits_and_comes_back_as_two() {
    for tables in FAMILIES {
        let mut bench = board(tables);
        load(
            &mut bench,
            "OPEN PLC 1 CLEAR\nP2=P2+1 WHILE (P1=0) END WHILE P3=P3+1\nCLOSE\nI5=2 ENABLE PLC 1",
        );
        assert_eq!(send(&mut bench, "LIST PLC 1"), ["P2=P2+1 WHILE(P1=0)", "ENDW P3=P3+1", "RET"]);
        bench.run(20);
        assert_eq!(send(&mut bench, "P3"), ["0"]);
        load(&mut bench, "OPEN PROG 1 CLEAR\nWHILE (Q1=0) ENDWHILE\nDWELL 1\nQ2=7\nCLOSE\n#1->X #1J/");
        bench.run(20);
        send(&mut bench, "&1B1R");
        bench.run(40);
        assert_eq!(send(&mut bench, "Q2"), ["0"]);
        send(&mut bench, "P1=1 Q1=1");
        bench.run(80);
        assert_eq!(send(&mut bench, "Q2"), ["7"]);
        assert_ne!(send(&mut bench, "P3"), ["0"]);
    }
}

#[test]
fn return_ends_a_scan() {
    let mut bench = board(&turbo::TURBO2);
    load(
        &mut bench,
        "OPEN PLC 2 CLEAR\nP1=P1+1\nIF(P1>3)\nRET\nENDIF\nP2=P2+1\nRET\nCLOSE\nI5=2 ENABLE PLC 2",
    );
    bench.run(30);
    let counts = send(&mut bench, "P1 P2");
    assert_eq!(counts[1], "3");
    assert!(counts[0].parse::<i32>().unwrap() > 10, "{counts:?}");
}

#[test]
fn what_was_listed_downloads_to_the_same_listing() {
    let programs = [
        (
            "PLC 3",
            "IF (M1=1 OR P1>$1F)\nAND (I(100*Q1+31)!<5)\nCOMMAND \"#1J/ &2 B3R\" cmd^K\nENABLE PLC 1,3..7\nENDIF\nADDRESS#1&2\nP1=P1&$FF\nRETURN",
        ),
        (
            "PLC 4",
            "WHILE (P1~2) ENDWHILE\nSEND\"a;b, C\" DISABLE PLCC 0,2\nENA PLCC 1..5\nI513=10*(P1+2)%7 M5=SIN(P1)^2|-3",
        ),
        (
            "PROG 7",
            "N10 LINEAR ABS(X,Y) FRAX(X,Y) TA100TS 50 F(P1)\nX10Y(Q1+2)Z-.5 M7==1 M8&=$FE M9|=1 M10^=3\nCIRCLE1 X1 I2 J(3)\nRAPID X5^-0.1\nPVT100 X5:10\nGOTO 10\nRETURN",
        ),
        (
            "PROG 8",
            "SPLINE1 INC HOME 1,2 HOMEZ3..5\nREAD(A,B) CALL 10.5 A1\nG1 M3 T2 D4 GOSUB 100\nBSTART X1 BSTOP STOP\nCC1 CCR2 TSEL1 TINIT ADIS5 IROT9\nNORMAL K-1 PSET X0\nIF (P1=1) DWELL 10\nELSE DELAY(P2)\nWHILE (P1<3) P1=P1+1",
        ),
    ];
    let own_to_turbo = [
        ("FORWARD", "Q7=P3*2+Q8"),
        ("INVERSE", "P3=(Q7-Q8/2-P4903)/P4803\nIF (Q8>0)\nP4=0\nENDIF"),
        ("PLC 5", "P1=$F09040 MSW16,MI124,P1\nMSR 16,I910,M5"),
        ("PLC 6", "SETPHASE1 setphase 2,4..32"),
        ("PROG 9", "SETPHASE 1..3\nX1"),
    ];
    for tables in FAMILIES {
        let mut bench = board(tables);
        let is_turbo = tables.family.motors == 32;
        let own = own_to_turbo.iter().filter(|_| is_turbo);
        for long in [2, 3] {
            send(&mut bench, &format!("I9={long}"));
            for (name, text) in programs.iter().chain(own.clone()) {
                load(&mut bench, &format!("OPEN {name} CLEAR\n{text}\nCLOSE"));
                let listed = send(&mut bench, &format!("LIST {name}"));
                load(&mut bench, &format!("OPEN {name}\nCLEAR\n{}\nCLOSE", listed.join("\n")));
                assert_eq!(send(&mut bench, &format!("LIST {name}")), listed, "{name}");
            }
        }
    }
}

#[test]
fn setphase_takes_motors_of_a_turbo_board() {
    let mut bench = board(&turbo::TURBO2);
    load(&mut bench, "OPEN PLC 1 CLEAR\nSETPHASE1\nP1=1\nCLOSE\nOPEN PROG 1 CLEAR\nSETPHASE1,3\nP2=2\nCLOSE");
    load(&mut bench, "#1->X #1J/ I5=2 ENABLE PLC 1\nSETPHASE1..32");
    bench.run(20);
    send(&mut bench, "&1B1R");
    bench.run(40);
    assert_eq!(send(&mut bench, "P1 P2"), ["1", "2"]);
    for line in ["SETPHASE", "SETPHASE33", "SETPHASE0", "OPEN PLC 2 SETPHASE33"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "{line}");
    }
    let mut pmac = board(&firmware::PMAC);
    assert_ne!(refusal(&mut pmac, "OPEN PLC 1 SETPHASE1"), None, "no page seen has it for PMAC");
}

#[test]
fn kinematic_programs_are_kept_by_coordinate_system_and_do_not_run_while_isx50_is_0() {
    let mut bench = board(&turbo::TURBO2);
    load(
        &mut bench,
        "&3\n#3->I\n#4->1000X\nOPEN FORWARD\nCLEAR\nQ7=P3*2\nCLOSE\nOPEN INVERSE CLEAR\nP3=Q7/2\nCLOSE",
    );
    assert_eq!(send(&mut bench, "LIST FORWARD LIST INVERSE"), ["Q7=P3*2", "RET", "P3=Q7/2", "RET"]);
    assert_eq!(send(&mut bench, "LIST INVERSE,0,80"), ["0:P3=Q7/2", "3:RET"]);
    assert_eq!(send(&mut bench, "#3->"), ["I"]);
    assert_eq!(refusal(&mut bench, "&2 LIST FORWARD"), Some(CommandError::SYNTAX), "each system has its own");
    // A move of the other axes leaves the motor where it is.
    load(&mut bench, "I300=1 I400=1\n#3J/ #4J/\n#3J=500");
    bench.run(3000);
    load(&mut bench, "OPEN PROG 1 CLEAR\nLINEAR F10 X2\nCLOSE\n&3B1R");
    bench.run(8000);
    assert_eq!(send(&mut bench, "#3P #4P"), ["500", "2000"]);
    // C.S. 3, axis: inverse kinematics 5, XYZ 7.
    assert_eq!(send(&mut bench, "#3?")[0][6..8], *"25");
    assert_eq!(send(&mut bench, "#4?")[0][6..8], *"27");
    assert_eq!(send(&mut bench, "&1 #8-> I2"), ["0", "1"], "a list, and a report");
    let mut pmac = board(&firmware::PMAC);
    for line in ["OPEN FORWARD", "OPEN INVERSE", "#3->I"] {
        assert_eq!(refusal(&mut pmac, line), Some(CommandError::SYNTAX), "{line}");
    }
}

#[test]
fn macro_stations_keep_their_variables() {
    let mut bench = board(&turbo::TURBO2);
    for line in ["MS0,I996=1", "ms 24,i992", "MSW16,MI124,P1", "MSR16,MI124,P1", "MSCLRF0"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::MACRO), "{line}");
    }
    bench.world.board.identity.stations = true;
    load(
        &mut bench,
        "I9=0\nms0,i996=$0FB333\nMS 24,I992=2457\nMS0,I71=$10C0A0208800\nmsclrf24\nMS8,MI910=-7",
    );
    assert_eq!(
        send(&mut bench, "MS0,MI996 MS24,I992 MS0,I71 MS8,I910 MS9,I910"),
        ["1028915", "2457", "18419506251776", "-7", "0"]
    );
    load(&mut bench, "P1=$F09040 MSW16,MI124,P1\nMSR16,I124,P2");
    assert_eq!(send(&mut bench, "P2"), ["15765568"]);
    load(&mut bench, "OPEN PLC 2 CLEAR\nP1=5 MSW16,MI125,P1\nCLOSE\nI5=2 ENABLE PLC 2");
    bench.run(5);
    assert_eq!(send(&mut bench, "MS16,MI125"), ["5"]);
    send(&mut bench, "$$$");
    assert_eq!(send(&mut bench, "MS16,MI125"), ["$5"], "the stations are not the board's");
    for line in ["MS64,I1", "MS0,P1", "MS0", "MSW0,MI1", "MSW0,MI1,7"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "{line}");
    }
}

#[test]
fn macro_stations_are_saved_and_reset_one_by_one() {
    let mut bench = board(&turbo::TURBO2);
    for line in ["MS$$$0", "MS$$$***0", "MSSAVE0", "MS CLRF 0"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::MACRO), "{line}");
    }
    bench.world.board.identity.stations = true;
    send(&mut bench, "I9=0 MS0,I10=1 MS4,I10=1");
    for (line, kept) in [
        ("ms save 0 MS0,I10=2 MS4,I10=2", ["2", "2"]),
        ("MSCLRF0 MACROSLVCLRF4", ["2", "2"]),
        ("MS$$$0", ["1", "2"]),
        ("MS$$$***0", ["0", "2"]),
        ("MS $$$0", ["1", "2"]),
        ("MS$$$4", ["1", "0"]),
        ("MACROSLV$$$***0 MACROSLVSAVE0 MS0,I10=3 MS$$$0", ["0", "0"]),
    ] {
        send(&mut bench, line);
        assert_eq!(send(&mut bench, "MS0,I10 MS4,I10"), kept, "{line}");
    }
    for line in ["MS$$$", "MSSAVE", "MSSAVE64", "MS$$$***"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "{line}");
    }
}

#[test]
fn addresses_and_sizes_as_sites_write_them() {
    let mut bench = board(&turbo::TURBO2);
    load(
        &mut bench,
        "M70->X:$FFFF8C,0,24\nM71->X:$3501,0,24,S\nM0..8191->*\nDELETE GATHER\nDEFINE UBUFFER $500",
    );
    for line in ["M70->X:$80000,0", "M70->X:$FFFF7F,0", "WX$FFFF8C,1"] {
        assert_eq!(refusal(&mut bench, line), Some(CommandError::SYNTAX), "{line}");
    }
    let mut pmac = board(&firmware::PMAC);
    assert_eq!(refusal(&mut pmac, "M70->X:$FFFF8C,0,24"), Some(CommandError::SYNTAX));
}
