//! `family = "auto"`: the daemon finds out which board it has, and writes nothing before it knows.

use std::time::Duration;

use serde_json::Value;

use crate::support::{VirtualSite, is_live};
use pmac_dpram::segment::RegionId;

const FAMILIES: [&str; 4] = ["pmac", "pmac2", "turbo", "turbo2"];
/// An engineer's board that is to be recognised.
const AUTO: &str = "family = \"auto\"\n";

/// A board with these options of the simulator.
fn board(options: &[&str]) -> VirtualSite {
    let site = VirtualSite::new();
    site.start_simulator(options);
    // It is not recognised by what happened before its first servo cycle.
    site.run_for(Duration::from_millis(20));
    site
}

fn configured(site: &VirtualSite, config: &str) {
    let config = site.file("pmacd.toml", config);
    site.start_daemon(&["--config", &config]);
}

/// The daemon's refusal to start.
fn refusal(site: &VirtualSite, config: &str) -> String {
    site.refusal(&site.file("pmacd.toml", config))
}

fn memory(site: &VirtualSite) -> Vec<u8> {
    std::fs::read(site.path("dpram")).unwrap()
}

fn status(site: &VirtualSite) -> Value {
    site.hurried(|| serde_json::from_str(&site.pmacctl(&["status", "--json"]).1).unwrap())
}

#[test]
fn a_board_that_reports_is_recognised() {
    for family in FAMILIES {
        for garbage in ["off", "1", "7"] {
            let site = board(&["--family", family, "--dpram-startup", "--garbage", garbage]);
            configured(&site, AUTO);
            site.wait_until("its own family", || status(&site)["family"] == family);
            site.wait_until("servo data", || is_live(&site.attach(), RegionId::Servo));
            let (code, text, error) = site.hurried(|| site.pmacctl(&["send", "TYPE"]));
            assert_eq!(code, 0, "{family} {garbage}: {text}{error}");
            site.assert_no_violations();
        }
    }
}

#[test]
fn nothing_is_written_to_a_board_that_is_not_recognised() {
    for family in FAMILIES {
        for garbage in ["off", "3", "11"] {
            // 32K x 16 bits would tell.
            let site = board(&["--family", family, "--dpram", "8k", "--garbage", garbage]);
            let before = memory(&site);
            configured(&site, AUTO);
            site.run_for(Duration::from_secs(3));
            let status = status(&site);
            assert_eq!(
                (&status["family"], &status["socket"]["functions"]),
                (&Value::Null, &serde_json::json!([]))
            );
            assert_eq!(status["condition"], "family_unknown");
            for command in ["status", "doctor"] {
                let (code, text, _) = site.hurried(|| site.pmacctl(&[command]));
                assert!(code == 1 && text.contains("write family = \"pmac\""), "{command}: {code} {text}");
            }
            for line in [
                &["send", "I10"] as &[&str],
                &["write", "--engineer", "--family", "pmac", "0x3000", "1"],
                &["abort"],
            ] {
                let (code, _, error) = site.hurried(|| site.pmacctl(line));
                assert!(code != 0 && error.contains("write family = \"pmac\""), "{line:?}: {code} {error}");
            }
            let (code, _, error) = site.hurried(|| site.pmacctl(&["read", "--family", "pmac", "0x0024"]));
            assert_eq!(code, 0, "reading goes on: {error}");
            site.stop_daemon();
            assert_eq!(memory(&site), before, "{family} {garbage}");
        }
    }
}

#[test]
fn a_configuration_that_contradicts_the_board_is_refused() {
    for (family, written, message) in [
        (
            "turbo2",
            "pmac",
            "is a Turbo PMAC2 by what it shows or answers, and nothing was written to its DPRAM; write family = \"turbo\"",
        ),
        ("turbo", "pmac2", "is a Turbo PMAC by what it shows or answers"),
        (
            "pmac",
            "turbo",
            "is a PMAC by what it shows or answers, and nothing was written to its DPRAM; write family = \"pmac\"",
        ),
    ] {
        let site = board(&["--family", family, "--dpram-startup"]);
        let error = refusal(&site, &format!("family = \"{written}\"\n"));
        assert!(error.contains(message), "{error}");
        site.assert_no_violations();
    }
    let site = board(&["--dpram-startup"]);
    let error = refusal(&site, "family = \"auto\"\nmotors = 20\n");
    assert!(error.contains("motors = 20 is out of range: write 1 to 8"), "{error}");
    let error = refusal(&site, "family = \"turbo3\"\n");
    assert!(error.contains("or write \"auto\""), "{error}");
}

#[test]
fn a_file_without_a_family_stays_a_pmac() {
    let site = board(&["--family", "pmac2", "--dpram-startup"]);
    configured(&site, "");
    site.wait_until("TYPE", || status(&site)["board"]["type"].is_string());
    // What TYPE says within the generation is told.
    assert_eq!(status(&site)["family"], "pmac2");
}

