//! The command line's tools for a running board: stop, set up, download, backup, compare, restore.

use std::process::Stdio;

use nix::sys::signal::Signal;
use serde_json::json;

use crate::support::VirtualSite;
use crate::support::bench::Bench;
use crate::support::raw::{Raw, error_name};
use crate::support::rig::{Ran, command, pmacctl};

#[test]
fn set_up_lines_and_absolute_words_need_no_daemon() {
    let ran = pmacctl("setup isa --address 0xEC000 --addressing 24 --json");
    assert_eq!(
        (ran.json()["commands"].clone(), ran.code),
        (json!(["WX:$786,$0000E,$000C5", "SAVE", "$$$"]), Some(0))
    );
    let ran = pmacctl("setup vme --mailbox 0x7FA000 --dpram 0x1FC000 --irq-level 2 --vector 0xA1 --json");
    assert_eq!(ran.json()["after_reset"], json!([{ "address": "0x7FA121", "value": "0x3F" }]));
    let ran = pmacctl("absolute --family turbo --ixx10 0x078D00 --ixx95 0x200000 --json");
    assert_eq!((ran.json()["kind"].as_str(), ran.json()["bits"].as_u64()), (Some("parallel"), Some(32)));
    assert!(pmacctl("setup enable servo").stdout.contains("I48=1"));
    assert!(pmacctl("absolute --ix10 0x000100").stdout.contains("resolver"));
    for (line, reason) in [
        ("setup isa --address 0xEC100", "not a multiple of 16 KiB"),
        ("setup isa --address 0xEC000 --yes", "--send"),
        ("setup isa --address 0xEC000 --port /dev/ttyS0", "--send"),
        ("setup isa --address 0xEC000 --send --baud 9600", "--port"),
        ("setup isa --address 0xEC000 --send --yes --port /dev/null", "/dev/null: not a serial line"),
        ("setup isa --address 0xEC000 --send --yes --port /dev/null --baud 31", "31 baud"),
        ("setup vme --mailbox 0x7FA000 --window /dev/null", "/dev/null: it is no master window of vme_user"),
        ("setup vme --mailbox 0x7FA100 --window /dev/null", "not a multiple of 512"),
        ("setup vme --mailbox 0x7FA000 --window /dev/null --send", "leave --send out"),
        ("setup enable everything", "everything"),
        ("absolute --ixx10 0x78D00 --ixx95 0x330000", "format code $33"),
    ] {
        let ran = pmacctl(line);
        assert!(ran.stderr.contains(reason) && ran.stderr.lines().count() == 1, "{line}: {ran:?}");
        assert_eq!(ran.code, Some(2), "{line}");
    }
}

#[test]
fn nothing_is_sent_unless_somebody_says_so() {
    let bench = Bench::new();
    let socket = bench.socket.display();
    let ran = pmacctl(&format!("setup enable servo --send --socket {socket}"));
    assert!(ran.stderr.contains("--yes") && ran.stderr.contains("nothing was sent"), "{ran:?}");
    assert_eq!(ran.code, Some(2));
    assert_eq!(*bench.seen.lock().unwrap(), [""; 0]);
    for lines in ["setup enable servo --family turbo2", "setup isa --family turbo --address 0xD4000"] {
        let ran = pmacctl(&format!("{lines} --send --yes --socket {socket}"));
        assert!(ran.stderr.contains("the board is a PMAC: give --family pmac"), "{ran:?}");
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""));
    }
    let ran = pmacctl(&format!("write --family turbo2 DP:$060450 1 --socket {socket}"));
    assert!(ran.stderr.contains("the board is a PMAC, whose DPRAM is laid out otherwise"), "{ran:?}");
    assert_eq!(*bench.seen.lock().unwrap(), [""; 0]);
    let ran = pmacctl(&format!("setup enable servo --motors 2 --send --yes --json --socket {socket}"));
    let document = ran.json();
    assert_eq!((ran.code, &document["error"]), (Some(0), &json!(null)));
    assert_eq!(document["sent"], document["commands"]);
    assert_eq!(json!(*bench.seen.lock().unwrap()), document["commands"]);
}

