//! Background variables, end to end: a simulated board, its daemon, and several clients at a time.

use pmac_dpram::client::{Board, VariableWatch};
use pmac_dpram::map::VariableName;

use crate::support::VirtualSite;

fn register(text: &str) -> VariableName {
    text.parse().unwrap()
}

fn board(site: &VirtualSite) -> Board {
    Board::attach(&site.name).unwrap().with_socket(&site.socket())
}

fn watch(board: &Board, registers: &[&str]) -> VariableWatch {
    let registers: Vec<VariableName> = registers.iter().map(|text| register(text)).collect();
    board.watch_variables(&registers).unwrap()
}

/// The live table's registers as the list shows them, sorted.
fn listed(site: &VirtualSite) -> Vec<String> {
    let document = site.run(&["variable", "list", "--json"]).json();
    let name = |entry: &serde_json::Value| entry["register"].as_str().unwrap().to_owned();
    let mut names: Vec<String> = document["entries"].as_array().unwrap().iter().map(name).collect();
    names.sort();
    names
}

#[test]
fn a_watch_says_what_is_wrong_with_a_name() {
    let site = VirtualSite::running(&[], &[]);
    for (name, said) in [
        ("P99999", "there is no P99999: a PMAC has P0 to P1023"),
        ("m1024", "there is no M1024: a PMAC has M0 to M1023"),
        ("DP:$D800", "a place in the DPRAM, which `pmacctl read` shows"),
    ] {
        let ran = site.run(&["variable", "watch", name, "--count", "1"]);
        assert!(ran.code == Some(2) && ran.stderr.contains(said), "{ran:?}");
    }
}

#[test]
fn clients_share_entries_and_free_them() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    for line in ["WY$770,$123456", "WX$771,$FFFFFE", "WY$0778,1", "WX$0778,0"] {
        site.ask(line);
    }
    let (mut one, mut two) = (board(&site), board(&site));
    let first = watch(&one, &["Y:$0770", "X:$0771", "X:$0000"]);
    let second = watch(&two, &["X:$0771", "D:$0778"]);
    site.wait_until("a table of both", || listed(&site) == ["D:$0778", "X:$0000", "X:$0771", "Y:$0770"]);
    site.wait_until("values", || {
        let Some(view) = two.variables().unwrap().filter(|view| view.is_fresh()) else { return false };
        let value = |text: &str| view.data.value_of(register(text)).map(|entry| entry.value().to_vec());
        value("Y:$0770") == Some(vec![0x12_3456])
            && value("X:$0771") == Some(vec![0xFFFF_FFFE])
            && value("D:$0778") == Some(vec![1, 0])
    });
    // The servo counter is read in the pass whose end the sample's servo time tells.
    let view = one.variables().unwrap().unwrap();
    let counter = view.data.value_of(register("X:$0000")).unwrap().value()[0];
    let behind = (view.servo_timer as u32).wrapping_sub(counter) & 0xFFFF;
    assert!(behind < 2000, "{behind} servo cycles between the value and its time");

    drop(first);
    site.wait_until("the first one's entries to be free", || listed(&site) == ["D:$0778", "X:$0771"]);
    drop(second);
    site.wait_until("all entries to be free", || listed(&site).is_empty());
    assert_eq!(site.run(&["variable", "list"]).stdout, "no register is watched\n");
    site.assert_no_violations();
}

#[test]
fn the_servo_time_of_values_goes_on_when_the_table_changes() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let (one, mut reader) = (board(&site), board(&site));
    let mut times = |with_both: bool| {
        let mut found = None;
        site.wait_until("values of the table", || {
            let view = reader.variables().unwrap().filter(|view| view.is_fresh());
            let view = view.filter(|view| view.data.value_of(register("Y:$0770")).is_some() == with_both);
            found = view.map(|view| (view.servo_timer, view.time_ns));
            found.is_some()
        });
        found.unwrap()
    };
    let _first = watch(&one, &["X:$0000"]);
    let before = times(false);
    let second = watch(&one, &["Y:$0770"]);
    let with_two = times(true);
    drop(second);
    let after = times(false);
    for (earlier, later) in [(before, with_two), (with_two, after)] {
        let (cycles, ns) = (later.0 - earlier.0, later.1 - earlier.1);
        // 2.26 kHz.
        assert!(cycles < 100 + ns / 400_000, "{cycles} servo cycles in {ns} ns");
    }
}

