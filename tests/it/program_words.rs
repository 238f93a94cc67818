//! C3: a site's own data in the DPRAM. The daemon asks where the board's M-variables point, and leaves alone what they use.

use std::time::Duration;

use serde_json::Value;

use crate::support::VirtualSite;

/// Every function; the daemon asks for the M-variables.
const ASKS: &str = "ask_m_variables = true\n";

/// A simulated board of `family` on which `lines` were sent, and a daemon with `config` started after that.
fn site(family: &str, lines: &[&str], config: &str) -> VirtualSite {
    let site = VirtualSite::new();
    site.start_simulator(&["--dpram-startup", "--family", family]);
    let first = site.file("first.toml", &format!("family = \"{family}\"\nfunctions = [\"ascii\"]\n"));
    site.start_daemon(&["--config", &first]);
    for line in lines {
        let (code, _, error) = site.hurried(|| site.pmacctl(&["send", "--yes", line]));
        assert_eq!(code, 0, "{line}: {error}");
    }
    site.stop_daemon();
    let second = site.file("second.toml", &format!("family = \"{family}\"\n{config}"));
    site.start_daemon(&["--config", &second]);
    site
}

/// What `pmacctl status` tells.
fn told(site: &VirtualSite) -> Value {
    let (_, text, error) = site.pmacctl(&["status", "--json"]);
    serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text}{error}"))
}

fn socket_of(site: &VirtualSite) -> Value {
    told(site)["socket"].clone()
}

/// Waits until the daemon knows where the M-variables point.
fn wait_until_known(site: &VirtualSite) {
    site.wait_until("known M-variables", || socket_of(site)["waiting"].as_array().is_some_and(Vec::is_empty));
}

/// The functions that are held, each with what is told of it.
fn held(site: &VirtualSite) -> Vec<(String, String)> {
    let all = socket_of(site)["program_words"].clone();
    let held = all.as_array().unwrap().iter().filter(|words| words["used"] == false);
    held.map(|words| {
        (words["function"].as_str().unwrap().to_owned(), words["text"].as_str().unwrap().to_owned())
    })
    .collect()
}

#[test]
fn a_function_into_whose_words_a_program_points_is_not_used() {
    for (family, definitions, place) in [
        // As sites on Turbo boards have it: status words in the motor report (ls-cat-org/pgpmac), a buffer where one gathers.
        ("turbo2", ["M211->DP:$60080", "M500->F:$60450"], "Y:$060080"),
        ("pmac", ["M211->DP:$D012", "M500->F:$D200"], "Y:$D012"),
    ] {
        let site = site(family, &["I48=0", definitions[0], definitions[1], "M211=305419896"], ASKS);
        wait_until_known(&site);
        let held = held(&site);
        let names: Vec<_> = held.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["servo", "gather"], "{family}: {held:?}");
        assert!(held[0].1.contains(&format!("M211 points to {place}")), "{held:?}");
        // What the site keeps there stays, whatever else goes on.
        site.run_for(Duration::from_secs(2));
        let (_, value, _) = site.hurried(|| site.pmacctl(&["send", "M211"]));
        assert_eq!(value.trim(), "305419896");
        // Whoever calls for it is told why, and what to do. Everything else works.
        let refused = site.hurried(|| {
            site.pmacctl(&["gather", "--source", "1.actual_position", "--seconds", "0.1", "-o", "-"])
        });
        assert_eq!(refused.0, 1, "{refused:?}");
        assert!(refused.2.contains("M500 points to"), "{refused:?}");
        assert!(refused.2.contains("shared_functions = [\"gather\"]"), "{refused:?}");
        let (code, text, error) = site.hurried(|| site.pmacctl(&["status"]));
        assert!(text.contains("programs' words") && text.contains("M211"), "{code} {text}{error}");
        let (_, text, _) = site.hurried(|| site.pmacctl(&["doctor"]));
        assert!(text.contains("is not used: M211 points to"), "{text}");
        assert!(!text.contains("GATHER"), "no other cause is told: {text}");
        assert!(site.log().contains("the function `servo` is not used: M211 points to"), "{}", site.log());
        site.assert_no_violations();
    }
}

/// The word of the board's memory at `offset`, as it is.
fn word(site: &VirtualSite, offset: usize) -> u16 {
    let bytes = std::fs::read(site.path("dpram")).unwrap();
    u16::from_le_bytes([bytes[offset], bytes[offset + 1]])
}

/// Turbo's mask of motors and its number of coordinate systems.
const CHOSEN: [usize; 3] = [0x70, 0x72, 0x674];

