//! `pmacctl backup`, `diff` and `restore` with the whole of a board's variables.

use crate::support::VirtualSite;

#[test]
fn a_whole_backup_names_what_has_changed_and_puts_it_back() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("I9=2 I122=32.5 P0=1.5 P1023=-3 M50->* M50=12");
    site.ask("&1Q9=4 M51->Y:$FFC2,0");
    let path = site.path("machine.pmc");
    let path = path.to_str().unwrap();
    assert_eq!(site.run(&["backup", "--output", path]).code, Some(0));
    let same = site.run(&["diff", path]);
    assert_eq!((same.stdout.as_str(), same.stderr.as_str(), same.code), ("", "", Some(0)));

    site.ask("I122=40 I125=$C004 P0=2 P1023=-3 P512=0.125 M50=13");
    site.ask("&1Q9=5 M51->Y:$FFC2,1");
    let i125 = std::fs::read_to_string(path).unwrap();
    let i125 = i125.lines().find_map(|line| line.strip_prefix("I125=")).unwrap();
    let expected = format!(
        "-I122=32.5\n+I122=40\n-I125={i125}\n+I125=$C004\n-P0=1.5\n+P0=2\n-P512=0\n+P512=0.125\n\
         -&1Q9=4\n+&1Q9=5\n-M51->Y:$FFC2,0\n+M51->Y:$FFC2,1\n-M50=12\n+M50=13\n"
    );
    let shown = site.run(&["backup", "--what", "I", "-o", "-"]);
    assert!(shown.code == Some(0) && shown.stdout.contains("\nI122=40\n"), "{shown:?}");
    assert!(!std::path::Path::new("-").exists());
    let differs = site.run(&["diff", path]);
    assert_eq!((differs.stdout.as_str(), differs.code), (expected.as_str(), Some(1)));
    // A second backup differs from the first in the same way, without a board.
    let changed = site.path("changed.pmc");
    let changed = changed.to_str().unwrap();
    assert_eq!(site.run(&["backup", "--output", changed]).code, Some(0));
    let files = site.run(&["diff", path, changed]);
    assert_eq!((files.stdout.as_str(), files.code), (expected.as_str(), Some(1)));

    let restored = site.run(&["restore", path, "--yes"]);
    assert_eq!((restored.stderr.as_str(), restored.code), ("", Some(0)));
    assert_eq!(restored.stdout.lines().count(), 7, "{restored:?}");
    let same = site.run(&["diff", path]);
    assert_eq!((same.stdout.as_str(), same.code), ("", Some(0)));
    let nothing = site.run(&["restore", path, "--yes"]);
    assert_eq!((nothing.stdout.as_str(), nothing.code), ("", Some(0)), "nothing is left to restore");
    site.assert_no_violations();
}

/// A Turbo board has 8192 of each kind, and coordinate systems to 16 whose Q-variables are the same registers.
#[test]
fn a_whole_turbo_board_is_backed_up_and_put_back() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    site.ask("I8191=$123456 I3222=40.5 I6699=0.5 P8191=-2 M8191->X:$3501,0,24,S M8190=7");
    site.ask("&16Q511=9");
    let path = site.path("machine.pmc");
    let path = path.to_str().unwrap();
    assert_eq!(site.run(&["backup", "--output", path]).code, Some(0));
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains("\n; board TURBO2, X4 (turbo2)\n; firmware 1.947, "), "{}", &text[..200]);
    for kind in ["I", "P", "Q", "M"] {
        let sign = if kind == "M" { "->" } else { "=" };
        assert!(text.contains(&format!("\n{kind}0{sign}")) && text.contains(&format!("\n{kind}8191{sign}")));
    }
    site.ask("I8191=0 I3222=32 I6699=0 P8191=0 M8191->* M8190=0");
    site.ask("&16Q511=0");
    let restored = site.run(&["restore", path, "--yes"]);
    assert_eq!((restored.stderr.as_str(), restored.code), ("", Some(0)));
    assert_eq!(restored.stdout.lines().count(), 7, "{}", restored.stdout);
    let same = site.run(&["diff", path]);
    assert_eq!((same.stdout.as_str(), same.code), ("", Some(0)));
    assert_eq!(site.run(&["send", "&16Q511 M8190"]).stdout, "9\n7\n");
    site.assert_no_violations();
}

