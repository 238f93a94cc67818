//! The command socket's jobs: panel requests with their guard and their leases, words of the user area.

use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::bench::Bench;
use crate::support::raw::{Raw, error_name};
use crate::support::wait_until;

/// The board in the bench answers I2 with 1 until it has been sent I2=3.
fn panel_enabled(bench: &Bench) -> Raw {
    let mut client = Raw::new(bench);
    client.call("Send", json!({"line": "I2=3"}));
    client.receive().unwrap();
    client
}

#[test]
fn a_method_that_returns_nothing_answers_with_no_parameters() {
    let bench = Bench::new();
    let mut client = panel_enabled(&bench);
    let calls = [
        ("PanelHold", json!({"action": "jog+", "numbers": [1]})),
        ("PanelRenew", json!({})),
        ("Panel", json!({"action": "jog-stop", "numbers": [1]})),
        ("Write", json!({"host_offset": 0x3000, "words": [1]})),
    ];
    for (method, parameters) in calls {
        client.call(method, parameters);
        assert_eq!(client.receive(), Some(json!({"parameters": {}})), "{method}");
    }
}

fn stops(bench: &Bench) -> usize {
    let of_motors_1_and_3 = "EndHold(Motors(5))";
    bench.seen().iter().filter(|job| *job == of_motors_1_and_3).count()
}

fn wait_for_stop(bench: &Bench) {
    wait_until("the jog's stop", || stops(bench) > 0);
}

