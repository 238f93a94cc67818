//! The manual pages: each has its sections, names what may be typed, and shows what can be typed as it stands.

use std::collections::HashMap;

use clap_complete::Shell;
use pmac_dpram::function::panel::PanelAction;
use pmac_dpram::map::{FAMILIES, Family, PMAC, TURBO2};
use pmac_dpram::protocol::{BackgroundSettings, Function, ServoSettings};
use pmac_dpram::sim::control::COMMANDS;
use pmac_dpram::sim::fault::faults;

#[path = "../man/command.rs"]
mod command;
#[path = "../man/completions.rs"]
mod completions;
#[path = "../man/roff.rs"]
mod roff;
#[path = "../man/sections.rs"]
mod sections;
#[path = "../man/site.rs"]
mod site;

fn pages() -> HashMap<String, String> {
    site::pages().into_iter().collect()
}

/// A section's text, without what marks it up. (Written by hand, a title has no quotes.)
fn section(page: &str, title: &str) -> String {
    let begins = [format!(".SH \"{title}\"\n"), format!(".SH {title}\n")];
    let rest = begins.iter().find_map(|begin| Some(page.split_once(begin.as_str())?.1));
    let rest = rest.unwrap_or_else(|| panic!("no {title}: {page}"));
    let text = rest.split("\n.SH").next().unwrap_or_default();
    text.replace("\\fB", "").replace("\\fI", "").replace("\\fR", "").replace("\\-", "-").replace("\\(ha", "^")
}

#[test]
fn every_page_has_its_sections() {
    let pages = pages();
    assert!(pages.len() > 20 && pages.contains_key("pmacd.8") && pages.contains_key("pmacd.toml.5"));
    for (name, page) in &pages {
        let title = |title: &str| {
            page.contains(&format!(".SH \"{title}\"\n")) || page.contains(&format!(".SH {title}\n"))
        };
        for wanted in ["NAME", "SYNOPSIS", "DESCRIPTION", "EXAMPLES", "EXIT STATUS", "SEE ALSO"] {
            assert!(title(wanted), "{name} has no {wanted}");
        }
        assert!(section(page, "EXAMPLES").len() > 20, "{name} has no example");
        assert!(section(page, "EXIT STATUS").contains("\n0\n"), "{name} tells no exit status");
    }
}

#[test]
fn a_synopsis_shows_the_values_that_options_take() {
    let pages = pages();
    let synopsis = |page: &str| section(&pages[page], "SYNOPSIS");
    assert!(synopsis("pmacctl-gather.1").contains("[--seconds S]"), "{}", synopsis("pmacctl-gather.1"));
    assert!(synopsis("pmacctl-read.1").contains(" ADDR..."), "{}", synopsis("pmacctl-read.1"));
    assert!(synopsis("pmac-sim.1").contains(" --memory PATH"), "{}", synopsis("pmac-sim.1"));
    assert!(synopsis("pmacd.8").contains("[--board SPEC]"), "{}", synopsis("pmacd.8"));
    let panel = synopsis("pmacctl-panel.1");
    assert_eq!(
        panel.matches("pmacctl panel ").count(),
        PanelAction::ALL.len() - 3 + 2,
        "each action but the jogs, feed and show: {panel}"
    );
}

#[test]
fn the_lists_of_names_are_the_codes_own() {
    let pages = pages();
    let listed = |page: &str, title: &str| {
        let text = section(&pages[page], title);
        let names =
            text.split_once(".PP\n").unwrap_or_else(|| panic!("{text}")).1.trim().trim_end_matches('.');
        names.split(", ").map(str::to_owned).collect::<Vec<_>>()
    };
    for page in ["pmacd.toml.5", "pmacctl.1"] {
        assert_eq!(listed(page, "FUNCTIONS"), Function::ALL.map(Function::name), "{page}");
        assert_eq!(listed(page, "ROLES"), ["observe", "stop", "operate", "engineer"], "{page}");
    }
    let names = |families: &[&Family]| families.iter().map(|family| family.name).collect::<Vec<_>>();
    for page in ["pmacctl-board.1", "pmacctl-read.1", "pmacctl-setup.1", "pmacd.toml.5"] {
        assert_eq!(listed(page, "FAMILIES"), names(FAMILIES), "{page}");
    }
    assert_eq!(listed("pmacctl-panel.1", "ACTIONS"), PanelAction::ALL.map(PanelAction::name));
    assert_eq!(listed("pmacd.toml.5", "SERVO FIELDS"), ServoSettings::all(&PMAC).fields);
    assert_eq!(listed("pmacd.toml.5", "BACKGROUND FIELDS"), BackgroundSettings::all(&PMAC).fields);
    for (title, fields) in [
        ("SERVO FIELDS OF TURBO BOARDS", ServoSettings::all(&TURBO2).fields),
        ("BACKGROUND FIELDS OF TURBO BOARDS", BackgroundSettings::all(&TURBO2).fields),
    ] {
        assert_eq!(listed("pmacd.toml.5", title), fields);
    }
    let layout = pmac_dpram::map::Layout::new(&pmac_dpram::map::PMAC, None);
    for register in listed("pmacctl-gather.1", "REGISTER SPELLINGS") {
        pmac_dpram::gather::Source::parse(&register, &layout).unwrap();
    }
    let set = listed("pmacctl-rotary.1", "SETTINGS");
    let defaults = serde_json::to_value(pmac_dpram::rotary::Settings::default()).unwrap();
    assert_eq!(set.len(), defaults.as_object().unwrap().len());
    for setting in set {
        let words = ["pmacctl", "rotary", "encode", "--set", &setting, "-"];
        pmac_dpram::cli::command().try_get_matches_from(words).unwrap();
    }
}

