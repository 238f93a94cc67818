//! What README.md, CONTRIBUTING.md and docs/ say, tried against a simulated board.
//!
//! The first word behind a fence says what becomes of the block:
//!
//! * `sh`: a shell runs it; it must succeed.
//! * `sh start`: its command runs until it is ended; `pmacctl status` must reach it meanwhile.
//! * `sh no-run: REASON`: it needs root or hardware; a shell checks its syntax.
//! * `console`: a shell runs each `$ ` line, which must succeed and print what the page shows; numbers may differ.
//! * `console exact`: numbers must be the same, too.
//! * `toml`: a configuration that `pmacd --check` must accept.
//! * `python`: as `sh`, by python3. As `sh python`, it is run by a test that is ignored where python3 may be missing.
//! * `text`: shown only, so no command stands in it.
//! * `console guest`, `toml guest` and `text serial` of docs/first-board.md: typed at a board of one's own, so only what is
//!   configured is checked here. `pmac` or `turbo` behind it is the family.
//!
//! `pmacctl` in a block is the program with the name and the socket of the test's own board.

use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::support::{PATIENCE, VirtualSite, output_within, wait_until};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap()
}

/// README.md, CONTRIBUTING.md, the C library's page and every page of docs/.
fn pages() -> Vec<String> {
    let mut pages: Vec<String> = fs::read_dir(root().join("docs"))
        .unwrap()
        .map(|entry| format!("docs/{}", entry.unwrap().file_name().into_string().unwrap()))
        .filter(|name| name.ends_with(".md"))
        .collect();
    pages.sort();
    pages.splice(0..0, ["README.md", "CONTRIBUTING.md", "c/README.md"].map(str::to_owned));
    pages
}

/// A fenced block of a page.
struct Block {
    /// Its page and line, for messages.
    place: String,
    /// What stands behind the fence.
    kind: String,
    body: String,
    /// The page's heading above it.
    section: String,
}

fn blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let (mut inside, mut section) = (false, String::new());
    for (index, line) in text(page).lines().enumerate() {
        if let Some(heading) = line.strip_prefix("## ").filter(|_| !inside) {
            section = heading.to_owned();
        } else if let Some(kind) = line.trim_start().strip_prefix("```") {
            inside = !inside;
            if inside {
                let place = format!("{page}:{}", index + 1);
                let section = section.clone();
                blocks.push(Block { place, kind: kind.to_owned(), body: String::new(), section });
            }
        } else if inside {
            blocks.last_mut().unwrap().body += &format!("{line}\n");
        }
    }
    assert!(!inside, "{page}: the last block does not end");
    blocks
}

/// The `$ ` lines of a console block, each with what is printed below it.
fn dialogue(block: &Block) -> Vec<(String, String)> {
    let mut commands: Vec<(String, String)> = Vec::new();
    for line in block.body.lines() {
        if let Some(command) = line.strip_prefix("$ ") {
            commands.push((command.to_owned(), String::new()));
        } else {
            let (_, output) = commands.last_mut().expect("a console block begins with a command");
            *output += &format!("{line}\n");
        }
    }
    commands
}

/// A reader's place: a directory with the programs where a build puts them, and a board of his own.
struct Reader {
    site: VirtualSite,
}

impl Reader {
    /// With a board that has told its scales.
    fn new() -> Self {
        Self::at(VirtualSite::running(&[], &[]))
    }

    fn at(site: VirtualSite) -> Self {
        let real = Path::new(env!("CARGO_BIN_EXE_pmacctl"));
        let programs = site.path("target");
        fs::create_dir_all(&programs).unwrap();
        symlink(real.parent().unwrap(), programs.join("release")).unwrap();
        for folder in ["tests", "systemd", "src", "examples"] {
            symlink(root().join(folder), site.path(folder)).unwrap();
        }
        // Before the real ones in PATH.
        fs::create_dir(site.path("bin")).unwrap();
        let (name, socket) = (&site.name, site.socket());
        let pmacctl = format!("exec '{}' --name {name} --socket {} \"$@\"", real.display(), socket.display());
        // This test is part of what they would do.
        let cargo = "case \"$*\" in 'build --release' | 'test --locked') ;; *) exit 1 ;; esac".to_owned();
        for (program, script) in [("bin/pmacctl", pmacctl), ("bin/cargo", cargo)] {
            fs::write(site.path(program), format!("#!/bin/sh\n{script}\n")).unwrap();
            fs::set_permissions(site.path(program), fs::Permissions::from_mode(0o755)).unwrap();
        }
        site.wait_for_live_servo();
        site.wait_until("a board that has told its scales", || site.has_scales());
        Self { site }
    }