#[test]
fn a_panel_request_asks_first_whether_the_panel_is_enabled() {
    let bench = Bench::new();
    let mut client = Raw::new(&bench);
    client.call("Panel", json!({"action": "jog+", "numbers": [1]}));
    let reply = client.receive().unwrap();
    assert_eq!(error_name(&reply), "Refused");
    let reason = reply["parameters"]["reason"].as_str().unwrap();
    assert!(reason.contains("I2 is 1") && reason.contains("send I2=3 first"), "{reason}");
    assert_eq!(bench.seen(), ["I2"], "nothing reached the panel");
    let mut client = panel_enabled(&bench);
    client.call("Panel", json!({"action": "jog+", "numbers": [1, 3]}));
    assert_eq!(client.receive().unwrap().get("error"), None);
    assert_eq!(bench.seen().last().unwrap(), r#"Panel({1: "0x0200", 3: "0x0200"})"#);
    for (action, numbers, error) in [
        ("jog+", json!([9]), "InvalidParameter"),
        ("jog+", json!([]), "InvalidParameter"),
        ("fly", json!([1]), "InvalidParameter"),
    ] {
        client.call("Panel", json!({"action": action, "numbers": numbers}));
        assert_eq!(error_name(&client.receive().unwrap()), error);
    }
    client.call("PanelHold", json!({"action": "home", "numbers": [1]}));
    assert_eq!(error_name(&client.receive().unwrap()), "InvalidParameter", "only jogs can be held");
}

#[test]
fn a_held_jog_stops_when_its_holder_is_gone() {
    let bench = Bench::new();
    let mut client = panel_enabled(&bench);
    client.call("PanelHold", json!({"action": "jog+", "numbers": [1, 3]}));
    client.receive().unwrap();
    drop(client);
    wait_for_stop(&bench);
    assert_eq!(stops(&bench), 1);
}

#[test]
fn the_end_does_not_wait_for_a_holder_who_says_nothing() {
    let mut bench = Bench::new();
    let mut client = panel_enabled(&bench);
    client.call("PanelHold", json!({"action": "jog+", "numbers": [1, 3]}));
    client.receive().unwrap();
    let (ended, end) = mpsc::channel::<()>();
    let holder = thread::spawn(move || {
        // Nothing else happens meanwhile that could wake the server.
        let _ = end.recv_timeout(Duration::from_secs(10));
        drop(client);
    });
    let asked = Instant::now();
    bench.stop_server();
    let took = asked.elapsed();
    drop(ended);
    holder.join().unwrap();
    assert!(took < Duration::from_secs(8), "{took:?}");
    assert_eq!(stops(&bench), 1);
}

/// A client on whose bench the board is slow to tell the address, and who has asked for the search of `motor`'s home.
fn homes_slowly(bench: &Bench, motor: u8) -> Raw {
    let mut client = Raw::new(bench);
    client.call("Send", json!({"line": "SLOW"}));
    client.receive().unwrap();
    client.call("Panel", json!({"action": "home", "numbers": [motor], "by_line": true}));
    bench.wait_seen("#");
    client
}

fn asks(bench: &Bench) -> usize {
    bench.seen().iter().filter(|line| *line == "#").count()
}

#[test]
fn no_order_begins_behind_a_stop_that_came_while_the_board_told_the_address() {
    for stop in ["#3K", "&1A", "&1H"] {
        let bench = Bench::new();
        let mut client = homes_slowly(&bench, 1);
        let mut other = Raw::new(&bench);
        other.call("Send", json!({"line": stop}));
        assert_eq!(other.receive().unwrap().get("error"), None);
        other.call("SendControl", json!({"character": "^G"}));
        other.receive().unwrap();
        let told = client.receive().unwrap();
        let reason = told["parameters"]["reason"].as_str().unwrap_or_default();
        assert!(
            error_name(&told) == "Refused" && reason.contains("has stopped a motion meanwhile"),
            "{told}"
        );
        assert!(!bench.seen().iter().any(|line| line.contains("HM")), "{stop}: {:?}", bench.seen());
    }
}

#[test]
fn an_order_asks_again_if_another_line_has_changed_the_address() {
    let bench = Bench::new();
    let mut client = homes_slowly(&bench, 1);
    let mut other = Raw::new(&bench);
    for line in ["#3P", "P1"] {
        other.call("Send", json!({ "line": line }));
        other.receive().unwrap();
    }
    for asked in [2, 2] {
        other.call("SendControl", json!({"character": "^G"}));
        other.receive().unwrap();
        wait_until("the question", || asks(&bench) == asked);
    }
    assert_eq!(client.receive(), Some(json!({"parameters": {}})));
    assert_eq!(bench.seen().last().unwrap(), "#1HM#5");
    assert_eq!(asks(&bench), 2);
}

#[test]
fn a_refused_order_leaves_the_address_as_it_was() {
    let bench = Bench::new();
    let mut client = homes_slowly(&bench, 2);
    let mut other = Raw::new(&bench);
    other.call("SendControl", json!({"character": "^G"}));
    other.receive().unwrap();
    assert_eq!(error_name(&client.receive().unwrap()), "BoardError");
    assert_eq!(bench.seen().last().unwrap(), "#5");
    client.call("Panel", json!({"action": "home", "numbers": [1, 3], "by_line": true}));
    assert_eq!(error_name(&client.receive().unwrap()), "InvalidParameter", "one at a time");
}

#[test]
fn words_to_write_are_checked_before_they_reach_the_bus_thread() {
    let bench = Bench::new();
    let mut client = Raw::new(&bench);
    let mut write = |parameters: Value| {
        client.call("Write", parameters);
        let reply = client.receive().unwrap();
        error_name(&reply).to_owned()
    };
    // Whose the words are is for the bus thread to say, which knows where the buffers lie.
    assert_eq!(write(json!({"host_offset": 0x24, "words": [1], "anywhere": true})), "");
    assert_eq!(write(json!({"host_offset": 0x2000, "words": [1, 2], "masks": [65535, 255]})), "");
    assert_eq!(write(json!({"host_offset": 0x3FFE, "words": [1, 2]})), "OutOfRange");
    assert_eq!(write(json!({"host_offset": 0x2000, "words": []})), "InvalidParameter");
    assert_eq!(write(json!({"host_offset": 0x2001, "words": [1]})), "InvalidParameter");
    assert_eq!(write(json!({"host_offset": 0x2000, "words": [65536]})), "InvalidParameter");
    assert_eq!(write(json!({"host_offset": 0x2000, "words": [1], "masks": []})), "InvalidParameter");
    assert_eq!(bench.seen().len(), 2);
}
