//! `[[user]]`: words that the site's own programs write into the DPRAM, read by anybody from the segment.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt as _;
use std::process::Command;
use std::time::Duration;

use pmac_dpram::client::{Board, UserData, View};
use pmac_dpram::decode::Value;
use pmac_dpram::table::Table;

use crate::support::VirtualSite;
use crate::support::rig::Ran;

/// Where nobody listens: a reader of the segment needs no socket.
const NO_SOCKET: &str = "/nonexistent/pmac.sock";

fn words(board: &mut Board) -> View<UserData> {
    board.user().unwrap().unwrap()
}

fn values(board: &mut Board, name: &str) -> Option<Vec<Value>> {
    words(board).data.get(name).unwrap().values.clone()
}

/// The site's board without its socket.
fn reader(site: &VirtualSite) -> Board {
    Board::attach(&site.name).unwrap().with_socket(NO_SOCKET.as_ref())
}

/// DPRAM manual p. 6: a PLC writes motor 1's position.
#[test]
fn the_position_of_the_manuals_first_example_is_read_without_the_socket() {
    let config =
        "[[user]]\nname = 'position'\naddress = '$D000'\nformat = 'DP'\nunit = 'count'\nrate_hz = 100\n";
    let site = VirtualSite::configured(&[], config);
    site.wait_for_live_servo();
    for line in [
        "M130->D:$28",
        "M131->DP:$D000",
        "OPEN PLC 1 CLEAR",
        "M131=M130/(I108*32)",
        "CLOSE",
        "I5=2",
        "ENABLE PLC 1",
        "#1J=-70000",
    ] {
        site.ask(line);
    }
    let mut board = reader(&site);
    let at_end = |value: &Value| matches!(value, Value::Long(at) if (at + 70_000).abs() <= 1);
    site.wait_until("the position", || values(&mut board, "position").is_some_and(|all| at_end(&all[0])));
    let shown = site.run(&["watch", "user", "--count", "1", "--json"]).json();
    assert_eq!((&shown["user"]["fresh"], &shown["user"]["stale"]), (&true.into(), &serde_json::Value::Null));
    let word = &shown["words"][0];
    assert_eq!(
        (&word["name"], &word["unit"], &word["address"]),
        (&"position".into(), &"count".into(), &"DP:$D000".into())
    );
    assert!((word["value"].as_i64().unwrap() + 70_000).abs() <= 1, "{word}");
    // Nothing is shown as live where the board has stopped.
    site.board_stands_still(true);
    site.wait_until("old words", || words(&mut board).stale.is_some());
    let ran = site.run(&["watch", "user", "--count", "1"]);
    assert!(ran.code == Some(1) && ran.stdout.contains("stale="), "{ran:?}");
}

/// DPRAM manual p. 8: a host gives positions; flags say when they are taken. The PLC is the motion program's other end.
#[test]
fn the_flags_and_positions_of_the_manuals_second_example_are_words_with_names() {
    let config = "[[user]]\nname = 'go'\naddress = '$D600'\nformat = 'Y:0,1'\nrate_hz = 100\n\
                  [[user]]\nname = 'taken'\naddress = '$D600'\nformat = 'Y:1,1'\n\
                  [[user]]\nname = 'target'\naddress = '$D601'\nformat = 'DP'\ncount = 3\n";
    let site = VirtualSite::configured(&[], config);
    site.wait_for_live_servo();
    for line in [
        "M100->Y:$D600,0",
        "M104->Y:$D600,1",
        "M101->DP:$D601",
        "M102->DP:$D602",
        "M103->DP:$D603",
        "M100=1",
        "M104=0",
        "OPEN PLC 1 CLEAR",
        "IF (M100=1)",
        "M101=100000",
        "M102=-1",
        "M103=65536",
        "M104=1",
        "M100=0",
        "ENDIF",
        "CLOSE",
    ] {
        site.ask(line);
    }
    let mut board = reader(&site);
    site.wait_until("the flag", || values(&mut board, "go") == Some(vec![Value::Word(1)]));
    assert_eq!(values(&mut board, "taken"), Some(vec![Value::Word(0)]));
    site.ask("I5=2");
    site.ask("ENABLE PLC 1");
    site.wait_until("the other flag", || values(&mut board, "taken") == Some(vec![Value::Word(1)]));
    assert_eq!(values(&mut board, "go"), Some(vec![Value::Word(0)]));
    assert_eq!(values(&mut board, "target"), Some([100_000, -1, 65_536].map(Value::Long).to_vec()));
    let line = site.run(&["watch", "user", "--count", "1"]).stdout;
    assert!(line.contains(" go=0 taken=1 target=100000,-1,65536"), "{line}");
}

