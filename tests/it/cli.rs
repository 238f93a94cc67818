//! The command line: what it prints, and how it ends.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Stdio;
use std::time::Duration;

use pmac_dpram::segment::{RegionId, RegionState, State};

use crate::support::bench::Bench;
use crate::support::rig::{Ran, Rig, command, pmacctl, pmacctl_with, pty};
use crate::support::status_within;

const MOTORS: &str = "\
motor  target  commanded  actual  following error  velocity  flags
   #1     0.0     1000.0   999.8              0.2       0.0  homed in-position
   #2     0.0      -25.0   -24.0             -1.0   -1129.4  moving
   #3    0raw      77raw  -77raw           154raw      5raw  open-loop
";
const SYSTEMS: &str = "\
system  mode     lines  PE  left ms  override  targets  flags
    &1  circle1      3   0      0.0         -  X12.5    running in-position
    &2  linear       0   0      0.0         -
    &3  linear       0   0      0.0         -
ports: JPAN $000000  JTHW $000000  JOPTO $000000
";

fn said(stdout: &str, code: i32) -> Ran {
    Ran { stdout: stdout.to_owned(), stderr: String::new(), code: Some(code) }
}

/// One line on stderr, nothing on stdout.
fn one_clear_line(ran: &Ran) -> &str {
    assert_eq!(ran.stdout, "", "{ran:?}");
    assert_eq!(ran.stderr.lines().count(), 1, "{ran:?}");
    assert!(ran.stderr.starts_with("pmacctl: "), "{ran:?}");
    ran.stderr.trim_end()
}

#[test]
fn motors_and_coordinates_are_shown_live() {
    let rig = Rig::new().live();
    assert_eq!(rig.run("motors"), said(MOTORS, 0));
    assert_eq!(rig.run("coordinates"), said(SYSTEMS, 0));
    assert_eq!(rig.run("motors --quiet"), said("", 0));
    let watched = "update=1 fresh &1 mode=circle1 lines=3 override=- targets=X12.5 flags=running,in-position &2 mode=linear lines=0 \
                   override=- targets= flags= &3 mode=linear lines=0 override=- targets= flags=\n";
    assert_eq!(rig.run("watch coordinates --count 1"), said(watched, 0));
    assert_eq!(
        rig.run("watch coordinates --count 1 --json").json()["coordinate_systems"][0]["coordinate_system"],
        1
    );
}

#[test]
fn motors_as_json_have_the_pinned_keys() {
    let rig = Rig::new().live();
    let ran = rig.run("motors --json");
    assert_eq!(ran.code, Some(0));
    let document = ran.json();
    assert_eq!(document["servo"]["fresh"], true);
    assert_eq!(document["servo"]["sequence"], 1);
    assert_eq!(document["servo"]["servo_timer"], 0x11234);
    assert!(document["servo"]["time"].as_str().unwrap().ends_with('Z'));
    assert_eq!(document["motors"].as_array().unwrap().len(), 3);
    let motor = &document["motors"][0];
    assert_eq!(motor["motor"], 1);
    for key in [
        "commanded_position",
        "actual_position",
        "master_position",
        "compensation_position",
        "previous_dac",
        "servo_status",
        "actual_velocity",
        "time_left",
        "handwheel_pointer",
    ] {
        let quantity = motor[key].as_object().unwrap();
        assert_eq!(
            quantity.keys().map(String::as_str).collect::<Vec<_>>(),
            ["raw", "unit", "value"],
            "{key}"
        );
    }
    assert_eq!(motor["actual_position"]["raw"], 3072 * 1000 - 768);
    assert_eq!(motor["actual_position"]["value"], 999.75);
    assert_eq!(motor["actual_position"]["unit"], "count");
    let status = ["motor_activated", "integration_mode", "desired_velocity_zero"];
    assert_eq!(motor["status"], serde_json::json!(status));
    assert!(document["motors"][2]["actual_position"]["value"].is_null());
}

