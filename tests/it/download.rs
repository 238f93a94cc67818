//! `pmacctl download` on the simulated board: what a file holds, the board holds, and lists.

use std::fmt::Write as _;

use serde_json::json;

use crate::support::VirtualSite;

/// What `pmacctl send` prints for `line`.
fn sent(site: &VirtualSite, line: &str) -> String {
    let ran = site.run(&["send", line]);
    assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)), "{line}");
    ran.stdout
}

#[test]
fn what_is_downloaded_is_what_the_board_lists() {
    let site = VirtualSite::running(&[], &[]);
    let program = "LIN ABS TM100 TA20 TS0\nF25.5\nX10 Y-3.25\nP3=P1*2+1\nWHILE(P3>0)\nX(P3) Y0\nP3=P3-1\nENDW\nDWE50\nCMD\"#1J/\"\nRET\n";
    let plc = "IF(M50=1)\nP4=P4+1\nSEND\"HELLO\"\nELSE\nP4=0\nENDI\n";
    let indented: String = program.lines().fold(String::new(), |mut text, line| {
        writeln!(text, "  {line}\t; as it is written").unwrap();
        text
    });
    let text = format!(
        "; a machine\nI9=2\nI122=32.5 // speed\nI125=$C000\nP1=0.25\n&2\nQ20=-7\nM1->Y:$FFC2,0\nM50->*\nM50=12\n\n\
         OPEN PROG 20 CLEAR\n{indented}CLOSE\nOPEN PLC 3 CLEAR\n{plc}CLOSE\nP2=P1*4\n"
    );
    let path = site.file("machine.pmc", &text);
    // Twice: what is in a buffer already is replaced.
    for _ in 0..2 {
        let ran = site.run(&["download", &path]);
        assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)));
        assert_eq!(sent(&site, "LIST PROG 20"), program);
        assert_eq!(sent(&site, "LIST PLC 3"), format!("{plc}RET\n"));
    }
    for (question, answer) in [
        ("I9", "2"),
        ("I122", "32.5"),
        ("I125", "$C000"),
        ("P1", "0.25"),
        ("P2", "1"),
        ("&2Q20", "-7"),
        ("M1->", "Y:$FFC2,0"),
        ("M50", "12"),
    ] {
        assert_eq!(sent(&site, question).trim_end(), answer, "{question}");
    }
    // The listing goes in again as it came out.
    let listed = sent(&site, "LIST PROG 20");
    let again = site.file("again.pmc", &format!("OPEN PROG 21 CLEAR\n{listed}CLOSE\n"));
    assert_eq!(site.run(&["download", &again]).code, Some(0));
    assert_eq!(sent(&site, "LIST PROG 21"), listed);
    site.assert_no_violations();
}

#[test]
fn a_program_of_hundreds_of_lines_comes_back_whole() {
    let site = VirtualSite::running(&[], &[]);
    let program: String = (0..300).fold(String::new(), |mut text, line| {
        writeln!(text, "X{} Y-{}.5", line * 7 % 1000, line).unwrap();
        text
    });
    let path = site.file("long.pmc", &format!("OPEN PROG 500 CLEAR\n{program}CLOSE\n"));
    let ran = site.run(&["download", &path, "--json"]);
    assert_eq!(ran.json(), json!({ "lines": 302, "taken": 302, "errors": [] }));
    assert_eq!(sent(&site, "LIST PROG 500"), format!("{program}RET\n"));
    site.assert_no_violations();
}

