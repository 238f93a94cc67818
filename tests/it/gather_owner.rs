//! A gather has one owner, and the daemon carries out its end, whoever dies.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, getuid};
use pmac_dpram::gather::{GatherMode, GatherRequest, Source, plan};
use pmac_dpram::map::{Layout, PMAC};
use pmac_dpram::segment::RegionId;

use crate::support::raw::{Raw, error_name};
use crate::support::{PATIENCE, VirtualSite, is_live, output_within};

fn ended(site: &VirtualSite, mut child: Child) -> Output {
    site.hurried(|| output_within(&mut child, PATIENCE))
}

fn running() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("the board's scales", || site.has_scales());
    site
}

/// Begins to gather at every third servo cycle, and waits until samples come.
fn gathering(site: &VirtualSite, arguments: &[&str]) -> Child {
    let file = site.path("gathered.csv");
    let _ = std::fs::remove_file(&file);
    let child = site
        .command(&["gather", "--source", "servo_timer", "--period", "3", "-o"])
        .arg(&file)
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    site.wait_until("samples", || std::fs::metadata(&file).is_ok_and(|there| there.len() > 1000));
    child
}

/// Nothing gathers, I19 is what it was, and the servo report goes on: another GATHER would gather.
#[track_caller]
fn assert_as_before(site: &VirtualSite) {
    site.wait_until("I19 as it was", || site.ask("I19") == ["1"]);
    let ran = site.run(&["gather", "--stop"]);
    assert_eq!(ran.stdout, "the board gathers nothing; nothing was sent\n", "{ran:?}");
    site.wait_until("the servo report", || is_live(&site.attach(), RegionId::Servo));
    site.assert_no_violations();
}

#[test]
fn a_second_gather_is_refused_with_the_owners_name() {
    let site = running();
    let first = gathering(&site, &["--seconds", "4"]);
    let ran = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.2", "-o", "-"]);
    let owner = format!("uid {} (pid {}) has run a gather", getuid(), first.id());
    assert!(ran.code == Some(1) && ran.stderr.contains(&owner), "{ran:?}");
    let first = ended(&site, first);
    let said = String::from_utf8_lossy(&first.stdout);
    assert!(first.status.success() && said.starts_with("samples=3012 lost=0 "), "{first:?}");
    assert_as_before(&site);
}

#[test]
fn the_daemon_puts_back_what_a_killed_gather_changed() {
    let site = running();
    let mut killed = gathering(&site, &[]);
    assert_eq!(site.ask("I19"), ["3"]);
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert_as_before(&site);
    assert!(site.log().contains("its client is gone"), "{}", site.log());
}

#[test]
fn a_silent_gather_ends() {
    let site = running();
    let layout = Layout::new(&PMAC, Some("1.16D".parse().unwrap()));
    let request = GatherRequest {
        sources: vec![Source::parse("servo_timer", &layout).unwrap()],
        period: 3,
        mode: GatherMode::Wrap,
        buffer_longs: Some(100),
    };
    let plan = plan(&request, &layout, &Default::default()).unwrap();
    let mut owner = site.connection();
    owner.gather_start(&plan, &layout, None).unwrap();
    assert_eq!(site.ask("I19"), ["3"]);
    for _ in 0..4 {
        site.run_for(Duration::from_secs(2));
        owner.sequence_renew().unwrap();
    }
    assert_eq!(site.ask("I19"), ["3"], "whoever is heard keeps it");
    site.run_for(Duration::from_secs(7));
    assert_as_before(&site);
    assert_eq!(owner.gather_stop(None).unwrap().reason.as_deref(), Some("its client is silent"));
}

#[test]
fn a_daemon_that_is_gone_leaves_samples_and_a_board_that_may_gather() {
    let site = running();
    let gather = gathering(&site, &["--seconds", "60"]);
    site.with_world(|world| world.daemon = None);
    let Output { status, stderr, .. } = ended(&site, gather);
    let told = String::from_utf8(stderr).unwrap();
    assert_eq!(status.code(), Some(2), "{told}");
    assert!(told.contains("samples came, which are kept; the board may go on gathering"), "{told}");
    assert!(!told.contains("nothing of it was carried out"), "{told}");
}

#[test]
fn a_reset_ends_the_gather_and_is_not_undone() {
    let site = running();
    let gather = gathering(&site, &["--seconds", "60"]);
    site.control("reset");
    // Its port is gone for 2 s.
    site.run_for(Duration::from_millis(4500));
    assert!(site.log().contains(": the board was reset, which ended the gather"), "{}", site.log());
    let ran = ended(&site, gather);
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.code() == Some(1) && said.contains("the board was reset"), "{ran:?}");
    assert!(said.contains(" samples came") && !said.contains("gathers nothing"), "{said}");
    site.wait_until("a board that takes commands", || site.run(&["gather", "--stop"]).code == Some(0));
    let log = site.log();
    assert!(!log.contains("(gather) sends \"ENDGATHER\""), "it would end the servo report: {log}");
    site.assert_no_violations();
}

#[test]
fn a_daemon_that_stops_ends_the_gather() {
    let site = running();
    let gather = gathering(&site, &[]);
    site.stop_daemon();
    let ran = ended(&site, gather);
    assert_ne!(ran.status.code(), Some(0), "{ran:?}");
    site.start_daemon(&[]);
    assert_as_before(&site);
}