#[test]
fn doctor_tells_the_other_board_of_a_generation() {
    for (family, written, text) in [
        ("pmac2", "pmac", "is a PMAC2, but pmacd takes it for a PMAC, which has the same functions"),
        ("turbo", "turbo2", "is a Turbo PMAC, but pmacd takes it for a Turbo PMAC2, which has the same"),
        ("turbo2", "turbo2", ""),
    ] {
        let size = if written == "pmac" { "8k" } else { "32k" };
        let site = board(&["--family", family, "--dpram", size, "--dpram-startup"]);
        configured(&site, &format!("family = \"{written}\"\n"));
        site.wait_until("TYPE", || status(&site)["board"]["type"].is_string());
        assert_eq!(status(&site)["family"], family, "status has what the board says");
        let checks = site.hurried(|| site.pmacctl(&["doctor", "--json"]).1);
        let checks: Value = serde_json::from_str(&checks).unwrap();
        let told = checks.as_array().unwrap().iter().find(|check| check["check"] == "family");
        let told = told.map(|check| (check["level"].as_str().unwrap(), check["text"].as_str().unwrap()));
        match told {
            None => assert_eq!(text, "", "nothing is told of {family}"),
            Some((level, told)) => {
                assert!(!text.is_empty() && told.contains(text), "{told}");
                assert!(told.ends_with(&format!("write family = \"{family}\"")), "{told}");
                assert_eq!(level, "ok", "{told}");
            }
        }
        site.assert_no_violations();
    }
}

#[test]
fn the_size_of_the_dpram_tells_turbo_without_a_report() {
    let site = board(&["--family", "turbo2", "--garbage", "off"]);
    configured(&site, AUTO);
    site.run_for(Duration::from_secs(1));
    assert_eq!(status(&site)["family"], "turbo2");
    site.assert_no_violations();
    let error = refusal(&board(&["--family", "turbo2"]), "family = \"pmac\"\n");
    assert!(error.contains("is a Turbo PMAC2 by what it shows or answers"), "{error}");
}

#[test]
fn words_are_read_by_their_offset_while_the_family_is_not_known() {
    let site = board(&["--family", "turbo2", "--dpram", "8k", "--garbage", "3"]);
    configured(&site, AUTO);
    site.wait_until("a daemon that has given up", || status(&site)["condition"] == "family_unknown");
    let run = |arguments: &[&str]| site.hurried(|| site.pmacctl(arguments));
    let word = u16::from_le_bytes(memory(&site)[0x70..0x72].try_into().unwrap());
    let (code, text, error) = run(&["read", "0x0070", "0x0070,0,16", "--json"]);
    assert_eq!(code, 0, "{error}");
    let found: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (&found[0]["words"][0], &found[1]["value"]["word"].is_null()),
        (&word.into(), &true),
        "{text}"
    );
    assert_eq!(found[0]["pmac_address"], Value::Null, "nobody knows it");
    let (code, text, _) = run(&["read", "0x0070"]);
    assert!(code == 0 && text.lines().last().unwrap().starts_with("0x0070   0x0070"), "{text}");
    // The others mean other words on a PMAC than on a Turbo board.
    for arguments in [
        &["read", "Y:$06001C"] as &[&str],
        &["read", "0x0070", "Y:$D001"],
        &["map"],
        &["setup", "enable", "servo"],
    ] {
        let (code, _, error) = run(arguments);
        assert!(code == 2 && error.contains("--family"), "{arguments:?}: {code} {error}");
        let family = if arguments.contains(&"Y:$D001") { "pmac" } else { "turbo" };
        let (code, _, error) = run(&[arguments, &["--family", family]].concat());
        assert_eq!(code, 0, "{arguments:?}: {error}");
    }
}

#[test]
fn map_and_setup_answer_for_the_board_that_is_there() {
    let site = board(&["--family", "turbo2", "--dpram-startup"]);
    configured(&site, "family = \"turbo2\"\n");
    for arguments in [&["map"] as &[&str], &["setup", "enable", "servo"]] {
        let run = |more: &[&str]| site.hurried(|| site.pmacctl(&[arguments, more].concat())).1;
        let (told, turbo2) = (run(&[]), run(&["--family", "turbo2"]));
        assert!(told == turbo2 && told != run(&["--family", "pmac"]), "{arguments:?}");
    }
}

#[test]
fn clients_know_how_large_the_dpram_is() {
    // Turbo User Manual p. 402: the last locations are $060FFF and $063FFF. Each size with the family that comes with the other.
    for (family, size, last, beyond) in
        [("turbo", "32k", "Y:$063FFF", "Y:$064000"), ("turbo2", "8k", "Y:$060FFF", "Y:$061000")]
    {
        let site = board(&["--family", family, "--dpram", size, "--dpram-startup"]);
        configured(&site, &format!("family = \"{family}\"\nask_m_variables = false\n"));
        site.wait_for_live_servo();
        let run = |arguments: &[&str]| site.hurried(|| site.pmacctl(arguments));
        assert_eq!(run(&["read", last]).0, 0, "{family} {size}");
        let (code, _, error) = run(&["read", beyond]);
        assert!(code == 2 && error.contains("lies outside the DPRAM"), "{code} {error}");
        site.wait_until("a board that takes commands", || run(&["send", "I10"]).0 == 0);
        let gather = ["gather", "--source", "1.actual_position", "--seconds", "0.1", "-o", "-"];
        let (code, text, error) = run(&gather);
        assert!(code == 0 && text.lines().count() > 100, "{family} {size}: {code} {error}");
        site.assert_no_violations();
    }
}