#[test]
fn an_image_decodes_as_the_live_data_do() {
    let rig = Rig::new().live();
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), rig.image()).unwrap();
    let path = file.path().display();
    let image = pmacctl(&format!("decode {path} --motors 3 --json")).json();
    // The scales are not in the image: raw values and everything else agree.
    let live = rig.run("motors --json").json();
    for (image, live) in image["motors"].as_array().unwrap().iter().zip(live["motors"].as_array().unwrap()) {
        assert_eq!(image["status"], live["status"]);
        for (key, quantity) in live.as_object().unwrap() {
            assert_eq!(image[key].get("raw"), quantity.get("raw"), "{key}");
        }
    }
    let coordinates = rig.run("coordinates --json").json();
    let systems = coordinates["coordinate_systems"].as_array().unwrap().iter().cloned();
    // An image is not asked for the panel's words.
    let without = |mut system: serde_json::Value| {
        assert_eq!(system.as_object_mut().unwrap().remove("feed_override"), Some(serde_json::Value::Null));
        system
    };
    assert_eq!(image["coordinate_systems"], systems.map(without).collect::<serde_json::Value>());
    assert_eq!(image["servo"]["servo_timer"], 0x1234);
    let ran = pmacctl(&format!("decode {path} --motors 3"));
    assert!(ran.stdout.contains(SYSTEMS), "{ran:?}");

    std::fs::write(file.path(), [0; 100]).unwrap();
    let ran = pmacctl(&format!("decode {path}"));
    assert!(one_clear_line(&ran).contains("16384 bytes, not 100"), "{ran:?}");
    assert_eq!(ran.code, Some(2));
    std::fs::write(file.path(), [0; 0x1_0000]).unwrap();
    let ran = pmacctl(&format!("decode {path}"));
    assert!(
        one_clear_line(&ran).contains("16384 bytes, not 65536; if it is a Turbo PMAC's: --family turbo"),
        "{ran:?}"
    );
    // Longer than any: not all of it is read.
    std::fs::write(file.path(), vec![0; 0x2_0000]).unwrap();
    let ran = pmacctl(&format!("decode {path}"));
    assert!(one_clear_line(&ran).ends_with("16384 bytes, and this one has more than 65536"), "{ran:?}");
    assert_eq!(pmacctl("decode /nonexistent").code, Some(2));
    assert_eq!(pmacctl(&format!("decode {path} --motors 9")).code, Some(2));
}

#[test]
fn old_data_say_so() {
    let rig = Rig::new().live();
    let stale = |rig: &Rig, reason: &str, name: &str| {
        let ran = rig.run("motors");
        assert_eq!(ran.code, Some(1));
        let (first, rest) = ran.stdout.split_once('\n').unwrap();
        assert!(first.starts_with("STALE: ") && first.contains(reason), "{first}");
        // Flags of the background data stand beside the servo data only while they are live themselves.
        let background_is_live = !["board_silent", "starting", "daemon_stopped"].contains(&name);
        let without = MOTORS.replace("  homed in-position", "").replace("   0.0  ", "     -  ");
        let without = without.replace("  0raw  ", "     -  ");
        assert_eq!(rest, if background_is_live { MOTORS.to_owned() } else { without });
        let ran = rig.run("motors --json");
        assert_eq!((ran.code, &ran.json()["servo"]["fresh"]), (Some(1), &serde_json::json!(false)));
        assert_eq!(ran.json()["servo"]["stale"], name);
    };
    rig.publisher.set_region_state(RegionId::Servo, RegionState::Stale);
    stale(&rig, "has not updated these data for", "no_updates");
    rig.publisher.set_region_state(RegionId::Servo, RegionState::Off);
    stale(&rig, "I48", "off");
    rig.publisher.set_region_state(RegionId::Servo, RegionState::Live);
    rig.publisher.set_period(RegionId::Servo, 1, 1);
    stale(&rig, "has not updated these data for", "no_updates");
    rig.publisher.set_state(State::Stale);
    stale(&rig, "the board does not answer", "board_silent");
    rig.publisher.set_state(State::Init);
    stale(&rig, "identifying", "starting");
    rig.publisher.beat(0);
    stale(&rig, "no sign of life", "daemon_stopped");
}

#[test]
fn a_daemon_that_gives_no_sign_of_life_is_not_waited_for_before_its_old_data_are_shown() {
    let rig = Rig::new().live();
    rig.publisher.beat(0);
    let directory = tempfile::tempdir().unwrap();
    let socket = directory.path().join("socket");
    let listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    let ran = rig.run(&format!("motors --socket {}", socket.display()));
    assert!(
        ran.code == Some(1) && ran.stdout.starts_with("STALE: pmacd has given no sign of life"),
        "{ran:?}"
    );
    listener.set_nonblocking(true).unwrap();
    assert_eq!(listener.accept().unwrap_err().kind(), std::io::ErrorKind::WouldBlock, "it was asked");
}