    fn shell(&self, program: &str, arguments: &[&str]) -> Command {
        let path = format!(
            "{}:{}:{}",
            self.site.path("bin").display(),
            self.site.path("target/release").display(),
            std::env::var("PATH").unwrap_or_default()
        );
        let mut command = Command::new(program);
        command.args(arguments).current_dir(self.site.directory.path()).env("PATH", path);
        command.env("HOME", self.site.directory.path()).stdin(Stdio::null());
        command
    }

    /// Runs a program on `script`; returns whether it succeeded, and what it printed.
    fn run(&self, program: &[&str], script: &str) -> (bool, String) {
        // One stream, so that errors stand where they come.
        let together = if program[0] == "sh" { "exec 2>&1\n" } else { "" };
        let script = format!("{together}{}", self.local(script));
        let mut child = self
            .shell(program[0], &[&program[1..], &[&script]].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let output = output_within(&mut child, PATIENCE);
        let printed = [output.stdout, output.stderr].concat();
        (output.status.success(), self.public(&String::from_utf8(printed).unwrap()))
    }

    /// A page's names of board, socket and segment become the test's own.
    fn local(&self, script: &str) -> String {
        script
            .replace("/tmp/pmac0.sock", self.site.socket().to_str().unwrap())
            .replace("/dev/shm/pmac0", &format!("/dev/shm/{}", self.site.name))
            .replace("attach(\"pmac0\")", &format!("attach(\"{}\")", self.site.name))
            // Nobody waits for the demo here.
            .replace("demo --seconds 10", "demo --seconds 1")
    }

    /// The other way round.
    fn public(&self, printed: &str) -> String {
        printed
            .replace(self.site.socket().to_str().unwrap(), "/tmp/pmac0.sock")
            .replace(&self.site.name, "pmac0")
            .replace(self.site.directory.path().to_str().unwrap(), "")
    }

    fn try_block(&self, block: &Block) {
        let place = &block.place;
        match block.kind.as_str() {
            "sh" => {
                let (done, printed) = self.run(&["sh", "-euc"], &block.body);
                assert!(done, "{place}: {printed}");
            }
            "sh start" => self.start(block),
            "console" => self.talk(block, shape),
            "console exact" => self.talk(block, str::to_owned),
            kind if kind == "toml" || kind.starts_with("toml guest") => {
                let file = self.site.path("block.toml");
                fs::write(&file, with_groups_that_exist(&block.body)).unwrap();
                let (done, printed) = self.run(&["pmacd", "--check", "--config"], file.to_str().unwrap());
                assert!(done, "{place}: {printed}");
            }
            _ => {}
        }
    }

    /// Runs a command that goes on until it is ended, and asks the daemon that it starts.
    fn start(&self, block: &Block) {
        let socket = self.site.path("started");
        let name = format!("{}-started", self.site.name);
        let place = format!("--socket {} --name {name}", socket.display());
        let script = format!("exec {}", block.body.replace("--socket /tmp/pmac0.sock", &place));
        let mut child = self.shell("sh", &["-euc", &script]).stderr(Stdio::piped()).spawn().unwrap();
        let status = ["--name", &name, "--socket", socket.to_str().unwrap(), "status"];
        wait_until("the daemon that a page starts", || {
            let output = self.shell("target/release/pmacctl", &status).output().unwrap();
            output.status.success()
        });
        nix::sys::signal::kill(
            nix::unistd::Pid::from_raw(child.id().cast_signed()),
            nix::sys::signal::Signal::SIGTERM,
        )
        .unwrap();
        let output = output_within(&mut child, PATIENCE);
        assert!(output.status.success(), "{}: {}", block.place, String::from_utf8_lossy(&output.stderr));
    }

    /// Types the commands of a console block and compares, after `form`, what they print.
    fn talk(&self, block: &Block, form: fn(&str) -> String) {
        for (command, expected) in dialogue(block) {
            let (done, printed) = self.run(&["sh", "-euc"], &command);
            assert!(done, "{}: {command}: {printed}", block.place);
            assert_eq!(form(&printed), form(&expected), "{}: {command} printed\n{printed}", block.place);
        }
    }
}

/// What is left of a text when its numbers may differ, and with them the width of its columns.
fn shape(text: &str) -> String {
    let mut shape = String::new();
    for line in text.lines() {
        for word in line.split_whitespace() {
            let mut previous = ' ';
            for character in word.chars() {
                let number = character.is_ascii_digit() || character == '.' && previous == '0';
                let character = if number { '0' } else { character };
                if !(number && previous == '0') {
                    shape.push(character);
                }
                previous = character;
            }
            shape.push(' ');
        }
        shape.push('\n');
    }
    // A value may be negative.
    shape.replace(" -0", " 0").replace("=-0", "=0")
}

/// A configuration whose groups the system of the test knows.
fn with_groups_that_exist(configuration: &str) -> String {
    let gid = nix::unistd::getgid();
    let group = nix::unistd::Group::from_gid(gid).unwrap().map_or("root".to_owned(), |group| group.name);
    ["pmac-stop", "pmac-operator", "pmac-engineer"]
        .into_iter()
        .fold(configuration.to_owned(), |text, name| {
            text.replace(&format!("\"{name}\""), &format!("\"{group}\""))
        })
        .replace("_group = \"pmac\"", &format!("_group = \"{group}\""))
}

#[test]
fn every_block_of_the_pages_does_what_it_shows() {
    for page in pages() {
        let blocks = blocks(&page);
        if blocks.iter().all(|block| ["text", "python"].contains(&block.kind.as_str())) {
            continue;
        }
        let reader = Reader::new();
        for block in &blocks {
            reader.try_block(block);
        }
        reader.site.assert_no_violations();
    }
}

/// Their commands are the same, though a Turbo board's reports have other columns.
#[test]
fn the_recipes_of_the_guide_run_on_a_turbo_board() {
    let reader = Reader::at(VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n"));
    let recipes = blocks("docs/guide.md").into_iter().filter(|block| block.section == "The windows of PEWIN");
    let recipes: Vec<Block> = recipes.collect();
    assert!(recipes.len() >= 8, "position, status, terminal, watch, jog, backup, tuning, download");
    for Block { place, kind, body, .. } in &recipes {
        let commands: Vec<&str> = match kind.as_str() {
            "sh" => vec![body],
            _ => body.lines().filter_map(|line| line.strip_prefix("$ ")).collect(),
        };
        // `tests/it/backup.rs` backs up a Turbo board, whose 8192 variables of each kind take long.
        let commands = commands.into_iter().filter(|command| !command.contains("machine.txt"));
        assert!(body.lines().filter(|line| kind == "sh" || line.starts_with("$ ")).count() <= 5, "{place}");
        for command in commands {
            let (done, printed) = reader.run(&["sh", "-euc"], command);
            assert!(done, "{place}: {command}: {printed}");
        }
    }
    reader.site.assert_no_violations();
}

#[test]
#[ignore = "needs python3"]
fn with_python_every_python_block_of_the_pages_runs() {
    let reader = Reader::new();
    for block in pages().iter().flat_map(|page| blocks(page)) {
        let program: &[&str] = match block.kind.as_str() {
            "python" => &["python3", "-c"],
            "sh python" => &["sh", "-euc"],
            _ => continue,
        };
        let (done, printed) = reader.run(program, &block.body);
        assert!(done, "{}: {printed}", block.place);
    }
}

#[test]
fn a_block_that_is_not_run_says_why() {
    for block in pages().iter().flat_map(|page| blocks(page)) {
        let Block { place, kind, body, .. } = &block;
        if let Some(reason) = kind.strip_prefix("sh no-run: ") {
            assert!(!reason.is_empty(), "{place}");
            let manifest = text("Cargo.toml");
            for test in body.split("--test ").skip(1).filter_map(|rest| rest.split_whitespace().next()) {
                assert!(manifest.contains(&format!("name = \"{test}\"")), "{place}: there is no test {test}");
            }
            let parsed = Command::new("sh").args(["-n", "-c", body]).output().unwrap();
            assert!(parsed.status.success(), "{place}: {}", String::from_utf8_lossy(&parsed.stderr));
            continue;
        }
        if place.starts_with("docs/first-board.md")
            && ["console guest", "text serial"].iter().any(|start| kind.starts_with(start))
        {
            continue;
        }
        if kind == "text" {
            let command = |line: &str| {
                ["$ ", "# pmac", "./target/", "cargo ", "pmacctl ", "pmacd ", "pmac-sim ", "sudo "]
                    .iter()
                    .any(|start| line.starts_with(start))
            };
            assert!(!body.lines().any(command), "{place}: a command in a block that is not run");
            continue;
        }
        let known =
            ["sh", "sh start", "sh python", "console", "console exact", "toml", "python", "rust", "c"];
        let kind = kind.strip_prefix("toml guest").map_or(kind.as_str(), |_| "toml");
        assert!(known.contains(&kind), "{place}: nothing runs a block of this kind: {kind:?}");
    }
}

#[test]
fn the_readme_is_short_and_names_the_test_command() {
    let readme = text("README.md");
    assert!(readme.lines().count() <= 200);
    assert!(readme.lines().any(|line| line == "cargo test --locked"));
    for page in pages() {
        for (index, line) in text(&page).lines().enumerate() {
            let length = line.chars().count();
            assert!(length <= 120 || line.starts_with('|'), "{page}:{}: {length} characters", index + 1);
        }
    }
}

/// Words of a page without its tables of registers, counters and the site's own words, which `tests/it/segment_page.rs` compares with the code.
fn words(page: &str) -> usize {
    let generated = |section: &str| {
        page == "docs/segment.md"
            && ["Counters\n", "Servo and background", "User\n"].iter().any(|name| section.starts_with(name))
    };
    let counted = |section: &str| {
        let lines = section.lines().filter(|line| !(generated(section) && line.starts_with('|')));
        lines.map(|line| line.split_whitespace().count()).sum::<usize>()
    };
    text(page).split("\n## ").map(counted).sum()
}

#[test]
fn pages_stay_as_short_as_they_are() {
    for (page, most) in [
        ("README.md", 1000),
        ("CHANGELOG.md", 414),
        ("CONTRIBUTING.md", 900),
        ("c/README.md", 260),
        ("docs/guide.md", 4545),
        ("docs/install.md", 1573),
        ("docs/operations.md", 2630),
        ("docs/first-board.md", 2600),
        ("docs/moving.md", 735),
        ("docs/pcomm32.md", 3342),
        ("docs/web.md", 450),
        ("python/README.md", 700),
        ("docs/assurance.md", 1689),
        ("docs/captures.md", 400),
        ("docs/evidence.md", 2420),
        ("docs/gateway.md", 1600),
        ("docs/security.md", 1300),
        ("docs/releasing.md", 280),
        ("docs/segment.md", 3025),
        ("docs/simulator.md", 400),
    ] {
        let words = words(page);
        assert!(words <= most, "{page}: {words} words");
    }
}

#[test]
fn every_command_there_is_stands_in_the_guide() {
    let guide = text("docs/guide.md");
    let command = pmac_dpram::cli::command();
    for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set()) {
        assert!(guide.contains(&format!("pmacctl {}", verb.get_name())), "{}", verb.get_name());
    }
}

/// The name that a heading has in a link, as code hosts make it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|character| character.is_alphanumeric() || " -_".contains(*character));
    kept.collect::<String>().trim().to_lowercase().replace(' ', "-")
}

#[test]
fn links_of_the_pages_lead_somewhere() {
    for page in pages() {
        let folder = root().join(&page).parent().unwrap().to_owned();
        for link in text(&page).split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.starts_with("https:") {
                continue;
            }
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target: PathBuf = if file.is_empty() { root().join(&page) } else { folder.join(file) };
            assert!(target.exists(), "{page}: {link}");
            if !heading.is_empty() {
                let there = fs::read_to_string(&target).unwrap();
                let found = there
                    .lines()
                    .filter(|line| line.starts_with('#'))
                    .any(|line| anchor(line.trim_start_matches('#')) == heading);
                assert!(found, "{page}: {link}");
            }
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
    let every = with_groups_that_exist(&every);
    let directory = tempfile::tempdir().unwrap();
    for (name, content) in [("example", &example), ("every", &every)] {
        let file = directory.path().join(name);
        fs::write(&file, content).unwrap();
        let ran = Command::new(env!("CARGO_BIN_EXE_pmacd"))
            .arg("--config")
            .arg(&file)
            .arg("--check")
            .output()
            .unwrap();
        assert!(ran.status.success(), "{name}: {}", String::from_utf8_lossy(&ran.stderr));
    }
}