#[test]
fn set_up_through_the_daemon_stops_at_the_first_error() {
    let site = VirtualSite::running(&[], &[]);
    // The servo report runs, so GATHER would start data gathering.
    site.ask("I45=1 I20=1 I21=$80002B DEFINE GATHER 100");
    let ran = site.run(&["setup", "enable", "servo", "background", "--motors", "3", "--send", "--yes"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.stdout.contains("\nsent I48=1\n") && !ran.stdout.contains("sent GATHER"), "{ran:?}");
    let gathers =
        || site.run(&["status", "--json"]).json()["socket"]["enabled"].to_string().contains("gather");
    assert!(!gathers());
    assert_eq!(site.ask("I48 I49 I59"), ["1", "1", "3"]);
    // A gather buffer cannot be defined while it is in use. With I45=1 it does not come to an end.
    site.ask("GATHER");
    site.wait_until("gathering in the status", gathers);
    let enable = ["setup", "enable", "gather", "--source", "D:$002B", "--send", "--yes"];
    let ran = site.run(&enable);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let told: Vec<_> = ran.stderr.lines().collect();
    assert!(told[0].starts_with("done: I") && told[0].contains("; failed: DEFINE GATHER 1024; "), "{ran:?}");
    assert!(told[0].ends_with("not sent: GATHER"), "{ran:?}");
    assert_eq!(told[1], "ERR003: data error or unrecognized command");
    assert!(!ran.stdout.contains("sent DEFINE"), "{ran:?}");
    let ran = site.run(&[&enable[..], &["--json"]].concat());
    assert_eq!((ran.json()["error"]["code"].as_i64(), ran.code), (Some(3), Some(1)));
    site.assert_no_violations();
}

#[test]
fn abort_and_kill_go_at_once_and_the_status_says_whether_they_went() {
    let bench = Bench::new();
    let socket = bench.socket.display();
    for line in ["abort", "abort --all", "kill", "abort 1 3"] {
        let ran = pmacctl(&format!("{line} --socket {socket}"));
        assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)), "{line}");
    }
    assert_eq!(
        *bench.seen.lock().unwrap(),
        ["^A", "^A", "^K", "Panel({1: \"0x2000\"})", "Panel({3: \"0x2000\"})"]
    );
    let ran = pmacctl(&format!("kill --json --socket {socket}"));
    assert_eq!(ran.json(), json!({ "sent": ["^K"], "error": null }));
    for (line, code) in [("abort 0", 2), ("abort 17", 2), ("abort --all 1", 2), ("kill 1", 2)] {
        assert_eq!(pmacctl(&format!("{line} --socket {socket}")).code, Some(code), "{line}");
    }
    assert_eq!(pmacctl("kill --socket /nonexistent/x.sock").code, Some(2));
}

#[test]
fn the_help_of_kill_says_that_a_vertical_axis_falls() {
    for arguments in ["kill --help", "--help"] {
        let told = pmacctl(arguments).stdout.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(
            told.contains("every loop opens") && told.contains("a vertical axis without a brake falls"),
            "{told}"
        );
    }
}

#[test]
fn what_cuts_everybody_off_is_not_sent_unless_somebody_says_so() {
    let bench = Bench::new();
    let socket = bench.socket.display();
    for line in ["^Z", "I58=0"] {
        let ran = pmacctl(&format!("send {line} --socket {socket}"));
        assert!(
            ran.code == Some(1) && ran.stderr.contains("not sent") && ran.stderr.contains("I58=1"),
            "{ran:?}"
        );
    }
    // The daemon refuses it, whoever asks and however: of several lines none is sent.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("lines.pmc");
    std::fs::write(&path, "P1=1\nI50..60=0\n").unwrap();
    let download = format!("download {} --socket {socket}", path.display());
    let ran = pmacctl(&download);
    assert!(ran.code == Some(1) && ran.stderr.contains("I50..60=0 ends command lines"), "{ran:?}");
    let refused = |method: &str, parameters| {
        let mut client = Raw::at(&bench.socket);
        client.call(method, parameters);
        error_name(&client.receive().unwrap()) == "Refused"
    };
    for line in ["I58=P1", "P1=1 I 58 = 0", "I8,6,10=0"] {
        assert!(refused("Send", json!({ "line": line })), "{line}");
    }
    assert!(refused("SendControl", json!({ "character": "^Z", "confirmed": false })));
    assert_eq!(*bench.seen.lock().unwrap(), [""; 0]);
    assert_eq!(pmacctl(&format!("{download} --yes")).code, Some(0));
    assert_eq!(std::mem::take(&mut *bench.seen.lock().unwrap()).last().unwrap(), "I50..60=0");
    assert_eq!(pmacctl(&format!("send ^Z --yes --socket {socket}")).code, Some(0));
    assert_eq!(*bench.seen.lock().unwrap(), ["^Z"]);
}

