//! What the README and the example files say, tried: every `$ pmacctl` line is run against a simulated board.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Site, wait_until};

fn text(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// The command lines of the blocks that begin with this fence, each with what is printed below it.
fn shown(readme: &str, fence: &str) -> Vec<(Vec<String>, String)> {
    let mut commands: Vec<(Vec<String>, String)> = Vec::new();
    let mut inside = false;
    for line in readme.lines() {
        if line.starts_with("```") {
            inside = !inside && line == fence;
        } else if !inside {
        } else if let Some(command) = line.strip_prefix("$ pmacctl ") {
            commands.push((words(command), String::new()));
        } else {
            let (_, output) = commands.last_mut().expect("a block begins with a command");
            *output += &format!("{line}\n");
        }
    }
    assert!(!commands.is_empty(), "{fence}");
    commands
}

/// The words of a command line; a word in single quotes may have blanks.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    for (index, part) in line.split('\'').enumerate() {
        if index % 2 == 1 {
            words.push(part.to_owned());
        } else {
            words.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    words
}

#[test]
fn every_command_the_readme_shows_does_what_it_shows() {
    let readme = text("README.md");
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let run = |command: &[String]| {
        let arguments: Vec<&str> = command.iter().map(String::as_str).collect();
        site.pmacctl(&arguments)
    };
    wait_until("a board that has told its scales", || run(&words("motors")).1.contains("count"));
    for (command, output) in shown(&readme, "```console") {
        let first =
            |text: &str| text.lines().next().unwrap_or_default().split_whitespace().next().map(str::to_owned);
        // On a machine that stands still for a tenth of a second the data are stale, and exit status 1 says so.
        wait_until(&format!("{command:?}"), || {
            let (code, stdout, stderr) = run(&command);
            assert!(code < 2, "{command:?}: {stderr}");
            assert_eq!(stdout.lines().count(), output.lines().count(), "{command:?}: {stdout}");
            code == 0
                && (["update=", "servo="].iter().any(|start| output.starts_with(start))
                    || first(&stdout) == first(&output))
        });
    }
    for (command, output) in shown(&readme, "```console exact") {
        wait_until(&format!("{command:?} to print\n{output}"), || {
            let (code, stdout, stderr) = run(&command);
            let refused = output.starts_with("ERR") || output.contains(" belongs to ");
            code == i32::from(refused) && if refused { stderr == output } else { stdout == output }
        });
    }
    site.assert_no_violations();
}

#[test]
fn every_command_there_is_stands_in_the_readme() {
    let readme = text("README.md");
    let help = crate::support::rig::pmacctl("--help").stdout;
    let commands = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    for command in commands.lines().map(|line| line.split_whitespace().next().unwrap()) {
        assert!(readme.contains(&format!("pmacctl {command}")), "{command}");
    }
}

#[test]
fn links_of_the_readme_lead_somewhere() {
    let readme = text("README.md");
    for target in readme.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
        if let Some(heading) = target.strip_prefix('#') {
            let found = readme.lines().any(|line| line.to_lowercase() == format!("## {heading}"));
            assert!(found, "{target}");
        } else if !target.starts_with("https:") {
            assert!(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(target).exists(), "{target}");
        }
    }
}

#[test]
fn the_example_configuration_is_accepted_and_so_is_every_key_in_it() {
    let example = text("systemd/pmacd.toml.example");
    // A commented key is `# key = value`; prose never looks like that.
    let key = |line: &str| {
        let line = line.strip_prefix("# ")?;
        let named = line.split_once(" = ").is_some_and(|(key, _)| !key.contains(' '));
        (named || line.starts_with('[') && line.ends_with(']')).then(|| line.to_owned())
    };
    let every: Vec<String> =
        example.lines().map(|line| key(line).unwrap_or_else(|| line.to_owned())).collect();
    let every = every.join("\n");
    assert!(every.lines().filter(|line| line.contains(" = ") && !line.starts_with('#')).count() > 15);
    // Of groups it is asked whether there are such.
    let gid = nix::unistd::getgid();
    let group = nix::unistd::Group::from_gid(gid).unwrap().map_or("root".to_owned(), |group| group.name);
    let every = ["[\"operators\"]", "[\"pmac-engineers\"]"]
        .into_iter()
        .fold(every, |text, list| text.replace(list, &format!("[\"{group}\"]")))
        .replace("_group = \"pmac\"", &format!("_group = \"{group}\""));
    let directory = tempfile::tempdir().unwrap();
    for (name, content) in [("example", &example), ("every", &every)] {
        let file = directory.path().join(name);
        fs::write(&file, content).unwrap();
        let ran = std::process::Command::new(env!("CARGO_BIN_EXE_pmacd"))
            .arg("--config")
            .arg(&file)
            .arg("--check")
            .output()
            .unwrap();
        assert!(ran.status.success(), "{name}: {}", String::from_utf8_lossy(&ran.stderr));
    }
}