/// The words of a line as a shell takes them; only single quotes are used, and only they keep what a shell would read.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut quoted = false;
    for character in line.chars() {
        match character {
            '\'' => quoted = !quoted,
            ' ' if !quoted => words.push(String::new()),
            _ => {
                assert!(quoted || !"$&#*?()<>|;^\"\\`".contains(character), "{line}: quote {character}");
                words.last_mut().unwrap().push(character);
            }
        }
    }
    words
}

#[test]
fn every_example_can_be_typed() {
    let mut programs: HashMap<String, clap::Command> =
        site::programs().into_iter().map(|program| (program.get_name().to_owned(), program)).collect();
    let mut count = 0;
    for file in pages().keys() {
        let page = file.rsplit_once('.').unwrap().0;
        for line in sections::examples(page)
            .iter()
            .flat_map(|(_, lines)| lines.iter())
            .filter(|_| page != "pmacd.toml")
        {
            let words = words(line);
            programs
                .get_mut(&words[0])
                .unwrap()
                .try_get_matches_from_mut(&words)
                .unwrap_or_else(|error| panic!("{line}: {error}"));
            count += 1;
        }
    }
    assert!(count > 40, "{count}");
}

#[test]
fn the_configurations_page_has_every_key_of_the_example() {
    let page = &pages()["pmacd.toml.5"];
    let page = section(page, "KEYS");
    let example = include_str!("../../systemd/pmacd.toml.example");
    let mut count = 0;
    for line in example.lines() {
        let line = line.strip_prefix("# ").unwrap_or(line);
        let key = match line.split_once(" = ") {
            Some((key, _))
                if key
                    .bytes()
                    .all(|byte| byte.is_ascii_lowercase() || byte == b'_' || byte.is_ascii_digit()) =>
            {
                key
            }
            _ if line.starts_with('[') && line.ends_with(']') => line,
            _ => continue,
        };
        assert!(
            page.split(|character: char| " ,\"\n".contains(character)).any(|word| word == key),
            "no {key}"
        );
        count += 1;
    }
    assert!(count > 50, "{count}");
    let text = sections::examples("pmacd.toml")
        .iter()
        .flat_map(|(_, lines)| lines.iter().copied())
        .collect::<Vec<_>>()
        .join("\n");
    let written: toml::Table = text.parse().unwrap();
    assert!(written.contains_key("roles") && written["servo"]["motors"].is_array());
}

#[test]
fn the_simulators_page_explains_every_fault_and_control_line() {
    let pages = pages();
    let explained = |title: &str, name: &str, what: &str| {
        let text = section(&pages["pmac-sim.1"], title);
        let line = text.split(".TP\n").find_map(|entry| entry.strip_prefix(&format!("{name}\n")));
        let line = line.unwrap_or_else(|| panic!("no {name}: {text}"));
        // The page begins it with a capital letter.
        assert!(line.replace("\\(aq", "'").contains(&what[1..]), "{name}: {line}");
    };
    for command in COMMANDS {
        explained("CONTROL SOCKET", command.form, command.effect);
    }
    for fault in faults() {
        explained("FAULTS", fault.name, fault.effect);
    }
}

#[test]
fn completions_know_boards_and_registers() {
    for shell in completions::SHELLS {
        for program in site::programs() {
            let is_pmacctl = program.get_name() == "pmacctl";
            let text = completions::completions(shell, program);
            for known in ["1.actual_position", "cs1.program_status"] {
                // Of gather, top and variable watch; clap_complete tells fish of options only.
                let least = if shell == Shell::Fish { 1 } else { 3 };
                let count = text.matches(known).count();
                assert!(if is_pmacctl { count >= least } else { count == 0 }, "{shell}: {known}");
            }
            assert_eq!(text.contains("ls /run/pmacd"), is_pmacctl, "{shell}");
            assert!(!text.contains("BOARDS"), "{shell}");
            assert!(!text.contains("jog-stop"), "{shell}: an old spelling");
        }
    }
}
