//! Jogs by command line that end with the connection they came by.

use std::time::Duration;

use pmac_dpram::client::HeldJog;
use pmac_dpram::client::command::SendAs;

use crate::support::jogs::{ask, until};
use crate::support::{PATIENCE, VirtualSite};

fn running() -> VirtualSite {
    let site = VirtualSite::configured(&[], "");
    site.wait_for_live_servo();
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    site
}

#[test]
fn a_jog_by_line_ends_with_its_connection_where_that_was_asked_for() {
    let site = running();
    let mut board = site.connection();
    for enable in ["I2=3", "I2=0"] {
        board.send(enable, PATIENCE).unwrap();
        let mut other = site.connection();
        other.send_while_connected("#1J+#2J-", PATIENCE).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        // A command of another one's takes the motor over.
        board.send("#2J+", PATIENCE).unwrap();
        drop(other);
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
        assert!(ask(&mut board, "#2V") > 1.0);
        board.send("#2J/", PATIENCE).unwrap();
        // The stop has been seen to work.
        site.run_for(Duration::from_millis(200));
    }
    let told = site.connection().send_while_connected("J+", PATIENCE).unwrap_err().to_string();
    assert!(told.contains("does not say which motor"), "{told}");
    // A jog that is refused has not begun: what moves the motor then is left alone.
    board.send("&1 #1->X", PATIENCE).unwrap();
    for line in ["OPEN PROG 5 CLEAR", "LINEAR INC F5000 X1000000", "CLOSE", "&1B5R"] {
        board.send(line, PATIENCE).unwrap();
    }
    until(&mut board, "#1V", "the program moves it", |speed| speed > 0.0);
    let mut other = site.connection();
    other.send_while_connected("#1J+", PATIENCE).unwrap_err();
    drop(other);
    site.run_for(Duration::from_secs(2));
    assert!(ask(&mut board, "#1V") > 0.0);
    assert!(!site.log().contains("sends ^A"), "{}", site.log());
    site.assert_no_violations();
}

#[test]
fn of_a_refused_line_every_jog_ends_with_its_connection_whatever_stands_behind_it() {
    let site = running();
    let mut board = site.connection();
    for line in ["#1J+K5", "#1J-O200", "#1J+#99J/", "#1J-#99K"] {
        let mut other = site.connection();
        other.send_while_connected(line, PATIENCE).unwrap_err();
        until(&mut board, "#1V", line, |speed| speed.abs() > 1.0);
        drop(other);
        until(&mut board, "#1V", line, |speed| speed.abs() < 0.1);
        site.run_for(Duration::from_millis(200));
    }
    let told = site.connection().send_while_connected("J+K5", PATIENCE).unwrap_err().to_string();
    assert!(told.contains("does not say which motor"), "{told}");
    site.assert_no_violations();
}

#[test]
fn a_jog_by_line_ends_with_the_silence_of_its_client_where_that_was_asked_for() {
    let site = running();
    let mut board = site.connection();
    let mut client = site.connection();
    let send_as = SendAs { while_connected: Some(true), silence_ms: Some(1000), ..SendAs::default() };
    client.send_as("#1J+", PATIENCE, send_as).unwrap();
    until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
    for _ in 0..3 {
        assert_eq!(client.jog_renew().unwrap(), [1]);
        site.run_for(Duration::from_millis(900));
    }
    client.send("P1", PATIENCE).unwrap();
    site.run_for(Duration::from_millis(900));
    assert!(ask(&mut board, "#1V") > 1.0, "any call says that he is there");
    site.run_for(Duration::from_millis(1500));
    assert!(ask(&mut board, "#1V").abs() < 0.1);
    assert!(site.log().contains("motor 1 jogged by command line: who had asked for it is gone or silent"));
    assert!(client.jog_renew().unwrap().is_empty(), "nothing goes on");
    site.assert_no_violations();
}

#[test]
fn who_jogs_a_motor_that_was_just_stopped_for_another_is_left_alone() {
    let site = running();
    let mut board = site.connection();
    board.send("I2=0", PATIENCE).unwrap();
    for pause in [0, 10, 20, 30] {
        let mut other = site.connection();
        other.send_while_connected("#1J+", PATIENCE).unwrap();
        until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
        drop(other);
        until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.5);
        site.run_for(Duration::from_millis(pause));
        board.send("#1J+", PATIENCE).unwrap();
        site.run_for(Duration::from_secs(2));
        assert!(ask(&mut board, "#1V") > 1.0, "after {pause} ms");
        board.send("#1J/", PATIENCE).unwrap();
        site.run_for(Duration::from_millis(500));
    }
    assert!(!site.log().contains("sends ^A"), "{}", site.log());
    site.assert_no_violations();
}

/// As by the panel: nobody may hold one motor, and take it for two.
#[test]
fn a_hold_of_two_motors_by_line_ends_when_another_stops_one_of_them() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    let mut board = site.connection();
    let held = HeldJog::begin(site.connection(), "jog+", &[1, 2]).unwrap();
    until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
    board.panel("jog-stop", &[2]).unwrap();
    for line in ["#1V", "#2V"] {
        until(&mut board, line, "it stands", |speed| speed.abs() < 0.1);
    }
    site.wait_until("a hold that is over", || !held.is_held());
    let told = held.stop().unwrap_err().to_string();
    assert!(
        told.contains("obeys another command") && site.log().contains("motor 1 jogged by command line"),
        "{told}"
    );
    site.assert_no_violations();
}