#[test]
fn abort_and_kill_act_on_the_motors() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("#1J+ #2J+");
    assert_eq!(site.run(&["kill"]).code, Some(0));
    let open_loop =
        |motor: &str| u64::from_str_radix(&site.ask(&format!("{motor}?"))[0], 16).unwrap() >> 42 & 1;
    assert_eq!((open_loop("#1"), open_loop("#2")), (1, 1));
    assert_eq!(site.run(&["abort"]).code, Some(0));
    assert_eq!((open_loop("#1"), open_loop("#2")), (0, 0), "an abort closes open loops");
    let ran = site.run(&["abort", "9"]);
    assert_eq!(ran.stderr, "pmacctl: there is no coordinate system 9; write 1 to 8\n");
    assert_eq!(ran.code, Some(2));
    // The others are aborted all the same.
    site.ask("#1J+");
    assert_eq!(site.run(&["abort", "9", "1", "--json"]).json()["sent"], json!(["&1A"]));
    site.assert_no_violations();
    site.kill_simulator();
    let ran = site.run(&["kill", "--json"]);
    assert_eq!(ran.code, Some(1), "a dead board does not take it");
    let message = ran.stderr.trim_end();
    assert_eq!(ran.json(), json!({ "sent": [], "error": { "code": null, "message": message } }));
}

#[test]
fn a_file_is_downloaded_line_by_line() {
    let site = VirtualSite::running(&[], &[]);
    site.file("names.pmc", "#define COUNT P5\n#define START 100 ; counts\n");
    let main = site.file(
        "main.pmc",
        "; a machine\n#include \"names.pmc\"\nCOUNT=START // begin\n\nP6=COUNT*2\nCOUNT P6\n#ifdef NEVER\nUUU\n#endif\n",
    );
    let dry = site.run(&["download", &main, "--dry-run"]);
    assert_eq!((dry.stdout.as_str(), dry.code), ("P5=100\nP6=P5*2\nP5 P6\n", Some(0)));
    assert_eq!(site.ask("P5"), ["0"]);
    let ran = site.run(&["download", &main]);
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("100\n200\n", "", Some(0)));

    let bad = site.file("bad.pmc", "P7=1\nP7=2 UUU\nP7=P7+1\nUUU\n");
    let ran = site.run(&["download", &bad]);
    let error = format!("{bad}:2: ERR003: data error or unrecognized command: P7=2 UUU\n");
    let told = format!("{error}the board took 1 of 4 lines\n");
    assert_eq!((ran.stderr.as_str(), ran.code), (told.as_str(), Some(1)));
    assert_eq!(site.ask("P7"), ["1"], "nothing of a line acts that has an unknown word");
    let ran = site.run(&["download", &bad, "--keep-going", "--json"]);
    assert_eq!((ran.stderr.lines().count(), ran.code), (3, Some(1)));
    let document = ran.json();
    assert_eq!((&document["lines"], &document["taken"]), (&json!(4), &json!(2)));
    assert_eq!(
        document["errors"][1],
        json!({ "file": bad, "line": 4, "text": "UUU", "code": 3,
        "message": "ERR003: data error or unrecognized command" })
    );
    assert_eq!(site.ask("P7"), ["2"]);

    let wrong = site.file("wrong.pmc", "P8=1\n#include \"none.pmc\"\n#else\n");
    let ran = site.run(&["download", &wrong]);
    assert!(ran.stderr.starts_with(&format!("{wrong}:2: ")), "{ran:?}");
    assert!(ran.stderr.contains(&format!("{wrong}:3: #else without #ifdef")), "{ran:?}");
    assert!(ran.stderr.ends_with("pmacctl: 2 mistakes; nothing was sent\n"), "{ran:?}");
    assert_eq!((ran.code, site.ask("P8")), (Some(2), vec!["0".to_owned()]));
    assert_eq!(site.run(&["download", "/nonexistent"]).code, Some(2));
    site.assert_no_violations();
}