#[test]
fn a_watch_prints_what_the_registers_hold() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.ask("WY$770,$FFFFFB");
    site.ask("WX$771,$800000");
    let watch = ["variable", "watch", "Y:$0770", "X:$0771,u", "--count", "2", "--rate", "100"];
    let ran = site.run(&watch);
    assert_eq!((ran.code, ran.stdout.lines().count()), (Some(0), 2), "{ran:?}");
    for line in ran.stdout.lines() {
        assert!(line.starts_with("servo=") && line.ends_with(" Y:$0770=-5 X:$0771,u=8388608"), "{line}");
    }
    let ran = site.run(&["variable", "watch", "X:$0771", "--count", "1", "--json"]);
    assert_eq!(ran.json()["values"][0]["value"], -0x80_0000);
    assert!(ran.json()["servo_timer"].as_u64().unwrap() > 0);

    for (arguments, said) in [
        (&["variable", "watch", "Q:$0770"][..], "Q:$0770"),
        (&["variable", "set", "Y:$0000=1"], "watchdog"),
        (&["variable", "set", "Y:$0770,20,8=1"], "leave the word"),
        (&["variable", "set", "Y:$0770,8,5=1"], "1, 4, 8, 12, 16, 20 or 24"),
        (&["variable", "set", "Y:$0770,8,4=16"], "does not fit in 4 bits"),
        (&["variable", "set", "Y:$0770=1.5"], "a whole number"),
        (&["variable", "set", "Y:$0770=0", "Y:$0770=16777216"], "does not fit in 24 bits"),
        (&["variable", "set", "L:$0778,0,24=1"], "as a whole"),
    ] {
        let ran = site.run(arguments);
        assert!(ran.code == Some(2) && ran.stdout.is_empty(), "{arguments:?}: {ran:?}");
        assert!(ran.stderr.contains(said) && ran.stderr.lines().count() == 1, "{arguments:?}: {ran:?}");
    }
    assert_eq!(site.ask("RHY$770"), ["FFFFFB"], "a refused call writes nothing");

    // 128 are all there are.
    let board = board(&site);
    let many: Vec<VariableName> = (0x770..0x7F0).map(|n| register(&format!("X:${n:X}"))).collect();
    let held = board.watch_variables(&many).unwrap();
    let ran = site.run(&["variable", "watch", "Y:$0770", "--count", "1"]);
    assert!(ran.code != Some(0) && ran.stderr.contains("128 are in use, 1 more"), "{ran:?}");
    drop(held);

    site.ask("I55=0");
    for arguments in [&["variable", "watch", "Y:$0770"][..], &["variable", "set", "Y:$0770=1"]] {
        let ran = site.run(arguments);
        assert!(ran.code != Some(0) && ran.stderr.contains("send I55=1 first"), "{ran:?}");
    }
    site.assert_no_violations();
}

#[test]
fn a_set_writes_the_bits_asked_for_and_many_in_their_order() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.ask("WY$770,$ABCDEF");
    let done = |arguments: &[&str]| {
        let ran = site.run(&[&["variable", "set"], arguments].concat());
        assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{arguments:?}");
    };
    done(&["Y:$0770,8,4=5"]);
    assert_eq!(site.ask("RHY$770"), ["ABC5EF"]);
    done(&["Y:$0770,0=0", "X:$0770=-2", "D:$0778=-3"]);
    assert_eq!(site.ask("RHY$770"), ["ABC5EE"]);
    assert_eq!(site.ask("RHX$770"), ["FFFFFE"]);
    assert_eq!((site.ask("RHX$778"), site.ask("RHY$778")), (vec!["FFFFFF".into()], vec!["FFFFFD".into()]));
    done(&["L:$0729=2.5"]);
    let ran = site.run(&["variable", "watch", "L:$0729", "--count", "1", "--json"]);
    assert_eq!(ran.json()["values"][0]["value"], 2.5);

    // 100 records take four cycles of 32; each register is written twice, and the last word counts.
    let values: Vec<String> = (0..100).map(|n| format!("Y:${:X}={}", 0x740 + n % 50, 1000 + n)).collect();
    done(&values.iter().map(String::as_str).collect::<Vec<_>>());
    for n in [0, 17, 49] {
        assert_eq!(site.ask(&format!("RY${:X}", 0x740 + n)), [(1050 + n).to_string()]);
    }
    site.assert_no_violations();
}

