//! Where the manual can be read two ways: the page of the readings, and what users see under each.

use pmac_dpram::map::{READINGS, Readings};

use crate::support::{PATIENCE, VirtualSite};

/// A board that reads `name` as `value` says, and its daemon.
fn board_that_reads(name: &str, value: &str) -> VirtualSite {
    let site = VirtualSite::running(&["--reading", &format!("{name}={value}")], &[]);
    site.wait_for_identity();
    site
}

/// The cells of each row of the page's table.
fn rows() -> Vec<Vec<String>> {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/readings.md");
    let page = std::fs::read_to_string(page).unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| row.trim_matches('|').split(" | ").map(|cell| cell.trim().to_owned()).collect()).collect()
}

#[test]
fn the_page_has_every_reading_of_the_list_and_no_other() {
    let rows = rows();
    let names: Vec<_> = rows.iter().map(|row| row[0].trim_matches('`')).collect();
    assert_eq!(names, READINGS.iter().map(|reading| reading.name).collect::<Vec<_>>());
    for (row, reading) in rows.iter().zip(READINGS) {
        assert_eq!(
            row.len(),
            7,
            "{}: name, sentence, reading, other, effect, found out, setting",
            reading.name
        );
        let shown: Vec<_> = row[2..4].iter().flat_map(|cell| values(cell)).collect();
        assert_eq!(shown, reading.values, "{}", reading.name);
        let setting =
            if reading.found_out { "none needed".to_owned() } else { format!("`{}`", reading.name) };
        assert_eq!(row[6], setting, "{}", reading.name);
    }
}

/// The values that a cell names, each as `VALUE`:
fn values(cell: &str) -> Vec<&str> {
    let parts: Vec<_> = cell.split('`').collect();
    let named = parts.windows(2).skip(1).step_by(2).filter(|part| part[1].starts_with(':'));
    named.map(|part| part[0]).collect()
}

#[test]
fn the_simulator_plays_what_it_is_told_and_refuses_the_rest() {
    let refused = |given: &str| {
        use clap::Parser;
        let options = ["pmac-sim", "--memory", "m", "--reading", given];
        pmac_dpram::sim::process::options::Options::try_parse_from(options).unwrap_err().to_string()
    };
    assert!(refused("line_flag=never").contains("expected `taken` or `done`"));
    assert!(refused("line=done").contains("expected one of `reply_count`, "));
    for reading in READINGS {
        assert_eq!(Readings::default().value(reading.name).as_deref(), Some(reading.values[0]));
    }
}

#[test]
fn b3_1_a_reply_is_whole_whatever_its_count_has_in_it() {
    for value in ["with_nul", "without_nul"] {
        let site = board_that_reads("reply_count", value);
        for (line, reply) in [("I108", "96"), ("P5=7", ""), ("P5", "7"), ("P5 I10", "7 3713707")] {
            let lines = site.connection().send(line, PATIENCE).unwrap();
            assert_eq!(lines.join(" "), reply, "{value}: {line}");
        }
        // The scale of positions comes from I108.
        site.connection().send("#1J=1000", PATIENCE).unwrap();
        site.wait_until("motor 1 at 1000 counts", || {
            let (_, stdout, _) = site.pmacctl(&["motors", "--json"]);
            let motors: serde_json::Value = serde_json::from_str(&stdout).unwrap();
            let position = &motors["motors"][0]["actual_position"]["value"];
            position.as_f64().is_some_and(|counts| (counts - 1000.0).abs() < 1.0)
        });
        site.assert_no_violations();
    }
}