/// A Turbo board whose programs keep data where the host says what is reported. No report is on.
fn site_with_data_in_the_hosts_words() -> VirtualSite {
    let lines = ["I48=0 I49=0", "M10->DP:$6001C", "M8100->Y:$06019D,0,16", "M10=305419896", "M8100=4321"];
    let site = site("turbo2", &lines, "functions = [\"ascii\"]\n");
    site.stop_daemon();
    site
}

fn start_asking(site: &VirtualSite) {
    let config = site.file("asks.toml", &format!("family = \"turbo2\"\n{ASKS}"));
    site.start_daemon(&["--config", &config]);
}

fn assert_theirs(site: &VirtualSite, when: &str) {
    assert_eq!(CHOSEN.map(|offset| word(site, offset)), [0x5678, 0x1234, 4321], "{when}");
}

/// With I9 odd the board repeats the question before each definition (Software Reference p. 253).
#[test]
fn definitions_in_the_long_form_are_understood() {
    for (family, definition) in [("turbo2", "M211->DP:$60080"), ("pmac", "M211->DP:$D012")] {
        for i9 in ["I9=1", "I9=3"] {
            let site = site(family, &["I48=0", definition, i9], ASKS);
            wait_until_known(&site);
            let held = held(&site);
            let names: Vec<_> = held.iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, ["servo"], "{family} {i9}: {held:?}");
            assert!(!site.log().contains("no definition"), "{}", site.log());
            let (_, text, error) = site.hurried(|| site.pmacctl(&["doctor", "--memory"]));
            let stretch = text.lines().find(|line| line.contains("servo from")).unwrap_or(&error);
            assert!(stretch.contains(definition), "{text}{error}");
        }
    }
}

#[test]
fn a_board_that_is_slow_or_silent_for_a_while_keeps_its_words() {
    for fault in ["ascii_slow 700ms", "ascii_slow 900ms", "ascii_no_reply on"] {
        let site = site_with_data_in_the_hosts_words();
        site.control(&format!("fault {fault}"));
        start_asking(&site);
        for second in 1..8 {
            site.run_for(Duration::from_secs(1));
            assert_theirs(&site, &format!("{fault}, after {second} s"));
        }
        site.control(&format!("fault {} off", fault.split_once(' ').unwrap().0));
        wait_until_known(&site);
        let names: Vec<_> = held(&site).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["servo", "background"], "{fault}");
        assert_theirs(&site, fault);
        assert!(!site.log().contains("does not tell"), "{fault}: {}", site.log());
        site.assert_no_violations();
    }
}

#[test]
fn how_far_a_slow_board_has_told_its_definitions_is_told() {
    let site = VirtualSite::new();
    site.start_simulator(&["--family", "turbo2"]);
    site.control("fault ascii_slow 400ms");
    let config = format!("family = \"turbo2\"\n{ASKS}shared_functions = [\"rotary\"]\n");
    let config = site.file("slow.toml", &config);
    site.start_daemon(&["--config", &config]);
    site.control("send I58=1");
    let read = || socket_of(&site)["definitions"]["read"].as_u64().unwrap();
    site.wait_until("half of the definitions", || read() > 4000);
    let socket = socket_of(&site);
    assert_eq!(socket["definitions"]["of"], 8192, "{socket}");
    let waiting = &socket["waiting"];
    assert!(waiting.to_string().contains("gather"), "{socket}");
    assert!(!waiting.to_string().contains("rotary"), "it does not wait: {socket}");
    let left = socket["definitions"]["seconds_left"].as_u64().unwrap();
    assert!(
        (30..150).contains(&left),
        "165 questions of half a second to a second, half of them asked: {socket}"
    );
    for command in ["status", "doctor"] {
        let (_, text, error) = site.pmacctl(&[command]);
        let told = text
            .lines()
            .find(|line| line.contains("of 8192 read"))
            .unwrap_or_else(|| panic!("{text}{error}"));
        for said in ["try again in about ", "shared_functions", "ask_m_variables = false"] {
            assert!(told.contains(said), "{told}");
        }
    }
    site.control("fault ascii_slow off");
    wait_until_known(&site);
    let (_, text, _) = site.pmacctl(&["status"]);
    assert!(!text.contains("of 8192 read"), "{text}");
}

#[test]
fn words_that_turn_out_to_be_a_programs_are_put_back() {
    let site = site_with_data_in_the_hosts_words();
    site.control("fault ascii_no_reply on");
    start_asking(&site);
    wait_until_known(&site);
    assert!(site.log().contains("the board does not tell where its M-variables point"), "{}", site.log());
    site.wait_until("the host's mask", || word(&site, CHOSEN[0]) == u16::MAX);
    site.control("fault ascii_no_reply off");
    site.wait_until("held functions", || held(&site).len() == 2);
    assert_theirs(&site, "put back");
}

