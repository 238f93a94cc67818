//! Another host on the board's serial port, as a PEWIN is: what it changes is found, said, and not acted on as if nothing had happened.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use pmac_dpram::client::Board;
use pmac_dpram::map::PmacRegister;
use serde_json::Value;

use crate::support::{PATIENCE, VirtualSite};

/// A board in use, known to its daemon, and another host's serial line to it.
fn running() -> (VirtualSite, UnixStream) {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("the board's scales", || site.has_scales());
    let serial = UnixStream::connect(site.path("serial")).unwrap();
    (site, serial)
}

/// Has the other host send a line, and the board take it.
fn send(site: &VirtualSite, serial: &mut UnixStream, line: &str) {
    serial.write_all(format!("{line}\r").as_bytes()).unwrap();
    site.run_for(Duration::from_millis(50));
}

/// What `status` says of others.
fn elsewhere(site: &VirtualSite) -> Vec<Value> {
    let ran = site.run(&["status", "--json"]);
    ran.json()["socket"]["elsewhere"].as_array().unwrap().clone()
}

/// Longer than the daemon takes to ask again.
const RECHECK: Duration = Duration::from_secs(32);

#[test]
fn status_says_what_another_host_has_changed() {
    let (site, mut serial) = running();
    assert_eq!(elsewhere(&site), [Value::Null; 0]);
    send(&site, &mut serial, "I2=1 I55=0 I108=48");
    site.run_for(RECHECK);
    let found = elsewhere(&site);
    let of = |what: &str| {
        found.iter().find(|change| change["what"] == what).unwrap_or_else(|| panic!("{found:?}"))
    };
    assert_eq!((&of("I2")["was"], &of("I2")["is"]), (&3.into(), &1.into()));
    assert_eq!((&of("I55")["was"], &of("I55")["is"]), (&1.into(), &0.into()));
    let text = of("I2")["text"].as_str().unwrap();
    assert!(text.starts_with("I2 is 1, was 3: changed since ") && text.contains("by another host"), "{text}");
    assert!(site.run(&["status"]).stdout.contains(text.split(" since").next().unwrap()));
    // A position by the old scale would be wrong.
    assert_eq!(Board::attach(&site.name).unwrap().identity().unwrap().ix08[0], Some(48));
    // Whoever sets it through the daemon knows it.
    site.ask("I2=3");
    assert!(!elsewhere(&site).iter().any(|change| change["what"] == "I2"));
    site.run_for(RECHECK);
    assert!(!elsewhere(&site).iter().any(|change| change["what"] == "I2"), "{:?}", elsewhere(&site));
    site.assert_no_violations();
}

#[test]
fn a_reset_is_no_change_by_another_host() {
    let (site, _serial) = running();
    site.ask("I2=1");
    site.run_for(RECHECK);
    site.control("reset");
    site.wait_until("a board that takes commands", || site.run(&["send", "I58"]).code == Some(0));
    site.run_for(RECHECK);
    assert_eq!(elsewhere(&site), [Value::Null; 0]);
}

#[test]
fn what_is_believed_is_asked_again_before_it_is_acted_on() {
    let (site, mut serial) = running();
    site.run_for(Duration::from_secs(2));
    send(&site, &mut serial, "I55=0");
    let register: PmacRegister = "X:$0028".parse().unwrap();
    let refused = site.connection().watch_variables(&[register.into()]).unwrap_err().to_string();
    assert!(refused.contains("I55 is 0") && refused.contains("send I55=1 first"), "{refused}");
    // The panel shows by itself that it takes nothing; then the reason is asked for.
    send(&site, &mut serial, "I2=1");
    let refused = site.connection().panel("jog+", &[1]).unwrap_err().to_string();
    assert!(refused.contains("did not take the panel request") && refused.contains("I2 is 1"), "{refused}");
    site.assert_no_violations();
}

#[test]
fn status_says_that_another_host_has_a_buffer_open_gathers_or_has_switched_lines_off() {
    let (site, mut serial) = running();
    let has = |what: &str| elsewhere(&site).iter().any(|change| change["what"] == what);
    send(&site, &mut serial, "OPEN PROG 7 CLEAR");
    assert!(has("program_buffer"));
    send(&site, &mut serial, "CLOSE");
    assert!(!has("program_buffer"));
    site.ask("OPEN PROG 7 CLEAR");
    assert!(!has("program_buffer"), "that was somebody here");
    site.ask("CLOSE");
    send(&site, &mut serial, "I20=1 I21=$80002B I45=3 DEFINE GATHER 100");
    send(&site, &mut serial, "GATHER");
    assert!(has("gather"));
    send(&site, &mut serial, "ENDGATHER");
    assert!(!has("gather"));
    send(&site, &mut serial, "I58=0");
    site.run_for(RECHECK + Duration::from_secs(5));
    let ran = site.run(&["status"]);
    assert!(ran.stdout.contains("no command line has been answered since"), "{ran:?}");
    send(&site, &mut serial, "I58=1");
    assert!(site.connection().send("P1", PATIENCE).is_ok());
    assert!(!has("command_lines"));
}