#[test]
fn a_wrong_line_ends_a_download_and_leaves_no_buffer_open() {
    let site = VirtualSite::running(&[], &[]);
    let path = site.file("bad.pmc", "; line 1\nP5=7\nOPEN PROG 9 CLEAR\nX1\nX2\nUUU\nX3\nCLOSE\nP5=8\n");
    let ran = site.run(&["download", &path]);
    let error = format!("{path}:6: ERR003: data error or unrecognized command: UUU\n");
    let left = "the board took 4 of 8 lines; PROG 9, which it opened, is incomplete: 2 lines entered it; it is closed now\n";
    let told = format!("{error}{left}");
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", told.as_str(), Some(1)));
    // With a buffer open, the first would be a line of the program and the second no question.
    assert_eq!(site.ask("P6=4"), Vec::<String>::new());
    assert_eq!(sent(&site, "I58"), "1\n");
    assert_eq!((site.ask("P5"), site.ask("P6")), (vec!["7".to_owned()], vec!["4".to_owned()]));
    assert_eq!(sent(&site, "LIST PROG 9"), "X1\nX2\nRET\n");
    let ran = site.run(&["send", "LIST"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("ERR"), "no buffer is open: {ran:?}");
    // Told to go on, it leaves out that line alone.
    let ran = site.run(&["download", &path, "--keep-going"]);
    let told = format!("{error}the board took 7 of 8 lines\n");
    assert_eq!((ran.stderr.as_str(), ran.code), (told.as_str(), Some(1)));
    assert_eq!((sent(&site, "LIST PROG 9"), sent(&site, "P5")), ("X1\nX2\nX3\nRET\n".into(), "8\n".into()));
    site.assert_no_violations();
}

#[test]
fn a_refused_line_that_ends_in_close_leaves_no_buffer_open() {
    let site = VirtualSite::running(&[], &[]);
    let path = site.file("wrong.pmc", "OPEN PROG 9 CLEAR\nX1\nUUU CLOSE\nP1=7\n");
    let ran = site.run(&["download", &path]);
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert_eq!(sent(&site, "P1=5"), "");
    assert_eq!(sent(&site, "P1"), "5\n", "no program line");
    assert_eq!(sent(&site, "LIST PROG 9"), "X1\nRET\n");
}

#[test]
fn a_file_of_comments_alone_changes_nothing() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("P5=3");
    let path = site.file("comments.pmc", "; P5=1\n\n   // P5=2\n\t\n;\n#ifdef NEVER\nP5=4\n#endif\n");
    let ran = site.run(&["download", &path]);
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)));
    let ran = site.run(&["download", &path, "--json"]);
    assert_eq!((ran.json(), ran.code), (json!({ "lines": 0, "taken": 0, "errors": [] }), Some(0)));
    assert_eq!(sent(&site, "P5"), "3\n");
    site.assert_no_violations();
}

#[test]
fn what_is_no_program_file_is_refused_before_anything_is_sent() {
    let site = VirtualSite::running(&[], &[]);
    let path =
        site.file("note.txt", "A note to the operators:\nHome the telescope.\nThen park it.\nThank you.\n");
    let ran = site.run(&["download", &path]);
    let said = format!(
        "{path}:1: \"A note to the operators:\" is no command, as most lines of this file; nothing was sent."
    );
    assert!(
        ran.code == Some(2) && ran.stderr.starts_with(&said) && ran.stderr.contains("--force"),
        "{ran:?}"
    );
    assert!(!site.log().contains("download"), "{}", site.log());
    let ran = site.run(&["download", &path, "--force"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("ERR"), "{ran:?}");
}

#[test]
fn a_circle_without_segmentation_is_warned_of() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let program = "OPEN PROG 5 CLEAR\nINC TM500\nCIRCLE1 X10 Y0 I5\nCLOSE\n";
    let path = site.file("arc.pmc", program);
    let warned = |path: &str| {
        let ran = site.run(&["download", path]);
        assert_eq!(ran.code, Some(0), "{ran:?}");
        ran.stderr.clone()
    };
    let warning = "while I13 is 0 the board moves along the chord, not the circle";
    assert!(warned(&path).starts_with(&format!("warning: {path}:3: {warning}")), "{}", warned(&path));
    assert_eq!(warned(&site.file("both.pmc", &format!("{program}I13=10\n"))), "");
    assert_eq!(warned(&path), "");
    // The same for a rotary program.
    for line in ["I13=0", "&1 #1->X #2->Y"] {
        site.ask(line);
    }
    let path = site.file("rotary.pmc", "INC TM50\nCIRCLE2 X10 Y0 I5\n");
    let ran = site.run(&["rotary", "check", &path, "--define", "100"]);
    assert!(
        ran.code == Some(0) && ran.stderr.starts_with(&format!("warning: {path}:2: {warning}")),
        "{ran:?}"
    );
    site.assert_no_violations();
}