/// A board that reports two motors and two coordinate systems, with words of its programs where it would report others.
fn site_with_data_in_unreported_words() -> VirtualSite {
    let mask_and_count =
        ["I48=0 I49=0", "M20->DP:$6001C", "M20=3", "M20->*", "M21->Y:$6019D,0,16", "M21=2", "M21->*"];
    let data = ["M211->DP:$60080", "M211=305419896", "M8000->DP:$60300", "M8000=305419896", "I48=1 I49=1"];
    let site = site("turbo2", &[&mask_and_count[..], &data].concat(), "functions = [\"ascii\"]\n");
    site.stop_daemon();
    site
}

/// The mask, the count, and the data.
fn reported_and_kept(site: &VirtualSite) -> [u16; 7] {
    [0x70, 0x72, 0x674, 4 * 0x80, 4 * 0x80 + 2, 4 * 0x300, 4 * 0x300 + 2].map(|offset| word(site, offset))
}

#[test]
fn the_board_is_told_to_report_no_more_than_before_until_its_definitions_are_known() {
    let site = site_with_data_in_unreported_words();
    let before = reported_and_kept(&site);
    assert_eq!(before, [3, 0, 2, 0x5678, 0x1234, 0x5678, 0x1234]);
    site.control("fault ascii_slow 300ms");
    start_asking(&site);
    site.wait_for_live_servo();
    site.run_for(Duration::from_secs(3));
    assert_eq!(reported_and_kept(&site), before, "while they are asked for");
    let (_, motors, _) = site.pmacctl(&["motors"]);
    assert!(motors.contains("#2 ") && !motors.contains("#3 "), "{motors}");
    site.wait_until("the coordinate systems", || site.pmacctl(&["coordinates"]).1.contains("&2 "));
    assert_eq!(reported_and_kept(&site), before, "with the coordinate systems");
    site.control("fault ascii_slow off");
    wait_until_known(&site);
    let names: Vec<_> = held(&site).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["servo", "background"]);
    assert_eq!(reported_and_kept(&site), before, "at the end");
}

#[test]
fn what_the_board_reports_is_as_before_when_the_daemon_ends() {
    let site =
        site("turbo2", &["M20->DP:$6001C", "M20=3", "M21->Y:$6019D,0,16", "M21=2", "M20->* M21->*"], ASKS);
    let chosen = || CHOSEN.map(|offset| word(&site, offset));
    wait_until_known(&site);
    site.wait_until("all motors and coordinate systems", || chosen() == [u16::MAX, u16::MAX, 16]);
    site.stop_daemon();
    assert_eq!(chosen(), [3, 0, 2]);
}

#[test]
fn behind_a_reset_the_board_reports_what_it_says_until_its_definitions_are_known_again() {
    use std::os::unix::fs::FileExt as _;
    let site = site("turbo2", &[], ASKS);
    wait_until_known(&site);
    site.wait_until("all motors", || word(&site, CHOSEN[0]) == u16::MAX);
    // Another board in its place has another mask, and may have other definitions.
    site.control("fault ascii_slow 300ms");
    let memory = std::fs::OpenOptions::new().write(true).open(site.path("dpram")).unwrap();
    memory.write_all_at(&[3, 0, 0, 0], CHOSEN[0] as u64).unwrap();
    site.control("reset");
    site.wait_until("the reset", || socket_of(&site)["definitions"]["read"] == 0);
    site.run_for(Duration::from_secs(3));
    assert_eq!([CHOSEN[0], CHOSEN[1]].map(|offset| word(&site, offset)), [3, 0]);
    // Nothing is known of the loops of the others: a jog could close one.
    let (code, _, error) = site.pmacctl(&["jog", "5", "=1000"]);
    assert!(code == 1 && error.contains("not sent: the board does not report motor 5"), "{code} {error}");
    site.control("fault ascii_slow off");
    wait_until_known(&site);
    site.wait_until("all motors again", || word(&site, CHOSEN[0]) == u16::MAX);
}

#[test]
fn a_daemon_that_cannot_ask_the_board_says_so() {
    let warning = "the board is not asked where its M-variables point";
    for (config, is_told) in [
        ("ask_m_variables = true\nfunctions = [\"servo\"]\n", true),
        ("ask_m_variables = true\nfunctions = [\"ascii\"]\n", false),
        (ASKS, false),
    ] {
        let site = site("turbo2", &[], config);
        site.run_for(Duration::from_secs(1));
        assert_eq!(site.log().contains(warning), is_told, "{config}: {}", site.log());
    }
}

