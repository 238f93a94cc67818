//! Where the manual can be read two ways: the page of the readings, and what users see under each.

use std::time::Duration;

use pmac_dpram::map::READINGS;

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

/// The same, with `config` for the daemon.
fn configured(name: &str, value: &str, config: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--reading", &format!("{name}={value}")], config);
    site.wait_for_identity();
    assert_eq!(site.pmacctl(&["send", "&1 #1->X #2->Y"]).0, 0);
    site
}

#[test]
fn b3_4_an_inc_that_the_board_takes_for_an_abs_is_found_out_before_it_moves() {
    let check = ["rotary", "check", "--define", "200"];
    for (name, other, line) in [
        ("rotary_code2", "bit16", "sample:2: sent INC(X,Y), the board lists ABS("),
        ("rotary_bit_codes", "table", "sample:4: sent M1^=3, the board lists M1&=3"),
    ] {
        let site = configured(name, other, "");
        let (status, _, stderr) = site.pmacctl(&check);
        assert!(status == 1 && stderr.contains(line), "{stderr}");
        let advice = format!("the board reads the manual by {name} = {other:?}: write it under [readings]");
        assert!(stderr.contains(&advice), "{stderr}");
        assert_eq!(site.connection().send("&1PR", PATIENCE).unwrap(), ["0"], "nothing is left to run");
        drop(site);
        let site = configured(name, other, &format!("[readings]\n{name} = {other:?}\n"));
        let (status, stdout, stderr) = site.pmacctl(&check);
        assert!(status == 0 && stdout == "the board lists 9 lines as they were sent\n", "{stdout}{stderr}");
        // The program runs as meant: 10 on, not to 10.
        let program = site.file("program.pmc", "RAPID ABS X20\nINC X10\n");
        let (status, _, stderr) = site.pmacctl(&["rotary", "stream", &program, "--run"]);
        assert_eq!(status, 0, "{stderr}");
        site.wait_until("motor 1 at 30", || site.connection().send("#1P", PATIENCE).unwrap() == ["30"]);
        site.assert_no_violations();
    }
}

#[test]
fn b3_5_a_board_that_takes_nothing_names_the_setting_of_the_header() {
    let stream = |site: &VirtualSite| {
        let program = site.file("program.pmc", "RAPID X20\n");
        site.pmacctl(&["rotary", "stream", &program, "--define", "200", "--run", "--timeout", "2"])
    };
    let site = configured("rotary_header", "start_first", "");
    let (status, _, stderr) = stream(&site);
    assert!(
        status == 1 && stderr.contains("try rotary_header = \"start_first\" under [readings]"),
        "{stderr}"
    );
    drop(site);
    for value in ["size_first", "start_first"] {
        let site = configured("rotary_header", value, &format!("[readings]\nrotary_header = {value:?}\n"));
        let (status, _, stderr) = stream(&site);
        assert_eq!(status, 0, "{stderr}");
        site.wait_until("motor 1 at 20", || site.connection().send("#1P", PATIENCE).unwrap() == ["20"]);
        site.assert_no_violations();
    }
}