#[test]
fn no_daemon_is_said_and_no_data_too() {
    let ran = pmacctl("--name pmac-test-nobody motors");
    assert!(one_clear_line(&ran).contains("is pmacd running"), "{ran:?}");
    assert_eq!(ran.code, Some(2));
    let ran = pmacctl("--name pmac-test-nobody status --json");
    assert_eq!((ran.code, ran.json()["condition"].as_str()), (Some(1), Some("absent")));
    let rig = Rig::new();
    let ran = rig.run("motors");
    assert!(ran.stdout.starts_with("STALE: there are no servo data yet"), "{ran:?}");
    assert_eq!(ran.code, Some(1));
    assert_eq!(rig.run("motors --json").json()["motors"], serde_json::json!([]));
}

#[test]
fn status_tells_segment_board_and_socket() {
    let rig = Rig::new().live();
    let bench = Bench::called(&rig.name, |_| {});
    let ran = rig.run(&format!("status --socket {}", bench.socket.display()));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for part in
        ["condition live", "PMAC1, pmac, 1.16D", "reports 3 motors", "2258.8 Hz", "enabled servo ascii"]
    {
        let words = ran.stdout.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains(part), "{part}: {}", ran.stdout);
    }
    let document = rig.run("status --json --socket /nonexistent/x.sock").json();
    assert_eq!(document["condition"], "unreachable");
    assert_eq!(document["regions"]["servo"]["published"], 1);
    assert_eq!(document["counters"]["lost"], 0);
    assert_eq!(document["socket"]["reachable"], false);
    rig.publisher.set_state(State::Stale);
    assert_eq!(rig.run("status").code, Some(1));
}

#[test]
fn the_doctor_finds_what_is_wrong() {
    let rig = Rig::new().live();
    let bench = Bench::called(&rig.name, |_| {});
    let ran = rig.run(&format!("doctor --socket {}", bench.socket.display()));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let (others, scales): (Vec<_>, Vec<_>) = ran.stdout.lines().partition(|line| !line.contains("scales"));
    assert!(others.iter().all(|line| line.starts_with("ok  ")), "{ran:?}");
    assert!(scales.len() == 1 && scales[0].starts_with("warn"), "{ran:?}");
    assert!(scales[0].contains("Ix08 of #3, so"), "{ran:?}");

    let level = |ran: &Ran, check: &str| {
        let report = ran.json();
        let found = report.as_array().unwrap().iter().find(|found| found["check"] == check).cloned();
        found.unwrap_or_else(|| panic!("{check}: {report}"))["level"].as_str().unwrap().to_owned()
    };
    let ran = rig.run("doctor --json --socket /nonexistent/x.sock");
    assert_eq!((ran.code, level(&ran, "socket").as_str()), (Some(1), "fail"));
    assert_eq!(level(&ran, "segment"), "ok");
    rig.publisher.set_region_state(RegionId::Background, RegionState::Off);
    let other = Bench::called(&rig.name, |board| board.pid = 1);
    let ran = rig.run(&format!("doctor --json --socket {}", other.socket.display()));
    assert_eq!(
        (level(&ran, "background"), level(&ran, "same daemon")),
        ("warn".to_owned(), "fail".to_owned())
    );
    assert_eq!(ran.code, Some(1));
    assert_eq!(pmacctl("doctor --name pmac-test-nobody").code, Some(1));
}

