//! Board or daemon pause and go on: nothing that is under way ends for it, and nothing old is told as new.

use std::process::{Command, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::segment::{Counter, RegionId, Sample, monotonic_ns};

use crate::support::{Site, counter, is_live, wait_until};

const PAUSE: Duration = Duration::from_millis(300);

/// Nobody took a pause for a reset.
fn assert_no_reset(site: &Site) {
    assert_eq!(counter(&site.attach(), Counter::Resets), 0);
    assert!(!site.log().contains("was reset"), "{}", site.log());
}

#[test]
fn a_gather_goes_on_while_the_servo_report_pauses() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    let csv = site.path("data.csv");
    let csv = csv.to_str().unwrap();
    // Once through the buffer: a gather that goes round and round counts by the servo report, and needs it. The report has
    // its period, too.
    let gather = ["gather", "--once", "--source", "X:$0000", "--period", "10", "--seconds", "4", "-o", csv];
    let ran = std::thread::scope(|scope| {
        let gather = scope.spawn(|| site.run(&gather));
        wait_until("samples", || is_live(&subscriber, RegionId::Gather));
        for _ in 0..2 {
            site.ask("I48=0");
            wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
            std::thread::sleep(PAUSE);
            site.ask("I48=1");
            wait_until("live data", || is_live(&subscriber, RegionId::Servo));
        }
        // A board that stands still, and a longer pause of its report around that.
        let board = Pid::from_raw(site.simulator_pid().cast_signed());
        for silent in [false, true] {
            if silent {
                site.control("fault servo_silent on");
                std::thread::sleep(PAUSE);
            }
            kill(board, Signal::SIGSTOP).unwrap();
            wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
            std::thread::sleep(PAUSE);
            kill(board, Signal::SIGCONT).unwrap();
            site.control("fault servo_silent off");
            wait_until("live data", || is_live(&subscriber, RegionId::Servo));
        }
        gather.join().unwrap()
    });
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.stdout.starts_with("samples=90") && ran.stdout.contains(" lost=0 seconds=4.00"), "{ran:?}");
    assert_no_reset(&site);
    site.assert_no_violations();
}

#[test]
fn a_rotary_stream_goes_on_while_the_servo_report_pauses() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    wait_until("a board that takes commands", || site.pmacctl(&["send", "&1 #1->X"]).0 == 0);
    let path = site.path("run.pmc");
    let text: String = (0..300).map(|step| format!("X{}\n", step % 2)).collect();
    std::fs::write(&path, format!("LINEAR ABS TM10 TA5 TS0\n{text}")).unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_pmacctl"))
        .args(["--name", &site.name])
        .arg("--socket")
        .arg(site.socket())
        .args(["rotary", "stream", path.to_str().unwrap(), "--define", "60", "--size", "40", "--run"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut connection = site.connection();
    wait_until("a full buffer", || connection.rotary_state(1).is_ok_and(|state| state.busy));
    site.control("fault servo_silent on");
    wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
    std::thread::sleep(PAUSE);
    site.control("fault servo_silent off");
    wait_until("live data", || is_live(&subscriber, RegionId::Servo));
    let before = connection.rotary_state(1).unwrap();
    assert!(before.sent_lines < 301, "the pause was in mid-contour");
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("lines=301 "), "{stderr}");
    assert_no_reset(&site);
    site.assert_no_violations();
}

#[test]
fn background_data_are_no_older_than_they_say() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    wait_until("background data", || is_live(&subscriber, RegionId::Background));
    let mut sample = Sample::new();
    for pause in [100, 1500, 2000] {
        site.signal_daemon(Signal::SIGSTOP);
        std::thread::sleep(Duration::from_millis(pause));
        let timer = site.status()["servo_timer"].as_u64().unwrap() as u16;
        let since = monotonic_ns();
        site.signal_daemon(Signal::SIGCONT);
        let mut seen = 0;
        let mut last = 0;
        wait_until("reports made since", || {
            let sequence = subscriber.latest(RegionId::Background, &mut sample).unwrap().unwrap();
            if sequence != last && sample.stamp().time_ns >= since {
                // Its timer says when it was made.
                let later = (sample.stamp().servo_timer as u16).wrapping_sub(timer).cast_signed();
                assert!(later >= 0, "made {} servo cycles before the time it bears", -later);
                (seen, last) = (seen + 1, sequence);
            }
            seen == 5
        });
    }
    site.assert_no_violations();
}