#[test]
fn less_than_was_asked_for_is_never_exit_0() {
    let site = running();
    let gather = gathering(&site, &["--seconds", "60"]);
    let ran = site.run(&["gather", "--stop"]);
    let whose = format!("the gather of uid {} (pid {}) has ended", getuid(), gather.id());
    assert!(ran.code == Some(0) && ran.stdout.starts_with(&whose), "{ran:?}");
    let ran = ended(&site, gather);
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.code() == Some(1) && said.contains("ended it"), "{ran:?}");
    let gather = gathering(&site, &["--seconds", "60"]);
    kill(Pid::from_raw(gather.id().cast_signed()), Signal::SIGINT).unwrap();
    let ran = ended(&site, gather);
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.code() == Some(1) && said.contains("interrupted: "), "{ran:?}");
    // Without --seconds ^C is the end that was asked for.
    let gather = gathering(&site, &[]);
    kill(Pid::from_raw(gather.id().cast_signed()), Signal::SIGINT).unwrap();
    assert!(ended(&site, gather).status.success());
    assert_as_before(&site);
}

#[test]
fn a_gather_that_nobody_owns_is_refused_and_can_be_ended() {
    let site = running();
    site.ask("I20=1 I21=$80002B I45=3 DEFINE GATHER 100");
    site.ask("GATHER");
    let ran = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.2", "-o", "-"]);
    assert!(ran.code == Some(1) && ran.stderr.contains("gathers already"), "{ran:?}");
    let ran = site.run(&["gather", "--stop"]);
    assert!(ran.code == Some(0) && ran.stdout.starts_with("the gather has ended; I19"), "{ran:?}");
    assert_as_before(&site);
}

#[test]
fn a_servo_report_that_pauses_is_no_report_that_has_ended() {
    let site = running();
    site.control("fault servo_silent on");
    site.wait_until("stale servo data", || !is_live(&site.attach(), RegionId::Servo));
    let gather = site
        .command(&["gather", "--source", "servo_timer", "--seconds", "0.5", "-o", "-"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    site.wait_until("a gather that begins", || site.log().contains("begins a gather"));
    site.run_for(Duration::from_millis(250));
    site.control("fault servo_silent off");
    let ran = ended(&site, gather);
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.success() && said.starts_with("samples=1129 lost=0 "), "{said}");
    assert_as_before(&site);
}

#[test]
fn a_period_that_the_board_cannot_hold_is_refused_before_anything_is_sent() {
    let site = running();
    let start = |period: u32| {
        let parameters = serde_json::json!({
            "registers": ["Y:$0770"], "buffer": 0x900, "size_word": 0x8FC, "index_word": 0x8FE, "size_longs": 200,
            "period": period,
        });
        let mut client = Raw::at(&site.socket());
        client.call("GatherStart", parameters);
        client.receive().unwrap()
    };
    for period in [0, 8_388_608, 1 << 24, u32::MAX] {
        assert!(error_name(&start(period)).ends_with("InvalidParameter"), "{period}");
    }
    assert_as_before(&site);
}

#[test]
fn a_gather_that_another_host_ends_says_so() {
    let site = running();
    let gather = gathering(&site, &["--seconds", "60"]);
    UnixStream::connect(site.path("serial")).unwrap().write_all(b"ENDGATHER\r").unwrap();
    site.run_for(Duration::from_secs(1));
    assert!(site.log().contains("failed: the board gathers no more"), "{}", site.log());
    let ran = ended(&site, gather);
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    assert!(ran.status.code() == Some(1) && said.contains("the board gathers no more"), "{ran:?}");
    assert!(said.contains("no client of pmacd ended that") && said.contains("samples came"), "{said}");
    assert_as_before(&site);
}

#[test]
fn a_gather_that_another_client_ends_by_line_names_him() {
    let site = running();
    for line in ["ENDGATHER", "END GATHER"] {
        let gather = gathering(&site, &["--seconds", "60"]);
        site.ask(line);
        let ran = ended(&site, gather);
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        let by = format!("uid {} (pid {}) sent ENDGATHER", getuid(), std::process::id());
        let why = format!("the board gathers no more: {by}");
        assert!(ran.status.code() == Some(1) && said.contains(&why), "{line}: {ran:?}");
        assert_as_before(&site);
    }
}

#[test]
fn i19_is_put_back_when_a_buffer_that_was_open_over_the_end_is_closed() {
    let site = running();
    let mut gather = gathering(&site, &[]);
    site.ask("OPEN PROG 7 CLEAR");
    site.ask("X1");
    gather.kill().unwrap();
    gather.wait().unwrap();
    site.run_for(Duration::from_secs(20));
    let unfinished = "sets I19 to 1 again, when the open program buffer is closed";
    let status: serde_json::Value = serde_json::from_str(&site.run(&["status", "--json"]).stdout).unwrap();
    assert!(status["socket"]["unfinished"][0].as_str().unwrap().contains(unfinished), "{status}");
    assert!(site.run(&["status"]).stdout.contains(unfinished));
    let ran = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.2", "-o", "-"]);
    assert!(ran.code == Some(1) && ran.stderr.contains(unfinished), "{ran:?}");
    site.ask("CLOSE");
    assert_as_before(&site);
    assert!(!site.run(&["status"]).stdout.contains("unfinished"));
    assert_eq!(site.ask("LIST PROG 7"), ["X1", "RET"], "nothing entered the program");
}