/// A file that is written by hand or by another tool: each item once in another spelling than the board lists it in.
#[test]
fn what_a_board_lists_in_its_own_spelling_is_no_difference() {
    let definitions = "M0->X:$000000,0,24,U\nM1->Y:$00FFC2,8,1\nM161->D:$000088\nM162->dp:$0d200\nM163->TWD:4,0.80,U\nM164->*\n";
    let programs = "P1=$0F\nP2=0.33333333333333\nI122=32.50\n&1\n#1->1000.0x + 5\nOPEN PROG 7 CLEAR\nlinear abs tm 100 ; slow\n\
                    RAPID X 10.0 Y+.5\nCIRCLE 1\tX$A I5.0\nDWELL 50\nENABLE PLC 1,2,3\nHOME 1,2,3\n\
                    WHILE (P1 > 0 AND P2!<1.50)\nP1 = P1 - $1\nENDWHILE\nCMD\"#1j/ \"\nRETURN\nCLOSE\n\
                    OPEN PLC 3 CLEAR\nif ( m164 = 1 )\nSEND\"a;B\"\nENDIF\nCLOSE\n";
    let turbo = "OPEN INVERSE CLEAR\np3 = q7 * 2.0\nRETURN\nCLOSE\n";
    for (family, more, long) in [("pmac", "", "0"), ("turbo2", turbo, "1")] {
        let site = VirtualSite::configured(&["--family", family], &format!("family = {family:?}\n"));
        site.wait_for_identity();
        // Long words in the listing, or short ones.
        site.ask(&format!("I9={long}"));
        let file = site.file("machine.pmc", &format!("{definitions}{programs}{more}"));
        let restored = site.run(&["restore", &file, "--yes"]);
        let left = "disabled since their OPEN, to be enabled by ENABLE PLC: PLC 3\n";
        assert_eq!((restored.stderr.as_str(), restored.code), (left, Some(0)), "{family}");
        let same = site.run(&["diff", &file]);
        assert_eq!((same.stdout.as_str(), same.code), ("", Some(0)), "{family}");
        let nothing = site.run(&["restore", &file, "--yes"]);
        assert_eq!((nothing.stdout.as_str(), nothing.code), ("", Some(0)), "{family}");
        // Text that programs send is no spelling.
        let other =
            site.file("other.pmc", "M1->Y:$FFC2,9\nOPEN PLC 3 CLEAR\nIF(M164=1)\nSEND\"A;B\"\nENDI\nCLOSE\n");
        let differs = site.run(&["diff", &other]);
        assert_eq!(differs.code, Some(1));
        let told: Vec<&str> = differs.stdout.lines().collect();
        assert_eq!(told.len(), 4, "{told:?}");
        assert!(told[0].starts_with("-M1->") && told[2] == "-PLC 3 line 2: SEND\"A;B\"", "{told:?}");
        site.assert_no_violations();
    }
}

