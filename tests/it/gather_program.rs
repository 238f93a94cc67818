//! `pmacctl gather` on a simulated board with its daemon.

use std::time::Instant;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::segment::RegionId;

use crate::support::rig::Ran;
use crate::support::{PATIENCE, VirtualSite, is_live, joined, status_within};

fn rows(text: &str) -> Vec<Vec<f64>> {
    text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
}

/// How long to gather at every servo cycle; a minute: `PMAC_GATHER_SECONDS=60`.
fn seconds() -> u64 {
    std::env::var("PMAC_GATHER_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(2)
}

#[test]
fn nothing_is_lost() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    let csv = site.path("data.csv");
    let sources = ["servo_timer", "1.actual_position", "D:$0028", "1.commanded_position"];
    let sources: Vec<&str> = sources.iter().flat_map(|source| ["--source", source]).collect();
    let seconds = seconds();
    let (time, samples) = (seconds.to_string(), (seconds as f64 * 1e9 / 442_708.373).round() as usize);
    let arguments = [&["gather"][..], &sources, &["--seconds", &time, "-o", csv.to_str().unwrap()]].concat();
    let began = Instant::now();
    let ran = site.hurried(|| site.run(&arguments));
    println!("{} in {:.1} s of real time", ran.stdout.trim_end(), began.elapsed().as_secs_f64());
    let said = format!("samples={samples} lost=0 seconds={seconds}.000\n");
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(0), said.as_str()), "{ran:?}");
    let text = std::fs::read_to_string(&csv).unwrap();
    assert!(text.starts_with("sample,time_s,servo_timer [servo cycles],1.actual_position [count],D:$0028,"));
    let rows = rows(&text);
    assert_eq!(rows.len(), samples);
    for (number, row) in rows.iter().enumerate() {
        assert_eq!((row[0], row[2]), (number as f64, rows[0][2] + number as f64));
    }

    let npy = site.path("data.npy");
    let npy_name = npy.to_str().unwrap();
    let arguments = [
        "gather",
        "--source",
        "X:$0000",
        "--period",
        "4",
        "--seconds",
        "0.5",
        "--output",
        npy_name,
        "--json",
    ];
    let ran = site.hurried(|| site.run(&arguments));
    assert_eq!((ran.json()["samples"].as_u64(), ran.json()["lost"].as_u64()), (Some(282), Some(0)));
    let bytes = std::fs::read(&npy).unwrap();
    assert!(bytes.starts_with(b"\x93NUMPY") && bytes.len() > 282 * 24);
    site.assert_no_violations();
}