#[test]
fn function_blocks_of_compiled_plcs_are_watched_and_written() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    // Where the blocks lie (DPRAM manual p. 23); block 7 is seven locations on.
    for line in ["WY$9FFF,$3000", "WY$3007,$FFFFFB", "WX$3007,$000002"] {
        site.ask(line);
    }
    let watch = ["variable", "watch", "PLCC:7", "PLCC:X:7", "plcc:y:7", "PLCC:Y:7,u", "--count", "1"];
    let ran = site.run(&watch);
    let fixed = 2 * (1 << 24) + 0xFF_FFFB;
    let values = format!(" PLCC:7={fixed} PLCC:X:7=2 PLCC:Y:7=-5 PLCC:Y:7,u=16777211\n");
    assert!(ran.code == Some(0) && ran.stdout.ends_with(&values), "{ran:?}");
    let held = board(&site).watch_variables(&[register("PLCC:X:7")]).unwrap();
    site.wait_until("the block in the list", || listed(&site) == ["PLCC:7"]);
    drop(held);
    let ran = site.run(&["variable", "set", "PLCC:X:7=-2", "PLCC:Y:7,8,4=3"]);
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    assert_eq!((site.ask("RHX$3007"), site.ask("RHY$3007")), (vec!["FFFFFE".into()], vec!["FFF3FB".into()]));
    assert!(site.log().contains("variable write PLCC:X:7=-2"), "{}", site.log());
    for (arguments, said) in [
        (["variable", "set", "PLCC:7=1"], "PLCC:X:7 or PLCC:Y:7"),
        (["variable", "set", "PLCC:X:7=16777216"], "does not fit in 24 bits"),
        (["variable", "watch", "PLCC:70000"], "up to 65535"),
        (["variable", "watch", "PLCC:7,u"], "PLCC:7,u"),
    ] {
        let ran = site.run(&arguments);
        assert!(ran.code == Some(2) && ran.stderr.contains(said), "{arguments:?}: {ran:?}");
    }
    site.assert_no_violations();
}

#[test]
fn function_blocks_need_firmware_that_has_them() {
    let site = VirtualSite::running(&["--firmware", "1.15G"], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    for arguments in [["variable", "watch", "PLCC:7"], ["variable", "set", "PLCC:X:7=1"]] {
        let ran = site.run(&arguments);
        let said = "function blocks need firmware 1.16; the board has 1.15G";
        assert!(ran.code == Some(1) && ran.stderr.contains(said), "{arguments:?}: {ran:?}");
    }
    site.assert_no_violations();
}

#[test]
fn registers_and_variables_are_watched_side_by_side() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    for line in ["WY$770,$123456", "P1=2.5", "M102->Y:$0770,0,8", "I122=40"] {
        site.ask(line);
    }
    let watch = |arguments: &[&str]| {
        let ran = site.hurried(|| site.run(&[&["variable", "watch", "--count", "1"], arguments].concat()));
        assert_eq!(ran.code, Some(0), "{ran:?}");
        ran
    };
    let line = watch(&["P1", "Y:$0770", "m102", "I122"]).stdout;
    let (servo, values) = line.split_once(' ').unwrap();
    assert!(servo.starts_with("servo=") && values == "P1=2.5 Y:$0770=1193046 M102=86 I122=40\n", "{line}");
    assert_eq!(watch(&["P1"]).stdout, "P1=2.5\n");
    let document = watch(&["P1", "I122", "--json"]).json();
    assert_eq!((&document["values"][0]["value"], &document["values"][1]["value"]), (&2.5.into(), &40.into()));
    // A question never enters a program buffer, whoever has opened it.
    for line in ["OPEN PROG 7 CLEAR", "X1"] {
        site.ask(line);
    }
    let ran = site.hurried(|| site.run(&["variable", "watch", "P1"]));
    assert!(ran.code == Some(1) && ran.stderr.contains("would have become a program line"), "{ran:?}");
    site.ask("CLOSE");
    assert!(!site.ask("LIST PROG 7").concat().contains('P'));
}

#[test]
fn an_absolute_position_is_worked_out_of_what_the_board_holds() {
    let site = VirtualSite::running(&[], &[]);
    site.ask("WY$D210,$8001");
    let ran = site.run(&["board", "absolute", "--ix10", "$90D210", "--json"]);
    assert_eq!((&ran.json()["position"], ran.code), (&serde_json::json!(-32767), Some(0)), "{ran:?}");
    assert!(ran.stderr.contains("Y:$D210=$008001"), "{ran:?}");
    // As the board itself does.
    site.ask("I110=$90D210");
    site.ask("#1$*");
    assert_eq!(site.ask("#1P"), ["-32767"]);
    // What is given counts; and it is no Turbo board.
    let given = site.run(&["board", "absolute", "--ix10", "$90D210", "--word", "Y:$D210=5", "--json"]);
    assert_eq!(given.json()["position"], 5);
    let turbo = site.run(&["board", "absolute", "--ixx10", "$78D00", "--ixx95", "$200000", "--json"]);
    assert_eq!(turbo.json().get("position"), None);
    site.assert_no_violations();
}
