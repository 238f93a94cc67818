//! The board or its servo report pauses and goes on: nothing that is under way ends for it, and nobody takes it for a reset.

use std::process::{Child, Stdio};
use std::time::Duration;

use pmac_dpram::segment::{Counter, RegionId};

use crate::support::{PATIENCE, VirtualSite, counter, is_live, output_within};

const PAUSE: Duration = Duration::from_millis(300);

fn start(site: &VirtualSite, arguments: &[&str]) -> Child {
    site.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Has `pause` end the servo data, lets time pass, and has `go_on` bring them back.
fn pause(site: &VirtualSite, pause: impl FnOnce(), go_on: impl FnOnce()) {
    let subscriber = site.attach();
    pause();
    site.wait_until("stale data", || !is_live(&subscriber, RegionId::Servo));
    site.run_for(PAUSE);
    go_on();
    site.wait_until("live data", || is_live(&subscriber, RegionId::Servo));
}

fn assert_no_reset(site: &VirtualSite) {
    assert_eq!(counter(&site.attach(), Counter::Resets), 0);
    assert!(!site.log().contains("was reset"), "{}", site.log());
    site.assert_no_violations();
}

#[test]
fn a_gather_goes_on_while_the_servo_report_pauses() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    let csv = site.path("data.csv");
    // Once through the buffer: a gather that goes round and round counts by the servo report, and needs it. The report has
    // its period, too.
    let gather = ["gather", "--once", "--source", "X:$0000", "--period", "10", "--seconds", "4", "-o"];
    let mut gather = start(&site, &[&gather, &[csv.to_str().unwrap()][..]].concat());
    site.wait_until("samples", || is_live(&subscriber, RegionId::Gather));
    for _ in 0..2 {
        pause(&site, || drop(site.ask("I48=0")), || drop(site.ask("I48=1")));
    }
    // A board that stands still, and a longer pause of its report around that.
    for silent in [false, true] {
        if silent {
            site.control("fault servo_silent on");
            site.run_for(PAUSE);
        }
        pause(
            &site,
            || site.board_stands_still(true),
            || {
                site.board_stands_still(false);
                site.control("fault servo_silent off");
            },
        );
    }
    let output = site.hurried(|| output_within(&mut gather, PATIENCE));
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(said.starts_with("samples=90") && said.contains(" lost=0 seconds=4.00"), "{said}");
    assert_no_reset(&site);
}

#[test]
fn a_rotary_stream_goes_on_while_the_servo_report_pauses() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.ask("&1 #1->X");
    let text: String = (0..300).map(|step| format!("X{}\n", step % 2)).collect();
    let path = site.file("run.pmc", &format!("LINEAR ABS TM10 TA5 TS0\n{text}"));
    let mut stream = start(&site, &["rotary", "stream", &path, "--define", "60", "--size", "40", "--run"]);
    let mut connection = site.connection();
    site.wait_until("a full buffer", || connection.rotary_state(1).is_ok_and(|state| state.busy));
    pause(
        &site,
        || drop(site.control("fault servo_silent on")),
        || drop(site.control("fault servo_silent off")),
    );
    let before = connection.rotary_state(1).unwrap();
    assert!(before.sent_lines < 301, "the pause was in mid-contour");
    let output = output_within(&mut stream, PATIENCE);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("lines=301 "), "{output:?}");
    assert_no_reset(&site);
}

#[test]
fn a_board_that_stood_still_together_with_the_daemon_made_no_updates_meanwhile() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let subscriber = site.attach();
    // Long enough to know the length of a servo cycle, and behind each stop, to know it again.
    let goes_on = || site.run_for(Duration::from_secs(1));
    goes_on();
    // Half a turn of the timer is 7.3 s.
    for seconds in [5, 8, 20, 300] {
        let before = subscriber.counter(Counter::Missed);
        site.daemon_stands_still(true);
        site.board_stands_still(true);
        site.run_for(Duration::from_secs(seconds));
        site.board_stands_still(false);
        site.daemon_stands_still(false);
        goes_on();
        let missed = subscriber.counter(Counter::Missed) - before;
        assert!(missed < 1000, "{seconds} s: {missed}");
    }
    // What the daemon alone slept through, the board made: the length of a cycle is known as before.
    let before = subscriber.counter(Counter::Missed);
    site.daemon_stands_still(true);
    site.step(10_000);
    site.daemon_stands_still(false);
    goes_on();
    let missed = subscriber.counter(Counter::Missed) - before;
    assert!((9_990..11_000).contains(&missed), "{missed}");
    assert_no_reset(&site);
}