#[test]
fn the_counts_are_exact_and_the_board_is_left_as_it_was() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    let gather =
        |rest: &[&str]| site.run(&[&["gather", "--source", "servo_timer", "-o", "-"], rest].concat());
    let ran = gather(&["--seconds", "0.5", "--period", "2"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let rows = rows(&ran.stdout);
    let count = |name: &str| -> u64 {
        let (_, rest) = ran.stderr.split_once(&format!("{name}=")).unwrap();
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    assert_eq!(
        (count("samples"), count("samples") + count("lost")),
        (rows.len() as u64, 565),
        "{}",
        ran.stderr
    );
    for row in &rows {
        assert_eq!(row[2] - rows[0][2], 2.0 * (row[0] - rows[0][0]), "numbered as the board counts");
    }
    assert_eq!(site.ask("I19"), ["1"], "as it was");
    site.wait_until("the servo report to go on", || is_live(&site.attach(), RegionId::Servo));

    // A buffer that is gathered once ends by itself.
    let ran = gather(&["--once", "--buffer", "100"]);
    assert!(ran.code == Some(0) && ran.stderr.starts_with("samples=100 lost=0 "), "{ran:?}");
    site.ask("DELETE GATHER");
    assert!(!starts_the_report(&site), "ENDGATHER has not ended it in place of the gather");

    for (rest, said) in [
        (&["--buffer", "3000", "--seconds", "1"][..], "overlap"),
        (&["--buffer", "90000", "--seconds", "1"], "there is room for"),
        (&["--buffer", "5", "--seconds", "1"], "too short"),
        (&["--source", "1.position", "--seconds", "1"], "actual_position"),
        (&["--period", "0", "--seconds", "1"], "period of 0"),
    ] {
        let ran = gather(rest);
        assert!(ran.code != Some(0) && ran.stderr.contains(said), "{rest:?}: {ran:?}");
    }
    let ran = site.run(&["gather", "--source", "servo_timer", "-o", "data.txt"]);
    assert!(ran.code == Some(2) && ran.stderr.contains(".csv or .npy"), "{ran:?}");
    site.assert_no_violations();
}

/// Whether a `GATHER` starts the servo report. Where the report runs, it would gather, for which there must be no buffer.
fn starts_the_report(site: &VirtualSite) -> bool {
    site.connection().send("GATHER", PATIENCE).is_ok()
}

#[test]
fn what_fails_before_the_first_sample_leaves_the_board_as_it_was() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    let gather = || {
        let words = ["gather", "--source", "servo_timer", "--period", "3", "--seconds", "0.2", "-o", "-"];
        site.run(&words)
    };
    // A gather that waits for its trigger: DEFINE GATHER is refused, and the status does not tell.
    site.ask("I20=1 I21=$80002B DEFINE GATHER 100 GATHER TRIGGER");
    let ran = gather();
    assert!(ran.code == Some(1) && ran.stderr.starts_with("DEFINE GATHER "), "{ran:?}");
    assert_eq!((site.ask("I19"), ran.stderr.lines().count()), (vec!["1".to_owned()], 1));
    let refused = site.connection().send("DELETE GATHER", PATIENCE);
    assert!(refused.is_err(), "somebody else's gather waits on");
    // That ends it, and another one would end the report.
    site.ask("ENDGATHER");
    site.ask("DELETE GATHER");
    assert!(!starts_the_report(&site));

    // A board that starts no servo report: the GATHER that was to start it is taken back as well.
    site.ask("ENDGATHER");
    site.ask("I59=0");
    site.wait_until("the report to end", || !is_live(&site.attach(), RegionId::Servo));
    let ran = gather();
    assert!(ran.code == Some(1) && ran.stderr.contains("start no servo report"), "{ran:?}");
    assert_eq!(site.ask("I19"), ["1"]);
    site.ask("DELETE GATHER");
    assert!(starts_the_report(&site), "it was left off");
    site.assert_no_violations();
}

#[test]
fn a_report_that_was_just_ended_is_started_again() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    for _ in 0..5 {
        site.ask("ENDGATHER");
        let ran = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.1", "-o", "-"]);
        assert!(ran.code == Some(0) && ran.stderr.starts_with("samples="), "{ran:?}");
        site.wait_until("the report, which goes on", || is_live(&site.attach(), RegionId::Servo));
    }
    let ran = site.run(&["gather", "--stop"]);
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(0), "the board gathers nothing; nothing was sent\n"));
    site.ask("DELETE GATHER");
    assert!(!starts_the_report(&site), "it runs on");
    site.ask("I20=1 I21=$80002B DEFINE GATHER 100");
    site.ask("GATHER");
    let ran = site.run(&["gather", "--stop", "--json"]);
    assert_eq!((ran.code, ran.json()["gathered"].as_bool()), (Some(0), Some(true)), "{ran:?}");
    site.ask("DELETE GATHER");
    assert!(!starts_the_report(&site), "it runs on");
    site.assert_no_violations();
}

#[test]
fn a_function_that_is_off_is_told_before_board_or_file_is_touched() {
    let site = VirtualSite::configured(&[], "functions = ['servo', 'ascii']\n");
    site.ask("I19=2 I20=1 I21=5 I45=0");
    let csv = site.path("data.csv");
    std::fs::write(&csv, "what was there").unwrap();
    let ran = site.run(&["gather", "--source", "servo_timer", "-o", csv.to_str().unwrap()]);
    assert!(ran.code == Some(1) && ran.stderr.contains("the function `gather` is switched off"), "{ran:?}");
    assert_eq!(std::fs::read_to_string(&csv).unwrap(), "what was there");
    assert_eq!(site.ask("I19 I20 I45"), ["2", "$1", "0"]);
    site.assert_no_violations();
}