#[test]
fn a_circle_without_segmentation_is_warned_of_on_turbo_boards_and_by_g_codes() {
    let arcs = ["CIRCLE1 F5 X0 Y0 I0 J-5", "G02 X10 Y0 I5"];
    for arc in arcs {
        let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
        site.wait_for_identity();
        let warned = |name: &str, text: &str| {
            let path = site.file(name, text);
            let ran = site.run(&["download", &path]);
            assert_eq!(ran.code, Some(0), "{ran:?}");
            ran.stderr.replace(&path, name)
        };
        let program = format!("#3->100X\n#4->100Y\nOPEN PROG 2 CLEAR\nINC\nP1=P2&3\n{arc}\nCLOSE\n");
        let warning = "is 0 the board moves along the chord, not the circle";
        let told = warned("arc.pmc", &format!("&2\n{program}"));
        assert!(told.starts_with(&format!("warning: arc.pmc:7: while I5213 {warning}; I5213 is")), "{told}");
        let told = warned("set.pmc", &format!("I5213=10\n&2\n{program}"));
        assert_eq!(told, "");
        // A file that addresses no coordinate system: any of them may run its program.
        let program = format!("OPEN PROG 3 CLEAR\n{arc}\nCLOSE\n");
        assert_eq!(warned("any.pmc", &program), "");
        let told = warned("none.pmc", &format!("I5213=0\n{program}"));
        assert!(
            told.starts_with(&format!("warning: none.pmc:3: while each of I5113 to I6613 {warning}")),
            "{told}"
        );
    }
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    let path = site.file("codes.pmc", "OPEN PROG 5 CLEAR\nG1 X1\nG3 X10 Y0 I5\nCLOSE\n");
    let ran = site.run(&["download", &path]);
    assert!(ran.stderr.starts_with(&format!("warning: {path}:3: while I13 is 0 ")), "{ran:?}");
    let ran = site.run(&["download", &site.file("straight.pmc", "OPEN PROG 5 CLEAR\nG28 X10\nCLOSE\n")]);
    assert_eq!(ran.stderr, "");
}

/// How a text is written.
type Way = fn(&str) -> Vec<u8>;

fn utf16(text: &str) -> Vec<u8> {
    text.encode_utf16().flat_map(u16::to_le_bytes).collect()
}

/// A byte-order mark, CR alone as boards end their lines, a form feed, `^Z` at the end, UTF-16.
#[test]
fn text_as_other_systems_write_it_is_the_same_text() {
    let site = VirtualSite::running(&[], &[]);
    let written = |name: &str, bytes: &[u8]| {
        let path = site.path(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let ways: [(&str, Way); 5] = [
        ("mark", |text| format!("\u{FEFF}{text}").replace('\n', "\r\n").into_bytes()),
        ("dos", |text| format!("{text}\u{1A}").replace('\n', "\r\n").into_bytes()),
        ("cr", |text| text.replace('\n', "\r").into_bytes()),
        ("pages", |text| text.replace('\n', "\n\u{C}").into_bytes()),
        ("utf16", |text| utf16(&format!("\u{FEFF}{text}").replace('\n', "\r\n"))),
    ];
    let text = "P5=7\nOPEN PROG 9 CLEAR\nX1\nX2\nCLOSE\n";
    // Without the places, of which a form feed is one.
    let encoded = |path: &str| {
        let words = site.run(&["rotary", "encode", path]).stdout;
        words.lines().map(|line| line.split(':').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let plain = encoded(&written("plain.rot", b"X1\nX2\n"));
    assert!(!plain.is_empty());
    for (name, way) in ways {
        site.ask("P5=0");
        site.ask("OPEN PROG 9 CLEAR CLOSE");
        let path = written(name, &way(text));
        let ran = site.run(&["download", &path]);
        assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)), "{name}");
        assert_eq!(
            (sent(&site, "LIST PROG 9"), sent(&site, "P5")),
            ("X1\nX2\nRET\n".into(), "7\n".into()),
            "{name}"
        );
        for command in [&["diff", &path][..], &["restore", &path, "--yes"]] {
            let ran = site.run(command);
            assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)), "{name}");
        }
        assert_eq!(encoded(&written("program.rot", &way("X1\nX2\n"))), plain, "{name}");
    }
    // Without its mark nobody can know; it is called by its name, and nothing is sent.
    let path = written("unmarked.pmc", &utf16(text));
    for command in [&["download", &path][..], &["diff", &path], &["rotary", "encode", &path]] {
        let ran = site.run(command);
        assert!(ran.code != Some(0) && ran.stderr.contains("UTF-16 without a byte-order mark"), "{ran:?}");
    }
    site.assert_no_violations();
}