#[test]
fn the_map_needs_no_daemon_and_follows_family_and_firmware() {
    let printed = pmacctl("map --json");
    let records = printed.json();
    assert_eq!(records.as_array().unwrap().len(), 289);
    let keys: Vec<_> = records[0].as_object().unwrap().keys().cloned().collect();
    let pinned =
        ["format", "function", "host_offset", "length", "number", "pmac_address", "register", "space"];
    assert_eq!(keys, pinned);
    assert_eq!(pmacctl("map --json --family pmac2").json(), records);
    let text = |line: &str| pmacctl(line).stdout;
    assert!(text("map").lines().any(|line| line.contains("$D200") && line.contains("gather")));
    let moved = text("map --firmware 1.16D");
    assert!(moved.lines().any(|line| line.contains("$D240") && line.contains("gather")));
    let turbo = pmacctl("map --json --family turbo2").json();
    assert_eq!((turbo.as_array().unwrap().len(), &turbo[0]["confidence"]), (722, &"L".into()));
    assert_eq!(
        pmacctl("map --json --family turbo").json(),
        turbo,
        "the sizes of the DPRAM differ behind the table"
    );
    assert!(text("map --family turbo").lines().next().unwrap().ends_with("confidence"));
    assert!(!text("map").contains("confidence"));
    let ran = pmacctl("map --family vax");
    assert!(one_clear_line(&ran).contains("there are pmac, pmac2, turbo, turbo2"), "{ran:?}");
    assert_eq!((ran.code, pmacctl("map --firmware new").code), (Some(2), Some(2)));
}

#[test]
fn addresses_are_read_as_the_manual_prints_them() {
    let bench = Bench::new();
    let socket = bench.socket.display();
    let ran = pmacctl(&format!("read Y:$D001 X:$D009 DP:$D200 0x0024 --socket {socket}"));
    let expected = "\
address   offset  words      value
Y:$D001   0x0004  0002           2
X:$D009   0x0026  0013          19
DP:$D200  0x0800  0400 0401  67175424
Y:$D009   0x0024  0012          18
";
    let columns = |text: &str| {
        text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect::<Vec<_>>()
    };
    assert_eq!(columns(&ran.stdout), columns(expected));
    assert_eq!(ran.code, Some(0));
    let json = pmacctl(&format!("--socket {socket} --json read D:$D014")).json();
    assert_eq!(json[0]["words"], serde_json::json!([0x28, 0x29, 0x2A, 0x2B]));
    assert_eq!(json[0]["host_offset"], 0x50);
    let before = bench.seen.lock().unwrap().len();
    for wrong in ["Z:$D000", "Y:$C000", "0x0001", "0x9000", ""] {
        let ran = pmacctl_with(["--socket", &socket.to_string(), "read", wrong]);
        one_clear_line(&ran);
        assert_eq!(ran.code, Some(2), "{wrong}");
    }
    assert_eq!(bench.seen.lock().unwrap().len(), before);
}

#[test]
fn a_line_is_sent_and_its_reply_stands_alone() {
    let bench = Bench::new();
    let socket = bench.socket.to_str().unwrap();
    let send =
        |args: &[&str]| pmacctl_with(["--socket", socket, "send"].into_iter().chain(args.iter().copied()));
    assert_eq!(send(&["1.5,2.5"]), said("1.5\n2.5\n", 0));
    assert_eq!(send(&["J+"]), said("", 0));
    assert_eq!(send(&["^K"]), said("", 0));
    let error = "ERR003: data error or unrecognized command\n".to_owned();
    assert_eq!(send(&["BAD"]), Ran { stdout: "before\n".to_owned(), stderr: error.clone(), code: Some(1) });
    let ran = send(&["BAD", "--json"]);
    assert_eq!((ran.json()["error"]["code"].as_i64(), ran.stderr, ran.code), (Some(3), error, Some(1)));
    assert_eq!(send(&["--json", "a"]).json(), serde_json::json!({"lines": ["a"], "error": null}));
    let late = "the board did not answer in time: 1 line of its reply had come, its end had not; \
                the line may or may not have been carried out";
    let ran = send(&["PART"]);
    assert_eq!(ran, Ran { stdout: "a part of it\n".to_owned(), stderr: format!("{late}\n"), code: Some(1) });
    let ran = send(&["PART", "--json"]);
    let error = serde_json::json!({ "code": null, "meaning": late });
    assert_eq!(ran.json(), serde_json::json!({ "lines": ["a part of it"], "error": error }));
    let ran = send(&["OFF", "--json"]);
    let error = serde_json::json!({ "code": null, "meaning": ran.stderr.trim_end() });
    assert_eq!((ran.json(), ran.code), (serde_json::json!({ "lines": [], "error": error }), Some(1)));
    assert_eq!(
        *bench.seen.lock().unwrap(),
        ["1.5,2.5", "J+", "^K", "BAD", "BAD", "a", "PART", "PART", "OFF"]
    );
    for wrong in [
        &["#1\r"] as &[&str],
        &[""],
        &[&"x".repeat(201)],
        &["a", "--timeout", "0"],
        &["a", "--timeout", "700"],
    ] {
        let ran = send(wrong);
        one_clear_line(&ran);
        assert_eq!(ran.code, Some(2), "{wrong:?}");
    }
    assert_eq!(bench.seen.lock().unwrap().len(), 9);
}