#[test]
fn a_file_that_takes_no_more_holds_whole_samples() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    for form in ["csv", "npy"] {
        let file = site.path(&format!("data.{form}"));
        // A file may not grow beyond 20 KiB, as if the disk were full then; the signal that tells is ignored.
        let script = "trap '' 25; ulimit -f $((20480 / $1)); shift; exec \"$@\"";
        let unit = if std::process::Command::new("sh")
            .args(["-c", "test -n \"$BASH_VERSION\""])
            .status()
            .unwrap()
            .success()
        {
            "1024"
        } else {
            "512"
        };
        let ran = std::process::Command::new("sh")
            .args(["-c", script, "sh", unit, env!("CARGO_BIN_EXE_pmacctl"), "--name", &site.name, "--socket"])
            .arg(site.socket())
            .args(["gather", "--source", "servo_timer", "--seconds", "10", "-o"])
            .arg(&file)
            .output()
            .unwrap();
        let said = String::from_utf8(ran.stderr).unwrap();
        assert_eq!(ran.status.code(), Some(2), "{said}");
        let (_, said) = said.split_once(&format!("data.{form}: File too large")).unwrap();
        let kept: usize = said.split_once("; ").unwrap().1.split_once(" of ").unwrap().0.parse().unwrap();
        let bytes = std::fs::read(&file).unwrap();
        assert!(kept > 100 && bytes.len() > 10_000, "{said}");
        if form == "csv" {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.ends_with('\n'));
            assert!(rows(&text).len() == kept && rows(&text).iter().all(|row| row.len() == 3));
        } else {
            let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            assert_eq!(bytes.len(), header + 24 * kept);
            assert!(String::from_utf8_lossy(&bytes[..header]).contains(&format!("({kept},)")));
        }
        assert!(
            site.run(&["gather", "--stop"]).stdout.contains("nothing was sent"),
            "the board is left as it was"
        );
    }
    site.assert_no_violations();
}

#[test]
fn waiting_for_a_reader_ends_with_a_signal() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    let fifo = site.path("data.csv");
    nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::from_bits_truncate(0o600)).unwrap();
    for signal in [Signal::SIGINT, Signal::SIGTERM] {
        let mut waits = site
            .command(&["gather", "--source", "servo_timer", "-o"])
            .arg(&fifo)
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = [0; 16];
        std::io::Read::read_exact(waits.stderr.as_mut().unwrap(), &mut said).unwrap();
        kill(Pid::from_raw(waits.id().cast_signed()), signal).unwrap();
        assert_eq!(status_within(&mut waits, PATIENCE).code(), Some(2));
    }
    let reader = std::thread::spawn({
        let fifo = fifo.clone();
        move || std::fs::read_to_string(fifo).unwrap()
    });
    let ran =
        site.run(&["gather", "--source", "servo_timer", "--seconds", "0.2", "-o", fifo.to_str().unwrap()]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(rows(&joined(reader)).len() > 10);
    site.assert_no_violations();
}

#[test]
fn a_sample_in_seven_seconds_is_waited_for() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    // The first sample comes at once, the second one 15000 servo cycles of 442.7 us later.
    let gather = ["gather", "--source", "servo_timer", "--period", "15000", "--seconds", "13.3", "-o", "-"];
    let ran = site.hurried(|| site.run(&gather));
    assert!(ran.code == Some(0) && ran.stderr.starts_with("samples=2 lost=0 "), "{ran:?}");
    assert_eq!(site.ask("I19"), ["1"]);
    site.assert_no_violations();
}

#[test]
fn without_the_servo_report_gathering_goes_by_the_hosts_clock() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    site.ask("ENDGATHER");
    site.ask("I48=0");
    site.wait_until("the report to end", || !is_live(&site.attach(), RegionId::Servo));
    let gather = || site.run(&["gather", "--source", "servo_timer", "--seconds", "0.5", "-o", "-"]);
    let check = |ran: Ran| {
        assert_eq!(ran.code, Some(0), "{ran:?} {}", site.log());
        let rows = rows(&ran.stdout);
        assert!(rows.len() > 100, "{}", ran.stderr);
        for row in &rows {
            assert_eq!(row[2] - rows[0][2], row[0] - rows[0][0], "numbered as the board counts");
        }
    };
    check(gather());
    assert!(!is_live(&site.attach(), RegionId::Servo), "the report is off as before");
    // I48=1, but no GATHER has begun the report: the first one does, and the second one gathers.
    site.ask("I48=1");
    check(gather());
    // ENDGATHER undid the latest GATHER only.
    site.wait_until("the report, which goes on", || is_live(&site.attach(), RegionId::Servo));
    check(gather());
    site.wait_until("the report, which goes on", || is_live(&site.attach(), RegionId::Servo));
    site.assert_no_violations();
}