/// The two words change together, and the guard before and behind.
#[test]
fn words_under_a_guard_are_of_one_pass_of_the_plc_and_a_guard_that_stays_odd_tells_none() {
    let word = |name: &str, address: &str, more: &str| {
        format!("[[user]]\nname = '{name}'\naddress = '{address}'\nformat = 'DP'\n{more}\n")
    };
    let guard = "guard = 'Y:$D60F'\nrate_hz = 'servo'";
    let config = word("one", "$D610", guard) + &word("two", "$D611", guard) + &word("other", "$D612", "");
    let site = VirtualSite::configured(&[], &config);
    site.wait_for_live_servo();
    for line in [
        "M10->Y:$D60F,0,16",
        "M11->DP:$D610",
        "M12->DP:$D611",
        "M13->DP:$D612",
        "M10=0",
        "M11=0",
        "M12=0",
        "M13=7",
        "P1=0",
        "OPEN PLC 1 CLEAR",
        "P1=P1+1",
        "M10=M10+1",
        "M11=P1*65535",
        "M12=P1*65535",
        "M10=M10+1",
        "CLOSE",
        "I5=2",
        "ENABLE PLC 1",
    ] {
        site.ask(line);
    }
    let mut board = reader(&site);
    site.hold();
    let (mut whole, mut sequence) = (0, 0);
    for _ in 0..300 {
        site.step(1);
        let view = words(&mut board);
        let [one, two] = ["one", "two"].map(|name| view.data.get(name).unwrap().values.clone());
        assert_eq!(one, two, "of two passes");
        whole += usize::from(one.is_some());
        assert!(view.sequence > sequence, "a sample with each update");
        sequence = view.sequence;
    }
    assert!(whole > 200, "{whole}");
    site.go_on();
    site.ask("DISABLE PLC 1");
    site.ask("M10=1");
    site.run_for(Duration::from_millis(50));
    let view = words(&mut board);
    let of = |name: &str| view.data.get(name).unwrap().values.clone();
    assert_eq!((of("one"), of("other"), view.stale), (None, Some(vec![Value::Long(7)]), None));
    let line = site.run(&["watch", "user", "--count", "1"]).stdout;
    assert!(line.contains(" one=not_whole two=not_whole other=7"), "{line}");
}

#[test]
fn a_daemon_without_user_tables_says_how_to_write_them() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let ran = site.run(&["watch", "user", "--count", "1"]);
    assert!(ran.code == Some(2) && ran.stderr.contains("no [[user]]; pmacctl setup user"), "{ran:?}");
    let ran = site.run(&["motors", "--json"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
}

#[test]
fn a_table_that_cannot_be_is_refused_with_its_place_and_a_cure() {
    let site = VirtualSite::new();
    site.start_simulator(&[]);
    let config = site.file("bad.toml", "[[user]]\nname = 'one'\naddress = '$DA10'\nformat = 'Y:8,9'\n");
    let said = site.refusal(&config);
    assert!(said.contains("bad.toml:4:10: format = \"Y:8,9\": ") && said.contains("16 bits of Y:"), "{said}");
}

#[test]
fn m_variables_that_point_into_the_user_area_become_tables_that_the_daemon_takes() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    for line in ["M200->DP:$DA10", "M201->Y:$DA11,8,4", "M202->X:$DA12,0,16,S", "M203->X:$C003,0,24"] {
        site.ask(line);
    }
    let ran = site.hurried(|| site.run(&["setup", "user"]));
    let table = |name: &str, address: &str, format: &str| {
        format!("[[user]]\nname = \"{name}\"\naddress = \"{address}\"\nformat = \"{format}\"\n\n")
    };
    let tables =
        table("M200", "$DA10", "DP") + &table("M201", "$DA11", "Y:8,4") + &table("M202", "$DA12", "X:0,16,S");
    assert_eq!((ran.code, ran.stdout.ends_with(&tables)), (Some(0), true), "{}", ran.stdout);
    let site = VirtualSite::configured(&[], &tables);
    site.wait_for_live_servo();
    for line in ["M202->X:$DA12,0,16,S", "M202=-5"] {
        site.ask(line);
    }
    let mut board = reader(&site);
    site.wait_until("the value", || values(&mut board, "M202") == Some(vec![Value::Fixed(-5)]));
}