/// What an integrator gives a board besides variables: axes, kinematics, PLCs and motion programs.
#[test]
fn axes_and_programs_are_backed_up_compared_and_put_back() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    let text = "&2\n#3->I\n#4->1000X+5\nOPEN INVERSE CLEAR\nP3=Q7*2\nCLOSE\nOPEN PROG 1000 CLEAR\nLIN X(P1)\nCLOSE\n\
                OPEN PLC 3 CLEAR\nIF(P1=1)\nSEND\"a;b\"\nP2=1\nENDI\nCLOSE\n";
    let program = site.file("program.pmc", text);
    assert_eq!(site.run(&["download", &program]).code, Some(0));
    let path = site.path("machine.pmc");
    let path = path.to_str().unwrap();
    let what = ["backup", "--what", "AXES,KIN,PROG,PLC", "--programs", "998..1001", "-o", path];
    assert_eq!(site.run(&what).code, Some(0));
    let saved = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = saved.lines().filter(|line| !line.starts_with(';')).collect();
    let listed = text.replace("\nCLOSE", "\nRET\nCLOSE");
    assert_eq!(lines, listed.lines().collect::<Vec<_>>());
    let same = site.run(&["diff", path]);
    assert_eq!((same.stdout.as_str(), same.stderr.as_str(), same.code), ("", "", Some(0)));

    let other =
        site.file("other.pmc", "OPEN PLC 3 CLEAR\nIF(P1=1)\nSEND\"a;b\"\nP2=7\nENDI\nCLOSE\n&2\n#3->0\n");
    assert_eq!(site.run(&["download", &other]).code, Some(0));
    let differs = site.run(&["diff", path]);
    let expected = "-&2#3->I\n+&2#3->0\n-PLC 3 line 3: P2=1\n+PLC 3 line 3: P2=7\n";
    assert_eq!((differs.stdout.as_str(), differs.code), (expected, Some(1)));
    let restored = site.run(&["restore", path, "--yes"]);
    assert_eq!(restored.code, Some(0), "{restored:?}");
    assert_eq!(restored.stderr, "disabled since their OPEN, to be enabled by ENABLE PLC: PLC 3\n");
    assert_eq!((site.run(&["diff", path]).stdout.as_str(), site.run(&["diff", path]).code), ("", Some(0)));

    // A program that the board does not take is told as it is, and the password as what it is.
    let wrong = site.file("wrong.pmc", "OPEN PLC 4 CLEAR\nP1=1\nUUU\nCLOSE\n");
    let ran = site.run(&["restore", &wrong, "--yes"]);
    assert!(
        ran.code == Some(1) && ran.stderr.contains("wrong.pmc:1: ERR003") && ran.stderr.contains("UUU"),
        "{ran:?}"
    );
    site.ask("PASSWORD=Sesame");
    for line in ["SAVE", "$$$"] {
        assert_eq!(site.run(&["send", line, "--yes"]).code, Some(0), "{line}");
    }
    site.wait_until("the board to answer", || site.run(&["send", "I58"]).stdout == "1\n");
    let ran = site.run(&what);
    assert!(ran.code == Some(1) && ran.stderr.contains("password protects"), "{ran:?}");
    site.assert_no_violations();
}

