//! `pmacd` and `pmacctl` as processes: what they refuse, and what they leave behind.

use std::process::Stdio;
use std::time::{Duration, Instant};

use pmac_dpram::segment::{RegionId, Subscriber};

use crate::support::{Site, is_live, wait_until};

#[test]
fn a_second_daemon_on_the_same_name_is_refused() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let second = site.daemon_command(&[]).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(second.status.code(), Some(69));
    let error = String::from_utf8(second.stderr).unwrap();
    assert!(error.contains("in use") && error.contains(&site.daemon_pid().to_string()), "{error}");
    // Nor may one of another name have the same board: a board has one host.
    let other = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
        .args(["--board", &format!("file:{}", site.path("dpram").display())])
        .args(["--name", &format!("{}-other", site.name), "--socket"])
        .arg(site.path("other"))
        .output()
        .unwrap();
    assert_eq!(other.status.code(), Some(69));
    let error = String::from_utf8(other.stderr).unwrap();
    assert!(error.contains("dpram is the board of another running pmacd"), "{error}");
    assert!(is_live(&site.attach(), RegionId::Servo), "the first one goes on");
    assert_eq!(site.stop_daemon(), 0);
    assert!(site.connection_refused());
}

/// The directory of the simulator that daemon `pid` has started.
fn left(pid: u32) -> Option<String> {
    let prefix = format!("pmac-sim-{pid}-");
    let name = |entry: std::fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
    std::fs::read_dir("/dev/shm").unwrap().flatten().map(name).find(|name| name.starts_with(&prefix))
}

#[test]
fn a_daemon_killed_while_its_simulator_starts_leaves_no_directory() {
    for moment in 0..10 {
        let site = Site::new();
        let mut daemon = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
            .args(["--board", "sim", "--name", &site.name, "--socket"])
            .arg(site.socket())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let pid = daemon.id();
        wait_until("the simulator's directory", || left(pid).is_some());
        // At once, and while the board powers up.
        let killed_at = Instant::now() + Duration::from_millis(moment);
        while Instant::now() < killed_at {}
        daemon.kill().unwrap();
        daemon.wait().unwrap();
        wait_until("the directory to be gone", || left(pid).is_none());
        let _ = std::fs::remove_file(format!("/dev/shm/{}", site.name));
        let _ = std::fs::remove_file(format!("/dev/shm/{}.lock", site.name));
    }
}

#[test]
fn what_a_daemon_and_its_simulator_leave_that_are_killed_together_the_next_one_removes() {
    let start = |site: &Site| {
        let daemon = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
            .args(["--board", "sim", "--name", &site.name, "--socket"])
            .arg(site.socket())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        wait_until("live servo data", || {
            Subscriber::attach(&site.segment()).is_ok_and(|seen| is_live(&seen, RegionId::Servo))
        });
        daemon
    };
    let site = Site::new();
    let mut daemon = start(&site);
    let children = format!("/proc/{0}/task/{0}/children", daemon.id());
    let simulator: i32 = std::fs::read_to_string(children).unwrap().trim().parse().unwrap();
    // Stopped, the simulator cannot follow the daemon's end.
    let simulator = nix::unistd::Pid::from_raw(simulator);
    nix::sys::signal::kill(simulator, nix::sys::signal::Signal::SIGSTOP).unwrap();
    daemon.kill().unwrap();
    daemon.wait().unwrap();
    nix::sys::signal::kill(simulator, nix::sys::signal::Signal::SIGKILL).unwrap();
    wait_until("the simulator's end", || nix::sys::signal::kill(simulator, None).is_err());
    // Nobody is there to remove its directory, but for a simulator that another test starts meanwhile.
    let other = Site::new();
    let next = start(&other);
    assert_eq!(left(daemon.id()), None);
    drop(other.adopt(next));
    let _ = std::fs::remove_file(format!("/dev/shm/{}", site.name));
    let _ = std::fs::remove_file(format!("/dev/shm/{}.lock", site.name));
}