#[test]
fn a_file_of_a_turbo_site_downloads_as_it_is_written() {
    let site = VirtualSite::configured(&["--family", "turbo2", "--macro"], "family = \"turbo2\"\n");
    site.wait_until("the board to be identified", || site.log().contains("the board is TURBO2"));
    site.file("names.pmc", "#define Base 10F\n#define Stop M33\n");
    let text = "/* A site's file:\n   not sent */\n#include names.pmc\n&9\n#17->X\ni5213,15,100=10\nms8,i910=7\n\
                M0..31->*\nM30->X:$Base0,0,24 /* built from a name */\nM31->X:$FFFF8C,0,24\nEND GATHER\n\
                OPEN INVERSE\nCLEAR\nP17=Q7*2\nCLOSE\nOPEN PLC 5 CLEAR\nIF (P1=1)\nAND (P2=1)\n  P3=$F0 MSW16,MI124,P3\n\
                END IF\nWHILE (I5413>0) END WHILE\nCLOSE\n";
    let path = site.file("site.pmc", text);
    let ran = site.run(&["download", &path]);
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)));
    let listed = sent(&site, "LIST PLC 5");
    assert_eq!(listed, "IF(P1=1)\nAND(P2=1)\nP3=240 MSW16,MI124,P3\nENDI\nWHILE(I5413>0)\nENDW\nRET\n");
    let again = site.file("again.pmc", &format!("OPEN PLC 5 CLEAR\n{listed}CLOSE\n"));
    assert_eq!(site.run(&["download", &again]).code, Some(0));
    assert_eq!(sent(&site, "LIST PLC 5"), listed);
    for (question, answer) in [
        ("&9#17->", "X"),
        ("I6613", "10"),
        ("MS8,MI910", "$7"),
        ("M30->", "X:$10F0,24"),
        ("&9LIST INVERSE", "P17=Q7*2\nRET"),
    ] {
        assert_eq!(sent(&site, question).trim_end(), answer, "{question}");
    }
    site.assert_no_violations();
}

/// Files with compiled PLCs in them: no board takes those as lines.
#[test]
fn the_lines_of_a_buffer_that_is_not_opened_are_left_out() {
    let site = VirtualSite::running(&[], &[]);
    let text = "P1=1\nOPEN PLCC 0 CLEAR\nP2=1\nP3=1\nCLOSE\nP4=1\n";
    let path = site.file("compiled.pmc", text);
    let ran = site.run(&["download", &path]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.stderr.contains("compiled.pmc:2: ERR") && ran.stderr.contains("PLCC 0"), "{ran:?}");
    assert!(!ran.stderr.contains("somebody else"), "nobody closed it: {ran:?}");
    let ran = site.run(&["download", &path, "--keep-going"]);
    assert_eq!(ran.code, Some(1));
    for line in [3, 4] {
        assert!(ran.stderr.contains(&format!("compiled.pmc:{line}: not sent, ")), "{ran:?}");
    }
    assert!(ran.stderr.contains("the board took 3 of 6 lines"), "{ran:?}");
    assert_eq!(sent(&site, "P1 P2 P3 P4"), "1\n0\n0\n1\n");
    site.assert_no_violations();
}