#[test]
fn a_buffer_is_closed_whatever_happens() {
    let bench = Bench::new();
    let directory = tempfile::tempdir().unwrap();
    let socket = bench.socket.display();
    let download = |text: &str, options: &str| {
        let path = directory.path().join("f");
        std::fs::write(&path, text).unwrap();
        let ran = pmacctl(&format!("download {} {options} --socket {socket}", path.display()));
        (ran, std::mem::take(&mut *bench.seen.lock().unwrap()))
    };
    let (ran, seen) = download("OPEN PROG 1\nX1\nCLOSE\n", "--quiet");
    assert_eq!((seen, ran.code), (["OPEN PROG 1", "X1", "CLOSE"].map(str::to_owned).to_vec(), Some(0)));
    let (ran, seen) = download("OPEN PROG 1\nBAD\nX1\nCLOSE\n", "");
    assert_eq!((seen, ran.code), (["OPEN PROG 1", "BAD", "CLOSE"].map(str::to_owned).to_vec(), Some(1)));
    let (ran, seen) = download("OPEN PROG 1\nLATE\n", "");
    assert!(ran.stderr.contains("f:2: the board did not answer in time"), "{ran:?}");
    assert_eq!((seen.last().unwrap().as_str(), ran.code), ("CLOSE", Some(1)));
    let (ran, _) = download("a\nPART\nb\n", "");
    assert_eq!((ran.stdout.as_str(), ran.code), ("a\na part of it\n", Some(1)), "{ran:?}");
    assert!(ran.stderr.contains("f:2: the board did not answer in time: 1 line of its reply"), "{ran:?}");
    let (ran, seen) = download("a\nPART\nb\n", "--keep-going --json");
    let error = &ran.json()["errors"][0];
    assert_eq!((&ran.json()["taken"], &error["line"], &error["code"]), (&json!(1), &json!(2), &json!(null)));
    assert!(error["message"].as_str().unwrap().contains("may or may not"), "{ran:?}");
    assert_eq!(seen, ["a", "PART"], "where the board does not answer, nothing more is sent");
    let (ran, seen) = download("OPEN PROG 1\nX1\n", "");
    assert!(ran.stderr.contains("left open"), "{ran:?}");
    assert_eq!((seen.last().unwrap().as_str(), ran.code), ("CLOSE", Some(0)));
}

#[test]
fn a_restore_says_which_line_may_have_been_carried_out() {
    let bench = Bench::new();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("part.pmc");
    std::fs::write(&path, "P1=5\nP404=1\nP500=2\n").unwrap();
    let ran =
        pmacctl(&format!("restore {} --yes --json --socket {}", path.display(), bench.socket.display()));
    assert_eq!(*bench.seen.lock().unwrap(), ["P1 P404 P500", "P1=5", "P404=1"]);
    let told: Vec<_> = ran.stderr.lines().collect();
    let stopped = ":2: stopped at this line; the board may or may not have executed it";
    assert_eq!(told[0], format!("{}{stopped}", path.display()), "{ran:?}");
    assert_eq!(told[1], "the board took 1 of 3 lines", "{ran:?}");
    assert!(told[2].starts_with("the board did not answer in time"), "{ran:?}");
    let document = ran.json();
    assert_eq!((&document["taken"], &document["errors"][0]["line"]), (&json!(1), &json!(2)));
    assert_eq!(ran.code, Some(1));
}