#[test]
fn a_killed_daemon_leaves_no_simulator_and_a_killed_demo_no_daemon() {
    let site = Site::new();
    let mut daemon = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
        .args(["--board", "sim", "--name", &site.name, "--socket"])
        .arg(site.socket())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until("live servo data", || {
        Subscriber::attach(&site.segment()).is_ok_and(|subscriber| is_live(&subscriber, RegionId::Servo))
    });
    assert!(left(daemon.id()).is_some());
    daemon.kill().unwrap();
    daemon.wait().unwrap();
    wait_until("the simulator to end and take its directory away", || left(daemon.id()).is_none());
    let _ = std::fs::remove_file(format!("/dev/shm/{}", site.name));
    let _ = std::fs::remove_file(format!("/dev/shm/{}.lock", site.name));

    let mut demo = std::process::Command::new(env!("CARGO_BIN_EXE_pmacctl"))
        .arg("demo")
        .env("TMPDIR", site.path(""))
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let segment = format!("pmac-demo-{}", demo.id()).parse().unwrap();
    wait_until("the demo's servo data", || {
        Subscriber::attach(&segment).is_ok_and(|subscriber| is_live(&subscriber, RegionId::Servo))
    });
    demo.kill().unwrap();
    demo.wait().unwrap();
    wait_until("the demo's daemon to end and take its segment away", || {
        Subscriber::attach(&segment).is_err()
    });
}

#[test]
fn the_demo_of_a_turbo_board_shows_the_motors_that_move() {
    let place = Site::new();
    let demo = std::process::Command::new(env!("CARGO_BIN_EXE_pmacctl"))
        .args(["demo", "--family", "turbo2", "--seconds", "1"])
        .env("TMPDIR", place.path(""))
        .output()
        .unwrap();
    let text = String::from_utf8(demo.stdout).unwrap();
    assert!(demo.status.success() && text.contains(" #8=") && !text.contains(" #9="), "{text}");
}

#[test]
fn a_daemon_starts_a_simulated_turbo_board_that_reports_everything() {
    let family = "family = \"turbo2\"\n";
    for (board, config, family, length) in [
        ("sim,family=turbo2", "", "turbo2", 0x1_0000),
        ("sim,dpram=8k", family, "turbo2", 0x4000),
        ("sim,family=turbo,dpram=32k", "", "turbo", 0x1_0000),
    ] {
        let site = Site::new();
        let config = site.file("pmacd.toml", config);
        let daemon = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
            .args(["--board", board, "--config", &config, "--name", &site.name, "--socket"])
            .arg(site.socket())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let pid = daemon.id();
        let site = site.adopt(daemon);
        let is_live = |region| Subscriber::attach(&site.segment()).is_ok_and(|seen| is_live(&seen, region));
        wait_until("both reports", || is_live(RegionId::Servo) && is_live(RegionId::Background));
        let json = |command| serde_json::from_str::<serde_json::Value>(&site.pmacctl(&[command, "--json"]).1);
        let status = json("status").unwrap();
        assert_eq!((&status["family"], &status["board"]["family"]), (&family.into(), &family.into()));
        // What lay in the memory at power-on is no program.
        assert_eq!(status["programs"], serde_json::json!([]), "{board}");
        assert_eq!(json("motors").unwrap()["motors"].as_array().unwrap().len(), 32);
        assert_eq!(json("coordinates").unwrap()["coordinate_systems"].as_array().unwrap().len(), 16);
        let prefix = format!("pmac-sim-{pid}-");
        let files = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let mut own = files.filter(|file| file.file_name().to_string_lossy().starts_with(&prefix));
        let memory = own.next().unwrap().path().join("dpram");
        assert_eq!(std::fs::metadata(memory).unwrap().len(), length, "{board}");
    }
}

#[test]
fn a_malformed_request_is_one_line_and_its_status() {
    let site = Site::new();
    let config = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(config.path(), "board = \"sim\"\nspeed = 1\n").unwrap();
    let config = config.path().to_str().unwrap();
    for (arguments, status) in [
        (&["--board", "boat"] as &[&str], 64),
        (&["--board", "sim", "--nonsense"], 64),
        (&["--board", "sim", "--name", "a/b"], 64),
        (&["--board", "sim,dpram=32k"], 64),
        (&["--config", config], 78),
        (&["--config", "/nonexistent"], 78),
        (&["--board", "sim", "--user", "no-such-user-here"], 78),
        (&["--board", "file:/nonexistent/dpram"], 69),
        (&[], 64),
    ] {
        let output =
            std::process::Command::new(env!("CARGO_BIN_EXE_pmacd")).args(arguments).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {error}");
        let error = error.lines().filter(|line| !line.starts_with("[WARN ")).collect::<Vec<_>>().join("\n");
        assert_eq!(error.lines().count(), 1, "{arguments:?}: {error}");
    }
    for arguments in [&["motors"] as &[&str], &["send", "P1"], &["read", "Q:$D000"], &["decode", "/dev/null"]]
    {
        let (status, stdout, error) = site.pmacctl(arguments);
        assert_eq!((status, stdout.as_str(), error.lines().count()), (2, "", 1), "{arguments:?}: {error}");
    }
}