/// Who asks the board for long lists all the time neither stops the questions nor makes pmacd give them up.
#[test]
fn lines_of_others_do_not_make_the_board_one_that_does_not_tell() {
    let site = site_with_data_in_the_hosts_words();
    site.control("fault ascii_slow 200ms");
    start_asking(&site);
    for _ in 0..60 {
        let (code, _, error) = site.hurried(|| site.pmacctl(&["send", "I10 I10 I10"]));
        assert_eq!(code, 0, "{error}");
        assert_theirs(&site, "while others ask");
    }
    assert!(!site.log().contains("does not tell"), "{}", site.log());
    site.control("fault ascii_slow off");
    wait_until_known(&site);
    assert_theirs(&site, "at the end");
}

#[test]
fn the_configuration_overrules_it_by_name() {
    let config = format!("{ASKS}shared_functions = [\"servo\"]\n");
    let site = site("pmac", &["M211->DP:$D012", "M212->Y:$D000"], &config);
    wait_until_known(&site);
    site.wait_for_live_servo();
    let names: Vec<_> = held(&site).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["panel"]);
    let words = socket_of(&site)["program_words"].clone();
    let servo = words.as_array().unwrap().iter().find(|words| words["function"] == "servo").unwrap();
    assert!(servo["text"].as_str().unwrap().starts_with("the function `servo` is used although M211"));
    // Without the panel's words a stop goes as a line.
    let (code, _, error) = site.hurried(|| site.pmacctl(&["jog", "1", "stop"]));
    assert_eq!(code, 0, "{error}");
    assert!(site.log().contains("by command line"), "{}", site.log());
    let site = VirtualSite::new();
    let config = site.file("wrong.toml", "functions = [\"ascii\"]\nshared_functions = [\"servo\"]\n");
    let options = ["--board", "sim", "--config", &config].map(str::to_owned).to_vec();
    let refused = site.with_world(move |world| world.start_daemon(&options)).unwrap_err();
    assert!(refused.contains("shared_functions has \"servo\", which `functions` leaves out"), "{refused}");
}

#[test]
fn what_is_defined_later_is_found_and_what_is_taken_away_is_used_again() {
    let site = site("pmac", &[], ASKS);
    wait_until_known(&site);
    site.wait_for_live_servo();
    assert_eq!(held(&site), []);
    let send = |line: &str| {
        let (code, _, error) = site.hurried(|| site.pmacctl(&["send", line]));
        assert_eq!(code, 0, "{line}: {error}");
    };
    send("M900->X:$D014,0,16");
    site.wait_until("held servo data", || held(&site).iter().any(|(name, _)| name == "servo"));
    let regions = told(&site)["regions"].clone();
    assert_eq!(regions["servo"]["state"], "off", "{regions}");
    send("M900->*");
    site.wait_until("servo data again", || held(&site).is_empty());
    site.wait_for_live_servo();
}

#[test]
fn a_board_that_cannot_be_asked_is_used_as_before() {
    let site = site("pmac", &["M211->DP:$D012", "I58=0"], ASKS);
    site.wait_for_live_servo();
    wait_until_known(&site);
    assert!(site.log().contains("the board does not tell where its M-variables point"), "{}", site.log());
    assert_eq!(socket_of(&site)["program_words"].as_array().unwrap().len(), 0);
}

/// Somebody else may have it open for long: what he keeps in the DPRAM stays until the board can tell.
#[test]
fn no_question_enters_an_open_buffer_and_functions_wait_until_it_is_closed() {
    let site = site("pmac", &["OPEN PROG 77 CLEAR", "X1"], ASKS);
    site.wait_for_live_servo();
    site.run_for(Duration::from_secs(30));
    let waiting = socket_of(&site)["waiting"].to_string();
    assert!(waiting.contains("gather") && !site.log().contains("does not tell"), "{waiting}: {}", site.log());
    let (code, _, error) = site.hurried(|| site.pmacctl(&["send", "CLOSE"]));
    assert_eq!(code, 0, "{error}");
    wait_until_known(&site);
    let (_, listed, _) = site.hurried(|| site.pmacctl(&["send", "LIST PROG 77"]));
    assert!(!listed.contains("->"), "{listed}");
}

#[test]
fn abort_and_kill_overtake_the_questions() {
    let site = site("turbo2", &[], ASKS);
    site.wait_for_identity();
    // The questions have begun, and are far from their end.
    assert!(!socket_of(&site)["waiting"].as_array().unwrap().is_empty());
    let began = site.with_world(|world| world.now());
    let (code, _, error) = site.pmacctl(&["abort"]);
    assert_eq!(code, 0, "{error}");
    let took = site.with_world(|world| world.now()) - began;
    assert!(took < Duration::from_millis(200), "{took:?}");
    assert!(!socket_of(&site)["waiting"].as_array().unwrap().is_empty(), "they go on");
}