#[test]
fn unknown_things_get_one_clear_line() {
    for line in [
        "frobnicate",
        "motors --frob",
        "motors extra",
        "read",
        "send",
        "--name ../x motors",
        "watch --rate 0",
        "watch --count 0",
    ] {
        let ran = pmacctl(line);
        one_clear_line(&ran);
        assert_eq!(ran.code, Some(2), "{line}");
    }
    let ran = pmacctl("--help");
    assert!(ran.stdout.contains("motors") && ran.code == Some(0));
}

#[test]
fn a_reader_that_goes_away_ends_it_quietly_and_a_full_disk_does_not() {
    let mut map = command();
    let mut map = map.args(["map", "--json"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(map.stdout.take());
    let ran = Ran::from(map.wait_with_output().unwrap());
    assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)));
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let ran = Ran::from(command().arg("map").stdout(full).stderr(Stdio::piped()).output().unwrap());
    assert!(one_clear_line(&ran).contains("No space left"), "{ran:?}");
    assert_eq!(ran.code, Some(2));
}

#[test]
fn watch_repaints_on_a_terminal() {
    let rig = Rig::new().live();
    let pty = pty(None);
    let watching = command()
        .args(["--name", &rig.name, "watch", "--count", "2", "--rate", "100"])
        .stdout(pty.slave)
        .output();
    assert_eq!(watching.unwrap().status.code(), Some(0));
    // The other end of a terminal that nobody has open any more gives what is left, and then an error.
    let mut screen = Vec::new();
    let _ = std::fs::File::from(pty.master).read_to_end(&mut screen);
    let screen = String::from_utf8(screen).unwrap();
    assert_eq!(screen.matches("\x1b[H").count(), 2, "{screen:?}");
    assert!(screen.contains("#1     0.0     1000.0   999.8              0.2"), "{screen:?}");
}

#[test]
fn watch_keeps_to_its_window_and_ends_on_q() {
    let rig = Rig::new().live();
    let size = nix::pty::Winsize { ws_row: 4, ws_col: 30, ws_xpixel: 0, ws_ypixel: 0 };
    let pty = pty(Some(&size));
    let mut watching = command()
        .args(["--name", &rig.name, "watch", "--rate", "100"])
        .stdin(pty.slave.try_clone().unwrap())
        .stdout(pty.slave)
        .spawn()
        .unwrap();
    let mut terminal = std::fs::File::from(pty.master);
    let (mut screen, mut bytes) = (String::new(), [0; 4096]);
    // The first frame is not over before the next one begins.
    while screen.matches("\x1b[H").count() < 2 {
        let count = terminal.read(&mut bytes).unwrap();
        screen += std::str::from_utf8(&bytes[..count]).unwrap();
    }
    let frame = screen.split("\x1b[H").nth(1).unwrap();
    let lines: Vec<&str> = frame.split("\r\n").map(|line| line.trim_start_matches("\x1b[K")).collect();
    let title = format!("/{} (q ends it)  update 1", rig.name);
    assert_eq!(lines[0], &title[..30], "{frame:?}");
    assert_eq!(lines[1], "motor  actual  flags");
    assert_eq!(lines[2..], ["... 4 more", "\x1b[J"], "{frame:?}");
    terminal.write_all(b"q").unwrap();
    assert_eq!(status_within(&mut watching, Duration::from_secs(10)).code(), Some(0));
}

#[test]
fn watch_prints_a_line_each_time_in_a_pipe() {
    let rig = Rig::new().live();
    let ran = rig.run("watch --count 3 --rate 100");
    let lines: Vec<_> = ran.stdout.lines().collect();
    let motors = "#1=999.8 following_error=0.2 flags=homed,in-position #2=-24.0 following_error=-1.0 flags=moving \
                  #3=-77raw following_error=154raw flags=open-loop";
    assert!(
        lines.len() == 3 && lines.iter().all(|line| *line == format!("update=1 fresh {motors}")),
        "{ran:?}"
    );
    assert_eq!(ran.code, Some(0));
    let ran = rig.run("watch --seconds 0.1 --json");
    assert!(ran.stdout.lines().all(|line| line.starts_with("{\"motors\"") && line.ends_with('}')), "{ran:?}");
}