/// The stations on a Turbo board's MACRO ring have variables of their own.
#[test]
fn variables_of_macro_stations_are_backed_up_compared_and_put_back() {
    let site = VirtualSite::configured(&["--family", "turbo2", "--macro"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    // One station serves nodes 0 and 1 of the first MACRO IC, one its node 4, and one node 17 of the second IC.
    site.ask("I6841=$FC013 I21=$79400 I6891=$FC002");
    site.ask("MS0,MI996=$FC003 MS0,MI71=$10C0A0208800 MS0,MI910=7 MS1,MI912=3 MS4,MI8=5 MS17,MI910=2");
    let path = site.path("stations.pmc");
    let path = path.to_str().unwrap();
    let saved = || {
        assert_eq!(site.run(&["backup", "--what", "MS", "-o", path]).code, Some(0));
        let saved = std::fs::read_to_string(path).unwrap();
        saved.lines().filter(|line| !line.starts_with(';')).map(str::to_owned).collect::<Vec<_>>()
    };
    let lines = saved();
    for line in [
        "MS0,MI996=$FC003",
        "MS0,MI71=$10C0A0208800",
        "MS0,MI910=$7",
        "MS1,MI912=$3",
        "MS4,MI8=$5",
        "MS17,MI910=$2",
    ] {
        assert!(lines.iter().any(|saved| saved == line), "{line}");
    }
    let at = |node: u8| lines.iter().filter(|line| line.starts_with(&format!("MS{node},"))).count();
    assert!(at(0) > 100 && at(0) == at(4) && at(0) == at(17), "{} {} {}", at(0), at(4), at(17));
    assert_eq!((at(1), at(5), at(16)), (14, 0, 0), "{lines:?}");
    let part = site.file("part.pmc", "ms0,i71=$10C0A0208800\nMS17,MI910=2\nMS1,MI912=3\n");
    assert_eq!(site.run(&["diff", &part]).code, Some(0));

    site.ask("MS0,MI71=0 MS17,I910=1");
    let differs = site.run(&["diff", path]);
    let expected = "-MS0,MI71=$10C0A0208800\n+MS0,MI71=$0\n-MS17,MI910=$2\n+MS17,MI910=$1\n";
    assert_eq!((differs.stdout.as_str(), differs.code), (expected, Some(1)));
    let restored = site.run(&["restore", path, "--yes"]);
    assert_eq!((restored.stderr.as_str(), restored.code), ("", Some(0)), "{restored:?}");
    assert_eq!(site.run(&["diff", path]).stdout, "");
    site.assert_no_violations();

    let without = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    without.wait_for_identity();
    without.ask("I6841=$FC013");
    let differs = without.run(&["diff", &part]);
    let expected = "-MS0,MI71=$10C0A0208800\n-MS1,MI912=3\n-MS17,MI910=2\n";
    assert_eq!((differs.stdout.as_str(), differs.code), (expected, Some(1)));
    let restored = without.run(&["restore", &part, "--yes"]);
    assert!(restored.code == Some(1) && restored.stderr.contains("ERR008"), "{restored:?}");
    let ran = without.run(&["backup", "--what", "MS"]);
    assert!(ran.code == Some(0) && !ran.stdout.contains("MS"), "{ran:?}");
    without.assert_no_violations();
}

/// For a nightly job: the exit status tells a board that differs from a board that could not be asked.
#[test]
fn a_check_tells_what_differs_from_a_backup_and_what_is_new() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_identity();
    let listing = "I122=32.5\nM1->Y:$00FFC2,8,1\n#1->100X\nOPEN PROG 5 CLEAR\nX1\nCLOSE\nOPEN PLC 3 CLEAR\nP1=1\nCLOSE\n";
    let path = site.file("night.txt", listing);
    assert_eq!(site.run(&["restore", &path, "--yes"]).code, Some(0));
    let check =
        |more: &[&str]| site.run(&[&["backup", "--check", &path, "--programs", "1..20"], more].concat());
    let same = check(&[]);
    assert_eq!(
        (same.stdout.as_str(), same.stderr.as_str(), same.code),
        ("", "", Some(0)),
        "spelling is nothing"
    );
    for line in [
        "I122=40",
        "#2->Y",
        "OPEN PROG 7 CLEAR X2 CLOSE",
        "OPEN PROG 5 CLEAR CLOSE",
        "OPEN PLC 3 CLEAR P1=2 CLOSE",
    ] {
        assert_eq!(site.run(&["send", line]).code, Some(0), "{line}");
    }
    let differs = check(&[]);
    let told = format!(
        "I122: 32.5 in {path}, 40 on the board\n&1#2->: on the board, not in {path}\nPROG 5: in {path}, not on the board\n\
         PROG 7: on the board, not in {path}\nPLC 3: another program on the board\n"
    );
    assert_eq!((differs.stdout.as_str(), differs.code), (told.as_str(), Some(1)));
    let document = check(&["--json"]).json();
    assert_eq!(document.as_array().unwrap().len(), 5, "{document}");
    assert_eq!(document[1], serde_json::json!({ "variable": "&1#2->", "first": null, "second": "Y" }));
    assert_eq!(check(&["--what", "M"]).code, Some(0));
    let none = check(&["--what", "Q"]);
    assert!(none.code == Some(2) && none.stderr.contains("nothing was compared"), "{none:?}");
    // A board that refuses a question differs from no backup.
    site.ask("OPEN PLC 4 CLEAR");
    let refused = check(&[]);
    assert_eq!((refused.stdout.as_str(), refused.code), ("", Some(2)), "{refused:?}");
}

#[test]
fn a_check_lists_some_differences_and_counts_the_rest() {
    let site = VirtualSite::running(&[], &[]);
    let listing: String = (0..25).map(|number| format!("P{number}=1\n")).collect();
    let path = site.file("night.txt", &listing);
    let differs = site.run(&["backup", "--check", &path, "--programs", "1"]);
    assert_eq!(differs.code, Some(1));
    assert_eq!(differs.stdout.lines().count(), 21);
    assert!(differs.stdout.ends_with("and 5 more: --json has them all\n"), "{}", differs.stdout);
}