#[test]
fn the_status_says_when_command_lines_are_off() {
    let site = VirtualSite::new();
    let path = site.file("config", "functions = ['servo']\nmotors = 2\ni10 = 3713707\n");
    site.start_simulator(&["--dpram-startup"]);
    site.start_daemon(&["--config", &path]);
    let ran = site.run(&["status"]);
    assert!(ran.stdout.contains("\ncommand lines   off by the daemon's configuration\n"), "{ran:?}");
    assert_eq!(site.run(&["status", "--json"]).json()["socket"]["functions"], json!(["servo"]));
}

#[test]
fn variables_are_backed_up_compared_and_restored() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("I9=2 I125=$C000 I122=2000.5 P7=-0.5 P1023=12345.678");
    // Apart: a blank before & would not keep it from being an operator.
    site.ask("&1Q3=7 M1->Y:$FFC2,0 M5=42");
    site.ask("&3");
    let path = site.path("machine.pmc");
    let path = path.to_str().unwrap();
    let began = std::time::Instant::now();
    let ran = site.run(&["backup", "-o", path]);
    eprintln!("a backup of all variables took {:?}", began.elapsed());
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), ("", "", Some(0)));
    let saved = std::fs::read_to_string(path).unwrap();
    let comments: Vec<_> = saved.lines().take_while(|line| line.starts_with("; ")).collect();
    assert!(comments[1].contains("PMAC1") && comments[2].starts_with("; firmware 1.16D, "), "{comments:?}");
    let lines: Vec<_> = saved.lines().skip(comments.len()).collect();
    assert_eq!(lines.len(), 1024 * 5 + 1 - 1, "I, P, &1, Q, definitions, and the values of all but one M");
    let known = [
        "I9=2",
        "I122=2000.5",
        "I125=$C000",
        "P7=-0.5",
        "P1023=12345.678",
        "&1",
        "Q3=7",
        "M1->Y:$FFC2,0",
        "M5->*",
        "M5=42",
    ];
    for line in known {
        assert!(lines.contains(&line), "{line}");
    }
    assert!(!lines.contains(&"M1=0"), "what M1 points to is not the backup's business");
    assert_eq!(site.ask("&"), ["3"], "the addressed coordinate system is left as it was");
    let ran = site.run(&["diff", path]);
    assert_eq!((ran.stdout.as_str(), ran.code), ("", Some(0)), "{ran:?}");

    // From here on with a part of it, as people keep one.
    let path = &site.file("part.pmc", &known.join("\n"));

    site.ask("I9=1 I122=1 P7=3");
    site.ask("&1Q3=8 M1->* M5=1");
    site.ask("&2");
    let ran = site.run(&["diff", path]);
    let differ = "-I9=2\n+I9=1\n-I122=2000.5\n+I122=1\n-P7=-0.5\n+P7=3\n-&1Q3=7\n+&1Q3=8\n-M1->Y:$FFC2,0\n+M1->*\n-M5=42\n+M5=1\n";
    assert_eq!((ran.stdout.as_str(), ran.code), (differ, Some(1)));
    let ran = site.run(&["diff", path, "--json"]);
    assert_eq!(ran.json()[1], json!({ "variable": "I122", "first": "2000.5", "second": "1" }));

    let plan = "I9=2  ; was 1\nI122=2000.5  ; was 1\nP7=-0.5  ; was 3\n&1Q3=7  ; was 8\nM1->Y:$FFC2,0  ; was *\nM5=42  ; was 1\n";
    let ran = site.run(&["restore", path, "--dry-run"]);
    assert_eq!((ran.stdout.as_str(), ran.code), (plan, Some(0)));
    let ran = site.run(&["restore", path]);
    assert!(ran.stderr.contains("--yes"), "{ran:?}");
    assert_eq!((ran.code, site.ask("P7")), (Some(2), vec!["3".to_owned()]));
    let ran = site.run(&["restore", path, "--yes"]);
    assert_eq!((ran.stdout.as_str(), ran.stderr.as_str(), ran.code), (plan, "", Some(0)));
    assert_eq!(site.run(&["diff", path]).code, Some(0));
    assert_eq!(site.ask("&"), ["2"]);
    site.assert_no_violations();
}