#[test]
fn watch_goes_on_with_the_next_daemon() {
    let rig = Rig::new().live();
    let mut watching = command()
        .args(["--name", &rig.name, "watch", "--rate", "50"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(watching.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.next().unwrap().starts_with("update=1 fresh"));
    let name = rig.name.clone();
    drop(rig);
    assert!(lines.any(|line| line.contains("stale=daemon_gone")), "an old position was shown as live");
    let mut rig = Rig::named(&name).live();
    rig.publish();
    assert!(lines.any(|line| line.starts_with("update=2 fresh")));
    drop(lines);
    // Its reader has gone: it ends by itself, and quietly.
    assert_eq!(watching.wait().unwrap().code(), Some(0));
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_a_stranger_may_look_and_not_send() {
    let bench = Bench::with(|options| options.mode = 0o666);
    // Where the stranger finds the program and the socket.
    let directory = bench.socket.parent().unwrap();
    let program = directory.join("pmacctl");
    std::fs::copy(env!("CARGO_BIN_EXE_pmacctl"), &program).unwrap();
    for path in [directory, &program] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    let run = |args: &[&str]| -> Ran {
        let mut command = std::process::Command::new(&program);
        command.uid(65_534).gid(65_534).arg("--socket").arg(&bench.socket).args(args);
        for _ in 0..500 {
            match command.output() {
                // Another test's child may still hold the copy open for writing, for a moment.
                Err(error) if error.kind() == std::io::ErrorKind::ExecutableFileBusy => {
                    std::thread::sleep(std::time::Duration::from_millis(10));
                }
                output => return output.unwrap().into(),
            }
        }
        panic!("the program's copy stays busy");
    };
    assert_eq!(run(&["read", "0x0024"]).code, Some(0));
    for (args, role) in [(["send", "#1J+"], "engineer"), (["send", "^K"], "stop")] {
        let ran = run(&args);
        assert!(ran.stderr.contains(role) && ran.stderr.contains("not permitted"), "{ran:?}");
        assert_eq!(ran.code, Some(1));
    }
    assert_eq!(*bench.seen.lock().unwrap(), ["read 0x0024 1"]);
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_b2_7_a_group_counts_that_no_data_base_has_the_user_in() {
    // Group 1 exists everywhere; user 65534 is not its member in any data base.
    let group = nix::unistd::Group::from_gid(nix::unistd::Gid::from_raw(1)).unwrap().unwrap().name;
    let bench = Bench::with(|options| {
        options.mode = 0o666;
        options.roles.stop = vec![group];
    });
    let directory = bench.socket.parent().unwrap();
    let program = directory.join("pmacctl");
    std::fs::copy(env!("CARGO_BIN_EXE_pmacctl"), &program).unwrap();
    for path in [directory, &program] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    for (groups, is_permitted) in [(["--clear-groups", ""], false), (["--groups", "7,1"], true)] {
        let mut command = std::process::Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534"]);
        command.args(groups.into_iter().filter(|word| !word.is_empty()));
        let output =
            command.arg(&program).arg("--socket").arg(&bench.socket).args(["send", "^K"]).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(!stderr.contains("not permitted"), is_permitted, "{groups:?}: {stderr}");
    }
    assert_eq!(*bench.seen.lock().unwrap(), ["^K"]);
}

#[test]
fn a_line_that_the_shell_has_eaten_is_told_how_to_quote_it() {
    let told = |arguments: &[&str]| {
        let ran = pmacctl_with(arguments.iter().copied());
        assert_eq!(ran.code, Some(2), "{arguments:?}: {ran:?}");
        ran.stderr
    };
    for arguments in [&["send"][..], &["send", ""], &["send", "--yes"]] {
        let told = told(arguments);
        assert!(told.contains("quote it: pmacctl send '#1P'"), "{arguments:?}: {told}");
    }
    let told_of_two = told(&["send", "#1J+", "P1"]);
    assert!(told_of_two.contains("nothing was sent; quote it: pmacctl send '#1J+ P1'"), "{told_of_two}");
    let told = told(&["read", "Y:", "--family", "pmac"]);
    assert!(told.contains("quote the address, as 'Y:$D001'"), "{told}");
}
