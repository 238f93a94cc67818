//! One board, whatever it is called: name and socket are of one board, and "live" is said of what lives.

use std::process::Command;
use std::time::Duration;

use pmac_dpram::client::{Board, ClientError, CommandError, Connection};
use pmac_dpram::segment::{RegionId, RegionState};

use crate::support::bench::{Bench, no_socket};
use crate::support::rig::{Rig, pmacctl_with};
use crate::support::{PATIENCE, Place, Site, VirtualSite, status_within, wait_until};

#[test]
fn a_socket_alone_is_that_of_its_own_board() {
    let (first, second) = (Rig::new().live(), Rig::new().live());
    let bench = Bench::called(&second.name, |_| {});
    let socket = bench.socket.to_str().unwrap();
    let ran = pmacctl_with(["--socket", socket, "status", "--json"]);
    assert_eq!((ran.json()["name"].as_str(), ran.code), (Some(second.name.as_str()), Some(0)));
    for line in ["motors", "coordinates", "watch --count 1", "doctor"] {
        let ran = pmacctl_with(["--socket", socket].into_iter().chain(line.split(' ')));
        assert_eq!(ran.code, Some(0), "{line}: {ran:?}");
    }
    let before = bench.seen();
    for line in [
        "status",
        "motors",
        "coordinates",
        "doctor",
        "watch --count 1",
        "panel show",
        "send P1",
        "abort",
        "kill",
        "read 0x0024",
        "variable list",
        "panel feed 1 100%",
    ] {
        let ran = first.run(&format!("--socket {socket} {line}"));
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{line}: {ran:?}");
        let both = ran.stderr.contains(&first.name) && ran.stderr.contains(&second.name);
        assert!(both && ran.stderr.lines().count() == 1, "{line}: {ran:?}");
    }
    assert_eq!(bench.seen(), before, "nothing was sent to the other board");
    // A place where no daemon answers is no other board.
    let nobody = no_socket().display();
    assert_eq!(first.run(&format!("--socket {nobody} motors")).code, Some(0));
}

#[test]
fn the_client_library_keeps_a_board_together() {
    let (first, second) = (Rig::new().live(), Rig::new().live());
    let bench = Bench::called(&second.name, |_| {});
    assert_eq!(Board::at_socket(&bench.socket).unwrap().name().as_str(), second.name);
    assert!(matches!(Board::at_socket(no_socket()), Err(ClientError::Socket(_))));
    let mut mixed = Board::attach(&first.name).unwrap().with_socket(&bench.socket);
    let refused = mixed.send("P1=1", PATIENCE);
    assert!(matches!(refused, Err(CommandError::OtherBoard { .. })), "{refused:?}");
    let refused = mixed.watch_variables(&["X:$0".parse().unwrap()]);
    assert!(matches!(refused, Err(CommandError::OtherBoard { .. })));
    assert_eq!(bench.seen(), [""; 0]);
}

#[test]
fn a_simulator_that_was_killed_ends_its_daemon() {
    let place = Place::new();
    let log = std::fs::File::create(place.path("log")).unwrap();
    let mut daemon = Command::new(env!("CARGO_BIN_EXE_pmacd"))
        .args(["--board", "sim", "--name", &place.name, "--socket"])
        .arg(place.socket())
        .stderr(log)
        .spawn()
        .unwrap();
    place.wait_for_live_servo();
    let said = || std::fs::read_to_string(place.path("log")).unwrap();
    // A thread of its own writes the log: it may come later than the data.
    wait_until("the log names the simulator", || said().contains(" serves board "));
    let started = said();
    let line = started.lines().find(|line| line.contains("] simulator ")).unwrap();
    let words: Vec<&str> = line.split("simulator ").nth(1).unwrap().split(" runs in ").collect();
    let pid = nix::unistd::Pid::from_raw(words[0].parse().unwrap());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGKILL).unwrap();
    assert_eq!(status_within(&mut daemon, PATIENCE).code(), Some(69), "{}", said());
    assert!(said().contains("the simulator ended by itself (signal: 9 (SIGKILL))"), "{}", said());
    assert!(!std::path::Path::new(words[1]).exists(), "{} is left", words[1]);
}

#[test]
fn the_exit_statuses_are_the_documented_ones() {
    let site = Site::new();
    let config = site.file("pmacd.toml", "board = \"sim\"\n");
    let missing = site.path("no/such/directory/x.sock").display().to_string();
    for (arguments, expected) in [
        // What is typed is wrong, whatever the file says.
        (&["--config", &config, "--board", "boat"] as &[&str], 64),
        (&["--config", &config, "--name", "a/b"], 64),
        (&["--board", "sim", "--socket", &missing], 69),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pmacd"));
        let name = ["--name", site.name.as_str()];
        let name = if arguments.contains(&"--name") { &[][..] } else { &name };
        let output = command.args(name).args(arguments).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(expected), "{arguments:?}: {error}");
    }
}