#[test]
fn a_restore_leaves_its_own_port_alone_and_tells_errors_by_line() {
    let site = VirtualSite::running(&[], &[]);
    // I5 has two bits: the board takes 7 and holds another value.
    let path = site.file("part.pmc", "I3=0\nI6=3\nI58=0\nI5=7\nP1=5\n&9Q1=1\nP2=6\n");
    let ran = site.run(&["restore", &path, "--yes"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(
        ran.stderr.contains("ERR003"),
        "reading Q-variables of a coordinate system that is not there: {ran:?}"
    );
    let path = site.file("part.pmc", "I3=0\nI6=3\nI58=0\nI5=7\nP1=5\nP2=6\n");
    let ran = site.run(&["restore", &path, "--yes", "--json"]);
    let told: Vec<_> = ran.stderr.lines().collect();
    assert_eq!(told.len(), 4, "{ran:?}");
    for (told, begin) in told.iter().zip([":1: I3 stays at 2", ":2: I6 stays at 1", ":3: I58 stays at 1"]) {
        assert!(told.starts_with(&format!("{path}{begin}")), "{told}");
    }
    assert!(told[3].starts_with(&format!("{path}:4: the board took the line but now holds ")), "{ran:?}");
    let document = ran.json();
    assert_eq!((document["skipped"].as_array().unwrap().len(), &document["taken"]), (3, &json!(3)));
    assert_eq!((document["errors"][0]["line"].as_u64(), ran.code), (Some(4), Some(1)));
    assert_eq!(site.ask("I3 I6 I58 P1 P2"), ["2", "1", "1", "5", "6"]);

    let other = site.file("other.pmc", "P1=5.0\nP2=7\nP3=1\n");
    let ran = pmacctl(&format!("diff {path} {other}"));
    let differ = "-I3=0\n-I5=7\n-I6=3\n-I58=0\n-P2=6\n+P2=7\n+P3=1\n";
    assert_eq!((ran.stdout.as_str(), ran.code), (differ, Some(1)));
    let wrong = site.file("wrong.pmc", "P1=5\nOPEN PROG 1\nP1=6\n");
    for command in ["restore", "diff"] {
        let ran = site.run(&[command, &wrong]);
        assert!(ran.stderr.starts_with(&format!("{wrong}:2: ")), "{ran:?}");
        assert!(ran.stderr.contains(&format!("{wrong}:3: P1 is set in line 1 already")), "{ran:?}");
        assert_eq!(ran.code, Some(2));
    }
    assert_eq!(site.run(&["backup", "--what", "X"]).code, Some(2));
    let ran = site.run(&["backup", "--what", "p,i", "--json"]);
    assert_eq!(ran.json()["variables"].as_array().unwrap().len(), 2048);
    assert_eq!(ran.json()["board_type"].as_str().unwrap().split(',').next(), Some("PMAC1"));
    assert_eq!(site.run(&["backup", "-o", "/nonexistent/x", "--what", "I"]).code, Some(2));
    assert_eq!(site.run(&["diff", "/nonexistent"]).code, Some(2));
    assert_eq!(pmacctl("backup --socket /nonexistent/x.sock").code, Some(2));
    site.assert_no_violations();
}

#[test]
fn an_interrupted_download_closes_its_buffer() {
    let bench = Bench::new();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("long.pmc");
    std::fs::write(&path, format!("OPEN PROG 1\nJ+\n{}CLOSE\n", "X1\n".repeat(100_000))).unwrap();
    let child = command()
        .args(["download", "--quiet", "--socket"])
        .args([&bench.socket, &path])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    bench.wait_seen("J+");
    nix::sys::signal::kill(nix::unistd::Pid::from_raw(child.id().cast_signed()), Signal::SIGINT).unwrap();
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert!(ran.stderr.ends_with(": interrupted before this line\n"), "{ran:?}");
    assert_eq!(ran.code, Some(1));
    let seen = bench.seen.lock().unwrap();
    assert!(seen.len() < 100_000);
    assert_eq!(seen.last().unwrap(), "CLOSE");
}
