//! A board whose memory holds anything at power-on.

use std::time::Duration;

use pmac_dpram::map::HostOffset;

use crate::support::{PATIENCE, VirtualSite};

#[test]
fn the_masks_of_the_panel_are_cleared_before_the_panel_is_enabled() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    assert_eq!(site.pmacctl(&["send", "I2=0"]).0, 0);
    // As power-on may leave them: a request and a feed rate for everybody.
    for mask in [0x0000, 0x0002] {
        site.connection().write(HostOffset::new(mask), &[(0x7F7F, 0xFFFF)], true).unwrap();
    }
    let (status, _, stderr) = site.pmacctl(&["setup", "--send", "--yes", "enable", "panel"]);
    assert_eq!(status, 0, "{stderr}");
    assert_eq!([site.word("0x0000"), site.word("0x0002")], [0, 0]);
}

#[test]
fn a_board_full_of_garbage_comes_up() {
    for seed in ["1", "2", "3"] {
        let site = VirtualSite::running(&["--garbage", seed], &[]);
        site.wait_for_identity();
        site.wait_for_live_servo();
        site.assert_no_violations();
    }
}

#[test]
fn functions_that_are_saved_as_enabled_do_no_harm_once_the_daemon_runs() {
    let site = VirtualSite::running(&["--garbage", "4", "--saved-enables"], &[]);
    site.wait_for_identity();
    site.wait_for_live_servo();
    assert_eq!([site.word("0x0000"), site.word("0x0002")], [0, 0], "the masks of the panel");
    assert_eq!(site.word("0x07D4"), 0, "the records to write");
}

#[test]
fn a_simulator_powers_up_with_anything_in_its_memory_unless_told_otherwise() {
    for (options, clean) in [(&[][..], false), (&["--garbage", "off"], true)] {
        let site = VirtualSite::new();
        site.start_simulator(options);
        let memory = std::fs::read(site.path("dpram")).unwrap();
        assert_eq!(memory[0x0800..].iter().all(|&byte| byte == 0), clean, "{options:?}");
    }
}

#[test]
fn save_and_a_reset_take_their_time_and_the_port_is_gone_meanwhile() {
    for slow in ["1", "3"] {
        let site = VirtualSite::running(&["--slow", slow], &[]);
        site.wait_for_identity();
        // Over a connection that stands: time passes while a program starts.
        let mut connection = site.connection();
        let mut seconds = |line: &str| {
            let begun = site.with_world(|world| world.now());
            connection.send(line, PATIENCE).unwrap();
            (site.with_world(|world| world.now()) - begun).as_secs_f64()
        };
        let least = 2.0 * slow.parse::<f64>().unwrap();
        assert!((least..least + 0.5).contains(&seconds("SAVE")));
        assert!(seconds("P1=5") < 0.5, "the next line is not late");
        assert!((0.02..0.5).contains(&seconds("&1DEFINE ROT 100")));
        // A reset answers nothing; what comes after it waits for the board.
        site.pmacctl(&["send", "$$$"]);
        let begun = site.with_world(|world| world.now());
        site.wait_until("a board that answers", || site.pmacctl(&["send", "I58"]).1 == "1\n");
        let took = (site.with_world(|world| world.now()) - begun).as_secs_f64();
        assert!(took < least + 12.0, "{took}");
        site.assert_no_violations();
    }
}

/// It is asked for few at a time, so that callers' lines go between.
#[test]
fn a_board_that_takes_its_time_for_every_line_of_a_reply_refuses_no_line() {
    let config = "family = \"turbo2\"\nask_m_variables = true\n";
    let site = VirtualSite::configured(&["--family", "turbo2"], config);
    site.wait_until("the board's scales", || site.has_scales());
    let definitions = || site.connection().info().unwrap().lines.definitions;
    site.wait_until("the definitions", || definitions().read == definitions().of);
    site.control("fault ascii_slow_lines 60ms");
    let mut connection = site.connection();
    // From the first telling reply on it is known to be slow.
    assert_eq!(connection.send("P1 P2 P3 P4", PATIENCE).unwrap().len(), 4);
    // In the second half the daemon asks for all definitions anew. Each line comes at another time of the second.
    for round in 0..20 {
        if round == 10 {
            connection.send("M8191->*", PATIENCE).unwrap();
        }
        let answer = connection.send("P1", Duration::from_secs(1));
        assert!(answer.is_ok(), "{round}: {answer:?}: {}", site.log());
        site.run_for(Duration::from_millis(990));
    }
    site.assert_no_violations();
}

#[test]
fn a_turbo_board_full_of_garbage_comes_up() {
    for options in [&["--garbage", "1"][..], &["--garbage", "2", "--saved-enables"], &["--slow", "3"]] {
        let options = [&["--family", "turbo2"], options].concat();
        let site = VirtualSite::configured(&options, "family = \"turbo2\"\n");
        site.wait_until("the board to be identified", || site.log().contains("the board is TURBO2"));
        site.wait_until("an answer", || site.pmacctl(&["send", "TYPE"]).1 == "TURBO2, X4\n");
        let mut connection = site.connection();
        let begun = site.with_world(|world| world.now());
        connection.send("SAVE", PATIENCE).unwrap();
        let took = (site.with_world(|world| world.now()) - begun).as_secs_f64();
        let least = if options.contains(&"--slow") { 6.0 } else { 2.0 };
        assert!((least..least + 0.5).contains(&took), "{options:?}: {took}");
        site.assert_no_violations();
    }
}