/// A file for the board that clears more than is there, and sets variables of a MACRO station that are called as the board's.
#[test]
fn a_file_that_clears_a_board_downloads() {
    let site = VirtualSite::configured(&["--family", "turbo2", "--macro"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    let text = "CLOSE\nUNDEFINE ALL\n#1DEL BLCOMP\n#32DELETE COMP\n#2 DEL TCOMP\nDELETE CCBUF\n&1\n#1->100X\n#2->0\n&2\n#1->0\n\
                #2->Y\nMS0,I58=0\n";
    let path = site.file("clear.pmc", text);
    for _ in 0..2 {
        let ran = site.run(&["download", &path]);
        assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)));
    }
    assert_eq!(sent(&site, "&1#1-> #2-> &2#1-> #2-> I58"), "100X\n0\n0\nY\n1\n");
    site.assert_no_violations();
}

/// What a prologue clears, and a file that begins as if a buffer were open.
#[test]
fn a_prologue_is_told_and_clears_what_it_says() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    let path = site.file("next.pmc", "P5=7\n");
    let plc_runs = || {
        site.ask("P1=0").is_empty() && {
            site.run_for(std::time::Duration::from_millis(200));
            site.ask("P1") != ["0"]
        }
    };
    for line in ["OPEN PLC 3 CLEAR", "P1=1", "CLOSE", "I5=2", "ENABLE PLC 3", "DEFINE GATHER 10"] {
        assert_eq!(site.run(&["send", line]).code, Some(0), "{line}");
    }
    site.ask("&1#1->100X");
    site.ask("OPEN PROG 9 CLEAR");
    let ran = site.run(&["download", &path, "--prologue"]);
    let said = "has had PROG 9 open";
    assert!(ran.code == Some(1) && ran.stderr.contains(said), "it closes no client's buffer: {ran:?}");
    site.ask("CLOSE");
    let ran = site.run(&["download", &path, "--prologue"]);
    assert_eq!((ran.stderr.as_str(), ran.code), ("before the file: CLOSE, DELETE GATHER\n", Some(0)));
    assert_eq!((sent(&site, "P5"), sent(&site, "&1#1->")), ("7\n".into(), "100X\n".into()));
    assert_eq!(site.run(&["send", "LIST GATHER"]).code, Some(1), "no gather buffer");
    assert!(plc_runs());

    let all = ["download", &path, "--prologue=plcs,undefine"];
    let effects = "PLC programs 0 to 31 STOP, and stay disabled until ENABLE PLC; the axis definitions of all coordinate systems are lost.";
    let ran = site.run(&all);
    assert!(
        ran.code == Some(2) && ran.stderr.contains(effects) && ran.stderr.contains("nothing was sent"),
        "{ran:?}"
    );
    assert!(plc_runs());
    let lines = "CLOSE\nDELETE GATHER\nDISABLE PLC 0..31\nUNDEFINE ALL\nP5=7\n";
    assert_eq!(site.run(&[&all[..], &["--dry-run"]].concat()).stdout, lines);
    let ran = site.run(&[&all[..], &["--yes", "--json"]].concat());
    let told = "before the file: CLOSE, DELETE GATHER, DISABLE PLC 0..31, UNDEFINE ALL\n";
    assert_eq!((ran.stderr.as_str(), ran.code), (told, Some(0)));
    assert_eq!(ran.json(), json!({ "lines": 5, "taken": 5, "errors": [] }));
    assert_eq!(sent(&site, "&1#1->"), "0\n");
    assert!(!plc_runs());
    site.assert_no_violations();
}