/// A word under a guard that stays odd has no number, and the guard is one of the words.
#[test]
fn a_log_has_a_column_for_each_word_as_it_was_last_read_before_the_update() {
    let guard = "guard = 'Y:$DA0F'\n";
    let config = "[[user]]\nname = 'count'\naddress = '$DA10'\nformat = 'DP'\nunit = 'part'\nrate_hz = 'servo'\n\
                  [[user]]\nname = 'pair'\naddress = '$DA11'\nformat = 'Y'\ncount = 2\n";
    let held = format!("[[user]]\nname = 'held'\naddress = '$DA13'\nformat = 'DP'\n{guard}");
    let site = VirtualSite::configured(&[], &format!("{config}{held}"));
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    for line in [
        "M10->Y:$DA0F,0,16",
        "M11->DP:$DA10",
        "M12->Y:$DA11,0,16",
        "M13->Y:$DA12,0,16",
        "M10=1",
        "M11=0",
        "M12=5",
        "M13=6",
        "OPEN PLC 1 CLEAR",
        "M11=M11+1",
        "CLOSE",
        "I5=2",
        "ENABLE PLC 1",
    ] {
        site.ask(line);
    }
    let log = |options: &[&str]| {
        let ran = site.run_slowly(&[&["log", "-o", "-", "--seconds", "0.1"], options].concat());
        assert!(ran.stderr.contains(" lost=0 "), "{ran:?}");
        Table::parse(ran.stdout.as_bytes()).unwrap()
    };
    let table = log(&["--motors", "1"]);
    let column = |name: &str| table.column(name).unwrap();
    let counts = column("user.count");
    assert!(counts.is_sorted() && counts.last() > counts.first(), "{counts:?}");
    for (name, value) in [("user.pair[1]", 5.0), ("user.pair[2]", 6.0)] {
        assert!(column(name).iter().all(|found| *found == value), "{name}");
    }
    assert!(column("user.held").iter().all(|value| value.is_nan()));
    assert_eq!(table.fields[table.index("user.count").unwrap()].unit, "part");
    let table = log(&["--fields", "user.count,velocity", "--motors", "1"]);
    let names: Vec<&str> = table.fields[5..].iter().map(|field| &*field.name).collect();
    assert_eq!(names, ["1.velocity", "user.count"]);
    // The trigger's word needs no column. It passes 0 half a second from now.
    let a_second = 10.0 * (counts.last().unwrap() - counts.first().unwrap());
    site.ask(&format!("M11={}", (-0.5 * a_second).round()));
    let table = log(&[
        "--fields",
        "velocity,user.pair",
        "--motors",
        "1",
        "--trigger",
        "user.count>0",
        "--before",
        "0.05",
    ]);
    let times = table.column("time_s").unwrap();
    assert!(times[0] < 0.0 && times.contains(&0.0), "{times:?}");
    let ran = site.run(&["log", "-o", "-", "--trigger", "user.pair>1"]);
    let known = "there is no \"user.pair\", but: user.count, user.pair[1], user.pair[2], user.held";
    assert!(ran.code == Some(2) && ran.stderr.contains(known), "{ran:?}");
    let ran = site.run(&["log", "-o", "-", "--fields", "user.other"]);
    assert!(ran.code == Some(2) && ran.stderr.contains("\"other\"; there are: count, pair, held"), "{ran:?}");
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_a_stranger_sees_words_and_variables_and_sets_and_moves_nothing() {
    let config = "socket_mode = \"0666\"\n[[user]]\nname = 'count'\naddress = '$DA10'\nformat = 'DP'\n";
    let site = VirtualSite::configured(&[], config);
    site.wait_for_live_servo();
    for line in ["M200->DP:$DA10", "M200=-7", "P1=5", "Q2=6"] {
        site.ask(line);
    }
    let program = site.path("pmacctl");
    std::fs::copy(env!("CARGO_BIN_EXE_pmacctl"), &program).unwrap();
    for path in [program.parent().unwrap(), &program] {
        std::fs::set_permissions(path, Permissions::from_mode(0o755)).unwrap();
    }
    let stranger = |arguments: &[&str]| -> Ran {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).arg(&program);
        command.args(["--name", &site.name, "--socket"]).arg(site.socket()).args(arguments);
        command.output().unwrap().into()
    };
    site.wait_until("the word", || stranger(&["watch", "user", "--count", "1"]).stdout.contains(" count=-7"));
    let ran = stranger(&["send", "P1 Q2 I122"]);
    assert_eq!((ran.code, &*ran.stdout), (Some(0), "5\n6\n32\n"), "{ran:?}");
    let ran = stranger(&["variable", "watch", "P1", "Q2", "--count", "1"]);
    assert!(ran.code == Some(0) && ran.stdout.contains("P1=5"), "{ran:?}");
    for line in ["P1=9", "M200", "M200=9", "#1J+", "P1 Q2=9", "I100=0", "OPEN PROG 7 CLEAR", "ENABLE PLC 1"] {
        let ran = stranger(&["send", line]);
        assert!(ran.code == Some(1) && ran.stderr.contains("not permitted"), "{line}: {ran:?}");
    }
    // Nor does a question enter the buffer that another user has open.
    site.ask("OPEN PROG 7 CLEAR");
    assert_eq!(stranger(&["send", "P1"]).code, Some(1));
    site.ask("X10");
    site.ask("CLOSE");
    let listed = site.ask("LIST PROG 7").join(" ");
    assert!(listed.starts_with("X10") && !listed.contains("P1"), "{listed}");
    assert_eq!(site.ask("P1 Q2 I100"), ["5", "6", "1"]);
}