#[test]
fn the_demo_has_the_name_it_was_given_and_says_how_to_reach_it() {
    let place = Place::new();
    let mut demo = place.command(&["demo", "--seconds", "600"]);
    let mut demo =
        demo.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let said = std::io::BufRead::lines(std::io::BufReader::new(demo.stderr.take().unwrap())).next();
    let said = said.unwrap().unwrap();
    assert_eq!(said, format!("try: pmacctl --socket {} send '#1P'", place.socket().display()));
    wait_until("the demo's board", || Board::attach(&place.name).is_ok());
    let socket = place.socket();
    let ran = pmacctl_with(["--socket", socket.to_str().unwrap(), "send", "P1"]);
    assert_eq!((ran.stdout.as_str(), ran.code), ("0\n", Some(0)), "{ran:?}");
    nix::sys::signal::kill(
        nix::unistd::Pid::from_raw(demo.id().cast_signed()),
        nix::sys::signal::Signal::SIGTERM,
    )
    .unwrap();
    assert_eq!(status_within(&mut demo, PATIENCE).code(), Some(0));
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_b5_2_a_user_starts_a_board_by_hand() {
    use std::os::unix::fs::{PermissionsExt, chown};
    use std::os::unix::process::CommandExt;
    let directory = tempfile::tempdir_in("/dev/shm").unwrap();
    std::fs::set_permissions(directory.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
    let home = directory.path().join("run");
    std::fs::create_dir(&home).unwrap();
    chown(&home, Some(65_534), Some(65_534)).unwrap();
    for program in ["pmacd", "pmacctl", "pmac-sim"] {
        let from = std::path::Path::new(env!("CARGO_BIN_EXE_pmacd")).with_file_name(program);
        std::fs::copy(from, directory.path().join(program)).unwrap();
    }
    let name = format!("pmac-test-user-{}", std::process::id());
    let program = |program: &str| {
        let mut command = Command::new(directory.path().join(program));
        command.uid(65_534).gid(65_534).env("XDG_RUNTIME_DIR", &home).args(["--name", &name]);
        command
    };
    let mut daemon = program("pmacd").args(["--board", "sim"]).spawn().unwrap();
    let socket = home.join(format!("pmacd/{name}.sock"));
    wait_until("the user's own socket", || socket.exists());
    wait_until("a board that lives", || program("pmacctl").arg("status").output().unwrap().status.success());
    let sent = program("pmacctl").args(["send", "P1"]).output().unwrap();
    assert_eq!(String::from_utf8(sent.stdout).unwrap(), "0\n");
    // Nobody else takes that user's answers for the board's, nor finds the socket by that user's environment.
    let stranger = Connection::open(&socket);
    assert!(matches!(stranger, Err(CommandError::Stranger { uid: 65_534, .. })), "{stranger:?}");
    let root = || Command::new(directory.path().join("pmacctl"));
    let told = root().arg("--socket").arg(&socket).arg("abort").output().unwrap();
    let stderr = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(told.status.code() == Some(2) && stderr.contains("user 65534, who is not trusted"), "{stderr}");
    let told = root().env("XDG_RUNTIME_DIR", &home).args(["--name", &name, "abort"]).output().unwrap();
    assert!(String::from_utf8_lossy(&told.stderr).contains("/run/pmacd/"), "{told:?}");
    nix::sys::signal::kill(
        nix::unistd::Pid::from_raw(daemon.id().cast_signed()),
        nix::sys::signal::Signal::SIGTERM,
    )
    .unwrap();
    assert_eq!(status_within(&mut daemon, PATIENCE).code(), Some(0));
}

#[test]
fn a_board_with_stale_servo_data_is_not_live() {
    let rig = Rig::new().live();
    let bench = Bench::called(&rig.name, |_| {});
    let status = || {
        let socket = bench.socket.display();
        let ran = rig.run(&format!("status --json --socket {socket}"));
        let words = rig.run(&format!("status --socket {socket}"));
        assert_eq!(words.code, ran.code);
        let document = ran.json();
        let condition = document["condition"].as_str().unwrap().to_owned();
        let line = words.stdout.lines().find(|line| line.starts_with("condition")).unwrap().to_owned();
        (condition, line, ran.code)
    };
    let (condition, line, code) = status();
    assert_eq!((condition.as_str(), line.as_str(), code), ("live", "condition       live", Some(0)));
    for (region, name) in [(RegionId::Servo, "servo"), (RegionId::Background, "background")] {
        rig.publisher.set_region_state(region, RegionState::Stale);
        let (condition, line, code) = status();
        assert_eq!((condition.as_str(), code), ("stale", Some(1)));
        assert!(
            line.starts_with(&format!("condition       stale: {name} data: the board has not")),
            "{line}"
        );
        // What the board was never told to report is not missed.
        rig.publisher.set_region_state(region, RegionState::Off);
        assert_eq!(status().2, Some(0));
    }
    let ran = rig.run(&format!("status --json --socket {}", no_socket().display()));
    assert_eq!((ran.json()["condition"].as_str(), ran.code), (Some("unreachable"), Some(1)));
}

#[test]
fn a_dead_board_is_noticed_without_its_reports() {
    let site = VirtualSite::configured(&[], "functions = [\"ascii\", \"panel\"]\n");
    site.wait_for_identity();
    site.wait_until("a board that lives", || site.pmacctl(&["status"]).0 == 0);
    site.run_for(Duration::from_secs(30));
    assert_eq!(site.pmacctl(&["status"]).0, 0, "nobody sent a line meanwhile");
    site.board_stands_still(true);
    site.run_for(Duration::from_secs(15));
    let (code, status, _) = site.pmacctl(&["status"]);
    assert_eq!(code, 1, "{status}");
    assert!(status.contains("condition       stale"), "{status}");
    site.board_stands_still(false);
    site.wait_until("a board that lives again", || site.pmacctl(&["status"]).0 == 0);
}
